//! What is sent, when again, what is given up, and what a signature is worth.

use super::endpoint::Endpoint;
use super::topics::Topics;
use super::*;
use crate::diagnosis::fault::ComponentKind;
use proptest::prelude::*;

fn courier(max_waiting: usize) -> Courier {
    Courier::new(Queue::new(Progress::default(), max_waiting), Backoff::default())
}

/// What is sent when the receiver answers `answer` to everything.
fn sent(courier: &mut Courier, answer: &Answer, now_s: f64) -> Vec<u64> {
    let mut sent = Vec::new();
    while let Next::Send(place) = courier.next(now_s) {
        sent.push(place);
        courier.answered(answer, now_s, 0.5);
    }
    sent
}

#[test]
fn waits_double_up_to_the_longest_and_jitter_takes_half_of_it() {
    let backoff = Backoff { first_s: 1.0, max_s: 60.0 };
    let whole: Vec<f64> = (1..10).map(|n| backoff.wait_s(n, 1.0)).collect();
    assert_eq!(whole, [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0]);
    assert_eq!((backoff.wait_s(3, 0.0), backoff.wait_s(3, 0.5)), (2.0, 3.0));
    assert_eq!(backoff.wait_s(u32::MAX, 1.0).to_bits(), 60.0_f64.to_bits());
    for wrong in [f64::NAN, -1.0, f64::NEG_INFINITY] {
        assert_eq!(backoff.wait_s(1, wrong).to_bits(), 0.5_f64.to_bits());
    }
    assert_eq!(backoff.wait_s(1, 2.0).to_bits(), 1.0_f64.to_bits());
}

#[test]
fn a_receiver_dead_for_an_hour_gets_everything_in_order_afterwards() {
    let mut courier = courier(1000);
    let (mut now_s, mut attempts, mut arrived) = (0.0, Vec::new(), Vec::new());
    for place in 1..=200 {
        courier.see(place, place % 2 == 0);
    }
    while courier.queue().n_waiting() > 0 {
        match courier.next(now_s) {
            Next::Send(place) => {
                attempts.push(now_s);
                let is_up = now_s >= 3600.0;
                let down = Answer::Failed("down".to_owned());
                let answer = if is_up { Answer::Status(200, None) } else { down };
                courier.answered(&answer, now_s, 0.3);
                assert_eq!(courier.failure().is_some(), !is_up);
                if is_up {
                    arrived.push(place);
                }
            }
            Next::At(at_s) => {
                assert!(at_s > now_s && at_s - now_s <= 60.0, "{now_s} {at_s}");
                now_s = at_s;
            }
            Next::Idle => panic!("something waits"),
        }
    }
    assert_eq!(arrived, (1..=100).map(|n| 2 * n).collect::<Vec<u64>>());
    assert!(now_s < 3661.0, "told within a minute: {now_s}");
    let n_vain = attempts.iter().filter(|at_s| **at_s < 3600.0).count();
    assert!((60..130).contains(&n_vain), "neither silent nor a flood: {n_vain}");
    let progress = courier.progress();
    assert_eq!((progress.n_delivered, progress.settled_until), (100, 200));
}

#[test]
fn only_answers_about_the_event_itself_give_it_up() {
    for status in [400, 406, 409, 413, 415, 422] {
        let mut courier = courier(10);
        (1..=3).for_each(|place| courier.see(place, true));
        assert_eq!(sent(&mut courier, &Answer::Status(status, None), 0.0), [1, 2, 3], "{status}");
        assert_eq!(courier.progress().n_refused, 3);
    }
    for status in [301, 302, 401, 403, 404, 405, 408, 410, 425, 429, 500, 502, 503] {
        let mut courier = courier(10);
        (1..=3).for_each(|place| courier.see(place, true));
        assert_eq!(sent(&mut courier, &Answer::Status(status, None), 0.0), [1], "{status}");
        assert!(courier.failure().unwrap().contains(&status.to_string()));
        assert_eq!((courier.progress(), courier.queue().n_waiting()), (Progress::default(), 3));
        assert_eq!(sent(&mut courier, &Answer::Status(204, None), 10.0), [1, 2, 3], "{status}");
        assert_eq!(courier.failure(), None);
    }
}

#[test]
fn a_receiver_may_ask_for_a_longer_wait_but_not_for_ever() {
    for (asked_s, waited_s) in
        [(20.0, 20.0), (1e9, 3600.0), (f64::NAN, 1.0), (-5.0, 1.0), (0.2, 1.0)]
    {
        let mut courier = courier(10);
        courier.see(1, true);
        courier.answered(&Answer::Status(429, Some(asked_s)), 100.0, 1.0);
        assert_eq!(courier.next(100.0), Next::At(100.0 + waited_s), "{asked_s}");
    }
}

#[test]
fn too_many_give_up_the_oldest_and_count_it() {
    let mut courier = courier(3);
    (1..=10).for_each(|place| courier.see(place, place != 4));
    let progress = courier.progress();
    assert_eq!((progress.n_given_up, progress.settled_until), (6, 7));
    assert_eq!(sent(&mut courier, &Answer::Status(200, None), 0.0), [8, 9, 10]);
    assert_eq!(courier.progress().settled_until, 10);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// However often it is killed, with whatever answers: every wanted event is delivered, refused or given up,
    /// first deliveries are in order, and a restart sends again only what was not settled.
    #[test]
    fn every_event_has_one_fate(
        wanted in prop::collection::vec(any::<bool>(), 1..60),
        answers in prop::collection::vec(0_u8..4, 1..200),
        max_waiting in 1_usize..40,
    ) {
        let mut kept = Progress::default();
        let mut queue = Courier::new(Queue::new(kept, max_waiting), Backoff::default());
        let (mut seen, mut now_s, mut delivered) = (0_usize, 0.0, Vec::new());
        for answer in answers {
            // A few more events come, or all at once after a restart.
            let upto = (seen + 2).min(wanted.len());
            for (place, is_wanted) in (1..).zip(&wanted).take(upto).skip(seen) {
                queue.see(place, *is_wanted);
            }
            seen = upto;
            now_s += 4000.0;
            if let Next::Send(place) = queue.next(now_s) {
                match answer {
                    0 => queue.answered(&Answer::Failed(String::new()), now_s, 0.0),
                    1 => {
                        queue.answered(&Answer::Status(200, None), now_s, 0.0);
                        prop_assert!(delivered.last().is_none_or(|last| *last < place));
                        delivered.push(place);
                    }
                    2 => queue.answered(&Answer::Status(422, None), now_s, 0.0),
                    _ => {
                        // Killed: what was kept after the last answer is all that is left.
                        queue = Courier::new(Queue::new(kept, max_waiting), Backoff::default());
                        for (place, is_wanted) in (1..).zip(&wanted).take(seen) {
                            queue.see(place, *is_wanted);
                        }
                    }
                }
            }
            kept = queue.progress();
            let n_wanted = wanted[..seen].iter().filter(|wanted| **wanted).count();
            let n_settled = kept.n_delivered + kept.n_refused + kept.n_given_up;
            prop_assert_eq!(n_settled + queue.queue().n_waiting() as u64, n_wanted as u64);
        }
    }
}

#[test]
fn signatures_are_those_of_the_standard() {
    // The example of Standard Webhooks 1.0.0.
    let key = signature::read_key("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw").unwrap();
    let signed = signature::sign(
        &key,
        "msg_p5jXN8AQM9LWM0D4loKWxJek",
        1_614_265_330,
        "{\"test\": 2432232314}",
    );
    assert_eq!(signed, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    let other = signature::sign(&key, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_331, "{}");
    assert_ne!(other, signed);
}

#[test]
fn secrets_are_long_enough_and_never_shown() {
    for (wrong, words) in [("short", "16 bytes"), ("whsec_!", "base64"), ("whsec_YWJj", "16 bytes")]
    {
        let message = signature::read_key(wrong).unwrap_err();
        assert!(message.contains(words) && !message.contains(wrong), "{message}");
    }
    let key = signature::read_key("0123456789abcdef").unwrap();
    assert_eq!(
        (key.reveal(), format!("{key:?}")),
        (&b"0123456789abcdef"[..], "Secret(…)".to_owned())
    );
}

#[test]
fn an_address_is_encrypted_or_of_this_computer_and_its_path_is_not_shown() {
    for text in [
        "https://alarms.example.org/hook/T0K3N?key=T0K3N",
        "http://127.0.0.1:9000/T0K3N",
        "http://[::1]/T0K3N",
        "http://LOCALHOST:1/T0K3N",
    ] {
        let endpoint = Endpoint::parse(text, false).unwrap();
        assert!(endpoint.uri().to_string().contains("T0K3N"));
        let shown = format!("{endpoint} {endpoint:?}");
        assert!(!shown.contains("T0K3N"), "{shown}");
    }
    for (text, words) in [
        ("http://192.168.1.4/T0K3N", "in the clear"),
        ("http://localhost.example.org/T0K3N", "in the clear"),
        ("https://user:T0K3N@example.org/", "headers_file"),
        ("ftp://example.org/T0K3N", "https://"),
        ("/T0K3N", "names no host"),
        ("http://exa mple/T0K3N", "not a URL"),
    ] {
        let message = Endpoint::parse(text, false).unwrap_err();
        assert!(message.contains(words) && !message.contains("T0K3N"), "{text}: {message}");
    }
    assert!(Endpoint::parse("http://192.168.1.4/", true).is_ok());
}

#[test]
fn topics_keep_their_levels_whatever_the_names() {
    let topics = Topics::new("/plant/rotorwatch/");
    let bearing = Subject::Component(ComponentKind::Bearing, "drive end/1".to_owned());
    assert_eq!(
        topics.health("rig-1", &bearing),
        "plant/rotorwatch/rig-1/components/bearing/drive end%2F1"
    );
    assert_eq!(topics.health("a+b#c", &Subject::Machine), "plant/rotorwatch/a%2Bb%23c/state");
    assert_eq!(topics.alarm("rig-1", 12), "plant/rotorwatch/rig-1/alarms/12");
    assert_eq!(topics.events("$x\u{7f}"), "plant/rotorwatch/%24x%7F/events");
}
