//! Scene files: what is read, and what is told of mistakes.

use super::*;

/// A small scene, right as it stands.
pub(in crate::simulator) const SMALL: &str = r#"
[scene]
name = "small"
duration_s = 1.0
start = "rotating"
[speed]
constant_hz = 20.0
[shaft]
length_mm = 500.0
diameter_mm = 16.0
[[disc]]
at_mm = 250.0
diameter_mm = 150.0
width_mm = 15.0
eccentricity_um = 20.0
[[bearing]]
id = "left"
kind = "ball"
at_mm = 50.0
elements = 11
element_diameter_mm = 7.9375
pitch_diameter_mm = 33.5
interference_um = 1.0
[[bearing]]
id = "right"
kind = "linear"
at_mm = 450.0
stiffness_n_per_m = 1e8
[[sensor]]
channel = "x"
kind = "accelerometer"
bearing = "left"
"#;

fn told(text: &str) -> String {
    Scene::parse(text, "s.toml").unwrap_err().to_string()
}

/// The one mistake of the small scene with `from` replaced.
fn mistake(from: &str, to: &str) -> String {
    assert!(SMALL.contains(from), "{from}");
    told(&SMALL.replacen(from, to, 1))
}

#[test]
fn every_built_in_scene_is_right_and_says_its_name() {
    for name in builtin::names() {
        let scene = Scene::parse(builtin::text(name).unwrap(), name).unwrap();
        assert!(scene.name.starts_with(name), "{name}: {}", scene.name);
    }
    assert_eq!(builtin::text("seed-bearing-41hz"), None);
}

#[test]
fn a_length_is_the_same_in_every_unit() {
    let metric = Scene::parse(SMALL, "s").unwrap();
    let inch = SMALL
        .replace("length_mm = 500.0", "length_in = 19.685039370078741")
        .replace("interference_um = 1.0", "clearance_mil = -0.039370078740157")
        .replace("at_mm = 250.0", "at_m = 0.25");
    let inch = Scene::parse(&inch, "s").unwrap();
    assert!((metric.shafts[0].length_m - inch.shafts[0].length_m).abs() < 1e-15);
    assert!((metric.discs[0].disc.at_m - inch.discs[0].disc.at_m).abs() < 1e-15);
    let clearance = |scene: &Scene| match &scene.bearings[0].kind {
        BearingKind::Ball(ball) => ball.bearing.clearance_m,
        BearingKind::Linear { .. } => f64::NAN,
    };
    // The figures in inches have 13 digits.
    assert!((clearance(&metric) - clearance(&inch)).abs() < 1e-18, "{}", clearance(&inch));
}

#[test]
fn every_mistake_is_told_with_its_place_all_at_once() {
    let text = SMALL
        .replace("duration_s = 1.0", "duration_s = -1.0")
        .replace("elements = 11", "elemnts = 11")
        .replace("kind = \"accelerometer\"", "kind = \"microphone\"");
    let told = told(&text);
    assert!(told.contains("s.toml:4:14: scene.duration_s: found -1.0, allowed: "), "{told}");
    assert!(told.contains("s.toml:20:1: bearing[0].elemnts: found an unknown key"), "{told}");
    assert!(told.contains("did you mean `elements`?"), "{told}");
    assert!(told.contains("s.toml:31:8: sensor[0].kind: found \"microphone\""), "{told}");
}

#[test]
fn what_cannot_be_is_refused_with_what_is_allowed() {
    for (from, to, expected) in [
        (
            "at_mm = 250.0",
            "at_mm = 501.0",
            "disc[0].at_mm: found 501.0, allowed: a number from 0 to 500",
        ),
        ("at_mm = 250.0", "at_mm = nan", "disc[0].at_mm: found nan"),
        ("at_mm = 250.0", "at_mm = 1.0\nat_in = 1.0", "one key for this length"),
        ("at_mm = 250.0", "", "as one of at_mm, at_m, at_um, at_in, at_mil"),
        ("diameter_mm = 150.0", "diameter_mm = 10.0", "a disc wider than its bore"),
        ("pitch_diameter_mm = 33.5", "pitch_diameter_mm = 20.0", "a bearing: "),
        (
            "interference_um = 1.0",
            "interference_um = 1.0\nclearance_um = 1.0",
            "either clearance or interference",
        ),
        ("stiffness_n_per_m = 1e8", "stiffness_n_per_m = [[1e8, 0], [0]]", "[[xx, xy], [yx, yy]]"),
        (
            "stiffness_n_per_m = 1e8",
            "stiffness_n_per_m = [[-1e8, 0], [0, 0]]",
            "mean of xx and yy above 0",
        ),
        ("bearing = \"left\"", "bearing = \"middle\"", "the id of a [[bearing]]: left, right"),
        ("bearing = \"left\"", "at_mm = 600.0", "sensor[0].at_mm"),
        (
            "bearing = \"left\"",
            "bearing = \"left\"\nclean = true\nnoise_ug_per_sqrt_hz = 1",
            "either clean",
        ),
        ("constant_hz = 20.0", "points = [[0.0, 1.0], [0.0, 2.0]]", "times rising"),
        ("constant_hz = 20.0", "", "constant_hz or points"),
        ("start = \"rotating\"", "start = \"slowly\"", "\"rest\", \"rotating\""),
    ] {
        let told = mistake(from, to);
        assert!(told.contains(expected), "{to}: {told}");
    }
    let together = mistake("at_mm = 450.0", "at_mm = 50.1");
    assert!(together.contains("found bearings left and right at one place"), "{together}");
    let one = SMALL.split("[[bearing]]\nid = \"right\"").next().unwrap();
    assert!(told(one).contains("at least 2 tables [[bearing]]"), "{}", told(one));
    assert!(told(&"#".repeat(MAX_TEXT_BYTES + 1)).contains("up to 60000 bytes"));
}

#[test]
fn a_defect_is_narrower_than_the_space_between_balls() {
    let with = |width: &str| {
        let table = format!(
            "interference_um = 1.0\n[[bearing.defect]]\non = \"inner_race\"\n{width}\ndepth_um = 50.0\n"
        );
        Scene::parse(&SMALL.replace("interference_um = 1.0\n", &table), "s.toml")
    };
    // 360°/11 on a radius of 12.78 mm is 7.30 mm.
    assert!(with("width_mm = 7.2").is_ok());
    let text = with("width_mm = 7.4").unwrap_err().to_string();
    assert!(text.contains("below 32.7°, the space between two balls"), "{text}");
    let scene = with("width_mm = 1.0").unwrap();
    assert_eq!(scene.faults().defects.len(), 1);
    let truth: toml::Table = scene.truth().parse().unwrap();
    let fault = truth["fault"][0].as_table().unwrap();
    assert_eq!(fault["id"].as_str(), Some("left"));
    assert!((fault["width_m"].as_float().unwrap() - 1e-3).abs() < 1e-15);
}

/// A gear that fits the small scene.
const GEAR: &str = "[[gear]]\nid = \"g\"\nat_mm = 480.0\nteeth = 28\nmodule_mm = 2.5\nface_width_mm = 10.0\ntorque_nm = 3.0\n";

#[test]
fn a_gear_is_read_with_its_faults_and_what_follows_from_it() {
    let faults = "[[gear.fault]]\nkind = \"cracked\"\ntooth = 8\nmember = \"mate\"\ndepth_mm = 1.0\n\
                  [[gear.fault]]\nkind = \"pitch_error\"\ntooth = 1\noffset_um = 5.0\n\
                  [[gear.fault]]\nkind = \"profile_error\"\ntooth = 2\nslope_um = 5.0\n";
    let text = format!("{SMALL}{GEAR}mate_teeth = 35\ntooth_1_at_deg = 10.0\n{faults}");
    let scene = Scene::parse(&text, "s").unwrap();
    assert!(scene.has_contacts());
    let gear = &scene.gears[0];
    assert_eq!((gear.design.gear.teeth, gear.design.mate.teeth, gear.faults.len()), (28, 35, 3));
    // Solid, 70 mm on 16 mm, 10 mm wide.
    let mass = 7833.4 * std::f64::consts::PI / 4.0 * (0.07_f64.powi(2) - 0.016_f64.powi(2)) * 0.01;
    assert!((gear.disc.mass_kg / mass - 1.0).abs() < 1e-12);
    assert!((1.5..1.75).contains(&gear.design.path.contact_ratio()));
    // Beyond mid-span the load sits at the other end.
    assert!(gear.torque_at_m.abs() < 1e-15);
    // A mate with other teeth meets another tooth each turn.
    assert_eq!(gear.tooth_angle_deg(&gear.faults[0]), None);
    let second = gear.tooth_angle_deg(&gear.faults[2]).unwrap();
    assert!((second - 10.0 - 360.0 / 28.0).abs() < 1e-9, "{second}");
    let truth: toml::Table = scene.truth().parse().unwrap();
    let listed = truth["fault"].as_array().unwrap();
    assert_eq!(listed[0]["member"].as_str(), Some("driving"));
    assert_eq!(listed[1]["kind"].as_str(), Some("pitch_error"));
    let inch = text.replace("module_mm = 2.5", "diametral_pitch_per_in = 10.16");
    let inch = Scene::parse(&inch, "s").unwrap();
    assert!((inch.gears[0].design.gear.module_m - 2.5e-3).abs() < 1e-15);
}

#[test]
fn gears_that_cannot_mesh_are_refused() {
    for (from, to, expected) in [
        ("teeth = 28", "teeth = 28\ntoth = 1", "found an unknown key"),
        ("teeth = 28", "teeth = 7", "gear[0].teeth"),
        ("module_mm = 2.5", "", "either module_mm or diametral_pitch_per_in"),
        ("torque_nm = 3.0", "", "gear[0].torque_nm"),
        (
            "torque_nm = 3.0",
            "torque_nm = 3.0\ncontact_ratio = 1.9",
            "that of these gears' geometry",
        ),
        ("torque_nm = 3.0", "torque_nm = 3.0\nbore_mm = 50.0", "foundation = false"),
        (
            "torque_nm = 3.0",
            "torque_nm = 3.0\ndamping_ratio = 0.1\ndamping_n_s_per_m = 1.0",
            "either damping_ratio or damping_n_s_per_m",
        ),
        ("torque_nm = 3.0", "torque_nm = 3.0\ndrive = \"loose\"", "\"prescribed\""),
        (
            "torque_nm = 3.0",
            "torque_nm = 3.0\n[[gear.fault]]\nkind = \"missing\"\ntooth = 29",
            "tooth 29 of a gear with 28 teeth",
        ),
        (
            "torque_nm = 3.0",
            "torque_nm = 3.0\n[[gear.fault]]\nkind = \"worn\"\ntooth = 2",
            "a stiffness_factor, or both",
        ),
        (
            "torque_nm = 3.0",
            "torque_nm = 3.0\n[[gear.fault]]\nkind = \"worn\"\ntooth = 2\ndepth_mm = 4.0",
            "tooth 2 worn and cracked down to",
        ),
    ] {
        let told = told(&format!("{SMALL}{}", GEAR.replacen(from, to, 1)));
        assert!(told.contains(expected), "{to}: {told}");
    }
    let second = GEAR.replace("\"g\"", "\"h\"");
    assert!(told(&format!("{SMALL}{GEAR}{second}")).contains("one table [[gear]]"));
}
