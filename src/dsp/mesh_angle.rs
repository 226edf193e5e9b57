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

/// Of a mesh harmonic's amplitude the average keeps this part at least: more is lost to noise than to the angle.
const KEPT: f64 = 0.95;

/// A harmonic that keeps this much leaves nothing to gain: 2 % of it are lost at the side bands of the highest.
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

/// Reads the drift of the angle that `blocks`, averages over equally long successive parts of a record, were made along
/// (D111).
///
/// `orders`: of the mesh harmonics, ascending, below half the points of a block. The drift from one part to the
/// next is read at the lowest steady one, where it must be less than half a period of it, and refined at the others.
#[must_use]
pub fn read(blocks: &[Vec<f64>], orders: &[usize]) -> MeshAngle {
    let steady = steady_lines(blocks, orders);
    if steady.is_empty() {
        return MeshAngle::Unknown;
    }
    if steady.iter().all(|(_, line)| kept(line) >= SHARP) {
        return MeshAngle::Sharp;
    }
    let mut steps = vec![0.0; blocks.len().saturating_sub(1)];
    for (order, line) in &steady {
        let period = 1.0 / *order as f64;
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
    MeshAngle::Drifts(ahead.into_iter().map(|a| a - mean).collect())
}

/// Power of the line at `order` in the mean of all `blocks` over what chance leaves there, from how the blocks scatter
/// (D26 of one line, for J5); `None` where they do not differ, or are fewer than two.
#[must_use]
pub fn power_over_scatter(blocks: &[Vec<f64>], order: usize) -> Option<f64> {
    let line: Vec<_> = blocks.iter().map(|block| line_at(block, order)).collect();
    let n = line.len() as f64;
    let mean = line.iter().sum::<Complex<f64>>() / n;
    let scatter: f64 = line.iter().map(|y| (y - mean).norm_sqr()).sum();
    (scatter > 0.0).then(|| n * (n - 1.0) * mean.norm_sqr() / scatter)
}

/// Whether `blocks` show a mesh harmonic at one of `orders` that is steady, and each such one is kept by their average.
#[must_use]
pub fn is_kept(blocks: &[Vec<f64>], orders: &[usize]) -> bool {
    let steady = steady_lines(blocks, orders);
    !steady.is_empty() && steady.iter().all(|(_, line)| kept(line) >= KEPT)
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

/// The mesh harmonics whose amplitudes agree, with their lines in each block.
fn steady_lines(blocks: &[Vec<f64>], orders: &[usize]) -> Vec<(usize, Vec<Complex<f64>>)> {
    let lines = orders.iter().map(|order| {
        let line: Vec<_> = blocks.iter().map(|block| line_at(block, *order)).collect();
        (*order, line)
    });
    lines.filter(|(_, line)| is_steady(line)).collect()
}

fn is_steady(line: &[Complex<f64>]) -> bool {
    let n = line.len() as f64;
    let mean = line.iter().map(|y| y.norm()).sum::<f64>() / n;
    let squares: f64 = line.iter().map(|y| (y.norm() - mean).powi(2)).sum();
    line.len() > 1 && mean > 0.0 && (squares / (n - 1.0)).sqrt() <= STEADY * mean
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
        let MeshAngle::Drifts(ahead) = read(&blocks, &ORDERS) else { panic!("it drifts") };
        let parted = plan.whole_revolutions(x.len(), FS_HZ, &track);
        let moved = corrected(&track, parted, &ahead).unwrap();
        let (_, again, blocks) = averaged(x, &moved);
        assert!(is_kept(&blocks, &ORDERS));
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
        assert_eq!(read(&blocks, &ORDERS), MeshAngle::Sharp);
    }

    #[test]
    fn noise_tells_no_angle() {
        let x = gaussian_noise(100_000, 7);
        let (_, _, blocks) = averaged(&x, &PhaseTrack::constant(18.0).unwrap());
        assert_eq!(read(&blocks, &ORDERS), MeshAngle::Unknown);
        // Eight amplitudes of noise that agree within STEADY: 4 in 10⁵; 10 and more of 10⁵ in one of 400 runs.
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
        for order in ORDERS {
            assert!(power_over_scatter(&blocks, order).unwrap() > 50.0, "{order}");
        }
        let beside = (30..40).filter(|k| power_over_scatter(&blocks, *k).unwrap() > 11.8).count();
        assert_eq!(beside, 0);
        assert_eq!(power_over_scatter(&[], 29), None);
        assert_eq!(power_over_scatter(&vec![vec![0.0; POINTS]; 8], 29), None);
    }

    #[test]
    fn few_blocks_and_silence_tell_nothing() {
        assert_eq!(read(&[], &ORDERS), MeshAngle::Unknown);
        assert_eq!(read(&[vec![0.0; POINTS]], &ORDERS), MeshAngle::Unknown);
        assert_eq!(read(&vec![vec![0.0; POINTS]; 8], &ORDERS), MeshAngle::Unknown);
        assert_eq!(read(&vec![vec![f64::NAN; POINTS]; 8], &ORDERS), MeshAngle::Unknown);
        let track = PhaseTrack::constant(18.0).unwrap();
        assert_eq!(corrected(&track, (1.0, 100), &[0.0]), None);
        let back: Vec<f64> = (0..8).map(|i| f64::from(i) * -20.0).collect();
        assert_eq!(corrected(&track, (1.0, 100), &back), None, "the wheel would turn back");
    }
}
