//! Whether what surrounds a line in a band is noise (F30). Must not know what the line is of.

use super::BandReading;

/// Power of the squared envelope of noise, Hann window, over the square of its mean, a bin: 6/(B·T). One-sided density 2/B where B is much more than
/// the rate, amplitude² of a bin twice that times 1.5/T.
const OF_NOISE: f64 = 6.0;

/// Part of that from which noise is taken to be there: a band two fifths of whose energy are noise leaves its square, a sixth.
const IS_THERE: f64 = 1.0 / 6.0;

impl BandReading {
    /// Whether the floor beside the fundamental is what noise leaves that holds two fifths of the band's energy (F30): the depth tells how much of the
    /// energy comes at the line's rate, and of what is struck without noise all does, however softly.
    #[must_use]
    pub fn is_in_noise(&self, duration_s: f64) -> bool {
        let cells = (self.band.high.0 - self.band.low.0) * duration_s;
        self.harmonics[0].is_some_and(|h| {
            h.power_ratio > 0.0 && h.depth * h.depth / h.power_ratio * cells >= OF_NOISE * IS_THERE
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::bands::Band;
    use crate::features::bearing::Harmonic;
    use crate::features::bearing::Searched;
    use crate::units::Hz;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn the_floor_of_noise_is_what_width_and_length_of_the_band_say() {
        // Squared envelope of complex white noise, a sample a time of 1/B: exponential powers.
        let n = 2000;
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let powers: Vec<f64> =
            (0..n).map(|_| -(1.0 - random.random_range(0.0..1.0_f64)).ln()).collect();
        let mean = powers.iter().sum::<f64>() / f64::from(n);
        let turn =
            |k: u32, i: usize| std::f64::consts::TAU * f64::from(k) * i as f64 / f64::from(n);
        let amplitude_squared = |k: u32| {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, power) in powers.iter().enumerate() {
                let hann = 1.0 - turn(1, i).cos();
                let (sin, cos) = turn(k, i).sin_cos();
                re += hann * (power / mean - 1.0) * cos;
                im += hann * (power / mean - 1.0) * sin;
            }
            (re * re + im * im) * (2.0 / f64::from(n)).powi(2)
        };
        let floor = (3..203).map(amplitude_squared).sum::<f64>() / 200.0;
        // 200 exponential powers, Hann: their mean scatters by a tenth.
        assert!((floor * f64::from(n) / OF_NOISE - 1.0).abs() < 0.3, "{floor}");
    }

    #[test]
    fn what_is_struck_without_noise_is_told_by_its_floor() {
        let reading = |power_ratio: f64| {
            let harmonic = Harmonic {
                power_ratio,
                depth: 0.5,
                floor_dof: 100.0,
                searched: Searched::peaks(60.0),
            };
            let band = Band { low: Hz(1e3), high: Hz(2e3), whitened: false };
            BandReading::of_test(band, Hz(50.0), &[harmonic])
        };
        // ¼·B·T = 2500.
        assert!(reading(2400.0).is_in_noise(10.0));
        assert!(!reading(2600.0).is_in_noise(10.0));
    }
}
