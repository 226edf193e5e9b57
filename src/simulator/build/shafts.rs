//! The shafts of a scene side by side, and the shapes they are bent to.

use super::super::rotor::{Place, Plane, Rotor, Support};
use super::super::scene::{BowShape, Scene, SceneBearing, SceneGear, SceneMate, SensorKind};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Places at which the flanks of a gear, and of its mate, push a shaft.
pub(super) fn flanks_at(gear: &SceneGear) -> Vec<Place> {
    let mut places = vec![Place::from(gear.at_m)];
    if let SceneMate::Shaft(mate) = gear.mate {
        places.push(Place { shaft: 1, at_m: mate.disc.at_m });
    }
    places
}

/// The rotors of a scene.
pub(super) fn rotors(scene: &Scene, elements_per_span: u32) -> Vec<Rotor> {
    (0..scene.shafts.len()).map(|shaft| rotor(scene, shaft, elements_per_span)).collect()
}

/// The plane of all rotors.
pub(super) fn beside(scene: &Scene, rotors: &[Rotor]) -> Plane {
    let with_turns = |(i, rotor): (usize, &Rotor)| (rotor.assemble(), scene.turns(i));
    Plane::beside(&rotors.iter().enumerate().map(with_turns).collect::<Vec<_>>())
}

/// A rotor with every place of the scene on it as a node.
fn rotor(scene: &Scene, shaft: usize, elements_per_span: u32) -> Rotor {
    let watching = scene.sensors.iter().filter(|sensor| sensor.kind != SensorKind::Tacho);
    let unbalances = scene.unbalances.iter().map(|unbalance| unbalance.place);
    let places = unbalances.chain(watching.map(|sensor| sensor.place));
    let mut stations_m: Vec<f64> =
        places.filter(|place| place.shaft == shaft).map(|place| place.at_m).collect();
    let mut discs: Vec<_> =
        scene.discs.iter().filter(|disc| disc.shaft == shaft).map(|disc| disc.disc).collect();
    for gear in &scene.gears {
        match gear.mate {
            SceneMate::Shaft(mate) if shaft == 1 => {
                stations_m.extend([mate.disc.at_m, mate.driven_at_m]);
                discs.push(mate.disc);
            }
            _ if shaft == 0 => {
                stations_m.extend([gear.at_m, gear.torque_at_m]);
                discs.push(gear.disc);
            }
            SceneMate::Shaft(_) | SceneMate::Prescribed => {}
        }
    }
    if let Some(bow) = scene.bow.as_ref().filter(|bow| scene.shaft_of(bow) == Some(shaft))
        && let BowShape::Points(points) = &bow.shape
    {
        stations_m.extend(points.iter().map(|(at_m, _)| *at_m));
    }
    let support = |bearing: &SceneBearing| Support {
        at_m: bearing.place.at_m,
        stiffness_n_per_m: bearing.support_n_per_m,
        ring_mass_kg: bearing.ring_mass_kg,
    };
    Rotor {
        section: scene.shafts[shaft].section,
        length_m: scene.shafts[shaft].length_m,
        discs,
        supports: scene.bearings.iter().filter(|b| b.place.shaft == shaft).map(support).collect(),
        stations_m,
        elements_per_span,
    }
}

/// A bow of a shaft as displacement and slope of every node.
pub(super) fn bow_shape(
    scene: &Scene,
    plane: &Plane,
    shaft: usize,
    shape: &BowShape,
) -> Option<DVector<f64>> {
    let nodes = plane.nodes_of(shaft);
    match shape {
        BowShape::HalfSine { amplitude_m } => {
            let on_it = || scene.bearings.iter().filter(|b| b.place.shaft == shaft);
            let places = || on_it().map(|bearing| bearing.place.at_m);
            let first = places().fold(f64::INFINITY, f64::min);
            let span = places().fold(0.0, f64::max) - first;
            let wave = PI / span;
            Some(DVector::from_fn(plane.n_dof(), |i, _| {
                if !nodes.contains(&(i / 2)) {
                    return 0.0;
                }
                let along = plane.nodes_m[i / 2] - first;
                let inside = along.clamp(0.0, span);
                let slope = amplitude_m * wave * (wave * inside).cos();
                let beyond = along - inside;
                let height = amplitude_m * (wave * inside).sin() + slope * beyond;
                if i % 2 == 0 { height } else { slope }
            }))
        }
        BowShape::Points(points) => through_points(plane, shaft, points),
    }
}

/// The shape of least bending energy through points: the free shaft held at them (R17).
fn through_points(plane: &Plane, shaft: usize, points: &[(f64, f64)]) -> Option<DVector<f64>> {
    let nodes = plane.nodes_of(shaft);
    let (first, n, m) = (2 * nodes.start, 2 * nodes.len(), points.len());
    let own = plane.shaft_stiffness.view((first, first), (n, n));
    let scale = own.amax();
    let mut held = DMatrix::zeros(n + m, n + m);
    held.view_mut((0, 0), (n, n)).copy_from(&own);
    let mut right = DVector::zeros(n + m);
    for (k, (at_m, height_m)) in points.iter().enumerate() {
        let u = plane.displacement_at(Place { shaft, at_m: *at_m }) - first;
        held[(n + k, u)] = scale;
        held[(u, n + k)] = scale;
        right[n + k] = scale * height_m;
    }
    let solved = held.lu().solve(&right)?;
    let mut whole = DVector::zeros(plane.n_dof());
    whole.rows_mut(first, n).copy_from(&solved.rows(0, n));
    whole.iter().all(|x| x.is_finite()).then_some(whole)
}
