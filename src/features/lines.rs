//! Sends every bearing line of the machine through the reader, band by band.

use super::absolute::AbsoluteLine;
use super::absolute::AbsoluteSpectrum;
use super::absolute::AbsoluteVibration;
use super::bands;
use super::bands::Band;
use super::bearing;
use super::bearing::DepthSpectrum;
use super::bearing::LineSearch;
use super::bearing::LineTask;
use super::impulses;
use super::impulses::Blows;
use super::impulses::Rates;
use super::plans::Plans;
use super::reach;
use super::targets;
use super::targets::HANN_LOBE;
use super::targets::MIN_WIDTH_PER_LINE;
use super::targets::Target;
use crate::dsp::envelope;
use crate::dsp::real::floor_index;
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
    /// Prepares for the speed `first` of the first shaft.
    #[must_use]
    pub fn new(machine: &'m Machine, first: Hz) -> Self {
        let band_levels = bands::LEVELS;
        Self {
            machine,
            first,
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
    /// bands: at the speed, and at each of the others. `x_hat` is the spectrum of `n` samples.
    pub fn envelope_lines(
        &mut self,
        sensor: &Sensor,
        heard: Heard,
        x_hat: &[Complex<f32>],
        n: usize,
        plans: &mut Plans,
    ) -> (Vec<LineSearch>, Vec<Vec<LineSearch>>) {
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
        if !pending.is_empty() {
            self.read_bands((x_hat, n, rate), usable, &pending, &mut searches, plans);
        }
        // As many at each speed: what there is to look for does not depend on it.
        let others = searches.split_off(n_here);
        (searches, others.chunks(n_here.max(1)).map(<[LineSearch]>::to_vec).collect())
    }

    /// Blows in the whitened bands of the channel read last.
    #[must_use]
    pub fn blows(&self) -> &[Blows] {
        &self.blows
    }

    /// Demodulates band by band and reads every pending line in each.
    fn read_bands(
        &mut self,
        (x_hat, n, rate): (&[Complex<f32>], usize, Hz),
        usable: (Hz, Hz),
        pending: &[(usize, Target)],
        searches: &mut [LineSearch],
        plans: &mut Plans,
    ) {
        let duration_s = n as f64 / rate.0;
        let mut whitened = vec![Complex::default(); x_hat.len()];
        let half_width = floor_index(self.first.0.max(10.0 / duration_s) * duration_s / 2.0);
        WhitenPlan::new(n, half_width, WHITEN_CLIP).process(x_hat, &mut whitened);
        let shafts = self.shaft_speeds();
        for speed in &shafts {
            whiten::limit_multiples(&mut whitened, n, speed.0 * duration_s, SPEED_PRECISION);
        }
        let fastest = |(_, t): &(usize, Target)| t.expected.0 * (1.0 + t.band.high);
        let fastest = pending.iter().map(fastest).fold(0.0, f64::max);
        let min_width = Hz(fastest * MIN_WIDTH_PER_LINE);
        let ranges = pending.iter().map(|(_, t)| reach::searched_range(t.line, t.expected, t.band));
        let lines: Vec<(Hz, Hz)> = ranges.collect();
        let is_own = |speed: &Hz| pending.iter().any(|(_, target)| target.shaft_speed == *speed);
        let (own, others): (Vec<Hz>, Vec<Hz>) = shafts.into_iter().partition(is_own);
        let rates = Rates { own_shafts: &own, other_shafts: &others, lines: &lines };
        let mut depth = Vec::new();
        let bands = bands::demodulation_bands(usable, min_width, self.band_levels);
        let octaves = bands::octaves_of_lowest(usable, Hz(fastest), self.band_levels);
        let bands = bands.into_iter().map(|band| (band, false));
        for (band, is_octave) in bands.chain(octaves.into_iter().map(|band| (band, true))) {
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
            if band.whitened {
                let blows =
                    impulses::read(&self.e2, &spectrum, (band, n_bins), rates, &mut self.scratch);
                self.blows.push(blows);
            }
            for (place, target) in pending {
                let search = &mut searches[*place];
                let task = target.task(duration_s);
                let reading = bearing::read_line(&spectrum, band, &task, &mut self.scratch);
                if !is_octave {
                    let covered = bearing::read_covered(&spectrum, band, &task, &mut self.scratch);
                    search.covered.extend(covered);
                }
                match (&mut search.outcome, reading) {
                    (Ok(_), Some(reading)) if is_octave => search.octaves.push(reading),
                    (Ok(readings), Some(reading)) => readings.push(reading),
                    (_, None) | (Err(_), _) => {}
                }
            }
        }
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
            let task = LineTask { sum_of_races: None, ..target.task(duration_s) };
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
