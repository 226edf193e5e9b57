//! Torsion of a shaft with discs, or of two: rods whose rigid turn a gear mesh holds (equations R26, R36).
//!
//! One angle a node, rad, counter-clockwise, beyond the turning that is prescribed. A shaft that nothing holds would
//! have a mode at 0 Hz; the mean stiffness of the mesh goes into the shapes and is given back in the
//! mesh force, as supports are for bearings. Must not know gears or scenes.

use super::modes::{Basis, BasisError};
use super::rotor::{Plane, Rotor, block_diagonal};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Stiffness and inertia of rods, one angle a node, in the order of the nodes of their plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Rod {
    /// Inertia, kg·m².
    pub inertia: DMatrix<f64>,
    /// Stiffness, N·m/rad.
    pub stiffness: DMatrix<f64>,
    /// Number of nodes of every shaft, and its turns to one of the first.
    shafts: Vec<(usize, f64)>,
}

/// A force on a flank as torque on a node: its number and the base radius, m.
pub type Arm = (usize, f64);

/// The torsion of a model, in its shapes.
#[derive(Debug, Clone, PartialEq)]
pub struct Torsion {
    /// Shapes and frequencies, the mesh's mean stiffness included.
    pub basis: Basis,
    /// Damping ratio of each shape.
    pub damping: Vec<f64>,
    /// Constant torque, counter-clockwise.
    pub torque: Vec<f64>,
    /// Inertia against a rise of the first shaft's speed, kg·m² by shape.
    pub inertia: Vec<f64>,
}

impl Rod {
    /// The rod of a rotor on the nodes of its plane.
    #[must_use]
    pub fn new(rotor: &Rotor, plane: &Plane) -> Self {
        let section = &rotor.section;
        let nodes_m = &plane.nodes_m;
        let n = nodes_m.len();
        let polar_m4 = PI / 32.0 * section.diameter_m.powi(4);
        let shear_pa = 0.5 * section.young_pa / (1.0 + section.poisson);
        let (mut inertia, mut stiffness) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for (i, span) in nodes_m.windows(2).enumerate() {
            let length = span[1] - span[0];
            let k = shear_pa * polar_m4 / length;
            let j = section.density_kg_per_m3 * polar_m4 * length / 6.0;
            for (a, b, k, j) in
                [(0, 0, k, 2.0 * j), (1, 1, k, 2.0 * j), (0, 1, -k, j), (1, 0, -k, j)]
            {
                stiffness[(i + a, i + b)] += k;
                inertia[(i + a, i + b)] += j;
            }
        }
        for disc in &rotor.discs {
            let node = plane.node_at(disc.at_m);
            inertia[(node, node)] += disc.polar_kg_m2;
        }
        Self { inertia, stiffness, shafts: vec![(n, 1.0)] }
    }

    /// Rods side by side, each with its turns to one of the first.
    #[must_use]
    pub fn beside(rods: &[(Self, f64)]) -> Self {
        let blocks = |of: fn(&Self) -> &DMatrix<f64>| -> Vec<_> {
            rods.iter().map(|(rod, _)| of(rod).clone()).collect()
        };
        let shafts = rods.iter().map(|(rod, turns)| (rod.inertia.nrows(), *turns)).collect();
        let inertia = block_diagonal(&blocks(|rod| &rod.inertia));
        Self { inertia, stiffness: block_diagonal(&blocks(|rod| &rod.stiffness)), shafts }
    }

    /// Holds a node to what is prescribed for its shaft by a coupling, N·m/rad.
    pub fn couple(&mut self, node: usize, stiffness_n_m_per_rad: f64) {
        self.stiffness[(node, node)] += stiffness_n_m_per_rad;
    }

    /// Turns of every node's shaft to one of the first.
    fn turns(&self) -> DVector<f64> {
        let all = self.shafts.iter().flat_map(|(n, turns)| std::iter::repeat_n(*turns, *n));
        DVector::from_iterator(self.inertia.nrows(), all)
    }

    /// Inertia of the whole, kg·m².
    #[must_use]
    pub fn whole_kg_m2(&self) -> f64 {
        self.inertia.sum()
    }

    /// The stiffness with a mesh of `held_n_per_m` that these arms push.
    fn held(&self, arms: &[Arm], held_n_per_m: f64) -> DMatrix<f64> {
        let mut stiffness = self.stiffness.clone();
        for (a, radius_a) in arms {
            for (b, radius_b) in arms {
                stiffness[(*a, *b)] += held_n_per_m * radius_a * radius_b;
            }
        }
        stiffness
    }

    /// Shapes up to `highest_rad_per_s` (2 to `most`) and one static shape for each node that a mesh
    /// of `held_n_per_m` holds.
    ///
    /// # Errors
    ///
    /// [`BasisError::Free`] if it is held by nothing.
    pub fn basis(
        &self,
        arms: &[Arm],
        held_n_per_m: f64,
        highest_rad_per_s: f64,
        most: usize,
    ) -> Result<Basis, BasisError> {
        let n = self.inertia.nrows();
        let plane = angles(self.inertia.clone(), self.held(arms, held_n_per_m));
        let most = most.min(n - arms.len()).max(1);
        let all = Basis::new(&plane, most, &[])?;
        let below = all.omega_rad_per_s.iter().take_while(|w| **w < highest_rad_per_s).count();
        let stations: Vec<usize> = arms.iter().map(|(node, _)| *node).collect();
        let wanted = (below + 1).clamp(2, most.max(2)).min(n - arms.len());
        Basis::new(&plane, wanted, &stations)
    }

    /// The shapes of shafts that turn as a whole, held by a mesh of `held_n_per_m` and their couplings.
    ///
    /// # Errors
    ///
    /// [`BasisError::Free`] if one is held by nothing.
    pub fn rigid(&self, arms: &[Arm], held_n_per_m: f64) -> Result<Basis, BasisError> {
        let (n, n_shafts) = (self.inertia.nrows(), self.shafts.len());
        let mut whole = DMatrix::zeros(n, n_shafts);
        let mut first = 0;
        for (shaft, (n_nodes, _)) in self.shafts.iter().enumerate() {
            whole.view_mut((first, shaft), (*n_nodes, 1)).fill(1.0);
            first += n_nodes;
        }
        let reduced = |matrix: &DMatrix<f64>| whole.transpose() * matrix * &whole;
        let plane = angles(reduced(&self.inertia), reduced(&self.held(arms, held_n_per_m)));
        let basis = Basis::new(&plane, n_shafts, &[])?;
        Ok(Basis { shapes: whole * basis.shapes, ..basis })
    }
}

/// Angles that nothing but inertia and stiffness holds, as a plane of one degree of freedom a node.
fn angles(inertia: DMatrix<f64>, stiffness: DMatrix<f64>) -> Plane {
    let n = inertia.nrows();
    Plane {
        nodes_m: vec![0.0; n],
        first_nodes: vec![0],
        mass: inertia,
        shaft_stiffness: stiffness.clone(),
        stiffness,
        gyroscopic: DMatrix::zeros(n, n),
    }
}

impl Torsion {
    /// A torsion without torque.
    #[must_use]
    pub fn new(rod: &Rod, basis: Basis, damping_ratio: f64) -> Self {
        let n = basis.len();
        let inertia = basis.project(&(&rod.inertia * rod.turns()));
        Self { basis, damping: vec![damping_ratio; n], torque: vec![0.0; n], inertia }
    }

    /// Adds a constant torque, N·m counter-clockwise, at a node.
    pub fn add_torque(&mut self, node: usize, torque_n_m: f64) {
        for (sum, phi) in self.torque.iter_mut().zip(self.basis.row(node)) {
            *sum += phi * torque_n_m;
        }
    }

    /// Number of coordinates.
    #[must_use]
    pub fn len(&self) -> usize {
        self.basis.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.basis.is_empty()
    }

    /// The coordinates at rest under the constant torque on the mean stiffness.
    #[must_use]
    pub fn rest(&self) -> Vec<f64> {
        let loads = self.torque.iter().zip(&self.basis.omega_rad_per_s);
        loads.map(|(torque, omega)| torque / (omega * omega)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::rotor::tests::rig;
    use super::*;

    #[test]
    fn a_bare_rod_held_at_one_end_has_its_frequencies() {
        let mut rotor = rig(48);
        rotor.discs.clear();
        let plane = rotor.assemble();
        let rod = Rod::new(&rotor, &plane);
        // Held a million times stiffer than the rod: (2k − 1)·π/2·√(G/ρ)/L.
        let stiff = 1e6 * 500.0 / rotor.length_m;
        let basis = rod.basis(&[(0, 1.0)], stiff, f64::INFINITY, 8).unwrap();
        let shear = 206.842_7e9 / 2.58;
        for (k, found) in [1.0, 3.0, 5.0].into_iter().zip(&basis.omega_rad_per_s) {
            let wave = k * PI / 2.0 / rotor.length_m;
            let exact = wave * (shear / 7833.4_f64).sqrt();
            // Linear elements of length h: (wave·h)²/24, h a twentieth of the shaft at most.
            assert!((found / exact - 1.0).abs() < 4e-3 * k, "{k}: {found} {exact}");
        }
    }

    #[test]
    fn the_whole_shaft_turns_on_the_mesh() {
        let rotor = rig(24);
        let plane = rotor.assemble();
        let rod = Rod::new(&rotor, &plane);
        let discs = 2.0 * rotor.discs[0].polar_kg_m2;
        let bare = PI / 32.0 * rotor.section.diameter_m.powi(4) * 7833.4 * rotor.length_m;
        assert!((rod.whole_kg_m2() / (discs + bare) - 1.0).abs() < 1e-12);
        let soft = 1.0;
        let rigid = rod.rigid(&[(0, 1.0)], soft).unwrap();
        let free = rod.basis(&[(0, 1.0)], soft, f64::INFINITY, 6).unwrap();
        // The rod is some thousand times stiffer than this mesh.
        let ratio = free.omega_rad_per_s[0] / rigid.omega_rad_per_s[0];
        assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
        let mut torsion = Torsion::new(&rod, free, 0.01);
        torsion.add_torque(plane.node_at(rotor.length_m), -2.0);
        let at: f64 = torsion.basis.row(0).iter().zip(torsion.rest()).map(|(a, b)| a * b).sum();
        // The static shape at the mesh makes this exact.
        assert!((at / -2.0 - 1.0).abs() < 1e-9, "{at}");
    }
}
