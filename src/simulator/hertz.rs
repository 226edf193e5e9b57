//! Hertzian point contact from geometry: elliptic integrals, not a table (equations R1–R4).
//!
//! Must not know bearings in motion; what turns is for [`super::contact`].

use std::f64::consts::PI;

/// Complete elliptic integrals K(m) and E(m) of parameter m = k², 0 ≤ m < 1.
///
/// Arithmetic-geometric mean; both to rounding. `None` outside the range.
#[must_use]
pub fn complete_elliptic(m: f64) -> Option<(f64, f64)> {
    if !(0.0..1.0).contains(&m) {
        return None;
    }
    let (mut a, mut b) = (1.0_f64, (1.0 - m).sqrt());
    let mut c = m.sqrt();
    let mut power = 0.5;
    let mut sum = power * c * c;
    // Quadratic convergence: 10 steps are enough for m up to 1 − 1e-16.
    for _ in 0..12 {
        let mean = 0.5 * (a + b);
        c = 0.5 * (a - b);
        b = (a * b).sqrt();
        a = mean;
        power *= 2.0;
        sum += power * c * c;
        if c.abs() <= f64::EPSILON * a {
            break;
        }
    }
    let first = PI / (2.0 * a);
    Some((first, first * (1.0 - sum)))
}

/// Curvature difference F(ρ) of a contact whose ellipse has the axis ratio κ > 1 (R1).
fn curvature_difference(kappa: f64) -> f64 {
    let square = kappa * kappa;
    let Some((first, second)) = complete_elliptic(1.0 - 1.0 / square) else { return 1.0 };
    ((square + 1.0) * second - 2.0 * first) / ((square - 1.0) * second)
}

/// Smallest F(ρ) that is told from a circular contact: below, δ* = 1 within 1e-13.
const CIRCULAR: f64 = 1e-6;

/// Axis ratio κ > 1 of the contact ellipse of a curvature difference F(ρ), 0 < F < 1: R1 solved.
fn axis_ratio(difference: f64) -> f64 {
    let (mut low, mut high) = (1e-12_f64, 30.0_f64); // ln κ
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if curvature_difference(middle.exp()) < difference {
            low = middle;
        } else {
            high = middle;
        }
        if high - low <= 1e-15 * high {
            break;
        }
    }
    (0.5 * (low + high)).exp()
}

/// Dimensionless approach δ* of a contact with curvature difference F(ρ), 0 ≤ F < 1 (R2).
///
/// `None` outside the range.
#[must_use]
pub fn dimensionless_approach(difference: f64) -> Option<f64> {
    if !(0.0..1.0).contains(&difference) {
        return None;
    }
    if difference < CIRCULAR {
        return Some(1.0);
    }
    let kappa = axis_ratio(difference);
    let (first, second) = complete_elliptic(1.0 - 1.0 / (kappa * kappa))?;
    Some(2.0 * first / PI * (PI / (2.0 * kappa * kappa * second)).cbrt())
}

/// Elastic constants of the two equal bodies in contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elasticity {
    /// Young's modulus, Pa.
    pub young_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
}

/// Load-deflection factor K of one contact, Q = K·δ^1.5, N/m^1.5 (R3).
///
/// `curvature_sum` Σρ in 1/m, `difference` F(ρ). `None` if they are no contact.
#[must_use]
pub fn contact_factor(elastic: Elasticity, curvature_sum: f64, difference: f64) -> Option<f64> {
    let approach = dimensionless_approach(difference)?;
    let modulus = elastic.young_pa / (1.0 - elastic.poisson * elastic.poisson);
    let factor = 2.0 * std::f64::consts::SQRT_2 / 3.0 * modulus;
    let factor = factor / (curvature_sum.sqrt() * approach.powf(1.5));
    (factor.is_finite() && factor > 0.0).then_some(factor)
}

/// Load Q at which the largest pressure 3Q/(2πab) of one contact is `pressure_pa`, N (R14).
///
/// `curvature_sum` Σρ in 1/m, `difference` F(ρ). `None` if they are no contact.
#[must_use]
pub fn load_at_pressure(
    elastic: Elasticity,
    curvature_sum: f64,
    difference: f64,
    pressure_pa: f64,
) -> Option<f64> {
    if !(0.0..1.0).contains(&difference) {
        return None;
    }
    let kappa = if difference < CIRCULAR { 1.0 + 1e-9 } else { axis_ratio(difference) };
    let (_, second) = complete_elliptic(1.0 - 1.0 / (kappa * kappa))?;
    // a·b of a load of 1 N, m²: a = (2κ²E/π)^⅓·s, b = (2E/(πκ))^⅓·s.
    let compliance = 2.0 * (1.0 - elastic.poisson * elastic.poisson) / elastic.young_pa;
    let scale = (1.5 / curvature_sum * compliance).cbrt();
    let (major, minor) =
        ((2.0 * kappa * kappa * second / PI).cbrt(), (2.0 * second / (PI * kappa)).cbrt());
    let area = major * minor * scale * scale;
    let load = (pressure_pa * PI * area / 1.5).powi(3);
    (load.is_finite() && load > 0.0).then_some(load)
}

/// Two contacts in series (R4).
#[must_use]
pub fn in_series(inner: f64, outer: f64) -> f64 {
    (inner.powf(-2.0 / 3.0) + outer.powf(-2.0 / 3.0)).powf(-1.5)
}

/// Ball on the groove of a race: curvature sum, 1/m, and difference.
///
/// `conformity` = groove radius ÷ ball diameter; `gamma` = d/D·cos φ, positive for the inner race,
/// negative for the outer one.
#[must_use]
pub fn ball_on_race(ball_diameter_m: f64, conformity: f64, gamma: f64) -> (f64, f64) {
    let rolling = 2.0 * gamma / (1.0 - gamma);
    let sum = 4.0 - 1.0 / conformity + rolling;
    (sum / ball_diameter_m, (1.0 / conformity + rolling) / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elliptic_integrals_have_their_known_values() {
        // Abramowitz & Stegun, table 17.1: m = 0, 0.5, 0.99.
        for (m, first, second) in [
            (0.0, 0.5 * PI, 0.5 * PI),
            (0.5, 1.854_074_677_301_372, 1.350_643_881_047_675),
            (0.99, 3.695_637_362_989_875, 1.015_993_545_025_224),
        ] {
            let (k, e) = complete_elliptic(m).unwrap();
            assert!((k - first).abs() < 1e-14 && (e - second).abs() < 1e-14, "{m}: {k} {e}");
        }
        assert_eq!(complete_elliptic(1.0), None);
    }

    #[test]
    fn the_dimensionless_approach_is_that_of_the_table() {
        // Harris, Rolling Bearing Analysis, table 6.1, to its four figures.
        for (difference, approach) in
            [(0.0, 1.0), (0.1075, 0.9974), (0.5916, 0.9077), (0.87366, 0.7169), (0.97290, 0.4960)]
        {
            let found = dimensionless_approach(difference).unwrap();
            assert!((found - approach).abs() < 1e-4, "{difference}: {found}");
        }
        let found = dimensionless_approach(0.9995).unwrap();
        assert!((found - 0.169).abs() < 1e-3, "{found}");
        assert_eq!(dimensionless_approach(1.0), None);
    }

    #[test]
    fn the_solution_satisfies_its_equation() {
        for difference in [1e-4, 0.01, 0.3, 0.7, 0.95, 0.999] {
            let (mut low, mut high) = (1e-12_f64, 30.0_f64);
            for _ in 0..200 {
                let middle = 0.5 * (low + high);
                if curvature_difference(middle.exp()) < difference {
                    low = middle
                } else {
                    high = middle
                }
            }
            assert!((curvature_difference(low.exp()) - difference).abs() < 1e-10, "{difference}");
        }
    }

    #[test]
    fn a_ball_on_a_plane_yields_at_the_load_of_the_closed_form() {
        // Sphere on plane: p = (6·Q·E*²/(π³·R²))^⅓ with E* = E/(2·(1 − ν²)).
        let steel = Elasticity { young_pa: 206.8e9, poisson: 0.3 };
        let (radius, pressure) = (4e-3, 4.2e9);
        let modulus = 206.8e9 / (2.0 * 0.91);
        let expected = pressure * pressure * pressure * PI.powi(3) * radius * radius
            / (6.0 * modulus * modulus);
        let found = load_at_pressure(steel, 2.0 / radius, 0.0, pressure).unwrap();
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
    }

    #[test]
    fn the_rig_bearing_has_its_factor() {
        // numerics of the rig: E 206.8 GPa, ν 0.3, conformity 0.52, d/D 0.2366, d 7.9375 mm.
        let steel = Elasticity { young_pa: 206.8e9, poisson: 0.3 };
        let factor = |gamma: f64| {
            let (sum, difference) = ball_on_race(7.9375e-3, 0.52, gamma);
            contact_factor(steel, sum, difference).unwrap()
        };
        let gamma = 0.312_5 * 25.4 / 33.5; // d/D
        let (inner, outer) = (factor(gamma), factor(-gamma));
        // Published to four figures.
        assert!((inner / 2.527e10 - 1.0).abs() < 5e-4, "{inner:e}");
        assert!((outer / 2.705e10 - 1.0).abs() < 5e-4, "{outer:e}");
        assert!((in_series(inner, outer) / 9.239e9 - 1.0).abs() < 5e-4);
    }
}
