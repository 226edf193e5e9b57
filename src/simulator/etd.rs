//! Oscillators under loads that depend on their motion: exponential Runge–Kutta of fourth order
//! (ETDRK4, Cox & Matthews 2002; equation R9).
//!
//! The oscillators themselves are propagated exactly, whatever the step; only the load is
//! approximated. The caller lays steps so that the load is smooth inside each.

use std::collections::BTreeMap;

/// What pushes the coordinates, beyond their own stiffness and damping.
pub trait Load {
    /// Writes the force on each coordinate at `time_s`, for displacements `q` and velocities `v`.
    ///
    /// Inside one step the function must be smooth in all its arguments; which side of an edge a
    /// step lies on is set before it.
    fn force(&mut self, time_s: f64, q: &[f64], v: &[f64], out: &mut [f64]);
}

/// q̈ + 2ζω·q̇ + ω²·q = f for each coordinate, ζ < 1, ω > 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Oscillators {
    /// ω, rad/s.
    pub omega_rad_per_s: Vec<f64>,
    /// ζ, part of critical damping.
    pub damping: Vec<f64>,
}

/// Distinct step lengths whose coefficients are kept.
const CACHED_STEPS: usize = 64;

/// Integrator of a set of oscillators; allocates when made and when a step length is new.
#[derive(Debug, Clone)]
pub struct Etdrk4 {
    oscillators: Oscillators,
    cache: BTreeMap<u64, Coefficients>,
    stages: [Vec<f64>; 6],
    forces: [Vec<f64>; 4],
}

/// Linear maps of one step length, one entry a coordinate.
#[derive(Debug, Clone, Default)]
struct Coefficients {
    /// exp(L·h) and exp(L·h/2), as the four entries of each 2×2 block.
    whole: [Vec<f64>; 4],
    half: [Vec<f64>; 4],
    /// h/2·φ₁(L·h/2): effect of a force on displacement and velocity.
    half_force: [Vec<f64>; 2],
    /// Weights of the forces at the start, of the two in the middle, at the end.
    start: [Vec<f64>; 2],
    middle: [Vec<f64>; 2],
    end: [Vec<f64>; 2],
}

impl Etdrk4 {
    /// Makes an integrator.
    ///
    /// # Panics
    ///
    /// If the two lists of the oscillators differ in length.
    #[must_use]
    pub fn new(oscillators: Oscillators) -> Self {
        assert_eq!(oscillators.omega_rad_per_s.len(), oscillators.damping.len());
        let n = oscillators.omega_rad_per_s.len();
        Self {
            oscillators,
            cache: BTreeMap::new(),
            stages: std::array::from_fn(|_| vec![0.0; n]),
            forces: std::array::from_fn(|_| vec![0.0; n]),
        }
    }

    /// Carries `q` and `v` from `time_s` on by `step_s` > 0, and leaves in `start_force` the force
    /// at the start of the step.
    ///
    /// # Panics
    ///
    /// If a slice does not have one entry a coordinate.
    pub fn step(
        &mut self,
        load: &mut impl Load,
        time_s: f64,
        step_s: f64,
        q: &mut [f64],
        v: &mut [f64],
    ) {
        let n = self.oscillators.omega_rad_per_s.len();
        assert!(q.len() == n && v.len() == n, "one entry a coordinate");
        let key = step_s.to_bits();
        if !self.cache.contains_key(&key) {
            if self.cache.len() >= CACHED_STEPS {
                self.cache.pop_first();
            }
            self.cache.insert(key, Coefficients::new(&self.oscillators, step_s));
        }
        let Some(map) = self.cache.get(&key) else { return };
        let [qa, va, qb, vb, qc, vc] = &mut self.stages;
        let [f0, fa, fb, fc] = &mut self.forces;
        let middle_s = time_s + 0.5 * step_s;
        load.force(time_s, q, v, f0);
        map.half_step((q, v), f0, (qa, va));
        load.force(middle_s, qa, va, fa);
        map.half_step((q, v), fa, (qb, vb));
        load.force(middle_s, qb, vb, fb);
        for i in 0..n {
            fc[i] = 2.0 * fb[i] - f0[i];
        }
        map.half_step((qa, va), fc, (qc, vc));
        load.force(time_s + step_s, qc, vc, fc);
        map.whole_step([f0, fa, fb, fc], q, v);
    }

    /// Force at the start of the last step.
    #[must_use]
    pub fn start_force(&self) -> &[f64] {
        &self.forces[0]
    }

    /// The oscillators.
    #[must_use]
    pub fn oscillators(&self) -> &Oscillators {
        &self.oscillators
    }
}

impl Coefficients {
    fn new(oscillators: &Oscillators, step_s: f64) -> Self {
        let mut map = Self::default();
        for (&omega, &zeta) in oscillators.omega_rad_per_s.iter().zip(&oscillators.damping) {
            let block = Block { omega, zeta };
            let push = |into: &mut [Vec<f64>], values: &[f64]| {
                for (list, value) in into.iter_mut().zip(values) {
                    list.push(*value);
                }
            };
            push(&mut map.whole, &block.matrix(Complex::phi(0, block.eigenvalue(step_s))));
            let half = block.eigenvalue(0.5 * step_s);
            push(&mut map.half, &block.matrix(Complex::phi(0, half)));
            push(&mut map.half_force, &block.column(Complex::phi(1, half), 0.5 * step_s));
            let z = block.eigenvalue(step_s);
            let [one, two, three] = [1, 2, 3].map(|k| Complex::phi(k, z));
            let sum = |a: f64, b: f64, c: f64| one.times(a).plus(two.times(b)).plus(three.times(c));
            push(&mut map.start, &block.column(sum(1.0, -3.0, 4.0), step_s));
            push(&mut map.middle, &block.column(sum(0.0, 2.0, -4.0), step_s));
            push(&mut map.end, &block.column(sum(0.0, -1.0, 4.0), step_s));
        }
        map
    }

    fn half_step(
        &self,
        (q, v): (&[f64], &[f64]),
        force: &[f64],
        (q_out, v_out): (&mut [f64], &mut [f64]),
    ) {
        let ([qq, qv, vq, vv], [fq, fv]) = (&self.half, &self.half_force);
        for i in 0..q_out.len() {
            q_out[i] = qq[i] * q[i] + qv[i] * v[i] + fq[i] * force[i];
            v_out[i] = vq[i] * q[i] + vv[i] * v[i] + fv[i] * force[i];
        }
    }

    fn whole_step(&self, [f0, fa, fb, fc]: [&[f64]; 4], q: &mut [f64], v: &mut [f64]) {
        let [qq, qv, vq, vv] = &self.whole;
        for i in 0..q.len() {
            let (q0, v0, fm) = (q[i], v[i], fa[i] + fb[i]);
            let gain = |at: usize| {
                self.start[at][i] * f0[i] + self.middle[at][i] * fm + self.end[at][i] * fc[i]
            };
            q[i] = qq[i] * q0 + qv[i] * v0 + gain(0);
            v[i] = vq[i] * q0 + vv[i] * v0 + gain(1);
        }
    }
}

/// The 2×2 block L = [0, 1; −ω², −2ζω] of one oscillator.
#[derive(Clone, Copy)]
struct Block {
    omega: f64,
    zeta: f64,
}

impl Block {
    /// The upper eigenvalue of L·h.
    fn eigenvalue(self, step_s: f64) -> Complex {
        let damped = self.omega * (1.0 - self.zeta * self.zeta).sqrt();
        Complex(-self.zeta * self.omega * step_s, damped * step_s)
    }

    /// f(L·h) = α·1 + β·L from the value of f at the eigenvalue.
    fn alpha_beta(self, value: Complex) -> (f64, f64) {
        let damped = self.omega * (1.0 - self.zeta * self.zeta).sqrt();
        let beta = value.1 / damped;
        (value.0 + self.zeta * self.omega * beta, beta)
    }

    /// All four entries of f(L·h), row by row.
    fn matrix(self, value: Complex) -> [f64; 4] {
        let (alpha, beta) = self.alpha_beta(value);
        [alpha, beta, -self.omega * self.omega * beta, alpha - 2.0 * self.zeta * self.omega * beta]
    }

    /// The second column of f(L·h), times `scale`: what a force does.
    fn column(self, value: Complex, scale: f64) -> [f64; 2] {
        let [_, upper, _, lower] = self.matrix(value);
        [scale * upper, scale * lower]
    }
}

/// A complex number (re, im).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Complex(pub(super) f64, pub(super) f64);

impl Complex {
    fn plus(self, other: Self) -> Self {
        Self(self.0 + other.0, self.1 + other.1)
    }

    fn times(self, factor: f64) -> Self {
        Self(self.0 * factor, self.1 * factor)
    }

    fn product(self, other: Self) -> Self {
        Self(self.0 * other.0 - self.1 * other.1, self.0 * other.1 + self.1 * other.0)
    }

    fn over(self, other: Self) -> Self {
        let square = other.0 * other.0 + other.1 * other.1;
        self.product(Self(other.0 / square, -other.1 / square))
    }

    /// φ₀ = eᶻ, φₖ₊₁ = (φₖ − 1/k!)/z.
    fn phi(k: u32, z: Self) -> Self {
        let size = z.0.hypot(z.1);
        if k > 0 && size < 1.0 {
            return Self::phi_series(k, z);
        }
        let grown = z.0.exp();
        let mut phi = Self(grown * z.1.cos(), grown * z.1.sin());
        let mut factorial = 1.0;
        for step in 0..k {
            phi = Self(phi.0 - 1.0 / factorial, phi.1).over(z);
            factorial *= f64::from(step + 1);
        }
        phi
    }

    /// Σ zⁿ/(n+k)!: 20 terms are below rounding for |z| < 1.
    fn phi_series(k: u32, z: Self) -> Self {
        let factorial: f64 = (1..=k).map(f64::from).product();
        let (mut term, mut sum) = (Self(1.0 / factorial, 0.0), Self(0.0, 0.0));
        for n in 1..=20_u32 {
            sum = sum.plus(term);
            term = term.product(z).times(1.0 / f64::from(n + k));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    struct Function<F: FnMut(f64, &[f64], &[f64], &mut [f64])>(F);

    impl<F: FnMut(f64, &[f64], &[f64], &mut [f64])> Load for Function<F> {
        fn force(&mut self, time_s: f64, q: &[f64], v: &[f64], out: &mut [f64]) {
            (self.0)(time_s, q, v, out);
        }
    }

    fn one(omega_rad_per_s: f64, damping: f64) -> Etdrk4 {
        Etdrk4::new(Oscillators { omega_rad_per_s: vec![omega_rad_per_s], damping: vec![damping] })
    }

    #[test]
    fn phi_functions_agree_on_both_sides_of_the_switch() {
        for k in 1..=3 {
            for z in [Complex(-0.6, 0.79), Complex(0.0, 0.999), Complex(-0.99, 0.1)] {
                let series = Complex::phi_series(k, z);
                let size = 1.0001 / z.0.hypot(z.1);
                let outside = Complex::phi(k, z.times(size));
                let series_outside = Complex::phi_series(k, z.times(size));
                // Cancellation of three differences of numbers near 1, divided by |z|³ = 1.
                let gap = (outside.0 - series_outside.0).hypot(outside.1 - series_outside.1);
                assert!(gap < 1e-14, "{k} {z:?}: {gap}");
                assert!(series.0.is_finite());
            }
        }
    }

    #[test]
    fn a_free_oscillator_keeps_amplitude_and_phase_for_a_thousand_seconds() {
        let omega = TAU * 117.0;
        let mut plan = one(omega, 0.0);
        let (mut q, mut v) = ([1.0_f64], [0.0_f64]);
        let mut none = Function(|_, _: &[f64], _: &[f64], out: &mut [f64]| out[0] = 0.0);
        let (h, n) = (1e-3, 1_000_000);
        for _ in 0..n {
            plan.step(&mut none, 0.0, h, &mut q, &mut v);
        }
        let amplitude = q[0].hypot(v[0] / omega);
        let phase = (-v[0] / omega).atan2(q[0]);
        let exact = (omega * h * f64::from(n)).rem_euclid(TAU);
        let lag = (phase - exact + std::f64::consts::PI).rem_euclid(TAU) - std::f64::consts::PI;
        // 1e6 roundings of the four entries add up to at most 1e6·2e-16.
        assert!((amplitude - 1.0).abs() < 1e-9, "{amplitude}");
        assert!(lag.abs() / 1000.0 < 1e-9, "{lag}");
    }

    #[test]
    fn a_mass_on_a_hertz_spring_has_its_frequency() {
        // 1 kg on K = 9.239e9 under 26 N: 703.995 Hz, falling with amplitude (independent reference).
        let (k, load) = (9.239e9_f64, 26.0);
        let rest = (load / k).powf(2.0 / 3.0);
        let stiffness = 1.5 * k * rest.sqrt();
        let omega = stiffness.sqrt();
        assert!((omega / TAU - 703.995).abs() < 1e-3, "{}", omega / TAU);
        for (amplitude, ratio) in
            [(0.1, 0.999_59), (0.5, 0.989_84), (0.9, 0.964_11), (1.0, 0.953_10)]
        {
            let mut spring = Function(|_, q: &[f64], _: &[f64], out: &mut [f64]| {
                let approach = q[0].max(0.0);
                out[0] = load - k * approach * approach.sqrt() + stiffness * q[0];
            });
            let mut plan = one(omega, 0.0);
            // Released from the unloading side; half a period later the velocity changes its sign.
            let (mut q, mut v) = ([rest * (1.0 - amplitude)], [0.0]);
            let (h, mut t, mut crossings) = (2e-6, 0.0, Vec::new());
            while crossings.len() < 21 {
                let before = v[0];
                plan.step(&mut spring, t, h, &mut q, &mut v);
                if before < 0.0 && v[0] >= 0.0 {
                    crossings.push(t + h * before / (before - v[0]));
                }
                t += h;
            }
            let frequency = 20.0 / (crossings[20] - crossings[0]);
            let found = frequency / (omega / TAU);
            // The reference is given to five decimals; linear interpolation of the crossing adds 1e-7.
            assert!((found - ratio).abs() < 1e-5, "{amplitude}: {found} {ratio}");
        }
    }

    #[test]
    fn parametric_resonance_grows_as_mathieu_says() {
        let omega = TAU * 100.0;
        // ε, ζ, growth/ω_n by an independent reference, one unit of its last figure
        let table =
            [(0.1, 0.01, 0.014_99, 1e-5), (0.2, 0.03, 0.019_96, 1e-5), (0.2, 0.07, -0.0200, 1e-4)];
        for (epsilon, zeta, growth, figure) in table {
            let mut pump = Function(|t: f64, q: &[f64], _: &[f64], out: &mut [f64]| {
                out[0] = -epsilon * omega * omega * (2.0 * omega * t).cos() * q[0];
            });
            let mut plan = one(omega, zeta);
            let (mut q, mut v) = ([1.0_f64], [-omega]);
            let (steps, h) = (200_u32, TAU / omega / 200.0);
            let mut energy = Vec::new();
            for period in 0..120_u32 {
                energy.push(q[0].hypot(v[0] / omega));
                for step in 0..steps {
                    let t = h * f64::from(period * steps + step);
                    plan.step(&mut pump, t, h, &mut q, &mut v);
                }
            }
            // A whole number of periods apart, after the start has died out.
            let found = (energy[119] / energy[79]).ln() / (40.0 * TAU);
            assert!((found - growth).abs() < figure, "{epsilon} {zeta}: {found} {growth}");
        }
    }

    #[test]
    fn the_error_falls_with_the_fourth_power_of_the_step() {
        let omega = TAU * 100.0;
        let run = |n: u32| {
            let mut load = Function(|t: f64, q: &[f64], v: &[f64], out: &mut [f64]| {
                out[0] = 1e5 * (300.0 * t).sin() - 2e5 * q[0].powi(3) - 40.0 * v[0];
            });
            let (mut plan, mut q, mut v) = (one(omega, 0.01), [0.3_f64], [0.0_f64]);
            let h = 0.02 / f64::from(n);
            for i in 0..n {
                plan.step(&mut load, h * f64::from(i), h, &mut q, &mut v);
            }
            q[0]
        };
        let exact = run(12_800);
        let order = ((run(200) - exact) / (run(400) - exact)).abs().log2();
        assert!((3.7..4.6).contains(&order), "{order}");
    }
}
