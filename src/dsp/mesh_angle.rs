//! The angle of a wheel by its own mesh, where no tacho marks it.
//!
//! An average along an angle that drifts loses its high orders: at order n a drift of 1/n of a revolution from one end of
//! the record to the other leaves nothing. The mesh shows the drift: in averages over successive parts of the record its
//! harmonics turn by n times what the wheel was ahead. Must not know tachos, nor what is damaged.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::order::PhaseTrack;

/// Standard deviation of a mesh harmonic's amplitudes in eight parts, over their mean, at most: of eight amplitudes of
/// noise, four in 10⁵ agree so well.
const STEADY: f64 = 0.1;

/// The average keeps this part of a steady mesh harmonic at least, after the angle was corrected. A drift that leaves so much of
/// the first leaves half at 3½ times its order, the highest that is read: less than the threefold growth that accuses.
const KEPT: f64 = 0.95;

/// A harmonic that keeps this much leaves nothing to gain: 2 % are lost half as far up again.
const SHARP: f64 = 0.99;

/// What the averages over successive parts of a record say of the angle they were made along.
#[derive(Debug, Clone, PartialEq)]
pub enum MeshAngle {
    /// Every steady mesh harmonic keeps its phase.
    Sharp,
    /// The wheel was ahead of the angle by so many revolutions in each part; their mean is 0.
    Drifts(Vec<f64>),
    /// No mesh harmonic is steady enough to tell.
    Unknown,
}

/// Mesh harmonics in averages over equally long successive parts of a record.
#[derive(Debug, Clone)]
pub struct MeshLines {
    /// Order and Σ y·e^(−j2πkn/N) in each part.
    lines: Vec<(usize, Vec<Complex<f64>>)>,
}

impl MeshLines {
    /// Reads the lines of `blocks` at `orders`: of the mesh harmonics, ascending, below half the points of a block.
    #[must_use]
    pub fn of(blocks: &[Vec<f64>], orders: &[usize]) -> Self {
        let in_each = |order: usize| blocks.iter().map(|block| line_at(block, order)).collect();
        Self { lines: orders.iter().map(|order| (*order, in_each(*order))).collect() }
    }

    /// Reads the drift of the angle that the averages were made along (D111).
    ///
    /// From one part to the next it is read at the lowest steady harmonic, where it must be less than half a period of it, and
    /// refined at the others.
    #[must_use]
    pub fn angle(&self) -> MeshAngle {
        let mut all_kept = None;
        for (_, line) in self.steady() {
            all_kept = Some(all_kept.unwrap_or(true) && kept(line) >= SHARP);
        }
        match all_kept {
            None => MeshAngle::Unknown,
            Some(true) => MeshAngle::Sharp,
            Some(false) => MeshAngle::Drifts(self.ahead()),
        }
    }

    /// Whether there is a steady mesh harmonic, and the average over all parts keeps each.
    #[must_use]
    pub fn are_kept(&self) -> bool {
        self.steady().next().is_some() && self.steady().all(|(_, line)| kept(line) >= KEPT)
    }

    /// Power of each line in the mean of all parts over what chance leaves there, from how the parts scatter (D26 of one line, for
    /// J5), in the order of the lines; infinite where the parts do not differ, 0 where nothing is there.
    pub fn powers_over_scatter(&self) -> impl Iterator<Item = f64> + '_ {
        self.lines.iter().map(|(_, line)| over_scatter(line))
    }

    /// How far the wheel got ahead in each part, revolutions, by the steady harmonics.
    fn ahead(&self) -> Vec<f64> {
        let n_parts = self.lines.first().map_or(0, |(_, line)| line.len());
        let mut steps = vec![0.0; n_parts.saturating_sub(1)];
        for (order, line) in self.steady() {
            let period = 1.0 / order as f64;
            for (step, pair) in steps.iter_mut().zip(line.windows(2)) {
                let turned = (pair[1] * pair[0].conj()).arg() / TAU;
                // What is left of the turn after the whole periods that the lower harmonics tell.
                let left = turned - *step / period;
                *step += (left - left.round()) * period;
            }
        }
        let mut ahead = vec![0.0];
        for step in steps {
            ahead.push(ahead[ahead.len() - 1] + step);
        }
        let mean = ahead.iter().sum::<f64>() / ahead.len() as f64;
        ahead.into_iter().map(|a| a - mean).collect()
    }

    /// The harmonics whose amplitudes agree.
    fn steady(&self) -> impl Iterator<Item = (usize, &[Complex<f64>])> {
        let lines = self.lines.iter().map(|(order, line)| (*order, line.as_slice()));
        lines.filter(|(_, line)| is_steady(line))
    }
}

/// Moves `track` ahead by `ahead` revolutions in the middles of as many parts of `n` revolutions from `first` on, as
/// [`TsaPlan::process_blocks`](crate::dsp::tsa::TsaPlan::process_blocks) parts them, and linearly beyond; `None` if it would turn back.
#[must_use]
pub fn corrected(
    track: &PhaseTrack,
    (first, n): (f64, usize),
    ahead: &[f64],
) -> Option<PhaseTrack> {
    let parts = ahead.len();
    let edge = |i: usize| first + (n * i / parts) as f64;
    let mut knots: Vec<(f64, f64)> =
        ahead.iter().enumerate().map(|(i, a)| (0.5 * (edge(i) + edge(i + 1)), *a)).collect();
    let ([a, b, ..], [.., y, z]) = (&knots[..], &knots[..]) else { return None };
    // A revolution more at either end, for the first and the last must be inside.
    let begin = along(*a, *b, first - 1.0);
    let end = along(*y, *z, first + n as f64 + 1.0);
    knots.insert(0, begin);
    knots.push(end);
    track.moved_ahead(&knots)
}

/// The line through `a` and `b` at `x`.
fn along(a: (f64, f64), b: (f64, f64), x: f64) -> (f64, f64) {
    (x, a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0))
}

fn is_steady(line: &[Complex<f64>]) -> bool {
    let n = line.len() as f64;
    let mean = line.iter().map(|y| y.norm()).sum::<f64>() / n;
    let squares: f64 = line.iter().map(|y| (y.norm() - mean).powi(2)).sum();
    line.len() > 1 && mean > 0.0 && (squares / (n - 1.0)).sqrt() <= STEADY * mean
}

fn over_scatter(line: &[Complex<f64>]) -> f64 {
    let n = line.len() as f64;
    let mean = line.iter().sum::<Complex<f64>>() / n;
    let scatter: f64 = line.iter().map(|y| (y - mean).norm_sqr()).sum();
    let power = n * (n - 1.0) * mean.norm_sqr();
    if power > 0.0 { power / scatter } else { 0.0 }
}

/// Part of a line that the mean of all blocks keeps.
fn kept(line: &[Complex<f64>]) -> f64 {
    let sum: Complex<f64> = line.iter().sum();
    sum.norm() / line.iter().map(|y| y.norm()).sum::<f64>()
}

/// Σ y·e^(−j2πkn/N) at k = `order`.
fn line_at(y: &[f64], order: usize) -> Complex<f64> {
    let turn = Complex::from_polar(1.0, -TAU * order as f64 / y.len() as f64);
    let mut at = Complex::new(1.0, 0.0);
    let mut sum = Complex::zero();
    for value in y {
        sum += at * *value;
        at *= turn;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::tsa::TsaPlan;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    const FS_HZ: f64 = 10_000.0;
    const POINTS: usize = 512;
    const ORDERS: [usize; 3] = [29, 58, 87];

    /// Ten seconds of a mesh of 29 teeth on a wheel that turns `turned(t)`.
    fn mesh(turned: &dyn Fn(f64) -> f64) -> Vec<f64> {
        let sample = |i: u32| {
            let angle = TAU * turned(f64::from(i) / FS_HZ);
            [1.0, 0.5, 0.8].iter().zip(ORDERS).map(|(a, n)| a * (n as f64 * angle).cos()).sum()
        };
        (0..100_000).map(sample).collect()
    }

    fn averaged(x: &[f64], track: &PhaseTrack) -> (TsaPlan, Vec<f64>, Vec<Vec<f64>>) {
        let plan = TsaPlan::new(POINTS, FS_HZ / 18.0);
        let (mut y, mut blocks) = (vec![0.0; POINTS], vec![vec![0.0; POINTS]; 8]);
        plan.process_blocks(x, FS_HZ, track, &mut y, &mut blocks);
        (plan, y, blocks)
    }

    /// Amplitudes of the mesh harmonics averaged at 18 Hz, and along the angle they tell.
    fn amplitudes(x: &[f64]) -> ([f64; 3], [f64; 3]) {
        let track = PhaseTrack::constant(18.0).unwrap();
        let (plan, y, blocks) = averaged(x, &track);
        let MeshAngle::Drifts(ahead) = MeshLines::of(&blocks, &ORDERS).angle() else {
            panic!("it drifts")
        };
        let parted = plan.whole_revolutions(x.len(), FS_HZ, &track);
        let moved = corrected(&track, parted, &ahead).unwrap();
        let (_, again, blocks) = averaged(x, &moved);
        assert!(MeshLines::of(&blocks, &ORDERS).are_kept());
        let of = |y: &[f64]| ORDERS.map(|n| 2.0 * line_at(y, n).norm() / POINTS as f64);
        (of(&y), of(&again))
    }

    #[test]
    fn a_speed_that_is_a_little_off_loses_no_harmonic() {
        // 5e-5 of 180 revolutions: 0.8 of a period of the third harmonic.
        let (before, after) = amplitudes(&mesh(&|t| 18.0 * (1.0 + 5e-5) * t + 0.3));
        assert!(before[2] < 0.3 * 0.8, "{before:?}");
        for (found, made) in after.iter().zip([1.0, 0.5, 0.8]) {
            assert!((found / made - 1.0).abs() < 1e-3, "{after:?}");
        }
    }

    #[test]
    fn a_speed_that_wanders_loses_no_harmonic() {
        let (before, after) = amplitudes(&mesh(&|t| 18.0 * t + 0.005 * (TAU * t / 10.0).sin()));
        assert!(before[2] < 0.4, "{before:?}");
        for (found, made) in after.iter().zip([1.0, 0.5, 0.8]) {
            // Knots 1.25 s apart leave 1e-4 of a revolution: 0.06 rad at order 87.
            assert!((found / made - 1.0).abs() < 0.01, "{after:?}");
        }
    }

    #[test]
    fn an_angle_that_is_right_is_left_alone() {
        let x = mesh(&|t| 18.0 * t + 0.3);
        let (_, _, blocks) = averaged(&x, &PhaseTrack::constant(18.0).unwrap());
        assert_eq!(MeshLines::of(&blocks, &ORDERS).angle(), MeshAngle::Sharp);
    }

    #[test]
    fn noise_tells_no_angle() {
        let x = gaussian_noise(100_000, 7);
        let (_, _, blocks) = averaged(&x, &PhaseTrack::constant(18.0).unwrap());
        assert_eq!(MeshLines::of(&blocks, &ORDERS).angle(), MeshAngle::Unknown);
        // Eight amplitudes of noise that agree within STEADY: 4 in 10⁵; 12 and more of 10⁵ in one of 400 runs.
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let mut normal = || -> f64 {
            let (u, v): (f64, f64) = (random.random(), random.random());
            (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
        };
        let steady = (0..100_000)
            .filter(|_| {
                is_steady(&(0..8).map(|_| Complex::new(normal(), normal())).collect::<Vec<_>>())
            })
            .count();
        assert!(steady < 12, "{steady} of 100000");
    }

    #[test]
    fn a_line_stands_over_the_scatter_of_the_blocks_and_noise_does_not() {
        let noise = gaussian_noise(100_000, 11);
        let x: Vec<f64> =
            mesh(&|t| 18.0 * t).iter().zip(&noise).map(|(m, n)| 0.1 * m + n).collect();
        let (_, _, blocks) = averaged(&x, &PhaseTrack::constant(18.0).unwrap());
        // Amplitudes of 0.1, 0.05 and 0.08 where 180 turns leave about 0.005 of noise (deviation 1, 512 points); 11.8 by chance
        // once in 1000.
        let over = |blocks: &[Vec<f64>], orders: &[usize]| -> Vec<f64> {
            MeshLines::of(blocks, orders).powers_over_scatter().collect()
        };
        assert!(over(&blocks, &ORDERS).iter().all(|z| *z > 50.0));
        let beside: Vec<usize> = (30..40).collect();
        assert!(over(&blocks, &beside).iter().all(|z| *z < 11.8));
        assert_eq!(over(&[], &ORDERS), [0.0; 3]);
        assert_eq!(over(&vec![vec![0.0; POINTS]; 8], &ORDERS), [0.0; 3]);
        let same = vec![blocks[0].clone(); 8];
        assert!(over(&same, &ORDERS).iter().all(|z| *z > 1e20), "nothing scatters");
    }

    #[test]
    fn few_blocks_and_silence_tell_nothing() {
        assert_eq!(MeshLines::of(&[], &ORDERS).angle(), MeshAngle::Unknown);
        assert_eq!(MeshLines::of(&[vec![0.0; POINTS]], &ORDERS).angle(), MeshAngle::Unknown);
        assert_eq!(MeshLines::of(&vec![vec![0.0; POINTS]; 8], &ORDERS).angle(), MeshAngle::Unknown);
        assert_eq!(
            MeshLines::of(&vec![vec![f64::NAN; POINTS]; 8], &ORDERS).angle(),
            MeshAngle::Unknown
        );
        let track = PhaseTrack::constant(18.0).unwrap();
        assert_eq!(corrected(&track, (1.0, 100), &[0.0]), None);
        let back: Vec<f64> = (0..8).map(|i| f64::from(i) * -20.0).collect();
        assert_eq!(corrected(&track, (1.0, 100), &back), None, "the wheel would turn back");
    }
}
