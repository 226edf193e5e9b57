//! Tests of one line weighed over the bands.

use super::*;
use crate::features::bands::Band;
use crate::features::bearing::Harmonic;
use crate::features::bearing::Searched;
use crate::machine::BearingIndex;
use crate::machine::uncertainty::RelativeBand;
use crate::signal::ChannelIndex;

/// A line read in eight bands, of this depth in the first `n_deep`, lost in noise in the others.
fn search(line: DefectLine, n_deep: u32, depth: f64) -> LineSearch {
    let reading = |i: u32| {
        let (power_ratio, depth) = if i < n_deep { (900.0, depth) } else { (1.0, 0.01) };
        let harmonic =
            Harmonic { power_ratio, depth, floor_dof: 100.0, searched: Searched::peaks(60.0) };
        let band = Band { low: Hz(0.0), high: Hz(5e3), whitened: false };
        BandReading::of_test(band, Hz(150.0), &[harmonic; 2])
    };
    LineSearch {
        bearing: BearingIndex(0),
        channel: ChannelIndex(0),
        line,
        is_at_rest: line == DefectLine::Bpfo,
        expected: Hz(150.0),
        band: RelativeBand::default(),
        shaft_speed: Hz(30.0),
        side_band_spacing: Hz(30.0),
        resolution: Hz(0.2),
        sample_range: (0, 1),
        outcome: Ok((0..8).map(reading).collect()),
        covered: Vec::new(),
        coincides: None,
        octaves: Vec::new(),
    }
}

/// Whether it is proven, and in most bands; its probability.
fn weighed(line: DefectLine, n_deep: u32, depth: f64) -> (bool, bool, f64) {
    let search = search(line, n_deep, depth);
    let candidate = Candidate::weigh(&search, &[], 4.0);
    (candidate.is_proven(), candidate.is_broad(), candidate.probability())
}

/// A line in the whole band, its halves and quarters, with this power in the lowest quarter and in the third.
fn in_quarters(lowest: f64, third: f64) -> LineSearch {
    let mut search = search(DefectLine::Bpfo, 8, 0.5);
    let bands =
        [(0.0, 4e3), (0.0, 2e3), (2e3, 4e3), (0.0, 1e3), (1e3, 2e3), (2e3, 3e3), (3e3, 4e3)];
    let readings = search.outcome.as_mut().unwrap();
    readings.truncate(bands.len());
    for (reading, (low, high)) in readings.iter_mut().zip(bands) {
        reading.band = Band { low: Hz(low), high: Hz(high), whitened: false };
        let within = |at: f64, power: f64| if low <= at && at < high { power } else { 0.0 };
        reading.mean_square = within(500.0, lowest) + within(2500.0, third);
    }
    search
}

#[test]
fn what_dies_out_upwards_is_a_smooth_motion() {
    // 12 dB an octave are 28 dB from the middle of the lowest quarter to that of the third: halfway are 14 dB.
    let (low, high) = (in_quarters(1.0, 0.02), in_quarters(1.0, 0.06));
    let of = |search: &LineSearch| is_smooth(&[Candidate::weigh_all(search, &[], 1.0)]);
    assert!(of(&low) && !of(&high), "17 and 12 dB below");
    // To that of the second they are 19 dB.
    let in_second = |power: f64| {
        let mut second = in_quarters(1.0, 0.0);
        for reading in second.outcome.iter_mut().flatten().filter(|r| r.band.low.0 >= 1e3) {
            let holds = reading.band.low.0 < 1500.0 && reading.band.high.0 <= 2e3;
            reading.mean_square = if holds { power } else { 0.0 };
        }
        second
    };
    assert!(of(&in_second(0.06)) && !of(&in_second(0.12)), "12 and 9 dB below");
    // In the band of a sensor that begins above the motion as much is asked as there.
    let shifted = |power: f64| {
        let mut search = in_second(power);
        for reading in search.outcome.iter_mut().flatten() {
            let band = reading.band;
            let (low, high) = (Hz(band.low.0 + 5e3), Hz(band.high.0 + 5e3));
            reading.band = Band { low, high, ..band };
        }
        search
    };
    assert!(of(&shifted(0.06)) && !of(&shifted(0.12)), "12 and 9 dB below");
    // Far up no less is enough than in the fourth quarter.
    let far = |power: f64| {
        let mut search = in_quarters(1.0, power);
        let quarter = search.outcome.as_ref().unwrap()[0].clone();
        let band = Band { low: Hz(0.0), high: Hz(100.0), whitened: false };
        search.octaves = vec![BandReading { band, ..quarter }];
        search
    };
    assert!(of(&far(0.015)) && !of(&far(0.025)), "18 and 16 dB below");
    // A second channel counts with its power: what shakes the whole machine is smooth though one sensor rings.
    let strong = in_quarters(10.0, 0.02);
    let both = [&strong, &high].map(|s| Candidate::weigh_all(s, &[], 1.0));
    assert!(is_smooth(&both));
    // Where the lowest quarter is wide, what rings in its upper octave rings.
    let mut fast = in_quarters(1.0, 0.005);
    let quarter = fast.outcome.as_ref().unwrap()[0].clone();
    let octave = |low: f64, high: f64, power: f64| {
        let band = Band { low: Hz(low), high: Hz(high), whitened: false };
        BandReading { band, mean_square: power, ..quarter.clone() }
    };
    fast.octaves = vec![octave(0.0, 500.0, 0.7), octave(500.0, 1e3, 0.3)];
    assert!(!of(&fast));
    fast.octaves[1].mean_square = 0.05;
    assert!(of(&fast));
    // One band alone tells nothing.
    assert!(!of(&search(DefectLine::Bpfo, 8, 0.5)));
}

#[test]
fn a_race_that_most_bands_show_with_all_harmonics_need_be_deep_in_one_alone() {
    // D = 0.8 in one band of eight and 0.3 in the others.
    let in_bands = |line: DefectLine, n_whole: usize, power_ratio: f64| {
        let mut search = search(line, 8, 0.5);
        for (i, reading) in search.outcome.iter_mut().flatten().enumerate() {
            let height = if i == 0 { 0.4 } else { 0.15 };
            let own = |h| Harmonic { depth: height, power_ratio, ..h };
            let harmonic = reading.harmonics[0].map(own);
            reading.harmonics = [harmonic; bearing::N_HARMONICS];
            if i >= n_whole {
                reading.harmonics[2] = None;
            }
        }
        let candidate = Candidate::weigh(&search, &[], 4.0);
        assert!(candidate.is_proven() && candidate.agreed_depth < 0.31);
        candidate.is_agreed()
    };
    assert!(in_bands(DefectLine::Bpfi, 5, 900.0) && !in_bands(DefectLine::Bpfi, 4, 900.0));
    assert!(in_bands(DefectLine::Bpfo, 5, 900.0) && !in_bands(DefectLine::TwoBsf, 8, 900.0));
    // 0.15²·B·T is 1125: of as much and more without noise, sound elements that pass have it.
    assert!(in_bands(DefectLine::Bpfi, 8, 1e4) && !in_bands(DefectLine::Bpfo, 8, 1e4));
}

#[test]
fn noise_in_the_bands_hides_no_agreement_of_a_race_that_turns() {
    // D = 0.57 in one band of eight and 0.28 in the others, without all harmonics. Noise alone leaves 6/(B·T) of a floor.
    let agreed = |line: DefectLine, floor: f64, has_side_band: bool| {
        let mut search = search(line, 8, 0.5);
        let duration_s = search.duration_s();
        for (i, reading) in search.outcome.iter_mut().flatten().enumerate() {
            let cells = (reading.band.high.0 - reading.band.low.0) * duration_s;
            let depth = if i == 0 { 0.4 } else { 0.2 };
            let own =
                |h| Harmonic { depth, power_ratio: depth * depth * cells / (6.0 * floor), ..h };
            let harmonic = reading.harmonics[0].map(own);
            reading.harmonics = [harmonic, harmonic, None, None];
            reading.side_band = harmonic.filter(|_| has_side_band);
        }
        let candidate = Candidate::weigh(&search, &[], 4.0);
        assert!(candidate.is_broad() && candidate.agreed_depth < 0.3, "{line:?} {floor}");
        candidate.is_agreed()
    };
    // Three quarters of the floor of noise are left where half of the energy is noise's, a third where a fifth is.
    assert!(agreed(DefectLine::Bpfi, 0.75, true));
    assert!(!agreed(DefectLine::Bpfi, 0.36, true));
    // Of what strikes at no rate nothing is known.
    assert!(!agreed(DefectLine::Bpfi, 2.0, true));
    // Sound elements that pass make the other lines, and those without side bands.
    assert!(!agreed(DefectLine::Bpfi, 0.75, false));
    assert!(!agreed(DefectLine::Bpfo, 0.75, true));
}

#[test]
fn what_strikes_at_no_rate_is_told_from_noise_by_the_band_around() {
    // D = 0.64 in a quarter of the usable band on a floor of 0.97 of noise's; around it on this.
    let agreed = |around: f64| {
        let mut search = in_quarters(1.0, 1.0);
        let duration_s = search.duration_s();
        for (i, reading) in search.outcome.iter_mut().flatten().enumerate() {
            let cells = (reading.band.high.0 - reading.band.low.0) * duration_s;
            let (depth, floor) = match i {
                5 => (0.45, 0.97),
                0 | 2 => (0.25, around),
                _ => (0.2, 0.5),
            };
            let own =
                |h| Harmonic { depth, power_ratio: depth * depth * cells / (6.0 * floor), ..h };
            let harmonic = reading.harmonics[0].map(own);
            reading.harmonics = [harmonic, harmonic, None, None];
            reading.side_band = harmonic;
        }
        search.line = DefectLine::Bpfi;
        search.is_at_rest = false;
        let candidate = Candidate::weigh(&search, &[], 4.0);
        assert!(candidate.is_broad() && candidate.agreed_depth < 0.4, "{around}");
        candidate.is_agreed()
    };
    assert!(agreed(0.97));
    // Twice as wide and the same depth of the floor, where noise would leave half: no noise.
    assert!(!agreed(1.94));
}

#[test]
fn a_harmonic_that_another_line_explains_adds_nothing() {
    let weak = search(DefectLine::Bpfo, 8, 0.4);
    let alone = Candidate::weigh(&weak, &[], 4.0);
    // 150 and 300 Hz: a line at 200 Hz with side bands at 100 Hz stands on the second harmonic.
    let other = Accepted {
        frequency: Hz(200.0),
        spacing: Hz(100.0),
        heard: (ChannelIndex(0), 1.0),
        rivals: Vec::new(),
        owners: Vec::new(),
    };
    let beside = Candidate::weigh(&weak, &[other], 4.0);
    assert!(alone.is_proven() && alone.depth() > 0.56);
    assert!(!beside.is_proven(), "a fundamental without harmonics");
}

#[test]
fn a_line_proven_in_few_bands_has_the_probability_of_those() {
    // Two harmonics of equal depth: D = √2·depth.
    let (proven, broad, p) = weighed(DefectLine::Bpfo, 4, 0.5);
    assert!(proven && broad && p < 1e-6, "half of the bands: {p}");
    let (proven, broad, p) = weighed(DefectLine::Bpfo, 2, 0.8);
    assert!(proven && !broad && p < 1e-6, "a quarter, D = 1.13: {p}");
    let (proven, _, p) = weighed(DefectLine::Bpfo, 2, 0.6);
    assert!(!proven && p > 0.5, "a quarter, D = 0.85: {p}");
    assert!(!weighed(DefectLine::Bpfo, 1, 0.8).0, "one of eight");
    assert!(!weighed(DefectLine::Ftf, 2, 0.8).0, "a cage strikes nothing");
}
