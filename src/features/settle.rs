//! At what speed the first shaft turns in a window: the contract's precedence, from a tacho to what was written.
//!
//! Gathers what `tacho` and `speed` need from the window; which of them is believed is theirs to say.

use super::Window;
use super::sensor::SensorReading;
use super::speed;
use super::speed::Peak;
use super::speed::Speed;
use super::speed::SpeedHints;
use super::tacho;
use super::targets;
use super::trace::Trace;
use crate::machine::Machine;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelInfo;
use crate::units::Hz;

/// What is said about the speed beside the samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Told<'a> {
    /// The machine.
    pub(super) machine: &'a Machine,
    /// The stream's channels.
    pub(super) channels: &'a [ChannelInfo],
    /// What the command line and the capture say.
    pub(super) hints: SpeedHints,
}

impl Told<'_> {
    /// Speed of the first shaft by the contract's precedence.
    #[must_use]
    pub(super) fn speed(
        &self,
        window: &Window<'_>,
        sensors: &[SensorReading],
        traces: &[Trace<'_>],
    ) -> Speed {
        let nominal =
            speed::nominal(self.hints, self.machine.shafts.first().and_then(|s| s.nominal_speed));
        if let Some(measured) = tacho::measured_speed(self.machine, self.channels, window, sensors)
        {
            return tacho::with_disagreement(measured, nominal);
        }
        let Some((nominal, source)) = nominal else { return Speed::unknown() };
        let (mut peaks, mut probes): (Vec<Peak>, Vec<Vec<Peak>>) = Default::default();
        let mut duration_s = f64::INFINITY;
        for trace in traces {
            let rate = trace.rate;
            let n = trace.samples.len();
            duration_s = duration_s.min(n as f64 / rate.0);
            let top = Hz(nominal.0 * 5.0 * (1.0 + 2.0 * speed::REFINE_RANGE));
            let found = speed::peaks(&trace.x_hat, n, rate, top, Hz(nominal.0 * 0.5));
            probes.extend(self.of_probe(trace, &found));
            peaks.extend(found);
        }
        let imitators = speed::imitators(self.machine);
        let excluded = targets::mains_lines(self.machine, Hz(nominal.0 * 6.0));
        let comb = speed::find_comb(&peaks, nominal, duration_s, &imitators, &excluded)
            .or_else(|| speed::find_probe_line(&probes, nominal, duration_s, &excluded));
        let mut settled = speed::settle(nominal, source, comb);
        if let (Some(option), Some(capture)) = (self.hints.option, self.hints.capture) {
            settled.notes.extend(tacho::disagreement("--speed", option, "the capture", capture));
        }
        if let (Some(capture), Some(machine)) =
            (self.hints.capture, self.machine.shafts.first().and_then(|s| s.nominal_speed))
        {
            settled.notes.extend(tacho::disagreement(
                "the capture",
                capture,
                "the machine file",
                machine,
            ));
        }
        settled
    }

    /// Peaks of a proximity probe, in speeds of the first shaft; `None` of any other sensor.
    fn of_probe(&self, trace: &Trace<'_>, peaks: &[Peak]) -> Option<Vec<Peak>> {
        let sensor = &self.machine.sensors[trace.sensor];
        let shaft =
            self.machine.shaft_at(sensor).filter(|_| sensor.kind == SensorKind::Proximitor)?;
        let ratio = self.machine.shafts[shaft.0].ratio_to_first?;
        let of_first = |p: &Peak| Peak { frequency: Hz(p.frequency.0 / ratio), ..*p };
        Some(peaks.iter().map(of_first).collect())
    }
}
