//! Spellings of units met in files of others, and the one this program uses.

use crate::units::SourceUnit;

/// The accepted spelling of a unit, if it is one.
pub(super) fn unit(text: &str) -> Option<&'static str> {
    let text = text.trim();
    if let Some(known) = SourceUnit::ACCEPTED.iter().find(|known| **known == text) {
        return Some(known);
    }
    let lower = text.to_lowercase().replace(['(', ')', '[', ']', ' '], "");
    Some(match lower.as_str() {
        "m/s²" | "m/s2" | "m/s^2" | "m/s**2" | "m/s/s" | "ms-2" | "m·s-2" | "m*s^-2"
        | "m/sec^2" => "m/s^2",
        "g" | "gn" | "g's" | "gs" | "g-force" | "gees" | "g_n" => "g",
        "mm/s" | "mm/sec" | "mms-1" => "mm/s",
        "in/s" | "in/sec" | "ips" | "inch/s" => "in/s",
        "in/s²" | "in/s2" | "in/s^2" => "in/s^2",
        "um" | "µm" | "μm" | "micron" | "microns" | "micrometer" | "micrometre" => "um",
        "mm" | "millimeter" | "millimetre" => "mm",
        "mil" | "mils" => "mil",
        "v" | "volt" | "volts" => "V",
        "hz" | "hertz" => "Hz",
        "rpm" | "r/min" | "rev/min" | "1/min" | "min-1" => "rpm",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_spelling_leads_to_an_accepted_one() {
        for (text, expected) in [
            ("m/s²", "m/s^2"),
            (" (m/s^2) ", "m/s^2"),
            ("G", "g"),
            ("µm", "um"),
            ("Volts", "V"),
            ("IPS", "in/s"),
            ("RPM", "rpm"),
        ] {
            assert_eq!(unit(text), Some(expected), "{text}");
            assert!(SourceUnit::ACCEPTED.contains(&expected));
        }
        assert!(SourceUnit::ACCEPTED.iter().all(|text| unit(text) == Some(text)));
        assert_eq!((unit("furlong"), unit("mV"), unit("")), (None, None, None));
    }
}
