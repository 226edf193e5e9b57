//! Lines of a squared envelope: found, told apart, refused.

use super::read::peak_height;
use super::*;
use crate::dsp::real::Real;
use crate::dsp::real::floor_index;

pub(super) const BAND: Band = Band { low: Hz(0.0), high: Hz(5000.0), whitened: false };

/// Flat pseudo-noise of depth about 0.01 and lines of given depth at harmonics of `rate_hz`.
fn spectrum_with(rate_hz: f64, depths: &[f32], bin_hz: f64) -> Vec<f32> {
    let mut state = 12345_u64;
    let mut depth: Vec<f32> = (0..20_000)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let u = ((state >> 33) as f64 + 1.0) / (1u64 << 31) as f64;
            f32::rounded(0.01 * (-u.min(1.0).ln()).sqrt())
        })
        .collect();
    for (i, d) in depths.iter().enumerate() {
        depth[floor_index(((i + 1) as f64 * rate_hz / bin_hz).round())] = *d;
    }
    depth
}

/// The squared envelope's spectrum of ten seconds, on a grid of 0.05 Hz.
pub(super) fn of_ten_seconds(depth: &[f32]) -> DepthSpectrum<'_> {
    DepthSpectrum { depth, bin_hz: 0.05, duration_s: 10.0, mean_square: 1.0, tone: None }
}

pub(super) fn task(known: &[KnownLine]) -> LineTask<'_> {
    LineTask {
        line: DefectLine::Bpfo,
        expected: Hz(100.0),
        band: RelativeBand::default(),
        side_band_spacing: Hz(25.0),
        cage_spacing: None,
        element_range: None,
        is_at_rest: false,
        sum_of_races: None,
        shaft_speed: Hz(28.0),
        known,
        known_to: 1e-3,
        resolution: Hz(0.2),
        floor_half_width: Hz(20.0),
    }
}

#[test]
fn a_slipping_line_and_its_harmonics_are_found() {
    let depth = spectrum_with(98.9, &[0.5, 0.3, 0.2], 0.05);
    let spectrum = of_ten_seconds(&depth);
    let reading = read_line(&spectrum, BAND, &task(&[]), &mut Vec::new()).unwrap();
    assert!((reading.frequency.0 - 98.9).abs() < 0.05, "one bin of the grid");
    assert!(
        (reading.total_depth() - 0.38_f64.sqrt()).abs() < 0.02,
        "noise of the empty fourth harmonic"
    );
    assert!(reading.harmonics[0].unwrap().power_ratio > 1000.0);
}

#[test]
fn a_side_line_of_shaft_events_is_told_from_a_line_of_its_own() {
    // Shaft harmonics of depth 0.6 at 84 and 112 Hz beside a line at 98.9: half of them is 0.3.
    let modulated = |line: f32| {
        let mut depth = spectrum_with(28.0, &[0.6; 8], 0.05);
        depth[1978] = line;
        let spectrum = of_ten_seconds(&depth);
        let reading = read_line(&spectrum, BAND, &task(&[]), &mut Vec::new()).unwrap();
        // A peak of one bin among noise is no Hann lobe: its interpolated height is some per cent off.
        assert!((reading.shaft_depth / 0.6 - 1.0).abs() < 0.1, "{}", reading.shaft_depth);
        reading.is_modulated_shaft()
    };
    assert!(modulated(0.25) && !modulated(0.38));
    // A shaft harmonic whose lobe meets the line's own cannot be read.
    let mut near = task(&[]);
    near.shaft_speed = Hz(98.7);
    let depth = spectrum_with(98.9, &[0.5, 0.3, 0.2], 0.05);
    let spectrum = of_ten_seconds(&depth);
    let reading = read_line(&spectrum, BAND, &near, &mut Vec::new()).unwrap();
    assert!(reading.shaft_depth < 0.4 && !reading.is_modulated_shaft());
}

#[test]
fn a_turning_race_shows_more_than_the_elements_modulate() {
    // Shaft harmonics of depth 0.6 and a line at 98.9, of 209.1 + 98.9 = 11·28: elements pass the race at rest at 209.1 Hz.
    let modulated = |passing: f32, sum_of_races: Option<Hz>| {
        let mut depth = spectrum_with(28.0, &[0.6; 8], 0.05);
        depth[1978] = 0.25;
        depth[4182] = passing;
        let spectrum = of_ten_seconds(&depth);
        let task = LineTask { sum_of_races, ..task(&[]) };
        read_line(&spectrum, BAND, &task, &mut Vec::new()).unwrap().is_modulated_shaft()
    };
    let both = Some(Hz(11.0 * 28.0));
    assert!(modulated(0.5, both), "½·0.6·min(1, 2·0.5) = 0.3");
    assert!(!modulated(0.2, both), "½·0.6·0.4 = 0.12: no side line is as high");
    assert!(modulated(0.2, None), "of other lines full modulation is allowed for");
}

#[test]
fn the_depth_of_a_line_between_bins_is_exact_to_a_third_of_a_percent() {
    use crate::dsp::envelope::EnvelopeSpectrumPlan;
    use crate::dsp::fft::FftCache;
    let n = 5000;
    let mut plan = EnvelopeSpectrumPlan::<f32>::new(n, &mut FftCache::new());
    let mut depth = vec![0.0; plan.n_bins()];
    for shift in [0.0, 0.13, 0.25, 0.37, 0.5] {
        // e² at 500 Hz with a modulation of depth 0.4 at 40 Hz + a part of the 0.1 Hz step.
        let f = 40.0 + shift * 0.1;
        let e2 = |i: u32| 1.0 + 0.4 * (std::f64::consts::TAU * f * f64::from(i) / 500.0).cos();
        let e2: Vec<f32> = (0..5000).map(|i| f32::rounded(e2(i))).collect();
        plan.process(&e2, &mut depth);
        let near = floor_index(f / 0.05);
        let at = if depth[near + 1] > depth[near] { near + 1 } else { near };
        let read = peak_height(&depth, at);
        assert!((read / 0.4 - 1.0).abs() < 3e-3, "{shift}: {read}");
    }
}

#[test]
fn a_geometry_known_less_well_is_searched_wider_and_at_a_price() {
    // 97.0 Hz lies 3 % below the kinematic rate: beyond slip, within slip and 2 % of geometry.
    let depth = spectrum_with(97.0, &[0.5], 0.05);
    let spectrum = of_ten_seconds(&depth);
    let read = |band: RelativeBand| {
        read_line(&spectrum, BAND, &LineTask { band, ..task(&[]) }, &mut Vec::new()).unwrap()
    };
    let exact = read(RelativeBand::default());
    let wide = read(RelativeBand { low: -0.02, high: 0.02 });
    assert!((wide.frequency.0 - 97.0).abs() < 0.05, "one bin of the grid");
    assert!((exact.frequency.0 - 97.0).abs() > 0.5, "outside of what slip explains");
    let bins = |reading: &BandReading| reading.harmonics[0].unwrap().searched.bins;
    // −2…+1 % of 100 Hz in 10 s are 30 steps; −3.96…+3.02 % are 70.
    assert!((bins(&exact) - 61.0).abs() < 1.1 && (bins(&wide) - 140.6).abs() < 1.1);
}

#[test]
fn a_known_line_is_not_read_as_a_defect() {
    let depth = spectrum_with(100.0, &[0.5], 0.05);
    let spectrum = of_ten_seconds(&depth);
    let known = [KnownLine { frequency: Hz(100.0), spacing: Hz(25.0), label: "4x main".into() }];
    let reading = read_line(&spectrum, BAND, &task(&known), &mut Vec::new()).unwrap();
    assert!(reading.harmonics[0].unwrap().depth < 0.05);
    assert_eq!(coinciding(Hz(100.1), &known, Hz(0.2)).unwrap().label, "4x main");
}

/// Hann lobes of given depth at frequencies between bins, over the noise of [`spectrum_with`].
pub(super) fn spectrum_of(lines: &[(f64, f64)], bin_hz: f64) -> Vec<f32> {
    let mut depth = spectrum_with(1.0, &[], bin_hz);
    for (frequency_hz, height) in lines {
        for (k, d) in depth.iter_mut().enumerate() {
            // Lobe of the Hann window, padded twice: x cells of 1/T from the line.
            let x = 0.5 * (k as f64 - frequency_hz / bin_hz);
            if x.abs() < 2.0 {
                let sinc = if x.abs() < 1e-9 {
                    1.0
                } else {
                    (std::f64::consts::PI * x).sin() / (std::f64::consts::PI * x)
                };
                let lobe = if (x.abs() - 1.0).abs() < 1e-9 { 0.5 } else { sinc / (1.0 - x * x) };
                *d = d.max(f32::rounded(height * lobe));
            }
        }
    }
    depth
}

/// What slower rate is found for a line at 98.9 Hz among others.
fn slower(lines: &[(f64, f64)], line: DefectLine) -> Option<f64> {
    let depth = spectrum_of(lines, 0.05);
    let spectrum = of_ten_seconds(&depth);
    let task = LineTask { line, ..task(&[]) };
    let reading = read_line(&spectrum, BAND, &task, &mut Vec::new()).unwrap();
    assert!((reading.frequency.0 - 98.9).abs() < 0.05);
    assert_eq!(reading.is_explained(), reading.slower.is_some());
    reading.slower.map(|rate| rate.0)
}

#[test]
fn stronger_side_bands_than_full_modulation_tell_of_the_shafts_events() {
    // Side bands at 75 and 125 Hz beside a line at 100 Hz and its second harmonic.
    let beside_shaft = |side: f32, is_at_rest: bool, shaft: f32| {
        let mut depth = spectrum_with(100.0, &[0.8, 0.5], 0.05);
        depth[560] = depth[560].max(shaft);
        depth[1500] = side;
        depth[2500] = side;
        let spectrum = of_ten_seconds(&depth);
        let task = LineTask { is_at_rest, ..task(&[]) };
        let reading = read_line(&spectrum, BAND, &task, &mut Vec::new()).unwrap();
        assert_eq!(reading.is_explained(), reading.is_shaft_product);
        reading.is_shaft_product
    };
    let product = |side: f32, is_at_rest: bool| beside_shaft(side, is_at_rest, 0.0);
    assert!(product(0.7, true));
    assert!(!product(0.3, true), "less than half: the load turns with the shaft");
    // Three quarters are a load's that turns, unless events of the shaft, at 28 Hz, stand nearly as high.
    assert!(!product(0.6, true) && !beside_shaft(0.6, true, 0.6));
    assert!(beside_shaft(0.6, true, 0.7));
    assert!(!product(0.7, false), "a race that turns has them by its nature");
}

#[test]
fn what_stands_on_either_side_of_a_shafts_harmonic_is_that_ones() {
    // 4x of 25 Hz is at 100 Hz; a line 2 Hz below, and what stands beside it.
    let is_mirrored = |beside: &[(f64, f64)], known: &[KnownLine]| {
        let depth = spectrum_of(&[&[(98.0, 0.5), (196.0, 0.3)], beside].concat(), 0.05);
        let task = LineTask { line: DefectLine::Bpfi, shaft_speed: Hz(25.0), ..task(known) };
        read_line(&of_ten_seconds(&depth), BAND, &task, &mut Vec::new()).unwrap().is_mirrored
    };
    assert!(is_mirrored(&[(102.0, 0.3)], &[]));
    assert!(!is_mirrored(&[], &[]) && !is_mirrored(&[(102.0, 0.2)], &[]));
    assert!(!is_mirrored(&[(102.2, 0.5)], &[]), "not as far away");
    // The shaft turns 0.2 % faster than told: its harmonic is at 100.2 Hz.
    assert!(is_mirrored(&[(100.2, 0.4), (102.4, 0.3)], &[]));
    let mains = KnownLine { frequency: Hz(102.0), spacing: Hz(51.0), label: "mains".to_owned() };
    assert!(!is_mirrored(&[(102.0, 0.3)], &[mains]));
    // Of the race that turns, the mirror may be a side band of the line at the rate of the other race, 152 Hz: no higher than that.
    let beside_passing = |passing: f64| {
        let lines = [(98.0, 0.5), (196.0, 0.3), (102.0, 0.3), (152.0, passing)];
        let depth = spectrum_of(&lines, 0.05);
        let sum_of_races = Some(Hz(250.0));
        let (line, shaft_speed) = (DefectLine::Bpfi, Hz(25.0));
        let task = LineTask { line, shaft_speed, sum_of_races, ..task(&[]) };
        read_line(&of_ten_seconds(&depth), BAND, &task, &mut Vec::new()).unwrap().is_mirrored
    };
    assert!(beside_passing(0.2) && !beside_passing(0.4));
    // Half way between two harmonics the mirror is a side band of its own, 1x off.
    let half = spectrum_of(&[(98.0, 0.5), (196.0, 0.3), (98.0 + 28.0, 0.3)], 0.05);
    let task = LineTask {
        line: DefectLine::Bpfi,
        shaft_speed: Hz(28.0),
        side_band_spacing: Hz(28.0),
        ..task(&[])
    };
    let reading = read_line(&of_ten_seconds(&half), BAND, &task, &mut Vec::new()).unwrap();
    assert!(!reading.is_mirrored && reading.side_band.unwrap().depth > 0.25);
}

#[test]
fn a_line_that_stands_beside_every_harmonic_of_the_shaft_is_no_rolling_elements() {
    // 2·BSF at 100 Hz with FTF of 10 Hz: as high a line at 72 Hz, a shaft's speed of 28 Hz below, or one at 90 Hz.
    let product = |beside_hz: f64| {
        let depth = spectrum_of(&[(100.0, 0.6), (200.0, 0.3), (beside_hz, 0.5)], 0.05);
        let side_band_spacing = Hz(10.0);
        let task = LineTask { line: DefectLine::TwoBsf, side_band_spacing, ..task(&[]) };
        let reading = read_line(&of_ten_seconds(&depth), BAND, &task, &mut Vec::new()).unwrap();
        reading.is_shaft_product
    };
    assert!(product(72.0) && !product(90.0));
}

#[test]
fn a_multiple_of_something_slower_is_told_from_a_line_of_its_own() {
    let own = (98.9, 0.5);
    assert_eq!(slower(&[own], DefectLine::Bpfo), None);
    // Knocks at a third of it, as high: 32.967 Hz lies between two bins.
    let found = slower(&[own, (32.967, 0.5), (65.933, 0.5)], DefectLine::Bpfo).unwrap();
    assert!((found - 32.967).abs() < 0.01, "{found}");
    // Less than half as high; or off by more than a speed wanders: 3·33.1 = 99.3 is 0.4 % off.
    assert_eq!(slower(&[own, (32.967, 0.2)], DefectLine::Bpfo), None);
    assert_eq!(slower(&[own, (33.1, 0.6)], DefectLine::Bpfo), None);
    // A sharp line is a multiple only of what meets it: 3·32.9 = 98.7 is 0.2 % off.
    assert_eq!(slower(&[own, (32.9, 0.5)], DefectLine::Bpfo), None);
    // One race struck: half the rate of a rolling element's line is its own.
    let half = [own, (49.45, 0.5)];
    assert!(
        slower(&half, DefectLine::Bpfo).is_some() && slower(&half, DefectLine::TwoBsf).is_none()
    );
}

#[test]
fn a_line_of_a_dense_comb_is_told_from_a_line_of_its_own() {
    // Strikes at a seventeenth of the rate, whose first lines are lost in noise.
    let (own, spacing) = ((98.9, 0.5), 98.9 / 17.0);
    let (below, above) = (98.9 - spacing, 98.9 + spacing);
    let found = slower(&[own, (below, 0.4), (above, 0.3)], DefectLine::Bpfo).unwrap();
    assert!((found - spacing).abs() < 0.01, "{found}");
    // One of them alone, one less than half as high, or spaced otherwise: side bands of a line that stands by itself.
    assert_eq!(slower(&[own, (below, 0.4)], DefectLine::Bpfo), None);
    assert_eq!(slower(&[own, (below, 0.4), (above, 0.2)], DefectLine::Bpfo), None);
    assert_eq!(slower(&[own, (below - 0.05, 0.4), (above + 0.05, 0.4)], DefectLine::Bpfo), None);
    // Above the fortieth the next ones must be as high.
    let at_47 = |second: f64| {
        let g = 98.9 / 47.0;
        let beside = [(-2.0, second), (-1.0, 0.4), (1.0, 0.4), (2.0, second)];
        slower(
            &[vec![own], beside.map(|(k, h)| (98.9 + k * g, h)).to_vec()].concat(),
            DefectLine::Bpfo,
        )
    };
    assert!(at_47(0.3).is_some() && at_47(0.2).is_none());
    // At the spacing of a rolling element's own side bands, FTF, the second ones must be as high.
    let read = |second: f64, ftf_hz: f64| {
        let beside = [-2.0, -1.0, 1.0, 2.0]
            .map(|k: f64| (98.9 + k * spacing, if k.abs() > 1.5 { second } else { 0.4 }));
        let depth = spectrum_of(&[&[own], &beside[..]].concat(), 0.05);
        let (line, side_band_spacing) = (DefectLine::TwoBsf, Hz(ftf_hz));
        let task = LineTask { line, side_band_spacing, ..task(&[]) };
        read_line(&of_ten_seconds(&depth), BAND, &task, &mut Vec::new()).unwrap().slower
    };
    assert!(read(0.1, 11.0).is_some());
    assert!(read(0.1, spacing).is_none() && read(0.3, spacing).is_some());
}

#[test]
fn a_line_of_a_comb_is_told_where_its_rate_is_placed_badly() {
    // Strikes at an eleventh, whose first line another pulls away by a tenth of a cell: eleven times that is a cell.
    let (own, spacing) = ((98.9, 0.5), 98.9 / 11.0);
    let first = (spacing + 0.01, 0.5);
    let beside = |heights: [f64; 4]| {
        [-2.0, -1.0, 1.0, 2.0].iter().zip(heights).map(|(k, h)| (98.9 + k * spacing, h)).collect()
    };
    let read =
        |beside: Vec<(f64, f64)>| slower(&[vec![own, first], beside].concat(), DefectLine::Bpfo);
    let found = read(beside([0.4; 4])).unwrap();
    assert!((found - spacing).abs() < 0.01, "{found}");
    // Side bands of a line that stands by itself fall off.
    assert_eq!(read(beside([0.2, 0.4, 0.4, 0.2])), None);
    assert_eq!(read(beside([0.4, 0.4, 0.4, 0.0])), None);
}

#[test]
fn a_line_that_is_smeared_is_a_multiple_of_what_lies_as_far_away_as_it_reaches() {
    // A speed that turns back at 32.967 Hz and rests at 32.7: the third harmonic is highest at one end, the first at the other.
    let resting = (32.7, 0.8);
    let third = [(98.1, 0.3), (98.3, 0.25), (98.5, 0.3), (98.7, 0.3), (98.9, 0.5)];
    let first = [(32.8, 0.5), (32.9, 0.7), resting];
    assert!(slower(&[&third[..], &first[..]].concat(), DefectLine::Bpfo).is_some());
    let sharp = [(98.9, 0.5), resting];
    assert_eq!(slower(&sharp, DefectLine::Bpfo), None);
    // A harmonic of the shaft apart from the line is none of its smear, where it is known.
    let beside = [(98.9, 0.5), (98.2, 0.45)];
    let depth = spectrum_of(&[&beside[..], &first[..]].concat(), 0.05);
    let read = |known: &[KnownLine]| {
        let reading = read_line(&of_ten_seconds(&depth), BAND, &task(known), &mut Vec::new());
        reading.unwrap().slower
    };
    assert!(read(&[]).is_some());
    assert_eq!(
        read(&[KnownLine { frequency: Hz(98.2), spacing: Hz(25.0), label: "3x main".into() }]),
        None
    );
}

#[test]
fn the_skirt_of_a_covered_line_is_no_line() {
    // A shaft harmonic at 98.75 where 98.5 is expected: its skirt leaves the covered 0.2 Hz.
    let depth = spectrum_of(&[(98.62, 0.8), (100.4, 0.06)], 0.05);
    let spectrum = of_ten_seconds(&depth);
    let known = [KnownLine { frequency: Hz(98.5), spacing: Hz(25.0), label: "4x main".into() }];
    let reading = read_line(&spectrum, BAND, &task(&known), &mut Vec::new()).unwrap();
    assert!((reading.frequency.0 - 100.4).abs() < 0.05, "{}", reading.frequency.0);
}

#[test]
fn peaks_of_noise_are_worth_what_the_joint_distribution_of_neighbours_says() {
    // Powers of two correlated complex normals: with K geometric, P(K = k) = (1 − ρ)·ρ^k, both are Gamma(k + 1) of scale 1 − ρ, on
    // their own (W. F. Kibble 1941); ρ = r², r of Hann half a step apart.
    let rho = 0.905_415_f64.powi(2);
    let both_above = |z: f64| -> f64 {
        let t = z / (1.0 - rho);
        let (mut term, mut tail, mut sum) = ((-t).exp(), (-t).exp(), 0.0);
        for k in 0..2000 {
            sum += (1.0 - rho) * rho.powi(k) * tail.min(1.0).powi(2);
            term *= t / f64::from(k + 1);
            tail += term;
        }
        sum
    };
    for z in [4.0, 7.0, 10.0, 14.0, 20.0] {
        let apart = 1.0 - both_above(z) * z.exp();
        let cells = Searched::peaks(1.0).cells(z);
        assert!((cells / apart - 1.0).abs() < 0.004, "z = {z}: {cells} for {apart}");
    }
    // Bins of one run, at a power that all or none reach.
    let run = Searched::largest(5.0, 1.0);
    assert!((run.cells(0.0) - 1.0).abs() < 1e-12 && (run.cells(1e4) - 5.0).abs() < 1e-6);
}

#[test]
fn what_stands_on_a_known_line_is_read_apart_with_what_is_beside_it() {
    let known = [KnownLine { frequency: Hz(99.0), spacing: Hz(33.0), label: "3x main".into() }];
    let covered = |lines: &[(f64, f64)]| {
        let depth = spectrum_of(lines, 0.05);
        read_covered(&of_ten_seconds(&depth), BAND, &task(&known), &mut Vec::new())
    };
    let found = covered(&[(98.9, 0.7), (132.0, 0.3), (100.4, 0.5)]).unwrap();
    assert!((found.frequency.0 - 98.9).abs() < 0.06 && found.with == "3x main");
    assert!((found.harmonic.depth - 0.7).abs() < 0.02 && (found.beside - 0.3).abs() < 0.02);
    // Something higher stands in the open part of the range, or nothing does.
    assert_eq!(covered(&[(98.9, 0.4), (100.4, 0.5)]), None);
    let noise = covered(&[]).is_some_and(|found| found.harmonic.depth > 0.05);
    assert!(!noise);
}

/// Multiples of a shaft's 33 Hz.
fn shaft_series() -> Vec<KnownLine> {
    let known = |h: u32| {
        let frequency = Hz(f64::from(h) * 33.0);
        KnownLine { frequency, spacing: Hz(33.0), label: format!("{h}x main") }
    };
    (1..=12).map(known).collect()
}

#[test]
fn a_harmonic_apart_tells_a_line_from_the_known_one_at_its_place() {
    let series = shaft_series();
    let read = |lines: &[(f64, f64)]| {
        let depth = spectrum_of(lines, 0.05);
        read_line(&of_ten_seconds(&depth), BAND, &task(&series), &mut Vec::new()).unwrap()
    };
    let strikes = [(98.85, 0.8), (197.7, 0.6), (296.55, 0.4)];
    // 98.85 lies within 0.2 Hz of 3x, twice that is 0.3 Hz from 6x.
    let told = read(&strikes);
    assert!((told.frequency.0 - 98.85).abs() < 0.02, "{}", told.frequency.0);
    let depths = told.harmonics.map(|h| h.map_or(0.0, |h| h.depth));
    assert!((depths[0] - 0.6).abs() < 0.02, "no deeper than what tells it: {depths:?}");
    assert!(depths[1] == 0.0 && (depths[2] - 0.4).abs() < 0.02, "{depths:?}");
    let is_told = |lines: &[(f64, f64)]| (read(lines).frequency.0 - lines[0].0).abs() < 0.05;
    assert!(!is_told(&[(98.85, 0.8)]), "no harmonic");
    assert!(!is_told(&[(99.0, 0.8), (198.0, 0.6), (297.0, 0.4)]), "the shaft's own");
    assert!(!is_told(&[(98.85, 0.8), (198.0, 0.9), (197.72, 0.6)]), "no valley between");
    // A speed of 0.05 % more: the fourth is 0.2 Hz off.
    assert!(!is_told(&[(99.05, 0.8), (198.1, 0.6), (396.21, 0.4)]), "the shaft's, by the speed");
    assert!(!is_told(&[strikes[0], strikes[1], (132.0, 0.5)]), "the shaft's events are beside it");
    // A speed that nothing confirms may be 0.15 % less.
    let unconfirmed = LineTask { known_to: 3e-3, ..task(&series) };
    let depth = spectrum_of(&strikes, 0.05);
    let reading = read_line(&of_ten_seconds(&depth), BAND, &unconfirmed, &mut Vec::new());
    assert!((reading.unwrap().frequency.0 - 98.85).abs() > 0.05);
}

#[test]
fn side_bands_of_a_turning_race_are_no_events_of_the_shaft_it_is_told_from() {
    let series = shaft_series();
    let read = |sum_of_races: Option<Hz>, others: &[(f64, f64)]| {
        // The shaft itself modulates what is struck.
        let strikes = [(33.0, 0.35), (65.85, 0.6), (98.85, 0.8), (132.0, 0.5), (197.7, 0.6)];
        let depth = spectrum_of(&[&strikes, others].concat(), 0.05);
        let task = LineTask { sum_of_races, ..task(&series) };
        read_line(&of_ten_seconds(&depth), BAND, &task, &mut Vec::new()).unwrap()
    };
    let turning = Some(Hz(165.0));
    let told = read(turning, &[]);
    assert!((told.frequency.0 - 98.85).abs() < 0.02, "{}", told.frequency.0);
    let is_told = |reading: &BandReading| (reading.frequency.0 - 98.85).abs() < 0.02;
    assert!(!is_told(&read(None, &[])), "a race at rest has none");
    assert!(!is_told(&read(turning, &[(165.0, 0.5)])), "the next but one is the shaft's");
}

#[test]
fn side_bands_at_the_cages_rate_are_read_beside_a_races_line_that_stands_out() {
    let read = |depth: f64, cage_spacing: Option<Hz>| {
        let depth = spectrum_of(&[(98.9, depth), (98.9 - 11.0, 0.2), (98.9 + 11.0, 0.1)], 0.05);
        let task = LineTask { cage_spacing, ..task(&[]) };
        read_line(&of_ten_seconds(&depth), BAND, &task, &mut Vec::new()).unwrap().cage_band
    };
    let found = read(0.5, Some(Hz(11.0))).unwrap();
    assert!((found.depth - 0.2).abs() < 0.02, "{found:?}");
    assert!(read(0.5, Some(Hz(7.0))).unwrap().depth < 0.05);
    assert_eq!(read(0.5, None), None);
    assert_eq!(read(0.02, Some(Hz(11.0))), None);
}

#[test]
fn side_bands_are_read_at_the_harmonic_that_tells_the_line() {
    // 98.85 lies within 0.2 Hz of 3x: its side bands at 1x lie within that of 2x and 4x, those of 197.7 do not.
    let series = shaft_series();
    let read = |beside: [(f64, f64); 2]| {
        let own = [(98.85, 0.8), (197.7, 0.4), (329.4, 0.3)];
        let depth = spectrum_of(&[&own, &beside[..]].concat(), 0.05);
        let task = LineTask { side_band_spacing: Hz(33.0), ..task(&series) };
        read_line(&of_ten_seconds(&depth), BAND, &task, &mut Vec::new()).unwrap()
    };
    let own = read([(164.7, 0.2), (230.7, 0.15)]);
    let side = own.side_band.unwrap();
    assert!((side.depth - 0.2).abs() < 0.02, "{side:?}");
    assert_eq!(own.outdone_by, None);
    // Beside the fundamental stands what is the shaft's, or as high as its own height allows.
    assert_eq!(read([(65.85, 0.35), (131.85, 0.35)]).outdone_by, None);
    let outdone = read([(164.7, 0.7), (230.7, 0.15)]).outdone_by.unwrap();
    assert!((outdone.0 - 164.7).abs() < 0.06, "{outdone:?}");
}
