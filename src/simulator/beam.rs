//! Timoshenko shaft elements of one plane (equation R5).
//!
//! Degrees of freedom of an element: (u₁, u₁′, u₂, u₂′), displacement in m and slope in rad at its
//! two ends; the same matrices serve both planes. Must not know where the element stands.

/// 4×4 matrix of an element, row by row.
pub type ElementMatrix = [[f64; 4]; 4];

/// A uniform round shaft section.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Outer diameter, m.
    pub diameter_m: f64,
    /// Young's modulus, Pa.
    pub young_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Density, kg/m³.
    pub density_kg_per_m3: f64,
}

impl Section {
    /// Cross-section, m².
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        std::f64::consts::FRAC_PI_4 * self.diameter_m * self.diameter_m
    }

    /// Second moment of area about a diameter, m⁴.
    #[must_use]
    pub fn second_moment_m4(&self) -> f64 {
        std::f64::consts::PI / 64.0 * self.diameter_m.powi(4)
    }

    /// Cowper's shear coefficient of a solid round section (Cowper 1966).
    #[must_use]
    pub fn shear_coefficient(&self) -> f64 {
        6.0 * (1.0 + self.poisson) / (7.0 + 6.0 * self.poisson)
    }

    /// Ratio of shear to bending flexibility Φ = 12EI/(κGAL²) of a length L in m.
    fn shear_ratio(&self, length_m: f64) -> f64 {
        let shear_pa = self.young_pa / (2.0 * (1.0 + self.poisson));
        12.0 * self.young_pa * self.second_moment_m4()
            / (self.shear_coefficient() * shear_pa * self.area_m2() * length_m * length_m)
    }

    /// Stiffness, N/m and so on.
    #[must_use]
    pub fn stiffness(&self, length_m: f64) -> ElementMatrix {
        let (l, phi) = (length_m, self.shear_ratio(length_m));
        let scale = self.young_pa * self.second_moment_m4() / (l.powi(3) * (1.0 + phi));
        let (near, far) = ((4.0 + phi) * l * l, (2.0 - phi) * l * l);
        scaled(
            scale,
            [
                [12.0, 6.0 * l, -12.0, 6.0 * l],
                [6.0 * l, near, -6.0 * l, far],
                [-12.0, -6.0 * l, 12.0, -6.0 * l],
                [6.0 * l, far, -6.0 * l, near],
            ],
        )
    }

    /// Consistent mass, translation and rotation, kg and so on.
    #[must_use]
    pub fn mass(&self, length_m: f64) -> ElementMatrix {
        let (l, phi) = (length_m, self.shear_ratio(length_m));
        let square = phi * phi;
        let scale =
            self.density_kg_per_m3 * self.area_m2() * l / (840.0 * (1.0 + phi) * (1.0 + phi));
        let m1 = 312.0 + 588.0 * phi + 280.0 * square;
        let m2 = (44.0 + 77.0 * phi + 35.0 * square) * l;
        let m3 = 108.0 + 252.0 * phi + 140.0 * square;
        let m4 = -(26.0 + 63.0 * phi + 35.0 * square) * l;
        let m5 = (8.0 + 14.0 * phi + 7.0 * square) * l * l;
        let m6 = -(6.0 + 14.0 * phi + 7.0 * square) * l * l;
        let translation = scaled(
            scale,
            [[m1, m2, m3, m4], [m2, m5, -m4, m6], [m3, -m4, m1, -m2], [m4, m6, -m2, m5]],
        );
        let rotation = self.rotary(length_m);
        std::array::from_fn(|i| std::array::from_fn(|j| translation[i][j] + rotation[i][j]))
    }

    /// Rotary inertia of the section about a diameter, kg and so on; twice this is the gyroscopic
    /// matrix, since a round section has twice the polar inertia.
    #[must_use]
    pub fn rotary(&self, length_m: f64) -> ElementMatrix {
        let (l, phi) = (length_m, self.shear_ratio(length_m));
        let scale = self.density_kg_per_m3 * self.second_moment_m4()
            / (30.0 * (1.0 + phi) * (1.0 + phi) * l);
        let m8 = (3.0 - 15.0 * phi) * l;
        let m9 = (4.0 + 5.0 * phi + 10.0 * phi * phi) * l * l;
        let m10 = (-1.0 - 5.0 * phi + 5.0 * phi * phi) * l * l;
        scaled(
            scale,
            [
                [36.0, m8, -36.0, m8],
                [m8, m9, -m8, m10],
                [-36.0, -m8, 36.0, -m8],
                [m8, m10, -m8, m9],
            ],
        )
    }
}

fn scaled(scale: f64, matrix: ElementMatrix) -> ElementMatrix {
    matrix.map(|row| row.map(|value| value * scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steel() -> Section {
        Section {
            diameter_m: 0.015_875,
            young_pa: 206.842_7e9,
            poisson: 0.29,
            density_kg_per_m3: 7833.4,
        }
    }

    fn times(matrix: &ElementMatrix, u: [f64; 4]) -> [f64; 4] {
        std::array::from_fn(|i| (0..4).map(|j| matrix[i][j] * u[j]).sum())
    }

    #[test]
    fn rigid_motions_cost_no_energy_and_carry_the_mass() {
        let (section, l) = (steel(), 0.1);
        let (shift, turn) = ([1.0, 0.0, 1.0, 0.0], [0.0, 1.0, l, 1.0]);
        let stiffness = section.stiffness(l);
        for u in [shift, turn] {
            let force = times(&stiffness, u);
            // Rounding of sums of terms of the size of the largest entry.
            assert!(force.iter().all(|f| f.abs() < 1e-9 * stiffness[0][0]), "{force:?}");
        }
        let mass = times(&section.mass(l), shift);
        let total = section.density_kg_per_m3 * section.area_m2() * l;
        assert!((mass[0] + mass[2] - total).abs() < 1e-12 * total);
        // Rotation about the end: ρAL³/3 and the rotary inertia ρIL.
        let inertia: f64 = times(&section.mass(l), turn).iter().zip(turn).map(|(f, u)| f * u).sum();
        let rod = total * l * l / 3.0 + section.density_kg_per_m3 * section.second_moment_m4() * l;
        assert!((inertia / rod - 1.0).abs() < 1e-12, "{inertia} {rod}");
    }

    #[test]
    fn a_cantilever_bends_and_shears_as_timoshenko_says() {
        let (section, l, force_n) = (steel(), 0.05, 10.0);
        let k = section.stiffness(l);
        // Clamp the first end; solve the 2×2 of the second.
        let det = k[2][2] * k[3][3] - k[2][3] * k[3][2];
        let tip = force_n * k[3][3] / det;
        let shear_pa = section.young_pa / (2.0 * 1.29);
        let expected = force_n * l.powi(3) / (3.0 * section.young_pa * section.second_moment_m4())
            + force_n * l / (section.shear_coefficient() * shear_pa * section.area_m2());
        assert!((tip / expected - 1.0).abs() < 1e-12, "{tip} {expected}");
    }
}
