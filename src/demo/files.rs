//! A scene as the files a user would have: a capture and its machine file.

use super::impulses::Scene;
use crate::capture::error::CaptureError;
use crate::capture::writer::CaptureHeader;
use crate::capture::writer::CaptureWriter;
use crate::capture::writer::ChannelHeader;
use crate::capture::writer::ChannelSamples;
use crate::capture::writer::ChannelStorage;
use std::path::Path;

/// The demonstration's machine file: id `demo`, shaft `main`, bearing `drive-end`, channels
/// `drive_x`, `drive_y` (m/s²) and `tacho`.
pub const MACHINE: &str = include_str!("machine.toml");

/// What every channel of the demonstration says it was measured by.
pub const SENSOR_NOTE: &str = "demo signal: closed-form impulses, not a rig simulation";

/// Writes `duration_s` seconds of a scene as the capture `path`: channels `drive_x`, `drive_y` and
/// `tacho`, the scene's speed as `shaft_speed_hz`, no machine text.
///
/// # Errors
/// When the capture cannot be written.
pub fn write_capture(
    path: &Path,
    scene: &Scene,
    seed: u64,
    duration_s: f64,
) -> Result<(), CaptureError> {
    let header = CaptureHeader { shaft_speed: Some(scene.shaft_speed), ..CaptureHeader::default() };
    let recording = scene.record(seed, duration_s);
    let mut writer = CaptureWriter::create(path, &header)?;
    for (name, unit, samples) in [
        ("drive_x", "m/s^2", &recording.x),
        ("drive_y", "m/s^2", &recording.y),
        ("tacho", "V", &recording.tacho),
    ] {
        let channel = ChannelHeader {
            name: name.to_owned(),
            sample_rate: scene.sample_rate,
            unit: Some(unit.to_owned()),
            sensor: Some(SENSOR_NOTE.to_owned()),
            storage: ChannelStorage::Contiguous,
        };
        writer.channel(&channel, ChannelSamples::F32(samples))?;
    }
    writer.finish()
}
