//! A shaft with discs on isotropic supports, as matrices of one plane (equations R5, R6); several
//! shafts side by side (R36).
//!
//! Degrees of freedom: displacement u in m and slope u′ in rad of every node, in the order of the
//! nodes along the shaft, shaft by shaft. The plane of y has the same matrices as the plane of x; the gyroscopic
//! matrix couples them. Must not know faults or time.

use super::beam::{ElementMatrix, Section};
use nalgebra::DMatrix;
use std::ops::Range;

/// A rigid disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Place along the shaft, m.
    pub at_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about a diameter, kg·m².
    pub diametral_kg_m2: f64,
    /// Moment of inertia about the axis, kg·m².
    pub polar_kg_m2: f64,
}

impl Disc {
    /// A homogeneous disc with a bore.
    #[must_use]
    pub fn solid(
        at_m: f64,
        outer_m: f64,
        bore_m: f64,
        width_m: f64,
        density_kg_per_m3: f64,
    ) -> Self {
        let (outer, inner) = (0.25 * outer_m * outer_m, 0.25 * bore_m * bore_m); // radii squared
        let mass_kg = density_kg_per_m3 * std::f64::consts::PI * (outer - inner) * width_m;
        Self {
            at_m,
            mass_kg,
            diametral_kg_m2: mass_kg / 12.0 * (3.0 * (outer + inner) + width_m * width_m),
            polar_kg_m2: 0.5 * mass_kg * (outer + inner),
        }
    }
}

/// A support, equally stiff in both planes, and what rides on the shaft there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    /// Place along the shaft, m.
    pub at_m: f64,
    /// Stiffness put into the modes, N/m.
    pub stiffness_n_per_m: f64,
    /// Mass of the ring that moves with the shaft, kg.
    pub ring_mass_kg: f64,
}

/// What a rotor is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Rotor {
    /// Shaft section, the same throughout.
    pub section: Section,
    /// Length, m.
    pub length_m: f64,
    /// Discs.
    pub discs: Vec<Disc>,
    /// Supports.
    pub supports: Vec<Support>,
    /// Further places that must be nodes, m: sensors, forces.
    pub stations_m: Vec<f64>,
    /// Elements between two neighbouring places, at least 1.
    pub elements_per_span: u32,
}

/// A place along one of the shafts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Number of the shaft.
    pub shaft: usize,
    /// Place along it, m.
    pub at_m: f64,
}

impl From<f64> for Place {
    /// Along the first shaft.
    fn from(at_m: f64) -> Self {
        Self { shaft: 0, at_m }
    }
}

/// Matrices of one plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Places of the nodes, m, rising along each shaft.
    pub nodes_m: Vec<f64>,
    /// Number of the first node of every shaft.
    pub first_nodes: Vec<usize>,
    /// Mass: shaft, discs, rings.
    pub mass: DMatrix<f64>,
    /// Stiffness of shaft and supports.
    pub stiffness: DMatrix<f64>,
    /// Stiffness of the free shaft alone: times a bow, it is the bow's force.
    pub shaft_stiffness: DMatrix<f64>,
    /// Symmetric gyroscopic matrix H: plane x is pushed by −Ω·H·ẏ, plane y by +Ω·H·ẋ, Ω the speed of
    /// the first shaft.
    pub gyroscopic: DMatrix<f64>,
}

/// Two places closer than this are one node, m: figures in inches and in millimetres differ so much.
const SAME_PLACE_M: f64 = 1e-5;

/// Shortest element a span is divided into, of the shaft's length: shorter ones cost digits.
const SHORTEST_ELEMENT: f64 = 1.0 / 400.0;

impl Rotor {
    /// Places that must be nodes, m, rising, ends included.
    fn places(&self) -> Vec<f64> {
        let mut places = vec![0.0, self.length_m];
        places.extend(self.discs.iter().map(|disc| disc.at_m));
        places.extend(self.supports.iter().map(|support| support.at_m));
        places.extend(&self.stations_m);
        places.sort_by(f64::total_cmp);
        places.dedup_by(|b, a| (*b - *a).abs() < SAME_PLACE_M);
        places
    }

    /// Nodes: the places, and what divides the spans between them evenly.
    fn nodes(&self) -> Vec<f64> {
        let places = self.places();
        let mut nodes = vec![places[0]];
        for span in places.windows(2) {
            let length = span[1] - span[0];
            let fitting = (length / (SHORTEST_ELEMENT * self.length_m)).floor().max(1.0);
            let parts = (1..=self.elements_per_span.max(1))
                .rev()
                .find(|parts| f64::from(*parts) <= fitting)
                .unwrap_or(1);
            nodes.extend((1..=parts).map(|k| span[0] + length * f64::from(k) / f64::from(parts)));
        }
        nodes
    }

    /// Assembles the matrices.
    #[must_use]
    pub fn assemble(&self) -> Plane {
        let nodes_m = self.nodes();
        let n = 2 * nodes_m.len();
        let zero = || DMatrix::<f64>::zeros(n, n);
        let (mut mass, mut shaft, mut gyroscopic) = (zero(), zero(), zero());
        for (i, span) in nodes_m.windows(2).enumerate() {
            let length = span[1] - span[0];
            add(&mut shaft, 2 * i, 1.0, &self.section.stiffness(length));
            add(&mut mass, 2 * i, 1.0, &self.section.mass(length));
            add(&mut gyroscopic, 2 * i, 2.0, &self.section.rotary(length));
        }
        let node = |at_m: f64| 2 * nearest(&nodes_m, at_m);
        for disc in &self.discs {
            let u = node(disc.at_m);
            mass[(u, u)] += disc.mass_kg;
            mass[(u + 1, u + 1)] += disc.diametral_kg_m2;
            gyroscopic[(u + 1, u + 1)] += disc.polar_kg_m2;
        }
        let mut stiffness = shaft.clone();
        for support in &self.supports {
            let u = node(support.at_m);
            stiffness[(u, u)] += support.stiffness_n_per_m;
            mass[(u, u)] += support.ring_mass_kg;
        }
        let first_nodes = vec![0];
        Plane { nodes_m, first_nodes, mass, stiffness, shaft_stiffness: shaft, gyroscopic }
    }
}

impl Plane {
    /// Degrees of freedom.
    #[must_use]
    pub fn n_dof(&self) -> usize {
        self.mass.nrows()
    }

    /// Shafts side by side, each with its turns to one of the first: nothing in the plane couples them,
    /// and each has the gyroscopic matrix of its own speed (R36).
    #[must_use]
    pub fn beside(shafts: &[(Self, f64)]) -> Self {
        let all = |of: fn(&Self) -> &DMatrix<f64>| {
            let blocks: Vec<_> = shafts.iter().map(|(plane, _)| of(plane).clone()).collect();
            block_diagonal(&blocks)
        };
        let gyroscopic: Vec<_> =
            shafts.iter().map(|(plane, turns)| &plane.gyroscopic * *turns).collect();
        let mut first_nodes = Vec::with_capacity(shafts.len());
        let mut nodes_m = Vec::new();
        for (plane, _) in shafts {
            first_nodes.push(nodes_m.len());
            nodes_m.extend(&plane.nodes_m);
        }
        Self {
            nodes_m,
            first_nodes,
            mass: all(|plane| &plane.mass),
            stiffness: all(|plane| &plane.stiffness),
            shaft_stiffness: all(|plane| &plane.shaft_stiffness),
            gyroscopic: block_diagonal(&gyroscopic),
        }
    }

    /// Numbers of the nodes of a shaft.
    #[must_use]
    pub fn nodes_of(&self, shaft: usize) -> Range<usize> {
        let end = self.first_nodes.get(shaft + 1).copied().unwrap_or(self.nodes_m.len());
        self.first_nodes.get(shaft).copied().unwrap_or(end)..end
    }

    /// Number of the node nearest to a place.
    #[must_use]
    pub fn node_at(&self, place: impl Into<Place>) -> usize {
        let place = place.into();
        let nodes = self.nodes_of(place.shaft);
        nodes.start + nearest(&self.nodes_m[nodes], place.at_m)
    }

    /// Index of the displacement at the node nearest to a place.
    #[must_use]
    pub fn displacement_at(&self, place: impl Into<Place>) -> usize {
        2 * self.node_at(place)
    }
}

/// Square matrices along the diagonal of one.
pub(super) fn block_diagonal(blocks: &[DMatrix<f64>]) -> DMatrix<f64> {
    let n = blocks.iter().map(DMatrix::nrows).sum();
    let mut whole = DMatrix::zeros(n, n);
    let mut at = 0;
    for block in blocks {
        whole.view_mut((at, at), block.shape()).copy_from(block);
        at += block.nrows();
    }
    whole
}

fn nearest(nodes_m: &[f64], at_m: f64) -> usize {
    let distance = |i: &usize| (nodes_m[*i] - at_m).abs();
    (0..nodes_m.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

fn add(into: &mut DMatrix<f64>, at: usize, factor: f64, element: &ElementMatrix) {
    for (i, row) in element.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            into[(at + i, at + j)] += factor * value;
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const INCH: f64 = 0.0254;

    /// The rig whose first two natural frequencies were measured as 117 and 367 Hz.
    pub(in crate::simulator) fn rig(n_elements: u32) -> Rotor {
        let section = Section {
            diameter_m: 0.625 * INCH,
            young_pa: 206.842_7e9,
            poisson: 0.29,
            density_kg_per_m3: 7833.4,
        };
        let disc =
            |inch: f64| Disc::solid(inch * INCH, 6.0 * INCH, 0.625 * INCH, 0.625 * INCH, 2700.0);
        let support = |inch: f64| Support {
            at_m: inch * INCH,
            stiffness_n_per_m: 1.078e8,
            ring_mass_kg: 0.0,
        };
        Rotor {
            section,
            length_m: 21.0 * INCH,
            discs: vec![disc(7.2985), disc(13.7015)],
            supports: vec![support(3.5148), support(17.4852)],
            stations_m: vec![10.5 * INCH],
            elements_per_span: n_elements / 6,
        }
    }

    #[test]
    fn places_side_by_side_make_no_slivers() {
        let mut rotor = rig(24);
        let at_m = rotor.discs[0].at_m;
        let n_nodes = rotor.assemble().nodes_m.len();
        rotor.stations_m.push(at_m + 5e-6);
        assert_eq!(rotor.assemble().nodes_m.len(), n_nodes, "one place");
        rotor.stations_m.push(at_m + 1e-3);
        assert_eq!(rotor.assemble().nodes_m.len(), n_nodes + 1, "one element of 1 mm");
    }

    #[test]
    fn mass_and_free_motions_of_the_assembly_are_those_of_the_parts() {
        let rotor = rig(6);
        let plane = rotor.assemble();
        assert_eq!(plane.nodes_m.len(), 7);
        let n = plane.n_dof();
        let shift = nalgebra::DVector::from_fn(n, |i, _| if i % 2 == 0 { 1.0 } else { 0.0 });
        let total = shift.dot(&(&plane.mass * &shift));
        let parts = rotor.section.density_kg_per_m3 * rotor.section.area_m2() * rotor.length_m
            + 2.0 * rotor.discs[0].mass_kg;
        assert!((total / parts - 1.0).abs() < 1e-12);
        let turn =
            nalgebra::DVector::from_fn(
                n,
                |i, _| {
                    if i % 2 == 0 { plane.nodes_m[i / 2] } else { 1.0 }
                },
            );
        let force = &plane.shaft_stiffness * turn;
        // Rounding against the largest entry.
        assert!(force.amax() < 1e-9 * plane.shaft_stiffness.amax(), "{}", force.amax());
        assert!((rotor.discs[0].mass_kg - 0.773_391).abs() < 1e-6);
    }
}
