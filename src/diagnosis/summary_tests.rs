//! From windows to one verdict.

use super::*;

fn part(state: State) -> ComponentDiagnosis {
    ComponentDiagnosis {
        id: "b".into(),
        kind: ComponentKind::Bearing,
        state,
        fault: state.is_accusation().then_some(FaultMode::InnerRace),
        severity: state.is_accusation().then_some(0.4),
        confidence: None,
        why: "w".into(),
        evidence: vec![],
        other_faults: vec![],
        gear: None,
    }
}

fn window(i: usize, state: State) -> Judged {
    Judged {
        time_s: (i as f64, i as f64 + 1.0),
        segment: 0,
        components: vec![part(state)],
        speed: Some(Hz(10.0)),
        load: None,
        speed_source: Some(SpeedSource::Capture),
        speed_confidence: 1.0,
        shaft_speeds: vec![],
        operating_state: OperatingState::Running,
        data_quality: DataQuality::Ok,
        sample_ranges: vec![("x".into(), i as u64 * 50, i as u64 * 50 + 100)],
        set_aside: vec![],
        notes: vec![],
        baselines: vec![],
    }
}

#[test]
fn what_is_set_aside_is_not_used_and_counted_once() {
    // Windows of 100 samples that begin every 50: sample 60 lies in both.
    let set_aside = |at: &[u64]| at.iter().map(|at| ("x".to_owned(), *at)).collect();
    let first = Judged { set_aside: set_aside(&[7, 60]), ..window(0, State::Healthy) };
    let second = Judged { set_aside: set_aside(&[60]), ..window(1, State::Healthy) };
    assert_eq!(samples_used([&first]), 98);
    assert_eq!(samples_in([&first, &second]), (150, 2));
    assert_eq!(samples_used([&first, &second]), 148);
}

fn conclude_states(states: &[State]) -> Diagnosis {
    let windows: Vec<Judged> = states.iter().enumerate().map(|(i, s)| window(i, *s)).collect();
    conclude("m", &windows).unwrap()
}

#[test]
fn most_of_the_last_windows_decide() {
    use State::{Healthy, Warning};
    assert_eq!(conclude_states(&[Warning, Warning, Healthy, Healthy, Healthy]).state, Healthy);
    assert_eq!(conclude_states(&[Healthy, Healthy, Healthy, Warning, Warning]).state, Warning);
    assert_eq!(conclude_states(&[Healthy, Healthy, Warning]).state, Healthy);
    assert_eq!(conclude_states(&[Warning]).state, Warning);
    // A record of two windows that disagree is neither.
    let open = conclude_states(&[Warning, Healthy]);
    assert_eq!(open.state, State::Undetermined);
    assert_eq!(open.components[0].why, "w (in half of 2 windows, not in most)");
    assert_eq!(open.components[0].fault, None);
}

#[test]
fn a_lone_window_does_not_date_the_first_warning() {
    use State::{Healthy, Warning};
    let found = conclude_states(&[Healthy, Warning, Healthy, Warning, Warning, Warning, Warning]);
    assert_eq!(found.first_warning_s, Some(3.0));
    assert_eq!(found.first_damaged_s, None);
    assert_eq!(found.timeline.unwrap().time_s.len(), 7);
}

#[test]
fn what_the_whole_is_judged_is_dated() {
    use State::{Damaged, Healthy};
    let first = |states: &[State]| {
        let found = conclude_states(states);
        assert_eq!(found.first_damaged_s.is_some(), found.state == Damaged, "{states:?}");
        (found.first_warning_s, found.first_damaged_s)
    };
    assert_eq!(
        first(&[Healthy, Damaged, Healthy, Damaged, Damaged, Healthy]),
        (Some(1.0), Some(1.0))
    );
    assert_eq!(first(&[Damaged, Healthy, Healthy, Damaged, Damaged]), (Some(3.0), Some(3.0)));
    assert_eq!(first(&[Healthy, Healthy, Healthy, Damaged]), (None, None));
    assert_eq!(first(&[Healthy, Damaged]), (None, None));
}

#[test]
fn undetermined_whole_only_if_nothing_was_judged() {
    use State::{Healthy, Undetermined};
    assert_eq!(whole_state(&[part(Undetermined), part(Healthy)]), Healthy);
    assert_eq!(whole_state(&[part(Undetermined)]), Undetermined);
}

#[test]
fn overlapping_windows_count_samples_once() {
    assert_eq!(conclude_states(&[State::Healthy, State::Healthy]).samples_used, 150);
}
