//! Whether what surrounds a line in a band is noise, and how much of the band that is (F30). Must not know what the line is of.

use super::BandReading;

/// Power of the squared envelope of noise, Hann window, over the square of its mean, a bin: 6/(B·T). One-sided density 2/B where B is much more than
/// the rate, amplitude² of a bin twice that times 1.5/T.
const OF_NOISE: f64 = 6.0;

/// Part of that from which noise is taken to be there: left by noise that holds a twelfth of the band's energy, 1 − √(5/6), beats and all.
const IS_THERE: f64 = 1.0 / 6.0;

/// Least part of a band's energy that is taken to be no noise: half, where the floor says that noise holds as much as all else or more.
const LEAST_PART: f64 = 0.5;

/// A floor so many times what noise alone leaves is no noise's: something strikes at no rate.
const NO_NOISE: f64 = 1.5;

impl BandReading {
    /// Floor beside the fundamental over what noise alone would leave in the band; 1 if all of the band is noise.
    fn floor_of_noise(&self, duration_s: f64) -> Option<f64> {
        let cells = (self.band.high.0 - self.band.low.0) * duration_s;
        let fundamental = self.harmonics[0].filter(|h| h.power_ratio > 0.0)?;
        Some(fundamental.depth.powi(2) / fundamental.power_ratio * cells / OF_NOISE)
    }

    /// Part of the band's energy that is no noise, as the floor beside the fundamental tells (F30), ½…1: noise that holds a part ν leaves ν² of the
    /// floor of noise alone, and 2ν(1 − ν) where it beats with all else, together 1 − (1 − ν)². Noise
    /// that is not white in the band is taken for more than it is.
    fn part_beside_noise(&self, duration_s: f64) -> f64 {
        match self.floor_of_noise(duration_s) {
            Some(floor) if floor <= NO_NOISE => (1.0 - floor).max(0.0).sqrt().max(LEAST_PART),
            Some(_) | None => 1.0,
        }
    }

    /// Depth of the line over the part of the band's energy that is no noise (F30, C54), `readings` being those of all bands of its channel. Where a
    /// band around this one has a floor that no noise leaves, none of this one's energy is taken for noise: what strikes at no rate leaves the same
    /// floor however wide the band, noise less the wider it is, so that the wide band tells them apart and the narrow one may not.
    #[must_use]
    pub fn depth_beside_noise(&self, readings: &[Self], duration_s: f64) -> f64 {
        let is_no_noise = |around: &Self| {
            around.band.holds(&self.band)
                && around.floor_of_noise(duration_s).is_some_and(|floor| floor > NO_NOISE)
        };
        let part =
            if readings.iter().any(is_no_noise) { 1.0 } else { self.part_beside_noise(duration_s) };
        self.total_depth() / part
    }

    /// Whether the floor beside the fundamental is what noise leaves that holds a twelfth of the band's energy (F30): the depth tells how much of the
    /// energy comes at the line's rate, and of what is struck without noise all does, however softly.
    #[must_use]
    pub fn is_in_noise(&self, duration_s: f64) -> bool {
        self.floor_of_noise(duration_s).is_some_and(|floor| floor >= IS_THERE)
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
    use rand_distr::Distribution;
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

    #[test]
    fn the_floor_tells_how_much_of_a_band_is_noise() {
        // A steady part a² of 1 beside complex noise ν of 1: the powers |a + n|² scatter by ν² + 2ν(1 − ν).
        let mut random = Pcg64Mcg::seed_from_u64(2);
        let mut normal = || -> f64 { rand_distr::StandardNormal.sample(&mut random) };
        for noise in [0.1_f64, 0.3, 0.45] {
            let n = 40_000;
            let a = (1.0 - noise).sqrt();
            let powers: Vec<f64> = (0..n)
                .map(|_| {
                    let (re, im) =
                        (a + normal() * (noise / 2.0).sqrt(), normal() * (noise / 2.0).sqrt());
                    re * re + im * im
                })
                .collect();
            let mean = powers.iter().sum::<f64>() / f64::from(n);
            let scatter =
                powers.iter().map(|p| (p / mean - 1.0).powi(2)).sum::<f64>() / f64::from(n);
            // Noise alone scatters by 1 and has a floor of 6/(B·T), here 6/(1000·10).
            let floor_power = scatter * 6.0 / 1e4;
            let harmonic = Harmonic {
                power_ratio: 0.09 / floor_power,
                depth: 0.3,
                floor_dof: 100.0,
                searched: Searched::peaks(60.0),
            };
            let band = Band { low: Hz(1e3), high: Hz(2e3), whitened: false };
            let part = BandReading::of_test(band, Hz(50.0), &[harmonic]).part_beside_noise(10.0);
            assert!((part - (1.0 - noise)).abs() < 0.03, "{part} beside {noise}");
        }
    }

    #[test]
    fn a_floor_that_noise_does_not_leave_says_nothing() {
        let part = |floor: f64| {
            let harmonic = Harmonic {
                power_ratio: 0.25 / (floor * 6.0 / 1e4),
                depth: 0.5,
                floor_dof: 100.0,
                searched: Searched::peaks(60.0),
            };
            let band = Band { low: Hz(1e3), high: Hz(2e3), whitened: false };
            BandReading::of_test(band, Hz(50.0), &[harmonic]).part_beside_noise(10.0)
        };
        assert!((part(0.36) - 0.8).abs() < 1e-12);
        assert!((part(0.9) - 0.5).abs() < 1e-12 && (part(1.4) - 0.5).abs() < 1e-12);
        assert!((part(1.6) - 1.0).abs() < 1e-12);
    }
}
