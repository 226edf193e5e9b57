//! Which unit a channel's samples are in: the machine file's word over the capture's.

use crate::machine::sensor::{Sensor, SensorKind};
use crate::units::{SourceUnit, Unit};

/// The decision about one channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChannelUnit {
    /// Conversion of physical values of the capture to the canonical unit.
    pub(super) unit: SourceUnit,
    /// (capture's spelling, machine file's spelling) where they differ.
    pub(super) conflict: Option<(String, String)>,
}

/// Decides from the machine file's sensor, if it names the channel, and the capture's attribute.
///
/// Volts with a sensitivity become the sensor kind's physical unit. A spelling in the capture that
/// is not in [`SourceUnit::ACCEPTED`] is no statement: the unit is unknown unless the sensor has one.
pub(super) fn resolve(sensor: Option<&Sensor>, attribute: Option<&str>) -> ChannelUnit {
    let stated = attribute.and_then(SourceUnit::parse);
    let from_machine = sensor.and_then(|sensor| sensor.unit.as_ref());
    let unit = from_machine.map(|(_, unit)| *unit).or(stated).unwrap_or(SourceUnit::UNKNOWN);
    let conflict = match (attribute, from_machine) {
        (Some(text), Some((spelling, unit))) if stated != Some(*unit) => {
            Some((text.to_owned(), spelling.clone()))
        }
        _ => None,
    };
    ChannelUnit { unit: calibrated(unit, sensor), conflict }
}

fn calibrated(unit: SourceUnit, sensor: Option<&Sensor>) -> SourceUnit {
    let Some(sensor) = sensor else { return unit };
    let Some(volts_per_unit) = sensor.sensitivity_v_per_unit else { return unit };
    let Some(canonical) = physical(sensor.kind) else { return unit };
    if unit.canonical != Unit::Volt {
        return unit;
    }
    SourceUnit { canonical, factor: unit.factor / volts_per_unit }
}

/// What a sensor of this kind measures, in the canonical unit; `None` where V is all there is.
fn physical(kind: SensorKind) -> Option<Unit> {
    match kind {
        SensorKind::Accelerometer => Some(Unit::MetrePerSecondSquared),
        SensorKind::Velocity => Some(Unit::MillimetrePerSecond),
        SensorKind::Proximitor => Some(Unit::Micrometre),
        SensorKind::Speed => Some(Unit::Hertz),
        SensorKind::Tacho | SensorKind::Load | SensorKind::Temperature | SensorKind::Process => {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(unit: Option<&str>, sensitivity_v_per_unit: Option<f64>) -> Sensor {
        Sensor {
            channel: "x".into(),
            kind: SensorKind::Accelerometer,
            unit: unit.map(|text| (text.to_owned(), SourceUnit::parse(text).unwrap())),
            at: None,
            axis_deg: None,
            direction: None,
            usable: None,
            sensitivity_v_per_unit,
            gap_v: None,
            tacho: None,
        }
    }

    #[test]
    fn the_machine_file_wins_and_the_conflict_is_kept() {
        let machine = sensor(Some("m/s^2"), None);
        let found = resolve(Some(&machine), Some("g"));
        assert_eq!(found.unit, SourceUnit::parse("m/s^2").unwrap());
        assert_eq!(found.conflict, Some(("g".into(), "m/s^2".into())));
        assert_eq!(resolve(Some(&machine), Some("m/s^2")).conflict, None);
        assert_eq!(resolve(Some(&machine), None).conflict, None);
    }

    #[test]
    fn the_capture_speaks_where_the_machine_file_is_silent() {
        let silent = sensor(None, None);
        assert_eq!(resolve(Some(&silent), Some("mil")).unit, SourceUnit::parse("mil").unwrap());
        assert_eq!(resolve(None, Some("g")).unit, SourceUnit::parse("g").unwrap());
        assert_eq!(resolve(None, None).unit, SourceUnit::UNKNOWN);
        assert_eq!(resolve(None, Some("furlong")).unit, SourceUnit::UNKNOWN);
    }

    #[test]
    fn volts_with_a_sensitivity_become_physical() {
        let machine = sensor(Some("V"), Some(0.01));
        let found = resolve(Some(&machine), None).unit;
        assert_eq!(found.canonical, Unit::MetrePerSecondSquared);
        // 1 V at 10 mV per m/s² is 100 m/s²; one division, so exact to rounding.
        assert!((found.factor - 100.0).abs() < 1e-12);
        assert_eq!(resolve(Some(&sensor(Some("V"), None)), None).unit.canonical, Unit::Volt);
        let unit = resolve(Some(&sensor(Some("g"), Some(0.01))), None).unit;
        assert_eq!(unit, SourceUnit::parse("g").unwrap());
    }
}
