//! Which defect lines a sensor is asked for at a speed, and which lines of the machine to keep clear of.
//!
//! Must not know spectra or samples.

use super::bearing;
use super::bearing::DefectLine;
use super::bearing::KnownLine;
use super::bearing::LineTask;
use super::bearing::Unreadable;
use super::reach;
use super::shaft_lines::Mains;
use crate::machine::BearingIndex;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::bearing::FaultRates;
use crate::machine::motor::MAINS_HZ;
use crate::machine::sensor::Location;
use crate::machine::sensor::Sensor;
use crate::machine::sensor::SensorKind;
use crate::machine::uncertainty::OrderBands;
use crate::machine::uncertainty::RelativeBand;
use crate::units::Hz;

/// A window must hold this many revolutions before its lines can be told from shaft harmonics: then ± 2/T about these cover a third of all
/// places.
const MIN_REVOLUTIONS: f64 = 12.0;

/// A demodulation band must be this many times wider than the fastest line: line, two harmonics and
/// side bands.
pub const MIN_WIDTH_PER_LINE: f64 = 2.5;

/// Half width of a Hann main lobe, bins of 1/T.
pub(super) const HANN_LOBE: f64 = 2.0;

/// One defect line to look for at a window's speed.
#[derive(Debug)]
pub(super) struct Target {
    pub(super) bearing: BearingIndex,
    pub(super) line: DefectLine,
    pub(super) expected: Hz,
    pub(super) band: RelativeBand,
    /// Another line of the bearing that may stand at the same place, given its geometry's limits.
    pub(super) rival: Option<DefectLine>,
    pub(super) shaft_speed: Hz,
    pub(super) side_band_spacing: Hz,
    /// Of a race's line: the cage's rate seen from that race.
    pub(super) cage_spacing: Option<Hz>,
    /// Of a race's line: where that of the rolling elements is searched.
    pub(super) element_range: Option<(Hz, Hz)>,
    /// Whether it is the line of the race that does not turn.
    pub(super) is_at_rest: bool,
    /// Of the line of the race that turns: the sum of both races' rates.
    pub(super) sum_of_races: Option<Hz>,
    /// Lines to keep clear of.
    pub(super) known: Vec<KnownLine>,
}

/// The bearings a sensor is asked about: its own; or, for a sensor elsewhere, those on its shaft
/// (any, at a gear) that have no sensor of their own.
fn bearings_heard_by(machine: &Machine, sensor: &Sensor) -> Vec<BearingIndex> {
    if !matches!(sensor.kind, SensorKind::Accelerometer | SensorKind::Velocity) {
        return Vec::new();
    }
    let has_own = |b: usize| {
        machine.sensors.iter().any(|s| {
            s.at == Some(Location::Bearing(BearingIndex(b)))
                && matches!(s.kind, SensorKind::Accelerometer | SensorKind::Velocity)
        })
    };
    let near = |b: usize| match sensor.at {
        Some(Location::Bearing(own)) => own.0 == b,
        Some(Location::Shaft(shaft)) => !has_own(b) && machine.bearings[b].shaft == shaft,
        Some(Location::Gear(_)) | None => !has_own(b),
    };
    (0..machine.bearings.len()).filter(|b| near(*b)).map(BearingIndex).collect()
}

/// The defect lines of all bearings a sensor is asked about, at the speed `first` of the first shaft; none of a
/// bearing without geometry. `window`: the speed at which it was measured, if another is tried.
pub(super) fn of_sensor(machine: &Machine, sensor: &Sensor, window: Hz, first: Hz) -> Vec<Target> {
    let mut targets = Vec::new();
    for bearing in bearings_heard_by(machine, sensor) {
        let described = machine.bearing(bearing);
        let speed = machine.shaft_speed(described.shaft, first);
        let Some(shaft_speed) = speed else { continue };
        let Some(rates) = described.fault_rates(shaft_speed) else { continue };
        let ftf = Hz(rates.ftf.0.abs());
        let bands = described.bands;
        let turning = DefectLine::of_turning_race(described.rotating_ring);
        let at_rest = DefectLine::of_race_at_rest(described.rotating_ring);
        targets.extend(DefectLine::ALL.into_iter().map(|line| {
            let expected = line.rate_of(&rates);
            let cage_spacing = match line {
                DefectLine::Bpfi | DefectLine::Bpfo if line == at_rest => Some(ftf),
                DefectLine::Bpfi | DefectLine::Bpfo => Some(Hz((shaft_speed.0 - ftf.0).abs())),
                DefectLine::TwoBsf | DefectLine::Ftf => None,
            };
            let of_elements = DefectLine::TwoBsf;
            let element_range = cage_spacing.map(|_| {
                reach::searched_range(of_elements, rates.two_bsf(), of_elements.band_of(&bands))
            });
            let side_band_spacing = if line == DefectLine::TwoBsf { ftf } else { shaft_speed };
            let band = line.band_of(&bands);
            let fastest = Hz(expected.0 * (1.0 + band.high));
            let known = known_lines(machine, described.shaft, fastest, (window, first));
            let rival = rival(line, &rates, &bands);
            Target {
                bearing,
                line,
                expected,
                band,
                rival,
                shaft_speed,
                side_band_spacing,
                cage_spacing,
                element_range,
                is_at_rest: line == at_rest,
                sum_of_races: (line == turning)
                    .then_some(Hz(rates.bpfi.0.abs() + rates.bpfo.0.abs())),
                known,
            }
        }));
    }
    targets
}

/// Highest multiple at which a shaft's lines are kept clear of for a bearing of another speed: vanes, jaws and knocks. Teeth are in the machine
/// file, and what strikes at a slow rate has lines to either side of each of its multiples, by which it is told (F14).
const OF_ANOTHER_SHAFT: u32 = 20;

/// Side bands of a mesh at the speeds of its wheels, to either side.
const MESH_SIDE_BANDS: u32 = 5;

/// Lines of the machine below the highest harmonic of `expected` that are no defect of a bearing on the shaft `own`: of the shafts at the
/// window's speed, and at `first` if that is another.
fn known_lines(
    machine: &Machine,
    own: ShaftIndex,
    expected: Hz,
    (window, first): (Hz, Hz),
) -> Vec<KnownLine> {
    let top = Hz(expected.0 * 1.1 * bearing::N_HARMONICS as f64);
    let own_ratio = machine.shafts[own.0].ratio_to_first;
    let mut known = Vec::new();
    let other = Some(first).filter(|first| *first != window);
    for speed in std::iter::once(window).chain(other) {
        for (i, shaft) in machine.shafts.iter().enumerate() {
            let Some(ratio) = shaft.ratio_to_first else { continue };
            let spacing = Hz(speed.0 * ratio);
            let multiples = if shaft.ratio_to_first == own_ratio {
                (1..=MULTIPLES).collect()
            } else {
                multiples_of_another(machine, ShaftIndex(i))
            };
            known.extend(multiples_below(spacing, multiples, top).map(|(k, frequency)| {
                KnownLine { frequency, spacing, label: format!("{k}× {}", shaft.id) }
            }));
        }
    }
    for spacing in supplies(machine) {
        let label = "mains".to_owned();
        let mains = harmonics_below(spacing, top);
        known.extend(mains.map(|frequency| KnownLine { frequency, spacing, label: label.clone() }));
    }
    known.extend(pole_passes(machine, window).filter(|line| line.frequency.0 < top.0));
    known
}

/// Multiples of the pole pass (K12) at which a rotor with a broken bar modulates what is heard: its torque pulsates at the first two.
const POLE_PASSES: u32 = 4;

/// Most slip, relative to the synchronous speed, with which an induction motor runs: beyond, an inverter feeds it otherwise than is stated.
const MOST_SLIP: f64 = 0.1;

/// Lines at the pole-pass frequencies of the machine's motors. Not those beside the shaft's harmonics at that distance: they are of the
/// vibration itself, not of its envelope.
fn pole_passes(machine: &Machine, first: Hz) -> impl Iterator<Item = KnownLine> {
    let spacings = machine.motors.iter().filter_map(move |motor| {
        let speed = machine.shaft_speed(motor.shaft, first)?;
        let (slip, spacing) = (motor.slip_speed(speed)?, motor.pole_pass_frequency(speed)?);
        let is_fed_so = slip.0.abs() <= MOST_SLIP * (speed.0 + slip.0);
        (spacing.0 > 0.0 && is_fed_so).then_some(spacing)
    });
    spacings.flat_map(|spacing| {
        (1..=POLE_PASSES).map(move |k| KnownLine {
            frequency: Hz(f64::from(k) * spacing.0),
            spacing,
            label: "pole pass".to_owned(),
        })
    })
}

/// Multiples at which a shaft has lines that a bearing of another speed may hear (F5): the first, and about those of its teeth.
fn multiples_of_another(machine: &Machine, shaft: ShaftIndex) -> Vec<u32> {
    let wheels = machine.gears.iter().flat_map(|gear| [&gear.driving, &gear.driven]);
    let teeth = wheels.filter(|wheel| wheel.shaft == shaft).map(|wheel| wheel.teeth);
    let about = |centre: u32| {
        centre.saturating_sub(MESH_SIDE_BANDS)..=centre.saturating_add(MESH_SIDE_BANDS)
    };
    let of_meshes = teeth.flat_map(|n| (1..=MULTIPLES / n.max(1)).map(move |j| j * n));
    let mut multiples: Vec<u32> =
        (1..=OF_ANOTHER_SHAFT).chain(of_meshes.flat_map(about)).filter(|k| *k > 0).collect();
    multiples.sort_unstable();
    multiples.dedup();
    multiples
}

impl Target {
    /// Why this line cannot be read in a window of `duration_s`, if so.
    pub(super) fn unreadable(&self, usable: (Hz, Hz), duration_s: f64) -> Option<Unreadable> {
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
        self.rival.map(|with| Unreadable::GeometryUncertain { with, band: self.band })
    }

    /// The known line that covers the kinematic rate in a window of `duration_s`, if any.
    pub(super) fn coincides(&self, duration_s: f64) -> Option<String> {
        reach::covering(self.expected, self.band, &self.known, Hz(HANN_LOBE / duration_s))
            .map(|line| line.label.clone())
    }

    /// As it is read in a window of `duration_s`, the speed being told to `told_to` of it.
    pub(super) fn task(&self, duration_s: f64, told_to: f64) -> LineTask<'_> {
        LineTask {
            line: self.line,
            expected: self.expected,
            band: self.band,
            side_band_spacing: self.side_band_spacing,
            cage_spacing: self.cage_spacing,
            element_range: self.element_range,
            is_at_rest: self.is_at_rest,
            sum_of_races: self.sum_of_races,
            shaft_speed: self.shaft_speed,
            known: &self.known,
            known_to: told_to,
            resolution: Hz(HANN_LOBE / duration_s),
            floor_half_width: Hz((0.8 * self.shaft_speed.0).max(25.0 / duration_s)),
        }
    }
}

/// The line whose searched range meets that of `line` because of the geometry's limits, if any.
/// Lines that slip alone brings together at a geometry known well are searched; their side bands tell.
fn rival(line: DefectLine, rates: &FaultRates, bands: &OrderBands) -> Option<DefectLine> {
    let exact = OrderBands::default();
    let range = |line: DefectLine, bands: &OrderBands| {
        reach::searched_range(line, line.rate_of(rates), line.band_of(bands))
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

/// Multiples of a rate that are looked at, at most.
const MULTIPLES: u32 = 200;

/// Harmonics of `fundamental` below `top`.
fn harmonics_below(fundamental: Hz, top: Hz) -> impl Iterator<Item = Hz> {
    multiples_below(fundamental, 1..=MULTIPLES, top).map(|(_, line)| line)
}

/// Which of the multiples of `fundamental`, in ascending order, lie below `top`, and where.
fn multiples_below(
    fundamental: Hz,
    multiples: impl IntoIterator<Item = u32>,
    top: Hz,
) -> impl Iterator<Item = (u32, Hz)> {
    let turns = fundamental.0 > 0.0;
    let lines = multiples.into_iter().map(move |k| (k, Hz(f64::from(k) * fundamental.0)));
    lines.take_while(move |(_, line)| turns && line.0 < top.0)
}

/// Multiples of the mains below `top`: those of the machine's motors, and where none states its own those that may be.
pub(super) fn mains(machine: &Machine, top: Hz) -> Mains {
    let stated = supplies(machine).flat_map(|supply| harmonics_below(supply, top)).collect();
    let is_told = supplies(machine).next().is_some();
    let possible = MAINS_HZ.iter().filter(|_| !is_told);
    let possible = possible.flat_map(|hz| harmonics_below(Hz(*hz), top)).collect();
    Mains { stated, possible }
}

/// Frequencies of the mains that feed the machine's motors.
fn supplies(machine: &Machine) -> impl Iterator<Item = Hz> {
    machine.motors.iter().filter_map(|motor| motor.line_frequency)
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
        let targets = of_sensor(&machine, &machine.sensors[0], Hz(29.5), Hz(29.5));
        targets.iter().map(|t| (t.line, t.unreadable((Hz(0.0), Hz(5000.0)), 10.0))).collect()
    }

    #[test]
    fn the_pole_pass_of_a_loaded_motor_is_no_cages_line() {
        // 4 poles at 60 Hz: 30 Hz synchronous, at 28 Hz a pole pass of 8 Hz; its second multiple lies below the cage's rate.
        let text = "[machine]\nid='m'\n[[shaft]]\nid='s'\n[[motor]]\nshaft='s'\npoles=4\nline_frequency_hz=60.0\n\
             [[bearing]]\nid='b'\nshaft='s'\ncatalogue='SKF 6205'\n\
             [[sensor]]\nchannel='a'\nkind='accelerometer'\nunit='g'\nat={bearing='b'}\n";
        let machine = file::parse(text, "m.toml").unwrap();
        let passes = |first: f64| -> Vec<f64> {
            let targets = of_sensor(&machine, &machine.sensors[0], Hz(first), Hz(first));
            let cage = targets.iter().find(|t| t.line == DefectLine::Ftf).unwrap();
            let known = cage.known.iter().filter(|known| known.label == "pole pass");
            known.map(|known| known.frequency.0).collect()
        };
        assert_eq!(passes(28.0), [8.0, 16.0, 24.0, 32.0]);
        assert!(passes(30.0).is_empty(), "no slip, no pole pass");
        assert!(passes(19.8).is_empty(), "fed by an inverter");
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
    fn a_slow_shaft_covers_its_first_lines_and_those_of_its_teeth_alone() {
        let of_wheel =
            "[[gear]]\nid='g'\ndriving={shaft='s',teeth=23}\ndriven={shaft='slow',teeth=110}\n";
        let multiples = |more: &str| -> Vec<u32> {
            let text = format!(
                "[machine]\nid='m'\n[[shaft]]\nid='s'\n{more}\
                 [[bearing]]\nid='b'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\npitch_diameter_mm=39.04\n\
                 [[sensor]]\nchannel='a'\nkind='accelerometer'\nunit='g'\nat={{bearing='b'}}\n"
            );
            let machine = file::parse(&text, "m.toml").unwrap();
            let targets = of_sensor(&machine, &machine.sensors[0], Hz(30.0), Hz(30.0));
            let own = targets[0].known.iter().filter(|line| line.spacing == Hz(30.0)).count();
            assert_eq!(own, 23, "BPFI is 5.415: below 1.1·4 of it");
            let slow = targets[0].known.iter().filter(|line| line.spacing.0 < 29.0);
            slow.map(|line| line.label.strip_suffix("× slow").unwrap().parse().unwrap()).collect()
        };
        let slow = "[[shaft]]\nid='slow'\n";
        assert_eq!(
            multiples("[[shaft]]\nid='slow'\nratio_to={shaft='s',ratio=0.21}\n"),
            (1..=20).collect::<Vec<_>>()
        );
        let teeth: Vec<u32> = (1..=20).chain(105..=113).collect();
        assert_eq!(
            multiples(&format!("{slow}{of_wheel}")),
            teeth,
            "the mesh, its side bands, below the top"
        );
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
