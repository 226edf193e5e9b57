//! Bands that one tone leads: a mesh harmonic, a converter's switching (docs/theory.md, F15). Passing elements
//! modulate such a tone without any damage, and its envelope tells of that, not of impacts.

use crate::features::bands::Band;
use crate::units::Hz;
use rustfft::num_complex::Complex;
use std::ops::Range;

/// A tone leads a band if it carries more than this part of its energy.
const LEADS: f64 = 0.5;

/// Bins to either side of the highest that belong to a tone: 95 % of its energy, however it lies between bins.
const SKIRT: usize = 2;

/// Impacts have lines at every multiple of their rate, and a resonance lets through those inside its width, 2ζ of its frequency. With
/// ζ = 6 %, as much as structures have, the eighth still has one to itself: higher ones lead in no band that holds more.
const MULTIPLES: f64 = 8.0;

/// Relative error of a multiple's place: the rate is known that well.
const TOLERANCE: f64 = 2e-3;

/// Powers that are summed side by side.
const LANES: usize = 16;

/// The tone that carries more than half of the energy of the bins `band` of the spectrum `x_hat` with bins of
/// `bin_hz`, if one does.
#[must_use]
pub fn leading_tone(x_hat: &[Complex<f32>], band: Range<usize>, bin_hz: f64) -> Option<Hz> {
    let bins = x_hat.get(band.clone())?;
    let (total, greatest) = total_and_greatest(bins);
    // The skirt of a tone is no stronger than its middle: what is less than this cannot lead.
    if f64::from(greatest) * (2 * SKIRT + 1) as f64 <= LEADS * total {
        return None;
    }
    let highest = bins.iter().rposition(|bin| bin.norm_sqr() >= greatest)?;
    let around = highest.saturating_sub(SKIRT)..(highest + SKIRT + 1).min(bins.len());
    let tone: f64 = bins[around].iter().map(|bin| f64::from(bin.norm_sqr())).sum();
    (tone > LEADS * total).then_some(Hz((band.start + highest) as f64 * bin_hz))
}

/// Sum of the powers of `bins`, and the greatest; lanes side by side, for every band of every window is read.
fn total_and_greatest(bins: &[Complex<f32>]) -> (f64, f32) {
    let (mut totals, mut greatest) = ([0.0_f64; LANES], [0.0_f32; LANES]);
    for chunk in bins.chunks(LANES) {
        for ((bin, total), greatest) in chunk.iter().zip(&mut totals).zip(&mut greatest) {
            let power = bin.norm_sqr();
            *total += f64::from(power);
            *greatest = if power > *greatest { power } else { *greatest };
        }
    }
    (totals.iter().sum(), greatest.into_iter().fold(0.0, f32::max))
}

/// Whether a leading tone may be a multiple of the line's rate: a low one, or one in a band that holds few of them.
pub(super) fn is_own(tone: Hz, line: Hz, band: Band) -> bool {
    let multiple = (tone.0 / line.0).round();
    let is_near = (multiple * line.0 - tone.0).abs() <= TOLERANCE * tone.0;
    let holds_few = band.high.0 - band.low.0 < MULTIPLES * line.0;
    multiple >= 1.0 && is_near && (holds_few || multiple <= MULTIPLES)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn spectrum(of: impl Fn(f64) -> f64) -> Vec<Complex<f32>> {
        let mut cache = crate::dsp::fft::FftCache::<f32>::new();
        let x: Vec<f32> =
            (0..20_000).map(|i| crate::dsp::real::Real::rounded(of(f64::from(i) / 10e3))).collect();
        let mut x_hat = vec![Complex::default(); crate::dsp::fft::n_bins(x.len())];
        crate::dsp::fft::ForwardPlan::new(x.len(), &mut cache).process(&x, &mut x_hat);
        x_hat
    }

    /// Impacts at 42 Hz that ring at 2.3 kHz.
    fn impacts(t: f64) -> f64 {
        let since = (t * 42.0).fract() / 42.0;
        (-since * 800.0).exp() * (TAU * 2300.0 * since).sin()
    }

    #[test]
    fn a_modulated_tone_leads_and_impacts_do_not() {
        let mesh = spectrum(|t| (1.0 + 0.3 * (TAU * 42.0 * t).cos()) * (TAU * 2803.3 * t).sin());
        let tone = leading_tone(&mesh, 4000..6000, 0.5).unwrap();
        assert!((tone.0 - 2803.3).abs() <= 0.5, "{tone:?}");
        assert_eq!(leading_tone(&mesh, 6000..8000, 0.5), None, "nothing but skirts");
        assert_eq!(leading_tone(&spectrum(impacts), 4000..6000, 0.5), None);
    }

    #[test]
    fn in_a_band_of_few_multiples_the_strongest_may_be_the_lines_own() {
        let band = Band { low: Hz(2000.0), high: Hz(3000.0), whitened: false };
        assert!(is_own(Hz(2448.3), Hz(408.0), band));
        assert!(!is_own(Hz(2600.0), Hz(408.0), band));
        assert!(!is_own(Hz(2814.0), Hz(42.0), band), "of 24 multiples none leads");
        let wide = Band { low: Hz(0.0), high: Hz(24_000.0), whitened: false };
        assert!(
            is_own(Hz(5727.1), Hz(954.5), wide),
            "a resonance as narrow as the sixth stands apart"
        );
        assert!(!is_own(Hz(9545.0), Hz(954.5), wide), "the tenth does not");
    }
}
