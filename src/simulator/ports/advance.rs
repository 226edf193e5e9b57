//! The inner loop of a [`PortRun`]: grid steps, cut at every edge of a defect.

use super::lanes;
use super::{Moment, PortRun, SAME_TIME, STRIDE, Seat, SetStep, Work};
use pulp::{Simd, WithSimd};

/// Most touches a grid step is cut for.
const MOST_CUTS: usize = 16;

/// Pieces below this part of a step are not cut again.
const SMALLEST_CUT: f64 = 0.1;

/// Pieces next to a touch, of the step that is cut: what a step from or to a touch misses goes with
/// the 2.5th power of its length.
const NEAR_TOUCH: [f64; 4] = [1.0 / 32.0, 1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0];

/// Cuts a length at a part of it into pieces that shrink towards there and grow from there; the last
/// first.
fn pieces(part: f64, whole_s: f64, out: &mut Vec<f64>) {
    let side = |length_s: f64, out: &mut Vec<f64>| {
        let mut left_s = length_s;
        for piece in NEAR_TOUCH {
            let piece_s = piece * whole_s;
            if left_s <= 1.5 * piece_s {
                break;
            }
            out.push(piece_s);
            left_s -= piece_s;
        }
        out.push(left_s);
    };
    let start = out.len();
    side((1.0 - part) * whole_s, out);
    out[start..].reverse();
    side(part * whole_s, out);
}

/// Which maps a step takes.
#[derive(Clone, Copy)]
enum Length {
    /// Those of the grid.
    Grid,
    /// Those of this length, s.
    Odd(f64),
}

impl PortRun {
    /// `n_steps` steps of the grid; what is watched at the beginning of each goes to `out`.
    #[inline(always)]
    pub(super) fn stride<S: Simd>(&mut self, simd: S, n_steps: usize, out: &mut [Vec<f64>]) {
        let from_s = self.time_s();
        self.find_edges(from_s, (self.n_steps + n_steps as i64) as f64 * self.step_s);
        let is_anchor = self.n_steps.rem_euclid(STRIDE) == 0;
        let mut now = match self.now.take() {
            Some(now) if !is_anchor => now,
            _ => self.anchor(simd, from_s),
        };
        let turn = Moment::at(0.5 * self.speed_rad_per_s * self.step_s, &self.seats);
        let mut next_edge = 0;
        let mut is_stale = self.is_stale;
        for _ in 0..n_steps {
            let begin_s = self.time_s();
            self.n_steps += 1;
            let end_s = self.time_s();
            let mut at_s = begin_s;
            while at_s < end_s {
                let edge_s = self.next_edge(&mut next_edge, at_s, end_s);
                let to_s = edge_s.unwrap_or(end_s);
                if is_stale {
                    let middle_rad = now.shaft_rad + 0.5 * self.speed_rad_per_s * (to_s - at_s);
                    self.seats.iter_mut().for_each(|seat| seat.balls.set_side(middle_rad));
                }
                let start = &mut self.work.forces[0];
                contact_forces(simd, &mut self.seats, (&now, true), &self.work.now_m, start);
                if at_s <= begin_s {
                    self.observe(simd, &now, out);
                }
                let is_whole = edge_s.is_none() && at_s <= begin_s;
                let length = if is_whole { Length::Grid } else { Length::Odd(to_s - at_s) };
                if self.cuts_at_contact {
                    self.reach(simd, length, &mut now, &turn);
                } else {
                    self.step(simd, length, &mut now, &turn);
                }
                is_stale = edge_s.is_some();
                at_s = to_s;
            }
            // An edge that lies on the grid changes the side of what follows.
            is_stale |= self.passes_edges_at(&mut next_edge, end_s);
        }
        (self.now, self.is_stale) = (Some(now), is_stale);
    }

    /// Angles and displacements of the ports anew from time and state, free of what rounding has
    /// added since the last time.
    #[inline(always)]
    fn anchor<S: Simd>(&mut self, simd: S, at_s: f64) -> Moment {
        let now = Moment::at(self.shaft_rad(at_s), &self.seats);
        self.ported.displacements(simd, &self.list, &mut self.work.free);
        let free = self.work.free.as_flattened();
        for ((now_m, free), still) in self.work.now_m.iter_mut().zip(free).zip(&self.port_steady) {
            *now_m = free + now.of(still);
        }
        now
    }

    /// Goes a length in as many steps as balls touch or leave in it. The force of a ball that touches
    /// grows with t^1.5, which no polynomial follows: steps are cut there and grow from there on.
    /// Forces at the start are known.
    #[inline(always)]
    fn reach<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        self.step_kept(simd, length, now, turn);
        let Some(part) = self.first_touch(now) else { return };
        let whole_s = match length {
            Length::Grid => self.step_s,
            Length::Odd(step_s) => step_s,
        };
        self.restore(now);
        let mut ahead_s = std::mem::take(&mut self.work.ahead_s);
        ahead_s.clear();
        pieces(part, whole_s, &mut ahead_s);
        let mut n_cuts = 1;
        while let Some(piece_s) = ahead_s.pop() {
            let start = &mut self.work.forces[0];
            contact_forces(simd, &mut self.seats, (now, true), &self.work.now_m, start);
            self.step_kept(simd, Length::Odd(piece_s), now, turn);
            if n_cuts >= MOST_CUTS || piece_s < whole_s * SMALLEST_CUT {
                continue;
            }
            if let Some(part) = self.first_touch(now) {
                self.restore(now);
                pieces(part, piece_s, &mut ahead_s);
                n_cuts += 1;
            }
        }
        self.work.ahead_s = ahead_s;
    }

    /// A step that can be taken back.
    #[inline(always)]
    fn step_kept<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        let kept = &mut self.kept;
        kept.list.clone_from(&self.list);
        kept.now_m.clone_from(&self.work.now_m);
        kept.now.clone_from(now);
        self.step(simd, length, now, turn);
    }

    fn restore(&mut self, now: &mut Moment) {
        self.list.copy_from_slice(&self.kept.list);
        self.work.now_m.copy_from_slice(&self.kept.now_m);
        now.clone_from(&self.kept.now);
    }

    /// The part of the last step after which a ball first touches or leaves; `None` if none does.
    fn first_touch(&mut self, after: &Moment) -> Option<f64> {
        if !self.seats.iter().any(|seat| seat.balls.has_touched()) {
            return None;
        }
        let before = &self.kept;
        let mut first: Option<f64> = None;
        let middle_rad = 0.5 * (before.now.shaft_rad + after.shaft_rad);
        let middle = Moment::at(middle_rad, &self.seats);
        let work = &self.work;
        for (i, seat) in self.seats.iter_mut().enumerate() {
            let place = |list: &[f64]| [list[2 * i], list[2 * i + 1]];
            let looks = [
                (before.now.shaft_rad, before.now.cages[i], place(&before.now_m)),
                (middle_rad, middle.cages[i], place(&work.middle_m)),
                (after.shaft_rad, after.cages[i], place(&work.now_m)),
            ];
            if let Some(part) = seat.balls.first_touch(looks) {
                first = Some(first.map_or(part, |first| first.min(part)));
            }
        }
        first
    }

    /// Times of the edges in an interval, in order.
    fn find_edges(&mut self, from_s: f64, to_s: f64) {
        let work = &mut self.work;
        work.edges_s.clear();
        work.angles.clear();
        let speed = self.speed_rad_per_s;
        if speed.abs() <= 0.0 {
            return;
        }
        // A little beyond, for edges that rounding puts on the other side of the last grid point.
        let margin_s = SAME_TIME * self.step_s;
        for seat in &self.seats {
            let contacts = seat.balls.contacts();
            contacts.edges(speed * from_s, speed * (to_s + margin_s), &mut work.angles);
        }
        work.edges_s.extend(work.angles.iter().map(|angle| angle / speed));
        work.edges_s.sort_by(f64::total_cmp);
    }

    /// The next edge inside (`at_s`, `end_s`), none of those that are at one of the two.
    fn next_edge(&self, next: &mut usize, at_s: f64, end_s: f64) -> Option<f64> {
        let margin_s = SAME_TIME * self.step_s;
        while let Some(&edge_s) = self.work.edges_s.get(*next) {
            if edge_s >= end_s - margin_s {
                return None;
            }
            *next += 1;
            if edge_s > at_s + margin_s {
                return Some(edge_s);
            }
        }
        None
    }

    /// Goes past the edges at `end_s`; whether there were any.
    fn passes_edges_at(&self, next: &mut usize, end_s: f64) -> bool {
        let before = *next;
        while self.work.edges_s.get(*next).is_some_and(|e| *e <= end_s + SAME_TIME * self.step_s) {
            *next += 1;
        }
        *next > before
    }

    /// What is watched now, with the forces now in `work.forces[0]`.
    #[inline(always)]
    fn observe<S: Simd>(&mut self, simd: S, now: &Moment, out: &mut [Vec<f64>]) {
        self.watched.rows.times(simd, &self.list, &mut self.work.seen);
        let seen = self.work.seen.as_flattened();
        let force = &self.work.forces[0];
        let n = force.len().max(1);
        for (i, (list, still)) in out.iter_mut().zip(&self.watched.steady).enumerate() {
            let direct = self.watched.direct.get(i * n..(i + 1) * n).unwrap_or_default();
            let pushed: f64 = direct.iter().zip(force).map(|(a, f)| a * f).sum();
            list.push(seen[i] + now.of(still) + pushed);
        }
    }

    /// One step from `now` on, with the forces now in `work.forces[0]`; leaves the displacements of
    /// the ports at its end.
    #[inline(always)]
    fn step<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        let odd_turn;
        let (map, turn) = match length {
            Length::Grid => (&self.grid, turn),
            Length::Odd(step_s) => {
                let set = SetStep { map: &mut self.odd, ported: &self.ported, step_s };
                set.with_simd(simd);
                odd_turn = Moment::at(0.5 * self.speed_rad_per_s * step_s, &self.seats);
                (&self.odd, &odd_turn)
            }
        };
        let Work { free, stage_m, middle_m: kept_middle_m, forces, amounts, now_m, .. } =
            &mut self.work;
        let [start, first, second, end] = forces;
        let (seats, still) = (&mut self.seats, &self.port_steady);
        let n = self.ported.n_ports;
        map.free.times(simd, &self.list, free);
        let free = free.as_flattened();
        now.turn(turn);
        // At the first stage the displacements of the middle are those of the free motion, and those
        // of the end wait in `now_m`.
        let middle_m = &mut *stage_m;
        for port in 0..n {
            middle_m[port] = free[port] + now.of(&still[port]);
        }
        push(&map.stage, start, middle_m);
        contact_forces(simd, seats, (now, false), middle_m, first);
        for port in 0..n {
            middle_m[port] = free[port] + now.of(&still[port]);
        }
        push(&map.stage, first, middle_m);
        kept_middle_m.copy_from_slice(middle_m);
        contact_forces(simd, seats, (now, false), middle_m, second);
        now.turn(turn);
        for port in 0..n {
            now_m[port] = free[n + port] + now.of(&still[port]);
        }
        let late_m = &mut *stage_m;
        late_m.copy_from_slice(now_m);
        for port in 0..n {
            amounts[port] = 2.0 * second[port] - start[port];
        }
        push(&map.carried, start, late_m);
        push(&map.stage, &amounts[..n], late_m);
        contact_forces(simd, seats, (now, false), late_m, end);
        for port in 0..n {
            amounts[port] = start[port];
            amounts[n + port] = first[port] + second[port];
            amounts[2 * n + port] = end[port];
        }
        for (weights, amounts) in map.weighted.iter().zip(amounts.chunks_exact(n.max(1))) {
            push(weights, amounts, now_m);
        }
        lanes::carry(simd, &map.whole, &map.columns, amounts, &mut self.list);
    }
}

/// Adds to displacements what forces do to them.
#[inline(always)]
fn push(effect: &[f64], force: &[f64], displacement_m: &mut [f64]) {
    let n = force.len().max(1);
    for (row, force) in effect.chunks_exact(n).zip(force) {
        for (displacement, effect) in displacement_m.iter_mut().zip(row) {
            *displacement += effect * force;
        }
    }
}

/// Forces at the ports for their displacements, at the start of a step or inside it.
#[inline(always)]
fn contact_forces<S: Simd>(
    simd: S,
    seats: &mut [Seat],
    (now, is_start): (&Moment, bool),
    displacement_m: &[f64],
    out: &mut [f64],
) {
    let ports = displacement_m.chunks_exact(2).zip(out.chunks_exact_mut(2));
    for ((seat, cage), (at, out)) in seats.iter_mut().zip(&now.cages).zip(ports) {
        let force = seat.balls.force(simd, now.shaft_rad, *cage, [at[0], at[1]], is_start);
        let [[xx, xy], [yx, yy]] = seat.given_back_n_per_m;
        out[0] = force[0] + xx * at[0] + xy * at[1];
        out[1] = force[1] + yx * at[0] + yy * at[1];
    }
}

impl Moment {
    /// The angles of shaft and cages when the shaft's is this.
    pub(super) fn at(shaft_rad: f64, seats: &[Seat]) -> Self {
        let unit = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            (cos, sin)
        };
        Self {
            shaft_rad,
            shaft: unit(shaft_rad),
            cages: seats.iter().map(|seat| unit(seat.cage_ratio * shaft_rad)).collect(),
        }
    }

    /// Goes on by these angles.
    #[inline(always)]
    fn turn(&mut self, by: &Self) {
        let turned = |(c, s): (f64, f64), (dc, ds): (f64, f64)| (c * dc - s * ds, s * dc + c * ds);
        self.shaft_rad += by.shaft_rad;
        self.shaft = turned(self.shaft, by.shaft);
        for (cage, by) in self.cages.iter_mut().zip(&by.cages) {
            *cage = turned(*cage, *by);
        }
    }

    /// Constant + cos and sin part.
    #[inline(always)]
    fn of(&self, still: &[f64; 3]) -> f64 {
        still[0] + still[1] * self.shaft.0 + still[2] * self.shaft.1
    }
}
