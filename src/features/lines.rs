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
use std::sync::Arc;

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

/// What one channel's envelopes tell of all lines of all bearings that its sensor listens to.
#[derive(Debug, Default)]
pub struct ChannelLines {
    /// At the speed.
    pub here: Vec<LineSearch>,
    /// The same in the sets of bands below (F4), widest first.
    pub lower: Vec<Vec<LineSearch>>,
    /// As `here` at each of the other speeds.
    pub elsewhere: Vec<Vec<LineSearch>>,
}

/// The searches of all channels in each set of bands below, each channel in its lowest where it has fewer, or in its only one (F4).
#[must_use]
pub fn lower_lines(channels: &[ChannelLines]) -> Arc<[Vec<LineSearch>]> {
    let n_sets = channels.iter().map(|channel| channel.lower.len()).max().unwrap_or(0);
    let of_channel = |channel: &ChannelLines, set: usize| {
        let lowest = channel.lower.get(set).or_else(|| channel.lower.last());
        lowest.unwrap_or(&channel.here).clone()
    };
    let of_set = |set| channels.iter().flat_map(|channel| of_channel(channel, set)).collect();
    (0..n_sets).map(of_set).collect()
}

/// The bands that one channel is demodulated in.
struct Sets {
    /// Those of the usable band.
    whole: Vec<Band>,
    octaves: Vec<Band>,
    /// The sets below, widest first.
    lower: Vec<Vec<Band>>,
}

/// One band and what was read in it of every line that was asked for.
type BandLines = (Band, Vec<Option<BandReading>>);

impl Sets {
    /// Each band once: sets share those of the sets above them.
    fn distinct(&self) -> Vec<Band> {
        let all = self.whole.iter().chain(&self.octaves).chain(self.lower.iter().flatten());
        let mut distinct: Vec<Band> = Vec::new();
        for band in all {
            if !distinct.contains(band) {
                distinct.push(*band);
            }
        }
        distinct
    }

    /// Whether a band is asked for lines at other speeds, too: those of the lower sets are not.
    fn is_for_all(&self, band: &Band) -> bool {
        self.whole.contains(band) || self.octaves.contains(band)
    }

    /// Hands what was `read` of each pending line to its search; of the first `n_here` searches those in the sets below.
    fn hand_out(
        &self,
        read: &[BandLines],
        (pending, n_here): (&[(usize, Target)], usize),
        searches: &mut [LineSearch],
    ) -> Vec<Vec<LineSearch>> {
        let of = |bands: &[Band], line: usize| -> Vec<BandReading> {
            let readings = |band| Some(&read.iter().find(|(of, _)| of == band)?.1);
            bands.iter().filter_map(|band| readings(band)?[line].clone()).collect()
        };
        for (line, (place, _)) in pending.iter().enumerate() {
            searches[*place].outcome = Ok(of(&self.whole, line));
            searches[*place].octaves = of(&self.octaves, line);
        }
        let in_set = |set: &Vec<Band>| {
            let mut there = searches[..n_here].to_vec();
            for (line, (place, _)) in pending.iter().enumerate().filter(|(_, p)| p.0 < n_here) {
                there[*place].outcome = Ok(of(set, line));
                there[*place].octaves = Vec::new();
            }
            there
        };
        self.lower.iter().map(in_set).collect()
    }
}

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
        let lower = if pending.is_empty() {
            Vec::new()
        } else {
            self.read_bands((x_hat, n, rate), usable, (&pending, n_here), &mut searches, plans)
        };
        // As many at each speed: what there is to look for does not depend on it.
        let others = searches.split_off(n_here);
        let elsewhere = others.chunks(n_here.max(1)).map(<[LineSearch]>::to_vec).collect();
        ChannelLines { here: searches, lower, elsewhere }
    }

    /// Blows in the whitened bands of the channel read last.
    #[must_use]
    pub fn blows(&self) -> &[Blows] {
        &self.blows
    }

    /// Demodulates band by band and reads every pending line in each; what the sets below tell of the first `n_here` searches.
    fn read_bands(
        &mut self,
        (x_hat, n, rate): (&[Complex<f32>], usize, Hz),
        usable: (Hz, Hz),
        (pending, n_here): (&[(usize, Target)], usize),
        searches: &mut [LineSearch],
        plans: &mut Plans,
    ) -> Vec<Vec<LineSearch>> {
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
            read.push((band, readings.collect()));
        }
        sets.hand_out(&read, (pending, n_here), searches)
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
mod tests {
    use crate::dsp::real::Real;
    use crate::features::ChannelWindow;
    use crate::features::Window;
    use crate::features::WindowFeatures;
    use crate::features::bearing::LineSearch;
    use crate::features::extract::Extractor;
    use crate::features::speed::SpeedHints;
    use crate::machine::file;
    use crate::signal::ChannelInfo;
    use crate::units::Hz;
    use crate::units::Unit;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;
    use std::sync::Arc;

    /// Two seconds of noise at 48 kHz, and at a rate of the bearing blows that ring at 2 kHz.
    fn struck() -> Vec<f32> {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let at = |i: u32| {
            let since = (f64::from(i) / 48e3) % (1.0 / 105.0);
            (-since * 600.0).exp() * (since * std::f64::consts::TAU * 2e3).sin()
        };
        (0..96_000).map(|i| f32::rounded(at(i) + random.random_range(-1.0..1.0_f64))).collect()
    }

    /// What channels of these names (`slow` at 12 kHz, all others at 48) tell of the same record, with more lines of their sensors' descriptions.
    fn features(sensors: &[(&str, &str)]) -> WindowFeatures {
        let of_sensor = |(name, more): &(&str, &str)| {
            format!(
                "[[sensor]]\nchannel='{name}'\nkind='accelerometer'\nunit='g'\nat={{bearing='b'}}\n{more}\n"
            )
        };
        let text = format!(
            "[machine]\nid='m'\n[[shaft]]\nid='s'\nspeed_hz=30.0\n[[bearing]]\nid='b'\nshaft='s'\nelements=9\n\
             element_diameter_mm=7.94\npitch_diameter_mm=39.04\n{}",
            sensors.iter().map(of_sensor).collect::<String>()
        );
        let channels: Vec<ChannelInfo> = sensors
            .iter()
            .map(|(name, _)| ChannelInfo {
                name: (*name).into(),
                sample_rate: Hz(if *name == "slow" { 12e3 } else { 48e3 }),
                unit: Unit::MetrePerSecondSquared,
                full_scale: None,
                offset: 0.0,
                unit_conflict: None,
            })
            .collect();
        let machine = Arc::new(file::parse(&text, "m.toml").unwrap());
        let samples = struck();
        let slow: Vec<f32> = samples.iter().step_by(4).copied().collect();
        let run = |(name, _): &(&str, &str)| {
            let samples = if *name == "slow" { &slow[..] } else { &samples[..] };
            Some(ChannelWindow { start: 0, time_s: 0.0, samples })
        };
        let window = Window { time_s: (0.0, 2.0), channels: sensors.iter().map(run).collect() };
        Extractor::new(machine, channels, SpeedHints::default()).extract(&window)
    }

    #[test]
    fn a_set_below_reads_what_a_sensor_tells_whose_usable_band_ends_there() {
        let all = features(&[("x", "")]);
        assert_eq!(all.lower_lines.len(), 2, "22.8 kHz: of 5.7 a quarter holds eight lines");
        let outcomes = |lines: &[LineSearch]| -> Vec<_> {
            lines.iter().map(|s| (s.line, s.outcome.clone())).collect()
        };
        for (lines, top) in all.lower_lines.iter().zip([11_400.0, 5_700.0]) {
            let there = features(&[("x", &format!("usable_hz=[0.0, {top:.1}]"))]);
            assert_eq!(outcomes(lines), outcomes(&there.bearing_lines));
            assert_ne!(outcomes(&all.bearing_lines), outcomes(&there.bearing_lines));
        }
        let covered =
            |lines: &[LineSearch]| -> Vec<_> { lines.iter().map(|s| s.covered.clone()).collect() };
        assert_eq!(covered(&all.lower_lines[0]), covered(&all.bearing_lines), "of all of the band");
    }

    #[test]
    fn every_channel_is_in_every_set_below() {
        let both = features(&[("x", ""), ("slow", "")]);
        let alone = features(&[("slow", "")]);
        assert!(alone.lower_lines.is_empty(), "12 kHz");
        let slow = |lines: &[LineSearch]| -> Vec<LineSearch> {
            lines.iter().filter(|s| s.channel.0 == 1).cloned().collect()
        };
        assert_eq!(both.lower_lines[0].len(), both.bearing_lines.len());
        assert_eq!(slow(&both.lower_lines[0]), slow(&both.bearing_lines), "in its only one");
    }
}
