//! Rare outbursts: a lost bit, a plug that is touched, something dropped on the floor. Squared, as envelopes are, one drowns all that
//! repeats; nothing in it does, so it is set aside and told of (docs/theory.md, F29). Must not know what is read in the rest.

use super::ChannelWindow;
use super::Window;
use super::sensor;
use super::sensor::SensorReading;
use super::speed::REFINE_RANGE;
use crate::dsp::real::Real;
use crate::dsp::real::ceil_index;
use crate::dsp::stats;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use std::ops::Range;

/// Length of the blocks whose energies are compared, s, and samples in one at least.
const BLOCK_S: f64 = 2e-3;
const FEWEST_SAMPLES: usize = 16;

/// Blocks from which their median tells what is usual.
const FEWEST_BLOCKS: usize = 100;

/// Energy over the median from which a block is of an outburst (10 dB).
const OVER_MEDIAN: f64 = 10.0;

/// Most outbursts of a window that are rare: what turns comes once in each of the twelve revolutions that accuse, and what a cage carries
/// in four of ten.
const MOST: usize = 4;

/// Energy of the least of them over that of whatever else is strongest (10 dB): what has one cause differs by less.
const APART: f64 = 10.0;

/// Part of the summed squares of all energies from which they drown the rest: half of what the spectrum of a squared envelope is made of.
const DROWNS: f64 = 0.5;

/// Part of the window that they may take: longer ones are another state of the machine.
const LONGEST: f64 = 0.02;

/// Part of its energy that one sample holds of an outburst that is no motion: what moves takes the samples beside it along.
const LOST: f64 = 0.9;

/// Single samples far off that are counted by the converter's clock: at least this many, and this part of all of them, a whole number of
/// samples apart throughout. Of a thousand strikes at a steady rate that is true by chance of one rate in five hundred, and machines slip.
const FEWEST_CLOCKED: usize = 8;
const CLOCKED: f64 = 0.9;

/// A channel without its outbursts.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Quiet {
    /// Its place in the stream.
    channel: ChannelIndex,
    /// All its samples, straight lines in place of the outbursts.
    samples: Vec<f32>,
    /// Whether single samples were all there was: no vibration, so that levels leave them out, too.
    pub(super) is_of_lost_samples: bool,
}

/// The channels of accelerometers and velocity sensors that had outbursts, without them. What was set aside is told of in the sensor's reading.
///
/// `first`: speed of the first shaft, as far as it is stated.
pub(super) fn set_aside(
    (machine, first): (&Machine, Option<Hz>),
    channels: &[ChannelInfo],
    window: &Window<'_>,
    sensors: &mut [SensorReading],
) -> Vec<Quiet> {
    let mut quiet = Vec::new();
    let shafts = (0..machine.shafts.len()).map(ShaftIndex);
    let speeds: Vec<Hz> = shafts.filter_map(|shaft| machine.shaft_speed(shaft, first?)).collect();
    for reading in sensors.iter_mut().filter(|r| r.flaw.is_none() && r.absent.is_none()) {
        let hears = matches!(
            machine.sensors[reading.sensor].kind,
            SensorKind::Accelerometer | SensorKind::Velocity
        );
        let run = window.channels.get(reading.channel.0).copied().flatten();
        let Some(run) = run.filter(|_| hears) else { continue };
        let rate = channels[reading.channel.0].sample_rate;
        let found = match clocked(run.samples, rate, &speeds) {
            clocked if clocked.is_empty() => find(run.samples, rate),
            clocked => clocked,
        };
        if found.is_empty() {
            continue;
        }
        let is_of_lost_samples =
            found.iter().all(|range| is_lost_sample(&run.samples[range.clone()]));
        reading.doubts.push(told(&found, is_of_lost_samples, run, rate));
        if is_of_lost_samples {
            // Levels leave them out, too; a knock counts in those.
            let first = reading.sample_range.0;
            reading.lost = found.iter().cloned().flatten().map(|at| first + at as u64).collect();
        }
        let mut samples = run.samples.to_vec();
        found.into_iter().for_each(|range| bridge(&mut samples, range));
        quiet.push(Quiet { channel: reading.channel, samples, is_of_lost_samples });
    }
    quiet
}

/// The samples of a channel without its outbursts, if it had any.
pub(super) fn of<'q>(
    quiet: &'q [Quiet],
    channel: ChannelIndex,
    run: ChannelWindow<'q>,
) -> (ChannelWindow<'q>, Option<&'q Quiet>) {
    let own = quiet.iter().find(|q| q.channel == channel);
    let samples = own.map_or(run.samples, |q| &q.samples);
    (ChannelWindow { samples, ..run }, own)
}

/// What was set aside, in words.
fn told(
    found: &[Range<usize>],
    is_of_lost_samples: bool,
    run: ChannelWindow<'_>,
    rate: Hz,
) -> String {
    let at = |range: &Range<usize>| format!("{:.3} s", run.time_s + range.start as f64 / rate.0);
    let what = match (is_of_lost_samples, found.len()) {
        (true, 1) => "one sample far off".to_owned(),
        (true, n) => format!("{n} single samples far off"),
        (false, 1) => "one outburst".to_owned(),
        (false, n) => format!("{n} outbursts"),
    };
    if found.len() > MOST {
        let first = found.first().map_or_else(String::new, at);
        return format!(
            "{what}, a whole number of samples apart, the first at {first}: by the clock of what sampled them, so that they were set aside; \
             look at buffers and plugs"
        );
    }
    let places: Vec<String> = found.iter().map(at).collect();
    let n: usize = found.iter().map(Range::len).sum();
    format!(
        "{what}, at {}, so strong as to hide what repeats, and too few to repeat: {n} samples were set aside",
        places.join(", ")
    )
}

/// Where the outbursts of a record are, in order of time; none unless they are rare and drown the rest.
fn find(x: &[f32], rate: Hz) -> Vec<Range<usize>> {
    let length = ceil_index(BLOCK_S * rate.0).max(FEWEST_SAMPLES);
    let energies = energies(x, length);
    let mut sorted: Vec<f32> = energies.iter().map(|e| f32::rounded(*e)).collect();
    let median = stats::median(&mut sorted).map_or(0.0, f64::from);
    if energies.len() < FEWEST_BLOCKS || median <= 0.0 {
        return Vec::new();
    }
    let mut events = runs(&energies, OVER_MEDIAN * median);
    let peak = |run: &Range<usize>| energies[run.clone()].iter().copied().fold(0.0, f64::max);
    events.sort_by(|a, b| peak(b).total_cmp(&peak(a)));
    let squares = |of: &[f64]| of.iter().map(|e| e * e).sum::<f64>();
    let whole = squares(&energies);
    let drown = |n: usize| {
        let next = events.get(n).map_or(OVER_MEDIAN * median, &peak);
        let held: f64 = events[..n].iter().map(|run| squares(&energies[run.clone()])).sum();
        peak(&events[n - 1]) >= APART * next && held >= DROWNS * whole
    };
    let Some(n) = (1..=MOST.min(events.len())).find(|n| drown(*n)) else { return Vec::new() };
    // The blocks beside them hold their beginnings and ends.
    let widened = |run: &Range<usize>| {
        run.start.saturating_sub(1) * length..((run.end + 1) * length).min(x.len())
    };
    let mut found: Vec<Range<usize>> = events[..n].iter().map(widened).collect();
    found.sort_by_key(|range| range.start);
    let taken: usize = found.iter().map(Range::len).sum();
    if taken as f64 > LONGEST * x.len() as f64 { Vec::new() } else { found }
}

/// Every sample of the phase that single samples far off keep, at one distance in samples through the whole record: buffers' edges, lost words,
/// and nothing that moves.
///
/// Not once a turn of a shaft, of the `speeds`: a rig may be driven, and is simulated, by the clock that samples it.
fn clocked(x: &[f32], rate: Hz, speeds: &[Hz]) -> Vec<Range<usize>> {
    let places: Vec<usize> = sensor::spikes(x).into_iter().map(|(at, _)| at).collect();
    if places.len() < FEWEST_CLOCKED {
        return Vec::new();
    }
    // Some of them are lost beside what vibrates: the distance that is most frequent, and the phase that most of them keep.
    let gaps = places.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let Some((period, _)) = most_frequent(gaps) else { return Vec::new() };
    let clock_hz = rate.0 / period as f64;
    if speeds.iter().any(|speed| (clock_hz / speed.0 - 1.0).abs() <= REFINE_RANGE) {
        return Vec::new();
    }
    let phases = places.iter().map(|at| at % period).collect();
    // Blows that ring at a part of the sampling rate are at its beat a few samples long.
    let is_throughout = 2 * places.len() * period >= x.len();
    match most_frequent(phases) {
        Some((phase, n)) if is_throughout && n as f64 >= CLOCKED * places.len() as f64 => {
            (phase..x.len()).step_by(period).map(|at| at..at + 1).collect()
        }
        Some(_) | None => Vec::new(),
    }
}

/// The value that occurs most often, and how often.
fn most_frequent(mut values: Vec<usize>) -> Option<(usize, usize)> {
    values.sort_unstable();
    let runs = values.chunk_by(|a, b| a == b).map(|run| (run[0], run.len()));
    runs.max_by_key(|(_, n)| *n)
}

/// Energies of blocks of this length about the mean of all, the last one shorter.
fn energies(x: &[f32], length: usize) -> Vec<f64> {
    let mean = x.iter().map(|v| f64::from(*v)).sum::<f64>() / x.len().max(1) as f64;
    let energy = |block: &[f32]| block.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum();
    x.chunks(length).map(energy).collect()
}

/// Runs of values above `limit`.
fn runs(values: &[f64], limit: f64) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (i, value) in values.iter().enumerate() {
        match runs.last_mut() {
            _ if *value <= limit => {}
            Some(last) if last.end == i => last.end += 1,
            Some(_) | None => runs.push(i..i + 1),
        }
    }
    runs
}

/// Whether one sample holds nearly all of what a stretch deviates from its median.
fn is_lost_sample(x: &[f32]) -> bool {
    if x.len() == 1 {
        return true;
    }
    let Some(median) = stats::median(&mut x.to_vec()) else { return false };
    let squares = || x.iter().map(|v| (f64::from(*v) - f64::from(median)).powi(2));
    squares().fold(0.0, f64::max) >= LOST * squares().sum::<f64>()
}

/// Puts a straight line in place of a stretch, from what is beside it.
fn bridge(x: &mut [f32], range: Range<usize>) {
    let beside = |at: Option<usize>| at.and_then(|i| x.get(i)).copied();
    let (before, after) = (beside(range.start.checked_sub(1)), beside(Some(range.end)));
    let (Some(from), Some(to)) = (before.or(after), after.or(before)) else { return };
    let n = range.len() as f64;
    for (i, value) in x[range].iter_mut().enumerate() {
        let part = (i as f64 + 1.0) / (n + 1.0);
        *value = f32::rounded(f64::from(from) * (1.0 - part) + f64::from(to) * part);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;

    const RATE: Hz = Hz(12_000.0);

    /// Ten seconds of noise of RMS 1.
    fn noise(seed: u64) -> Vec<f32> {
        gaussian_noise(120_000, seed).into_iter().map(f32::rounded).collect()
    }

    /// The same, struck so hard so often at even distances: each blow rings for some milliseconds.
    fn struck(n_blows: usize, height: f32) -> Vec<f32> {
        let mut x = noise(7);
        for blow in 0..n_blows {
            let at = (2 * blow + 1) * x.len() / (2 * n_blows);
            for i in 0..120 {
                let t = i as f32 / 12_000.0;
                x[at + i] += height * (-t / 2e-3).exp() * (TAU * 2500.0 * t).sin();
            }
        }
        x
    }

    const TAU: f32 = std::f32::consts::TAU;

    #[test]
    fn one_sample_and_one_knock_are_set_aside_and_what_repeats_is_not() {
        let mut x = noise(3);
        x[70_000] = 200.0;
        let found = find(&x, RATE);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains(&70_000) && found[0].len() <= 72, "{found:?}");
        assert!(is_lost_sample(&x[found[0].clone()]));
        let before = x.clone();
        bridge(&mut x, found[0].clone());
        let outside = |i: &usize| !found[0].contains(i);
        assert!((0..x.len()).filter(outside).all(|i| x[i].to_bits() == before[i].to_bits()));
        assert!(find(&x, RATE).is_empty());
        let knocked = struck(1, 200.0);
        let found = find(&knocked, RATE);
        assert!(found.len() == 1 && !is_lost_sample(&knocked[found[0].clone()]), "{found:?}");
        assert_eq!(find(&struck(MOST, 200.0), RATE).len(), MOST);
        assert!(find(&struck(MOST + 1, 200.0), RATE).is_empty(), "often enough to repeat");
        assert!(find(&struck(1, 10.0), RATE).is_empty(), "drowns nothing");
    }

    #[test]
    fn single_samples_by_the_converters_clock_are_set_aside() {
        let every = |distance: f64| {
            let mut x = noise(11);
            let mut at = 40.0;
            while at < x.len() as f64 {
                x[crate::dsp::real::floor_index(at)] += 30.0;
                at += distance;
            }
            clocked(&x, RATE, &[])
        };
        let found = every(76.0);
        assert!(found.len() > 1500 && found[3] == (268..269), "{}", found.len());
        assert!(every(76.013).is_empty(), "a rate of the machine's");
        assert!(clocked(&noise(11), RATE, &[]).is_empty());
        let once_a_turn = |speed_hz: f64| {
            let mut x = noise(11);
            x.iter_mut().skip(40).step_by(1200).for_each(|v| *v += 30.0);
            clocked(&x, RATE, &[Hz(3.0), Hz(speed_hz)])
        };
        assert!(once_a_turn(10.1).is_empty(), "a shaft's strikes");
        assert_eq!(once_a_turn(12.0).len(), 100);
        // Five samples of each strike, twenty apart: not throughout.
        let mut x = noise(11);
        for strike in (40..x.len() - 100).step_by(1200) {
            x[strike..strike + 100].iter_mut().step_by(20).for_each(|v| *v += 30.0);
        }
        assert!(clocked(&x, RATE, &[]).is_empty());
    }

    #[test]
    fn the_strongest_of_a_family_is_no_outburst() {
        // Eight blows one of which is three times as high (9.5 dB), or ten times.
        let with = |times: f32| {
            let mut x = struck(8, 60.0);
            let at = 120_000 / 16;
            x[at..at + 120].iter_mut().for_each(|v| *v *= times);
            find(&x, RATE).len()
        };
        assert_eq!((with(3.0), with(10.0)), (0, 1));
    }

    #[test]
    fn a_long_burst_or_a_silent_record_is_left_as_it_is() {
        let mut x = noise(5);
        x[50_000..54_000].iter_mut().for_each(|v| *v *= 100.0);
        assert!(find(&x, RATE).is_empty(), "a third of a second of ten");
        assert!(find(&vec![0.0; 120_000], RATE).is_empty());
        assert!(find(&[], RATE).is_empty() && find(&[1.0; 50], RATE).is_empty());
    }
}
