//! Butterworth filters: flat in the pass band, monotone outside.
//!
//! Designed in closed form by the bilinear transform with the edges prewarped, so the gain at an edge
//! is exactly −3 dB at any rate. Must not know what is filtered.

use std::f64::consts::PI;

use rustfft::num_complex::Complex;

use crate::dsp::sos::Section;

/// What a filter lets through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pass {
    /// Below an edge.
    Low {
        /// Edge (−3 dB), Hz.
        edge_hz: f64,
    },
    /// Above an edge.
    High {
        /// Edge (−3 dB), Hz.
        edge_hz: f64,
    },
    /// Between two edges.
    Band {
        /// Lower edge (−3 dB), Hz.
        low_hz: f64,
        /// Upper edge (−3 dB), Hz.
        high_hz: f64,
    },
}

/// Designs a filter of `order` per edge (6·order dB an octave) for the rate `fs_hz` (D39).
///
/// Sections for [`crate::dsp::sos`]: ⌈order/2⌉ of a low or high pass, `order` of a band pass. `None`
/// if the order is 0, an edge not inside 0…fs/2, or the lower not below the upper. The realised gain
/// is the designed one to about 1e-16·(fs/edge)².
#[must_use]
pub fn design(pass: Pass, order: usize, fs_hz: f64) -> Option<Vec<Section>> {
    let warped = |f_hz: f64| {
        let half_turns = f_hz / fs_hz;
        (half_turns > 0.0 && half_turns < 0.5).then(|| (PI * half_turns).tan())
    };
    if order == 0 {
        return None;
    }
    match pass {
        Pass::Low { edge_hz } => {
            let edge = warped(edge_hz)?;
            Some(single_edge(order, edge, |scale| [edge * edge * scale, edge * scale]))
        }
        Pass::High { edge_hz } => {
            let edge = warped(edge_hz)?;
            let mut sections = single_edge(order, edge, |scale| [scale, scale]);
            for section in &mut sections {
                section.b[1] = -section.b[1];
            }
            Some(sections)
        }
        Pass::Band { low_hz, high_hz } => {
            let (low, high) = (warped(low_hz)?, warped(high_hz)?);
            (low < high).then(|| band(order, low, high))
        }
    }
}

/// Squared gain of the filter that [`design`] makes, by its definition (D39).
#[must_use]
pub fn power_gain(pass: Pass, order: usize, f_hz: f64, fs_hz: f64) -> f64 {
    let warped = |f_hz: f64| (PI * f_hz / fs_hz).tan();
    let f = warped(f_hz);
    let ratio = match pass {
        Pass::Low { edge_hz } => f / warped(edge_hz),
        Pass::High { edge_hz } => warped(edge_hz) / f,
        Pass::Band { low_hz, high_hz } => {
            let (low, high) = (warped(low_hz), warped(high_hz));
            (f * f - low * high) / (f * (high - low))
        }
    };
    1.0 / (1.0 + (ratio * ratio).powf(order as f64))
}

/// Poles −sin θ ± j·cos θ of the unit low pass, θ = π(2k + 1)/(2·order); those with Im ≥ 0.
fn poles(order: usize) -> impl Iterator<Item = Complex<f64>> {
    (0..order.div_ceil(2)).map(move |k| {
        let (sin, cos) = (0.5 * PI * (2 * k + 1) as f64 / order as f64).sin_cos();
        // The middle one of an odd order is real: its cosine is rounding.
        let is_real = 2 * k + 1 == order;
        Complex::new(-sin, if is_real { 0.0 } else { cos })
    })
}

/// Sections of a low or high pass; `numerator` gives b₀ of a section of two poles and of one from
/// the scale of its denominator.
fn single_edge(order: usize, edge: f64, numerator: impl Fn(f64) -> [f64; 2]) -> Vec<Section> {
    let section = |pole: Complex<f64>| {
        let reach = -pole.re * edge;
        if pole.im > 0.0 {
            let scale = 1.0 / (1.0 + 2.0 * reach + edge * edge);
            let [b, _] = numerator(scale);
            let a = [2.0 * (edge * edge - 1.0) * scale, (1.0 - 2.0 * reach + edge * edge) * scale];
            Section { b: [b, 2.0 * b, b], a }
        } else {
            let scale = 1.0 / (1.0 + edge);
            let [_, b] = numerator(scale);
            Section { b: [b, b, 0.0], a: [(edge - 1.0) * scale, 0.0] }
        }
    };
    poles(order).map(section).collect()
}

fn band(order: usize, low: f64, high: f64) -> Vec<Section> {
    let (width, centre_square) = (high - low, low * high);
    // width·s/(s² + α·s + β) at s = (1 − z⁻¹)/(1 + z⁻¹).
    let section = |alpha: f64, beta: f64| {
        let scale = 1.0 / (1.0 + alpha + beta);
        let a = [2.0 * (beta - 1.0) * scale, (1.0 - alpha + beta) * scale];
        Section { b: [width * scale, 0.0, -width * scale], a }
    };
    let mut sections = Vec::with_capacity(order);
    for pole in poles(order) {
        if pole.im > 0.0 {
            // s² − p·width·s + centre² = 0: the larger root first, the other without cancellation.
            let half = pole * (0.5 * width);
            let root = (half * half - centre_square).sqrt();
            let same_side = if (root * half.conj()).re < 0.0 { -root } else { root };
            let larger = half + same_side;
            for s in [larger, larger.inv() * centre_square] {
                sections.push(section(-2.0 * s.re, s.norm_sqr()));
            }
        } else {
            sections.push(section(width, centre_square));
        }
    }
    sections
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::sos::response;

    const FS_HZ: f64 = 10_000.0;

    fn passes() -> [Pass; 6] {
        [
            Pass::Low { edge_hz: 1000.0 },
            Pass::Low { edge_hz: 4900.0 },
            Pass::High { edge_hz: 10.0 },
            Pass::Band { low_hz: 10.0, high_hz: 1000.0 },
            Pass::Band { low_hz: 2000.0, high_hz: 4000.0 },
            Pass::Band { low_hz: 0.5, high_hz: 4999.0 },
        ]
    }

    #[test]
    fn gain_is_the_closed_form() {
        for pass in passes() {
            for order in 1..=9 {
                let sections = design(pass, order, FS_HZ).unwrap();
                for f_hz in [0.3, 2.0, 10.0, 55.0, 999.0, 2500.0, 4000.0, 4950.0] {
                    let gain = response(&sections, f_hz, FS_HZ).norm_sqr();
                    let exact = power_gain(pass, order, f_hz, FS_HZ);
                    // Sensitivity of a pole near 1: 1e-16·(fs/f)² is 1e-8 at 0.5 Hz, times the order.
                    assert!((gain - exact).abs() < 1e-6, "{pass:?} {order} {f_hz}: {gain} {exact}");
                    let slack = if f_hz < 5.0 { 1e-5 } else { 1e-8 };
                    assert!(
                        (gain / exact - 1.0).abs() < slack || exact < 1e-20,
                        "{pass:?} {order} {f_hz}"
                    );
                }
            }
        }
    }

    #[test]
    fn edges_are_at_half_power_at_any_rate() {
        for fs_hz in [2500.0, 10_000.0, 51_200.0] {
            for order in 1..=8 {
                let sections =
                    design(Pass::Band { low_hz: 10.0, high_hz: 1000.0 }, order, fs_hz).unwrap();
                assert_eq!(sections.len(), order);
                for f_hz in [10.0, 1000.0] {
                    let gain = response(&sections, f_hz, fs_hz).norm_sqr();
                    assert!((gain - 0.5).abs() < 1e-7, "{fs_hz} {order} {f_hz}: {gain}");
                }
            }
        }
    }

    #[test]
    fn third_order_low_pass_has_its_known_coefficients() {
        // Edge fs/4: tan = 1, poles −1 and −½ ± j√¾: b = (1 + z)²/(3 + z²) and (1 + z)/2.
        let sections = design(Pass::Low { edge_hz: 2500.0 }, 3, FS_HZ).unwrap();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-15;
        let third = 1.0 / 3.0;
        let [two, one] = sections[..] else { unreachable!() };
        assert!(close(two.b[0], third) && close(two.b[1], 2.0 * third) && close(two.a[0], 0.0));
        assert!(close(two.a[1], third));
        assert!(close(one.b[0], 0.5) && close(one.b[1], 0.5) && close(one.a[0], 0.0));
    }

    #[test]
    fn every_pole_is_inside_the_circle() {
        for pass in passes() {
            for order in 1..=12 {
                for section in design(pass, order, FS_HZ).unwrap() {
                    let [a1, a2] = section.a;
                    assert!(a2.abs() < 1.0 && a1.abs() < 1.0 + a2, "{pass:?} {order}: {section:?}");
                }
            }
        }
    }

    #[test]
    fn impossible_filters_are_none() {
        let none = |pass| design(pass, 2, FS_HZ).is_none();
        assert!(none(Pass::Low { edge_hz: 0.0 }) && none(Pass::Low { edge_hz: 5000.0 }));
        assert!(none(Pass::High { edge_hz: -3.0 }) && none(Pass::High { edge_hz: f64::NAN }));
        assert!(none(Pass::Band { low_hz: 20.0, high_hz: 20.0 }));
        assert!(none(Pass::Band { low_hz: 20.0, high_hz: 5000.0 }));
        assert!(design(Pass::Low { edge_hz: 10.0 }, 0, FS_HZ).is_none());
        assert!(design(Pass::Low { edge_hz: 10.0 }, 2, 0.0).is_none());
    }
}
