//! A scene as the files a user would have: a capture and its machine file.

use super::Scene;
use rotorwatch::capture::error::CaptureError;
use rotorwatch::capture::writer::CaptureHeader;
use rotorwatch::capture::writer::CaptureWriter;
use rotorwatch::capture::writer::ChannelHeader;
use rotorwatch::capture::writer::ChannelSamples;
use rotorwatch::capture::writer::ChannelStorage;
use std::path::Path;

/// The machine file of the impulses: id `demo`, shaft `main`, bearing `drive-end`, channels
/// `drive_x`, `drive_y` (m/s²) and `tacho`.
pub(crate) const MACHINE: &str = include_str!("machine.toml");

/// What every channel says it was measured by.
pub(crate) const SENSOR_NOTE: &str = "closed-form impulses, not a rig simulation";

/// Writes `duration_s` seconds of a scene as the capture `path`: channels `drive_x`, `drive_y` and
/// `tacho`, the scene's speed as `shaft_speed_hz`, no machine text.
///
/// # Errors
/// When the capture cannot be written.
pub(crate) fn write_capture(
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
