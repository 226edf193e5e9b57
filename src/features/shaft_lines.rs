//! Lines of a shaft in the spectrum that tell its speed: a comb of its harmonics, or its 1× alone (docs/theory.md, F1–F3, F21, F26).
//!
//! Harmonics that a bearing's defect lines or the mains could imitate take no part. Must not know what was written down of the speed
//! but one figure near which it lies, nor which of several tellings is believed: that is `speed`'s.
//!
//! `dsp::comb` and `dsp::speed_track` find a speed in one record without any nominal; here the peaks of all channels' spectra,
//! which are there already, are pooled near a nominal one, and orders are left out by the machine: those cannot do that.

use super::shaft::hann_magnitude;
use super::speed::REFINE_RANGE;
use crate::dsp::real::floor_index;
use crate::dsp::stats;
use crate::machine::Machine;
use crate::machine::motor::MAINS_WANDER;
use crate::units::Hz;
use rustfft::num_complex::Complex;

/// Highest shaft harmonic of the comb.
const COMB: u32 = 5;

/// A peak of the comb: power over the local floor. A noise cell exceeds 18 once in 6·10⁷, and a
/// window offers some hundred cells.
pub(super) const PEAK_POWER_RATIO: f64 = 18.0;

/// Two harmonics alone must be this strong to count as a comb.
const PAIR_POWER_RATIO: f64 = 100.0;

/// A harmonic closer than this, relative, to a line that could imitate it takes no part: the range
/// of the search and of slip together.
const IMITATION: f64 = 0.05;

/// A spectral peak of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Interpolated frequency.
    pub frequency: Hz,
    /// Power over the local floor.
    pub power_ratio: f64,
}

/// Finds the peaks below `top` in the spectrum of `n` samples (F1): Hann window applied in the
/// frequency domain, floor by block medians, frequency by the two-bin ratio.
///
/// `x_hat`: unnormalised one-sided DFT of n samples, mean removed.
#[must_use]
pub fn peaks(x_hat: &[Complex<f32>], n: usize, sample_rate: Hz, top: Hz, block: Hz) -> Vec<Peak> {
    let bin_hz = sample_rate.0 / n as f64;
    let last = floor_index((top.0 / bin_hz).ceil()).min(x_hat.len().saturating_sub(2));
    let width = floor_index((block.0 / bin_hz).ceil()).clamp(16, x_hat.len().max(16));
    let amplitude: Vec<f64> = (0..=last).map(|k| hann_magnitude(x_hat, k)).collect();
    let medians: Vec<Option<f64>> = amplitude
        .chunks(2 * width)
        .map(|block| stats::median(&mut block.to_vec()).filter(|m| *m > 0.0))
        .collect();
    let mut found = Vec::new();
    for k in 2..last {
        let a = amplitude[k];
        if a <= amplitude[k - 1] || a < amplitude[k + 1] {
            continue;
        }
        let Some(median) = medians[k / (2 * width)] else { continue };
        let power_ratio = (a / median).powi(2) * std::f64::consts::LN_2;
        if power_ratio < PEAK_POWER_RATIO {
            continue;
        }
        // Two-bin ratio of the Hann window: exact for a lone line.
        let (next, sign) = if amplitude[k + 1] >= amplitude[k - 1] {
            (amplitude[k + 1], 1.0)
        } else {
            (amplitude[k - 1], -1.0)
        };
        let ratio = next / a;
        let shift = sign * (2.0 * ratio - 1.0) / (1.0 + ratio);
        found.push(Peak { frequency: Hz((k as f64 + shift) * bin_hz), power_ratio });
    }
    found
}

/// A comb of shaft harmonics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comb {
    /// Shaft speed by weighted least squares over the harmonics.
    pub speed: Hz,
    /// How many different harmonics agree.
    pub harmonics: u32,
}

/// Multiples of the mains, which are no shaft's.
#[derive(Debug, Clone, Default)]
pub struct Mains {
    /// Those of the motors that state theirs.
    pub stated: Vec<Hz>,
    /// Those that may be there, where none does.
    pub possible: Vec<Hz>,
}

impl Mains {
    /// Those that are stated alone.
    pub(super) fn stated(&self) -> Self {
        Self { stated: self.stated.clone(), possible: Vec::new() }
    }

    fn is_stated(&self, peak: &Peak, duration_s: f64) -> bool {
        let near = |line: &Hz| (peak.frequency.0 - line.0).abs() < 2.0 / duration_s;
        self.stated.iter().any(near)
    }

    fn is_possible(&self, peak: &Peak, duration_s: f64) -> bool {
        let near = |line: &Hz| {
            (peak.frequency.0 - line.0).abs() < 1.0 / duration_s + MAINS_WANDER * line.0
        };
        self.possible.iter().any(near)
    }
}

/// Looks for a comb of harmonics 1…5 of a speed within ± 3 % of `nominal` (F2, F3).
///
/// `peaks` come from all channels of a window of `duration_s`; `imitators` are orders of lines that
/// are no shaft harmonics.
#[must_use]
pub fn find_comb(
    peaks: &[Peak],
    nominal: Hz,
    duration_s: f64,
    imitators: &[f64],
    mains: &Mains,
) -> Option<Comb> {
    let tolerance_hz = 0.5 / duration_s;
    let usable: Vec<u32> = (1..=COMB)
        .filter(|j| {
            let order = f64::from(*j);
            !is_imitated(order, imitators)
        })
        .collect();
    let offered: Vec<(u32, Peak)> = peaks
        .iter()
        .filter(|p| !mains.is_stated(p, duration_s))
        .flat_map(|p| usable.iter().map(move |j| (*j, *p)))
        .filter(|(j, p)| {
            let speed = p.frequency.0 / f64::from(*j);
            (speed / nominal.0 - 1.0).abs() <= REFINE_RANGE
        })
        .collect();
    let mut best: Option<(Comb, f64)> = None;
    for (j0, p0) in &offered {
        let guess = p0.frequency.0 / f64::from(*j0);
        let Some((comb, weight)) = fit(&offered, guess, tolerance_hz) else { continue };
        let is_own = |(j, p): &(u32, Peak)| {
            (p.frequency.0 - guess * f64::from(*j)).abs() <= tolerance_hz
                && !mains.is_possible(p, duration_s)
        };
        if !offered.iter().any(is_own) {
            continue;
        }
        let closer = |b: &(Comb, f64)| (comb.harmonics, weight) > (b.0.harmonics, b.1);
        if best.as_ref().is_none_or(closer) {
            best = Some((comb, weight));
        }
    }
    best.map(|(comb, _)| comb).filter(|c| (c.speed.0 / nominal.0 - 1.0).abs() <= REFINE_RANGE)
}

/// How much stronger than any other line near a nominal speed, in power, 1× is where it stands alone: a shaft has one speed.
const LEAD: f64 = 10.0;

/// The speed by 1× alone, where there is no comb. Of proximity probes (F21): a probe looks at the shaft itself, whose
/// run-out, bow and unbalance all come once a turn and which nothing else moves so near its speed. Of accelerometers (F26), which
/// hear neighbours too.
///
/// `sensors`: peaks of each sensor, in speeds of the first shaft. `None` unless each that has a strong line within ± 3 %
/// of `nominal` has a single one, and all the same.
#[must_use]
pub fn find_first(
    sensors: &[Vec<Peak>],
    nominal: Hz,
    duration_s: f64,
    mains: &Mains,
) -> Option<Comb> {
    let tolerance_hz = 0.5 / duration_s;
    let is_free = |p: &Peak| {
        !mains.is_stated(p, duration_s)
            && !mains.is_possible(p, duration_s)
            && (p.frequency.0 / nominal.0 - 1.0).abs() <= REFINE_RANGE
    };
    let (mut numerator, mut denominator) = (0.0, 0.0);
    let mut found: Option<f64> = None;
    for peaks in sensors {
        let near = peaks.iter().copied().filter(is_free);
        let strongest = near.clone().max_by(|a, b| a.power_ratio.total_cmp(&b.power_ratio));
        let Some(line) = strongest.filter(|p| p.power_ratio > PAIR_POWER_RATIO) else { continue };
        let is_rival = |p: &Peak| {
            (p.frequency.0 - line.frequency.0).abs() > 2.0 * tolerance_hz
                && p.power_ratio * LEAD > line.power_ratio
        };
        let first = *found.get_or_insert(line.frequency.0);
        if near.clone().any(|p| is_rival(&p)) || (line.frequency.0 - first).abs() > tolerance_hz {
            return None;
        }
        let weight = line.power_ratio.min(1e4);
        numerator += weight * line.frequency.0;
        denominator += weight;
    }
    found.map(|_| Comb { speed: Hz(numerator / denominator), harmonics: 1 })
}

/// Whether one of the orders `imitators` may pose as a shaft's harmonic `order`.
pub(super) fn is_imitated(order: f64, imitators: &[f64]) -> bool {
    imitators.iter().any(|i| (i - order).abs() < IMITATION * order)
}

/// Fits the peaks that agree with `guess_hz`; `None` when they are no comb: three harmonics, or two
/// strong ones, the first or second among them.
fn fit(offered: &[(u32, Peak)], guess_hz: f64, tolerance_hz: f64) -> Option<(Comb, f64)> {
    let mut strongest = [0.0_f64; COMB as usize + 1];
    let (mut numerator, mut denominator) = (0.0, 0.0);
    for (j, peak) in offered {
        let order = f64::from(*j);
        if (peak.frequency.0 - guess_hz * order).abs() > tolerance_hz {
            continue;
        }
        let weight = peak.power_ratio.min(1e4);
        numerator += weight * order * peak.frequency.0;
        denominator += weight * order * order;
        let slot = &mut strongest[*j as usize];
        *slot = slot.max(peak.power_ratio);
    }
    let present = strongest.iter().filter(|s| **s > 0.0).count();
    let low = strongest[1].max(strongest[2]) > 0.0;
    let strong = strongest.iter().filter(|s| **s > PAIR_POWER_RATIO).count();
    let is_comb = low && (present >= 3 || strong >= 2);
    let weight: f64 = strongest.iter().map(|s| s.max(1.0).ln()).sum();
    let harmonics = u32::try_from(present).ok()?;
    is_comb.then(|| (Comb { speed: Hz(numerator / denominator), harmonics }, weight))
}

/// Orders of the first shaft at which bearing lines could pose as shaft harmonics.
pub(super) fn imitators(machine: &Machine) -> Vec<f64> {
    let mut orders = Vec::new();
    for bearing in &machine.bearings {
        let ratio = machine.shafts[bearing.shaft.0].ratio_to_first;
        if let (Some(found), Some(ratio)) = (bearing.fault_orders(), ratio) {
            let bands = &bearing.bands;
            let lines = [
                (found.bpfo, bands.bpfo),
                (found.bpfi, bands.bpfi),
                (found.two_bsf(), bands.two_bsf),
            ];
            for (order, band) in lines {
                // Close enough together for the comb's reach around each.
                let places = [band.low, band.low / 2.0, 0.0, band.high / 2.0, band.high];
                for place in places {
                    let order = order * ratio * (1.0 + place);
                    orders.extend([order, 2.0 * order]);
                }
            }
        }
    }
    orders
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::real::Real;
    use crate::features::speed::SpeedSource;
    use crate::features::speed::settle;

    fn stated(hz: f64) -> Mains {
        Mains { stated: vec![Hz(hz)], possible: Vec::new() }
    }

    fn spectrum_of(fs: f64, n: usize, tones: &[(f64, f64)]) -> Vec<Complex<f32>> {
        let mut state = 99_u64;
        let x: Vec<f32> = (0..n)
            .map(|i| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let noise = ((state >> 33) as f64 / (1u64 << 31) as f64 - 0.5) * 0.2;
                let t = i as f64 / fs;
                let sum: f64 =
                    tones.iter().map(|(f, a)| a * (std::f64::consts::TAU * f * t).cos()).sum();
                f32::rounded(sum + noise)
            })
            .collect();
        let mut plan = ForwardPlan::new(n, &mut FftCache::new());
        let mut x_hat = vec![Complex::default(); plan.n_bins()];
        plan.process(&x, &mut x_hat);
        x_hat
    }

    #[test]
    fn a_comb_moves_a_wrong_nominal_speed() {
        let tones = [(29.76, 0.1), (59.52, 0.08), (89.28, 0.05)];
        let x_hat = spectrum_of(5000.0, 25_000, &tones);
        let found = peaks(&x_hat, 25_000, Hz(5000.0), Hz(160.0), Hz(15.0));
        let comb = find_comb(&found, Hz(30.0), 5.0, &[], &Mains::default()).unwrap();
        // Two-bin interpolation in 20 dB noise: a few thousandths of the 0.2 Hz bin.
        assert!((comb.speed.0 - 29.76).abs() < 2e-3, "{comb:?}");
        assert_eq!(
            settle(Hz(30.0), SpeedSource::Capture, Some(comb), true).source,
            Some(SpeedSource::Estimated)
        );
    }

    #[test]
    fn one_line_tells_the_speed_and_two_that_differ_tell_none() {
        let peak = |hz: f64, power_ratio: f64| Peak { frequency: Hz(hz), power_ratio };
        let find = |probes: &[Vec<Peak>]| {
            find_first(probes, Hz(9.8), 10.0, &stated(9.6)).map(|comb| comb.speed.0)
        };
        let (x, y) = (vec![peak(10.0, 1e5), peak(42.0, 1e6)], vec![peak(10.01, 1e5)]);
        let found = find(&[x.clone(), y.clone()]).unwrap();
        assert!((found - 10.005).abs() < 1e-9, "{found}");
        assert_eq!(find(&[x.clone(), Vec::new()]), Some(10.0), "a blind one says nothing");
        assert_eq!(find(&[x.clone(), vec![peak(9.9, 1e5)]]), None, "they differ");
        assert_eq!(find(&[vec![peak(10.0, 1e5), peak(9.85, 2e4)]]), None, "which of the two");
        assert_eq!(find(&[vec![peak(10.0, 90.0)]]), None, "too weak");
        assert_eq!(find(&[vec![peak(10.2, 1e5)]]), None, "beyond 3 %");
        assert_eq!(find(&[vec![peak(9.85, 1e5)]]), Some(9.85));
        assert_eq!(find(&[vec![peak(9.61, 1e5)]]), None, "the mains");
        let line = find_first(&[x, y], Hz(9.8), 10.0, &Mains::default());
        let by_probes = settle(Hz(9.8), SpeedSource::Capture, line, true);
        assert_eq!((by_probes.source, by_probes.confidence), (Some(SpeedSource::Estimated), 0.9));
        assert!(!by_probes.is_unconfirmed());
        let by_accelerometers = settle(Hz(9.8), SpeedSource::Machine, line, false);
        assert_eq!(by_accelerometers.first, by_probes.first);
        assert!(by_accelerometers.is_unconfirmed(), "a neighbour's may be that line");
    }

    #[test]
    fn bearing_lines_do_not_pose_as_shaft_harmonics() {
        // BPFO at order 3.053 of 30 Hz and its double, plus one mains line: no shaft line at all.
        let tones = [(91.59, 0.1), (183.18, 0.1), (60.0, 0.1)];
        let x_hat = spectrum_of(5000.0, 25_000, &tones);
        let found = peaks(&x_hat, 25_000, Hz(5000.0), Hz(200.0), Hz(15.0));
        assert!(found.len() >= 2);
        assert_eq!(find_comb(&found, Hz(30.0), 5.0, &[3.053, 6.106], &stated(60.0)), None);
    }

    #[test]
    fn what_may_be_the_mains_alone_tells_no_speed() {
        let mains = Mains { stated: Vec::new(), possible: vec![Hz(50.0), Hz(100.0)] };
        let peak = |hz: f64| Peak { frequency: Hz(hz), power_ratio: 1e4 };
        let comb = |hz: &[f64]| {
            let peaks: Vec<Peak> = hz.iter().map(|hz| peak(*hz)).collect();
            find_comb(&peaks, Hz(24.6), 5.0, &[], &mains).map(|comb| comb.speed.0)
        };
        assert_eq!(comb(&[50.0, 100.05]), None, "2× and 4× of a shaft at 25 Hz");
        assert!(comb(&[25.0, 50.0, 100.0]).is_some_and(|hz| (hz - 25.0).abs() < 0.01));
        assert!(comb(&[49.2, 98.4, 50.0, 100.0]).is_some_and(|hz| (hz - 24.6).abs() < 0.01));
        let first = |mains: &Mains| find_first(&[vec![peak(50.0)]], Hz(49.2), 5.0, mains);
        assert_eq!(first(&mains), None, "an accelerometer may receive it");
        assert!(first(&mains.stated()).is_some(), "a probe looks at the shaft");
    }

    #[test]
    fn noise_alone_gives_no_comb() {
        let x_hat = spectrum_of(5000.0, 25_000, &[]);
        let found = peaks(&x_hat, 25_000, Hz(5000.0), Hz(160.0), Hz(15.0));
        assert_eq!(find_comb(&found, Hz(30.0), 5.0, &[], &Mains::default()), None);
    }
}
