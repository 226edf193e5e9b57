//! Full spectrum at the shaft's own orders: what of a probe pair's orbit turns with the shaft and what against it.
//!
//! An unbalance or a bow on equal supports turns forward in a circle; supports that differ flatten the orbit, a load that
//! presses a shaft to one side does so at 2× too, a rub turns it back. Must not know what is too much.

use super::Feature;
use super::trace::Trace;
use crate::dsp::full_spectrum::Orbit;
use crate::dsp::line;
use crate::machine::Machine;
use crate::machine::shaft::Rotation;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// Orders whose orbits are read.
const ORDERS: [u8; 2] = [1, 2];

/// Name of the feature "radius of what turns forward (else backward) at `order` × `shaft`".
#[must_use]
pub fn name(forward: bool, order: u8, shaft: &str) -> String {
    let sense = if forward { "forward" } else { "backward" };
    format!("{sense}_{order}x_{shaft}")
}

/// Radii of the forward and the backward part (F19) at 1× and 2× of the shaft that a pair of probes looks at; none where the sense of
/// its rotation is not stated, or a line cannot be read.
pub(super) fn parts(
    machine: &Machine,
    (x, y): (&Trace<'_>, &Trace<'_>),
    unit: Unit,
    first: Hz,
) -> Vec<Feature> {
    let Some(shaft) = machine.shaft_at(&machine.sensors[x.sensor]) else { return Vec::new() };
    let described = machine.shaft(shaft);
    let (Some(speed), Some(rotation)) = (machine.shaft_speed(shaft, first), described.rotation)
    else {
        return Vec::new();
    };
    let at_order = |order: u8| {
        let hz = f64::from(order) * speed.0;
        let of_x = line::line_at(&x.samples, x.rate.0, hz)?;
        let of_y = line::line_at(&y.samples, y.rate.0, hz)?;
        let orbit = Orbit::of_lines(of_x, of_y);
        let (forward, backward) = match rotation {
            Rotation::Ccw => (orbit.counter_clockwise, orbit.clockwise),
            Rotation::Cw => (orbit.clockwise, orbit.counter_clockwise),
        };
        let feature = |is_forward: bool, value: f64| {
            let name = Arc::from(name(is_forward, order, &described.id));
            Feature { name, value, unit }
        };
        Some([feature(true, forward), feature(false, backward)])
    };
    ORDERS.into_iter().filter_map(at_order).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::real::Real;
    use crate::features::ChannelWindow;
    use crate::features::Extractor;
    use crate::features::Window;
    use crate::features::speed::SpeedHints;
    use crate::machine::file;
    use crate::signal::ChannelInfo;
    use std::f64::consts::TAU;

    /// Forward and backward radii that are read of a pair on a shaft of this rotation.
    fn read(rotation: &str) -> Vec<Option<f64>> {
        let text = format!(
            "[machine]\nid = \"m\"\n[[shaft]]\nid = \"s\"\nspeed_hz = 25.0\n{rotation}\n\
             [[sensor]]\nchannel = \"y\"\nkind = \"proximitor\"\nunit = \"um\"\nat = {{ shaft = \"s\" }}\naxis_deg = 90.0\n\
             [[sensor]]\nchannel = \"x\"\nkind = \"proximitor\"\nunit = \"um\"\nat = {{ shaft = \"s\" }}\naxis_deg = 0.0\n"
        );
        let machine = Arc::new(file::parse(&text, "m.toml").unwrap());
        let channels = ["y", "x"].map(|name| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(2000.0),
            unit: Unit::Micrometre,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        });
        // 1×: radii 20 counter-clockwise and 5 clockwise; 2×: 3 and 4; by 0.3 and 1.1 rad askew.
        let at = |i: u32| {
            let angle = TAU * 25.0 * f64::from(i) / 2000.0;
            let turn = |radius: f64, angle: f64| (radius * angle.cos(), radius * angle.sin());
            let parts = [
                turn(20.0, angle + 0.3),
                turn(5.0, 1.1 - angle),
                turn(3.0, 2.0 * angle),
                turn(4.0, 0.7 - 2.0 * angle),
            ];
            parts.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
        };
        let x: Vec<f32> = (0..20_000).map(|i| f32::rounded(at(i).0)).collect();
        let y: Vec<f32> = (0..20_000).map(|i| f32::rounded(at(i).1)).collect();
        let run = |samples| Some(ChannelWindow { start: 0, time_s: 0.0, samples });
        let mut extractor =
            Extractor::new(Arc::clone(&machine), channels.to_vec(), SpeedHints::default());
        let window = Window { time_s: (0.0, 10.0), channels: vec![run(&y[..]), run(&x[..])] };
        let features = extractor.extract(&window);
        let of_x = &features.channels[1];
        let names = [(true, 1), (false, 1), (true, 2), (false, 2)];
        names.iter().map(|(forward, order)| of_x.get(&name(*forward, *order, "s"))).collect()
    }

    #[test]
    fn what_turns_with_the_shaft_and_against_it_is_told_apart() {
        let near = |found: Vec<Option<f64>>, expected: [f64; 4]| {
            // Samples in f32, lines exact: 1e-6 of the largest.
            found.iter().zip(expected).all(|(f, e)| f.is_some_and(|f| (f - e).abs() < 1e-4))
        };
        assert!(near(read("rotation = \"ccw\""), [20.0, 5.0, 3.0, 4.0]));
        assert!(near(read("rotation = \"cw\""), [5.0, 20.0, 4.0, 3.0]));
        assert_eq!(read(""), [None; 4], "no sense of rotation, no forward");
    }
}
