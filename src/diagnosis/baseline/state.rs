//! The operating state a baseline belongs to: speed and load.

use crate::units::Hz;

/// Speeds that differ by no more than this, relative, are one operating state.
pub const SPEED_TOLERANCE: f64 = 0.05;

/// Loads that differ by no more than this part of the larger are one bin where the machine file states
/// no bins.
pub const LOAD_TOLERANCE: f64 = 0.2;

/// Speed and load of a window or a record; what is unknown fits everything.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OperatingPoint {
    /// Speed of the first shaft.
    pub speed: Option<Hz>,
    /// Load, in the unit of the machine's load sensor.
    pub load: Option<f64>,
}

impl OperatingPoint {
    /// Why `self`, a record's, does not fit `now`; `None`: it fits. `load_bins`: rising inner edges of the
    /// bins of load, a value on an edge belonging to the higher bin; empty: [`LOAD_TOLERANCE`].
    #[must_use]
    pub fn unfit(&self, now: &Self, load_bins: &[f64]) -> Option<String> {
        if let (Some(a), Some(b)) = (self.speed, now.speed)
            && !is_same_speed(a, b)
        {
            return Some(format!("its speed of {:.2} Hz differs by more than 5 %", a.0));
        }
        let (a, b) = (self.load?, now.load?);
        if load_bins.is_empty() {
            return (!is_near(a, b)).then(|| {
                format!("its load of {a:.4} differs from {b:.4} by more than 20 %, and limits.load_bins states no bins")
            });
        }
        let (of_a, of_b) = (bin(a, load_bins), bin(b, load_bins));
        (of_a != of_b).then(|| {
            format!("its load of {a:.4} is in bin {of_a} and not, as {b:.4}, in bin {of_b}")
        })
    }

    /// Whether both name the same operating state, so that one baseline takes the place of the other.
    #[must_use]
    pub fn is_same(&self, other: &Self, load_bins: &[f64]) -> bool {
        self.speed.is_some() == other.speed.is_some()
            && self.load.is_some() == other.load.is_some()
            && self.unfit(other, load_bins).is_none()
    }
}

/// Whether two speeds are one operating state; standing still is one of its own.
fn is_same_speed(a: Hz, b: Hz) -> bool {
    (a.0 - b.0).abs() <= SPEED_TOLERANCE * b.0.abs()
}

fn is_near(a: f64, b: f64) -> bool {
    (a - b).abs() <= LOAD_TOLERANCE * a.abs().max(b.abs())
}

/// Number of the bin, from 0.
fn bin(load: f64, inner_edges: &[f64]) -> usize {
    inner_edges.partition_point(|edge| *edge <= load)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(speed: f64, load: f64) -> OperatingPoint {
        OperatingPoint { speed: Some(Hz(speed)), load: Some(load) }
    }

    #[test]
    fn a_speed_within_five_per_cent_fits() {
        let now = at(10.0, 1.0);
        assert_eq!(at(10.5, 1.0).unfit(&now, &[]), None);
        assert!(at(10.6, 1.0).unfit(&now, &[]).unwrap().contains("10.60 Hz"));
        assert!(at(9.4, 1.0).unfit(&now, &[]).is_some());
        assert!(at(10.0, 1.0).unfit(&at(0.0, 1.0), &[]).is_some(), "nothing is near standstill");
        assert_eq!(at(0.0, 1.0).unfit(&at(0.0, 1.0), &[]), None);
    }

    #[test]
    fn stated_bins_decide_and_an_edge_belongs_to_the_higher() {
        let bins = [10.0, 20.0];
        let fits = |a, b| at(1.0, a).unfit(&at(1.0, b), &bins).is_none();
        assert!(fits(0.0, 9.99) && fits(10.0, 19.9) && fits(20.0, 1e6) && fits(-5.0, 5.0));
        assert!(!fits(9.99, 10.0) && !fits(19.9, 20.0));
        let why = at(1.0, 5.0).unfit(&at(1.0, 25.0), &bins).unwrap();
        assert!(why.contains("bin 0") && why.contains("bin 2"), "{why}");
    }

    #[test]
    fn without_bins_loads_within_a_fifth_of_the_larger_are_one() {
        let fits = |a, b| at(1.0, a).unfit(&at(1.0, b), &[]).is_none();
        assert!(fits(8.0, 10.0) && fits(10.0, 8.0) && fits(0.0, 0.0) && fits(-9.0, -10.0));
        assert!(!fits(7.9, 10.0) && !fits(0.0, 1.0) && !fits(-1.0, 1.0));
    }

    #[test]
    fn what_is_unknown_fits_everything_and_is_the_same_as_nothing() {
        let nothing = OperatingPoint::default();
        let now = at(10.0, 1.0);
        assert_eq!(nothing.unfit(&now, &[]), None);
        assert_eq!(now.unfit(&nothing, &[]), None);
        assert!(!nothing.is_same(&now, &[]) && nothing.is_same(&nothing, &[]));
        assert!(at(10.2, 1.1).is_same(&now, &[]) && !at(12.0, 1.0).is_same(&now, &[]));
    }
}
