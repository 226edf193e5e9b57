//! An orbit as JSON, in columns.

use super::finite;
use super::signals::{AngleFrom, Validity};
use crate::dsp::full_spectrum::Orbit;
use schemars::JsonSchema;
use serde::Serialize;
use utoipa::ToSchema;

/// What a pair of sensors sees over whole revolutions of a shaft.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct OrbitWire {
    /// Channel of `x`.
    pub x_channel: String,
    /// Channel of `y`, 90° counter-clockwise from x.
    pub y_channel: String,
    /// Unit of `x` and `y`.
    pub unit: String,
    /// Samples a second, Hz.
    pub sample_rate_hz: Option<f64>,
    /// The shaft.
    pub shaft: String,
    /// Its mean speed over these revolutions, Hz.
    pub shaft_speed_hz: Option<f64>,
    /// `ccw` or `cw`, seen from the driver end; null: not stated.
    pub rotation: Option<String>,
    /// Where the angle comes from.
    pub angle_from: AngleFrom,
    /// Whole revolutions there are; fewer than asked for where no more are held.
    pub revolutions: Option<f64>,
    /// First sample used.
    pub start_sample: u64,
    /// Number of samples used.
    pub n_samples: usize,
    /// Whether they can be trusted.
    pub validity: Validity,
    /// Every so many samples is a point.
    pub step: usize,
    /// Stream time, s.
    pub time_s: Vec<Option<f64>>,
    /// Angle of the shaft from the first point on, degrees.
    pub angle_deg: Vec<Option<f64>>,
    /// Motion along x, mean left out.
    pub x: Vec<Option<f64>>,
    /// Motion along y, mean left out.
    pub y: Vec<Option<f64>>,
    /// Points, counted from 0, at which the mark of the shaft passed its probe; empty where there is none.
    pub marks: Vec<usize>,
    /// The motion at orders of the shaft; those that so few revolutions allow to read.
    pub ellipses: Vec<EllipseWire>,
}

/// The ellipse at one order.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct EllipseWire {
    /// Order of the shaft.
    pub order: u8,
    /// Half length of the long axis, unit of the orbit.
    pub major: Option<f64>,
    /// Half length of the short axis; negative where the point runs clockwise.
    pub minor: Option<f64>,
    /// Direction of the long axis from x towards y, degrees; null for a circle.
    pub inclination_deg: Option<f64>,
    /// Radius of the part that turns counter-clockwise.
    pub counter_clockwise: Option<f64>,
    /// Radius of the part that turns clockwise.
    pub clockwise: Option<f64>,
}

impl EllipseWire {
    /// Makes it of an orbit at one order.
    #[must_use]
    pub fn new(order: u8, orbit: Orbit) -> Self {
        Self {
            order,
            major: finite(orbit.major()),
            minor: finite(orbit.minor()),
            inclination_deg: orbit.inclination_rad.and_then(|rad| finite(rad.to_degrees())),
            counter_clockwise: finite(orbit.counter_clockwise),
            clockwise: finite(orbit.clockwise),
        }
    }
}
