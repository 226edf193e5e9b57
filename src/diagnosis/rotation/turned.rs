//! A 1× that points elsewhere than in the baseline (J10): what amplitudes alone do not tell.

use super::TURNED_CONFIDENCE;
use super::UP_RATIO;
use super::accuse_at;
use super::shaft;
use super::signs::Indicator;
use super::signs::is_over_noise;
use crate::diagnosis::Context;
use crate::diagnosis::baseline;
use crate::diagnosis::confidence;
use crate::diagnosis::fault::State;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Evidence;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::shaft::line_name;
use crate::machine::ShaftIndex;
use crate::machine::limits;
use crate::units::Unit;

/// Change of the vector that counts as up, in baselines: of one as large as ever that points a quarter of a turn elsewhere.
const UP_CHANGE: f64 = std::f64::consts::SQRT_2;

/// Change that matters whatever it was before, as a part of the boundary B/C of a shaft's displacement (ISO 7919-3, criterion II).
const OF_ZONE: f64 = 0.25;

/// How the vector of 1× has changed in one probe.
#[derive(Debug, Clone)]
pub(super) struct Turned {
    /// Its ratio is the change, as many times [`UP_RATIO`] as it is [`UP_CHANGE`].
    pub(super) indicator: Indicator,
    /// |v − v₀|/|v₀|.
    pub(super) change: f64,
    /// |v|/|v₀|.
    size: f64,
    /// Whether it points a quarter of a turn elsewhere or more (what points where it did has grown, which its size tells), and matters.
    is_told: bool,
    /// Lag behind the mark in the baseline and now, degrees.
    lags_deg: (f64, f64),
}

/// The change of the vector in every probe of a shaft that has it and whose baseline has its direction, all paid for. Not near a critical
/// speed, where a small change of speed or stiffness turns what nothing has changed.
pub(super) fn turned(
    shaft: ShaftIndex,
    probes: &[&ChannelFeatures],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Vec<Turned> {
    if shaft::is_near_critical(shaft, features, context) {
        return Vec::new();
    }
    let read = |probe: &&ChannelFeatures| read(shaft, probe, features, context);
    let mut found: Vec<Turned> = probes.iter().filter_map(read).collect();
    let looks = found.len() as f64;
    found.iter_mut().for_each(|turned| turned.indicator.pay_for(looks));
    found
}

fn read(
    shaft: ShaftIndex,
    probe: &ChannelFeatures,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<Turned> {
    let channel = context.channel_name(probe.channel);
    let line = line_name(1, &context.machine.shaft(shaft).id);
    let amplitude = probe.get(&line)?;
    let size = context.baseline.compare(channel, &line, amplitude)?;
    let then = context.baseline.direction(channel, features.speed.first?)?;
    let now = baseline::direction_of(probe)?;
    let change = (now * size.ratio - then.unit).norm();
    let cosine = (now * then.unit.conj()).re;
    // By chance it points as far elsewhere on either side, or noise does.
    let by_chance = 2.0 * confidence::normal_tail((now - then.unit).norm() / then.sigma);
    let is_there = is_over_noise((shaft, 1), probe, features);
    let probability = if is_there { by_chance.min(1.0) } else { 1.0 };
    let changed_um = change * amplitude / size.ratio;
    let is_told = cosine <= 0.0 && matters(changed_um, (shaft, probe), features, context);
    let indicator = Indicator {
        name: "vector_1x_change".to_owned(),
        ratio: UP_RATIO * change / UP_CHANGE,
        probability,
        allowed: context.false_alarm_probability,
        rest: None,
        evidence: Evidence {
            indicator: "vector_1x_change".to_owned(),
            channel: channel.to_owned(),
            detector: None,
            frequency: features.speed.first,
            expected: None,
            order: Some(1.0),
            value: change,
            unit: Unit::One,
            threshold: is_told.then_some(UP_CHANGE),
            false_alarm_probability: Some(probability),
            sample_range: Some(probe.sample_range),
        },
    };
    let lag = |to: f64| to.to_degrees().rem_euclid(360.0);
    let lags_deg = (lag(then.unit.arg()), lag(now.arg()));
    Some(Turned { indicator, change, size: size.ratio, is_told, lags_deg })
}

/// Whether a change of so many µm (zero to peak) is one by the standard, at the speeds that it has a scale for.
fn matters(
    changed_um: f64,
    (shaft, probe): (ShaftIndex, &ChannelFeatures),
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let first = features.speed.first;
    let speed = first.and_then(|first| context.machine.shaft_speed(shaft, first));
    let zones = speed.and_then(limits::shaft_zones);
    let is_in_um = context.channels[probe.channel.0].unit == Unit::Micrometre;
    is_in_um && zones.is_some_and(|zones| 2.0 * changed_um >= OF_ZONE * zones.b_c_um)
}

impl Turned {
    /// Whether it accuses the shaft.
    pub(super) fn is_up(&self) -> bool {
        self.is_told && self.indicator.is_up()
    }

    /// Accuses the shaft without a cause, a warning at most, beside what may accuse it already.
    pub(super) fn accuse(&self, verdict: &mut ComponentDiagnosis, features: &WindowFeatures) {
        let said = self.sentence();
        if verdict.state.is_accusation() {
            verdict.why = format!("{}; {said}", verdict.why);
            return;
        }
        accuse_at(verdict, &self.indicator, (None, TURNED_CONFIDENCE), features);
        let severity = verdict.severity.map(severity::not_damaged);
        verdict.severity = severity;
        verdict.state = severity.map_or(State::Warning, severity::state);
        verdict.why = said;
    }

    fn sentence(&self) -> String {
        format!(
            "1× displacement is {:.2} times its baseline in {} but points {:.0}° behind the mark, {:.0}° in the baseline: it has changed \
             by {:.1} times what it was; unless mark, probe or a sender's clock were moved since, the shaft turns otherwise than it did, \
             cause not proven",
            self.size,
            self.indicator.evidence.channel,
            self.lags_deg.1,
            self.lags_deg.0,
            self.change
        )
    }
}
