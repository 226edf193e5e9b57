//! Tests of the frequency table against figures known from the machines themselves.

use super::coincidence::MAX_COINCIDENCES;
use super::*;
use crate::machine::file;
use crate::units::Order;

const RIG: &str = include_str!("../../../config/machines/rig.toml");
const STAND: &str = include_str!("../../../config/machines/motor-stand.toml");

fn table_of(text: &str, speed: f64) -> FrequencyTable {
    frequency_table(&file::parse(text, "m.toml").unwrap(), Hz(speed))
}

/// Frequency of the only line of this owner and kind.
fn line(table: &FrequencyTable, owner: &str, kind: LineKind) -> Hz {
    let lines: Vec<Hz> = table
        .lines
        .iter()
        .filter(|line| line.owner_id == owner && line.kind == kind)
        .map(|line| line.frequency)
        .collect();
    assert_eq!(lines.len(), 1, "{owner} {kind:?}");
    lines[0]
}

#[test]
fn the_rig_shows_its_lines_at_10_hz() {
    let table = table_of(RIG, 10.0);
    // Given as 68 Hz, 280 Hz and f/2.62, to the figures shown.
    assert!((line(&table, "right", LineKind::Bpfi { harmonic: 1 }).0 - 68.0).abs() < 0.05);
    assert!((line(&table, "left", LineKind::Ftf { harmonic: 1 }).0 - 10.0 / 2.62).abs() < 0.01);
    let exact = |owner, kind, expected: f64| {
        // Small whole numbers: exact but for rounding.
        assert!((line(&table, owner, kind).0 - expected).abs() < 1e-12, "{owner} {kind:?}");
    };
    exact("main", LineKind::Shaft { harmonic: 3 }, 30.0);
    exact("mesh-1", LineKind::GearMesh { harmonic: 2 }, 560.0);
    exact("mesh-1", LineKind::LowerSideBand { member: Member::Driven }, 270.0);
    exact("mesh-1", LineKind::UpperSideBand { member: Member::Driving }, 290.0);
    exact("mesh-1", LineKind::HuntingTooth, 10.0);
    // 2 shafts × 3, 2 bearings × (4 × 3 + 1), 1 mesh × (3 + 1 + 4).
    assert_eq!(table.lines.len(), 6 + 26 + 8);
    assert!(table.unlisted.is_empty());
}

#[test]
fn orders_refer_to_the_lines_own_shaft() {
    let geared = "[machine]\nid='m'\n[[shaft]]\nid='in'\n[[shaft]]\nid='out'\n\
                  [[gear]]\nid='g'\ndriving={shaft='in',teeth=20}\ndriven={shaft='out',teeth=40}\n\
                  [[bearing]]\nid='b'\nshaft='out'\nelements=9\nelement_diameter_mm=7.94\n\
                  pitch_diameter_mm=39.04\n";
    let table = table_of(geared, 30.0);
    let bpfo = table.lines.iter().find(|l| l.kind == LineKind::Bpfo { harmonic: 1 }).unwrap();
    // SKF 6205 orders, on a shaft at half speed.
    assert!((bpfo.order.unwrap().0 - 3.5848).abs() < 5e-5, "{bpfo:?}");
    assert!((bpfo.frequency.0 - 3.5848 * 15.0).abs() < 1e-3);
    let band = LineKind::UpperSideBand { member: Member::Driven };
    let band = table.lines.iter().find(|l| l.kind == band).unwrap();
    assert_eq!((band.frequency, band.order), (Hz(615.0), Some(Order(41.0))));
}

#[test]
fn supply_lines_follow_the_kind_of_motor() {
    let table = table_of(STAND, 29.5);
    assert_eq!(line(&table, "motor[0]", LineKind::Mains { harmonic: 1 }), Hz(60.0));
    assert_eq!(line(&table, "motor[0]", LineKind::Mains { harmonic: 2 }), Hz(120.0));
    assert_eq!(line(&table, "motor[0]", LineKind::PolePass), Hz(2.0));

    let synchronous = "[machine]\nid='m'\n[[shaft]]\nid='s'\n\
                       [[motor]]\nshaft='s'\npoles=8\nsynchronous=true\n";
    let table = table_of(synchronous, 25.0);
    // 8 poles: 4× and 8× of the shaft, the trap beside a ball line at 3.99×.
    assert_eq!(line(&table, "motor[0]", LineKind::SynchronousPole { harmonic: 1 }), Hz(100.0));
    assert_eq!(line(&table, "motor[0]", LineKind::SynchronousPole { harmonic: 2 }), Hz(200.0));
    assert!(!table.lines.iter().any(|line| line.kind == LineKind::PolePass));
}

#[test]
fn what_cannot_be_listed_is_named_with_its_reason() {
    let text = "[machine]\nid='m'\n[[shaft]]\nid='a'\n[[shaft]]\nid='loose'\n\
                [[bearing]]\nid='b'\nshaft='a'\ncatalogue='SKF 6204'\n\
                [[motor]]\nshaft='a'\npoles=4\n";
    let mut machine = file::parse(text, "m.toml").unwrap();
    // A machine file always knows the geometry; a machine built otherwise need not.
    machine.bearings[0].geometry = None;
    let table = frequency_table(&machine, Hz(25.0));
    let reasons: Vec<(String, Unlisted)> =
        table.unlisted.iter().map(|&(owner, why)| (owner.id(&machine), why)).collect();
    let expected = [
        ("loose", Unlisted::SpeedNotConnected),
        ("b", Unlisted::NoGeometry),
        ("motor[0]", Unlisted::NoLineFrequency),
    ];
    assert_eq!(reasons, expected.map(|(id, why)| (id.to_owned(), why)));
}

#[test]
fn at_standstill_only_the_mains_remain() {
    for speed in [0.0, -5.0, f64::NAN, f64::INFINITY] {
        let table = table_of(STAND, speed);
        let kinds: Vec<LineKind> = table.lines.iter().map(|line| line.kind).collect();
        assert_eq!(kinds, [LineKind::Mains { harmonic: 1 }, LineKind::Mains { harmonic: 2 }]);
        assert!(table.lines.iter().all(|line| line.order.is_none()));
        assert_eq!(table.unlisted.len(), 4, "shaft, two bearings, motor");
    }
}

#[test]
fn coincidences_match_a_search_of_all_pairs() {
    let table = table_of(RIG, 10.0);
    for resolution in [0.0, 0.1, 1.0, 7.3] {
        let mut expected: Vec<(usize, usize)> = Vec::new();
        for a in 0..table.lines.len() {
            for b in a + 1..table.lines.len() {
                let apart = table.lines[a].frequency.0 - table.lines[b].frequency.0;
                if apart.abs() < resolution {
                    expected.push((a, b));
                }
            }
        }
        let mut found: Vec<(usize, usize)> = table
            .coincidences(Hz(resolution))
            .iter()
            .map(|pair| (pair.a.min(pair.b), pair.a.max(pair.b)))
            .collect();
        found.sort_unstable();
        assert_eq!(found, expected, "{resolution}");
    }
    assert!(table.coincidences(Hz(f64::NAN)).is_empty());
}

#[test]
fn equal_bearings_coincide_in_every_line() {
    let table = table_of(RIG, 10.0);
    let pairs = table.coincidences(Hz(1e-9));
    let twins = pairs.iter().filter(|pair| {
        let (a, b) = (&table.lines[pair.a], &table.lines[pair.b]);
        a.kind == b.kind && a.owner_id == "left" && b.owner_id == "right"
    });
    assert_eq!(twins.count(), 13);
}

#[test]
fn a_large_machine_cannot_exhaust_memory_by_coincidences() {
    let bearing = "[[bearing]]\nid='ID'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\n\
                   pitch_diameter_mm=39.04\n";
    let bearings: String = (0..300).map(|n| bearing.replace("ID", &n.to_string())).collect();
    let table = table_of(&format!("[machine]\nid='m'\n[[shaft]]\nid='s'\n{bearings}"), 10.0);
    assert_eq!(table.coincidences(Hz(f64::INFINITY)).len(), MAX_COINCIDENCES);
}
