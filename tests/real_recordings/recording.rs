//! A recording in memory, to be changed and written as another capture.

use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::capture::writer::CaptureHeader;
use rotorwatch::capture::writer::CaptureWriter;
use rotorwatch::capture::writer::ChannelHeader;
use rotorwatch::capture::writer::ChannelSamples;
use rotorwatch::capture::writer::ChannelStorage;
use rotorwatch::units::Hz;
use std::path::Path;

/// A capture whose channels have one rate and no gaps.
#[derive(Debug, Clone)]
pub(super) struct Recording {
    /// Of every channel.
    pub(super) rate_hz: f64,
    /// Speed as the capture states it.
    pub(super) stated: Option<Hz>,
    /// Names and samples in canonical units.
    pub(super) channels: Vec<(String, Vec<f64>)>,
}

impl Recording {
    pub(super) fn read(capture: &Path) -> Self {
        let mut reader = CaptureReader::open(capture, None, &Hints::default()).unwrap();
        let info = reader.info().clone();
        let named = info.channels.iter().map(|c| (c.info.name.to_string(), Vec::new()));
        let mut channels: Vec<(String, Vec<f64>)> = named.collect();
        while let Some(block) = reader.next_block().unwrap() {
            channels[block.channel.0].1.extend(block.samples.iter().map(|v| f64::from(*v)));
        }
        let rate_hz = info.channels[0].info.sample_rate.0;
        Self { rate_hz, stated: info.shaft_speed, channels }
    }

    /// Writes it without units: the machine file has them.
    pub(super) fn write(&self, to: &Path) {
        let header = CaptureHeader { start_time: None, machine: None, shaft_speed: self.stated };
        let mut writer = CaptureWriter::create(to, &header).unwrap();
        for (name, samples) in &self.channels {
            let header = ChannelHeader {
                name: name.clone(),
                sample_rate: Hz(self.rate_hz),
                unit: None,
                sensor: None,
                storage: ChannelStorage::Contiguous,
            };
            writer.channel(&header, ChannelSamples::F64(samples)).unwrap();
        }
        writer.finish().unwrap();
    }

    /// Changes the samples of each channel.
    pub(super) fn each(&mut self, mut change: impl FnMut(&mut Vec<f64>)) {
        self.channels.iter_mut().for_each(|(_, samples)| change(samples));
    }

    pub(super) fn duration_s(&self) -> f64 {
        self.channels[0].1.len() as f64 / self.rate_hz
    }
}

/// RMS about the mean.
pub(super) fn rms(samples: &[f64]) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    (samples.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}
