//! How damage grows from one scenario to the next.
//!
//! Must not know the clock: it is told which part of the way is done.

use super::super::mesh::{Crack, Fault, ToothFault};
use super::super::scene::{Bow, BowShape, Faults, SceneDefect};

/// Faults on the way from one scenario to another; `part` 0 gives the first, 1 the second.
///
/// Width and depth of a defect that both have (same bearing, place, angle and profile) change in
/// proportion; one that only one of them has grows from nothing or shrinks to it. Bows of half a
/// sine wave add as vectors; one of another shape shrinks first, then the new one grows. Faults of
/// teeth change like defects, those of the same gear, tooth and kind into each other; teeth go
/// missing, and are there again, at the end.
#[must_use]
pub fn between(from: &Faults, to: &Faults, part: f64) -> Faults {
    if part >= 1.0 {
        return to.clone();
    }
    if part <= 0.0 {
        return from.clone();
    }
    let sized = |(id, defect): &(String, SceneDefect), width_m: f64, depth_m: f64| {
        (width_m > 0.0 && depth_m > 0.0)
            .then(|| (id.clone(), SceneDefect { width_m, depth_m, ..*defect }))
    };
    let going = from.defects.iter().filter(|a| !to.defects.iter().any(|b| is_same(a, b)));
    let going =
        going.filter_map(|a| sized(a, (1.0 - part) * a.1.width_m, (1.0 - part) * a.1.depth_m));
    let coming = to.defects.iter().filter_map(|b| {
        let old = from.defects.iter().find(|a| is_same(a, b));
        let (width_m, depth_m) = old.map_or((0.0, 0.0), |a| (a.1.width_m, a.1.depth_m));
        let mixed = |old: f64, new: f64| old + part * (new - old);
        sized(b, mixed(width_m, b.1.width_m), mixed(depth_m, b.1.depth_m))
    });
    Faults {
        defects: going.chain(coming).collect(),
        bow: bow_between(from.bow.as_ref(), to.bow.as_ref(), part),
        teeth: teeth_between(&from.teeth, &to.teeth, part),
    }
}

/// Faults of teeth, by the identifier of the gear.
type Teeth = [(String, ToothFault)];

fn teeth_between(from: &Teeth, to: &Teeth, part: f64) -> Vec<(String, ToothFault)> {
    let counterpart = |list: &Teeth, (id, fault): &(String, ToothFault)| {
        let is_it = |(other, b): &&(String, ToothFault)| other == id && is_same_tooth(b, fault);
        list.iter().find(is_it).map(|(_, fault)| fault.fault)
    };
    let on_the_way = |(id, tooth): &(String, ToothFault), fault: Fault| {
        (id.clone(), ToothFault { fault, ..*tooth })
    };
    let going = from.iter().filter(|a| counterpart(to, a).is_none());
    let going = going.map(|a| on_the_way(a, mixed(nothing_of(a.1.fault), a.1.fault, 1.0 - part)));
    let coming = to.iter().filter_map(|b| match (b.1.fault, counterpart(from, b)) {
        (Fault::Missing, None) => None,
        (fault, old) => Some(on_the_way(b, mixed(old.unwrap_or(nothing_of(fault)), fault, part))),
    });
    going.chain(coming).collect()
}

/// A fault of the same kind that takes nothing from the tooth.
fn nothing_of(fault: Fault) -> Fault {
    match fault {
        Fault::Worn { .. } => Fault::Worn { depth_m: 0.0, stiffness_factor: 1.0 },
        Fault::Cracked(crack) => Fault::Cracked(Crack { depth_m: 0.0, ..crack }),
        Fault::Missing => Fault::Missing,
        Fault::Profile { .. } => Fault::Profile { slope_m: 0.0, form_m: 0.0 },
        Fault::Pitch { .. } => Fault::Pitch { offset_m: 0.0 },
    }
}

/// The fault between two of a kind; `part` 0 gives the first, 1 the second.
fn mixed(from: Fault, to: Fault, part: f64) -> Fault {
    let mix = |a: f64, b: f64| a + part * (b - a);
    match (from, to) {
        (
            Fault::Worn { depth_m: a, stiffness_factor: c },
            Fault::Worn { depth_m: b, stiffness_factor: d },
        ) => Fault::Worn { depth_m: mix(a, b), stiffness_factor: mix(c, d) },
        (Fault::Cracked(a), Fault::Cracked(b)) => Fault::Cracked(Crack {
            depth_m: mix(a.depth_m, b.depth_m),
            angle_rad: mix(a.angle_rad, b.angle_rad),
        }),
        (Fault::Profile { slope_m: a, form_m: c }, Fault::Profile { slope_m: b, form_m: d }) => {
            Fault::Profile { slope_m: mix(a, b), form_m: mix(c, d) }
        }
        (Fault::Pitch { offset_m: a }, Fault::Pitch { offset_m: b }) => {
            Fault::Pitch { offset_m: mix(a, b) }
        }
        (_, to) => to,
    }
}

/// Whether two faults are the same kind of damage to the same tooth of a gear.
pub(super) fn is_same_tooth(a: &ToothFault, b: &ToothFault) -> bool {
    let kind = std::mem::discriminant::<Fault>;
    (a.member, a.tooth, kind(&a.fault)) == (b.member, b.tooth, kind(&b.fault))
}

fn is_same(a: &(String, SceneDefect), b: &(String, SceneDefect)) -> bool {
    let sizeless = |d: &SceneDefect| SceneDefect { width_m: 0.0, depth_m: 0.0, ..*d };
    a.0 == b.0 && sizeless(&a.1) == sizeless(&b.1)
}

fn bow_between(from: Option<&Bow>, to: Option<&Bow>, part: f64) -> Option<Bow> {
    let shaft = from.or(to).and_then(|bow| bow.shaft.clone());
    let vector = |bow: Option<&Bow>| match bow {
        None => Some((0.0, 0.0)),
        Some(bow) if bow.shaft != shaft => None,
        Some(Bow { angle_rad, shape: BowShape::HalfSine { amplitude_m }, .. }) => {
            Some((amplitude_m * angle_rad.cos(), amplitude_m * angle_rad.sin()))
        }
        Some(Bow { shape: BowShape::Points(_), .. }) => None,
    };
    if let (Some(a), Some(b)) = (vector(from), vector(to)) {
        let (x, y) = (a.0 + part * (b.0 - a.0), a.1 + part * (b.1 - a.1));
        let amplitude_m = x.hypot(y);
        let shape = BowShape::HalfSine { amplitude_m };
        return (amplitude_m > 0.0).then(|| Bow { shaft, angle_rad: y.atan2(x), shape });
    }
    let (bow, size) = if part < 0.5 { (from, 1.0 - 2.0 * part) } else { (to, 2.0 * part - 1.0) };
    bow.filter(|_| size > 0.0).map(|bow| scaled(bow, size))
}

fn scaled(bow: &Bow, by: f64) -> Bow {
    let shape = match &bow.shape {
        BowShape::HalfSine { amplitude_m } => BowShape::HalfSine { amplitude_m: by * amplitude_m },
        BowShape::Points(points) => {
            BowShape::Points(points.iter().map(|(at_m, d_m)| (*at_m, by * d_m)).collect())
        }
    };
    Bow { shape, ..bow.clone() }
}
