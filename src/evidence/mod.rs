//! The evidence of an alarm: the windows it rests on with everything that is needed to judge them again, in one
//! capture.
//!
//! [`kept`] is what a capture keeps beside its channels, `list` its lists in the file, [`again`] judges the windows
//! again from samples and settings alone and only then holds the outcome against what was kept. Must not know alarms'
//! lives, threads or the clock.

pub mod again;
pub mod kept;
mod list;
mod settings;

use crate::capture::error::CaptureError;
use crate::machine::file::MachineFileErrors;
use crate::pipeline::MonitorError;
use std::path::PathBuf;

/// Why what a capture keeps cannot be judged again.
#[derive(Debug, thiserror::Error)]
pub enum EvidenceError {
    /// The capture cannot be read.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// What it keeps contradicts itself.
    #[error("{}: its evidence cannot be used: {problem}; take a copy that is whole", file.display())]
    Damaged {
        /// The capture.
        file: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// The machine text inside is wrong.
    #[error("the machine description inside {} is wrong", file.display())]
    Machine {
        /// The capture.
        file: PathBuf,
        /// Every mistake.
        source: MachineFileErrors,
    },
    /// Machine and channels do not fit.
    #[error("{}: its channels do not fit its machine", file.display())]
    Monitor {
        /// The capture.
        file: PathBuf,
        /// Why.
        source: MonitorError,
    },
}

/// Which instructions the processor has that decide how numbers are rounded together: a replay is bit by bit the same
/// only where they are.
#[must_use]
pub fn processor() -> String {
    let mut found = vec![std::env::consts::ARCH];
    #[cfg(target_arch = "x86_64")]
    {
        let known = [
            ("sse4.1", std::arch::is_x86_feature_detected!("sse4.1")),
            ("avx", std::arch::is_x86_feature_detected!("avx")),
            ("avx2", std::arch::is_x86_feature_detected!("avx2")),
            ("fma", std::arch::is_x86_feature_detected!("fma")),
            ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
        ];
        found.extend(known.iter().filter(|(_, is_there)| *is_there).map(|(name, _)| *name));
    }
    found.join(" ")
}

#[cfg(test)]
mod tests;
