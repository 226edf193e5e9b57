//! How far a bearing's fault orders may be off when its inside is known within limits.
//!
//! Limits, not standard deviations: a true bearing lies inside. Slip is not part of it. Must not
//! know where the limits come from. Equations K15 and K16 of `docs/theory.md`.

use super::bearing::BearingGeometry;
use super::bearing::FaultOrders;
use super::bearing::MIN_ELEMENTS;
use super::bearing::RotatingRing;

/// Limits of a value relative to the value used: the true one lies in 1 + `low` … 1 + `high` times.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RelativeBand {
    /// ≤ 0, above −1.
    pub low: f64,
    /// ≥ 0.
    pub high: f64,
}

/// The band of each fault order; all zero for a geometry stated by hand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OrderBands {
    /// Cage.
    pub ftf: RelativeBand,
    /// Outer race.
    pub bpfo: RelativeBand,
    /// Inner race.
    pub bpfi: RelativeBand,
    /// Rolling element: BSF and its defect line 2·BSF.
    pub two_bsf: RelativeBand,
}

/// One way the inside of a bearing may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Design {
    /// Nominal geometry.
    pub geometry: BearingGeometry,
    /// How far the number of elements may be off.
    pub elements_pm: u32,
    /// Relative uncertainty of d/D, so of γ at a given contact angle.
    pub gamma_relative: f64,
}

impl RelativeBand {
    /// Whether the value is exact.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.low == 0.0 && self.high == 0.0
    }

    /// The larger of the two limits, without sign.
    #[must_use]
    pub fn widest(&self) -> f64 {
        self.high.max(-self.low)
    }

    /// The band of a value that is off by this band and, independently, by `other` of the result:
    /// (1 + a)(1 + b) − 1 at either end (K16).
    #[must_use]
    pub fn and(&self, other: Self) -> Self {
        let both = |a: f64, b: f64| a + b + a * b;
        Self { low: both(self.low, other.low), high: both(self.high, other.high) }
    }

    /// Widens the band so that it holds `value / nominal`.
    fn include(&mut self, value: f64, nominal: f64) {
        let relative = value / nominal - 1.0;
        self.low = self.low.min(relative);
        self.high = self.high.max(relative);
    }
}

impl OrderBands {
    /// The largest limit of all lines.
    #[must_use]
    pub fn widest(&self) -> f64 {
        [self.ftf, self.bpfo, self.bpfi, self.two_bsf]
            .iter()
            .map(RelativeBand::widest)
            .fold(0.0, f64::max)
    }

    /// Bands around the orders of `nominal` that hold every design in `designs` (K15): each order
    /// at the limits of n and of γ.
    ///
    /// To first order dBPFO/BPFO = dn/n − γ/(1 − γ)·u, dBPFI/BPFI = dn/n + γ/(1 + γ)·u,
    /// dFTF/FTF = −γ/(1 − γ)·u and dBSF/BSF = −(1 + γ²)/(1 − γ²)·u, u = dγ/γ.
    #[must_use]
    pub fn around(nominal: &BearingGeometry, ring: RotatingRing, designs: &[Design]) -> Self {
        let used = nominal.fault_orders(ring);
        let mut bands = Self::default();
        for design in designs {
            for orders in design.extremes(ring) {
                bands.ftf.include(orders.ftf, used.ftf);
                bands.bpfo.include(orders.bpfo, used.bpfo);
                bands.bpfi.include(orders.bpfi, used.bpfi);
                bands.two_bsf.include(orders.bsf, used.bsf);
            }
        }
        bands
    }
}

impl Design {
    /// Orders at the limits of n and γ; every order is monotonous in both. A limit that is no
    /// bearing is left out.
    fn extremes(&self, ring: RotatingRing) -> Vec<FaultOrders> {
        let g = &self.geometry;
        let few = g.elements().saturating_sub(self.elements_pm).max(MIN_ELEMENTS);
        let many = g.elements().saturating_add(self.elements_pm);
        let mut found = Vec::new();
        for factor in [1.0 - self.gamma_relative, 1.0, 1.0 + self.gamma_relative] {
            for elements in [few, g.elements(), many] {
                // The pitch diameter carries the uncertainty, so that elements still fit.
                let made = BearingGeometry::new(
                    elements,
                    g.element_diameter_m(),
                    g.pitch_diameter_m() / factor,
                    g.contact_angle_rad(),
                );
                // One element too many for the pitch circle is none that exists.
                found.extend(made.ok().map(|geometry| geometry.fault_orders(ring)));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn design(elements_pm: u32, gamma_relative: f64) -> Design {
        let geometry = BearingGeometry::new(9, 7.938e-3, 38.5e-3, 0.0).unwrap();
        Design { geometry, elements_pm, gamma_relative }
    }

    #[test]
    fn an_exact_geometry_has_no_band() {
        let exact = design(0, 0.0);
        let bands = OrderBands::around(&exact.geometry, RotatingRing::Inner, &[exact]);
        assert!(bands.widest() < 1e-12, "roundings alone: {bands:?}");
    }

    #[test]
    fn an_element_more_or_less_moves_the_races_by_its_part() {
        let bands =
            OrderBands::around(&design(1, 0.0).geometry, RotatingRing::Inner, &[design(1, 0.0)]);
        for band in [bands.bpfo, bands.bpfi] {
            assert!((band.high - 1.0 / 9.0).abs() < 1e-12 && (band.low + 1.0 / 9.0).abs() < 1e-12);
        }
        assert!(bands.ftf.widest() < 1e-12 && bands.two_bsf.widest() < 1e-12);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn small_bands_follow_the_derivatives(
            elements in 5_u32..20,
            fill in 0.4_f64..0.9,
            angle_rad in 0.0_f64..0.7,
            u in 1e-5_f64..1e-3,
        ) {
            let d = fill * std::f64::consts::PI / f64::from(elements) * 0.1;
            let geometry = BearingGeometry::new(elements, d, 0.1, angle_rad).unwrap();
            let design = Design { geometry, elements_pm: 0, gamma_relative: u };
            let bands = OrderBands::around(&geometry, RotatingRing::Inner, &[design]);
            let gamma = geometry.gamma();
            // The second order is at most u²/(1 − γ)², γ < 0.6 here.
            let close = |found: f64, expected: f64| (found - expected).abs() <= 10.0 * u * u;
            prop_assert!(close(bands.bpfo.high, gamma / (1.0 - gamma) * u));
            prop_assert!(close(bands.bpfi.high, gamma / (1.0 + gamma) * u));
            prop_assert!(close(bands.ftf.high, gamma / (1.0 - gamma) * u));
            let spin = (1.0 + gamma * gamma) / (1.0 - gamma * gamma) * u;
            prop_assert!(close(bands.two_bsf.high, spin) && close(bands.two_bsf.low, -spin));
        }
    }
}
