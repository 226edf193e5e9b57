//! Units at the borders: bare tags and the only conversions.
//!
//! Inside a kernel a suffix names the unit (`speed_hz`, `angle_rad`); between modules one of these
//! types does. Every sample, spectrum and result is in one of the *canonical* units of [`Unit`];
//! [`SourceUnit`] converts once, where data enter. Must not know anything of machines or signals.

/// Frequency or shaft speed in hertz (cycles or revolutions a second).
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct Hz(pub f64);

/// Shaft speed in revolutions a minute.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Rpm(pub f64);

/// Angular speed in radians a second.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct RadPerS(pub f64);

/// Multiple of a shaft's speed, dimensionless.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Order(pub f64);

impl Hz {
    /// Converts to angular speed: ω = 2πf.
    #[must_use]
    pub fn to_rad_per_s(self) -> RadPerS {
        RadPerS(self.0 * std::f64::consts::TAU)
    }

    /// Converts to revolutions a minute.
    #[must_use]
    pub fn to_rpm(self) -> Rpm {
        Rpm(self.0 * 60.0)
    }

    /// Expresses this frequency as an order of `shaft`; `None` at standstill.
    #[must_use]
    pub fn order_of(self, shaft: Hz) -> Option<Order> {
        (shaft.0 > 0.0).then(|| Order(self.0 / shaft.0))
    }
}

impl Rpm {
    /// Converts to hertz.
    #[must_use]
    pub fn to_hz(self) -> Hz {
        Hz(self.0 / 60.0)
    }
}

impl RadPerS {
    /// Converts to hertz: f = ω/2π.
    #[must_use]
    pub fn to_hz(self) -> Hz {
        Hz(self.0 / std::f64::consts::TAU)
    }
}

/// Canonical unit of samples and results.
///
/// The units of the field's standards: what a value carries inside the program is what the API shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Unit {
    /// Acceleration, m/s².
    MetrePerSecondSquared,
    /// Velocity, mm/s.
    MillimetrePerSecond,
    /// Displacement, µm.
    Micrometre,
    /// Uncalibrated voltage: no absolute limit applies.
    Volt,
    /// Frequency or speed, Hz.
    Hertz,
    /// Dimensionless (ratio, modulation depth).
    One,
    /// Not stated by machine file or capture: no absolute limit applies.
    Unknown,
}

impl Unit {
    /// Gives the unit's text in documents.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::MetrePerSecondSquared => "m/s^2",
            Self::MillimetrePerSecond => "mm/s",
            Self::Micrometre => "um",
            Self::Volt => "V",
            Self::Hertz => "Hz",
            Self::One => "1",
            Self::Unknown => "unknown",
        }
    }
}

/// A unit as written in a machine file or capture, with its conversion to the canonical one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceUnit {
    /// Unit after conversion.
    pub canonical: Unit,
    /// canonical value = source value · `factor`.
    pub factor: f64,
}

/// Standard gravity, m/s² (exact by definition, CGPM 1901).
pub const STANDARD_GRAVITY_M_PER_S2: f64 = 9.806_65;

/// Metres in an inch (exact by definition).
pub const METRE_PER_INCH: f64 = 0.0254;

impl SourceUnit {
    /// Spellings accepted in machine files and captures.
    pub const ACCEPTED: &'static [&'static str] =
        &["g", "m/s^2", "in/s^2", "mm/s", "in/s", "um", "mm", "mil", "in", "V", "Hz", "rpm"];

    /// No statement about the unit.
    pub const UNKNOWN: Self = Self { canonical: Unit::Unknown, factor: 1.0 };

    /// Reads a spelling of [`Self::ACCEPTED`]; `None` for any other text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (canonical, factor) = match text {
            "g" => (Unit::MetrePerSecondSquared, STANDARD_GRAVITY_M_PER_S2),
            "m/s^2" => (Unit::MetrePerSecondSquared, 1.0),
            "in/s^2" => (Unit::MetrePerSecondSquared, METRE_PER_INCH),
            "mm/s" => (Unit::MillimetrePerSecond, 1.0),
            "in/s" => (Unit::MillimetrePerSecond, METRE_PER_INCH * 1e3),
            "um" => (Unit::Micrometre, 1.0),
            "mm" => (Unit::Micrometre, 1e3),
            "mil" => (Unit::Micrometre, METRE_PER_INCH * 1e3),
            "in" => (Unit::Micrometre, METRE_PER_INCH * 1e6),
            "V" => (Unit::Volt, 1.0),
            "Hz" => (Unit::Hertz, 1.0),
            "rpm" => (Unit::Hertz, 1.0 / 60.0),
            _ => return None,
        };
        Some(Self { canonical, factor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_conversions_agree() {
        // 600 rpm is the source rig's 10 Hz; exact in binary.
        assert!((Rpm(600.0).to_hz().0 - 10.0).abs() < 1e-15);
        assert!((Hz(10.0).to_rad_per_s().to_hz().0 - 10.0).abs() < 1e-14);
        assert_eq!(Hz(68.0).order_of(Hz(10.0)), Some(Order(6.8)));
        assert_eq!(Hz(68.0).order_of(Hz(0.0)), None);
    }

    #[test]
    fn every_accepted_unit_parses_and_inches_are_exact() {
        for text in SourceUnit::ACCEPTED {
            assert!(SourceUnit::parse(text).is_some(), "{text}");
        }
        let mil = SourceUnit::parse("mil").unwrap();
        assert!((mil.factor - 25.4).abs() < 1e-12 && mil.canonical == Unit::Micrometre);
        assert!(SourceUnit::parse("furlong").is_none());
    }
}
