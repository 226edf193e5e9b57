//! Effect size → severity 0…1 and state. Healthy < 0.25 ≤ warning < 0.5 ≤ damaged.

use super::fault::State;

/// Severity from which a proven fault is a warning.
pub const WARNING: f64 = 0.25;
/// Severity from which it is damaged.
pub const DAMAGED: f64 = 0.5;

/// Effect size D of a bearing line that makes a warning.
///
/// A train of impacts that carries the part η of a band's energy gives the squared envelope lines of
/// depth up to 2η: at D = 0.5 a quarter, at D = 1 half of the energy in the band that hears it best
/// comes from the defect.
pub const WARNING_DEPTH: f64 = 0.5;

/// Severity of a bearing line of effect size D (S1): D/2 up to 1, then 1 − 1/(2D); smooth, strictly
/// rising, below 1.
#[must_use]
pub fn of_depth(depth: f64) -> f64 {
    if depth <= 1.0 { depth.max(0.0) / 2.0 } else { 1.0 - 0.5 / depth }
}

/// Severity of a level that stands at `ratio` to its reference (S2), with the ratios that make a
/// warning and damage: linear in ln(ratio) up to damage, then saturating; strictly rising above 1.
#[must_use]
pub fn of_ratio(ratio: f64, warning: f64, damaged: f64) -> f64 {
    let x = ratio.max(1.0).ln();
    let (w, d) = (warning.ln(), damaged.ln());
    if x <= w {
        WARNING * x / w
    } else if x <= d {
        WARNING + (DAMAGED - WARNING) * (x - w) / (d - w)
    } else {
        1.0 - (1.0 - DAMAGED) * d / x
    }
}

/// Severity shown of a component that is not accused (S3): the same order, squeezed below the warning.
#[must_use]
pub fn not_accused(severity: f64) -> f64 {
    squeezed(severity, WARNING)
}

/// Severity shown where the cause is not proven and damage may not be claimed (S3).
#[must_use]
pub fn not_damaged(severity: f64) -> f64 {
    if severity <= WARNING {
        severity
    } else {
        WARNING + squeezed(severity - WARNING, DAMAGED - WARNING)
    }
}

/// x → limit·(1 − e^(−x/limit)): strictly rising, below the limit.
fn squeezed(x: f64, limit: f64) -> f64 {
    limit * -(-x.max(0.0) / limit).exp_m1()
}

/// State of a proven fault of a severity.
#[must_use]
pub fn state(severity: f64) -> State {
    if severity >= DAMAGED {
        State::Damaged
    } else if severity >= WARNING {
        State::Warning
    } else {
        State::Healthy
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn anchors_hold() {
        assert!((of_depth(WARNING_DEPTH) - WARNING).abs() < 1e-15);
        assert!((of_depth(1.0) - DAMAGED).abs() < 1e-15);
        assert!((of_ratio(2.0, 2.0, 10.0) - WARNING).abs() < 1e-15);
        assert!((of_ratio(10.0, 2.0, 10.0) - DAMAGED).abs() < 1e-15);
        assert_eq!(state(of_depth(0.49)), State::Healthy);
        assert_eq!(state(of_depth(0.7)), State::Warning);
        assert_eq!(state(of_depth(1.2)), State::Damaged);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
        #[test]
        fn severity_rises_strictly_and_stays_below_one(a in 1.0..50.0_f64, step in 1e-3..10.0_f64) {
            prop_assert!(of_depth(a + step) > of_depth(a) && of_depth(a + step) < 1.0);
            let (low, high) = (of_ratio(a, 2.0, 10.0), of_ratio(a + step, 2.0, 10.0));
            prop_assert!(high > low && high < 1.0);
            let (a, b) = (of_depth(a / 50.0), of_depth((a + step) / 50.0));
            prop_assert!(not_accused(b) > not_accused(a) && not_accused(b) < WARNING);
            prop_assert!(not_damaged(b) > not_damaged(a) && not_damaged(b) < DAMAGED);
        }
    }
}
