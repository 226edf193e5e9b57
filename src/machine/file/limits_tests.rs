//! Mistakes in `[limits]`, and what is read where keys are absent.

use super::*;
use crate::machine::alarm_limit::JudgedIn;
use crate::machine::alarm_limit::Quantity;
use crate::units::Unit;

const HEAD: &str = "[machine]\nid = 'm'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n\
    [[sensor]]\nchannel = 'x'\nkind = 'accelerometer'\nunit = 'g'\nat = { shaft = 'main' }\n\
    [[sensor]]\nchannel = 'y'\nkind = 'accelerometer'\nunit = 'g'\nat = { shaft = 'main' }\n\
    [[sensor]]\nchannel = 'gap'\nkind = 'proximitor'\nunit = 'um'\nat = { shaft = 'main' }\n";

fn read(limits: &str) -> Result<Machine, MachineFileErrors> {
    parse(&format!("{HEAD}{limits}"), "m.toml")
}

/// A limit of a kind with further keys, as the only one.
fn limit(kind: &str, rest: &str) -> String {
    format!("[[limits.alarm]]\nid = 'a'\nkind = '{kind}'\n{rest}\n")
}

#[test]
fn absent_keys_have_their_defaults() {
    let machine = read(&limit("gap", "unit = 'mm'\nwarning_below = 0.5")).unwrap();
    let found = &machine.alarm_limits.limits[0];
    assert_eq!((found.sensors.as_slice(), found.votes), (&[2][..], 1));
    assert_eq!((found.unit, found.thresholds.warning_below), (Unit::Micrometre, Some(500.0)));
    assert_eq!((found.judged_in, found.raises, found.latching), (JudgedIn::ALWAYS, true, false));
    assert!((found.hysteresis - 0.05).abs() < 1e-15);
    assert_eq!((found.on_delay_s, found.off_delay_s), (None, None));
    let machine = read(&limit("order", "order = 2\nunit = 'g'\nwarning_above = 1")).unwrap();
    let found = &machine.alarm_limits.limits[0];
    assert_eq!(found.sensors, [0, 1], "channels of this unit");
    assert!(matches!(found.quantity, Quantity::Order { order, .. } if (order - 2.0).abs() < 1e-15));
    assert_eq!(found.judged_in, JudgedIn::STEADY);
}

#[test]
fn bins_of_load_rise() {
    assert_eq!(read("").unwrap().limits.load_bins, [0.0; 0]);
    let stated = read("[limits]\nload_bins = [-1, 0.5, 20]\n").unwrap();
    assert_eq!(stated.limits.load_bins, [-1.0, 0.5, 20.0]);
    assert_eq!(stated.limits_in_force().load_bins, stated.limits.load_bins);
    for wrong in ["[]", "[2, 1]", "[1, 1]", "[nan]", "['a']", "3"] {
        let text = read(&format!("[limits]\nload_bins = {wrong}\n")).unwrap_err().to_string();
        assert!(text.contains("each above the one before"), "{wrong}: {text}");
    }
}

#[test]
fn every_mistake_is_told_with_what_is_allowed() {
    let unit = "unit = 'g'\nwarning_above = 1\n";
    for (text, words) in [
        (limit("loud", ""), "\"velocity_rms\""),
        (limit("velocity_rms", ""), "iso_group where it applies"),
        (limit("velocity_rms", "warning_above = 1\nunit = 'mm/s'"), "an unknown key"),
        (limit("velocity_rms", "baseline_mm_per_s = 1\nwarning_above = 2"), "iso_group only"),
        (limit("band", unit), "[low, high] in Hz"),
        (limit("band", "band_hz = [200, 100]\nunit = 'g'\nwarning_above = 1"), "low below high"),
        (limit("band", "band_hz = [1, 2]\nwarning_above = 1"), "m/s^2"),
        (limit("band", "band_hz = [1, 2]\nunit = 'parsec'\nwarning_above = 1"), "m/s^2"),
        (limit("order", unit), "limits.alarm[0].order"),
        (limit("order", &format!("order = 1\nshaft = 'mian'\n{unit}")), "main"),
        (limit("order", &format!("order = 1\nchannels = ['z']\n{unit}")), ": x, y, gap"),
        (limit("order", &format!("order = 1\nchannels = ['x', 'x']\n{unit}")), "each once"),
        (limit("order", &format!("order = 1\nchannels = ['gap']\n{unit}")), "`gap` is not one"),
        (limit("order", &format!("order = 1\nvotes = 3\n{unit}")), "from 1 to 2"),
        (limit("order", &format!("order = 1\ndamaged_above = 1\n{unit}")), "above the limit"),
        (limit("order", &format!("order = 1\nby_speed = [[0, 9, 1, 2]]\n{unit}")), "not both"),
        (
            limit("order", "order = 1\nunit = 'g'\nby_speed = [[0, 9, 1, 2], [8, 9, 1, 2]]"),
            "none overlapping",
        ),
        (limit("order", &format!("order = 1\nstates = ['asleep']\n{unit}")), "transient"),
        (limit("order", &format!("order = 1\nstartup_multiply = 2\n{unit}")), "[limits.startup]"),
        (limit("order", &format!("order = 1\nhysteresis_percent = 100\n{unit}")), "below 100"),
        (limit("feature", "warning_above = 1"), "limits.alarm[0].feature"),
        (limit("vote", "of = ['a']\nvotes = 1"), "above this one"),
        (limit("vote", "of = ['b']\nvotes = 1"), "each once"),
        (limit("velocity_change", "warning_above = 1"), "reference_mm_per_s"),
        (limit("vector_change", "reference = 1\nunit = 'g'\nwarning_above = 1"), "phase_deg"),
        ("[limits.startup]\nmax_s = 10\n".to_owned(), "speed_hz"),
        ("[limits]\nalarms = 1\n".to_owned(), "an unknown key"),
    ] {
        let found = read(&text).expect_err(&text).to_string();
        assert!(found.contains(words), "`{words}` not in:\n{found}\nof\n{text}");
    }
}

#[test]
fn two_limits_of_one_name_are_a_mistake() {
    let one = limit("velocity_rms", "warning_above = 1");
    let found = read(&format!("{one}{one}")).unwrap_err().to_string();
    assert!(found.contains("a id used once"), "{found}");
}

#[test]
fn displacements_have_the_zones_of_the_group_and_of_the_speed() {
    let text = format!("{HEAD}{}", limit("displacement_rms", ""));
    let machine =
        parse(&text.replace("id = 'm'", "id = 'm'\niso_group = '2-rigid'"), "m.toml").unwrap();
    let found = &machine.alarm_limits.limits[0];
    assert_eq!((found.sensors.as_slice(), found.unit), (&[0, 1][..], Unit::Micrometre));
    assert_eq!(
        (found.thresholds.warning_above, found.thresholds.damaged_above),
        (Some(45.0), Some(71.0))
    );
    assert!(read(&limit("displacement_rms", "")).unwrap_err().to_string().contains("iso_group"));
    // 10 Hz are 600 r/min, below what the formula is for; 25 Hz are 1500.
    let text = read(&limit("shaft_displacement", "")).unwrap_err().to_string();
    assert!(text.contains("max_speed_hz between 16.67 and 500"), "{text}");
    let machine =
        read(&limit("shaft_displacement", "max_speed_hz = 25\ndamaged_above = 400")).unwrap();
    let found = &machine.alarm_limits.limits[0];
    assert_eq!(
        (found.sensors.as_slice(), found.quantity.clone()),
        (&[2][..], Quantity::PeakToPeak)
    );
    let warning = found.thresholds.warning_above.unwrap();
    assert!((warning - 9000.0 / 1500.0_f64.sqrt()).abs() < 1e-9);
    assert_eq!(found.thresholds.damaged_above, Some(400.0), "what is stated comes first");
}
