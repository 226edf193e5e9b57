//! Pages of a diagnosis written by hand, over samples whose truth is known.

use super::recording::Track;
use super::*;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::verdict::Coverage;
use crate::diagnosis::verdict::DataQuality;
use crate::diagnosis::verdict::Evidence;
use crate::diagnosis::verdict::OperatingState;
use crate::dsp::reference::gaussian_noise;
use crate::machine::file;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;

const MACHINE: &str = r#"
[machine]
id = "rig"
[[shaft]]
id = "main"
speed_hz = 20.0
[[bearing]]
id = "de"
shaft = "main"
elements = 9
element_diameter_mm = 7.94
pitch_diameter_mm = 39.04
[[gear]]
id = "mesh"
driving = { shaft = "main", teeth = 20 }
driven = { shaft = "slow", teeth = 40 }
[[shaft]]
id = "slow"
[[sensor]]
channel = "x"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "de" }
axis_deg = 0.0
[[sensor]]
channel = "y"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "de" }
axis_deg = 90.0
"#;

const FS_HZ: f64 = 8000.0;
const LINE_HZ: f64 = 108.3;

/// A carrier of 1 kHz whose strength swings at the line's rate, beside a steady one of 3 kHz, and noise: without it the
/// line would be held against rounding, which is another on another computer.
fn track(name: &str, phase: f64) -> Track {
    let noise = gaussian_noise(16_000, 1);
    let turn = |f_hz: f64, i: u32| std::f64::consts::TAU * f_hz * f64::from(i) / FS_HZ + phase;
    let value = |i: u32| {
        (1.0 + 0.8 * turn(LINE_HZ, i).cos()) * turn(1000.0, i).cos() + turn(3000.0, i).cos()
    };
    #[expect(clippy::cast_possible_truncation, reason = "f32 is what a channel holds")]
    let samples = (0..16_000).zip(noise).map(|(i, e)| (value(i) + 0.01 * e) as f32).collect();
    let info = ChannelInfo {
        name: name.to_owned(),
        sample_rate: Hz(FS_HZ),
        unit: Unit::MetrePerSecondSquared,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    };
    Track { info, start: 0, start_s: 0.0, samples, even: None }
}

fn diagnosis() -> Diagnosis {
    let evidence = |indicator: &str, at: f64, value: f64| Evidence {
        indicator: indicator.to_owned(),
        channel: "x".to_owned(),
        detector: None,
        frequency: Some(Hz(at)),
        expected: Some(Hz(at)),
        order: None,
        value,
        unit: Unit::One,
        threshold: Some(0.5),
        false_alarm_probability: Some(1e-9),
        sample_range: None,
    };
    let open = ComponentDiagnosis::undetermined("de", ComponentKind::Bearing, "a <b> & c".into());
    let bearing = ComponentDiagnosis {
        state: State::Damaged,
        fault: Some(FaultMode::InnerRace),
        severity: Some(0.6),
        confidence: Some(0.9),
        evidence: vec![
            evidence("envelope_line_bpfo", 71.7, 5.0),
            evidence("envelope_line_bpfi", LINE_HZ, 0.8),
        ],
        ..open
    };
    let gear = ComponentDiagnosis {
        state: State::Healthy,
        evidence: vec![evidence("cwt_ratio_to_baseline", 20.0, 1.0)],
        ..ComponentDiagnosis::undetermined("mesh", ComponentKind::Gear, "fine".into())
    };
    Diagnosis {
        machine: "rig".to_owned(),
        duration_s: 2.0,
        samples_used: 32_000,
        samples_rejected: 0,
        rejected_because: Vec::new(),
        shaft_speed: Some(Hz(20.0)),
        shaft_speeds: vec![("main".to_owned(), Hz(20.0)), ("slow".to_owned(), Hz(10.0))],
        speed_source: None,
        speed_confidence: 1.0,
        operating_state: OperatingState::Running,
        state: State::Damaged,
        coverage: Coverage { judged: 2, undetermined: Vec::new() },
        data_quality: DataQuality::Ok,
        components: vec![gear, bearing],
        warnings: vec!["<script>".to_owned()],
        notes: Vec::new(),
        baselines: Vec::new(),
        provisional_baseline: None,
        timeline: None,
        first_warning_s: None,
        first_damaged_s: None,
        sample_ranges: Vec::new(),
    }
}

fn with(tracks: &[Track]) -> String {
    let machine = file::parse(MACHINE, "rig.toml").unwrap();
    let diagnosis = diagnosis();
    let name = "run 7 <1>.h5";
    page(&Subject { name, diagnosis: &diagnosis, machine: &machine, tracks, above: "" })
}

#[test]
fn a_page_shows_every_verdict_with_its_pictures_and_needs_nothing_else() {
    let page = with(&[track("x", 0.0), track("y", 0.3)]);
    for part in [
        "<h1>run 7 &lt;1&gt;.h5</h1>",
        "bearing de: <span class=\"state damaged\">damaged</span>, inner race",
        "a &lt;b&gt; &amp; c",
        "<td>envelope_line_bpfi</td><td>x</td><td class=\"n\">108.30</td>",
        "Squared envelope of x",
        "Wavelet map of x, mesh mesh",
        "Waveform of y",
        "Amplitude spectrum of x",
        "Orbit of x and y",
        "warning: &lt;script&gt;",
    ] {
        assert!(page.contains(part), "{part} not in the page");
    }
    // The accused part comes first, as in every report.
    assert!(page.find("bearing de").unwrap() < page.find("gear mesh").unwrap());
    for outside in ["<script", "http://", "https://", "url(", "@import", "NaN", "inf"] {
        let inside = page.replace("http://www.w3.org/2000/svg", "").replace("inform", "");
        assert!(!inside.contains(outside), "{outside}");
    }
}

#[test]
fn a_gear_that_was_not_judged_has_its_map_too() {
    let machine = file::parse(MACHINE, "rig.toml").unwrap();
    let mut diagnosis = diagnosis();
    let open = ComponentDiagnosis::undetermined("mesh", ComponentKind::Gear, "no baseline".into());
    diagnosis.components[0] = open;
    let tracks = [track("x", 0.0), track("y", 0.3)];
    let name = "r.h5";
    let page = page(&Subject {
        name,
        diagnosis: &diagnosis,
        machine: &machine,
        tracks: &tracks,
        above: "",
    });
    assert!(page.contains("Wavelet map of x, mesh mesh") && page.contains("It was not judged"));
    assert!(!with(&tracks).contains("It was not judged"));
}

#[test]
fn the_band_shown_is_the_one_that_swings_and_the_line_that_of_the_fault() {
    let machine = file::parse(MACHINE, "rig.toml").unwrap();
    let diagnosis = diagnosis();
    let bearing = &diagnosis.components[1];
    let (line, evidence) = envelope::deciding(bearing).unwrap();
    assert_eq!(
        (line.slug(), evidence.value),
        ("bpfi", 0.8),
        "not the deeper one of another element"
    );
    let figure = envelope::figure(bearing, &machine, 20.0, &[track("x", 0.0)]).unwrap();
    // Bands of 0…3800 Hz are split in quarters: 1 kHz swings in the second, 3 kHz is steady.
    assert!(
        figure.svg.contains("950 to 1900 Hz") || figure.svg.contains("0 to 1900 Hz"),
        "{}",
        &figure.svg[..300]
    );
    // Fundamental and harmonics; side bands one turn apart: 20 Hz below is 88.3 Hz.
    assert!(figure.svg.contains("<title>BPFI: 108.30</title>"));
    assert!(figure.svg.contains("<title>3·BPFI: 324.90</title>"));
    assert!(figure.svg.contains("<title>−1×: 88.30</title>"));
    assert!(figure.svg.contains("<title>BPFO: 71.70</title>"));
    assert!(figure.caption.contains("found at 108.30 Hz"));
}

#[test]
fn what_is_read_between_the_shafts_events_is_drawn_without_them() {
    let machine = file::parse(MACHINE, "rig.toml").unwrap();
    let mut bearing = diagnosis().components[1].clone();
    let mut struck = track("x", 0.0);
    // Every turn of 400 samples begins with a blow that rings for ten of them.
    let blows = struck.samples.iter_mut().enumerate().filter(|(i, _)| i % 400 < 10);
    blows.for_each(|(_, value)| *value *= 30.0);
    let drawn = |bearing: &ComponentDiagnosis| {
        envelope::figure(bearing, &machine, 20.0, std::slice::from_ref(&struck)).unwrap()
    };
    let hidden = drawn(&bearing);
    assert!(!hidden.caption.contains("left out"));
    for line in &mut bearing.evidence {
        line.order = line.frequency.map(|f| f.0 / 20.0);
        line.indicator.push_str("_between_events");
    }
    let between = drawn(&bearing);
    assert!(between.caption.contains("Events of the shaft hide it"), "{}", between.caption);
    assert!(between.caption.contains("found at 108.30 Hz"));
    assert_ne!(hidden.svg, between.svg);
    // Without the blows the picture is that of the line alone.
    let free = envelope::figure(&diagnosis().components[1], &machine, 20.0, &[track("x", 0.0)]);
    let title = |svg: &str| svg.split("<title>").nth(1).unwrap_or_default().to_owned();
    assert_eq!(title(&between.svg), title(&free.unwrap().svg), "the same band");
}

#[test]
fn a_line_too_small_to_accuse_is_not_shown_as_what_did() {
    let machine = file::parse(MACHINE, "rig.toml").unwrap();
    let mut diagnosis = diagnosis();
    let caption = |bearing: &ComponentDiagnosis| {
        envelope::figure(bearing, &machine, 20.0, &[track("x", 0.0)]).unwrap().caption
    };
    let bearing = &mut diagnosis.components[1];
    assert!(caption(bearing).starts_with("A damaged surface is struck"), "{}", caption(bearing));
    bearing.evidence.iter_mut().for_each(|line| line.value = 0.1);
    assert!(
        caption(bearing).starts_with("Its growth or another sign accuses"),
        "{}",
        caption(bearing)
    );
}

#[test]
fn where_the_speed_changes_the_picture_is_of_equal_angles_and_says_so() {
    let machine = file::parse(MACHINE, "rig.toml").unwrap();
    let diagnosis = diagnosis();
    let bearing = &diagnosis.components[1];
    let sharp = track("x", 0.0);
    let even = Some((sharp.samples.clone(), sharp.info.sample_rate));
    let smeared = Track { samples: vec![0.0; sharp.samples.len()], even, ..sharp.clone() };
    let figure = |track: Track| envelope::figure(bearing, &machine, 20.0, &[track]).unwrap();
    let (steady, run) = (figure(sharp), figure(smeared));
    assert_eq!(steady.svg, run.svg);
    assert!(!steady.caption.contains("The speed changes"), "{}", steady.caption);
    assert!(run.caption.ends_with("at the mean speed of the newest window."), "{}", run.caption);
}

#[test]
fn without_samples_the_words_remain() {
    let page = with(&[]);
    assert!(page.contains("inner race") && !page.contains("<svg"));
    let short = Track { samples: vec![1.0; 3], ..track("x", 0.0) };
    assert!(with(&[short]).contains("inner race"), "too few samples for any picture");
}

#[test]
fn a_waveform_leaves_the_constant_part_out_and_tells_it() {
    // Values that f32 holds exactly, with the constant or without.
    let shifted = |by: f32, offset: f64| {
        let mut track = track("x", 0.0);
        track.samples = [by + 0.5, by - 0.5].repeat(8000);
        track.info.offset = offset;
        figures::waveform(&track, Some(20.0)).unwrap()
    };
    let (plain, on_four) = (shifted(0.0, 0.0), shifted(4.0, 2.0));
    assert_eq!(plain.svg, on_four.svg);
    assert!(plain.caption.contains("0.000 m/s^2"), "{}", plain.caption);
    assert!(on_four.caption.contains("6.000 m/s^2"), "{}", on_four.caption);
}
