//! Options that say what a file does not: where channels stand, rate, unit.

use crate::capture::hints::Hints;
use crate::capture::map::ChannelMap;
use crate::capture::map::MapError;
use crate::units::Hz;
use crate::units::SourceUnit;
use clap::Args;

/// Samples a second that make sense.
const RATE_MAX_HZ: f64 = 1e9;

/// What the caller knows beside the files.
#[derive(Debug, Clone, Default, Args)]
pub struct HintArguments {
    /// Where a channel stands in a file of another layout; may be repeated. NAME=/path and options:
    /// column=K or row=K of a table; rate=HZ, interval=S or time=/path; unit=U; scale=A; offset=B.
    /// A number or unit may be a place in the file: @attribute, /path@attribute, /path
    #[arg(long, value_name = "NAME=/PATH[,OPTION=VALUE]")]
    pub map: Vec<String>,
    /// Samples a second of channels whose file does not say it; of CSV and WAV it wins over the file.
    #[arg(long, value_name = "HZ", value_parser = rate)]
    pub rate: Option<f64>,
    /// Unit of channels whose file and machine file do not say it: g, m/s^2, mm/s, um, V, …
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    pub unit: Option<String>,
}

impl HintArguments {
    /// The hints.
    ///
    /// # Errors
    /// When a `--map` is wrong.
    pub fn hints(&self) -> Result<Hints, MapError> {
        let map = ChannelMap::of_options(&self.map)?;
        Ok(Hints { map, rate: self.rate.map(Hz), unit: self.unit.clone() })
    }
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number <= RATE_MAX_HZ => Ok(number),
        Ok(_) | Err(_) => Err(format!("not a number above 0 and up to {RATE_MAX_HZ}")),
    }
}

fn unit(text: &str) -> Result<String, String> {
    match SourceUnit::parse(text) {
        Some(_) => Ok(text.to_owned()),
        None => Err(format!("not one of {}", SourceUnit::ACCEPTED.join(", "))),
    }
}
