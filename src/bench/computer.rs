//! What the figures were measured on.

use serde_json::{Value, json};

/// Processor, system, version and profile of the program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Computer {
    /// Model of the processor, as the system names it.
    pub processor: String,
    /// Cores this process may use.
    pub n_cores: usize,
    /// System and architecture.
    pub system: String,
    /// Version of this program.
    pub version: &'static str,
    /// `release`, or `debug` with assertions.
    pub profile: &'static str,
}

impl Computer {
    /// The one this runs on.
    #[must_use]
    pub fn this() -> Self {
        let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            processor: model_name(&text).unwrap_or("unknown processor").to_owned(),
            n_cores,
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            version: env!("CARGO_PKG_VERSION"),
            profile: if cfg!(debug_assertions) { "debug" } else { "release" },
        }
    }

    /// One line.
    #[must_use]
    pub fn line(&self) -> String {
        let Self { processor, n_cores, system, version, profile } = self;
        format!("rotorwatch {version} ({profile}), {processor}, {n_cores} cores, {system}")
    }

    /// An object.
    #[must_use]
    pub fn json(&self) -> Value {
        let Self { processor, n_cores, system, version, profile } = self;
        json!({
            "processor": processor,
            "cores": n_cores,
            "system": system,
            "rotorwatch": version,
            "profile": profile,
        })
    }
}

fn model_name(cpuinfo: &str) -> Option<&str> {
    let line = cpuinfo.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_is_read_where_it_is_told() {
        let text = "processor\t: 0\nmodel name\t: Example CPU @ 2.30GHz\nflags\t: fpu\n";
        assert_eq!(model_name(text), Some("Example CPU @ 2.30GHz"));
        assert_eq!(model_name("CPU implementer\t: 0x41\n"), None);
    }
}
