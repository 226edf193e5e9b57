//! Every row against independent physics, and designations as people write them.

mod rows_hold;

use super::*;
use proptest::prelude::*;

const INNER: RotatingRing = RotatingRing::Inner;

fn found(text: &str) -> Resolved {
    resolve(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// Designation, number of elements, element diameter in µm as text.
fn inside(text: &str) -> (String, u32, String) {
    let resolved = found(text);
    let g = resolved.geometry;
    (resolved.designation, g.elements(), format!("{:.0}", g.element_diameter_m() * 1e6))
}

#[test]
fn designations_resolve_as_people_write_them() {
    let deep = ("6205".to_owned(), 9, "7938".to_owned());
    for text in [
        "6205",
        "SKF 6205",
        "skf 6205-2rsh/c3",
        "6205-2RS C3",
        "FAG 6205-2Z",
        "NSK 6205DDU C3",
        "NTN 6205LLU",
        "SKF6205",
        "6205-2RS JEM",
        "6205ZZC3",
        "62052RS",
        "W 6205",
        "6205.2ZR.C3",
        "NTN-SNR 6205ZZ/5K",
        "  6205  ",
        "KOYO 6205 2RU",
        "6205 ZZ CM NS7S",
    ] {
        assert_eq!(inside(text), deep, "{text}");
    }
    let roller = ("NU205E".to_owned(), 13, "7500".to_owned());
    for text in [
        "NU 205 ECP",
        "NU205E.TVP2",
        "nu205 ecj",
        "FAG NU205-E-XL-TVP2",
        "NJ 205 ECP/C3",
        "NSK NU205EW",
    ] {
        assert_eq!(inside(text), roller, "{text}");
    }
    assert_eq!(inside("SKF 7205 BEP"), ("7205B".to_owned(), 13, "7938".to_owned()));
    assert_eq!(inside("16008-C3"), ("16008".to_owned(), 15, "6350".to_owned()));
}

#[test]
fn what_is_ignored_is_said() {
    let resolved = found("SKF 6205-2RSH/C3");
    assert_eq!(resolved.ignored(), "2RSH (seal), C3 (clearance)");
    assert!(resolved.note(INNER).contains("ignored: 2RSH (seal), C3 (clearance)"));
    assert_eq!(found("SKF 6205").ignored(), "");
    assert_eq!(
        found("SKF NJ 205 ECP").ignored(),
        "NJ (flanges; the rollers are those of NU), P (cage)"
    );
}

#[test]
fn the_6205_of_the_literature_lies_inside_its_limits() {
    let resolved = found("SKF 6205");
    let orders = resolved.geometry.fault_orders(INNER);
    let bands = resolved.bands(INNER);
    let holds = |used: f64, band: crate::machine::uncertainty::RelativeBand, published: f64| {
        (band.low..=band.high).contains(&(published / used - 1.0))
    };
    assert!(holds(orders.bpfi, bands.bpfi, 5.4152));
    assert!(holds(orders.bpfo, bands.bpfo, 3.5848));
    assert!(holds(orders.two_bsf(), bands.two_bsf, 4.7135));
    assert!(holds(orders.ftf, bands.ftf, 0.3983));
    // The test bearing of Case Western Reserve University, as published there.
    let stated = BearingGeometry::new(9, 7.94e-3, 39.04e-3, 0.0).unwrap();
    assert_eq!(resolved.disagreement(&stated, INNER), None);
    let wrong = BearingGeometry::new(8, 7.94e-3, 39.04e-3, 0.0).unwrap();
    assert!(resolved.disagreement(&wrong, INNER).unwrap().starts_with("BPFO 3.186"));
    let fan_end = BearingGeometry::new(8, 6.746e-3, 28.499e-3, 0.0).unwrap();
    assert_eq!(found("SKF 6203-2RS JEM").disagreement(&fan_end, INNER), None);
}

#[test]
fn the_contact_angle_is_never_ignored() {
    let degrees = |text: &str| found(text).geometry.contact_angle_rad().to_degrees().round();
    assert!((degrees("NSK 7205A") - 30.0).abs() < 0.1);
    assert!((degrees("7205 BEP") - 40.0).abs() < 0.1);
    assert!((degrees("FAG 7205-B-TVP") - 40.0).abs() < 0.1);
    assert!((degrees("NTN 7205C") - 15.0).abs() < 0.1);
    assert!((degrees("SKF 7205 ACD/P4A") - 25.0).abs() < 0.1);
    assert!((degrees("SKF 7205 BECBP") - 40.0).abs() < 0.1);
    // 40° of 13 balls of d/D = 0.2062: published as BPFO 5.473, BPFI 7.527 and BSF 2.365.
    let orders = found("NTN 7205B").geometry.fault_orders(INNER);
    assert!((orders.bpfo - 5.473).abs() < 2e-3 && (orders.bsf - 2.365).abs() < 2e-3, "{orders:?}");
    // Without a suffix both angles lie inside the band.
    let open = found("7205");
    let steep = found("NTN 7205B").geometry.fault_orders(INNER);
    let relative = steep.bpfo / open.geometry.fault_orders(INNER).bpfo - 1.0;
    assert!(relative > 0.02 && open.bands(INNER).bpfo.high >= relative);
    assert!(open.remarks.iter().any(|remark| remark.contains("40°")), "{:?}", open.remarks);
}

#[test]
fn makers_that_differ_are_told_apart_or_held_by_the_band() {
    assert_eq!(found("SKF 6203").geometry.elements(), 8);
    assert_eq!(found("NTN 6203").geometry.elements(), 7);
    let open = found("6203");
    assert_eq!(open.geometry.elements(), 8);
    let other = found("NTN 6203").geometry.fault_orders(INNER);
    let relative = other.bpfo / open.geometry.fault_orders(INNER).bpfo - 1.0;
    assert!(open.bands(INNER).bpfo.low <= relative && relative < -0.1);
    assert!(open.note(INNER).contains("the band holds all"), "{}", open.note(INNER));
    // Two makers agree: a third is taken to, and it is said. One maker alone is not enough.
    assert!(found("FAG 6205").bands(INNER).bpfo.widest() < 0.01);
    assert!(found("FAG 6317").bands(INNER).bpfo.widest() > 1.0 / 8.0 - 1e-3);
    assert!(found("NTN 6317").bands(INNER).bpfo.widest() < 0.01);
}

#[test]
fn what_may_change_the_elements_widens_the_band() {
    for text in ["SKF 6205 ETN9", "SKF 6205 QQ7"] {
        let resolved = found(text);
        assert!(resolved.bands(INNER).bpfo.widest() > 0.1, "{text}");
        assert!(resolved.remarks.iter().any(|r| r.contains("band widened")), "{text}");
    }
    assert!(found("SKF 6205 QQ7").ignored().contains("QQ7 (not known)"));
}

#[test]
fn the_design_of_a_roller_bearing_must_be_stated() {
    let error = resolve("NU 205").unwrap_err();
    assert!(
        matches!(error, Unresolved::DesignNotStated { .. }) && error.to_string().contains("NU205E")
    );
    let either = found("NU 208");
    assert!(either.rows.len() == 2 && either.remarks.iter().any(|r| r.contains("NU208E")));
}

#[test]
fn unknown_designations_name_their_neighbours() {
    for text in ["6225", "6299", "22210 E", "51105", "", "bearing", "62/22", "NU 2205", "620522"] {
        let error = resolve(text).unwrap_err();
        let Unresolved::Unknown { nearest } = error else { panic!("{text}: {error}") };
        assert_eq!(nearest.len(), 3, "{text}");
    }
    let error = resolve("6225").unwrap_err().to_string();
    assert!(error.contains("6205") || error.contains("6215"), "{error}");
}

#[test]
fn two_designations_are_none() {
    for text in ["6205 6206", "6205/2205", "SKF 6205-2RS, NU 205 ECP", "7205B 7206B"] {
        let error = resolve(text).unwrap_err();
        assert!(matches!(error, Unresolved::TwoDesignations { .. }), "{text}: {error}");
    }
    assert!(resolve("6205 6206").unwrap_err().to_string().contains("6205 and 6206"));
}

#[test]
fn an_unknown_tail_hides_no_contact_angle() {
    let degrees = |text: &str| found(text).geometry.contact_angle_rad().to_degrees();
    assert!((degrees("7205 CTYNSULP4") - 15.0).abs() < 0.1);
    let resolved = found("NTN 7205BQQ7");
    assert!((degrees("NTN 7205BQQ7") - 40.0).abs() < 0.1);
    assert!(resolved.ignored().contains("QQ7 (not known)"), "{}", resolved.ignored());
    assert!(resolved.bands(INNER).bpfo.widest() > 0.05, "the tail may mean anything");
}

#[test]
fn rows_are_listed_by_their_beginning() {
    assert!(beginning_with("62").iter().all(|row| row.designation.starts_with("62")));
    assert!(beginning_with("nu 2").len() > 20);
    assert!(beginning_with("").is_empty() && beginning_with("22").is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn any_text_is_answered(text in "\\PC{0,120}") {
        let _either = resolve(&text);
    }

    #[test]
    fn any_suffix_keeps_the_bearing(suffix in "[-/ .A-Z0-9]{0,12}") {
        // Whatever follows after a separator, the basic designation stays, and so do its limits.
        let resolved = match resolve(&format!("SKF 6205 {suffix}")) {
            Err(Unresolved::TwoDesignations { .. }) => return Ok(()),
            other => other.unwrap(),
        };
        prop_assert_eq!(resolved.designation, "6205");
        prop_assert_eq!(resolved.geometry.elements(), 9);
    }
}
