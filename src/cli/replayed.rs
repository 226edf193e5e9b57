//! What `diagnose --evidence` prints of a capture that keeps the windows of an alarm: each judged again, equal or not.

use crate::api::wire::diagnosis::DiagnosisDocument;
use crate::api::wire::evidence::EvidenceDocument;
use crate::api::wire::evidence::EvidenceWindowWire;
use crate::evidence::again::Again;
use crate::evidence::again::Compared;

/// Lines for people, one a window.
pub(super) fn text(again: &Again) -> String {
    let n = again.windows.len();
    let n_equal = again.windows.iter().filter(|window| window.is_equal()).count();
    let mut text = match n {
        0 => "evidence: no window is kept, only raw data\n".to_owned(),
        _ if n == n_equal => format!("evidence: {n} windows judged again, all equal bit by bit\n"),
        _ => format!("evidence: {n} windows judged again, {} different\n", n - n_equal),
    };
    for window in &again.windows {
        let (from_s, to_s) = window.time_s;
        let Compared { n_features, n_different, differences, .. } = window;
        let found = if window.is_equal() {
            format!("equal ({n_features} features, verdict, alarm levels)")
        } else {
            format!(
                "different ({n_different} of {n_features} features): {}",
                differences.join("; ")
            )
        };
        text.push_str(&format!("  window {from_s:.3} s to {to_s:.3} s: {found}\n"));
    }
    if !again.raised.is_empty() {
        text.push_str(&format!("  above its alarm level then: {}\n", again.raised));
    }
    if let Some(why) = again.made_elsewhere() {
        text.push_str(&format!("  note: {why}\n"));
    }
    text
}

/// The document of a capture.
pub(super) fn document(again: &Again, capture: &str) -> EvidenceDocument {
    let window = |window: &Compared| EvidenceWindowWire {
        from_s: window.time_s.0,
        to_s: window.time_s.1,
        equal: window.is_equal(),
        features: window.n_features,
        different: window.n_different,
        differences: window.differences.clone(),
    };
    let diagnosis = again.diagnosis.as_ref();
    EvidenceDocument {
        schema: EvidenceDocument::SCHEMA,
        capture: capture.to_owned(),
        equal: again.is_equal(),
        made_elsewhere: again.made_elsewhere(),
        windows: again.windows.iter().map(window).collect(),
        raised: again.raised.clone(),
        diagnosis: diagnosis.map(|diagnosis| DiagnosisDocument::new(diagnosis, Some(capture))),
    }
}
