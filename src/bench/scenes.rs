//! The rig as a scene, in the variants that the simulator's figures are measured on.

use crate::simulator::scene::{Scene, SceneErrors};

/// A variant of the rig at 40 Hz on two ball bearings, the right one damaged or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig<'a> {
    /// `[speed]`.
    pub speed: &'a str,
    /// Clearance or interference of both bearings.
    pub fit: &'a str,
    /// Whether there is gravity.
    pub gravity: bool,
    /// Width, in, depth, mil, and profile of the inner-race defect of the right bearing.
    pub defect: Option<(f64, f64, &'a str)>,
    /// `[modes]`.
    pub modes: &'a str,
    /// Accuracy asked for.
    pub accuracy: f64,
    /// Of both discs, in phase.
    pub eccentricity_um: f64,
}

/// Set A, bearing 3: interference, a step 0.05 in wide and 4 mil deep, from rest.
pub const A3: Rig<'static> = Rig {
    speed: "constant_hz = 40.0",
    fit: "interference_um = 0.5",
    gravity: false,
    defect: Some((0.05, 4.0, "step")),
    modes: "count = 12\ndamping = 0.002",
    accuracy: 1e-4,
    eccentricity_um: 100.0,
};

/// Set D with the true path of the balls: clearance and gravity.
pub const D3: Rig<'static> =
    Rig { fit: "clearance_um = 2.0", gravity: true, defect: Some((0.05, 4.0, "geometric")), ..A3 };

/// Set D without a defect: balls are loaded and unloaded.
pub const D0: Rig<'static> = Rig { defect: None, ..D3 };

const SHAFT: &str = "[shaft]\nlength_in = 21.0\ndiameter_in = 0.625\nyoung_gpa = 206.8427\n\
    poisson = 0.29\ndensity_kg_per_m3 = 7833.4\n";

fn discs(eccentricity_um: f64) -> String {
    let disc = |at: f64| {
        format!(
            "[[disc]]\nat_in = {at}\ndiameter_in = 6.0\nwidth_in = 0.625\n\
             density_kg_per_m3 = 2700.0\neccentricity_um = {eccentricity_um:?}\n"
        )
    };
    format!("{}{}", disc(7.2985), disc(13.7015))
}

/// Accelerometers along x and y at the right bearing, a probe in the middle; all clean.
fn clean_sensors() -> String {
    let sensor = |channel: &str, lines: &str| {
        format!(
            "[[sensor]]\nchannel = \"{channel}\"\nclean = true\nnumber = \"float64\"\n{lines}\n"
        )
    };
    let seat = "kind = \"accelerometer\"\nbearing = \"right\"\naxis_deg =";
    format!(
        "{}{}{}",
        sensor("right_x", &format!("{seat} 0.0")),
        sensor("right_y", &format!("{seat} 90.0")),
        sensor("mid_x", "kind = \"proximitor\"\nat_in = 10.5\naxis_deg = 0.0\nunit = \"um\"")
    )
}

/// Accelerometers along x and y at the right bearing and, if all are wanted, at the left one; probes in the
/// middle; noise and converters as they come.
fn noisy_sensors(bearings: &[&str]) -> String {
    let sensor = |channel: &str, kind: &str, place: &str, axis_deg: f64| {
        format!(
            "[[sensor]]\nchannel = \"{channel}\"\nkind = \"{kind}\"\n{place}\n\
             axis_deg = {axis_deg:?}\nfull_scale = 1000.0\n"
        )
    };
    let axes = [("x", 0.0), ("y", 90.0)];
    let mut text = String::new();
    for bearing in bearings {
        for (axis, axis_deg) in axes {
            let place = format!("bearing = \"{bearing}\"");
            text += &sensor(&format!("{bearing}_{axis}"), "accelerometer", &place, axis_deg);
        }
    }
    for (axis, axis_deg) in axes {
        text += &sensor(&format!("mid_{axis}"), "proximitor", "at_in = 10.5", axis_deg);
    }
    text
}

impl Rig<'_> {
    /// The scene with three clean sensors.
    ///
    /// # Errors
    ///
    /// Mistakes in the texts given.
    pub fn scene(&self) -> Result<Scene, SceneErrors> {
        self.with_sensors(&clean_sensors())
    }

    /// The scene with seven channels as a recorder has them: six sensors with noise and converters, and a
    /// tacho.
    ///
    /// # Errors
    ///
    /// Mistakes in the texts given.
    pub fn noisy_scene(&self) -> Result<Scene, SceneErrors> {
        let tacho = "[[sensor]]\nchannel = \"tacho\"\nkind = \"tacho\"\n";
        self.with_sensors(&(noisy_sensors(&["left", "right"]) + tacho))
    }

    fn with_sensors(&self, sensors: &str) -> Result<Scene, SceneErrors> {
        let Self { speed, fit, gravity, modes, accuracy, .. } = self;
        let ball = |id: &str, at: f64| {
            format!(
                "[[bearing]]\nid = \"{id}\"\nkind = \"ball\"\nat_in = {at}\nelements = 11\n\
                 element_diameter_mm = 7.9375\npitch_diameter_mm = 33.5\n\
                 contact_factor_n_per_m1_5 = 9.239e9\ncage_ratio = 0.3816793893129771\n{fit}\n\
                 damping_n_s_per_m = 200.0\nring_mass_kg = 0.05\nsupport_n_per_m = 1.078e8\n"
            )
        };
        let defect = self.defect.map_or(String::new(), |(width, depth, profile)| {
            format!(
                "[[bearing.defect]]\non = \"inner_race\"\nwidth_in = {width}\ndepth_mil = {depth}\n\
                 race_radius_in = 0.50325\nprofile = \"{profile}\"\n"
            )
        });
        let text = format!(
            "[scene]\nname = \"rig\"\nduration_s = 1.0\nstart = \"rest\"\ngravity = {gravity}\n\
             accuracy = {accuracy:e}\n[speed]\n{speed}\n{SHAFT}[modes]\n{modes}\n{}{}{}{defect}{}",
            discs(self.eccentricity_um),
            ball("left", 3.5148),
            ball("right", 17.4852),
            sensors
        );
        Scene::parse(&text, "rig.toml")
    }
}

/// A bowed shaft on linear bearings with cross terms that runs up through its first critical speed
/// (0 to 200 Hz in 0.1 s).
///
/// # Errors
///
/// None: the text is fixed.
pub fn bow_run_up() -> Result<Scene, SceneErrors> {
    let bearing = |id: &str, at: f64| {
        format!(
            "[[bearing]]\nid = \"{id}\"\nkind = \"linear\"\nat_in = {at}\n\
             stiffness_n_per_m = [[1.078e8, 2e6], [-2e6, 0.9e8]]\ndamping_n_s_per_m = 2000.0\n"
        )
    };
    let text = format!(
        "[scene]\nname = \"bow\"\nduration_s = 1.0\nstart = \"rest\"\n[speed]\n\
         points = [[0.0, 0.0], [0.1, 200.0]]\n{SHAFT}[modes]\ncount = 12\ndamping = 0.01\n\
         [bow]\nshape = \"half_sine\"\namplitude_mil = 8.0\n{}{}{}{}",
        discs(100.0),
        bearing("left", 3.5148),
        bearing("right", 17.4852),
        clean_sensors()
    );
    Scene::parse(&text, "rig.toml")
}

/// The rig at 40 Hz on linear bearings with four channels: bent and turning for ever, or with unbalance alone
/// from rest. Computed exactly.
///
/// # Errors
///
/// None: the text is fixed.
pub fn linear(is_bent: bool) -> Result<Scene, SceneErrors> {
    let bearing = |id: &str, at: f64| {
        format!(
            "[[bearing]]\nid = \"{id}\"\nkind = \"linear\"\nat_in = {at}\n\
             stiffness_n_per_m = 1.078e8\ndamping_n_s_per_m = 200.0\n"
        )
    };
    let (start, bow) = if is_bent {
        ("rotating", "[bow]\nshape = \"half_sine\"\namplitude_mil = 8.0\n")
    } else {
        ("rest", "")
    };
    let text = format!(
        "[scene]\nname = \"linear\"\nduration_s = 1.0\nstart = \"{start}\"\n[speed]\n\
         constant_hz = 40.0\n{SHAFT}[modes]\ndamping = 0.01\n{bow}{}{}{}{}",
        discs(100.0),
        bearing("left", 3.5148),
        bearing("right", 17.4852),
        noisy_sensors(&["right"])
    );
    Scene::parse(&text, "rig.toml")
}
