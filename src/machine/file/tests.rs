//! Tests of the machine file's reader: right files, every kind of mistake, hostile input.

use super::*;
use crate::machine::bearing::RotatingRing;
use crate::machine::limits::IsoGroup;
use crate::machine::sensor::{Location, SensorKind, SensorPair, TachoEdge};
use crate::machine::shaft::Rotation;
use crate::machine::uncertainty::OrderBands;
use crate::machine::{BearingIndex, ShaftIndex};
use crate::units::{Hz, Unit};

const RIG: &str = include_str!("../../../config/machines/rig.toml");
const STAND: &str = include_str!("../../../config/machines/motor-stand.toml");

/// A head, a shaft and whatever follows.
fn machine_with(rest: &str) -> String {
    format!("[machine]\nid = 'm'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n{rest}")
}

/// The mistakes of a file, one text each.
fn mistakes(text: &str) -> Vec<String> {
    let errors = parse(text, "m.toml").unwrap_err();
    errors.to_string().lines().map(str::to_owned).collect()
}

/// Asserts that `rest` (from line 6 on) makes exactly one mistake, at `place`, worded so.
fn one_mistake(rest: &str, place: &str, words: &[&str]) {
    let found = mistakes(&machine_with(rest));
    assert_eq!(found.len(), 1, "{found:#?}");
    assert!(found[0].starts_with(&format!("m.toml:{place}: ")), "{}", found[0]);
    for word in words {
        assert!(found[0].contains(word), "`{word}` not in: {}", found[0]);
    }
}

#[test]
fn the_rig_reads_as_it_stands() {
    let rig = parse(RIG, "rig.toml").unwrap();
    assert_eq!((rig.id.as_str(), rig.shafts.len(), rig.sensors.len()), ("rig-1", 2, 7));
    let main = &rig.shafts[0];
    assert_eq!(main.rotation, Some(Rotation::Ccw));
    assert_eq!((main.first_critical, main.running_above), (Some(Hz(117.0)), Some(Hz(1.0))));
    assert_eq!(rig.shafts[1].nominal_speed, Some(Hz(10.0)));
    assert_eq!(rig.shaft_speed(ShaftIndex(1), Hz(40.0)), Some(Hz(40.0)));
    let right = rig.bearing(BearingIndex(1));
    assert_eq!(right.rotating_ring, RotatingRing::Inner);
    // 7.9375 mm converts to metres with one rounding.
    assert!((right.geometry.unwrap().element_diameter_m() - 7.9375e-3).abs() < 1e-17);
    assert_eq!(rig.component_at(&rig.sensors[2]).unwrap().id(), "right");
    assert_eq!(rig.shaft_at(&rig.sensors[2]), Some(ShaftIndex(0)));
    let tacho = rig.sensors[6].tacho.unwrap();
    assert_eq!((tacho.pulses_per_rev, tacho.edge), (1, TachoEdge::Rising));
    let pairs = [(0, 1), (2, 3), (4, 5)].map(|(x, y)| SensorPair { x, y });
    assert_eq!(rig.sensor_pairs(), pairs);
    assert!(rig.notes.is_empty());
}

#[test]
fn the_motor_stand_reads_with_limits_map_and_note() {
    let stand = parse(STAND, "motor-stand.toml").unwrap();
    assert_eq!(stand.limits.velocity_rms_damaged_mm_per_s, Some(4.5));
    assert_eq!(stand.capture_map["FE"], "/X105_FE_time,rate=12000");
    assert_eq!(stand.notes.len(), 1, "{:?}", stand.notes);
    assert!(stand.notes[0].contains("bearing[0]"), "{}", stand.notes[0]);
    assert_eq!(stand.sensors[1].canonical_unit(), Some(Unit::MetrePerSecondSquared));
    assert!(stand.sensor_pairs().is_empty());
}

#[test]
fn defaults_hold_where_keys_are_absent() {
    let text = machine_with(
        "[[bearing]]\nid='b'\nshaft='main'\ncatalogue='SKF 6204'\n\
         [[motor]]\nshaft='main'\npoles=4\n\
         [[sensor]]\nchannel='t'\nkind='tacho'\n\
         [[sensor]]\nchannel='load'\nkind='load'\nunit='kN'\n",
    );
    let machine = parse(&text, "m.toml").unwrap();
    assert_eq!(machine.name, "m");
    assert_eq!(machine.bearings[0].rotating_ring, RotatingRing::Inner);
    assert_eq!(machine.bearings[0].geometry.unwrap().elements(), 8);
    assert!(!machine.motors[0].synchronous);
    let tacho = &machine.sensors[0];
    assert_eq!(tacho.at, Some(Location::Shaft(ShaftIndex(0))));
    assert_eq!(tacho.tacho.unwrap().pulses_per_rev, 1);
    let load = &machine.sensors[1];
    assert_eq!((load.kind, load.at), (SensorKind::Load, None));
    assert_eq!(load.canonical_unit(), Some(Unit::Unknown));
    assert_eq!(machine.iso_group, None::<IsoGroup>);
}

#[test]
fn a_designation_alone_gives_the_geometry_its_limits_and_a_note() {
    let text = machine_with("[[bearing]]\nid='b'\nshaft='main'\ncatalogue='SKF 6205-2RSH/C3'\n");
    let machine = parse(&text, "m.toml").unwrap();
    let bearing = &machine.bearings[0];
    assert_eq!(bearing.geometry.unwrap().elements(), 9);
    assert!(bearing.bands.bpfo.high > 0.003 && bearing.bands.bpfo.high < 0.005);
    assert_eq!(machine.notes.len(), 1);
    for words in ["line 9: bearing[0]: 6205 of the catalogue (confirmed)", "ignored: 2RSH (seal)"] {
        assert!(machine.notes[0].contains(words), "{:?}", machine.notes);
    }
}

#[test]
fn an_unknown_designation_is_a_mistake_with_a_remedy() {
    one_mistake(
        "[[bearing]]\nid='b'\nshaft='main'\ncatalogue='SKF 22210 E'\n",
        "9:11",
        &[
            "bearing[0].catalogue: found 'SKF 22210 E'",
            "nearest: ",
            "elements, element_diameter_mm",
        ],
    );
    one_mistake(
        "[[bearing]]\nid='b'\nshaft='main'\ncatalogue='NU 205'\n",
        "9:11",
        &["write NU205E"],
    );
}

#[test]
fn a_stated_geometry_wins_and_what_differs_is_said() {
    let geometry = "element_diameter_mm=7.94\npitch_diameter_mm=39.04\n";
    let read = |designation: &str, n: u32| {
        let text = machine_with(&format!(
            "[[bearing]]\nid='b'\nshaft='main'\ncatalogue='{designation}'\nelements={n}\n{geometry}"
        ));
        parse(&text, "m.toml").unwrap()
    };
    let same = read("SKF 6205", 9);
    assert_eq!(same.notes.len(), 1, "{:?}", same.notes);
    assert_eq!(same.bearings[0].bands, OrderBands::default());
    let other = read("SKF 6205", 8);
    assert_eq!(other.bearings[0].geometry.unwrap().elements(), 8);
    assert!(other.notes.iter().any(|note| note.contains("differs from that of 6205")));
    assert_eq!(read("X 17", 9).notes.len(), 1);
}

#[test]
fn every_mistake_is_reported_at_once_with_its_place() {
    let text = "[machine]\nid = 'rig 1'\n\n[[shaft]]\nid = 'main'\nspeed_hz = nan\n\n\
                [[bearing]]\nid = 'right'\nshaft = 'mian'\nelements = -3\n\
                element_diameter_mm = '8'\npitch_diameter_mm = 33.5\nelemets = 4\n";
    let id = "an id: 1 to 64 letters, digits, '-', '_' or '.', beginning with a letter or digit";
    let keys = "id, shaft, catalogue, rotating_ring, elements, element_diameter_mm, \
                pitch_diameter_mm, contact_angle_deg (did you mean `elements`?)";
    let expected = [
        format!("m.toml:2:6: machine.id: found 'rig 1', allowed: {id}"),
        "m.toml:6:12: shaft[0].speed_hz: found nan, allowed: a number above 0 and up to 10000"
            .to_owned(),
        "m.toml:10:9: bearing[0].shaft: found 'mian', allowed: the id of a [[shaft]]: main \
         (did you mean `main`?)"
            .to_owned(),
        "m.toml:11:12: bearing[0].elements: found -3, allowed: a whole number from 3 to 1000"
            .to_owned(),
        "m.toml:12:23: bearing[0].element_diameter_mm: found '8', allowed: a number above 0 and \
         up to 20000"
            .to_owned(),
        format!(
            "m.toml:14:1: bearing[0].elemets: found an unknown key, allowed: in bearing[0]: {keys}"
        ),
    ];
    assert_eq!(mistakes(text), expected);
}

#[test]
fn missing_tables_and_keys_are_named() {
    let found = mistakes("");
    assert_eq!(found.len(), 2, "{found:#?}");
    assert!(found.iter().all(|line| line.contains("found nothing")), "{found:#?}");
    one_mistake(
        "[[bearing]]\nid='b'\nshaft='main'\n",
        "6:1",
        &["bearing[0].elements", "catalogue"],
    );
    one_mistake(
        "[[bearing]]\nid='b'\nshaft='main'\ncatalogue='X'\nelements=9\nelement_diameter_mm=8\n",
        "6:1",
        &["bearing[0].pitch_diameter_mm: found nothing"],
    );
    one_mistake("[[sensor]]\nchannel='a'\nkind='velocity'\n", "6:1", &["sensor[0].at"]);
    one_mistake("[[gear]]\nid='g'\ndriven={shaft='main',teeth=3}\n", "6:1", &["gear[0].driving"]);
}

#[test]
fn geometry_that_cannot_be_is_refused() {
    let bearing = |n: u32, d: f64, pitch: f64, angle: f64| {
        format!(
            "[[bearing]]\nid='b'\nshaft='main'\nelements={n}\nelement_diameter_mm={d:?}\n\
             pitch_diameter_mm={pitch:?}\ncontact_angle_deg={angle:?}\n"
        )
    };
    one_mistake(&bearing(3, 34.0, 33.5, 0.0), "10:21", &["not below 1"]);
    one_mistake(&bearing(14, 7.9375, 33.5, 0.0), "10:21", &["14 elements side by side"]);
    one_mistake(&bearing(11, 7.9375, 33.5, 90.0), "12:19", &["to below 90"]);
    one_mistake(&bearing(11, f64::INFINITY, 33.5, 0.0), "10:21", &["found inf"]);
    one_mistake(&bearing(2, 7.9375, 33.5, 0.0), "9:10", &["found 2", "from 3 to 1000"]);
}

#[test]
fn contact_angles_are_degrees_and_rings_may_turn_outside() {
    let text = machine_with(
        "[[bearing]]\nid='b'\nshaft='main'\nelements=12\nelement_diameter_mm=10\n\
         pitch_diameter_mm=50\ncontact_angle_deg=60\nrotating_ring='outer'\n",
    );
    let machine = parse(&text, "m.toml").unwrap();
    let orders = machine.bearings[0].fault_orders().unwrap();
    // cos 60° = ½, so γ = 0.1: FTF ½·1.1, BPFO 6·0.9, BPFI 6·1.1, BSF 2.5·0.99; rounding only.
    let close = |value: f64, expected: f64| (value - expected).abs() < 1e-14 * expected * 4.0;
    assert!(close(orders.ftf, 0.55) && close(orders.bsf, 2.475), "{orders:?}");
    assert!(close(orders.bpfo, 5.4) && close(orders.bpfi, 6.6), "{orders:?}");
}

#[test]
fn identifiers_and_channels_are_used_once() {
    let rest = "[[shaft]]\nid='main'\n";
    one_mistake(rest, "7:4", &["shaft[1].id", "line 4 has it already"]);
    let sensor = "[[sensor]]\nchannel='a'\nkind='accelerometer'\nat={shaft='main'}\n";
    one_mistake(&format!("{sensor}{sensor}"), "11:9", &["sensor[1].channel", "line 7"]);
}

#[test]
fn the_train_must_not_contradict_itself() {
    let shafts = "[[shaft]]\nid='b'\n[[shaft]]\nid='c'\nratio_to={shaft='main',ratio=0.5}\n";
    let gear = |id: &str, from: &str, to: &str, teeth: u32| {
        format!(
            "[[gear]]\nid='{id}'\ndriving={{shaft='{from}',teeth=20}}\n\
             driven={{shaft='{to}',teeth={teeth}}}\n"
        )
    };
    let closed = [shafts, &gear("g1", "main", "b", 80), &gear("g2", "b", "c", 10)].concat();
    let machine = parse(&machine_with(&closed), "m.toml").unwrap();
    assert_eq!(machine.shafts[2].nominal_speed, Some(Hz(5.0)));
    let open = [shafts, &gear("g1", "main", "b", 80), &gear("g2", "b", "c", 11)].concat();
    one_mistake(&open, "17:9", &["gear[1].driving", "speed ratio c/b of 1.81", "2,"]);

    one_mistake("ratio_to={shaft='main',ratio=2}\n", "6:17", &["another [[shaft]]"]);
    one_mistake(&gear("g", "main", "main", 30), "9:8", &["gear[0].driven.shaft"]);
    let slow = "[[shaft]]\nid='b'\nspeed_hz=7.0\nratio_to={shaft='main',ratio=0.5}\n";
    one_mistake(slow, "8:10", &["found 7", "5 within 2 %", "speed of main"]);
    let rounded = "[[shaft]]\nid='b'\nspeed_hz=5.05\nratio_to={shaft='main',ratio=0.5}\n";
    assert!(parse(&machine_with(rounded), "m.toml").is_ok());
}

#[test]
fn motors_obey_their_poles() {
    one_mistake("[[motor]]\nshaft='main'\npoles=3\n", "8:7", &["an even number"]);
    one_mistake(
        "[[motor]]\nshaft='main'\npoles=8\nsynchronous=true\nline_frequency_hz=50\n",
        "10:19",
        &["synchronous = true"],
    );
    one_mistake("[[motor]]\nshaft='main'\npoles=4\nsynchronous=1\n", "9:13", &["true or false"]);
}

#[test]
fn sensors_fit_their_kind() {
    let sensor = |rest: &str| {
        format!("[[sensor]]\nchannel='a'\nkind='accelerometer'\nat={{shaft='main'}}\n{rest}\n")
    };
    one_mistake(&sensor("unit='mm/s'"), "10:6", &["for kind accelerometer: g, m/s^2, in/s^2, V"]);
    one_mistake(&sensor("unit='m/s2'"), "10:6", &["did you mean `m/s^2`?"]);
    one_mistake(&sensor("unit='g'\nsensitivity_v_per_unit=0.1"), "11:24", &["unit = \"V\""]);
    one_mistake(&sensor("unit='V'\nsensitivity_v_per_unit=0"), "11:24", &["other than 0"]);
    one_mistake(&sensor("pulses_per_rev=2"), "10:16", &["only for kind tacho"]);
    one_mistake(&sensor("usable_hz=[10, 5]"), "10:11", &["an array of 2", "low below high"]);
    one_mistake(&sensor("direction='axial'\naxis_deg=0"), "11:10", &["axial"]);
    one_mistake(&sensor("axis_deg=400"), "10:10", &["from -360 to 360"]);
    assert!(parse(&machine_with(&sensor("unit='V'\nsensitivity_v_per_unit=-0.1")), "").is_ok());

    let probe = |rest: &str| {
        format!("[[sensor]]\nchannel='a'\nkind='proximitor'\nat={{shaft='main'}}\n{rest}\n")
    };
    one_mistake(&sensor("unit='V'\ngap_v=[-11, -9]"), "11:7", &["only for kind proximitor"]);
    one_mistake(&probe("unit='um'\ngap_v=[-11, -9]"), "11:7", &["unit = \"V\""]);
    one_mistake(&probe("unit='V'\ngap_v=[-9, -11]"), "11:7", &["low below high"]);
    let machine = parse(&machine_with(&probe("unit='V'\ngap_v=[-11, -9]")), "").unwrap();
    assert_eq!(machine.sensors[0].gap_v, Some((-11.0, -9.0)));

    let place = |at: &str| format!("[[sensor]]\nchannel='a'\nkind='proximitor'\nat={at}\n");
    one_mistake(&place("{}"), "9:4", &["no place"]);
    one_mistake(&place("{gear='g'}"), "9:10", &["there is none (no [[gear]])"]);
    one_mistake(&place("'main'"), "9:4", &["found 'main', allowed: a table"]);
    let tacho = "[[sensor]]\nchannel='t'\nkind='tacho'\nunit='rpm'\n";
    one_mistake(tacho, "9:6", &["for kind tacho: V"]);
    one_mistake("[[sensor]]\nchannel='t'\nkind='taco'\n", "8:6", &["did you mean `tacho`?"]);
    let slash = "[[sensor]]\nchannel='a/b'\nkind='tacho'\n";
    one_mistake(slash, "7:9", &["without '/'"]);
}

#[test]
fn limits_rise_and_map_places_are_paths() {
    one_mistake(
        "[limits]\nvelocity_rms_warning_mm_per_s=4\nvelocity_rms_damaged_mm_per_s=3\n",
        "8:31",
        &["above velocity_rms_warning_mm_per_s = 4"],
    );
    one_mistake("[capture.map]\nx='time'\n", "7:3", &["capture.map.x", "/path"]);
    one_mistake("[capture.map]\n'a/b'='/time'\n", "7:1", &["the key `a/b`"]);
    one_mistake("[limit]\n", "6:2", &["limit: found an unknown key", "did you mean `limits`?"]);
}

#[test]
fn syntax_errors_are_reported_with_the_other_mistakes_but_not_with_their_consequences() {
    let text = "[machine]\nid = 'm'\n[[shaft]]\nid = 'main\nspeed_hz = -1\n\
                [[bearing]]\nid = 'b'\nshaft = 'main'\ncatalogue = 'X'\nelements = 2\n";
    let found = mistakes(text);
    assert!(found[0].starts_with("m.toml:4:"), "{found:#?}");
    assert!(found[0].contains("broken TOML"), "{found:#?}");
    assert!(found.iter().any(|line| line.contains("speed_hz: found -1")), "{found:#?}");
    assert!(found.iter().any(|line| line.contains("elements: found 2")), "{found:#?}");
    assert_eq!(found.len(), 3, "{found:#?}");
    one_mistake("speed_hz = 3\n", "6:1", &["broken TOML (duplicate key"]);
}

#[test]
fn the_document_names_every_key() {
    const DOCUMENT: &str = include_str!("../../../docs/machines.md");
    let member = "{shaft='s',teeth=9,zz=1}";
    let text = format!(
        "zz=1\n[machine]\nid='m'\nzz=1\n[[shaft]]\nid='s'\nzz=1\nrunning={{above_hz=1,zz=1}}\n\
         ratio_to={{shaft='t',ratio=1,zz=1}}\n[[shaft]]\nid='t'\n[[bearing]]\nid='b'\nshaft='s'\n\
         catalogue='6205'\nzz=1\n[[motor]]\nshaft='s'\npoles=2\nzz=1\n[[gear]]\nid='g'\nzz=1\n\
         driving={member}\ndriven={}\n[[sensor]]\nchannel='c'\nkind='velocity'\n\
         at={{shaft='s',zz=1}}\nzz=1\n[limits]\nzz=1\n[capture]\nzz=1\n",
        member.replace("'s'", "'t'")
    );
    let errors = parse(&text, "m.toml").unwrap_err();
    assert_eq!(errors.mistakes.len(), 14, "{errors}");
    for mistake in &errors.mistakes {
        let (_, keys) = mistake.allowed.split_once(": ").unwrap();
        for key in keys.split(", ") {
            let named = ["`", " ", "[", "."].iter().any(|before| {
                ["`", " = ", "]", "."]
                    .iter()
                    .any(|after| DOCUMENT.contains(&[before, key, after].concat()))
            });
            assert!(named, "docs/machines.md does not name `{key}` ({})", mistake.path);
        }
    }
}

#[test]
fn wrong_types_are_no_surprise() {
    for key in ["shaft", "bearing", "motor", "gear", "sensor", "machine", "limits", "capture"] {
        for value in ["1", "'x'", "[1, 2]", "{a = 1}", "[[1]]", "[]", "2020-01-01", "true"] {
            let errors = parse(&format!("{key} = {value}\n"), "m.toml").unwrap_err();
            assert!(!errors.mistakes.is_empty(), "{key} = {value}");
        }
    }
}

#[test]
fn hostile_texts_end_in_errors() {
    let deep =
        |open: &str, close: &str| format!("a={}{}", open.repeat(50_000), close.repeat(50_000));
    let hostile = [
        "\u{0}".repeat(1000),
        "[".repeat(400_000),
        deep("[", "]"),
        deep("{a=", "}"),
        format!("{}=1", vec!["a"; 100_000].join(".")),
        "[[shaft]]\n".repeat(90_000),
        "=\n".repeat(45_000),
        "x".repeat(MAX_TEXT_BYTES + 1),
        format!("a = {}", "9".repeat(100_000)),
        format!("a = 1e{}", "9".repeat(1000)),
        "\u{feff}[machine]".to_owned(),
        "[machine]\r\nid = 'm'\r\n".to_owned(),
    ];
    for text in hostile {
        let errors = parse(&text, "m.toml").unwrap_err();
        // 200 kept, one line each, excerpts of 60 characters.
        assert!(errors.mistakes.len() <= 200 && errors.to_string().len() < 100_000);
    }
}

#[test]
fn too_many_mistakes_are_counted() {
    let text = machine_with(&"[[bearing]]\nid='!'\nshaft='main'\ncatalogue='6205'\n".repeat(300));
    let errors = parse(&text, "m.toml").unwrap_err();
    assert_eq!((errors.mistakes.len(), errors.n_omitted), (200, 100));
    assert!(errors.to_string().ends_with("and 100 more mistakes"));
    let many = machine_with(&"[[motor]]\nshaft='main'\npoles=2\n".repeat(1001));
    one_mistake_of(&many, &["motor", "found 1001 of them", "1 to 1000"]);
}

fn one_mistake_of(text: &str, words: &[&str]) {
    let found = mistakes(text);
    assert_eq!(found.len(), 1, "{found:#?}");
    assert!(words.iter().all(|word| found[0].contains(word)), "{found:#?}");
}

/// xorshift64*: small, seeded, and no dependency of the test's outcome on a crate's version.
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let drawn = self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33;
        usize::try_from(drawn).unwrap() % end.max(1)
    }
}

/// One seeded change of a text: bytes or whole lines.
fn mutate(text: &str, dice: &mut Dice) -> String {
    const SPICE: &[u8] = b"[]{}=.\"'#,\n\r-+0e9_x\\ \t\0\x80\xff";
    let mut bytes = text.as_bytes().to_vec();
    let mut lines: Vec<&str> = text.lines().collect();
    let (line, other) = (dice.below(lines.len()), dice.below(lines.len()));
    let at = dice.below(bytes.len());
    match dice.below(7) {
        0 => bytes[at] = SPICE[dice.below(SPICE.len())],
        1 => bytes.insert(at, SPICE[dice.below(SPICE.len())]),
        2 => drop(bytes.remove(at)),
        3 => bytes.truncate(at),
        4 => drop(lines.remove(line)),
        5 => lines.insert(line, lines[other]),
        _ => lines.swap(line, other),
    }
    let by_lines = lines.join("\n");
    if by_lines == text.trim_end() {
        String::from_utf8_lossy(&bytes).into_owned()
    } else {
        by_lines
    }
}

#[test]
fn two_thousand_mutations_give_a_machine_or_mistakes() {
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let (mut n_good, mut n_bad) = (0, 0);
    for round in 0..2000 {
        let mut text = if round % 2 == 0 { RIG } else { STAND }.to_owned();
        for _ in 0..=dice.below(3) {
            text = mutate(&text, &mut dice);
        }
        match parse(&text, "mutant.toml") {
            Ok(machine) => {
                n_good += 1;
                assert!(!machine.shafts.is_empty());
                let _ = machine.sensor_pairs();
            }
            Err(errors) => {
                n_bad += 1;
                assert!(!errors.mistakes.is_empty());
                let n_lines = text.lines().count();
                for mistake in &errors.mistakes {
                    assert!(mistake.line >= 1 && mistake.line <= n_lines + 1, "{mistake}");
                    assert!(!mistake.to_string().contains('\n'), "{mistake}");
                }
            }
        }
    }
    // Comments and notes may change freely; most else matters.
    assert!(n_good > 100 && n_bad > 500, "{n_good} good, {n_bad} bad");
}
