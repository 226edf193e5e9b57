//! Tokens, the file of them, and the door.

use super::buckets::Buckets;
use super::*;
use crate::signal::Timestamp;
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicI64;
use std::sync::atomic::Ordering;

fn secret(n: u8) -> Secret {
    Secret::of(&[n; 32])
}

fn token(n: u8, label: &str, role: Role, machines: &[&str]) -> Token {
    let machines: Vec<String> = machines.iter().map(|id| (*id).to_owned()).collect();
    Token::new(&secret(n), (label, role), &machines, (Some(Timestamp(1_000_000_000)), None))
        .unwrap()
}

fn three() -> Tokens {
    let mut tokens = Tokens::default();
    tokens.add(token(1, "wall \"A\"", Role::Viewer, &[])).unwrap();
    tokens.add(token(2, "M. Ito", Role::Operator, &["rig-1", "rig-2"])).unwrap();
    let times = (None, Some(Timestamp(5_000_000_000)));
    tokens.add(Token::new(&secret(3), ("gateway", Role::Ingest), &[], times).unwrap()).unwrap();
    tokens
}

/// A door, and the clock it sees, s.
fn door() -> (Door, Arc<AtomicI64>) {
    let clock = Arc::new(AtomicI64::new(2));
    let seen = Arc::clone(&clock);
    let now: Now = Arc::new(move || {
        let s = seen.load(Ordering::Relaxed);
        (Timestamp(s * 1_000_000_000), s as f64)
    });
    (Door::new(Some(three()), Counters::default(), now), clock)
}

fn peer(text: &str) -> Option<IpAddr> {
    Some(text.parse().unwrap())
}

#[test]
fn a_secret_has_256_bits_and_is_never_shown() {
    let a = secret(7);
    assert_eq!(a.reveal().len(), "rotorwatch_".len() + 43);
    assert!(a.reveal().bytes().all(|b| b.is_ascii_alphanumeric() || b"_-".contains(&b)));
    assert_ne!(a.reveal(), secret(8).reveal());
    let shown = format!("{a:?} {:?} {}", three(), three().text());
    for n in 1..=7 {
        assert!(!shown.contains(secret(n).reveal()));
    }
}

#[test]
fn each_role_may_what_those_below_it_may_and_only_senders_and_admins_send() {
    use Role::{Admin, Ingest, Operator, Viewer};
    let may = |needed: Role| Role::ALL.map(|role| role.may(needed));
    assert_eq!(may(Viewer), [true, true, true, false]);
    assert_eq!(may(Operator), [false, true, true, false]);
    assert_eq!(may(Admin), [false, false, true, false]);
    assert_eq!(may(Ingest), [false, false, true, true]);
    for role in Role::ALL {
        assert_eq!(Role::parse(role.name()), Some(role));
    }
    assert_eq!(Role::parse("root"), None);
}

#[test]
fn what_is_written_is_read_unchanged() {
    let tokens = three();
    let text = tokens.text();
    assert_eq!(Tokens::parse(&text), Ok(tokens), "{text}");
    assert!(text.contains("label = 'wall \"A\"'") || text.contains("label = \"wall \\\"A\\\"\""));
    assert_eq!(Tokens::parse(""), Ok(Tokens::default()));
}

#[test]
fn a_mistake_in_the_file_names_its_place_and_tells_nothing_of_it() {
    let text = three().text();
    let raw = secret(9);
    let digest = text.lines().find(|line| line.starts_with("sha256")).unwrap();
    let misplaced = format!("sha256 = \"{}\"", raw.reveal());
    for (from, to, expected) in [
        (digest, misplaced.as_str(), "token 1: sha256 is not the 64 hexadecimal digits"),
        (digest, "", "not a list of [[token]]"),
        ("role = \"viewer\"", "role = \"root\"", "token 1: role is not \"viewer\", "),
        ("\"M. Ito\"", "\"gateway\"", "tokens 2 and 3 have the same label"),
        ("\"M. Ito\"", "\" M. Ito\"", "token 2: a label has 1 to 64 characters"),
        ("\"M. Ito\"", "\"\"", "token 2: a label has 1 to 64 characters"),
        ("\"rig-2\"", "\"\"", "token 2: a token is of at most"),
        ("expires = \"", "expires = \"x", "token 3: expires is not a time such as"),
        ("expires = \"", "until = \"", "not a list of [[token]]"),
        ("[[token]]", "[[token", "line 4: not a list"),
    ] {
        let wrong = text.replacen(from, to, 1);
        assert_ne!(wrong, text, "{from}");
        let told = Tokens::parse(&wrong).unwrap_err().to_string();
        assert!(told.contains(expected), "{from} → {to}: {told}");
        assert!(!told.contains(raw.reveal()), "{told}");
    }
    let double = text.clone()
        + &text
            .split_once("[[token]]")
            .map(|(_, rest)| {
                let one = rest.split("[[token]]").next().unwrap();
                format!("\n[[token]]{}", one.replace("wall", "well"))
            })
            .unwrap();
    let told = Tokens::parse(&double).unwrap_err().to_string();
    assert_eq!(told, "tokens 1 and 4 have the same secret");
}

#[test]
fn a_label_is_added_once_and_revoked_by_its_name() {
    let mut tokens = three();
    let error = tokens.add(token(9, "M. Ito", Role::Viewer, &[])).unwrap_err();
    assert_eq!(error, ListError::Double { first: 2, second: 4, what: "label" });
    assert_eq!(tokens, three());
    assert!(!tokens.revoke("m. ito"));
    assert!(tokens.revoke("M. Ito"));
    assert_eq!(tokens.labels().into_iter().collect::<Vec<_>>(), ["gateway", "wall \"A\""]);
}

#[test]
fn a_door_without_tokens_is_open_and_one_without_any_is_shut() {
    let open = Door::open();
    assert_eq!(open.admit(None, peer("10.0.0.1")), Ok(None));
    assert_eq!(open.admit(Some("anything"), None), Ok(None));
    assert!(open.holds(None) && open.is_open());
    open.set(three());
    assert!(open.is_open(), "who bound an open door did not bind a shut one");
    let (shut, _) = door();
    shut.set(Tokens::default());
    assert_eq!(shut.admit(Some(secret(1).reveal()), None), Err(Denied::Unknown));
    assert!(!shut.holds(None));
}

#[test]
fn a_token_is_let_in_until_it_is_revoked_changed_or_over() {
    let (door, clock) = door();
    let who = |n: u8| door.admit(Some(secret(n).reveal()), peer("10.0.0.1"));
    let ito = who(2).unwrap();
    assert_eq!(ito.as_ref().unwrap().label(), "M. Ito");
    assert!(ito.as_ref().unwrap().sees("rig-2") && !ito.as_ref().unwrap().sees("rig-3"));
    let gateway = who(3).unwrap();
    assert!(door.holds(ito.as_ref()) && door.holds(gateway.as_ref()) && !door.holds(None));
    for wrong in [None, Some("")] {
        assert_eq!(door.admit(wrong, None), Err(Denied::Missing));
    }
    let long = "x".repeat(1 << 20);
    let cut = &secret(1).reveal()[1..].to_owned();
    for wrong in ["x", long.as_str(), cut, &secret(1).reveal().to_uppercase()] {
        assert_eq!(door.admit(Some(wrong), None), Err(Denied::Unknown));
    }
    clock.store(5, Ordering::Relaxed);
    assert_eq!(who(3), Err(Denied::Expired));
    assert!(!door.holds(gateway.as_ref()));
    let mut fewer = three();
    fewer.revoke("M. Ito");
    door.set(fewer.clone());
    assert!(!door.holds(ito.as_ref()));
    assert_eq!(who(2), Err(Denied::Unknown));
    // The same secret with another role is another token: who came in with the old one asks again.
    fewer.add(token(2, "M. Ito", Role::Viewer, &[])).unwrap();
    door.set(fewer);
    assert!(!door.holds(ito.as_ref()));
    assert_eq!(who(2).unwrap().unwrap().role(), Role::Viewer);
}

#[test]
fn failures_of_a_peer_are_limited_and_lock_out_nobody_with_a_token() {
    let (door, clock) = door();
    let fail = |from: &str| door.admit(Some("wrong"), peer(from)).unwrap_err();
    for _ in 0..10 {
        assert_eq!(fail("2001:db8::1"), Denied::Unknown);
    }
    assert_eq!(fail("2001:db8::2"), Denied::TooMany { after_s: 5.0 }, "one /64 is one peer");
    assert_eq!(fail("2001:db8:0:1::2"), Denied::Unknown);
    assert!(door.admit(Some(secret(1).reveal()), peer("2001:db8::1")).is_ok());
    clock.store(7, Ordering::Relaxed);
    assert_eq!(fail("2001:db8::1"), Denied::Unknown);
    assert!(matches!(fail("2001:db8::1"), Denied::TooMany { .. }));
}

#[test]
fn who_says_no_token_or_one_that_is_over_guesses_nothing_and_is_paced_like_others() {
    let (door, clock) = door();
    let door = door.with_requests(10.0);
    clock.store(5, Ordering::Relaxed);
    let over = secret(3);
    for _ in 0..20 {
        assert_eq!(door.admit(None, peer("192.0.2.1")), Err(Denied::Missing));
        assert_eq!(door.admit(Some(over.reveal()), peer("192.0.2.1")), Err(Denied::Expired));
    }
    for wrong in [None, Some(over.reveal())] {
        assert!(matches!(door.admit(wrong, peer("192.0.2.1")), Err(Denied::TooFast { .. })));
    }
    // The attempts are there as a whole, and others are not held back.
    for _ in 0..10 {
        assert_eq!(door.admit(Some("x"), peer("192.0.2.1")), Err(Denied::Unknown));
    }
    assert!(matches!(door.admit(Some("x"), peer("192.0.2.1")), Err(Denied::TooMany { .. })));
    assert_eq!(door.admit(None, peer("192.0.2.2")), Err(Denied::Missing));
}

#[test]
fn the_table_of_peers_is_bounded() {
    let mut failures = Buckets::new(10.0, 0.2);
    for i in 0..5000_u32 {
        let peer = IpAddr::V4(i.into());
        assert_eq!(failures.take(peer, f64::from(i) * 1e-3), Ok(()));
        assert!(failures.len() <= 1024);
    }
    // After a while everybody is forgotten to make room.
    assert_eq!(failures.take(IpAddr::V4(9999.into()), 1e3), Ok(()));
    assert_eq!(failures.len(), 1);
}

#[test]
fn requests_of_a_token_are_paced_wherever_it_comes_from_and_those_of_this_computer_are_not() {
    let (door, clock) = door();
    let door = door.with_requests(2.0);
    let token = door.admit(Some(secret(1).reveal()), None).unwrap().unwrap();
    let of = |n: u8| peer(&format!("192.0.2.{n}"));
    for n in 0..8 {
        assert_eq!(door.pace(Some(&token), of(n)), Ok(()));
    }
    assert_eq!(door.pace(Some(&token), of(9)), Err(Denied::TooFast { after_s: 1.0 }));
    let other = door.admit(Some(secret(2).reveal()), None).unwrap().unwrap();
    assert_eq!(door.pace(Some(&other), of(9)), Ok(()), "another token has its own");
    clock.store(5, Ordering::Relaxed);
    assert_eq!(door.pace(Some(&token), of(9)), Ok(()));
    // Without tokens an address is one, and the loopback is nobody's.
    for _ in 0..8 {
        assert_eq!(door.pace(None, of(1)), Ok(()));
    }
    assert!(door.pace(None, of(1)).is_err() && door.pace(None, of(2)).is_ok());
    assert!((0..100).all(|_| door.pace(None, peer("::1")).is_ok()));
}
