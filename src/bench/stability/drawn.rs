//! Scenes at random over the ranges that a scene's file may hold.
//!
//! A number of the scene decides all of it, so that a scene that fails can be had again. Sizes of parts are
//! drawn relative to each other, since a disc must be wider than its bore; what still does not fit is refused
//! by the reader, which is one of the right answers. Must not know how a scene is computed.

use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;
use std::fmt::Write;

/// What holds the shaft and drives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// Linear bearings at constant speed.
    Linear,
    /// A run-up or a reversal, on bearings of either kind.
    RunUp,
    /// Ball bearings without defects.
    Balls,
    /// Ball bearings with defects.
    Defects,
    /// A gear with or without faults.
    Gears,
}

impl Class {
    /// In the order of the table.
    pub const ALL: [Self; 5] = [Self::Linear, Self::RunUp, Self::Balls, Self::Defects, Self::Gears];

    /// Words of the table.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear bearings",
            Self::RunUp => "changing speed",
            Self::Balls => "ball bearings",
            Self::Defects => "ball bearings with defects",
            Self::Gears => "gears",
        }
    }
}

/// A scene's class and text.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn {
    /// Class.
    pub class: Class,
    /// A scene's file.
    pub text: String,
}

/// Numbers of the channels of a pair of probes at one place, in every scene.
pub const PROBES: [usize; 2] = [2, 3];

/// Draws the scene of this number.
#[must_use]
pub fn scene(number: u64) -> Drawn {
    let mut draw = Draw { random: Pcg64Mcg::seed_from_u64(number), text: String::new() };
    let class = match draw.random.random_range(0..20) {
        0..9 => Class::Linear,
        9..11 => Class::RunUp,
        11..14 => Class::Balls,
        14..18 => Class::Defects,
        _ => Class::Gears,
    };
    draw.head(class);
    let shaft = draw.shaft();
    draw.bearings(class, &shaft);
    draw.parts(class, &shaft);
    draw.sensors(&shaft);
    Drawn { class, text: draw.text }
}

struct Draw {
    random: Pcg64Mcg,
    text: String,
}

struct Shaft {
    length_m: f64,
    diameter_m: f64,
    bearings_m: Vec<f64>,
}

impl Draw {
    fn even(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.random.random::<f64>()
    }

    /// Evenly in the logarithm.
    fn log(&mut self, low: f64, high: f64) -> f64 {
        self.even(low.ln(), high.ln()).exp()
    }

    fn chance(&mut self, part: f64) -> bool {
        self.random.random::<f64>() < part
    }

    fn whole(&mut self, low: u32, high: u32) -> u32 {
        self.random.random_range(low..=high)
    }

    fn line(&mut self, key: &str, value: f64) {
        // Every digit: the number of the scene gives the same bits on every computer.
        let _never = writeln!(self.text, "{key} = {value:e}");
    }

    fn words(&mut self, line: &str) {
        let _never = writeln!(self.text, "{line}");
    }

    fn head(&mut self, class: Class) {
        let duration_s = match class {
            Class::Linear => 0.4,
            Class::RunUp => 0.1,
            Class::Balls | Class::Defects | Class::Gears => 0.03,
        };
        self.words("[scene]\nname = \"drawn\"");
        self.line("duration_s", duration_s);
        let start = if self.chance(0.5) && class != Class::RunUp { "rotating" } else { "rest" };
        self.words(&format!("start = \"{start}\""));
        let gravity = self.chance(0.5);
        self.words(&format!("gravity = {gravity}"));
        let accuracy = [1e-3, 1e-4, 1e-5][self.random.random_range(0..3)];
        self.line("accuracy", accuracy);
        let speed_hz = if self.chance(0.02) { 0.0 } else { self.log(0.05, 300.0) };
        let sign = if self.chance(0.2) { -1.0 } else { 1.0 };
        self.words("[speed]");
        if class == Class::RunUp {
            let end_hz = self.even(-300.0, 300.0);
            self.words(&format!(
                "points = [[0.0, {:e}], [{:e}, {end_hz:e}]]",
                sign * speed_hz,
                0.1 * duration_s
            ));
        } else {
            self.line("constant_hz", sign * speed_hz);
        }
        self.words("[modes]");
        let damping = if self.chance(0.1) { 0.0 } else { self.log(1e-5, 0.3) };
        self.line("damping", damping);
        if self.chance(0.3) {
            let count = self.whole(4, 24);
            self.words(&format!("count = {count}"));
        }
        if self.chance(0.1) {
            self.words("attachment = false");
        }
    }

    fn shaft(&mut self) -> Shaft {
        let length_m = self.log(0.05, 10.0);
        let diameter_m = length_m / self.log(8.0, 60.0);
        self.words("[shaft]");
        self.line("length_m", length_m);
        self.line("diameter_m", diameter_m);
        let (young, poisson) = (self.log(10.0, 1200.0), self.even(0.0, 0.49));
        self.line("young_gpa", young);
        self.line("poisson", poisson);
        let density = self.log(500.0, 30_000.0);
        self.line("density_kg_per_m3", density);
        let mut bearings_m = vec![self.even(0.01, 0.3) * length_m, self.even(0.7, 0.99) * length_m];
        if self.chance(0.15) {
            bearings_m.push(self.even(0.4, 0.6) * length_m);
        }
        Shaft { length_m, diameter_m, bearings_m }
    }

    fn bearings(&mut self, class: Class, shaft: &Shaft) {
        let all_balls = match class {
            Class::Linear => false,
            Class::Balls | Class::Defects => true,
            Class::RunUp | Class::Gears => self.chance(0.3),
        };
        for (i, at_m) in shaft.bearings_m.iter().enumerate() {
            self.words(&format!("[[bearing]]\nid = \"b{i}\""));
            self.line("at_m", *at_m);
            if self.chance(0.3) {
                let mass = shaft.diameter_m.powi(3) * self.log(10.0, 3e4);
                self.line("ring_mass_kg", mass);
            }
            if all_balls && !(i > 0 && self.chance(0.2)) {
                self.ball_bearing(class, shaft.diameter_m);
            } else {
                self.linear_bearing();
            }
        }
    }

    fn linear_bearing(&mut self) {
        self.words("kind = \"linear\"");
        let (x, y) = (self.log(1e4, 1e11), self.log(0.2, 5.0));
        if self.chance(0.5) {
            self.line("stiffness_n_per_m", x);
        } else {
            let cross = if self.chance(0.5) { self.even(-0.2, 0.2) * x } else { 0.0 };
            let y = x * y;
            self.words(&format!("stiffness_n_per_m = [[{x:e}, {cross:e}], [{:e}, {y:e}]]", -cross));
        }
        if self.chance(0.8) {
            let damping = self.log(0.1, 1e6);
            self.line("damping_n_s_per_m", damping);
        }
    }

    fn ball_bearing(&mut self, class: Class, shaft_m: f64) {
        let elements = self.whole(3, 60);
        let pitch_m = shaft_m * self.even(1.2, 3.0);
        let widest = 0.9 * (PI / f64::from(elements)).sin();
        let ball_m = pitch_m * widest.min(self.even(0.05, 0.35));
        self.words(&format!("kind = \"ball\"\nelements = {elements}"));
        self.line("element_diameter_m", ball_m);
        self.line("pitch_diameter_m", pitch_m);
        let conformity = self.even(0.501, 0.6);
        self.line("conformity", conformity);
        // Fits as they come on balls of this size, and ten times as far.
        let (fit_m, has_clearance) = (ball_m * self.log(1e-6, 5e-3), self.chance(0.6));
        self.line(if has_clearance { "clearance_m" } else { "interference_m" }, fit_m);
        let damping = if self.chance(0.1) { 0.0 } else { self.log(1.0, 1e4) };
        self.line("damping_n_s_per_m", damping);
        let first = self.even(-360.0, 360.0);
        self.line("first_ball_deg", first);
        if class == Class::Defects {
            for _ in 0..self.whole(1, 3) {
                self.defect(elements, ball_m, pitch_m);
            }
        }
        if self.chance(0.1) {
            let order = self.whole(1, 40);
            self.words(&format!("[[bearing.wave]]\norder = {order}"));
            let amplitude = ball_m * self.log(1e-6, 1e-3);
            self.line("amplitude_m", amplitude);
        }
    }

    fn defect(&mut self, elements: u32, ball_m: f64, pitch_m: f64) {
        let space = 2.0 * PI / f64::from(elements);
        let (on, widest_m) = match self.random.random_range(0..3) {
            0 => ("inner_race", 0.5 * space * (pitch_m - ball_m)),
            1 => ("outer_race", 0.5 * space * (pitch_m + ball_m)),
            _ => ("ball", 0.25 * PI * ball_m),
        };
        let profile = ["geometric", "step", "raised_cosine"][self.random.random_range(0..3)];
        self.words(&format!("[[bearing.defect]]\non = \"{on}\"\nprofile = \"{profile}\""));
        let (width, depth) = (widest_m * self.log(1e-3, 0.95), ball_m * self.log(1e-5, 0.05));
        self.line("width_m", width);
        self.line("depth_m", depth);
        let angle = self.even(-360.0, 360.0);
        self.line("angle_deg", angle);
    }

    fn parts(&mut self, class: Class, shaft: &Shaft) {
        let d = shaft.diameter_m;
        for _ in 0..self.whole(0, 3) {
            self.words("[[disc]]");
            let at = self.even(0.0, 1.0) * shaft.length_m;
            self.line("at_m", at);
            let (diameter, width) = (d * self.log(1.2, 12.0), d * self.log(0.1, 2.0));
            self.line("diameter_m", diameter);
            self.line("width_m", width);
            let density = self.log(500.0, 30_000.0);
            self.line("density_kg_per_m3", density);
            let eccentricity = if self.chance(0.2) { 0.0 } else { d * self.log(1e-7, 1e-2) };
            self.line("eccentricity_m", eccentricity);
            let angle = self.even(-360.0, 360.0);
            self.line("eccentricity_deg", angle);
        }
        if self.chance(0.2) {
            self.words("[bow]\nshape = \"half_sine\"");
            let amplitude = d * self.log(1e-6, 2e-2);
            self.line("amplitude_m", amplitude);
        }
        if self.chance(0.2) {
            self.words("[[unbalance]]");
            let (at, amount) = (self.even(0.0, 1.0) * shaft.length_m, self.log(1e-3, 1e3));
            self.line("at_m", at);
            self.line("amount_g_mm", amount);
        }
        if class == Class::Gears {
            self.gear(shaft);
        }
    }

    fn gear(&mut self, shaft: &Shaft) {
        let (teeth, mate) = (self.whole(12, 150), self.whole(12, 150));
        let module_mm = 1e3 * shaft.diameter_m * self.even(1.5, 6.0) / f64::from(teeth);
        self.words(&format!("[[gear]]\nid = \"g\"\nteeth = {teeth}\nmate_teeth = {mate}"));
        let at = self.even(0.0, 1.0) * shaft.length_m;
        self.line("at_m", at);
        self.line("module_mm", module_mm);
        let face_m = 1e-3 * module_mm * self.even(5.0, 15.0);
        self.line("face_width_m", face_m);
        // A bore that leaves the smaller of the two a rim.
        let root_m = 1e-3 * module_mm * (f64::from(teeth.min(mate)) - 3.5);
        self.line("bore_m", (0.6 * root_m).min(shaft.diameter_m));
        let torque = shaft.diameter_m.powi(3) * self.log(1e3, 1e7);
        let sign = if self.chance(0.2) { -1.0 } else { 1.0 };
        self.line("torque_nm", sign * torque);
        if self.chance(0.5) {
            let kind = ["worn", "cracked", "missing"][self.random.random_range(0..3)];
            let tooth = self.whole(1, teeth);
            self.words(&format!("[[gear.fault]]\nkind = \"{kind}\"\ntooth = {tooth}"));
            if kind != "missing" {
                let depth = 1e-3 * module_mm * self.log(1e-4, 0.3);
                self.line("depth_m", depth);
            }
        }
    }

    fn sensors(&mut self, shaft: &Shaft) {
        let middle_m = self.even(0.0, 1.0) * shaft.length_m;
        for (channel, place, kind, axis) in [
            ("ax", "bearing = \"b0\"".to_owned(), "accelerometer", 0.0),
            ("ay", "bearing = \"b1\"".to_owned(), "accelerometer", 90.0),
            ("px", format!("at_m = {middle_m:e}"), "proximitor", 0.0),
            ("py", format!("at_m = {middle_m:e}"), "proximitor", 90.0),
        ] {
            self.words(&format!(
                "[[sensor]]\nchannel = \"{channel}\"\nkind = \"{kind}\"\n{place}\naxis_deg = {axis:e}\nclean = true\n\
                 number = \"float64\""
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::scene::Scene;

    #[test]
    fn most_scenes_that_are_drawn_can_be_read_and_all_classes_come() {
        let drawn: Vec<Drawn> = (0..400).map(scene).collect();
        for class in Class::ALL {
            let of_class = drawn.iter().filter(|drawn| drawn.class == class);
            let all: Vec<_> = of_class.map(|drawn| Scene::parse(&drawn.text, "drawn")).collect();
            let n_read = all.iter().filter(|read| read.is_ok()).count();
            let why = all.iter().find_map(|read| read.as_ref().err().map(ToString::to_string));
            assert!(all.len() >= 20 && 2 * n_read > all.len(), "{class:?}: {n_read}, {why:?}");
        }
    }

    #[test]
    fn a_number_is_always_the_same_scene() {
        assert_eq!(scene(7), scene(7));
        assert_ne!(scene(7), scene(8));
    }
}
