//! Vectors made by the law's own closed form, with and without noise.

use super::*;
use rand::RngExt;
use rand::SeedableRng;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

const CRITICAL_HZ: f64 = 117.0;

/// Vectors at speeds from `low` to `high`: of a bow b and an eccentricity e by complex stiffness, damping ratio
/// `damping`, and noise of `sigma` along each direction.
fn run(
    (low, high): (f64, f64),
    (b, e): (Complex<f64>, Complex<f64>),
    damping: f64,
    (sigma, random): (f64, &mut Pcg64Mcg),
) -> Vec<VectorAt> {
    let n = 30_u32;
    (0..n)
        .map(|i| {
            let speed_hz = low + (high - low) * f64::from(i) / f64::from(n - 1);
            let r = speed_hz / CRITICAL_HZ;
            let raised = Complex::new(1.0 - r * r, 2.0 * damping * r).inv();
            let noise =
                Complex::new(random.sample(StandardNormal), random.sample(StandardNormal)) * sigma;
            VectorAt { speed_hz, vector: (b + e * r * r) * raised + noise, weight: 1.0 }
        })
        .collect()
}

fn random(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed)
}

const NONE: Complex<f64> = Complex::new(0.0, 0.0);

#[test]
fn both_parts_of_a_closed_form_are_found() {
    let (b, e) = (Complex::new(30.0, -40.0), Complex::new(-100.0, 20.0));
    let vectors = run((5.0, 80.0), (b, e), 0.0, (0.0, &mut random(1)));
    let law = speed_law(&vectors, Known::Vectors, Some(CRITICAL_HZ)).unwrap();
    let best = law.fits[0];
    // Exact but for rounding; the other critical speeds cannot fit what has no noise.
    assert!((best.bow.vector - b).norm() < 1e-9 && law.fits.len() == 1);
    let at_reference = e * (REFERENCE_HZ / CRITICAL_HZ).powi(2);
    assert!((best.unbalance.vector - at_reference).norm() < 1e-9);
    let (r, (shown, _)) = (0.5, best.unbalance_at(0.5 * CRITICAL_HZ));
    assert!((shown - e.norm() * r * r / (1.0 - r * r)).abs() < 1e-9);
    assert!((best.bow_at(0.5 * CRITICAL_HZ).0 - 50.0 / 0.75).abs() < 1e-9);
    // At half the critical speed: |b + e/4|·4/3.
    let whole = (b + e * 0.25).norm() / 0.75;
    assert!((best.whole_at(0.5 * CRITICAL_HZ).unwrap() - whole).abs() < 1e-9);
    assert!(best.whole_at(0.8 * CRITICAL_HZ).is_none());
    assert!(best.bow.chance < 1e-100 && best.unbalance.chance < 1e-100 && best.unexplained < 1e-12);
}

#[test]
fn what_is_not_there_is_needed_as_often_as_chance_says() {
    let mut generator = random(2);
    let n = 20_000_u32;
    let (mut without_bow, mut without_unbalance) = (0_u32, 0_u32);
    for _ in 0..n {
        let noise = (1.0, &mut generator);
        let unbalance = run((5.0, 60.0), (NONE, Complex::new(40.0, 9.0)), 0.0, noise);
        without_bow += u32::from(fit(&unbalance, CRITICAL_HZ).unwrap().1.bow.chance <= 0.01);
        let noise = (1.0, &mut generator);
        let bow = run((5.0, 60.0), (Complex::new(9.0, 3.0), NONE), 0.0, noise);
        without_unbalance += u32::from(fit(&bow, CRITICAL_HZ).unwrap().1.unbalance.chance <= 0.01);
    }
    // 200 expected of 20 000, standard deviation 14: 158 to 242 is three of them.
    assert!((158..=242).contains(&without_bow), "{without_bow}");
    assert!((158..=242).contains(&without_unbalance), "{without_unbalance}");
}

#[test]
fn the_stated_deviation_is_the_scatter() {
    let mut generator = random(3);
    let truth = Complex::new(20.0, 5.0);
    let n = 4000;
    let mut found = Vec::new();
    for _ in 0..n {
        let vectors = run((5.0, 35.0), (truth, NONE), 0.0, (2.0, &mut generator));
        let (_, fit) = fit(&vectors, CRITICAL_HZ).unwrap();
        found.push(((fit.bow.vector - truth).re.powi(2), fit.bow.sigma.powi(2)));
    }
    let mean = |of: fn(&(f64, f64)) -> f64| found.iter().map(of).sum::<f64>() / f64::from(n);
    // A mean of 4000 squares is known to √(2/4000) = 2.2 %.
    assert!((mean(|f| f.0) / mean(|f| f.1) - 1.0).abs() < 0.09);
}

#[test]
fn resonance_raises_a_bow_and_is_not_taken_for_an_unbalance() {
    // To 0.68 of the critical speed: the bow shows nearly twice its size, with the phase of a damped rotor.
    let vectors = run((5.0, 80.0), (Complex::new(100.0, 0.0), NONE), 0.02, (0.3, &mut random(4)));
    let law = speed_law(&vectors, Known::Vectors, Some(CRITICAL_HZ)).unwrap();
    for fit in &law.fits {
        let ((bow, _), (unbalance, _)) = (fit.bow_at(80.0), fit.unbalance_at(80.0));
        // 2ζr/(1 − r²) = 5 % of phase is what the law leaves out.
        assert!(bow > 160.0 && unbalance < 0.1 * bow, "{fit:?}");
    }
}

#[test]
fn without_a_critical_speed_every_one_that_fits_is_kept() {
    // To 0.3 of the critical speed under noise: near, far, and where it is.
    let unbalance = (NONE, Complex::new(60.0, 80.0));
    let vectors = run((5.0, 35.0), unbalance, 0.0, (0.5, &mut random(5)));
    let law = speed_law(&vectors, Known::Vectors, None).unwrap();
    let highest = law.fits.iter().map(|f| f.critical_hz).fold(0.0, f64::max);
    let lowest = law.fits.iter().map(|f| f.critical_hz).fold(f64::INFINITY, f64::min);
    assert!(lowest < CRITICAL_HZ && highest > CRITICAL_HZ, "{lowest} {highest}");
    assert!(law.fits.iter().all(|f| f.unbalance.chance < 1e-6 && f.bow.vector.norm() < 1.5));
    // Without noise, to 0.68 of it, the far ones are out.
    let vectors = run((5.0, 80.0), unbalance, 0.0, (0.05, &mut random(6)));
    let law = speed_law(&vectors, Known::Vectors, None).unwrap();
    assert!(law.fits.iter().all(|f| f.critical_hz < 1.2 * CRITICAL_HZ));
}

#[test]
fn one_speed_few_vectors_and_the_neighbourhood_of_the_critical_speed_say_nothing() {
    let both = (Complex::new(9.0, 0.0), Complex::new(50.0, 0.0));
    let read = |span, n: usize, critical| {
        speed_law(&run(span, both, 0.0, (0.1, &mut random(7)))[..n], Known::Vectors, critical)
    };
    assert!(read((20.0, 29.0), 30, Some(CRITICAL_HZ)).is_none(), "not 1.5 times");
    assert!(read((20.0, 60.0), 5, None).is_none());
    assert!(read((90.0, 160.0), 30, Some(CRITICAL_HZ)).is_none(), "above 0.7");
    let through = read((10.0, 200.0), 30, Some(CRITICAL_HZ)).unwrap();
    assert!(through.speeds_hz.1 <= 0.7 * CRITICAL_HZ && through.n_vectors == 11, "{through:?}");
    let zero = VectorAt { speed_hz: 0.0, vector: NONE, weight: 1.0 };
    let silent: Vec<_> =
        (1..9_u32).map(|i| VectorAt { speed_hz: 5.0 * f64::from(i), ..zero }).collect();
    assert!(speed_law(&silent, Known::Vectors, None).is_none());
}

/// The same without phases: every vector turned by another angle.
fn turned(mut vectors: Vec<VectorAt>) -> Vec<VectorAt> {
    for (v, turn) in vectors.iter_mut().zip(0_u32..) {
        v.vector *= Complex::from_polar(1.0, 2.3 * f64::from(turn));
    }
    vectors
}

#[test]
fn lengths_alone_give_both_parts_of_a_closed_form() {
    let (b, e) = (Complex::new(30.0, -40.0), Complex::new(-100.0, 20.0));
    let vectors = turned(run((5.0, 80.0), (b, e), 0.0, (0.0, &mut random(1))));
    let law = speed_law(&vectors, Known::Lengths, Some(CRITICAL_HZ)).unwrap();
    let best = law.fits[0];
    // Rounding, as the normal matrix of 1, h, h² lets it through.
    assert!((best.bow.vector.norm() - 50.0).abs() < 1e-6 && law.fits.len() == 1, "{best:?}");
    let u = e * (REFERENCE_HZ / CRITICAL_HZ).powi(2);
    assert!((best.unbalance.vector.norm() - u.norm()).abs() < 1e-6);
    let between = (b.conj() * u).arg().abs();
    assert!((best.unbalance.vector.arg() - between).abs() < 1e-6);
    let whole = (b + e * 0.25).norm() / 0.75;
    assert!((best.whole_at(0.5 * CRITICAL_HZ).unwrap() - whole).abs() < 1e-6);
    assert!(best.bow.chance < 1e-50 && best.unbalance.chance < 1e-50 && best.unexplained < 1e-6);
}

#[test]
fn a_part_that_is_not_there_is_not_needed_by_lengths_oftener_than_chance_says() {
    let mut generator = random(2);
    let n = 20_000_u32;
    let (mut without_bow, mut without_unbalance) = (0_u32, 0_u32);
    for _ in 0..n {
        let noise = (1.0, &mut generator);
        let unbalance = run((5.0, 60.0), (NONE, Complex::new(400.0, 90.0)), 0.0, noise);
        let fitted = lengths::fit(&unbalance, CRITICAL_HZ).unwrap().1;
        without_bow += u32::from(fitted.bow.chance <= 0.01);
        let noise = (1.0, &mut generator);
        let bow = run((5.0, 60.0), (Complex::new(90.0, 30.0), NONE), 0.0, noise);
        let fitted = lengths::fit(&bow, CRITICAL_HZ).unwrap().1;
        without_unbalance += u32::from(fitted.unbalance.chance <= 0.01);
    }
    // 200 expected of 20 000 each if no sign were asked for, 242 three deviations more: a part of negative square is not there.
    assert!(without_bow <= 242 && without_unbalance <= 242, "{without_bow} {without_unbalance}");
}

#[test]
fn the_ends_of_a_part_by_lengths_hold_the_truth() {
    let mut generator = random(3);
    let (b, e) = (Complex::new(20.0, 5.0), Complex::new(0.0, 60.0));
    let n = 4000_u32;
    let (mut bows, mut unbalances) = (0_u32, 0_u32);
    for _ in 0..n {
        let vectors = run((5.0, 60.0), (b, e), 0.0, (2.0, &mut generator));
        let fit = lengths::fit(&vectors, CRITICAL_HZ).unwrap().1;
        let holds = |part: Part, truth: f64| (part.vector.norm() - truth).abs() <= 2.0 * part.sigma;
        let u = e.norm() * (REFERENCE_HZ / CRITICAL_HZ).powi(2);
        (bows, unbalances) = (
            bows + u32::from(holds(fit.bow, b.norm())),
            unbalances + u32::from(holds(fit.unbalance, u)),
        );
    }
    // Two deviations hold 95.4 % of 27 degrees' t rather less: at least 93 %.
    let least = 93 * n / 100;
    assert!(bows >= least && unbalances >= least, "{bows} {unbalances} of {n}");
}

#[test]
fn resonance_raises_a_bow_by_lengths_too() {
    let bow = (Complex::new(100.0, 0.0), NONE);
    let vectors = turned(run((5.0, 80.0), bow, 0.02, (0.3, &mut random(4))));
    let law = speed_law(&vectors, Known::Lengths, Some(CRITICAL_HZ)).unwrap();
    assert!(law.fits.iter().all(|fit| fit.bow.chance < 1e-6 && fit.bow_at(80.0).0 > 160.0));
    // The best fit leaves next to nothing to an unbalance.
    let best = law.fits[0];
    assert!(best.unbalance_at(80.0).0 < 0.2 * best.bow_at(80.0).0, "{best:?}");
}
