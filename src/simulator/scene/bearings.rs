//! `[[bearing]]` with `[[bearing.defect]]` and `[[bearing.wave]]`.

use super::lengths::{Span, angle, length, length_keys, number_or};
use super::parts::{self, POISSON, YOUNG_GPA};
use super::shafts::Shafts;
use super::{BearingKind, ProfileKind, SceneBall, SceneBearing, SceneDefect};
use crate::machine::bearing::{BearingGeometry, RotatingRing};
use crate::machine::file::general::ID;
use crate::machine::file::range::NumberRange;
use crate::machine::file::reader::{Ids, Need, Section};
use crate::simulator::contact::{BallBearing, DefectPlace, Wave};
use crate::simulator::hertz::{self, Elasticity};
use std::f64::consts::{PI, TAU};

/// Bearing steel, unless another is given.
const YOUNG_DEFAULT_GPA: f64 = 206.8;
const POISSON_DEFAULT: f64 = 0.3;

/// Groove radius ÷ ball diameter unless another is given.
const CONFORMITY_DEFAULT: f64 = 0.52;

/// Damping of a ball bearing unless another is given, N·s/m.
const DAMPING_DEFAULT: f64 = 200.0;

/// Contact pressure at which a ball and its race yield by one ten-thousandth of the ball's
/// diameter, Pa: the limit of the static load rating of ball bearings.
pub(crate) const YIELD_PRESSURE_PA: f64 = 4.2e9;

/// Interference for which a ball bearing's stiffness goes into the modes unless given, m.
const NOMINAL_APPROACH_M: f64 = 1e-6;

/// Stiffnesses, N/m.
const STIFFNESS: NumberRange = NumberRange::positive_up_to(1e13);

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Ball,
    Linear,
}

/// Identifiers of all bearings.
pub(super) fn ids<'s>(sections: &mut [Section<'s>]) -> Ids<'s> {
    Ids::read("bearing", "id", sections, &ID)
}

/// Reads a bearing.
pub(super) fn read(
    mut section: Section<'_>,
    id: Option<&str>,
    shafts: &Shafts,
) -> Option<SceneBearing> {
    let s = &mut section;
    let kinds = [("ball", Kind::Ball), ("linear", Kind::Linear)];
    let kind = s.choice("kind", Need::Required, &kinds);
    let place = parts::place(s, shafts);
    let ring_mass_kg = number_or(s, "ring_mass_kg", NumberRange::closed(0.0, 1e6), 0.0);
    let (kind, natural_n_per_m) = match kind {
        Some(Kind::Ball) => {
            let ball = read_ball(s);
            let natural = ball.as_ref().map_or(0.0, |ball| natural_stiffness(&ball.bearing));
            (ball.map(BearingKind::Ball), natural)
        }
        Some(Kind::Linear) => {
            let linear = read_linear(s);
            let natural = linear.map_or(0.0, |(k, _)| 0.5 * (k[0][0] + k[1][1]));
            let kind = linear.map(|(stiffness_n_per_m, damping_n_s_per_m)| BearingKind::Linear {
                stiffness_n_per_m,
                damping_n_s_per_m,
            });
            (kind, natural)
        }
        // What a bearing of no kind may hold is not known.
        None => return None,
    };
    let support_n_per_m = number_or(s, "support_n_per_m", STIFFNESS, natural_n_per_m);
    section.finish();
    Some(SceneBearing {
        id: id?.to_owned(),
        place: place?,
        ring_mass_kg: ring_mass_kg?,
        support_n_per_m: support_n_per_m?,
        kind: kind?,
    })
}

/// Stiffness of a bearing pressed together by [`NOMINAL_APPROACH_M`], N/m.
fn natural_stiffness(bearing: &BallBearing) -> f64 {
    0.75 * f64::from(bearing.balls) * bearing.contact_factor * NOMINAL_APPROACH_M.sqrt()
}

/// [[xx, xy], [yx, yy]].
type Matrix = [[f64; 2]; 2];

fn read_linear(s: &mut Section<'_>) -> Option<(Matrix, Matrix)> {
    let stiffness = matrix(s, "stiffness_n_per_m", Need::Required);
    let damping = matrix(s, "damping_n_s_per_m", Need::Optional);
    if stiffness.is_some_and(|k| k[0][0] + k[1][1] <= 0.0) {
        s.refuse("stiffness_n_per_m", "a mean of xx and yy above 0");
        return None;
    }
    let damping = if s.has("damping_n_s_per_m") { damping? } else { [[0.0; 2]; 2] };
    Some((stiffness?, damping))
}

/// A number for both directions, or [[xx, xy], [yx, yy]].
fn matrix(s: &mut Section<'_>, key: &'static str, need: Need) -> Option<Matrix> {
    let allowed = "a number, or [[xx, xy], [yx, yy]], each up to 1e13";
    if !s.is_array(key) {
        let number = s.number(key, need, NumberRange::closed(0.0, 1e13))?;
        return Some([[number, 0.0], [0.0, number]]);
    }
    let rows = s.rows(key, need, 2, allowed)?;
    let fits = rows.len() == 2 && rows.iter().flatten().all(|x| x.abs() <= 1e13);
    if !fits {
        s.refuse(key, allowed);
        return None;
    }
    Some([[rows[0][0], rows[0][1]], [rows[1][0], rows[1][1]]])
}

fn read_ball(s: &mut Section<'_>) -> Option<SceneBall> {
    let balls = s.whole("elements", Need::Required, 3..=200);
    let ball = length(s, length_keys!("element_diameter"), Need::Required, Span::Positive(1.0));
    let pitch = length(s, length_keys!("pitch_diameter"), Need::Required, Span::Positive(10.0));
    let geometry = geometry(s, balls, ball, pitch);
    let stiff = contact(s, ball.zip(pitch));
    let clearance = clearance(s);
    let damping = number_or(s, "damping_n_s_per_m", NumberRange::closed(0.0, 1e9), DAMPING_DEFAULT);
    let cage = s.number("cage_ratio", Need::Optional, NumberRange::closed(0.01, 0.99));
    let first_ball = angle(s, "first_ball_deg");
    let waves: Vec<_> = s.tables("wave", Need::Optional).into_iter().map(read_wave).collect();
    let size = balls.zip(ball.zip(pitch));
    let defects: Vec<_> =
        s.tables("defect", Need::Optional).into_iter().map(|d| read_defect(d, size)).collect();
    let orders = geometry?.fault_orders(RotatingRing::Inner);
    let (contact_factor, yield_load_n) = stiff?;
    Some(SceneBall {
        bearing: BallBearing {
            balls: balls?,
            turns: 1.0,
            contact_factor,
            clearance_m: clearance?,
            cage_ratio: cage.unwrap_or(orders.ftf),
            spin_ratio: orders.bsf,
            first_ball_rad: first_ball?,
            damping_n_s_per_m: damping?,
            defects: Vec::new(),
            waves: waves.into_iter().collect::<Option<_>>()?,
        },
        ball_diameter_m: ball?,
        pitch_diameter_m: pitch?,
        yield_load_n,
        defects: defects.into_iter().collect::<Option<_>>()?,
    })
}

fn geometry(
    s: &Section<'_>,
    balls: Option<u32>,
    ball_m: Option<f64>,
    pitch_m: Option<f64>,
) -> Option<BearingGeometry> {
    let (balls, ball_m, pitch_m) = (balls?, ball_m?, pitch_m?);
    BearingGeometry::new(balls, ball_m, pitch_m, 0.0)
        .map_err(|error| {
            let found = format!("{balls} balls of {ball_m} m on {pitch_m} m");
            s.log().report(s.start(), s.path().to_owned(), found, format!("a bearing: {error}"));
        })
        .ok()
}

/// Contact factor, N/m^1.5, and the load at which a contact yields, N.
fn contact(s: &mut Section<'_>, size: Option<(f64, f64)>) -> Option<(f64, Option<f64>)> {
    let range = NumberRange::positive_up_to(1e14);
    let given = s.number("contact_factor_n_per_m1_5", Need::Optional, range);
    let conformity =
        number_or(s, "conformity", NumberRange::closed(0.501, 0.6), CONFORMITY_DEFAULT);
    let young = number_or(s, "young_gpa", YOUNG_GPA, YOUNG_DEFAULT_GPA);
    let poisson = number_or(s, "poisson", POISSON, POISSON_DEFAULT);
    if s.has("contact_factor_n_per_m1_5") {
        for key in ["conformity", "young_gpa", "poisson"].into_iter().filter(|key| s.has(key)) {
            s.refuse(key, "either contact_factor_n_per_m1_5 or what it follows from");
        }
        return given.map(|factor| (factor, None));
    }
    let elastic = Elasticity { young_pa: young? * 1e9, poisson: poisson? };
    let (conformity, (ball_m, pitch_m)) = (conformity?, size?);
    let gamma = ball_m / pitch_m;
    let race = |gamma: f64| hertz::ball_on_race(ball_m, conformity, gamma);
    let factor = |(sum, difference)| hertz::contact_factor(elastic, sum, difference);
    let (inner, outer) = (race(gamma), race(-gamma));
    let series = hertz::in_series(factor(inner)?, factor(outer)?);
    let load = hertz::load_at_pressure(elastic, inner.0, inner.1, YIELD_PRESSURE_PA);
    Some((series, load))
}

fn clearance(s: &mut Section<'_>) -> Option<f64> {
    let clearance = length(s, length_keys!("clearance"), Need::Optional, Span::Signed(1e-3));
    let interference =
        length(s, length_keys!("interference"), Need::Optional, Span::FromZero(1e-3));
    match (clearance, interference) {
        (Some(_), Some(_)) => {
            let at = s.path_of("interference");
            s.log().report(s.start(), at, "both", "either clearance or interference");
            None
        }
        (Some(clearance), None) => Some(clearance),
        (None, Some(interference)) => Some(-interference),
        (None, None) => Some(0.0),
    }
}

fn read_wave(mut section: Section<'_>) -> Option<Wave> {
    let s = &mut section;
    let order = s.whole("order", Need::Required, 1..=500);
    let amplitude = length(s, length_keys!("amplitude"), Need::Required, Span::FromZero(1e-3));
    let phase_rad = angle(s, "phase_deg");
    section.finish();
    Some(Wave { order: order?, amplitude_m: amplitude?, phase_rad: phase_rad? })
}

fn read_defect(mut section: Section<'_>, size: Option<(u32, (f64, f64))>) -> Option<SceneDefect> {
    #[derive(Clone, Copy, PartialEq)]
    enum On {
        Inner,
        Outer,
        Ball,
    }
    let s = &mut section;
    let on = s.choice(
        "on",
        Need::Required,
        &[("inner_race", On::Inner), ("outer_race", On::Outer), ("ball", On::Ball)],
    );
    let last = size.map_or(200, |(balls, _)| balls) - 1;
    let ball = s.whole("ball", Need::Optional, 0..=last);
    if s.has("ball") && on != Some(On::Ball) {
        s.refuse("ball", "only with on = \"ball\"");
    }
    let width = length(s, length_keys!("width"), Need::Required, Span::Positive(1.0));
    let depth = length(s, length_keys!("depth"), Need::Required, Span::Positive(0.1));
    let radius_m = length(s, length_keys!("race_radius"), Need::Optional, Span::Positive(5.0));
    let angle_rad = angle(s, "angle_deg");
    let profile = s.choice(
        "profile",
        Need::Optional,
        &[
            ("geometric", ProfileKind::Geometric),
            ("step", ProfileKind::Step),
            ("raised_cosine", ProfileKind::RaisedCosine),
        ],
    );
    let profile = if s.has("profile") { profile? } else { ProfileKind::Geometric };
    section.finish();
    let place = match on? {
        On::Inner => DefectPlace::InnerRace,
        On::Outer => DefectPlace::OuterRace,
        On::Ball => DefectPlace::Element(ball.unwrap_or(0)),
    };
    let (width_m, depth_m, angle_rad) = (width?, depth?, angle_rad?);
    let defect = SceneDefect { place, angle_rad, width_m, depth_m, profile, radius_m };
    fits(&section, &defect, size?).then_some(defect)
}

/// Whether a defect is narrower than the space between two balls (on a ball: than a quarter of it).
fn fits(
    s: &Section<'_>,
    defect: &SceneDefect,
    (balls, (ball_m, pitch_m)): (u32, (f64, f64)),
) -> bool {
    let (radius_m, widest_rad) = match defect.place {
        DefectPlace::InnerRace => (0.5 * (pitch_m - ball_m), TAU / f64::from(balls)),
        DefectPlace::OuterRace => (0.5 * (pitch_m + ball_m), TAU / f64::from(balls)),
        DefectPlace::Element(_) => (0.5 * ball_m, 0.5 * PI),
    };
    let radius_m = defect.radius_m.unwrap_or(radius_m);
    let width_rad = defect.width_m / radius_m;
    if width_rad < widest_rad {
        return true;
    }
    let found = format!("{:.1}° of the race", width_rad.to_degrees());
    let allowed = format!("below {:.1}°, the space between two balls", widest_rad.to_degrees());
    s.log().report(s.start(), s.path_of("width"), found, allowed);
    false
}
