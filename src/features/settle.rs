//! At what speed the first shaft turns in a window: the contract's precedence, from a tacho to what was written.
//!
//! Gathers what `tacho`, `shaft_lines` and `speed` need from the window; which of them is believed is theirs to say.

use super::Window;
use super::sensor::SensorReading;
use super::shaft_lines;
use super::shaft_lines::Comb;
use super::shaft_lines::Peak;
use super::speed;
use super::speed::Speed;
use super::speed::SpeedHints;
use super::speed::SpeedSource;
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
        let (comb, is_sure) = self.by_lines(nominal, source, traces);
        let mut settled = speed::settle(nominal, source, comb, is_sure);
        let machine = self.machine.shafts.first().and_then(|s| s.nominal_speed);
        let stated = [
            ("--speed", self.hints.option),
            ("the capture", self.hints.capture),
            ("the machine file", machine),
        ];
        for (i, (name, speed)) in stated.iter().enumerate() {
            for (other_name, other) in &stated[i + 1..] {
                let told = speed
                    .zip(*other)
                    .and_then(|(speed, other)| tacho::disagreement(name, speed, other_name, other));
                settled.notes.extend(told);
            }
        }
        settled
    }

    /// What the lines of the shafts say of a nominal speed, and whether that is sure.
    fn by_lines(
        &self,
        nominal: Hz,
        source: SpeedSource,
        traces: &[Trace<'_>],
    ) -> (Option<Comb>, bool) {
        let (mut probes, mut others): (Vec<Vec<Peak>>, Vec<Vec<Peak>>) = Default::default();
        let mut peaks = Vec::new();
        let mut duration_s = f64::INFINITY;
        for trace in traces {
            let rate = trace.rate;
            let n = trace.samples.len();
            duration_s = duration_s.min(n as f64 / rate.0);
            let top = Hz(nominal.0 * 5.0 * (1.0 + 2.0 * speed::REFINE_RANGE));
            let found = shaft_lines::peaks(&trace.x_hat, n, rate, top, Hz(nominal.0 * 0.5));
            match self.of_probe(trace, &found) {
                Some(of_shaft) => probes.push(of_shaft),
                None => others.push(found.clone()),
            }
            peaks.extend(found);
        }
        let imitators = shaft_lines::imitators(self.machine);
        let mains = targets::mains(self.machine, Hz(nominal.0 * 6.0));
        // A probe looks at the shaft: what it receives of a cable is less.
        let sure = shaft_lines::find_comb(&peaks, nominal, duration_s, &imitators, &mains)
            .or_else(|| shaft_lines::find_first(&probes, nominal, duration_s, &mains.stated()));
        if sure.is_some() {
            return (sure, true);
        }
        // A name plate tells the speed at full load; who wrote another down has looked.
        let is_alone = source == SpeedSource::Machine && !self.has_another_near();
        let may_tell = is_alone && !shaft_lines::is_imitated(1.0, &imitators);
        let by_one = shaft_lines::find_first(&others, nominal, duration_s, &mains);
        (by_one.filter(|_| may_tell), false)
    }

    /// Whether another shaft turns nearly as fast as the first.
    fn has_another_near(&self) -> bool {
        let mut ratios = self.machine.shafts.iter().filter_map(|shaft| shaft.ratio_to_first);
        ratios.any(|ratio| {
            let apart = (ratio - 1.0).abs();
            apart > f64::EPSILON && shaft_lines::is_imitated(1.0, &[ratio])
        })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::real::Real;
    use crate::dsp::reference::gaussian_noise;
    use crate::features::ChannelWindow;
    use crate::features::plans::Plans;
    use crate::machine::file;
    use crate::signal::ChannelIndex;

    const RATE_HZ: f64 = 1000.0;
    const N: u32 = 10_000;

    /// What the lines of an accelerometer that hears 1× at 29.93 Hz alone say of 29.5 Hz.
    fn told(source: SpeedSource, more: &str) -> (Option<f64>, bool) {
        let text = format!(
            "[machine]\nid = \"m\"\n[[shaft]]\nid = \"s\"\nspeed_hz = 29.5\n{more}[[sensor]]\nchannel = \"a\"\n\
             kind = \"accelerometer\"\nat = {{ shaft = \"s\" }}\n"
        );
        let machine = file::parse(&text, "m.toml").unwrap();
        let tone = |i: u32| (std::f64::consts::TAU * 29.93 * f64::from(i) / RATE_HZ).cos();
        let noise = gaussian_noise(N as usize, 3);
        let x: Vec<f32> =
            (0..N).zip(noise).map(|(i, noise)| f32::rounded(noise + tone(i))).collect();
        let run = ChannelWindow { start: 0, time_s: 0.0, samples: &x };
        let reading = SensorReading {
            sensor: 0,
            channel: ChannelIndex(0),
            absent: None,
            doubts: Vec::new(),
            lost: Vec::new(),
            flaw: None,
            sample_range: (0, u64::from(N)),
        };
        let traces = [Trace::new(&reading, run, Hz(RATE_HZ), &mut Plans::new())];
        let told = Told { machine: &machine, channels: &[], hints: SpeedHints::default() };
        let (comb, is_sure) = told.by_lines(Hz(29.5), source, &traces);
        (comb.map(|comb| comb.speed.0), is_sure)
    }

    #[test]
    fn a_line_of_accelerometers_moves_a_name_plates_speed_alone_and_is_not_sure() {
        let (speed, is_sure) = told(SpeedSource::Machine, "");
        assert!(speed.is_some_and(|hz| (hz - 29.93).abs() < 0.005) && !is_sure, "{speed:?}");
        assert_eq!(told(SpeedSource::Capture, ""), (None, false), "who wrote it has looked");
        let another = "[[shaft]]\nid = \"t\"\nspeed_hz = 30.0\n";
        assert_eq!(told(SpeedSource::Machine, another), (None, false), "which of the two");
    }
}
