//! Sends every bearing line of the machine through the reader, band by band.

use super::absolute::AbsoluteLine;
use super::absolute::AbsoluteSpectrum;
use super::absolute::AbsoluteVibration;
use super::bands;
use super::bands::Band;
use super::bearing;
use super::bearing::BandReading;
use super::bearing::DepthSpectrum;
use super::bearing::LineSearch;
use super::bearing::LineTask;
use super::impulses;
use super::impulses::Blows;
use super::impulses::Rates;
use super::plans::Plans;
use super::reach;
use super::sets::BandLines;
use super::sets::Besides;
use super::sets::ChannelLines;
use super::sets::Sets;
use super::targets;
use super::targets::HANN_LOBE;
use super::targets::MIN_WIDTH_PER_LINE;
use super::targets::Target;
use crate::dsp::envelope;
use crate::dsp::real::floor_index;
use crate::dsp::turn_gate;
use crate::dsp::whiten;
use crate::dsp::whiten::WhitenPlan;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::sensor::Sensor;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use rustfft::num_complex::Complex;

/// Bins that stand more than this many noise levels high are discrete lines and are held there in the whitened
/// bands (20 dB): one tone then carries 1 % of a band of 1 kHz in 10 s, while impacts, a comb of a hundred lines,
/// keep their shape.
const WHITEN_CLIP: f64 = 10.0;

/// How well a speed is known that shaft harmonics or a tacho gave, relative: orders of the shafts are brought down to
/// the noise in the whitened bands as far up as this leaves them in their bins.
const SPEED_PRECISION: f64 = 2e-5;

/// Reads bearing lines at one speed.
#[derive(Debug)]
pub struct LineReader<'m> {
    machine: &'m Machine,
    first: Hz,
    /// Relative error of that speed.
    told_to: f64,
    /// Speeds the first shaft may turn at as well.
    elsewhere: Vec<Hz>,
    /// Levels of demodulation bands.
    band_levels: usize,
    scratch: Vec<f32>,
    /// Squared envelope of a band.
    e2: Vec<f32>,
    /// Blows in the whitened bands read last.
    blows: Vec<Blows>,
}

/// A channel of a search: index, rate, sample range.
type Heard = (ChannelIndex, Hz, (u64, u64));

impl<'m> LineReader<'m> {
    /// Prepares for the speed `first` of the first shaft, told to `told_to` of it.
    #[must_use]
    pub fn new(machine: &'m Machine, first: Hz, told_to: f64) -> Self {
        let band_levels = bands::LEVELS;
        Self {
            machine,
            first,
            told_to,
            elsewhere: Vec::new(),
            band_levels,
            scratch: Vec::new(),
            e2: Vec::new(),
            blows: Vec::new(),
        }
    }

    /// The same, which looks at other speeds of the first shaft, too.
    #[must_use]
    pub fn also_at(self, elsewhere: Vec<Hz>) -> Self {
        Self { elsewhere, ..self }
    }

    /// The same, which demodulates in the first so many levels of bands.
    #[must_use]
    pub fn in_levels(self, band_levels: usize) -> Self {
        Self { band_levels, ..self }
    }

    /// Reads all lines of all bearings that `sensor` listens to, in the squared envelope of its
    /// bands. `x_hat` is the spectrum of `n` samples.
    pub fn envelope_lines(
        &mut self,
        sensor: &Sensor,
        heard: Heard,
        (x_hat, n): (&[Complex<f32>], usize),
        plans: &mut Plans,
    ) -> ChannelLines {
        let (_, rate, _) = heard;
        self.blows.clear();
        let duration_s = n as f64 / rate.0;
        let usable = bands::usable_band(sensor, rate);
        let mut searches = Vec::new();
        let mut pending: Vec<(usize, Target)> = Vec::new();
        let targets = targets::of_sensor(self.machine, sensor, self.first, self.first);
        let n_here = targets.len();
        let elsewhere = self
            .elsewhere
            .iter()
            .flat_map(|first| targets::of_sensor(self.machine, sensor, self.first, *first));
        for target in targets.into_iter().chain(elsewhere) {
            let blocked = target.unreadable(usable, duration_s);
            let is_readable = blocked.is_none();
            searches.push(LineSearch {
                bearing: target.bearing,
                channel: heard.0,
                line: target.line,
                is_at_rest: target.is_at_rest,
                expected: target.expected,
                band: target.band,
                shaft_speed: target.shaft_speed,
                side_band_spacing: target.side_band_spacing,
                resolution: Hz(HANN_LOBE / duration_s),
                sample_range: heard.2,
                outcome: blocked.map_or(Ok(Vec::new()), Err),
                covered: Vec::new(),
                coincides: target.coincides(duration_s),
                octaves: Vec::new(),
            });
            if is_readable {
                pending.push((searches.len() - 1, target));
            }
        }
        let besides = if pending.is_empty() {
            Besides::default()
        } else {
            self.read_bands((x_hat, n, rate), usable, (&pending, n_here), &mut searches, plans)
        };
        // As many at each speed: what there is to look for does not depend on it.
        let others = searches.split_off(n_here);
        let elsewhere = others.chunks(n_here.max(1)).map(<[LineSearch]>::to_vec).collect();
        let Besides { lower, between } = besides;
        ChannelLines { here: searches, lower, between, elsewhere }
    }

    /// Blows in the whitened bands of the channel read last.
    #[must_use]
    pub fn blows(&self) -> &[Blows] {
        &self.blows
    }

    /// Demodulates band by band and reads every pending line in each; what else there is of the first `n_here` searches.
    fn read_bands(
        &mut self,
        (x_hat, n, rate): (&[Complex<f32>], usize, Hz),
        usable: (Hz, Hz),
        (pending, n_here): (&[(usize, Target)], usize),
        searches: &mut [LineSearch],
        plans: &mut Plans,
    ) -> Besides {
        let duration_s = n as f64 / rate.0;
        let shafts = self.shaft_speeds();
        let whitened = self.whitened((x_hat, n), duration_s, &shafts);
        let ranges = pending.iter().map(|(_, t)| reach::searched_range(t.line, t.expected, t.band));
        let lines: Vec<(Hz, Hz)> = ranges.collect();
        let is_own = |speed: &Hz| pending.iter().any(|(_, target)| target.shaft_speed == *speed);
        let (own, others): (Vec<Hz>, Vec<Hz>) = shafts.into_iter().partition(is_own);
        let rates = Rates { own_shafts: &own, other_shafts: &others, lines: &lines };
        let sets = self.sets(usable, pending);
        let (mut depth, mut read) = (Vec::new(), Vec::new());
        for band in sets.distinct() {
            let source = if band.whitened { &whitened[..] } else { x_hat };
            let Some((bin_hz, mean_square)) =
                self.depth_spectrum(source, (n, rate), band, (&mut depth, plans))
            else {
                continue;
            };
            let bins = envelope::bins_of_band(n, rate.0, band.low.0, band.high.0);
            let n_bins = bins.as_ref().map_or(0, std::ops::Range::len);
            let tone = bins.and_then(|b| bearing::leading_tone(source, b, 1.0 / duration_s));
            let spectrum = DepthSpectrum { depth: &depth, bin_hz, duration_s, mean_square, tone };
            let (is_whole, is_for_all) = (sets.whole.contains(&band), sets.is_for_all(&band));
            if band.whitened && is_whole {
                let blows =
                    impulses::read(&self.e2, &spectrum, (band, n_bins), rates, &mut self.scratch);
                self.blows.push(blows);
            }
            let readings = pending.iter().map(|(place, target)| {
                let task = target.task(duration_s, self.told_to);
                if is_whole {
                    let covered = bearing::read_covered(&spectrum, band, &task, &mut self.scratch);
                    searches[*place].covered.extend(covered);
                }
                let is_asked = is_for_all || *place < n_here;
                let mut read = || bearing::read_line(&spectrum, band, &task, &mut self.scratch);
                if is_asked { read() } else { None }
            });
            let readings: Vec<Option<BandReading>> = readings.collect();
            let hidden = |(line, (place, target)): (usize, &(usize, Target))| {
                let is_hidden = readings[line].as_ref().is_some_and(BandReading::is_under_events);
                let is_turning = target.sum_of_races.is_some();
                (is_whole && *place < n_here && is_turning && is_hidden).then_some(line)
            };
            let hidden: Vec<usize> = pending.iter().enumerate().filter_map(hidden).collect();
            let between =
                self.between_events((band, bin_hz, tone), (pending, &hidden), duration_s, plans);
            read.push(BandLines { band, read: readings, between });
        }
        sets.hand_out(&read, (pending, n_here), searches)
    }

    /// What is read of the `hidden` lines of races that turn in the band demodulated last, the loudest eighth of the turn left out (F31).
    fn between_events(
        &mut self,
        (band, bin_hz, tone): (Band, f64, Option<Hz>),
        (pending, hidden): (&[(usize, Target)], &[usize]),
        duration_s: f64,
        plans: &mut Plans,
    ) -> Vec<(usize, BandReading)> {
        let mut found = Vec::new();
        let (mut e2, mut depth) = (Vec::new(), Vec::new());
        let mut at: Option<(Hz, Option<f64>)> = None;
        for line in hidden {
            let (_, target) = &pending[*line];
            // Lines of one shaft follow one another.
            if at.is_none_or(|(speed, _)| speed != target.shaft_speed) {
                e2.clone_from(&self.e2);
                let turns_per_sample = target.shaft_speed.0 * duration_s / e2.len() as f64;
                let mean_square =
                    turn_gate::leave_out_loudest(&mut e2, turns_per_sample).then(|| {
                        let plan = plans.envelope_spectrum(e2.len());
                        depth.resize(plan.n_bins(), 0.0);
                        plan.process(&e2, &mut depth)
                    });
                at = Some((target.shaft_speed, mean_square.flatten()));
            }
            let Some(mean_square) = at.and_then(|(_, mean_square)| mean_square) else { continue };
            let spectrum = DepthSpectrum { depth: &depth, bin_hz, duration_s, mean_square, tone };
            let task = target.task(duration_s, self.told_to);
            let reading = bearing::read_line(&spectrum, band, &task, &mut self.scratch);
            found.extend(reading.map(|reading| (*line, reading)));
        }
        found
    }

    /// The bands in which the pending lines are read.
    fn sets(&self, usable: (Hz, Hz), pending: &[(usize, Target)]) -> Sets {
        let fastest = |(_, t): &(usize, Target)| t.expected.0 * (1.0 + t.band.high);
        let fastest = Hz(pending.iter().map(fastest).fold(0.0, f64::max));
        let min_width = Hz(fastest.0 * MIN_WIDTH_PER_LINE);
        Sets {
            whole: bands::demodulation_bands(usable, min_width, self.band_levels),
            octaves: bands::octaves_of_lowest(usable, fastest, self.band_levels),
            lower: bands::lower_sets(usable, fastest, self.band_levels),
        }
    }

    /// The spectrum of `n` samples after whitening, the orders of the shafts brought down to the noise.
    fn whitened(
        &self,
        (x_hat, n): (&[Complex<f32>], usize),
        duration_s: f64,
        shafts: &[Hz],
    ) -> Vec<Complex<f32>> {
        let mut whitened = vec![Complex::default(); x_hat.len()];
        let half_width = floor_index(self.first.0.max(10.0 / duration_s) * duration_s / 2.0);
        WhitenPlan::new(n, half_width, WHITEN_CLIP).process(x_hat, &mut whitened);
        for speed in shafts {
            whiten::limit_multiples(&mut whitened, n, speed.0 * duration_s, SPEED_PRECISION);
        }
        whitened
    }

    /// Speeds of all shafts that are known, each once.
    fn shaft_speeds(&self) -> Vec<Hz> {
        let shafts = (0..self.machine.shafts.len()).map(ShaftIndex);
        let known = shafts.filter_map(|shaft| self.machine.shaft_speed(shaft, self.first));
        let mut speeds: Vec<Hz> = known.filter(|speed| speed.0 > 0.0).collect();
        speeds.sort_by(|a, b| a.0.total_cmp(&b.0));
        speeds.dedup();
        speeds
    }

    /// Highest frequency at which a bearing's or mesh's line is read: decides about oversampling.
    #[must_use]
    pub fn top(&self) -> Hz {
        let bearings = self.machine.bearings.iter().filter_map(|bearing| {
            let speed = self.machine.shaft_speed(bearing.shaft, self.first)?;
            let fastest = bearing.fault_rates(speed)?.bpfi.0 * (1.0 + bearing.bands.bpfi.high);
            Some(fastest * bearing::N_HARMONICS as f64)
        });
        let gears = self.machine.gears.iter().filter_map(|gear| {
            let speed = self.machine.shaft_speed(gear.driving.shaft, self.first)?;
            Some(gear.mesh_frequency(speed).0)
        });
        Hz(bearings.chain(gears).fold(0.0, f64::max))
    }

    /// Reads the lines of the pair's bearing in its absolute vibration `a`.
    pub fn absolute_lines(
        &mut self,
        sensor: &Sensor,
        (pair, rate, range): ((ChannelIndex, ChannelIndex), Hz, (u64, u64)),
        a: &AbsoluteVibration,
        scale: f64,
        plans: &mut Plans,
    ) -> Vec<AbsoluteLine> {
        let duration_s = a.samples.len() as f64 / a.sample_rate.0;
        let Some(spectrum) = AbsoluteSpectrum::new(a, scale, plans) else {
            return Vec::new();
        };
        let usable = bands::usable_band(sensor, rate);
        let mut found = Vec::new();
        for target in targets::of_sensor(self.machine, sensor, self.first, self.first) {
            if target.unreadable(usable, duration_s).is_some()
                || target.coincides(duration_s).is_some()
            {
                continue;
            }
            // The amplitude itself holds the elements' own smooth motion, which may stand against their modulation.
            let task = LineTask { sum_of_races: None, ..target.task(duration_s, self.told_to) };
            if let Some((reading, amplitude, floor)) = spectrum.read(&task, &mut self.scratch) {
                found.push(AbsoluteLine {
                    bearing: target.bearing,
                    pair,
                    line: target.line,
                    expected: target.expected,
                    amplitude,
                    floor,
                    reading,
                    sample_range: range,
                });
            }
        }
        found
    }

    /// Modulation-depth spectrum of one band, written into `depth`: bin spacing, mean of the squared envelope.
    fn depth_spectrum(
        &mut self,
        x_hat: &[Complex<f32>],
        (n, rate): (usize, Hz),
        band: Band,
        (depth, plans): (&mut Vec<f32>, &mut Plans),
    ) -> Option<(f64, f64)> {
        let bins = envelope::bins_of_band(n, rate.0, band.low.0, band.high.0)?;
        let bins = bins.start.max(1)..bins.end;
        if bins.is_empty() {
            return None;
        }
        let squared = plans.squared_envelope(n, bins);
        let (length, e2_rate_hz) = (squared.out_len(), squared.out_rate_hz(rate.0));
        self.e2.resize(length, 0.0);
        squared.process(x_hat, &mut self.e2);
        let plan = plans.envelope_spectrum(length);
        depth.resize(plan.n_bins(), 0.0);
        let mean_square = plan.process(&self.e2, depth)?;
        Some((plan.bin_width_hz(e2_rate_hz), mean_square))
    }
}

#[cfg(test)]
#[path = "lines_tests.rs"]
mod tests;
