//! Shaft lines: 1×, 2×, 3× amplitude at the exact frequency, for every shaft a channel can see.

use super::Feature;
use crate::dsp::line;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// Shaft orders read.
pub const ORDERS: [u8; 3] = [1, 2, 3];

/// Name of the feature "amplitude at `order` × `shaft`".
#[must_use]
pub fn line_name(order: u8, shaft: &str) -> String {
    format!("line_{order}x_{shaft}")
}

/// Name of the feature "mean CWT magnitude at the speed of `shaft`".
#[must_use]
pub fn cwt_name(shaft: &str) -> String {
    format!("cwt_1x_{shaft}")
}

/// Name of the feature "mean CWT magnitude at the mesh frequency of `gear`".
#[must_use]
pub fn cwt_mesh_name(gear: &str) -> String {
    format!("cwt_mesh_{gear}")
}

/// Reads 1×, 2×, 3× of a shaft (zero-to-peak, exact frequency); lines that the window or the
/// sampling cannot show are left out.
#[must_use]
pub fn lines(x: &[f32], sample_rate: Hz, shaft: &str, speed: Hz, unit: Unit) -> Vec<Feature> {
    ORDERS
        .iter()
        .filter_map(|order| {
            let read = line::line_at(x, sample_rate.0, speed.0 * f64::from(*order))?;
            Some(Feature { name: Arc::from(line_name(*order, shaft)), value: read.amplitude, unit })
        })
        .collect()
}
