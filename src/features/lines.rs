//! Sends every bearing line of the machine through the reader: which sensor listens to which
//! bearing, which lines of the machine to keep clear of, which bands to read.

use super::absolute::AbsoluteLine;
use super::absolute::AbsoluteSpectrum;
use super::absolute::AbsoluteVibration;
use super::bands;
use super::bands::Band;
use super::bearing;
use super::bearing::DefectLine;
use super::bearing::DepthSpectrum;
use super::bearing::KnownLine;
use super::bearing::LineSearch;
use super::bearing::LineTask;
use super::bearing::Unreadable;
use super::plans::Plans;
use super::reach;
use crate::dsp::envelope;
use crate::dsp::real::floor_index;
use crate::dsp::whiten;
use crate::dsp::whiten::WhitenPlan;
use crate::machine::BearingIndex;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::bearing::FaultRates;
use crate::machine::bearing::RotatingRing;
use crate::machine::sensor::Location;
use crate::machine::sensor::Sensor;
use crate::machine::sensor::SensorKind;
use crate::machine::uncertainty::OrderBands;
use crate::machine::uncertainty::RelativeBand;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use rustfft::num_complex::Complex;

/// A window must hold this many revolutions before its lines can be told from shaft harmonics.
const MIN_REVOLUTIONS: f64 = 20.0;

/// A demodulation band must be this many times wider than the fastest line: line, two harmonics and
/// side bands.
const MIN_WIDTH_PER_LINE: f64 = 2.5;

/// Half width of a Hann main lobe, bins of 1/T.
const HANN_LOBE: f64 = 2.0;

/// Bins that stand more than this many noise levels high are discrete lines and are held there in the whitened
/// bands (20 dB): one tone then carries 1 % of a band of 1 kHz in 10 s, while impacts, a comb of a hundred lines,
/// keep their shape.
const WHITEN_CLIP: f64 = 10.0;

/// How well a speed is known that shaft harmonics or a tacho gave, relative: orders of the shafts are brought down to
/// the noise in the whitened bands as far up as this leaves them in their bins.
const SPEED_PRECISION: f64 = 2e-5;

/// One defect line to look for at a window's speed.
#[derive(Debug)]
struct Target {
    bearing: BearingIndex,
    line: DefectLine,
    expected: Hz,
    band: RelativeBand,
    /// Another line of the bearing that may stand at the same place, given its geometry's limits.
    rival: Option<DefectLine>,
    shaft_speed: Hz,
    side_band_spacing: Hz,
    /// Whether it is the line of the race that does not turn.
    is_at_rest: bool,
    /// Lines to keep clear of.
    known: Vec<KnownLine>,
}

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
        let duration_s = n as f64 / rate.0;
        let usable = bands::usable_band(sensor, rate);
        let mut searches = Vec::new();
        let mut pending: Vec<(usize, Target)> = Vec::new();
        let targets = self.targets(sensor, self.first);
        let n_here = targets.len();
        let elsewhere = self.elsewhere.iter().flat_map(|first| self.targets(sensor, *first));
        for target in targets.into_iter().chain(elsewhere) {
            let blocked = target.unreadable(usable, duration_s);
            let is_readable = blocked.is_none();
            searches.push(LineSearch {
                bearing: target.bearing,
                channel: heard.0,
                line: target.line,
                expected: target.expected,
                band: target.band,
                shaft_speed: target.shaft_speed,
                side_band_spacing: target.side_band_spacing,
                resolution: Hz(HANN_LOBE / duration_s),
                sample_range: heard.2,
                outcome: blocked.map_or(Ok(Vec::new()), Err),
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
        for speed in self.shaft_speeds() {
            whiten::limit_multiples(&mut whitened, n, speed.0 * duration_s, SPEED_PRECISION);
        }
        let fastest = |(_, t): &(usize, Target)| t.expected.0 * (1.0 + t.band.high);
        let fastest = pending.iter().map(fastest).fold(0.0, f64::max);
        let min_width = Hz(fastest * MIN_WIDTH_PER_LINE);
        let mut depth = Vec::new();
        for band in bands::demodulation_bands(usable, min_width, self.band_levels) {
            let source = if band.whitened { &whitened[..] } else { x_hat };
            let Some((bin_hz, mean_square)) =
                self.depth_spectrum(source, (n, rate), band, (&mut depth, plans))
            else {
                continue;
            };
            let bins = envelope::bins_of_band(n, rate.0, band.low.0, band.high.0);
            let tone = bins.and_then(|b| bearing::leading_tone(source, b, 1.0 / duration_s));
            let spectrum = DepthSpectrum { depth: &depth, bin_hz, duration_s, mean_square, tone };
            for (place, target) in pending {
                let search = &mut searches[*place];
                let task = target.task(duration_s);
                let reading = bearing::read_line(&spectrum, band, &task, &mut self.scratch);
                if let (Ok(readings), Some(reading)) = (&mut search.outcome, reading) {
                    readings.push(reading);
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
        for target in self.targets(sensor, self.first) {
            if target.unreadable(usable, duration_s).is_some() {
                continue;
            }
            let task = target.task(duration_s);
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

    /// The bearings a sensor is asked about: its own; or, for a sensor elsewhere, those on its shaft
    /// (any, at a gear) that have no sensor of their own.
    fn bearings_heard_by(&self, sensor: &Sensor) -> Vec<BearingIndex> {
        if !matches!(sensor.kind, SensorKind::Accelerometer | SensorKind::Velocity) {
            return Vec::new();
        }
        let has_own = |b: usize| {
            self.machine.sensors.iter().any(|s| {
                s.at == Some(Location::Bearing(BearingIndex(b)))
                    && matches!(s.kind, SensorKind::Accelerometer | SensorKind::Velocity)
            })
        };
        let near = |b: usize| match sensor.at {
            Some(Location::Bearing(own)) => own.0 == b,
            Some(Location::Shaft(shaft)) => !has_own(b) && self.machine.bearings[b].shaft == shaft,
            Some(Location::Gear(_)) | None => !has_own(b),
        };
        (0..self.machine.bearings.len()).filter(|b| near(*b)).map(BearingIndex).collect()
    }

    /// The defect lines of all bearings a sensor is asked about, at a speed of the first shaft; none of a
    /// bearing without geometry.
    fn targets(&self, sensor: &Sensor, first: Hz) -> Vec<Target> {
        let mut targets = Vec::new();
        for bearing in self.bearings_heard_by(sensor) {
            let described = self.machine.bearing(bearing);
            let speed = self.machine.shaft_speed(described.shaft, first);
            let Some(shaft_speed) = speed else { continue };
            let Some(rates) = described.fault_rates(shaft_speed) else { continue };
            let ftf = Hz(rates.ftf.0.abs());
            let bands = described.bands;
            let at_rest = match described.rotating_ring {
                RotatingRing::Inner => DefectLine::Bpfo,
                RotatingRing::Outer => DefectLine::Bpfi,
            };
            targets.extend(DefectLine::ALL.into_iter().map(|line| {
                let expected = rate_of(line, &rates);
                let side_band_spacing = if line == DefectLine::TwoBsf { ftf } else { shaft_speed };
                let band = line.band_of(&bands);
                let known = self.known_lines(Hz(expected.0 * (1.0 + band.high)), first);
                let rival = rival(line, &rates, &bands);
                Target {
                    bearing,
                    line,
                    expected,
                    band,
                    rival,
                    shaft_speed,
                    side_band_spacing,
                    is_at_rest: line == at_rest,
                    known,
                }
            }));
        }
        targets
    }

    /// Lines of the machine below the highest harmonic of `expected` that are no bearing defect: of the shafts at the
    /// window's speed, and at `first` if that is another.
    fn known_lines(&self, expected: Hz, first: Hz) -> Vec<KnownLine> {
        let top = Hz(expected.0 * 1.1 * bearing::N_HARMONICS as f64);
        let mut known = Vec::new();
        let other = Some(first).filter(|first| *first != self.first);
        for speed in std::iter::once(self.first).chain(other) {
            for shaft in &self.machine.shafts {
                let Some(ratio) = shaft.ratio_to_first else { continue };
                let harmonics = harmonics_below(Hz(speed.0 * ratio), top).enumerate();
                known.extend(harmonics.map(|(i, frequency)| KnownLine {
                    frequency,
                    label: format!("{}× {}", i + 1, shaft.id),
                }));
            }
        }
        let mains = mains_lines(self.machine, top).into_iter();
        known.extend(mains.map(|frequency| KnownLine { frequency, label: "mains".to_owned() }));
        known
    }
}

impl Target {
    /// Why this line cannot be read in a window of `duration_s`, if so.
    fn unreadable(&self, usable: (Hz, Hz), duration_s: f64) -> Option<Unreadable> {
        let (low, high) = usable;
        let fastest = self.expected.0 * (1.0 + self.band.high);
        let needed = Hz(low.0 + fastest * MIN_WIDTH_PER_LINE);
        if high.0 < needed.0 {
            return Some(Unreadable::TooSlow { usable: high, needed });
        }
        let needed_s = MIN_REVOLUTIONS / self.shaft_speed.0;
        if duration_s < needed_s {
            return Some(Unreadable::TooShort { needed_s });
        }
        if let Some(with) = self.rival {
            return Some(Unreadable::GeometryUncertain { with, band: self.band });
        }
        reach::covering(self.expected, self.band, &self.known, Hz(HANN_LOBE / duration_s))
            .map(|line| Unreadable::Coincides { with: line.label.clone() })
    }

    fn task(&self, duration_s: f64) -> LineTask<'_> {
        LineTask {
            line: self.line,
            expected: self.expected,
            band: self.band,
            side_band_spacing: self.side_band_spacing,
            is_at_rest: self.is_at_rest,
            shaft_speed: self.shaft_speed,
            known: &self.known,
            resolution: Hz(HANN_LOBE / duration_s),
            floor_half_width: Hz((0.8 * self.shaft_speed.0).max(25.0 / duration_s)),
        }
    }
}

/// Kinematic rate of a line, without sign.
fn rate_of(line: DefectLine, rates: &FaultRates) -> Hz {
    match line {
        DefectLine::Bpfi => rates.bpfi,
        DefectLine::Bpfo => rates.bpfo,
        DefectLine::TwoBsf => rates.two_bsf(),
        DefectLine::Ftf => Hz(rates.ftf.0.abs()),
    }
}

/// The line whose searched range meets that of `line` because of the geometry's limits, if any.
/// Lines that slip alone brings together at a geometry known well are searched; their side bands tell.
fn rival(line: DefectLine, rates: &FaultRates, bands: &OrderBands) -> Option<DefectLine> {
    let exact = OrderBands::default();
    let range = |line: DefectLine, bands: &OrderBands| {
        reach::searched_range(line, rate_of(line, rates), line.band_of(bands))
    };
    let meet = |other: DefectLine, bands: &OrderBands| {
        let ((low, high), (other_low, other_high)) = (range(line, bands), range(other, bands));
        low.0 <= other_high.0 && other_low.0 <= high.0
    };
    let others = DefectLine::ALL.into_iter().filter(|other| *other != line);
    let wide = |line: DefectLine| reach::is_wide(line.band_of(bands));
    others
        .into_iter()
        .find(|&other| meet(other, bands) && (wide(line) || wide(other) || !meet(other, &exact)))
}

/// Harmonics of `fundamental` below `top`, at most 200.
fn harmonics_below(fundamental: Hz, top: Hz) -> impl Iterator<Item = Hz> {
    let turns = fundamental.0 > 0.0;
    (1..=200_u32)
        .map(move |k| Hz(f64::from(k) * fundamental.0))
        .take_while(move |line| turns && line.0 < top.0)
}

/// Mains harmonics of the machine's motors below `top`.
#[must_use]
pub fn mains_lines(machine: &Machine, top: Hz) -> Vec<Hz> {
    let supplies = machine.motors.iter().filter_map(|motor| motor.line_frequency);
    supplies.flat_map(|supply| harmonics_below(supply, top)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::file;

    fn outcomes(designation: &str) -> Vec<(DefectLine, Option<Unreadable>)> {
        let text = format!(
            "[machine]\nid='m'\n[[shaft]]\nid='s'\n\
             [[bearing]]\nid='b'\nshaft='s'\ncatalogue='{designation}'\n\
             [[sensor]]\nchannel='a'\nkind='accelerometer'\nunit='g'\nat={{bearing='b'}}\n"
        );
        let machine = file::parse(&text, "m.toml").unwrap();
        let reader = LineReader::new(&machine, Hz(29.5));
        let targets = reader.targets(&machine.sensors[0], reader.first);
        targets.iter().map(|t| (t.line, t.unreadable((Hz(0.0), Hz(5000.0)), 10.0))).collect()
    }

    #[test]
    fn lines_of_a_well_known_bearing_are_all_readable() {
        for designation in ["SKF 6205", "NTN 6203", "SKF 6309", "6206-2Z", "NU 206 ECP"] {
            for (line, outcome) in outcomes(designation) {
                assert_eq!(outcome, None, "{designation} {}", line.name());
            }
        }
    }

    #[test]
    fn a_wide_band_makes_rivals_of_lines_that_meet_by_slip_alone() {
        // The geometry of SKF 6008 is known to some 2 %: its lines meet by slip and are searched. With a
        // suffix in no table they are known to a tenth.
        let at_same_place = |designation: &str| {
            let outcomes = outcomes(designation);
            let blocked = |line: DefectLine| {
                let found = outcomes.iter().find(|(l, _)| *l == line);
                matches!(found, Some((_, Some(Unreadable::GeometryUncertain { .. }))))
            };
            (blocked(DefectLine::Bpfi), blocked(DefectLine::TwoBsf))
        };
        assert_eq!(at_same_place("SKF 6008"), (false, false));
        assert_eq!(at_same_place("SKF 6008 QQ7"), (true, true));
    }

    #[test]
    fn lines_that_an_uncertain_geometry_lets_meet_are_not_guessed() {
        // One maker's data alone: one ball more or less brings BPFI and 2·BSF together.
        let outcomes = outcomes("FAG 6317");
        let of = |line: DefectLine| &outcomes.iter().find(|(l, _)| *l == line).unwrap().1;
        assert!(matches!(
            of(DefectLine::Bpfi),
            Some(Unreadable::GeometryUncertain { with: DefectLine::TwoBsf, band }) if band.high > 0.1
        ));
        assert!(matches!(
            of(DefectLine::TwoBsf),
            Some(Unreadable::GeometryUncertain { with: DefectLine::Bpfi, .. })
        ));
        assert_eq!(*of(DefectLine::Ftf), None, "the cage does not depend on the number of balls");
    }
}
