//! Two gears in motion: which pairs touch, when that changes, and the force between them (R23–R25).
//!
//! Local: it takes the gear's angle and the approach of both flanks, and gives the force of each
//! flank. How coordinates make approaches, and forces push coordinates, is the caller's matter.

use super::pair::{Condition, Gap, Member, MeshDesign, Pair, Pairs, ToothFault};
use std::f64::consts::{PI, TAU};

/// A mesh, with what changes from step to step.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    design: MeshDesign,
    /// Pairs by condition of the gear's tooth, then of the mate's.
    pairs: Vec<Pair>,
    /// Condition of each tooth of the gear and of the mate; 0: healthy.
    conditions: [Vec<usize>; 2],
    n_mate_conditions: usize,
    base_m: f64,
    mean_n_per_m: f64,
    /// Pairs that may touch in the present step, on the drive and on the back flanks.
    pub(super) active: [Vec<Active>; 2],
    /// Angle of the gear for which the places of the active pairs are known.
    known_rad: Option<f64>,
    peak_force_n: f64,
    has_parted: bool,
}

/// A pair on the path in the present step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Active {
    /// Angle of the gear at which it is at the pitch point, rad.
    pitch_point_rad: f64,
    pair: usize,
    piece: usize,
    gap: Gap,
    /// Whether it touches; `None`: wherever its gap is closed.
    touches: Option<bool>,
    /// At the angle that is known: approach from which its gap is closed, m, place on the path, m, and,
    /// once it was asked for, stiffness, N/m.
    free_m: f64,
    at_m: f64,
    stiffness_n_per_m: Option<f64>,
}

/// Angle of the gear, rad, and approach and its rate of both flanks, m and m/s, at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Angle of the gear, rad.
    pub gear_rad: f64,
    /// Approach of the drive and the back flanks, without the backlash, m.
    pub approach_m: [f64; 2],
    /// Their rates, m/s.
    pub rate_m_per_s: [f64; 2],
}

/// A pair that meets or parts inside a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// When, as a part of the step.
    pub part: f64,
    flank: usize,
    index: usize,
}

impl Mesh {
    /// Prepares a mesh with faults.
    #[must_use]
    pub fn new(design: MeshDesign, faults: &[ToothFault]) -> Self {
        let sides = [(Member::Gear, design.gear.teeth), (Member::Mate, design.mate.teeth)];
        let [gear, mate] = sides.map(|(member, teeth)| conditions(faults, member, teeth));
        let pairs = Pairs::new(&design);
        let all = gear.0.iter().flat_map(|g| mate.0.iter().map(move |m| (g, m)));
        let list: Vec<Pair> = all.map(|(gear, mate)| pairs.pair(gear, mate)).collect();
        let mean_n_per_m = list[0].stiffness[0].integral() / design.path.pitch_m;
        Self {
            base_m: design.gear.base_radius_m(),
            n_mate_conditions: mate.0.len(),
            conditions: [gear.1, mate.1],
            pairs: list,
            mean_n_per_m,
            active: [Vec::new(), Vec::new()],
            known_rad: None,
            peak_force_n: 0.0,
            has_parted: false,
            design,
        }
    }

    /// The design.
    #[must_use]
    pub fn design(&self) -> &MeshDesign {
        &self.design
    }

    /// Stiffness of the healthy mesh along the line of action, averaged over a pitch, N/m.
    #[must_use]
    pub fn mean_stiffness_n_per_m(&self) -> f64 {
        self.mean_n_per_m
    }

    /// Largest force so far, N.
    #[must_use]
    pub fn peak_force_n(&self) -> f64 {
        self.peak_force_n
    }

    /// Whether the drive flanks have been apart.
    #[must_use]
    pub fn has_parted(&self) -> bool {
        self.has_parted
    }

    /// Appends the angles of the gear between two, the first excluded, at which a pair meets, parts,
    /// or bends in its stiffness.
    pub fn edges(&self, from_rad: f64, to_rad: f64, out: &mut Vec<f64>) {
        let path = self.design.path;
        let pitch = TAU / self.design.gear.z();
        for flank in self.flanks() {
            let first = self.design.first_tooth_rad - self.lead_rad(flank);
            let ends =
                if flank == 0 { [path.begin_m, path.end_m] } else { [-path.end_m, -path.begin_m] };
            for end in ends {
                repeated(first + end / self.base_m, pitch, (from_rad, to_rad), |_, angle| {
                    out.push(angle)
                });
            }
            // Bends of damaged pairs, by their numbers.
            for (index, pair) in self.pairs.iter().enumerate() {
                for bend in pair.stiffness[flank].bends() {
                    let s = if flank == 0 { bend } else { -bend };
                    repeated(first + s / self.base_m, pitch, (from_rad, to_rad), |n, angle| {
                        if self.pair_of(n) == index {
                            out.push(angle);
                        }
                    });
                }
            }
        }
    }

    /// Decides which pairs touch in a step in whose middle the gear has this angle.
    pub fn set_side(&mut self, gear_rad: f64) {
        self.known_rad = None;
        let path = self.design.path;
        let pitch = TAU / self.design.gear.z();
        for flank in self.flanks() {
            let first = self.design.first_tooth_rad - self.lead_rad(flank);
            let (begin, end) =
                if flank == 0 { (path.begin_m, path.end_m) } else { (-path.end_m, -path.begin_m) };
            let count = |s: f64| (gear_rad - first - s / self.base_m) / pitch;
            let (lowest, highest) = (count(end).ceil(), count(begin).floor());
            let mut active = std::mem::take(&mut self.active[flank]);
            active.clear();
            let mut n = lowest;
            while n <= highest {
                let pair = self.pair_of(n);
                let pitch_point_rad = first + n * pitch;
                if self.pairs[pair].carries {
                    let s = self.base_m * (gear_rad - pitch_point_rad);
                    let at = if flank == 0 { s } else { -s };
                    let piece = self.pairs[pair].stiffness[flank].piece(at);
                    let gap = self.pairs[pair].gap[flank];
                    active.push(Active {
                        pitch_point_rad,
                        pair,
                        piece,
                        gap,
                        touches: None,
                        free_m: 0.0,
                        at_m: 0.0,
                        stiffness_n_per_m: None,
                    });
                }
                n += 1.0;
            }
            self.active[flank] = active;
        }
    }

    /// The approach from which the gap of a pair is closed, m, and where on the path it is.
    #[inline]
    fn free(&self, (flank, active): (usize, &Active), gear_rad: f64) -> (f64, f64) {
        let path = self.design.path;
        let s = self.base_m * (gear_rad - active.pitch_point_rad);
        let at = if flank == 0 { s } else { -s };
        let xi = (2.0 * at - path.begin_m - path.end_m) / (path.end_m - path.begin_m);
        let play = if flank == 0 { 0.0 } else { self.design.backlash_m };
        (play + active.gap.at(xi), at)
    }

    /// Finds the places of the active pairs at this angle, unless they are known: stages of a step share
    /// their angles.
    #[inline]
    fn know(&mut self, gear_rad: f64) {
        if self.known_rad == Some(gear_rad) {
            return;
        }
        self.known_rad = Some(gear_rad);
        for flank in self.flanks() {
            for i in 0..self.active[flank].len() {
                let active = &self.active[flank][i];
                let (free_m, at) = self.free((flank, active), gear_rad);
                let active = &mut self.active[flank][i];
                (active.free_m, active.at_m, active.stiffness_n_per_m) = (free_m, at, None);
            }
        }
    }

    /// Force of the drive and of the back flanks, N, each pushing its flanks apart, for their
    /// approaches without the backlash, m, and the approaches' rates, m/s (R25).
    #[inline]
    pub fn force(
        &mut self,
        gear_rad: f64,
        approach_m: [f64; 2],
        rate_m_per_s: [f64; 2],
    ) -> [f64; 2] {
        self.know(gear_rad);
        let mut forces = [0.0; 2];
        for flank in self.flanks() {
            let (mut force, mut touch) = (0.0, false);
            for active in &mut self.active[flank] {
                let closed = approach_m[flank] - active.free_m;
                if active.touches.unwrap_or(closed > 0.0) {
                    let curve = &self.pairs[active.pair].stiffness[flank];
                    let known = active.stiffness_n_per_m;
                    let stiffness = known.unwrap_or_else(|| curve.at(active.piece, active.at_m));
                    active.stiffness_n_per_m = Some(stiffness);
                    force += closed * stiffness;
                    touch = true;
                }
            }
            if touch {
                force += self.design.damping_n_s_per_m * rate_m_per_s[flank];
            }
            self.has_parted |= flank == 0 && !touch;
            forces[flank] = force;
            self.peak_force_n = self.peak_force_n.max(force);
        }
        forces
    }

    /// Whether the drive flanks are held apart.
    #[must_use]
    pub fn is_apart(&self) -> bool {
        self.active[0].iter().all(|active| active.touches == Some(false))
    }

    /// Keeps the pairs that touch at a moment touching, and the others apart, up to the next
    /// [`Mesh::set_side`] or [`Mesh::cross`]: the force is then smooth in all its arguments.
    pub fn hold(&mut self, moment: &Moment) {
        self.know(moment.gear_rad);
        for flank in self.flanks() {
            for active in &mut self.active[flank] {
                active.touches = Some(moment.approach_m[flank] - active.free_m > 0.0);
            }
        }
    }

    /// The first pair that meets or parts in a step of `step_s`, though [`Mesh::hold`] kept it, by the
    /// cubic through both ends.
    #[must_use]
    pub fn crossing(&self, from: &Moment, to: &Moment, step_s: f64) -> Option<Crossing> {
        let mut first: Option<Crossing> = None;
        for flank in self.flanks() {
            for (index, active) in self.active[flank].iter().enumerate() {
                let at =
                    |m: &Moment| m.approach_m[flank] - self.free((flank, active), m.gear_rad).0;
                let x1 = at(to);
                if active.touches.is_none_or(|touches| touches == (x1 > 0.0)) {
                    continue;
                }
                let x0 = at(from);
                // What the gap itself changes is even over a step.
                let gap = (x1 - x0) - (to.approach_m[flank] - from.approach_m[flank]);
                let ends = [
                    x0,
                    step_s * from.rate_m_per_s[flank] + gap,
                    x1,
                    step_s * to.rate_m_per_s[flank] + gap,
                ];
                let part = root(ends);
                if first.is_none_or(|known| part < known.part) {
                    first = Some(Crossing { part, flank, index });
                }
            }
        }
        first
    }

    /// Lets the pair of a crossing part if it touches, or touch.
    pub fn cross(&mut self, crossing: Crossing) {
        if let Some(active) = self.active[crossing.flank].get_mut(crossing.index) {
            active.touches = active.touches.map(|touches| !touches);
        }
    }

    /// Stiffness of all pairs in contact on the drive flanks, were they pressed together, N/m, by
    /// the pairs of the present step.
    #[must_use]
    pub fn stiffness_n_per_m(&self, gear_rad: f64) -> f64 {
        let of_pair = |active: &Active| {
            let s = self.base_m * (gear_rad - active.pitch_point_rad);
            self.pairs[active.pair].stiffness[0].at(active.piece, s)
        };
        self.active[0].iter().map(of_pair).sum()
    }

    /// Flanks that can touch: the drive flanks, and the back flanks where there is a backlash they
    /// can close.
    #[must_use]
    pub fn n_flanks(&self) -> usize {
        if self.design.backlash_m.is_finite() { 2 } else { 1 }
    }

    fn flanks(&self) -> std::ops::Range<usize> {
        0..self.n_flanks()
    }

    /// By how much a tooth's back flank passes its pitch point before its drive flank, rad.
    fn lead_rad(&self, flank: usize) -> f64 {
        if flank == 0 { 0.0 } else { PI / self.design.gear.z() }
    }

    /// The pair of this running number.
    fn pair_of(&self, n: f64) -> usize {
        let [gear, mate] = [0, 1].map(|side| {
            let list = &self.conditions[side];
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "0 to z − 1"
            )]
            let tooth = n.rem_euclid(list.len() as f64) as usize;
            list.get(tooth).copied().unwrap_or(0)
        });
        gear * self.n_mate_conditions + mate
    }
}

/// The distinct conditions of a gear's teeth, healthy first, and which of them each tooth is in.
fn conditions(faults: &[ToothFault], member: Member, teeth: u32) -> (Vec<Condition>, Vec<usize>) {
    let (mut list, mut of_tooth) = (vec![Condition::default()], Vec::new());
    for tooth in 0..teeth {
        let its = faults.iter().filter(|f| f.member == member && f.tooth == tooth);
        let condition = Condition::of(its.map(|f| f.fault));
        let known = list.iter().position(|known| *known == condition).unwrap_or(list.len());
        if known == list.len() {
            list.push(condition);
        }
        of_tooth.push(known);
    }
    (list, of_tooth)
}

/// Where between 0 and 1 the cubic of these ends (value, slope, value, slope) passes zero; 0 if both
/// ends lie on one side.
fn root([x0, v0, x1, v1]: [f64; 4]) -> f64 {
    let at = |t: f64| {
        let (r, t2) = (1.0 - t, t * t);
        (1.0 + 2.0 * t) * r * r * x0 + t * r * r * v0 + t2 * (3.0 - 2.0 * t) * x1 - t2 * r * v1
    };
    if (x0 > 0.0) == (x1 > 0.0) {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..52 {
        let middle = 0.5 * (low + high);
        if (at(middle) > 0.0) == (x0 > 0.0) { low = middle } else { high = middle }
    }
    high
}

/// Calls `take` for every mark + n·period between two angles, the first excluded, in either sense.
fn repeated(mark: f64, period: f64, (from, to): (f64, f64), mut take: impl FnMut(f64, f64)) {
    let (low, high) = if from <= to { (from, to) } else { (to, from) };
    let mut n = ((low - mark) / period).floor();
    let last = ((high - mark) / period).ceil();
    while n <= last {
        let angle = mark + n * period;
        if angle >= low && angle <= high && (angle - from).abs() > 0.0 {
            take(n, angle);
        }
        n += 1.0;
    }
}

#[cfg(test)]
impl Mesh {
    /// Number of pairs on the path, on the drive and on the back flanks.
    pub(super) fn active_pairs(&self) -> [usize; 2] {
        [self.active[0].len(), self.active[1].len()]
    }
}
