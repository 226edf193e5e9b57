//! Oscillators under load by extrapolation of the modified midpoint rule with control of order and
//! step (Gragg, Bulirsch & Stoer 1966; equation R30).
//!
//! It takes nothing of the motion to be known, stiffness and damping included, so that it shares no
//! approximation with [`super::super::etd`]. Slow. Must not know rotors or edges.

use super::super::etd::{Load, Oscillators};

/// Columns of the extrapolation at most: order 24.
const COLUMNS: usize = 12;

/// Columns that are looked at in any case, so that no contact between two looks is missed that lasts
/// longer than a tenth of a step.
const LOOKS: usize = 4;

/// Column at which steps are meant to be accepted.
const WANTED: usize = 8;

/// Shortest step, as a part of the interval asked for: below, rounding decides.
const SHORTEST: f64 = 1e-7;

/// Longest and shortest next step, of the present one.
const CHANGE: (f64, f64) = (4.0, 0.02);

/// Integrator of a set of oscillators in first-order form.
#[derive(Debug, Clone)]
pub struct Extrapolation {
    oscillators: Oscillators,
    tolerance: f64,
    /// Length that the last steps suggest for the next, s.
    suggested_s: f64,
    /// Largest state so far: in the norm of ω·q and q̇, and in that of ω²·q and ω·q̇.
    largest: [f64; 2],
    /// State (q, q̇) at the start of a step, its slope there, and the midpoint rule's last two points.
    state: Vec<f64>,
    slope: Vec<f64>,
    older: Vec<f64>,
    newer: Vec<f64>,
    /// Slope at the newer point.
    slope_newer: Vec<f64>,
    /// The last row of the table.
    row: Vec<Vec<f64>>,
    n_forces: u64,
    /// Evaluations of the load after which nothing is carried further.
    max_forces: u64,
}

impl Extrapolation {
    /// An integrator whose error in each step is below `tolerance` of the largest state so far; the
    /// forces' scale counts as well as that of the velocities.
    ///
    /// # Panics
    ///
    /// If the two lists of the oscillators differ in length.
    #[must_use]
    pub fn new(oscillators: Oscillators, tolerance: f64) -> Self {
        assert_eq!(oscillators.omega_rad_per_s.len(), oscillators.damping.len());
        let n = 2 * oscillators.omega_rad_per_s.len();
        let zero = || vec![0.0; n];
        Self {
            oscillators,
            tolerance,
            suggested_s: f64::INFINITY,
            largest: [0.0; 2],
            state: zero(),
            slope: zero(),
            older: zero(),
            newer: zero(),
            slope_newer: zero(),
            row: (0..COLUMNS).map(|_| zero()).collect(),
            n_forces: 0,
            max_forces: u64::MAX,
        }
    }

    /// The same, which gives up after so many evaluations of the load: see [`Self::is_spent`].
    #[must_use]
    pub fn within(self, max_forces: u64) -> Self {
        Self { max_forces, ..self }
    }

    /// Whether it has given up: where it was to carry the state it did not come.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.n_forces > self.max_forces
    }

    /// Carries `q` and `v` from one time to another, or as far as it may ([`Self::within`]).
    ///
    /// # Panics
    ///
    /// If a slice does not have one entry a coordinate.
    pub fn carry(
        &mut self,
        load: &mut impl Load,
        (from_s, to_s): (f64, f64),
        q: &mut [f64],
        v: &mut [f64],
    ) {
        let n = self.oscillators.omega_rad_per_s.len();
        assert!(q.len() == n && v.len() == n, "one entry a coordinate");
        let whole_s = to_s - from_s;
        self.state[..n].copy_from_slice(q);
        self.state[n..].copy_from_slice(v);
        let mut at_s = from_s;
        let mut has_slope = false;
        while at_s < to_s && !self.is_spent() {
            let left_s = to_s - at_s;
            // Two like steps rather than a long and a very short one.
            let step_s = match self.suggested_s {
                suggested_s if suggested_s >= left_s => left_s,
                suggested_s if 2.0 * suggested_s >= left_s => 0.5 * left_s,
                suggested_s => suggested_s,
            };
            if !has_slope {
                slope(&self.oscillators, load, at_s, &self.state, &mut self.slope);
                self.n_forces += 1;
                has_slope = true;
            }
            let is_shortest = step_s <= SHORTEST * whole_s;
            if let Some(column) = self.try_step(load, at_s, step_s, is_shortest) {
                std::mem::swap(&mut self.state, &mut self.row[column]);
                at_s = if step_s >= left_s { to_s } else { at_s + step_s };
                has_slope = false;
            }
        }
        q.copy_from_slice(&self.state[..n]);
        v.copy_from_slice(&self.state[n..]);
    }

    /// Evaluations of the load so far.
    #[must_use]
    pub fn n_forces(&self) -> u64 {
        self.n_forces
    }

    /// The oscillators.
    #[must_use]
    pub fn oscillators(&self) -> &Oscillators {
        &self.oscillators
    }

    /// Tries a step and sets the length suggested next; the column of `row` that holds its result, or
    /// `None` if the step must be shorter.
    fn try_step(
        &mut self,
        load: &mut impl Load,
        at_s: f64,
        step_s: f64,
        is_shortest: bool,
    ) -> Option<usize> {
        let mut error = f64::INFINITY;
        for column in 0..COLUMNS {
            self.midpoint(load, at_s, step_s, 2 * (column + 1));
            let before = error;
            error = self.extrapolate(column);
            let order = (2 * column + 1) as f64;
            if column >= LOOKS && error <= 1.0 {
                self.grow_largest(column);
                let factor = 0.9 * (0.25 / error.max(1e-30)).powf(1.0 / order);
                let least = if column < WANTED { 1.0 } else { CHANGE.1 };
                let next_s = step_s * factor.clamp(least, CHANGE.0);
                // A step cut short by the end of its interval says little about a longer one.
                let was_cut = step_s < self.suggested_s;
                self.suggested_s =
                    if was_cut && next_s < self.suggested_s { self.suggested_s } else { next_s };
                return Some(column);
            }
            let is_hopeless = column >= LOOKS && error > 1e3 * before.max(1.0);
            if column + 1 == COLUMNS || is_hopeless {
                if is_shortest {
                    self.grow_largest(column);
                    self.suggested_s = 2.0 * step_s;
                    return Some(column);
                }
                let factor = 0.8 * (0.25 / error.max(1.0)).powf(1.0 / order);
                self.suggested_s = step_s * factor.clamp(CHANGE.1, 0.5);
                return None;
            }
        }
        None
    }

    /// Modified midpoint rule over a step in `n_sub` parts, into `newer`.
    fn midpoint(&mut self, load: &mut impl Load, at_s: f64, step_s: f64, n_sub: usize) {
        let h = step_s / n_sub as f64;
        self.older.copy_from_slice(&self.state);
        for (newer, (start, slope)) in self.newer.iter_mut().zip(self.state.iter().zip(&self.slope))
        {
            *newer = start + h * slope;
        }
        for part in 1..n_sub {
            let time_s = at_s + h * part as f64;
            slope(&self.oscillators, load, time_s, &self.newer, &mut self.slope_newer);
            for (older, slope) in self.older.iter_mut().zip(&self.slope_newer) {
                *older += 2.0 * h * slope;
            }
            std::mem::swap(&mut self.older, &mut self.newer);
        }
        // Gragg's last step: it looks at the load at the end, where a contact may have begun.
        slope(&self.oscillators, load, at_s + step_s, &self.newer, &mut self.slope_newer);
        for ((newer, older), slope) in self.newer.iter_mut().zip(&self.older).zip(&self.slope_newer)
        {
            *newer = 0.5 * (*newer + older + h * slope);
        }
        self.n_forces += n_sub as u64;
    }

    /// Adds `newer` as row `column` to the table; gives the error of its best entry, `row[column]`, in
    /// tolerances.
    fn extrapolate(&mut self, column: usize) -> f64 {
        // `row[k]` holds T(column − 1, k); it becomes T(column, k) from left to right.
        let n_here = (column + 1) as f64;
        std::mem::swap(&mut self.older, &mut self.newer);
        // `older` carries T(column, k − 1).
        for k in 0..column {
            let ratio = n_here / (column - k) as f64;
            let denominator = ratio * ratio - 1.0;
            for (carried, kept) in self.older.iter_mut().zip(&mut self.row[k]) {
                let better = *carried + (*carried - *kept) / denominator;
                *kept = *carried;
                *carried = better;
            }
        }
        std::mem::swap(&mut self.row[column], &mut self.older);
        if column == 0 { f64::INFINITY } else { self.error(column) }
    }

    /// Difference of the two best entries of the last row, in tolerances.
    fn error(&self, column: usize) -> f64 {
        let (best, second) = (&self.row[column], &self.row[column - 1]);
        let n = self.oscillators.omega_rad_per_s.len();
        let difference = |i: usize| best[i] - second[i];
        let gap = norms(&self.oscillators, n, difference);
        let size = norms(&self.oscillators, n, |i| best[i]);
        let parts = gap.iter().zip(size.iter().zip(self.largest)).map(|(gap, (size, largest))| {
            if *gap > 0.0 { gap / (self.tolerance * size.max(largest)) } else { 0.0 }
        });
        // A step that overflows has no error that is a number, and `max` would pass over it.
        parts
            .fold(0.0, |worst, part| if part.is_finite() { part.max(worst) } else { f64::INFINITY })
    }

    fn grow_largest(&mut self, column: usize) {
        let n = self.oscillators.omega_rad_per_s.len();
        let size = norms(&self.oscillators, n, |i| self.row[column][i]);
        for (largest, size) in self.largest.iter_mut().zip(size) {
            *largest = largest.max(size);
        }
    }
}

/// Norms of a state (q, q̇): √Σ((ω·q)² + q̇²), and the same with every part times its ω.
fn norms(oscillators: &Oscillators, n: usize, state: impl Fn(usize) -> f64) -> [f64; 2] {
    let mut sums = [0.0_f64; 2];
    for (i, omega) in oscillators.omega_rad_per_s.iter().enumerate() {
        let (q, v) = (omega * state(i), state(n + i));
        let square = q * q + v * v;
        sums[0] += square;
        sums[1] += omega * omega * square;
    }
    sums.map(f64::sqrt)
}

/// (q̇, q̈) of a state (q, q̇).
fn slope(
    oscillators: &Oscillators,
    load: &mut impl Load,
    time_s: f64,
    state: &[f64],
    out: &mut [f64],
) {
    let n = oscillators.omega_rad_per_s.len();
    let (q, v) = state.split_at(n);
    let (rate, acceleration) = out.split_at_mut(n);
    load.force(time_s, q, v, acceleration);
    rate.copy_from_slice(v);
    for i in 0..n {
        let (omega, zeta) = (oscillators.omega_rad_per_s[i], oscillators.damping[i]);
        acceleration[i] -= omega * (omega * q[i] + 2.0 * zeta * v[i]);
    }
}
