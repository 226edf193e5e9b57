//! What a reduction to a few shapes costs in the sensors' band (equation R31).
//!
//! Compares how two bases of one plane answer forces at their stations. Must not know scenes.

use super::modes::Basis;

/// Damping ratio with which answers are compared: resonances that are a little apart are no error.
const DAMPING: f64 = 0.05;

/// Frequencies compared, from the first part of the corner to the last, each this factor higher.
const RANGE: (f64, f64, f64) = (0.02, 4.0, 1.02);

/// Order of the filter after which errors count.
const FILTER_ORDER: i32 = 8;

/// Expected error of accelerations at the degrees of freedom `seen`, relative to the largest, under forces at
/// `pushed`, if `reduced` takes the place of `whole` and an anti-alias filter cuts at `corner_hz`.
#[must_use]
pub fn expected_error(
    whole: &Basis,
    reduced: &Basis,
    pushed: &[usize],
    seen: &[usize],
    corner_hz: f64,
) -> f64 {
    let corner = std::f64::consts::TAU * corner_hz;
    let mut worst = 0.0_f64;
    for &out in seen {
        let (mut gap, mut size) = (0.0_f64, 0.0_f64);
        let mut omega = RANGE.0 * corner;
        while omega < RANGE.1 * corner {
            let filter = 1.0 / (1.0 + (omega / corner).powi(2 * FILTER_ORDER)).sqrt();
            let weight = omega * omega * filter;
            for &into in pushed {
                let (right, found) =
                    (answer(whole, into, out, omega), answer(reduced, into, out, omega));
                size = size.max(weight * right.0.hypot(right.1));
                gap = gap.max(weight * (found.0 - right.0).hypot(found.1 - right.1));
            }
            omega *= RANGE.2;
        }
        if size > 0.0 {
            worst = worst.max(gap / size);
        }
    }
    worst
}

/// Displacement at one degree of freedom under a unit force of angular frequency ω at another,
/// complex, m/N.
fn answer(basis: &Basis, into: usize, out: usize, omega: f64) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for (i, natural) in basis.omega_rad_per_s.iter().enumerate() {
        let share = basis.shapes[(into, i)] * basis.shapes[(out, i)];
        let (re, im) = (natural * natural - omega * omega, 2.0 * DAMPING * natural * omega);
        let square = re * re + im * im;
        sum.0 += share * re / square;
        sum.1 -= share * im / square;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::super::rotor::tests::rig;
    use super::*;

    #[test]
    fn missing_modes_and_missing_flexibility_are_seen() {
        let plane = rig(24).assemble();
        let stations = [3.5148, 17.4852].map(|inch| plane.displacement_at(inch * 0.0254));
        let whole = Basis::new(&plane, plane.n_dof(), &[]).unwrap();
        let error = |n: usize, stations_kept: &[usize]| {
            let reduced = Basis::new(&plane, n, stations_kept).unwrap();
            expected_error(&whole, &reduced, &stations, &stations, 4000.0)
        };
        assert!(expected_error(&whole, &whole, &stations, &stations, 4000.0) <= 0.0);
        let (few, bare, kept, more) =
            (error(4, &stations), error(16, &[]), error(16, &stations), error(24, &stations));
        // A mode of the band is missing; all are there but the supports too stiff; neither; and further
        // modes leave (f/f_cut)² of it: (16/37)² here.
        assert!(few > 0.1 && bare > 0.01, "{few} {bare}");
        assert!(kept < 1e-3 && kept < 0.1 * bare && more < 0.3 * kept, "{bare} {kept} {more}");
    }
}
