//! A ball bearing in motion: load of every ball by Hertz, localised defects, waviness
//! (equations R10–R13).
//!
//! The outer ring stands, the inner turns with its shaft. All angles follow from that of the first shaft
//! alone, so the edges of defects are known beforehand: [`Contacts::edges`]. Must not know shafts
//! or time.

use std::f64::consts::{PI, TAU};

/// A ball bearing, its fits and its damage.
#[derive(Debug, Clone, PartialEq)]
pub struct BallBearing {
    /// Number of balls n.
    pub balls: u32,
    /// Turns of its shaft to one of the first; below 0 against it.
    pub turns: f64,
    /// Load-deflection factor of the two contacts in series, N/m^1.5.
    pub contact_factor: f64,
    /// Radial clearance c, m; negative: interference.
    pub clearance_m: f64,
    /// Cage speed ÷ speed of its shaft.
    pub cage_ratio: f64,
    /// Ball spin speed ÷ speed of its shaft.
    pub spin_ratio: f64,
    /// Angle of the first ball when the shafts' angle is 0, rad.
    pub first_ball_rad: f64,
    /// Viscous damping of the bearing, N·s/m, in each direction.
    pub damping_n_s_per_m: f64,
    /// Localised defects.
    pub defects: Vec<Defect>,
    /// Waves of the inner race.
    pub waves: Vec<Wave>,
}

/// A localised defect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defect {
    /// Where.
    pub place: DefectPlace,
    /// Angle of its centre, rad: on the inner race from the shaft's mark, on the outer one from
    /// the x axis, on a ball from the point that touches the outer race at shaft angle 0.
    pub angle_rad: f64,
    /// Half of its angular width β, rad, 0 < β < π/2.
    pub half_width_rad: f64,
    /// Its shape.
    pub profile: Profile,
}

/// The part a defect is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefectPlace {
    /// The inner race: turns with the shaft.
    InnerRace,
    /// The outer race: stands.
    OuterRace,
    /// A ball, counted from 0: it meets both races in each turn of the ball.
    Element(u32),
}

/// How far a ball drops as it passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Profile {
    /// At once, by the whole depth.
    Step {
        /// Depth, m.
        depth_m: f64,
    },
    /// Depth·½(1 + cos(πψ/β)).
    RaisedCosine {
        /// Depth in the middle, m.
        depth_m: f64,
    },
    /// The path of the centre of a ball that rolls over an edge, down to the depth (R12).
    Geometric {
        /// Depth, m.
        depth_m: f64,
        /// Half of the width along the race, m.
        half_width_m: f64,
        /// 1/r_ball + 1/R_race (inner) or 1/r_ball − 1/R_race (outer), 1/m.
        curvature_per_m: f64,
    },
}

/// A wave of the inner race: amplitude · cos(order·ψ + phase), ψ the angle from the shaft's mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Waves a turn.
    pub order: u32,
    /// Amplitude, m.
    pub amplitude_m: f64,
    /// Phase, rad.
    pub phase_rad: f64,
}

impl BallBearing {
    /// Turns of the cage to one of the first shaft.
    #[must_use]
    pub fn cage_turns(&self) -> f64 {
        self.cage_ratio * self.turns
    }
}

impl Profile {
    /// Drop, m, at a place ψ from the middle of a defect of half width β, |ψ| ≤ β.
    fn drop_m(self, place_rad: f64, half_width_rad: f64) -> f64 {
        match self {
            Self::Step { depth_m } => depth_m,
            Self::RaisedCosine { depth_m } => {
                0.5 * depth_m * (1.0 + (PI * place_rad / half_width_rad).cos())
            }
            Self::Geometric { depth_m, half_width_m, curvature_per_m } => {
                let from_edge = half_width_m * (1.0 - (place_rad / half_width_rad).abs());
                depth_m.min(0.5 * from_edge * from_edge * curvature_per_m)
            }
        }
    }
}

/// One ball and one defect: ψ = offset + rate·φ, and it is over the defect while |ψ| ≤ β, ψ
/// taken to the period.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Passage {
    ball: usize,
    offset_rad: f64,
    rate: f64,
    period_rad: f64,
    half_width_rad: f64,
    profile: Profile,
}

impl Passage {
    /// ψ within ± half a period.
    fn place(&self, shaft_rad: f64) -> f64 {
        let psi = self.offset_rad + self.rate * shaft_rad;
        psi - self.period_rad * (psi / self.period_rad).round()
    }
}

/// A bearing with what changes from step to step.
#[derive(Debug, Clone, PartialEq)]
pub struct Contacts {
    bearing: BallBearing,
    /// cos and sin of every ball's angle in the cage.
    seats: Vec<(f64, f64)>,
    passages: Vec<Passage>,
    /// Passages whose ball is over the defect in the present step.
    active: Vec<usize>,
    drops_m: Vec<f64>,
    peak_force_n: f64,
}

impl Contacts {
    /// Prepares a bearing.
    #[must_use]
    pub fn new(bearing: BallBearing) -> Self {
        let n = f64::from(bearing.balls);
        let seat = |j: u32| TAU * f64::from(j) / n + bearing.first_ball_rad;
        let seats: Vec<(f64, f64)> =
            (0..bearing.balls).map(|j| (seat(j).cos(), seat(j).sin())).collect();
        let (cage, spin) = (bearing.cage_turns(), bearing.spin_ratio * bearing.turns);
        let mut passages = Vec::new();
        for defect in &bearing.defects {
            for j in 0..bearing.balls {
                let (offset_rad, rate, period_rad) = match defect.place {
                    DefectPlace::InnerRace => (seat(j), cage - bearing.turns, TAU),
                    DefectPlace::OuterRace => (seat(j), cage, TAU),
                    DefectPlace::Element(ball) if ball == j => (0.0, spin, PI),
                    DefectPlace::Element(_) => continue,
                };
                passages.push(Passage {
                    ball: j as usize,
                    offset_rad: offset_rad - defect.angle_rad,
                    rate,
                    period_rad,
                    half_width_rad: defect.half_width_rad,
                    profile: defect.profile,
                });
            }
        }
        let drops_m = vec![0.0; seats.len()];
        Self { bearing, seats, passages, active: Vec::new(), drops_m, peak_force_n: 0.0 }
    }

    /// The bearing.
    #[must_use]
    pub fn bearing(&self) -> &BallBearing {
        &self.bearing
    }

    /// Largest load of a ball so far, N.
    #[must_use]
    pub fn peak_force_n(&self) -> f64 {
        self.peak_force_n
    }

    /// Appends the shaft angles between two, the first excluded, at which a ball meets the edge or
    /// (geometric profile) the middle of a defect.
    pub fn edges(&self, from_rad: f64, to_rad: f64, out: &mut Vec<f64>) {
        for passage in self.passages.iter().filter(|p| p.rate.abs() > 0.0) {
            let middle = matches!(passage.profile, Profile::Geometric { .. });
            let marks = [-passage.half_width_rad, passage.half_width_rad, 0.0];
            for &mark in &marks[..if middle { 3 } else { 2 }] {
                passage_marks(passage, mark, from_rad, to_rad, out);
            }
        }
    }

    /// Decides which balls are over which defects for a step whose middle has this shaft angle.
    pub fn set_side(&mut self, shaft_rad: f64) {
        self.active.clear();
        let inside = |p: &Passage| p.place(shaft_rad).abs() <= p.half_width_rad;
        self.active.extend((0..self.passages.len()).filter(|i| inside(&self.passages[*i])));
    }

    /// cos and sin of every ball's angle in the cage.
    pub(super) fn seats(&self) -> &[(f64, f64)] {
        &self.seats
    }

    /// Whether the inner race has waves.
    pub(super) fn has_waves(&self) -> bool {
        !self.bearing.waves.is_empty()
    }

    /// Whether a ball is over a defect in the present step.
    pub(super) fn is_over_defect(&self) -> bool {
        !self.active.is_empty()
    }

    /// Whether a ball is over a defect whose depth changes on the way, in the present step.
    pub(super) fn is_over_slope(&self) -> bool {
        let is_slope = |i: &usize| !matches!(self.passages[*i].profile, Profile::Step { .. });
        self.active.iter().any(is_slope)
    }

    /// Displacement along every ball's direction from which it carries load, m: clearance, what it
    /// drops into defects, less the waves under it. Entries beyond the balls stay.
    pub(super) fn gaps_m(&self, shaft_rad: f64, out: &mut [f64]) {
        let n = self.seats.len().min(out.len());
        out[..n].fill(self.bearing.clearance_m);
        for &index in &self.active {
            let passage = &self.passages[index];
            let drop = passage.profile.drop_m(passage.place(shaft_rad), passage.half_width_rad);
            out[passage.ball] += drop;
        }
        if self.bearing.waves.is_empty() {
            return;
        }
        let turned = (self.bearing.cage_turns() - self.bearing.turns) * shaft_rad;
        for ((seat_cos, seat_sin), gap) in self.seats.iter().zip(out) {
            let from_mark = seat_sin.atan2(*seat_cos) + turned;
            for wave in &self.bearing.waves {
                let angle = f64::from(wave.order) * from_mark + wave.phase_rad;
                *gap -= wave.amplitude_m * angle.cos();
            }
        }
    }

    /// Force on the shaft, N, for its displacement and velocity at the bearing (R10, R11).
    pub fn force(&mut self, shaft_rad: f64, [x, y]: [f64; 2], [vx, vy]: [f64; 2]) -> [f64; 2] {
        let bearing = &self.bearing;
        let (sin, cos) = (bearing.cage_turns() * shaft_rad).sin_cos();
        for &index in &self.active {
            let passage = &self.passages[index];
            self.drops_m[passage.ball] = 0.0;
        }
        for &index in &self.active {
            let passage = &self.passages[index];
            let drop = passage.profile.drop_m(passage.place(shaft_rad), passage.half_width_rad);
            self.drops_m[passage.ball] += drop;
        }
        let (mut fx, mut fy, mut peak) = (0.0, 0.0, 0.0_f64);
        for (ball, &(seat_cos, seat_sin)) in self.seats.iter().enumerate() {
            let c = cos * seat_cos - sin * seat_sin;
            let s = sin * seat_cos + cos * seat_sin;
            let mut approach = x * c + y * s - bearing.clearance_m - self.drops_m[ball];
            for wave in &bearing.waves {
                let from_mark = s.atan2(c) - bearing.turns * shaft_rad;
                let turned = f64::from(wave.order) * from_mark + wave.phase_rad;
                approach += wave.amplitude_m * turned.cos();
            }
            if approach > 0.0 {
                let load = approach * approach.sqrt();
                fx += load * c;
                fy += load * s;
                peak = peak.max(load);
            }
        }
        for &index in &self.active {
            self.drops_m[self.passages[index].ball] = 0.0;
        }
        self.peak_force_n = self.peak_force_n.max(bearing.contact_factor * peak);
        let (k, d) = (bearing.contact_factor, bearing.damping_n_s_per_m);
        [-k * fx - d * vx, -k * fy - d * vy]
    }

    /// A bound of the radial stiffness at a displacement of this length, N/m: every ball as deep in its contact as
    /// the deepest, and turned so that half of them count.
    #[must_use]
    pub fn stiffness_bound_n_per_m(&self, displacement_m: f64) -> f64 {
        let deepest_m = (displacement_m - self.bearing.clearance_m).max(0.0);
        let all = 0.5 * f64::from(self.bearing.balls);
        1.5 * self.bearing.contact_factor * deepest_m.sqrt() * all
    }

    /// Radial stiffness of the unloaded fit, N/m, averaged over the cage's turn: what an
    /// interference makes of the contacts (0 with clearance).
    #[must_use]
    pub fn fit_stiffness_n_per_m(&self) -> f64 {
        let interference = (-self.bearing.clearance_m).max(0.0);
        // Σ cos² over the balls is n/2.
        0.75 * f64::from(self.bearing.balls) * self.bearing.contact_factor * interference.sqrt()
    }
}

fn passage_marks(passage: &Passage, mark: f64, from_rad: f64, to_rad: f64, out: &mut Vec<f64>) {
    let at = |shaft_rad: f64| {
        (passage.offset_rad + passage.rate * shaft_rad - mark) / passage.period_rad
    };
    let (a, b) = (at(from_rad), at(to_rad));
    let (low, high) = if a <= b { (a, b) } else { (b, a) };
    let mut turn = low.ceil();
    while turn <= high {
        let shaft_rad = (turn * passage.period_rad + mark - passage.offset_rad) / passage.rate;
        let forward = (shaft_rad > from_rad) == (to_rad > from_rad);
        let inside = (shaft_rad - from_rad).abs() <= (to_rad - from_rad).abs();
        if forward && inside && (shaft_rad - from_rad).abs() > 0.0 {
            out.push(shaft_rad);
        }
        turn += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn rig_bearing(defects: Vec<Defect>) -> BallBearing {
        BallBearing {
            balls: 11,
            turns: 1.0,
            contact_factor: 9.239e9,
            clearance_m: -0.5e-6,
            cage_ratio: 1.0 / 2.62,
            spin_ratio: 1.992,
            first_ball_rad: 0.0,
            damping_n_s_per_m: 0.0,
            defects,
            waves: Vec::new(),
        }
    }

    fn inner_step(half_width_rad: f64) -> Defect {
        let profile = Profile::Step { depth_m: 1e-4 };
        Defect { place: DefectPlace::InnerRace, angle_rad: 0.3, half_width_rad, profile }
    }

    #[test]
    fn a_preloaded_bearing_is_a_spring_of_its_fit() {
        let mut contacts = Contacts::new(rig_bearing(Vec::new()));
        let stiffness = contacts.fit_stiffness_n_per_m();
        for angle in [0.0, 0.2, 1.0] {
            let small = 1e-10;
            let [fx, fy] = contacts.force(angle, [small, 0.0], [0.0; 2]);
            // Next terms are of the order small/interference squared, and rounding of the preloads.
            assert!((-fx / small / stiffness - 1.0).abs() < 1e-4, "{fx}");
            assert!(fy.abs() < 1e-4 * fx.abs(), "{fy}");
        }
    }

    #[test]
    fn every_ball_meets_both_edges_once_a_turn_relative_to_the_race() {
        let contacts = Contacts::new(rig_bearing(vec![inner_step(0.05)]));
        let mut edges = Vec::new();
        let turns = 262.0;
        contacts.edges(0.0, turns * TAU, &mut edges);
        // BPFI = n·(1 − FTF): 11·(1 − 1/2.62)·262 = 1782 passages of two edges, give or take one.
        let expected = 2.0 * 11.0 * (1.0 - 1.0 / 2.62) * turns;
        assert!((edges.len() as f64 - expected).abs() <= 2.0, "{} {expected}", edges.len());
        let mut back = Vec::new();
        contacts.edges(turns * TAU, 0.0, &mut back);
        assert_eq!(back.len(), edges.len(), "backwards alike");
    }

    #[test]
    fn edges_are_where_the_side_changes() {
        let ball = Defect { place: DefectPlace::Element(4), ..inner_step(0.1) };
        let outer = Defect { place: DefectPlace::OuterRace, ..inner_step(0.02) };
        let mut contacts = Contacts::new(rig_bearing(vec![inner_step(0.05), outer, ball]));
        let mut edges = Vec::new();
        contacts.edges(0.0, 40.0, &mut edges);
        edges.sort_by(f64::total_cmp);
        let mut sides = |angle: f64| {
            contacts.set_side(angle);
            contacts.active.clone()
        };
        for pair in edges.windows(2).filter(|pair| pair[1] - pair[0] > 1e-9) {
            let (a, b) = (0.999 * pair[0] + 0.001 * pair[1], 0.001 * pair[0] + 0.999 * pair[1]);
            assert_eq!(sides(a), sides(b), "no change between {} and {}", pair[0], pair[1]);
        }
        let changes = edges.iter().filter(|e| sides(*e - 1e-9) != sides(*e + 1e-9)).count();
        assert_eq!(changes, edges.len(), "each edge changes something");
    }

    #[test]
    fn a_bearing_of_a_faster_shaft_is_the_same_at_that_shafts_angle() {
        let ball = Defect { place: DefectPlace::Element(4), ..inner_step(0.1) };
        let outer = Defect { place: DefectPlace::OuterRace, ..inner_step(0.02) };
        let wave = Wave { order: 3, amplitude_m: 2e-7, phase_rad: 0.4 };
        let own =
            BallBearing { waves: vec![wave], ..rig_bearing(vec![inner_step(0.05), outer, ball]) };
        let turns = -48.0 / 19.0;
        let mut geared = Contacts::new(BallBearing { turns, ..own.clone() });
        let mut alone = Contacts::new(own);
        for step in 0..500 {
            let first_rad = 0.0371 * f64::from(step);
            geared.set_side(first_rad);
            alone.set_side(turns * first_rad);
            let at = [2e-7 * f64::from(step % 7), -1e-7];
            let [a, b] = [
                geared.force(first_rad, at, [0.0; 2]),
                alone.force(turns * first_rad, at, [0.0; 2]),
            ];
            // Angles of some hundred rad, rounded: 1e-13 of forces up to 20 N.
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9, "{step}: {a:?} {b:?}");
        }
        let (mut of_geared, mut of_alone) = (Vec::new(), Vec::new());
        geared.edges(0.0, 20.0, &mut of_geared);
        alone.edges(0.0, turns * 20.0, &mut of_alone);
        of_geared.sort_by(f64::total_cmp);
        of_alone.sort_by(|a, b| b.total_cmp(a));
        assert_eq!(of_geared.len(), of_alone.len());
        assert!(of_geared.iter().zip(&of_alone).all(|(a, b)| (a * turns - b).abs() < 1e-9));
    }

    #[test]
    fn a_ball_over_a_step_carries_nothing_and_over_a_slot_drops_as_geometry_says() {
        let mut contacts = Contacts::new(rig_bearing(vec![inner_step(0.05)]));
        let angle = 0.3 / (1.0 / 2.62 - 1.0); // ball 0 over the middle
        let whole = Contacts::new(rig_bearing(Vec::new())).force(angle, [0.0; 2], [0.0; 2]);
        contacts.set_side(angle);
        assert_eq!(contacts.active, [0]);
        let [fx, fy] = contacts.force(angle, [0.0; 2], [0.0; 2]);
        let missing = (fx - whole[0]).hypot(fy - whole[1]);
        let load = 9.239e9 * 0.5e-6_f64.powf(1.5);
        assert!((missing / load - 1.0).abs() < 1e-12, "{missing} {load}");
        // w²/8·(1/r + 1/R) for a slot of 1 mm, r = 4 mm, R = 12 mm: 41.7 µm, reached in the middle.
        let curvature_per_m = 1.0 / 4e-3 + 1.0 / 12e-3;
        let slot = Profile::Geometric { depth_m: 1.0, half_width_m: 0.5e-3, curvature_per_m };
        assert!((slot.drop_m(0.0, 0.05) - 1e-6 / 8.0 * curvature_per_m).abs() < 1e-15);
        assert!(slot.drop_m(0.05, 0.05).abs() < 1e-18);
    }
}
