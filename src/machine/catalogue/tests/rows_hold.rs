//! Each row against boundary dimensions, room on the pitch circle, and the load ratings that
//! ISO 281 and ISO 76 compute from it.

use super::super::row;
use super::*;

/// Factor f_c of ISO 281, radial and angular contact groove ball bearings, by γ.
const BALL_FC: &[(f64, f64)] = &[
    (0.05, 46.7),
    (0.06, 49.1),
    (0.07, 51.1),
    (0.08, 52.8),
    (0.09, 54.3),
    (0.10, 55.5),
    (0.12, 57.5),
    (0.14, 58.8),
    (0.16, 59.6),
    (0.18, 59.9),
    (0.20, 59.9),
    (0.22, 59.6),
    (0.24, 59.0),
    (0.26, 58.2),
    (0.28, 57.1),
    (0.30, 56.0),
    (0.32, 54.6),
    (0.34, 53.2),
    (0.36, 51.7),
    (0.38, 50.0),
    (0.40, 48.4),
];

/// Factor f_c of ISO 281, radial roller bearings, by γ.
const ROLLER_FC: &[(f64, f64)] = &[
    (0.10, 84.2),
    (0.12, 86.4),
    (0.14, 87.7),
    (0.16, 88.5),
    (0.18, 88.8),
    (0.20, 88.7),
    (0.22, 88.2),
    (0.24, 87.5),
    (0.26, 86.4),
    (0.28, 85.2),
    (0.30, 83.8),
];

/// Factor f_0 of ISO 76, radial and angular contact groove ball bearings, by γ in steps of 0.01.
const BALL_F0: &[f64] = &[
    14.7, 14.9, 15.1, 15.3, 15.5, 15.7, 15.9, 16.1, 16.3, 16.5, 16.4, 16.1, 15.9, 15.6, 15.4, 15.2,
    14.9, 14.7, 14.4, 14.2, 14.0, 13.7, 13.5, 13.2, 13.0, 12.8, 12.5, 12.3, 12.1, 11.8, 11.6, 11.4,
    11.2, 10.9, 10.7, 10.5, 10.3, 10.0, 9.8, 9.6, 9.4,
];

/// SKF rates its bearings above ISO 281: balls by 2 to 8 %, rollers by 12 to 16 %.
const ABOVE_ISO_BALL: (f64, f64) = (1.02, 1.08);
const ABOVE_ISO_ROLLER: (f64, f64) = (1.12, 1.16);

/// Outer diameters of ISO 15 by bore code 00, 01, …
const OUTER_60: [u32; 21] =
    [26, 28, 32, 35, 42, 47, 55, 62, 68, 75, 80, 90, 95, 100, 110, 115, 125, 130, 140, 145, 150];
const OUTER_2: [u32; 21] =
    [30, 32, 35, 40, 47, 52, 62, 72, 80, 85, 90, 100, 110, 120, 125, 130, 140, 150, 160, 170, 180];
const OUTER_3: [u32; 21] = [
    35, 37, 42, 47, 52, 62, 72, 80, 90, 100, 110, 120, 130, 140, 150, 160, 170, 180, 190, 200, 215,
];

fn interpolated(table: &[(f64, f64)], x: f64) -> f64 {
    let pair = table.windows(2).find(|pair| (pair[0].0..=pair[1].0).contains(&x)).unwrap();
    pair[0].1 + (pair[1].1 - pair[0].1) * (x - pair[0].0) / (pair[1].0 - pair[0].0)
}

/// n, d and D in mm, cos φ, γ.
fn measures(row: &Row) -> (f64, f64, f64, f64, f64) {
    let g = &row.geometry;
    let mm = |length_m: f64| length_m * 1e3;
    let (d, pitch) = (mm(g.element_diameter_m()), mm(g.pitch_diameter_m()));
    (f64::from(g.elements()), d, pitch, g.contact_angle_rad().cos(), g.gamma())
}

/// C = b_m·f_c·(cos φ)^0.7·Z^(2/3)·D_w^1.8, from 25.4 mm on 3.647·D_w^1.4; kN.
fn ball_dynamic_kn(row: &Row) -> f64 {
    let (z, d, _, cos, gamma) = measures(row);
    let size = if d <= 25.4 { d.powf(1.8) } else { 3.647 * d.powf(1.4) };
    1.3 * interpolated(BALL_FC, gamma) * cos.powf(0.7) * z.powf(2.0 / 3.0) * size / 1e3
}

/// C₀ = f₀·Z·D_w²·cos φ; kN.
fn ball_static_kn(row: &Row) -> f64 {
    let (z, d, _, cos, gamma) = measures(row);
    let table: Vec<(f64, f64)> =
        BALL_F0.iter().enumerate().map(|(i, f)| (i as f64 / 100.0, *f)).collect();
    interpolated(&table, gamma) * z * d * d * cos / 1e3
}

/// C = b_m·f_c·L^(7/9)·Z^(3/4)·D_w^(29/27), the length L of the rollers from C₀ = 44·(1 − γ)·Z·L·D_w;
/// kN and mm.
fn roller_dynamic_kn(row: &Row) -> (f64, f64) {
    let (z, d, _, _, gamma) = measures(row);
    let length = row.ratings_kn.1 * 1e3 / (44.0 * (1.0 - gamma) * z * d);
    let fc = interpolated(ROLLER_FC, gamma);
    let c = 1.1 * fc * length.powf(7.0 / 9.0) * z.powf(0.75) * d.powf(29.0 / 27.0) / 1e3;
    (c, length)
}

fn is_roller(row: &Row) -> bool {
    row.designation.starts_with("NU")
}

#[test]
fn every_line_is_a_row() {
    assert_eq!(row::lines().count(), rows().len());
    assert!(rows().len() > 150);
    for row in rows() {
        assert!(!row.makers.contains(&"") && !row.sources.contains(&""), "{row:?}");
    }
}

#[test]
fn every_source_is_in_the_references() {
    let references = include_str!("../../../../docs/references.bib");
    for source in rows().iter().flat_map(|row| row.sources.clone()) {
        assert!(references.contains(&format!("{{{source},")), "{source}");
    }
}

#[test]
fn boundary_dimensions_are_those_of_iso_15() {
    for row in rows() {
        let digits: String = row.designation.chars().filter(char::is_ascii_digit).collect();
        let (series, code) = digits.split_at(digits.len() - 2);
        let code: usize = code.parse().unwrap();
        let bore = match code {
            0 => 10,
            1 => 12,
            2 => 15,
            3 => 17,
            code => 5 * u32::try_from(code).unwrap(),
        };
        let outer = match series {
            "60" | "160" => OUTER_60[code],
            "62" | "72" | "2" => OUTER_2[code],
            _ => OUTER_3[code],
        };
        // Whole numbers below 1000 are exact.
        let off = (row.bore_mm - f64::from(bore)).abs() + (row.outer_mm - f64::from(outer)).abs();
        assert!(off < 1e-9, "{row:?}");
    }
}

#[test]
fn elements_fit_between_the_rings_and_beside_each_other() {
    for row in rows() {
        let (z, d, pitch, _, _) = measures(row);
        let name = row.designation;
        // Rings of balls are about equally thick; rollers run on raceways of their own.
        let mean = (row.bore_mm + row.outer_mm) / 2.0;
        let off = if is_roller(row) { 0.04 } else { 1e-9 };
        assert!((pitch / mean - 1.0).abs() <= off, "{name}: pitch {pitch}, mean {mean}");
        let part = d / (row.outer_mm - row.bore_mm);
        let thin = name.starts_with("160");
        let expected = if thin { 0.19..0.32 } else { 0.23..0.34 };
        assert!(expected.contains(&part), "{name}: d/H = {part:.3}");
        let gap = std::f64::consts::PI * pitch / z / d - 1.0;
        // Deep groove: the balls go in between eccentric rings, which leaves room. Angular contact
        // and rollers: as many as the cage allows.
        let room = match name.as_bytes()[0] {
            b'6' | b'1' => 0.30..0.95,
            b'7' => 0.03..0.35,
            _ => 0.18..0.33,
        };
        assert!(room.contains(&gap), "{name}: gap {gap:.3} of an element");
    }
}

#[test]
fn load_ratings_follow_from_number_and_size_of_the_balls() {
    for row in rows().iter().filter(|row| !is_roller(row)) {
        let (c, c0) = (ball_dynamic_kn(row), ball_static_kn(row));
        let (published_c, published_c0) = row.ratings_kn;
        // Three digits published, f_c and f_0 in steps; 2 % is half of what one ball makes.
        assert!(
            (c0 / published_c0 - 1.0).abs() < 0.02,
            "{}: static rating {c0:.2}",
            row.designation
        );
        let ratio = published_c / c;
        let expected = if row.sources[0] == "skf2018" { ABOVE_ISO_BALL } else { (0.98, 1.02) };
        assert!(
            (expected.0..=expected.1).contains(&ratio),
            "{} {:?}: published C is {ratio:.3} of ISO 281",
            row.designation,
            row.makers
        );
    }
}

#[test]
fn the_other_contact_angle_gives_its_own_ratings() {
    // 40° of the same balls, published beside 30°: both ratings of 7205B, 7305B, 7310B, 7320B.
    for (name, c, c0) in
        [("7205", 14.8, 9.4), ("7305", 24.4, 14.6), ("7310", 68.0, 48.0), ("7320", 190.0, 178.0)]
    {
        let steep = found(&format!("NTN {name}B"));
        let row = Row { geometry: steep.geometry, ..steep.rows[0].clone() };
        assert!((ball_dynamic_kn(&row) / c - 1.0).abs() < 0.01, "{name}");
        assert!((ball_static_kn(&row) / c0 - 1.0).abs() < 0.01, "{name}");
    }
}

#[test]
fn load_ratings_follow_from_the_size_of_the_rollers() {
    for row in rows().iter().filter(|row| is_roller(row)) {
        let (c, length) = roller_dynamic_kn(row);
        let ratio = row.ratings_kn.0 / c;
        let expected =
            if row.sources.contains(&"skf2018") { ABOVE_ISO_ROLLER } else { (0.98, 1.02) };
        assert!(
            (expected.0..=expected.1).contains(&ratio),
            "{}: published C is {ratio:.3} of ISO 281",
            row.designation
        );
        // Rollers are about as long as thick.
        let slender = length / row.geometry.element_diameter_m() / 1e3;
        assert!((0.7..1.3).contains(&slender), "{}: L/d = {slender:.2}", row.designation);
    }
}

#[test]
fn spread_between_makers_is_what_is_stated() {
    let mut widest: f64 = 0.0;
    for pair in rows().windows(2).filter(|pair| pair[0].designation == pair[1].designation) {
        let (a, b) = (&pair[0].geometry, &pair[1].geometry);
        if a.elements() == b.elements() {
            widest = widest.max((a.gamma() / b.gamma() - 1.0).abs());
        }
        assert!(a.elements().abs_diff(b.elements()) <= 2, "{}", pair[0].designation);
    }
    assert!(widest > 0.07, "otherwise the allowance is too wide: {widest}");
    let allowed = OTHER_MAKER_GAMMA;
    let seldom = rows().windows(2).filter(|pair| {
        pair[0].designation == pair[1].designation
            && pair[0].geometry.elements() == pair[1].geometry.elements()
            && (pair[0].geometry.gamma() / pair[1].geometry.gamma() - 1.0).abs() > allowed
    });
    let names: Vec<&str> = seldom.map(|pair| pair[0].designation).collect();
    assert_eq!(names, Vec::<&str>::new());
}

#[test]
fn housed_bearings_of_the_same_rings_have_the_same_balls() {
    // Coefficients of a third maker for bearings on the rings of the 62 and 63 series: n and BPFO,
    // published to three decimals, so d/D to 0.0005 of n/2.
    for (name, n, bpfo) in [
        ("6203", 8, 3.053),
        ("6204", 8, 3.052),
        ("6205", 9, 3.574),
        ("6206", 9, 3.568),
        ("6207", 9, 3.565),
        ("6210", 10, 4.093),
        ("6211", 10, 4.078),
        ("6212", 10, 4.066),
        ("6303", 7, 2.545),
        ("6304", 7, 2.574),
        ("6309", 8, 3.037),
        ("6310", 8, 3.047),
        ("6311", 8, 3.057),
        ("6312", 8, 3.064),
        ("6314", 8, 3.076),
        ("6315", 8, 3.081),
        ("6316", 8, 3.086),
        ("6318", 8, 3.093),
    ] {
        let resolved = found(&format!("SKF {name}"));
        assert_eq!(resolved.geometry.elements(), n, "{name}");
        let relative = bpfo / resolved.geometry.fault_orders(INNER).bpfo - 1.0;
        let band = resolved.bands(INNER).bpfo;
        assert!((band.low..=band.high).contains(&relative), "{name}: {relative:.4}");
    }
}
