//! Rolling bearings and their fault rates.
//!
//! The formulas hold for rolling without slip; a loaded bearing runs up to about 2 % beside them,
//! which is for the reader of a spectrum to search, not for this module to guess.
//! Equations K1–K7 of `docs/theory.md`.

use super::ShaftIndex;
use super::uncertainty::OrderBands;
use crate::units::Hz;

/// Fewest rolling elements that hold a shaft in place.
pub const MIN_ELEMENTS: u32 = 3;

/// Which ring turns with the shaft.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RotatingRing {
    /// Inner ring turns, outer ring stands.
    Inner,
    /// Outer ring turns, inner ring stands.
    Outer,
}

/// Why a set of dimensions is no bearing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// Too few rolling elements.
    #[error("{elements} rolling elements, at least {MIN_ELEMENTS} are needed")]
    TooFewElements {
        /// As given.
        elements: u32,
    },
    /// A diameter is not a positive, finite length.
    #[error("{name} diameter {diameter_m} m is not a positive length")]
    Diameter {
        /// `element` or `pitch`.
        name: &'static str,
        /// As given, m.
        diameter_m: f64,
    },
    /// The contact angle is outside 0 ≤ φ < π/2.
    #[error("contact angle {angle_rad} rad lies outside 0 to below π/2")]
    ContactAngle {
        /// As given, rad.
        angle_rad: f64,
    },
    /// d/D·cos φ ≥ 1: the elements would reach past the axis.
    #[error(
        "d/D·cos φ = {gamma:.4} is not below 1, the elements are too large for the pitch circle"
    )]
    ElementsTooLarge {
        /// γ = d/D·cos φ.
        gamma: f64,
    },
    /// n·d > π·D: the elements side by side are longer than the pitch circle.
    #[error(
        "{elements} elements side by side take {needed_m:.6} m of a pitch circle of {available_m:.6} m"
    )]
    ElementsDoNotFit {
        /// n.
        elements: u32,
        /// n·d, m.
        needed_m: f64,
        /// π·D, m.
        available_m: f64,
    },
}

/// Internal geometry of a rolling bearing; constructed only through [`BearingGeometry::new`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BearingGeometry {
    elements: u32,
    element_diameter_m: f64,
    pitch_diameter_m: f64,
    contact_angle_rad: f64,
}

/// Fault orders of a bearing: rates divided by the speed of the ring that turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultOrders {
    /// Cage: FTF.
    pub ftf: f64,
    /// Outer race: BPFO.
    pub bpfo: f64,
    /// Inner race: BPFI.
    pub bpfi: f64,
    /// Ball spin: BSF. The defect line of a rolling element is [`FaultOrders::two_bsf`].
    pub bsf: f64,
}

/// Fault rates of a bearing at given ring speeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultRates {
    /// Cage: FTF; negative when the cage turns against the positive sense of the ring speeds.
    pub ftf: Hz,
    /// Outer race: BPFO.
    pub bpfo: Hz,
    /// Inner race: BPFI.
    pub bpfi: Hz,
    /// Ball spin: BSF. The defect line of a rolling element is [`FaultRates::two_bsf`].
    pub bsf: Hz,
}

/// One bearing of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Bearing {
    /// Identifier.
    pub id: String,
    /// Shaft it carries.
    pub shaft: ShaftIndex,
    /// Maker's designation as written.
    pub catalogue: Option<String>,
    /// Geometry: as stated, else the catalogue's; `None` when neither is known.
    pub geometry: Option<BearingGeometry>,
    /// Limits of the fault orders around those of the geometry; zero for one stated by hand.
    pub bands: OrderBands,
    /// Which ring turns.
    pub rotating_ring: RotatingRing,
}

impl BearingGeometry {
    /// Checks the dimensions: n elements of diameter d on pitch diameter D, contact angle φ.
    ///
    /// # Errors
    ///
    /// [`GeometryError`] for fewer than 3 elements, lengths that are not positive and finite, an
    /// angle outside 0 ≤ φ < π/2, d/D·cos φ ≥ 1 (K1), or elements that do not fit side by side on
    /// the pitch circle (K7).
    pub fn new(
        elements: u32,
        element_diameter_m: f64,
        pitch_diameter_m: f64,
        contact_angle_rad: f64,
    ) -> Result<Self, GeometryError> {
        if elements < MIN_ELEMENTS {
            return Err(GeometryError::TooFewElements { elements });
        }
        for (name, diameter_m) in [("element", element_diameter_m), ("pitch", pitch_diameter_m)] {
            if !(diameter_m.is_finite() && diameter_m > 0.0) {
                return Err(GeometryError::Diameter { name, diameter_m });
            }
        }
        if !(0.0..std::f64::consts::FRAC_PI_2).contains(&contact_angle_rad) {
            return Err(GeometryError::ContactAngle { angle_rad: contact_angle_rad });
        }
        let geometry = Self { elements, element_diameter_m, pitch_diameter_m, contact_angle_rad };
        let gamma = geometry.gamma();
        if gamma >= 1.0 {
            return Err(GeometryError::ElementsTooLarge { gamma });
        }
        let needed_m = f64::from(elements) * element_diameter_m;
        let available_m = std::f64::consts::PI * pitch_diameter_m;
        if needed_m > available_m {
            return Err(GeometryError::ElementsDoNotFit { elements, needed_m, available_m });
        }
        Ok(geometry)
    }

    /// Number of rolling elements n.
    #[must_use]
    pub fn elements(&self) -> u32 {
        self.elements
    }

    /// Rolling-element diameter d, m.
    #[must_use]
    pub fn element_diameter_m(&self) -> f64 {
        self.element_diameter_m
    }

    /// Pitch diameter D, m.
    #[must_use]
    pub fn pitch_diameter_m(&self) -> f64 {
        self.pitch_diameter_m
    }

    /// Contact angle φ, rad.
    #[must_use]
    pub fn contact_angle_rad(&self) -> f64 {
        self.contact_angle_rad
    }

    /// γ = d/D·cos φ, 0 < γ < 1 (K1).
    #[must_use]
    pub fn gamma(&self) -> f64 {
        self.element_diameter_m / self.pitch_diameter_m * self.contact_angle_rad.cos()
    }

    /// Fault rates at ring speeds f_i (inner) and f_o (outer), both counted in one sense (K2–K5).
    ///
    /// BPFO, BPFI and BSF depend on |f_i − f_o| alone and are never negative.
    /// Source: Harris & Kotzalas, *Rolling Bearing Analysis*, kinematics of a bearing with both
    /// rings turning.
    #[must_use]
    pub fn fault_rates(&self, inner: Hz, outer: Hz) -> FaultRates {
        let gamma = self.gamma();
        let relative = (inner.0 - outer.0).abs();
        let half_n = 0.5 * f64::from(self.elements);
        let spin = self.pitch_diameter_m / (2.0 * self.element_diameter_m);
        FaultRates {
            ftf: Hz(0.5 * (inner.0 * (1.0 - gamma) + outer.0 * (1.0 + gamma))),
            bpfo: Hz(half_n * (1.0 - gamma) * relative),
            bpfi: Hz(half_n * (1.0 + gamma) * relative),
            bsf: Hz(spin * (1.0 - gamma * gamma) * relative),
        }
    }

    /// Fault orders of the shaft when one ring stands: [`Self::fault_rates`] at 1 Hz (K2–K5).
    #[must_use]
    pub fn fault_orders(&self, rotating: RotatingRing) -> FaultOrders {
        let rates = match rotating {
            RotatingRing::Inner => self.fault_rates(Hz(1.0), Hz(0.0)),
            RotatingRing::Outer => self.fault_rates(Hz(0.0), Hz(1.0)),
        };
        FaultOrders { ftf: rates.ftf.0, bpfo: rates.bpfo.0, bpfi: rates.bpfi.0, bsf: rates.bsf.0 }
    }
}

impl FaultOrders {
    /// Defect order of a rolling element, 2·BSF: it strikes both races in one turn (K6).
    #[must_use]
    pub fn two_bsf(&self) -> f64 {
        2.0 * self.bsf
    }
}

impl FaultRates {
    /// Defect rate of a rolling element, 2·BSF: it strikes both races in one turn (K6).
    #[must_use]
    pub fn two_bsf(&self) -> Hz {
        Hz(2.0 * self.bsf.0)
    }
}

impl Bearing {
    /// Fault orders of its shaft; `None` while the geometry is unknown.
    #[must_use]
    pub fn fault_orders(&self) -> Option<FaultOrders> {
        self.geometry.map(|geometry| geometry.fault_orders(self.rotating_ring))
    }

    /// Fault rates at a speed of its shaft, the other ring standing; `None` while the geometry is
    /// unknown.
    #[must_use]
    pub fn fault_rates(&self, shaft_speed: Hz) -> Option<FaultRates> {
        self.geometry.map(|geometry| match self.rotating_ring {
            RotatingRing::Inner => geometry.fault_rates(shaft_speed, Hz(0.0)),
            RotatingRing::Outer => geometry.fault_rates(Hz(0.0), shaft_speed),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn skf_6205() -> BearingGeometry {
        BearingGeometry::new(9, 7.94e-3, 39.04e-3, 0.0).unwrap()
    }

    #[test]
    fn skf_6205_has_its_published_orders() {
        let orders = skf_6205().fault_orders(RotatingRing::Inner);
        // Published to four decimals: half a unit of the last one. 4.7135 is 2·BSF, not BSF.
        let close = |value: f64, published: f64| (value - published).abs() < 5e-5;
        assert!(close(orders.ftf, 0.3983), "{}", orders.ftf);
        assert!(close(orders.bpfo, 3.5848), "{}", orders.bpfo);
        assert!(close(orders.bpfi, 5.4152), "{}", orders.bpfi);
        assert!(close(orders.two_bsf(), 4.7135), "{}", orders.two_bsf());
    }

    #[test]
    fn rig_bearing_has_the_rates_of_its_source() {
        let rig = BearingGeometry::new(11, 7.9375e-3, 33.5e-3, 0.0).unwrap();
        let orders = rig.fault_orders(RotatingRing::Inner);
        // "f/2.62" and "6.80·f" are given to three figures.
        assert!((1.0 / orders.ftf - 2.62).abs() < 5e-3, "{}", orders.ftf);
        assert!((orders.bpfi - 6.80).abs() < 5e-3, "{}", orders.bpfi);
    }

    #[test]
    fn turning_the_outer_ring_changes_the_cage_alone() {
        let inner = skf_6205().fault_orders(RotatingRing::Inner);
        let outer = skf_6205().fault_orders(RotatingRing::Outer);
        assert_eq!((inner.bpfo, inner.bpfi, inner.bsf), (outer.bpfo, outer.bpfi, outer.bsf));
        // The cage moves at the mean of the two contact speeds: ½(1+γ) instead of ½(1−γ).
        assert!((inner.ftf + outer.ftf - 1.0).abs() < 1e-15);
        assert!(outer.ftf > 0.5 && inner.ftf < 0.5);
    }

    #[test]
    fn impossible_dimensions_are_refused_with_their_reason() {
        let new = BearingGeometry::new;
        assert_eq!(new(2, 1e-3, 1e-2, 0.0), Err(GeometryError::TooFewElements { elements: 2 }));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = new(9, bad, 1e-2, 0.0).unwrap_err();
            assert!(matches!(error, GeometryError::Diameter { name: "element", .. }));
            let error = new(9, 1e-3, bad, 0.0).unwrap_err();
            assert!(matches!(error, GeometryError::Diameter { name: "pitch", .. }));
        }
        for bad in [-0.1, std::f64::consts::FRAC_PI_2, f64::NAN] {
            let error = new(9, 1e-3, 1e-2, bad).unwrap_err();
            assert!(matches!(error, GeometryError::ContactAngle { .. }));
        }
        assert!(matches!(new(3, 1e-2, 1e-2, 0.0), Err(GeometryError::ElementsTooLarge { .. })));
        assert!(matches!(new(13, 1e-2, 4e-2, 0.0), Err(GeometryError::ElementsDoNotFit { .. })));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn every_element_passes_either_race_once_a_relative_turn(
            elements in 3_u32..60,
            fill in 0.05_f64..0.99,
            pitch_m in 1e-3_f64..5.0,
            angle_rad in 0.0_f64..1.5,
            inner in -200.0_f64..200.0,
            outer in -200.0_f64..200.0,
        ) {
            let n = f64::from(elements);
            let diameter_m = fill * pitch_m * (std::f64::consts::PI / n).min(0.99);
            let bearing =
                BearingGeometry::new(elements, diameter_m, pitch_m, angle_rad).unwrap();
            let rates = bearing.fault_rates(Hz(inner), Hz(outer));
            let relative = (inner - outer).abs();
            // A handful of roundings of terms no larger than n·400 Hz.
            let tolerance = 1e-12 * n * (inner.abs() + outer.abs());
            prop_assert!((rates.bpfo.0 + rates.bpfi.0 - n * relative).abs() <= tolerance);
            // Seen from the cage: each race passes n elements a turn of that race.
            prop_assert!((rates.bpfo.0 - n * (rates.ftf.0 - outer).abs()).abs() <= tolerance);
            prop_assert!((rates.bpfi.0 - n * (inner - rates.ftf.0).abs()).abs() <= tolerance);
        }
    }
}
