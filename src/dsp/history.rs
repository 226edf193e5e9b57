//! Gear figures that compare a record with those before it: NA4, NA4*, NB4, NB4* (D66, D67).
//!
//! [`HistoryPlan`] computes; [`GearHistory`] is what it remembers: plain numbers, so that a caller can
//! write them down and go on after a restart. A history belongs to one gear in one channel in one
//! operating state; keeping them apart is the caller's part. Must not know healthy from damaged.

use crate::dsp::demodulate::MeshDemodPlan;
use crate::dsp::fft::FftCache;
use crate::dsp::gear::GearFigures;
use crate::dsp::gear::GearPlan;
use crate::dsp::stats::Moments;

/// Records before a variance may be refused.
pub const MIN_ACCEPTED: u64 = 30;

/// Standard errors a variance may be above the mean of those accepted: 1 % of a Gaussian.
pub const MAX_STANDARD_ERRORS: f64 = 2.33;

/// Rounding allowed a variance equal to all before.
const ROUNDING: f64 = 1e-12;

/// Sums over the records of one signal, residual or envelope.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EnergyHistory {
    /// Records M.
    pub n_records: u64,
    /// Mean of Σ(x − x̄)² over all records, u².
    pub mean_energy: f64,
    /// Records accepted as healthy.
    pub n_accepted: u64,
    /// Mean variance V of the accepted, u².
    pub mean_variance: f64,
    /// Σ(variance − V)² over the accepted, u⁴.
    pub variance_m2: f64,
    /// Whether a record was refused, so that V stays as it is.
    pub is_frozen: bool,
}

impl EnergyHistory {
    /// Takes in one record and returns its kurtosis against all records and against the accepted ones.
    fn push(&mut self, record: Shape) -> (Option<f64>, Option<f64>) {
        let Shape { n, variance, kurtosis } = record;
        let energy = n * variance;
        self.n_records += 1;
        self.mean_energy += (energy - self.mean_energy) / self.n_records as f64;
        self.offer(variance);
        let against = |reference: f64| {
            // By the ratio: fourth powers may underflow where the ratio does not.
            let ratio = energy / reference;
            (reference > 0.0).then_some(kurtosis * ratio * ratio).filter(|value| value.is_finite())
        };
        (against(self.mean_energy), against(n * self.mean_variance))
    }

    /// Accepts a variance into V, or freezes V for good.
    fn offer(&mut self, variance: f64) {
        if self.is_frozen {
            return;
        }
        if self.n_accepted >= MIN_ACCEPTED && variance > self.limit() {
            self.is_frozen = true;
            return;
        }
        self.n_accepted += 1;
        let before = variance - self.mean_variance;
        self.mean_variance += before / self.n_accepted as f64;
        self.variance_m2 += before * (variance - self.mean_variance);
    }

    /// Largest variance accepted next, x̄ + Z·s/√M.
    fn limit(&self) -> f64 {
        let n = self.n_accepted as f64;
        let deviation = (self.variance_m2 / n).sqrt();
        self.mean_variance * (1.0 + ROUNDING) + MAX_STANDARD_ERRORS * deviation / n.sqrt()
    }

    fn is_sound(&self) -> bool {
        let sums = [self.mean_energy, self.mean_variance, self.variance_m2];
        let counts = self.n_accepted <= self.n_records
            && (self.is_frozen || self.n_accepted == self.n_records)
            && (!self.is_frozen || self.n_accepted >= MIN_ACCEPTED);
        counts && sums.iter().all(|sum| sum.is_finite() && *sum >= 0.0)
    }
}

/// What a gear's figures remember of its records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GearHistory {
    /// Points N of an average: the same in all records.
    pub n_points: usize,
    /// Teeth of the gear.
    pub teeth: usize,
    /// Strongest mesh harmonic h* of the baseline, kept.
    pub harmonic: usize,
    /// Sums over the residual signals.
    pub residual: EnergyHistory,
    /// Sums over the mesh envelopes.
    pub envelope: EnergyHistory,
    /// Records with a sample that is no number: not in the sums.
    pub n_rejected: u64,
}

impl GearHistory {
    /// An empty history for records of `n_points` points of a gear of `teeth` teeth whose baseline has
    /// its strongest mesh harmonic at `harmonic` ([`GearPlan::strongest_harmonic`]).
    #[must_use]
    pub fn new(n_points: usize, teeth: usize, harmonic: usize) -> Self {
        Self {
            n_points,
            teeth,
            harmonic,
            residual: EnergyHistory::default(),
            envelope: EnergyHistory::default(),
            n_rejected: 0,
        }
    }

    /// Whether the numbers can be a history: what was read back from somewhere is asked this first.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let same = self.residual.n_records == self.envelope.n_records;
        same && self.residual.is_sound() && self.envelope.is_sound()
    }
}

/// All figures of one record (D24, D66, D67); `None` where a denominator is 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GearIndicators {
    /// Figures of the record alone.
    pub figures: GearFigures,
    /// Fourth moment of the residual over the mean energy of all records; 3 when healthy.
    pub na4: Option<f64>,
    /// The same over the energy of the accepted records; 3 when healthy.
    pub na4_star: Option<f64>,
    /// NA4's formula on the envelope around h*·z; against its baseline.
    pub nb4: Option<f64>,
    /// NA4*'s formula on that envelope; against its baseline.
    pub nb4_star: Option<f64>,
}

/// Computes the figures of merit of records of one gear against their history (D66, D67).
#[derive(Debug)]
pub struct HistoryPlan {
    gear: GearPlan,
    mesh: MeshDemodPlan,
}

impl HistoryPlan {
    /// Plans for the records of `history`, orders up to `max_order` usable; `None` if the mesh or the
    /// band around h*·z is not inside them, or if the history is not sound.
    #[must_use]
    pub fn new(history: &GearHistory, max_order: usize, cache: &mut FftCache<f64>) -> Option<Self> {
        let (n, teeth, harmonic) = (history.n_points, history.teeth, history.harmonic);
        let gear = GearPlan::new(n, teeth, max_order, cache)?;
        let mesh = MeshDemodPlan::new(n, teeth, harmonic, cache)?;
        let fits = harmonic <= gear.n_harmonics() && history.is_sound();
        fits.then_some(Self { gear, mesh })
    }

    /// The split of the last record into regular, residual and difference signal.
    #[must_use]
    pub fn gear(&self) -> &GearPlan {
        &self.gear
    }

    /// Amplitude and phase of the mesh in the last record.
    #[must_use]
    pub fn mesh(&self) -> &MeshDemodPlan {
        &self.mesh
    }

    /// Adds the average `y` (N points of one revolution) to the history and computes its figures.
    ///
    /// A record with a sample that is no number is counted as rejected, changes nothing else and gives
    /// `None`.
    ///
    /// # Panics
    ///
    /// If `y` or `history` is not what was planned for.
    pub fn process(&mut self, y: &[f64], history: &mut GearHistory) -> Option<GearIndicators> {
        let planned = (self.mesh.n_points(), self.gear.teeth(), self.mesh.harmonic());
        let given = (history.n_points, history.teeth, history.harmonic);
        assert_eq!(given, planned, "history of the plan");
        if !y.iter().all(|value| value.is_finite()) {
            history.n_rejected += 1;
            return None;
        }
        let figures = self.gear.process(y);
        self.mesh.process(y);
        // What is only rounding beside y counts as nothing, as in the figures of the record alone.
        let floor = ROUNDING * Moments::of(y).rms().unwrap_or(0.0);
        let moments = |part: &[f64]| {
            let moments = Moments::of(part);
            if moments.rms() > Some(floor) { Shape::of(&moments) } else { Shape::nothing(&moments) }
        };
        let (na4, na4_star) = history.residual.push(moments(self.gear.residual()));
        let (nb4, nb4_star) = history.envelope.push(moments(self.mesh.amplitude()));
        Some(GearIndicators { figures, na4, na4_star, nb4, nb4_star })
    }
}

/// What of a record a history takes in.
#[derive(Clone, Copy)]
struct Shape {
    n: f64,
    variance: f64,
    kurtosis: f64,
}

impl Shape {
    /// Of a record; one without variance has no fourth moment either.
    fn of(moments: &Moments) -> Self {
        Self {
            n: moments.n as f64,
            variance: moments.variance().unwrap_or(0.0),
            kurtosis: moments.kurtosis().unwrap_or(0.0),
        }
    }

    /// Of as many zeros.
    fn nothing(moments: &Moments) -> Self {
        Self { n: moments.n as f64, variance: 0.0, kurtosis: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;

    const N: usize = 1024;
    const Z: usize = 28;

    fn record(seed: u64) -> Vec<f64> {
        let mesh = sine(N, N as f64, 28.0, 2.0, 0.3);
        let side = sine(N, N as f64, 29.0, 0.4, 0.0);
        sum(&[sine(N, N as f64, 1.0, 5.0, 0.1), mesh, side, gaussian_noise(N, seed)])
    }

    fn scaled(y: &[f64], by: f64) -> Vec<f64> {
        y.iter().map(|value| by * value).collect()
    }

    fn fresh() -> (HistoryPlan, GearHistory) {
        let history = GearHistory::new(N, Z, 1);
        (HistoryPlan::new(&history, 400, &mut FftCache::new()).unwrap(), history)
    }

    fn kurtosis_of(x: &[f64]) -> f64 {
        let n = x.len() as f64;
        let mean = x.iter().sum::<f64>() / n;
        let power = |p: i32| x.iter().map(|v| (v - mean).powi(p)).sum::<f64>();
        n * power(4) / power(2).powi(2)
    }

    #[test]
    fn identical_records_give_the_kurtosis_of_residual_and_envelope() {
        let (mut plan, mut history) = fresh();
        for _ in 0..40 {
            let found = plan.process(&record(1), &mut history).unwrap();
            let of_residual = kurtosis_of(plan.gear().residual());
            let of_envelope = kurtosis_of(plan.mesh().amplitude());
            // Rounding of 40 means.
            for (value, exact) in [
                (found.na4, of_residual),
                (found.na4_star, of_residual),
                (found.nb4, of_envelope),
                (found.nb4_star, of_envelope),
            ] {
                assert!((value.unwrap() / exact - 1.0).abs() < 1e-12);
            }
        }
        assert!(!history.residual.is_frozen, "equal is not above");
        assert_eq!((history.residual.n_records, history.residual.n_accepted), (40, 40));
    }

    #[test]
    fn doubling_one_record_raises_the_starred_figures_sixteenfold() {
        let (mut plan, mut history) = fresh();
        for _ in 0..MIN_ACCEPTED {
            plan.process(&record(2), &mut history);
        }
        let mut as_before = history;
        let normal = plan.process(&record(2), &mut as_before).unwrap();
        let doubled = plan.process(&scaled(&record(2), 2.0), &mut history).unwrap();
        let ratio = |a: Option<f64>, b: Option<f64>| a.unwrap() / b.unwrap();
        // V is that of the records before: exactly 2⁴ but for rounding.
        assert!((ratio(doubled.na4_star, normal.na4_star) - 16.0).abs() < 1e-9);
        assert!((ratio(doubled.nb4_star, normal.nb4_star) - 16.0).abs() < 1e-9);
        // NA4 takes it into its denominator: 16/(1 + 3/31)².
        let expected = 16.0 / (1.0_f64 + 3.0 / 31.0).powi(2);
        assert!((ratio(doubled.na4, normal.na4) - expected).abs() < 1e-9);
        assert!(history.residual.is_frozen && history.envelope.is_frozen);
        // What needs one record only does not notice.
        let (a, b) = (doubled.figures, normal.figures);
        for (a, b) in [
            (a.fm0, b.fm0),
            (a.fm4, b.fm4),
            (a.m6a, b.m6a),
            (a.m8a, b.m8a),
            (a.energy_ratio, b.energy_ratio),
            (a.sideband_level_factor, b.sideband_level_factor),
        ] {
            assert!((ratio(a, b) - 1.0).abs() < 1e-12);
        }
        // Frozen for good: healthy records afterwards change NA4's mean, not V.
        let frozen = history.residual;
        plan.process(&record(2), &mut history);
        assert_eq!(history.residual.mean_variance.to_bits(), frozen.mean_variance.to_bits());
        assert_eq!(history.residual.n_accepted, frozen.n_accepted);
        assert!(history.residual.mean_energy < frozen.mean_energy);
    }

    #[test]
    fn the_definitions_are_met_over_a_run_of_different_records() {
        let (mut plan, mut history) = fresh();
        let (mut energies, mut accepted, mut frozen) = (Vec::new(), Vec::<f64>::new(), false);
        for i in 0..120_u64 {
            let y = scaled(&record(100 + i), if i < 100 { 1.0 } else { 1.2 });
            let found = plan.process(&y, &mut history).unwrap();
            let r = plan.gear().residual();
            let mean = r.iter().sum::<f64>() / N as f64;
            let power = |p: i32| r.iter().map(|v| (v - mean).powi(p)).sum::<f64>();
            energies.push(power(2));
            let variance = power(2) / N as f64;
            let m = accepted.len() as f64;
            let v_mean = accepted.iter().sum::<f64>() / m;
            let s = (accepted.iter().map(|v| (v - v_mean).powi(2)).sum::<f64>() / m).sqrt();
            frozen |= accepted.len() >= 30 && variance > v_mean + 2.33 * s / m.sqrt();
            if !frozen {
                accepted.push(variance);
            }
            let all = energies.iter().sum::<f64>() / energies.len() as f64;
            let v = accepted.iter().sum::<f64>() / accepted.len() as f64;
            let n = N as f64;
            // Rounding of sums in another order.
            assert!((found.na4.unwrap() / (n * power(4) / (all * all)) - 1.0).abs() < 1e-11);
            assert!(
                (found.na4_star.unwrap() * (n * v).powi(2) / (n * power(4)) - 1.0).abs() < 1e-11
            );
            assert_eq!(history.residual.is_frozen, frozen, "record {i}");
        }
        assert!(frozen);
        assert_eq!(history.residual.n_accepted, accepted.len() as u64);
    }

    #[test]
    fn white_noise_reads_three_on_average() {
        let (mut plan, mut history) = fresh();
        let values: Vec<f64> = (0..200)
            .map(|i| plan.process(&gaussian_noise(N, 900 + i), &mut history).unwrap().na4.unwrap())
            .collect();
        let mean = values[50..].iter().sum::<f64>() / 150.0;
        // A record scatters by √(96/1024) = 0.31 (fourth moment over σ⁴), 150 of them by 0.025.
        assert!((mean - 3.0).abs() < 0.1, "{mean}");
    }

    #[test]
    fn a_history_written_down_and_read_back_goes_on_as_if_nothing_had_been() {
        let (mut plan, mut history) = fresh();
        for i in 0..35 {
            plan.process(&record(i), &mut history);
        }
        let GearHistory { n_points, teeth, harmonic, residual, envelope, n_rejected } = history;
        let mut copy = GearHistory { n_points, teeth, harmonic, residual, envelope, n_rejected };
        let mut other = HistoryPlan::new(&copy, 400, &mut FftCache::new()).unwrap();
        for i in 35..45 {
            assert_eq!(
                plan.process(&record(i), &mut history),
                other.process(&record(i), &mut copy),
                "bit by bit"
            );
        }
    }

    #[test]
    fn records_that_are_no_numbers_are_counted_and_change_nothing() {
        let (mut plan, mut history) = fresh();
        plan.process(&record(1), &mut history);
        let before = history;
        for bad in [f64::NAN, f64::INFINITY] {
            let mut y = record(2);
            y[17] = bad;
            assert_eq!(plan.process(&y, &mut history), None);
        }
        assert_eq!(history, GearHistory { n_rejected: 2, ..before });
    }

    #[test]
    fn nothing_but_mesh_has_no_figure_and_zero_records_stay_none() {
        let (mut plan, mut history) = fresh();
        for y in [vec![0.0; N], vec![3.3; N], sine(N, N as f64, 28.0, 1.0, 0.0)] {
            let found = plan.process(&y, &mut history).unwrap();
            assert_eq!(
                (found.na4, found.na4_star, found.nb4, found.nb4_star),
                (None, None, None, None)
            );
        }
        assert_eq!(history.residual.mean_energy.to_bits(), 0);
        // One microvolt beside a constant of a million is no rounding and is still read.
        let y = sum(&[record(5), vec![1e6; N]]);
        let (mut plan, mut history) = fresh();
        let with_dc = plan.process(&y, &mut history).unwrap();
        let (mut plan, mut history) = fresh();
        let plain = plan.process(&record(5), &mut history).unwrap();
        // An offset of 1e6 rounds each point by 6e-11.
        assert!((with_dc.na4.unwrap() - plain.na4.unwrap()).abs() < 1e-8);
        assert!((with_dc.nb4.unwrap() - plain.nb4.unwrap()).abs() < 1e-8);
    }

    #[test]
    fn what_cannot_be_a_history_is_refused() {
        let (_, sound) = fresh();
        let accepted = |n_accepted, n_records, is_frozen| GearHistory {
            residual: EnergyHistory {
                n_accepted,
                n_records,
                is_frozen,
                ..EnergyHistory::default()
            },
            envelope: EnergyHistory {
                n_accepted: n_records,
                n_records,
                ..EnergyHistory::default()
            },
            ..sound
        };
        let mut nan = sound;
        nan.residual.mean_energy = f64::NAN;
        let mut negative = sound;
        negative.envelope.mean_variance = -1.0;
        let mut uneven = sound;
        uneven.residual.n_records = 1;
        for history in [
            nan,
            negative,
            uneven,
            accepted(31, 30, false),
            accepted(29, 30, false),
            accepted(10, 30, true),
            GearHistory::new(N, Z, 0),
            GearHistory::new(N, Z, 15),
            GearHistory::new(40, Z, 1),
        ] {
            assert!(HistoryPlan::new(&history, 400, &mut FftCache::new()).is_none(), "{history:?}");
        }
        assert!(accepted(30, 40, true).is_sound());
    }

    #[test]
    fn records_of_1e9_samples_do_not_drift() {
        let mut history = EnergyHistory::default();
        // Two records in turn, of 64 samples each: the mean energy is the mean of two.
        let [a, b] = [3, 4].map(|seed| Shape::of(&Moments::of(&gaussian_noise(64, seed))));
        let n_pairs = 1_000_000_000 / 128;
        for _ in 0..n_pairs {
            history.push(a);
            history.push(b);
        }
        let exact = 0.5 * 64.0 * (a.variance + b.variance);
        let drift = history.mean_energy / exact - 1.0;
        // A running mean corrects its own rounding: the last steps count, not their number.
        assert!(drift.abs() < 1e-13, "{drift}");
        assert_eq!(history.n_records, 2 * n_pairs);
        // Equal records: no variance is refused for its rounding.
        let mut history = EnergyHistory::default();
        (0..1_000_000).for_each(|_| _ = history.push(a));
        assert!(!history.is_frozen && history.n_accepted == 1_000_000);
    }
}
