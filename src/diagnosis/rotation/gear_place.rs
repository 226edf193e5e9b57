//! What the energy of a gear's average is of: one tooth, all teeth, or neither; and of which member.

use super::UP_RATIO;
use super::gear_signs;
use super::signs::Indicator;
use super::signs::same_speed;
use crate::diagnosis::Context;
use crate::diagnosis::confidence;
use crate::diagnosis::verdict::Evidence;
use crate::features::ChannelFeatures;
use crate::features::WindowFeatures;
use crate::features::gear;
use crate::features::gear::GearReading;
use crate::features::gear::Part;
use crate::machine::GearIndex;
use crate::machine::ShaftIndex;
use crate::units::Unit;

/// Energy at one place is of one tooth if teeth that differ by chance would show it this rarely: the growth is
/// proven beside it, this only says of what.
const ONE_TOOTH: f64 = 0.01;

/// Wear of all teeth shows in the higher harmonics: these must have grown this many times as much as the fundamental,
/// which load and the sensor's gain move alike.
const MORE_THAN_THE_FUNDAMENTAL: f64 = 2.0;

/// A tooth's energy must have grown this many times as much as the mesh: what grows with all teeth is theirs.
const MORE_THAN_THE_MESH: f64 = 2.0;

/// Of two members whose averages both show one place, the faster is damaged if its amplitude is this part of the
/// slower's at least, …
const SAME: f64 = 0.75;

/// … the slower if at most this: a tooth of the slower wheel meets every n-th turn of the faster, n ≥ 2, and an
/// average over all keeps 1/n.
const HALF: f64 = 0.6;

/// Probability that of `teeth` teeth whose energy scatters by chance `width` in a row have `q` times the mean of all (C21):
/// their share of all is Beta(m, z − m), times the z places.
fn chance_of_place(q: f64, width: usize, teeth: u32) -> f64 {
    let (z, m) = (f64::from(teeth), width as f64);
    let share = m * q / z;
    if share >= 1.0 || m >= z {
        return if m >= z { 1.0 } else { 0.0 };
    }
    // Tail of the binomial that is the tail of Beta: Σ_{j < m} C(z − 1, j)·s^j·(1 − s)^(z − 1 − j).
    let mut term = (1.0 - share).powf(z - 1.0);
    let mut tail = term;
    for j in 1..width {
        let j = j as f64;
        term *= share / (1.0 - share) * (z - j) / j;
        tail += term;
    }
    (tail * z).min(1.0)
}

/// The least of the widths of a gear's average, times their number.
pub(super) fn chance_of_one_tooth(reading: &GearReading) -> f64 {
    let places = reading.localisation.peak_over_mean.iter().zip(gear::WIDTHS);
    let least = places.map(|(q, width)| chance_of_place(*q, width, reading.teeth));
    (least.fold(1.0, f64::min) * gear::WIDTHS.len() as f64).min(1.0)
}

pub(super) fn is_one_tooth(reading: &GearReading) -> bool {
    chance_of_one_tooth(reading) <= ONE_TOOTH
}

/// The average of a gear over a shaft (or one of its speed) behind a local amplitude.
pub(super) fn reading<'a>(
    (gear, shaft): (GearIndex, ShaftIndex),
    local: &Indicator,
    features: &'a WindowFeatures,
    context: &Context<'_>,
) -> Option<&'a GearReading> {
    let readings = features.gears.iter();
    readings
        .filter(|r| r.gear == gear && same_speed(r.shaft, shaft, context))
        .filter(|r| context.channel_name(r.channel) == local.evidence.channel)
        .find(|r| gear_signs::is_of(r, &local.name, context))
}

/// The same gear and channel over another shaft or in other orders.
pub(super) fn beside<'a>(
    found: &GearReading,
    shaft: ShaftIndex,
    part: Part,
    features: &'a WindowFeatures,
    context: &Context<'_>,
) -> Option<&'a GearReading> {
    let readings = features.gears.iter();
    readings
        .filter(|r| (r.gear, r.channel, r.part) == (found.gear, found.channel, part))
        .find(|r| same_speed(r.shaft, shaft, context))
}

/// The reading over `shaft` that says best where a tooth is: the whole average, where one tooth stands out of it and stays,
/// for the fewer orders the longer a blow rings; else the same part as `found`.
pub(super) fn clearest<'a>(
    found: &GearReading,
    shaft: ShaftIndex,
    features: &'a WindowFeatures,
    context: &Context<'_>,
) -> Option<&'a GearReading> {
    let stands_out = |r: &&GearReading| {
        is_one_tooth(r) && gear_signs::chance_of_persistence(r) <= context.false_alarm_probability
    };
    beside(found, shaft, Part::Whole, features, context)
        .filter(stands_out)
        .or_else(|| beside(found, shaft, found.part, features, context))
}

/// Whose tooth it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Owner {
    /// A gear on this shaft.
    Shaft(ShaftIndex),
    /// That of one member shows in the other's average, and their amplitudes do not say which is whose.
    Unclear,
}

/// The member whose average shows one tooth; of two the faster if the other is its echo (C22).
pub(super) fn owner(
    gear: GearIndex,
    found: &GearReading,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Owner {
    let others = features.gears.iter().filter(|r| {
        (r.gear, r.channel, r.part) == (gear, found.channel, found.part)
            && !same_speed(r.shaft, found.shaft, context)
            && is_one_tooth(r)
    });
    let Some(other) = others.max_by(|a, b| a.local_amplitude.total_cmp(&b.local_amplitude)) else {
        return Owner::Shaft(found.shaft);
    };
    let (fast, slow) =
        if found.revolutions >= other.revolutions { (found, other) } else { (other, found) };
    match faster_has_it(fast.local_amplitude, slow.local_amplitude) {
        Some(true) => Owner::Shaft(fast.shaft),
        Some(false) => Owner::Shaft(slow.shaft),
        None => Owner::Unclear,
    }
}

/// Whether a tooth that both averages show is the faster member's (C22), by its amplitudes in the two; `None` between
/// the limits.
fn faster_has_it(fast: f64, slow: f64) -> Option<bool> {
    let part = fast / slow;
    if part >= SAME {
        Some(true)
    } else if part <= HALF {
        Some(false)
    } else {
        None
    }
}

/// How far the mesh has grown.
#[derive(Debug, Clone)]
pub(super) struct Growth {
    /// Largest ratio to the baseline of a mesh harmonic.
    pub(super) largest: f64,
    /// Wear of all teeth if the higher harmonics prove it.
    pub(super) wear: Option<Wear>,
}

/// Wear of all teeth, as far as the mesh harmonics prove it.
#[derive(Debug, Clone)]
pub(super) struct Wear {
    /// The least of the higher harmonics' ratios to the baseline.
    pub(super) ratio: f64,
    pub(super) probability: f64,
    pub(super) evidence: Vec<Evidence>,
}

/// Reads the growth of the mesh harmonics in the average of a gear over a shaft (J5).
pub(super) fn growth(
    found: &GearReading,
    channel: &ChannelFeatures,
    context: &Context<'_>,
) -> Option<Growth> {
    let machine = context.machine;
    let (gear, shaft) = (&machine.gear(found.gear).id, &machine.shaft(found.shaft).id);
    let channel_name = context.channel_name(channel.channel);
    let compared: Vec<_> = (1..)
        .zip(found.mesh_over_scatter)
        .filter(|(_, over_scatter)| gear_signs::stands_out(*over_scatter, context))
        .filter_map(|(h, _)| {
            let name = gear::mesh_name(h, gear, shaft);
            let value = channel.get(&name)?;
            Some((h, name.clone(), context.baseline.compare(channel_name, &name, value)?))
        })
        .collect();
    let largest = compared.iter().map(|(.., c)| c.ratio).fold(0.0, f64::max);
    let fundamental = compared.iter().find(|(h, ..)| *h == 1)?.2;
    let higher: Vec<_> = compared.iter().filter(|(h, ..)| *h > 1).collect();
    // All of them, two at least: one alone may have met a resonance.
    let least = higher.iter().map(|(.., c)| c.ratio).fold(f64::INFINITY, f64::min);
    let probability =
        higher.iter().map(|(.., c)| confidence::normal_tail(c.z())).fold(0.0, f64::max);
    let is_worn = higher.len() >= 2
        && least >= UP_RATIO
        && least >= MORE_THAN_THE_FUNDAMENTAL * fundamental.ratio
        && probability <= context.false_alarm_probability;
    let evidence =
        |(_, name, c): &&(usize, String, crate::diagnosis::baseline::Comparison)| Evidence {
            indicator: format!("{name}_ratio_to_baseline"),
            channel: channel_name.to_owned(),
            detector: None,
            frequency: None,
            expected: None,
            order: None,
            value: c.ratio,
            unit: Unit::One,
            threshold: Some(UP_RATIO),
            false_alarm_probability: Some(confidence::normal_tail(c.z())),
            sample_range: Some(channel.sample_range),
        };
    let wear = is_worn.then(|| Wear {
        ratio: least,
        probability,
        evidence: higher.iter().map(evidence).collect(),
    });
    Some(Growth { largest, wear })
}

/// Whether the energy at one place has grown in all the orders that were read, as a blow's does; what a smooth load once a
/// turn adds lies in the low ones (J8).
pub(super) fn is_short(
    found: &GearReading,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let machine = context.machine;
    let (gear, shaft) = (&machine.gear(found.gear).id, &machine.shaft(found.shaft).id);
    let channel_name = context.channel_name(found.channel);
    let Some(channel) = features.channel(found.channel) else { return false };
    let ratio = |part: Part| {
        let name = gear::local_name(part, gear, shaft);
        let value = channel.get(&name)?;
        Some(context.baseline.compare(channel_name, &name, value)?.ratio)
    };
    Part::ALL.into_iter().filter_map(ratio).all(|ratio| ratio >= UP_RATIO)
}

/// Whether energy at one place has grown more than the mesh itself.
pub(super) fn outgrows(ratio: f64, mesh: Option<&Growth>) -> bool {
    mesh.is_none_or(|mesh| {
        ratio >= MORE_THAN_THE_MESH * mesh.largest.max(1.0) || mesh.wear.is_none()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    /// Of z teeth with exponential powers in a circle, how often `width` in a row exceed `q` times the mean of all.
    fn share_above(q: f64, width: usize, z: u32) -> f64 {
        const TRIES: u32 = 20_000;
        let mut random = Pcg64Mcg::seed_from_u64(7);
        let mut n = 0_u32;
        for _ in 0..TRIES {
            let mut powers: Vec<f64> =
                (0..z).map(|_| -random.random_range(f64::MIN_POSITIVE..1.0_f64).ln()).collect();
            let mean = powers.iter().sum::<f64>() / f64::from(z);
            powers.extend_from_within(..width - 1);
            let in_a_row = powers.windows(width).map(|row| row.iter().sum::<f64>() / width as f64);
            n += u32::from(in_a_row.fold(0.0, f64::max) >= q * mean);
        }
        f64::from(n) / f64::from(TRIES)
    }

    #[test]
    fn the_chance_of_one_tooth_is_that_of_scattering_teeth() {
        for (z, q) in [(20_u32, 6.0), (20, 7.0), (60, 8.0), (60, 9.5)] {
            let told = chance_of_place(q, 1, z);
            let found = share_above(q, 1, z);
            // Bonferroni's sum is exact where two teeth cannot both stand out; 4 σ of the count.
            let sigma = (told / 20_000.0).sqrt();
            assert!((found - told).abs() < 4.0 * sigma + 0.1 * told, "{z} {q}: {found} {told}");
        }
        // Places of several teeth overlap: the sum is an upper bound, and no more than their number above it.
        for (z, width, q) in [(20_u32, 2, 4.5), (60, 2, 5.5), (30, 4, 3.2), (60, 4, 3.6)] {
            let told = chance_of_place(q, width, z);
            let found = share_above(q, width, z);
            let sigma = (told / 20_000.0).sqrt();
            let (most, least) = (told + 4.0 * sigma, told / width as f64 - 4.0 * sigma);
            assert!((least..most).contains(&found), "{z} {width} {q}: {found} {told}");
        }
        assert_eq!((chance_of_place(25.0, 1, 20), chance_of_place(1.0, 4, 4)), (0.0, 1.0));
    }

    #[test]
    fn a_blow_that_rings_over_several_teeth_stands_out_where_none_of_them_alone_does() {
        // Of 24 teeth four have 4.5 times the mean of all, each.
        assert!(chance_of_place(4.5, 1, 24) > 0.1);
        assert!(chance_of_place(4.5, 4, 24) < 1e-4);
    }

    /// Amplitude that an average over many turns keeps of a place struck in every `n`-th of them.
    fn averaged(n: u32) -> f64 {
        let turns = 1200;
        let strikes = (0..turns).filter(|turn| turn % n == 0).count();
        strikes as f64 / f64::from(turns)
    }

    #[test]
    fn of_two_members_the_one_struck_on_each_of_its_turns_has_the_tooth() {
        // The slower wheel turns once in n turns of the faster. Its tooth strikes in one of them.
        for n in [2, 3, 5] {
            let (in_fast, in_slow) = (averaged(n), averaged(1));
            assert_eq!(faster_has_it(in_fast, in_slow), Some(false), "{n}: {in_fast}");
            // A tooth of the faster strikes on each of its turns, and so n times in one of the slower, as high.
            assert_eq!(faster_has_it(averaged(1), averaged(1)), Some(true));
        }
        // Noise may move either by some part: between the two it is not said.
        assert_eq!(faster_has_it(0.67, 1.0), None);
    }
}
