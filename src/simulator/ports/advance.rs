//! The inner loop of a [`PortRun`]: grid steps, cut at every edge of a defect.

use super::loads::{Look, Moment};
use super::{PortRun, RESTLESS_S, SAME_TIME, STRIDE, SetStep, Work};
use crate::simulator::lanes::{Block, push};
use crate::simulator::mesh::Crossing;
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

/// What a step should not go across.
#[derive(Clone, Copy)]
enum Event {
    /// A pair of teeth of this gear meets or parts.
    Teeth(usize, Crossing),
    /// A ball touches or leaves after this part of the step.
    Ball(f64),
}

/// Which maps a step takes.
#[derive(Clone, Copy)]
enum Length {
    /// Those of the grid.
    Grid,
    /// Those of a part of the grid's step.
    Fine,
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
        let turn = Moment::at(0.5 * self.speed_rad_per_s * self.step_s, &self.loads);
        let mut next_edge = 0;
        let mut is_stale = self.is_stale;
        for _ in 0..n_steps {
            let begin_s = self.time_s();
            let is_watched = self.n_steps.rem_euclid(self.watched_every) == 0;
            self.n_steps += 1;
            let end_s = self.time_s();
            let mut at_s = begin_s;
            while at_s < end_s {
                let edge_s = self.next_edge(&mut next_edge, at_s, end_s);
                let to_s = edge_s.unwrap_or(end_s);
                if is_stale {
                    let middle_rad = now.shaft_rad + 0.5 * self.speed_rad_per_s * (to_s - at_s);
                    self.loads.set_side(middle_rad);
                }
                self.start_forces(simd, &now, true);
                if is_watched && at_s <= begin_s {
                    self.observe(simd, &now, out);
                }
                let is_whole = edge_s.is_none() && at_s <= begin_s;
                let length = if is_whole { Length::Grid } else { Length::Odd(to_s - at_s) };
                if self.parts_of_events > 1 {
                    self.go(simd, length, &mut now, &turn);
                } else if self.cuts_at_contact || !self.loads.gears.is_empty() {
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

    /// Angles and what is read of the motion anew from time and state, free of what rounding has
    /// added since the last time.
    #[inline(always)]
    fn anchor<S: Simd>(&mut self, simd: S, at_s: f64) -> Moment {
        self.watched.forget_what_died(&mut self.list);
        let now = Moment::at(self.shaft_rad(at_s), &self.loads);
        self.ported.read(simd, &self.list, &mut self.work.free);
        let free = self.work.free.as_flattened();
        self.still.plus(simd, now.shafts(), free, &mut self.work.now);
        now
    }

    /// Forces at the ports now; where a stretch without edges begins, teeth are held as they are.
    fn start_forces<S: Simd>(&mut self, simd: S, now: &Moment, holds: bool) {
        simd.vectorize(Begin { run: self, now, holds });
    }

    #[inline(always)]
    fn begin<S: Simd>(&mut self, simd: S, now: &Moment, holds: bool) {
        let look = Look { now, read: self.work.now.as_flattened() };
        if holds {
            self.loads.hold(look);
        }
        self.loads.forces(simd, look, true, self.work.forces[0].as_flattened_mut());
    }

    /// Goes a length in one step; or in parts, where teeth are restless or if a ball touches or leaves in
    /// it (unless that is cut): the step is taken back then. Forces at the start are known.
    fn go<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        let is_calm = self.n_steps > self.restless_until && !self.loads.are_teeth_apart();
        if is_calm && !self.reach_calmly(simd, length, now, turn) {
            return;
        }
        let n_parts = self.parts_of_events;
        let part = match length {
            Length::Grid | Length::Fine => Length::Fine,
            Length::Odd(step_s) => Length::Odd(step_s / f64::from(n_parts)),
        };
        for i in 0..n_parts {
            if i > 0 {
                self.start_forces(simd, now, true);
            }
            self.reach(simd, part, now, turn);
        }
    }

    /// Goes a length unless it needs parts; whether it does, and nothing is done.
    fn reach_calmly<S: Simd>(
        &mut self,
        simd: S,
        length: Length,
        now: &mut Moment,
        turn: &Moment,
    ) -> bool {
        self.step_kept(simd, length, now, turn);
        let whole_s = self.length_s(length);
        let event = self.first_event(now, whole_s, false);
        if matches!(event, Some(Event::Teeth(..))) {
            self.restore(now);
            return true;
        }
        if event.is_some() {
            self.follow(simd, event, whole_s, now, turn);
        } else if !self.cuts_at_contact && self.loads.has_touched() {
            self.n_touches += 1;
            self.restore(now);
            return true;
        }
        false
    }

    /// Length of a step, s.
    fn length_s(&self, length: Length) -> f64 {
        match length {
            Length::Grid => self.step_s,
            Length::Fine => self.step_s / f64::from(self.parts_of_events),
            Length::Odd(step_s) => step_s,
        }
    }

    /// Goes a length in as many steps as teeth meet or part and balls touch or leave in it. The force
    /// of a ball that touches grows with t^1.5, which no polynomial follows: steps are cut there and
    /// grow from there on. Forces at the start are known.
    fn reach<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        let whole_s = self.length_s(length);
        self.step_kept(simd, length, now, turn);
        let event = self.first_event(now, whole_s, false);
        if event.is_some() {
            self.follow(simd, event, whole_s, now, turn);
        }
    }

    /// Takes a step of `whole_s` back in which something happened, and goes its length in pieces.
    fn follow<S: Simd>(
        &mut self,
        simd: S,
        mut event: Option<Event>,
        whole_s: f64,
        now: &mut Moment,
        turn: &Moment,
    ) {
        let shortest_s = SAME_TIME * self.step_s;
        let mut ahead_s = std::mem::take(&mut self.work.ahead_s);
        ahead_s.clear();
        let (mut piece_s, mut n_cuts) = (whole_s, 0);
        loop {
            match event {
                Some(Event::Teeth(gear, crossing))
                    if piece_s * (1.0 - crossing.part) > shortest_s =>
                {
                    self.restore(now);
                    let part_s = crossing.part * piece_s;
                    ahead_s.push(piece_s - if part_s > shortest_s { part_s } else { 0.0 });
                    if part_s > shortest_s {
                        self.start_forces(simd, now, false);
                        self.step(simd, Length::Odd(part_s), now, turn);
                    }
                    self.loads.cross((gear, crossing));
                }
                Some(Event::Ball(part)) => {
                    self.restore(now);
                    pieces(part, piece_s, &mut ahead_s);
                }
                Some(Event::Teeth(..)) | None => {}
            }
            match event {
                Some(Event::Teeth(..)) => {
                    #[expect(clippy::cast_possible_truncation, reason = "some hundred")]
                    let n_steps = (RESTLESS_S / self.step_s).ceil() as i64;
                    self.restless_until = self.n_steps + n_steps;
                }
                Some(Event::Ball(_)) => self.n_touches += 1,
                None => {}
            }
            n_cuts += usize::from(event.is_some());
            let Some(next_s) = ahead_s.pop() else { break };
            piece_s = next_s;
            self.start_forces(simd, now, false);
            self.step_kept(simd, Length::Odd(piece_s), now, turn);
            event = if n_cuts < MOST_CUTS {
                self.first_event(now, piece_s, piece_s < whole_s * SMALLEST_CUT)
            } else {
                None
            };
        }
        self.work.ahead_s = ahead_s;
    }

    /// A step that can be taken back.
    fn step_kept<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        let kept = &mut self.kept;
        kept.read.clone_from(&self.work.now);
        kept.now.clone_from(now);
        self.step(simd, length, now, turn);
    }

    /// Takes a step back; every step leaves the list before it.
    fn restore(&mut self, now: &mut Moment) {
        std::mem::swap(&mut self.list, &mut self.kept.list);
        self.work.now.copy_from_slice(&self.kept.read);
        now.clone_from(&self.kept.now);
    }

    /// What happened first in the last step, of `step_s`, that it should not have gone across; balls
    /// are left alone in small pieces.
    fn first_event(&mut self, after: &Moment, step_s: f64, is_small: bool) -> Option<Event> {
        let before = Look { now: &self.kept.now, read: self.kept.read.as_flattened() };
        let end = Look { now: after, read: self.work.now.as_flattened() };
        if let Some((gear, crossing)) = self.loads.crossing(before, end, step_s) {
            return Some(Event::Teeth(gear, crossing));
        }
        if !self.cuts_at_contact || is_small || !self.loads.has_touched() {
            return None;
        }
        let middle_rad = 0.5 * (before.now.shaft_rad + after.shaft_rad);
        let middle = Moment::at(middle_rad, &self.loads);
        let middle = Look { now: &middle, read: self.work.middle.as_flattened() };
        self.loads.first_touch([before, middle, end]).map(Event::Ball)
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
        self.loads.edges(speed * from_s, speed * (to_s + margin_s), &mut work.angles);
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
        let force = self.work.forces[0].as_flattened();
        let n = self.ported.n_in;
        for (i, (list, still)) in out.iter_mut().zip(&self.watched.still).enumerate() {
            let direct = self.watched.direct.get(i * n..(i + 1) * n).unwrap_or_default();
            let pushed: f64 = direct.iter().zip(force).map(|(a, f)| a * f).sum();
            list.push(seen[i] + now.of(still) + pushed);
        }
    }

    /// One step from `now` on, with the forces now in `work.forces[0]`; leaves what is read at its end.
    fn step<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        simd.vectorize(Step { run: self, length, now, turn });
    }

    #[inline(always)]
    fn steps<S: Simd>(&mut self, simd: S, length: Length, now: &mut Moment, turn: &Moment) {
        let (map, turn) = match length {
            Length::Grid => (&self.grid, turn),
            Length::Fine => (&self.fine, &self.fine_turn),
            Length::Odd(step_s) => {
                if self.odd_s.to_bits() != step_s.to_bits() {
                    self.odd_s = step_s;
                    simd.vectorize(SetStep { map: &mut self.odd, ported: &self.ported, step_s });
                    self.odd_turn.set(0.5 * self.speed_rad_per_s * step_s, &self.loads);
                }
                (&self.odd, &self.odd_turn)
            }
        };
        let Work { free, stage, middle, forces, sums, now: at_end, .. } = &mut self.work;
        let [start, first, second, end] = forces;
        let (loads, still) = (&mut self.loads, &self.still);
        map.free.times(simd, &self.list, free);
        // Whole blocks of both: what is beyond is not asked for.
        let free_middle = free.as_flattened();
        let free_end = &free_middle[self.ported.n_out..];
        now.turn(turn);
        still.plus(simd, now.shafts(), free_middle, stage);
        middle.copy_from_slice(stage);
        push(simd, &map.stage, start.as_flattened(), stage);
        let look = Look { now, read: stage.as_flattened() };
        loads.forces(simd, look, false, first.as_flattened_mut());
        push(simd, &map.stage, first.as_flattened(), middle);
        let look = Look { now, read: middle.as_flattened() };
        loads.forces(simd, look, false, second.as_flattened_mut());
        now.turn(turn);
        still.plus(simd, now.shafts(), free_end, at_end);
        stage.copy_from_slice(at_end);
        let [both, ahead] = sums;
        let pairs =
            start.as_flattened().iter().zip(first.as_flattened()).zip(second.as_flattened());
        let sums = both.as_flattened_mut().iter_mut().zip(ahead.as_flattened_mut());
        for ((both, ahead), ((start, first), second)) in sums.zip(pairs) {
            (*both, *ahead) = (first + second, 2.0 * second - start);
        }
        push(simd, &map.carried, start.as_flattened(), stage);
        push(simd, &map.stage, ahead.as_flattened(), stage);
        let look = Look { now, read: stage.as_flattened() };
        loads.forces(simd, look, false, end.as_flattened_mut());
        let amounts: [&[Block]; 3] = [start, both, end];
        for (weights, amounts) in map.weighted.iter().zip(amounts) {
            push(simd, weights, amounts.as_flattened(), at_end);
        }
        map.carry(simd, &self.ported, amounts, (&self.list, &mut self.kept.list));
        std::mem::swap(&mut self.list, &mut self.kept.list);
    }
}

/// [`PortRun::begin`] once in the program, not at every place that calls it.
struct Begin<'a> {
    run: &'a mut PortRun,
    now: &'a Moment,
    holds: bool,
}

impl WithSimd for Begin<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.run.begin(simd, self.now, self.holds);
    }
}

/// [`PortRun::steps`] likewise.
struct Step<'a> {
    run: &'a mut PortRun,
    length: Length,
    now: &'a mut Moment,
    turn: &'a Moment,
}

impl WithSimd for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.run.steps(simd, self.length, self.now, self.turn);
    }
}
