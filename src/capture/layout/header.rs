//! The root attributes of a capture: what it says of itself as a whole.

use super::Attributes;
use super::FORMAT;
use super::Layout;
use super::MAX_SPEED_HZ;
use super::RECORDING;
use super::VERSION;
use super::start_time_of;
use crate::capture::checksums;
use crate::capture::error::CaptureError;
use crate::capture::hdf5::Attribute;
use crate::capture::root::RootAttribute;
use crate::signal::Timestamp;
use crate::units::Hz;

/// Root attribute of the load.
const LOAD: &str = "load";

/// What the root attributes say.
pub(super) struct Header {
    pub(super) format_stated: bool,
    pub(super) start_time: Option<Timestamp>,
    pub(super) machine: Option<String>,
    pub(super) shaft_speed: Option<Hz>,
    pub(super) load: Option<f64>,
    /// Of what the file states about itself.
    pub(super) checksum: Option<f64>,
    pub(super) others: Vec<String>,
}

impl Layout<'_> {
    pub(super) fn header(&self, attributes: &Attributes) -> Result<Header, CaptureError> {
        const KNOWN: [&str; 8] = [
            "format",
            "version",
            "start_time",
            "machine",
            "shaft_speed_hz",
            RECORDING,
            "configuration",
            checksums::STATEMENT,
        ];
        let format = self.root_text(attributes, "format")?;
        if let Some(text) = format.as_deref().filter(|text| *text != FORMAT) {
            let expected = format!("\"{FORMAT}\", or no such attribute");
            return Err(self.checks.attribute_error(
                "/",
                "format",
                format!("\"{text}\""),
                expected,
            ));
        }
        if let Some(version) = self.root_number(attributes, "version")? {
            #[expect(clippy::float_cmp, reason = "integers are exact")]
            let known = version == f64::from(VERSION);
            if !known {
                let expected = format!("{VERSION}; a newer version of this program may read it");
                return Err(self.checks.attribute_error(
                    "/",
                    "version",
                    version.to_string(),
                    expected,
                ));
            }
        }
        let shaft_speed = self.root_number(attributes, "shaft_speed_hz")?;
        if let Some(speed) = shaft_speed.filter(|speed| !(0.0..=MAX_SPEED_HZ).contains(speed)) {
            let expected = format!("Hz, 0 (standstill) to {MAX_SPEED_HZ}");
            return Err(self.checks.attribute_error(
                "/",
                "shaft_speed_hz",
                speed.to_string(),
                expected,
            ));
        }
        // Files carry notes under this name too: those are no load.
        let load = match attributes.get(LOAD) {
            Some(RootAttribute::Value(Attribute::Number(load))) => {
                Some(*load).filter(|load| load.is_finite())
            }
            Some(_) | None => None,
        };
        let is_known = |name: &str| KNOWN.contains(&name) || (name == LOAD && load.is_some());
        let others = attributes.keys().filter(|name| !is_known(name));
        Ok(Header {
            format_stated: format.is_some(),
            start_time: self.start_time(attributes)?,
            machine: self.root_text(attributes, "machine")?,
            shaft_speed: shaft_speed.map(Hz),
            load,
            checksum: self.root_number(attributes, checksums::STATEMENT)?,
            others: others.cloned().collect(),
        })
    }

    fn start_time(&self, attributes: &Attributes) -> Result<Option<Timestamp>, CaptureError> {
        let Some(text) = self.root_text(attributes, "start_time")? else { return Ok(None) };
        match start_time_of(&text) {
            Some(time) => Ok(Some(time)),
            None => {
                let expected = "an RFC 3339 time such as 2026-03-01T12:00:00Z".into();
                let found = Attribute::Text(text).describe();
                Err(self.checks.attribute_error("/", "start_time", found, expected))
            }
        }
    }

    fn root_number(
        &self,
        attributes: &Attributes,
        name: &str,
    ) -> Result<Option<f64>, CaptureError> {
        match attributes.get(name) {
            None => Ok(None),
            Some(RootAttribute::Value(Attribute::Number(value))) => Ok(Some(*value)),
            Some(other) => Err(self.checks.attribute_error(
                "/",
                name,
                describe_root(other),
                "one number".into(),
            )),
        }
    }

    fn root_text(
        &self,
        attributes: &Attributes,
        name: &str,
    ) -> Result<Option<String>, CaptureError> {
        match attributes.get(name) {
            None => Ok(None),
            Some(RootAttribute::Text) => {
                let text = self.file.root_text(name).map_err(|e| self.checks.library("/", e))?;
                self.checks.bounded_text("/", name, text).map(Some)
            }
            Some(other) => {
                Err(self.checks.attribute_error("/", name, describe_root(other), "a text".into()))
            }
        }
    }
}

fn describe_root(attribute: &RootAttribute) -> String {
    match attribute {
        RootAttribute::Value(value) => value.describe(),
        RootAttribute::Text => "a text".into(),
        RootAttribute::Unreadable(reason) => reason.clone(),
    }
}
