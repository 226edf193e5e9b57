//! One mass: Hertz spring, parametric excitation, long motion without damping, unbalance and bow.

use super::Rows;
use super::rows::Row;
use crate::bench::BenchError;
use crate::bench::gaps::largest;
use crate::simulator::etd::{Etdrk4, Load, Oscillators};
use crate::simulator::linear::{LinearRun, LinearSystem};
use crate::simulator::model::Model;
use crate::simulator::modes::Basis;
use crate::simulator::run::{Quantity, Run, Watch};
use crate::simulator::speed::SpeedProfile;
use nalgebra::DMatrix;
use std::f64::consts::TAU;

const NO_STEADY: BenchError = BenchError::Absent { case: "one mass", what: "steady motion" };

struct Function<F: FnMut(f64, &[f64], &[f64], &mut [f64])>(F);

impl<F: FnMut(f64, &[f64], &[f64], &mut [f64])> Load for Function<F> {
    fn force(&mut self, time_s: f64, q: &[f64], v: &[f64], out: &mut [f64]) {
        (self.0)(time_s, q, v, out);
    }
}

fn one(omega: f64, damping: f64) -> Etdrk4 {
    Etdrk4::new(Oscillators { omega_rad_per_s: vec![omega], damping: vec![damping] })
}

/// 1 kg in both planes.
fn mass(omega: f64, damping: f64, speed_hz: f64) -> Model {
    let basis = Basis {
        omega_rad_per_s: vec![omega],
        shapes: DMatrix::from_element(2, 1, 1.0),
        gyroscopic: DMatrix::zeros(1, 1),
    };
    Model::new(basis, damping, SpeedProfile::Constant(speed_hz))
}

/// A mass on a Hertz spring: its frequency falls with the amplitude.
///
/// # Errors
///
/// [`BenchError`] when it cannot be computed.
pub fn hertz_spring() -> Rows {
    let (factor, load_n) = (9.239e9_f64, 26.0);
    let rest = (load_n / factor).powf(2.0 / 3.0);
    let natural = (1.5 * factor * rest.sqrt()).sqrt();
    let mut rows = vec![Row::new("Hertz: natural frequency, Hz", "", 703.995, natural / TAU, 1e-3)];
    let table = [
        (0.1, 0.999_59),
        (0.5, 0.989_84),
        (0.9, 0.964_11),
        (1.0, 0.953_10),
        (-0.5, 0.987_78),
        (-0.9, 0.939_51),
    ];
    for (amplitude, ratio) in table {
        let mut spring = Function(|_, q: &[f64], _: &[f64], out: &mut [f64]| {
            let approach = q[0].max(0.0);
            out[0] = load_n - factor * approach * approach.sqrt() + natural * natural * q[0];
        });
        let mut plan = one(natural, 0.0);
        let (mut q, mut v) = ([rest * (1.0 - amplitude)], [0.0]);
        let (h, mut t, mut crossings) = (2e-6, 0.0, Vec::new());
        let sign = if amplitude > 0.0 { 1.0 } else { -1.0 };
        while crossings.len() < 21 {
            let before = sign * v[0];
            plan.step(&mut spring, t, h, &mut q, &mut v);
            let after = sign * v[0];
            if before < 0.0 && after >= 0.0 {
                crossings.push(t + h * before / (before - after));
            }
            t += h;
        }
        let found = 20.0 / (crossings[20] - crossings[0]) * TAU / natural;
        // The reference has five decimals; linear interpolation of the crossing adds 1e-7.
        rows.push(Row::new(
            "Hertz: f/f0",
            format!("amplitude/static {amplitude} (+: unloading)"),
            ratio,
            found,
            1e-5,
        ));
        if amplitude < 0.5 && amplitude > 0.0 {
            let series = 1.0 - amplitude * amplitude / 24.0;
            // The next term is of the order a⁴/24.
            rows.push(Row::new("Hertz: 1 − a²/24", "a 0.1", series, found, 1e-5));
        }
    }
    Ok(rows)
}

/// A spring pumped at twice its frequency grows as Mathieu's equation says.
///
/// # Errors
///
/// [`BenchError`] when it cannot be computed.
pub fn pumped_spring() -> Rows {
    let omega = TAU * 100.0;
    let mut rows = Vec::new();
    for (epsilon, zeta, growth, figure) in
        [(0.1, 0.01, 0.014_99, 1e-5), (0.2, 0.03, 0.019_96, 1e-5), (0.2, 0.07, -0.0200, 1e-4)]
    {
        let mut pump = Function(|t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
            out[0] = -epsilon * omega * omega * (2.0 * omega * t).cos() * q[0];
        });
        let mut plan = one(omega, zeta);
        let (mut q, mut v) = ([1.0_f64], [-omega]);
        let (steps, h) = (200_u32, TAU / omega / 200.0);
        let mut size = Vec::new();
        for period in 0..120_u32 {
            size.push(q[0].hypot(v[0] / omega));
            for step in 0..steps {
                let t = h * f64::from(period * steps + step);
                plan.step(&mut pump, t, h, &mut q, &mut v);
            }
        }
        let found = (size[119] / size[79]).ln() / (40.0 * TAU);
        // One unit of the reference's last figure.
        let parameters = format!("ε {epsilon}, ζ {zeta}");
        rows.push(Row::new("Mathieu: growth/ω", parameters, growth, found, figure));
    }
    Ok(rows)
}

/// Motion without damping keeps amplitude and phase.
///
/// # Errors
///
/// [`BenchError`] when it cannot be computed.
pub fn without_damping() -> Rows {
    let omega = TAU * 117.0;
    let watch = Watch { row: vec![1.0], axis_rad: 0.0, quantity: Quantity::Displacement };
    let model = mass(omega, 0.0, 1.0);
    let mut rows = Vec::new();
    // 1 kHz: 117 samples in 0.117 s, the last quarter period tells amplitude and phase.
    for seconds in [10_u32, 1000] {
        let state = (&[1.0, 0.0][..], &[0.0, 0.0][..]);
        let mut run =
            LinearRun::new(&model, 1.0, std::slice::from_ref(&watch), 1000.0, Some(state))
                .ok_or(NO_STEADY)?;
        let mut block = [Vec::new()];
        for _ in 0..seconds {
            run.fill(1000, &mut block);
        }
        let (q, v) = run.state();
        let phase = (-v[0] / omega).atan2(q[0]);
        let lag = (phase - omega * f64::from(seconds) + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
        let parameters = format!("117 Hz, ζ 0, {seconds} s");
        // Rounding of the propagator, 1e-16 a sample, at 1e3 samples a second.
        let amplitude = q[0].hypot(v[0] / omega);
        rows.push(Row::new("light damping: amplitude", &parameters[..], 1.0, amplitude, 1e-9));
        let rate = lag / f64::from(seconds);
        rows.push(Row::below("light damping: phase error, rad/s", parameters, rate, 1e-9));
    }
    Ok(rows)
}

/// (e·r² + δ₀·e^{iβ})/(1 − r² + 2iζr).
fn response(ratio: f64, zeta: f64, bow: f64, beta: f64) -> (f64, f64) {
    let (re, im) = (ratio * ratio + bow * beta.cos(), bow * beta.sin());
    let (low_re, low_im) = (1.0 - ratio * ratio, 2.0 * zeta * ratio);
    let square = low_re * low_re + low_im * low_im;
    ((re * low_re + im * low_im) / square, (im * low_re - re * low_im) / square)
}

/// Unbalance and bow against the closed form of the Jeffcott rotor.
///
/// # Errors
///
/// [`BenchError`] when it cannot be computed.
pub fn unbalance_and_bow() -> Rows {
    let (omega, zeta) = (100.0, 0.05);
    let watch = |axis_rad| Watch { row: vec![1.0], axis_rad, quantity: Quantity::Displacement };
    let mut rows = Vec::new();
    for (case, bow, beta) in
        [("no bow", 0.0, 0.0), ("bow 0.5 at 0°", 0.5, 0.0), ("bow 0.5 at 180°", 0.5, 0.5 * TAU)]
    {
        let loaded = |ratio: f64| {
            let mut model = mass(omega, zeta, ratio * omega / TAU);
            model.shafts[0].unbalance.add(&[1.0], 0.0);
            model.shafts[0].bow.add(&[bow * omega * omega], beta);
            model
        };
        let mut gaps = Vec::new();
        for i in 1..=30_u32 {
            let ratio = 0.1 * f64::from(i);
            let model = loaded(ratio);
            let system = LinearSystem::new(&model, ratio * omega);
            let (q, _) = system.steady(&model).ok_or(NO_STEADY)?.at(&system, 0.0);
            let (re, im) = response(ratio, zeta, bow, beta);
            gaps.push((q[0] - re).hypot(q[1] - im));
        }
        let worst = largest(gaps);
        // Rounding of a solve of 8 unknowns, amplitudes up to 15.
        let range = format!("{case}, r 0.1 to 3");
        rows.push(Row::below("unbalance and bow: exact path", range, worst, 1e-12 * 15.0));
        let published = [10.0, 15.0, 5.0][rows.len() / 2];
        let mut run = Run::new(loaded(1.0), 2e-4, None);
        while run.time_s() < 8.0 {
            run.step();
        }
        run.step();
        let found = run.observe(&watch(0.0)).hypot(run.observe(&watch(0.25 * TAU)));
        // The transient has fallen to 4e-18; (Ω·h)⁴ times a small factor is left.
        rows.push(Row::new(
            "unbalance and bow: steps",
            format!("{case}, r 1"),
            published,
            found,
            1e-8,
        ));
    }
    let model = {
        let mut model = mass(omega, zeta, 0.5_f64.sqrt() * omega / TAU);
        model.shafts[0].unbalance.add(&[1.0], 0.0);
        model.shafts[0].bow.add(&[0.5 * omega * omega], 0.5 * TAU);
        model
    };
    let system = LinearSystem::new(&model, 0.5_f64.sqrt() * omega);
    let (q, _) = system.steady(&model).ok_or(NO_STEADY)?.at(&system, 0.0);
    let cancelled = q[0].hypot(q[1]);
    rows.push(Row::below("unbalance and bow cancel", "β 180°, r 0.7071", cancelled, 1e-12));
    Ok(rows)
}
