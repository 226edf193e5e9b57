//! One table in many dialects; what is guessed, mapped, counted and refused; rubbish.

use crate::capture::error::CaptureError;
use crate::capture::hints::Hints;
use crate::capture::info::CaptureInfo;
use crate::capture::map::ChannelMap;
use crate::capture::reader::{CaptureReader, ReadReport};
use crate::units::{Hz, Unit};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write as _;
use std::path::Path;

/// Info, physical samples of each channel, counts.
type Read = (CaptureInfo, Vec<Vec<f64>>, ReadReport);

fn read_file(path: &Path, hints: &Hints) -> Result<Read, CaptureError> {
    let mut reader = CaptureReader::open(path, None, hints)?;
    let info = reader.info().clone();
    let mut samples = vec![Vec::new(); info.channels.len()];
    while let Some(block) = reader.next_block()? {
        let offset = info.channels[block.channel.0].info.offset;
        samples[block.channel.0].extend(block.samples.iter().map(|x| f64::from(*x) + offset));
    }
    Ok((info, samples, reader.report()))
}

fn read(text: impl AsRef<[u8]>, hints: &Hints) -> Result<Read, CaptureError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    std::fs::write(&path, text).unwrap();
    read_file(&path, hints)
}

fn rate(rate_hz: f64) -> Hints {
    Hints { rate: Some(Hz(rate_hz)), ..Hints::default() }
}

fn mapped(entries: &[&str]) -> Hints {
    Hints { map: ChannelMap::of_options(entries).unwrap(), ..Hints::default() }
}

fn error(text: impl AsRef<[u8]>, hints: &Hints) -> String {
    let error = read(text, hints).unwrap_err().to_string();
    assert!(error.contains("a.csv:"), "names the file: {error}");
    error
}

const N: u32 = 400;

fn x(i: u32) -> f64 {
    (f64::from(i) * 0.3).sin()
}

fn y(i: u32) -> f64 {
    2.0 + (f64::from(i) * 0.7).cos()
}

/// A table of time at 1 kHz, x and y, after `head`.
fn table(head: &str, separator: &str, comma: bool, end: &str) -> String {
    let mut text = head.to_owned();
    for i in 0..N {
        let row = format!("{:.4}{separator}{:.6}{separator}{:.6}", f64::from(i) / 1e3, x(i), y(i));
        text.push_str(&if comma { row.replace('.', ",") } else { row });
        text.push_str(end);
    }
    text
}

/// Holds the two channels against the closed form.
fn assert_read(read: &Read, what: &str) {
    let (info, samples, report) = read;
    assert_eq!(samples.len(), 2, "{what}");
    for i in 0..N {
        let found = (samples[0][i as usize], samples[1][i as usize]);
        // Printed to 6 digits behind the point, and a rounding to f32.
        let scatter = 0.5e-6 + 6e-8 * 3.0;
        let near = (found.0 - x(i)).abs() < scatter && (found.1 - y(i)).abs() < scatter;
        assert!(near, "{what}: row {i}: {found:?}");
    }
    assert_eq!(report.samples_read, u64::from(2 * N), "{what}");
    assert_eq!(info.channels[0].info.sample_rate, Hz(1000.0), "{what}");
    assert_eq!(info.segments, None, "{what}");
}

#[test]
fn every_dialect_reads_alike() {
    let cases = [
        ("t,x,y\n", ",", false, "\n", "separator ','"),
        ("t;x;y\r\n", ";", false, "\r\n", "separator ';'"),
        ("t;x;y\n", ";", true, "\n", "decimal comma"),
        ("t\tx\ty\n", "\t", true, "\n", "separator tab"),
        ("t x y\n", "  ", false, "\n", "separated by blanks"),
        ("\u{feff}t, x, y\n", ", ", false, "\n", "header in line 1"),
        ("# rig 7\n# 2026\nt,x,y\n", ",", false, "\n", "header in line 3"),
        ("Logger: A7\nRate;1000\n\n\"t [s]\";\"x\";\"y\"\n", ";", true, "\n", "(\"t [s]\")"),
        ("t,x,y\ns,m/s^2,mm/s\n", ",", false, "\n", "header in line 1, units in line 2"),
        ("# t x y\n", " ", false, "\n", "header in line 1"),
        ("", ",", false, "\n", "no header, table from line 1"),
        ("Time (s),x,y\n", ",", false, ",\n", "(\"Time (s)\")"),
    ];
    for (head, separator, comma, end, guess) in cases {
        let found = read(table(head, separator, comma, end), &Hints::default());
        let found = found.unwrap_or_else(|error| panic!("{head:?}: {error}"));
        assert_read(&found, head);
        assert!(found.0.notes[0].starts_with("guessed: "), "{:?}", found.0.notes);
        assert!(found.0.notes[0].contains(guess), "{head:?}: {:?}", found.0.notes);
    }
}

#[test]
fn quoted_cells_and_a_last_line_without_end_are_read() {
    let text = table("t,x,y\n", "\",\"", false, "\"\n\"");
    let text = text.replacen("t,x,y\n", "t,x,y\n\"", 1);
    assert_read(
        &read(text.trim_end_matches(['\n', '"']).to_owned() + "\"", &Hints::default()).unwrap(),
        "quoted",
    );
    let text = table("t,x,y\n", ",", false, "\n");
    assert_read(&read(text.trim_end(), &Hints::default()).unwrap(), "no end");
}

#[test]
fn names_and_units_come_from_the_header() {
    let text = table("Zeit [ms]; DE/x [g] ;Fan (µm)\n", ";", false, "\n");
    let (info, ..) = read(&text, &Hints::default()).unwrap();
    let described: Vec<_> =
        info.channels.iter().map(|c| (c.info.name.as_str(), c.info.unit)).collect();
    assert_eq!(described, [("DE_x", Unit::MetrePerSecondSquared), ("Fan", Unit::Micrometre)]);
    // 1e-3 of a unit that is a millisecond.
    assert_eq!(info.channels[0].info.sample_rate, Hz(1e6));
    let latin = b"t;a [m/s\xb2]\n0,1;1\n0,2;2\n0,3;3\n".to_vec();
    let (info, ..) = read(latin, &Hints::default()).unwrap();
    assert_eq!(info.channels[0].unit_text.as_deref(), Some("m/s^2"));
    assert!(info.notes[0].contains("Latin-1"));
    let hints = Hints { unit: Some("g".to_owned()), ..Hints::default() };
    let (info, ..) = read("t,a [um],b\n0,1,1\n0.1,2,2\n0.2,3,3\n", &hints).unwrap();
    let units: Vec<_> = info.channels.iter().map(|c| c.unit_text.clone().unwrap()).collect();
    assert_eq!(units, ["um", "g"], "the option holds where nothing else does");
}

#[test]
fn dates_become_the_start_time() {
    let mut text = "timestamp,x\n".to_owned();
    (0..200).for_each(|i| writeln!(text, "2026-03-01 12:00:00.{:03},{}", i * 5, x(i)).unwrap());
    let (info, samples, _) = read(&text, &Hints::default()).unwrap();
    assert_eq!(info.start_time.unwrap().0, 1_772_366_400_000_000_000);
    assert_eq!((info.channels[0].info.sample_rate, samples[0].len()), (Hz(200.0), 200));
}

#[test]
fn gaps_in_the_times_are_segments() {
    let mut text = "t,x\n".to_owned();
    let time_s = |i: u32| f64::from(i) / 100.0 + if i >= 150 { 5.0 } else { 0.0 };
    (0..300).for_each(|i| writeln!(text, "{:.2},{:.3}", time_s(i), x(i)).unwrap());
    let (info, samples, _) = read(&text, &Hints::default()).unwrap();
    assert_eq!((info.segments, samples[0].len()), (Some(2), 300));
    assert!((info.duration_s - 8.0).abs() < 1e-9, "{}", info.duration_s);
    // The option says twice the rate: the gap stays, its time is halved with all others.
    let (info, ..) = read(&text, &rate(200.0)).unwrap();
    assert_eq!((info.segments, info.channels[0].info.sample_rate), (Some(2), Hz(200.0)));
    assert!((info.duration_s - 4.0).abs() < 1e-9, "{}", info.duration_s);
    assert!(
        info.notes[1].contains("the time column says 100 Hz, --rate 200 Hz"),
        "{:?}",
        info.notes
    );
}

#[test]
fn a_rate_must_come_from_somewhere() {
    let text: String = (0..50).map(|i| format!("{:.3};{:.3}\n", x(i), y(i))).collect();
    assert!(error(&text, &Hints::default()).contains("give --rate HZ"));
    let (info, samples, _) = read(&text, &rate(2000.0)).unwrap();
    assert_eq!(info.channels[1].info.name, "ch2");
    assert_eq!((info.channels[0].info.sample_rate, samples[1].len()), (Hz(2000.0), 50));
    assert_eq!(info.options.as_deref(), Some("--rate 2000 --map 'ch1=/ch1' --map 'ch2=/ch2'"));
    // Rows that are only counted are no seconds.
    let text: String = (0..50).map(|i| format!("{i};{:.3}\n", x(i))).collect();
    assert!(error(&text, &Hints::default()).contains("give --rate HZ"));
    let (info, samples, _) = read(&text, &rate(2000.0)).unwrap();
    assert_eq!((samples.len(), info.ignored.len()), (1, 1), "{:?}", info.ignored);
}

#[test]
fn the_map_names_numbers_and_converts_columns() {
    let text = table("Time [s];DE [g];Fan\n", ";", true, "\n");
    let by_name = mapped(&["right_x=/DE,unit=V,scale=2,offset=1", "left=/Fan"]);
    let (info, samples, _) = read(&text, &by_name).unwrap();
    let names: Vec<_> = info.channels.iter().map(|c| c.info.name.as_str()).collect();
    assert_eq!((names, info.channels[1].info.unit), (vec!["left", "right_x"], Unit::Volt));
    assert!((samples[1][7] - (2.0 * x(7) + 1.0)).abs() < 2e-6);
    assert_eq!(info.channels[0].info.sample_rate, Hz(1000.0), "from the times");
    let (_, by_number, _) = read(&text, &mapped(&["a=/,column=2"])).unwrap();
    assert_eq!(by_number[0], samples[0]);
    let (info, ..) = read(&text, &mapped(&["a=/Fan,interval=0.001"])).unwrap();
    assert_eq!((info.notes.len(), info.channels.len()), (1, 1), "{:?}", info.notes);
    let other = text.replacen("Time [s]", "clock", 1);
    assert!(error(&other, &Hints::default()).contains("give --rate"));
    let (info, ..) = read(&other, &mapped(&["a=/Fan,time=/clock"])).unwrap();
    assert_eq!(info.channels[0].info.sample_rate, Hz(1000.0));
    for (entry, what) in [
        ("a=/Fun", "no column /Fun; there are /Time, /DE, /Fan"),
        ("a=/,column=3", "there are 3, counted from 0"),
        ("a=/", "needs column=K"),
        ("a=/Fan,row=1", "give column="),
        ("a=/Fan,rate=@rate", "give the value"),
        ("a=/Fan,rate=0", "allowed: 0.000001 to"),
        ("a=/Fan,time=/DE", "falls back"),
        ("a=/Fan,scale=0", "scale not 0"),
        ("@start_time=/Fan", "no place for it"),
    ] {
        let found = error(&text, &mapped(&[entry]));
        assert!(found.contains(what), "{entry}: {found}");
    }
    assert!(error(&text, &mapped(&["a=/Fan,rate=10", "b=/DE,rate=20"])).contains("one rate"));
}

#[test]
fn cells_without_a_number_are_counted_and_lines_of_another_width_refused() {
    let mut text = "t,x,y,state\n".to_owned();
    (0..2000)
        .for_each(|i| writeln!(text, "{:.3},{},{},ok", f64::from(i) / 1e3, x(i), y(i)).unwrap());
    let bad = text.replace(&format!(",{},{},ok", x(5), y(5)), ",NaN,,ok");
    let (info, samples, report) = read(&bad, &Hints::default()).unwrap();
    assert_eq!((report.samples_not_finite, report.samples_read), (2, 3998));
    assert_eq!(samples[0].len(), 1999);
    assert_eq!(info.ignored, ["state (2000 of 2000 cells hold no number)"]);
    let holes: String = text
        .lines()
        .enumerate()
        .map(|(at, line)| {
            let y = line.split(',').nth(2).unwrap();
            let is_bad = at > 1 && at % 10 == 0;
            format!("{}\n", if is_bad { line.replace(y, "n/a") } else { line.to_owned() })
        })
        .collect();
    let found = error(&holes, &Hints::default());
    assert!(found.contains("a.csv:11: column y: 200 of 2000 cells"), "{found}");
    assert!(read(&holes, &mapped(&["x=/x"])).is_ok());
    assert!(error(&holes, &mapped(&["y=/y"])).contains("200 of 2000"));
    let narrow = text.replacen("0.700,", "0.700;", 1);
    let found = error(&narrow, &Hints::default());
    assert!(found.contains("a.csv:702: 3 cells where the table has 4"), "{found}");
    let cut = &text[..text.len() - 12];
    let (info, samples, _) = read(cut, &Hints::default()).unwrap();
    assert_eq!(samples[0].len(), 1999);
    assert!(info.notes[1].contains("line 2001, the last, is cut"), "{:?}", info.notes);
    let back = text.replacen("\n1.200,", "\n0.200,", 1);
    let found = error(&back, &Hints::default());
    assert!(found.contains("a.csv:1202: the time falls back"), "{found}");
    // A fall within the first lines does not make the times a channel, except of what may be one.
    let early = text.replacen("\n0.050,", "\n0.020,", 1);
    assert!(error(&early, &Hints::default()).contains("a.csv:52: the time falls back"));
    let doubtful = early.replacen("t,x", "T,x", 1);
    assert_eq!(read(&doubtful, &rate(1000.0)).unwrap().1.len(), 3);
    let (info, ..) = read(&back, &rate(1000.0)).unwrap();
    assert!(info.notes[1].contains("times passed over (line 1202"), "{:?}", info.notes);
}

#[test]
fn what_is_no_table_is_refused_with_the_remedy() {
    assert!(error("just\nsome words\n", &Hints::default()).contains("without a table of numbers"));
    assert!(error("a,b\n1,2\n", &rate(1.0)).contains("without a table of numbers"));
    assert!(error("t,x,x\n0,1,2\n0.1,2,3\n0.2,4,5\n", &Hints::default()).contains("called \"x\""));
    assert!(error("date,x\nfoo,bar\nbar,foo\n", &rate(1.0)).contains("without a table"));
    assert!(error("t\n0.1\n0.2\n0.3\n0.5\n", &Hints::default()).contains("no column of numbers"));
    let wide = "1,".repeat(3000) + "1\n";
    assert!(read(wide.repeat(3), &rate(1.0)).is_err());
    // A line without an end, beyond what is held.
    let long = "0.1;1\n0.2;2\n".repeat(200_000) + "\"" + &"x".repeat(3 << 20);
    assert!(error(long, &rate(1.0)).contains("quotation mark"));
}

#[test]
fn flipped_and_cut_bytes_are_an_error_or_a_table() {
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let whole = table("# rig\nt [s];x [g];y\n", ";", true, "\r\n").into_bytes();
    let whole = &whole[..2000];
    let mut n_read = 0;
    for round in 0..600 {
        let mut bytes = whole.to_vec();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..bytes.len());
            bytes[at] =
                if round % 2 == 0 { random.random() } else { random.random_range(b'+'..=b'=') };
        }
        if round % 3 == 0 {
            bytes.truncate(random.random_range(0..bytes.len()));
        }
        std::fs::write(&path, &bytes).unwrap();
        match read_file(&path, &Hints::default()) {
            Ok((info, _, report)) => {
                let declared: u64 = info.channels.iter().map(|c| c.n_samples).sum();
                assert_eq!(report.samples_read + report.samples_rejected(), declared);
                n_read += 1;
            }
            Err(error) => assert!(error.to_string().contains("a.csv"), "{error}"),
        }
    }
    assert!(n_read > 20, "{n_read}: not every byte can matter");
}

#[test]
fn one_column_with_decimal_commas_is_one_channel() {
    for head in ["acc [g]\n", ""] {
        let rows: String = (0..N).map(|i| format!("{:.4}\n", x(i)).replace('.', ",")).collect();
        let (info, samples, _) = read(format!("{head}{rows}"), &rate(1000.0)).unwrap();
        assert_eq!(samples.len(), 1, "{info}");
        // Printed to 4 digits, rounded to f32.
        let unit = if head.is_empty() { 1.0 } else { 9.806_65 };
        let near = |i: u32| (samples[0][i as usize] / unit - x(i)).abs() < 0.6e-4;
        assert!((0..N).all(near), "{head}: {info}");
        assert!(info.notes[0].contains("one column, decimal comma"), "{:?}", info.notes);
    }
    let counts: String = (0..N).map(|i| format!("{},{}\n", 500 + i % 7, 490 + i % 5)).collect();
    assert_eq!(read(counts, &rate(1000.0)).unwrap().1.len(), 2);
    let row = |i: u32| format!("{},{:03},{:.4}\n", i / 1000, i % 1000, x(i)).replace('.', ",");
    let both: String = (0..N).map(row).collect();
    let text = error(format!("t,x\n{both}"), &Hints::default());
    assert!(text.contains("a.csv:2: twice as many cells as names"), "{text}");
    let grouped: String = (0..N).map(|i| format!("{i};1.{:03},5\n", i)).collect();
    let text = error(format!("t;a\n{grouped}"), &Hints::default());
    assert!(text.contains("without thousands separators"), "{text}");
}

#[test]
fn times_in_other_units_are_read_or_doubted() {
    for unit in [1_000_u64, 1_000_000, 1_000_000_000] {
        let row = |i: u32| 1_700_000_000 * unit + u64::from(i) * unit / 1000;
        let rows: String = (0..N).map(|i| format!("{},{:.6}\n", row(i), x(i))).collect();
        let (info, ..) = read(format!("timestamp,x\n{rows}"), &Hints::default()).unwrap();
        assert_eq!(info.channels[0].info.sample_rate, Hz(1000.0), "{unit}");
        assert_eq!(info.start_time.map(|time| time.0), Some(1_700_000_000_000_000_000));
        assert!(info.notes[0].contains("since 1970"), "{:?}", info.notes);
    }
    // 50 kHz in ns, where float64 has steps of 256 ns.
    let rows: String = (0..N)
        .map(|i| format!("{},0.5\n", 1_700_000_000_000_000_003_u64 + u64::from(i) * 20_000))
        .collect();
    let (info, ..) = read(format!("t,x\n{rows}"), &Hints::default()).unwrap();
    assert_eq!((info.channels[0].info.sample_rate, info.segments), (Hz(50_000.0), None));
    let rows: String = (0..N).map(|i| format!("{i},{:.6}\n", x(i))).collect();
    let (info, ..) = read(format!("t,x\n{rows}"), &Hints::default()).unwrap();
    assert!(info.notes.iter().any(|note| note.contains("are they in seconds?")), "{info}");
    let day = |i: u32| {
        if i < 200 {
            format!("23:59:59.{:03}", 800 + i)
        } else {
            format!("00:00:00.{:03}", i - 200)
        }
    };
    let rows: String = (0..N).map(|i| format!("{},{:.6}\n", day(i), x(i))).collect();
    let (info, ..) = read(format!("Time,x\n{rows}"), &Hints::default()).unwrap();
    assert_eq!((info.channels[0].info.sample_rate, info.segments), (Hz(1000.0), None));
}

#[test]
fn pandas_headers_old_line_ends_and_units_are_told() {
    let rows: String = (0..N).map(|i| format!("{i},{:.6},{:.6}\n", x(i), y(i))).collect();
    assert_read(&read(format!(",0,1\n{rows}"), &rate(1000.0)).unwrap(), "pandas");
    let text = table("t,x,y\n", ",", false, "\r").replace('\n', "\r");
    assert!(error(text, &Hints::default()).contains("tr '\\r' '\\n'"));
    let text = table("t,x,y\n", ",", false, "\n");
    let text = error(text, &mapped(&["a=/x,unit=foo"]));
    assert!(text.contains("unit=foo; expected one of ") && text.contains(", mm/s,"), "{text}");
}
