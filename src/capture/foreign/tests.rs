//! Files of other layouts, written with bare library calls, read through maps.

use super::inventory::Inventory;
use crate::capture::error::CaptureError;
use crate::capture::hdf5::{H5Type, NewFile};
use crate::capture::hints::Hints;
use crate::capture::map::ChannelMap;
use crate::capture::reader::CaptureReader;
use crate::signal::Block;
use crate::units::{Hz, Unit};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::path::{Path, PathBuf};

/// Samples of a channel.
const N: usize = 5000;

/// Channels of a table.
const C: usize = 3;

/// Sample `k` of channel `c`: distinct, and exact in every number type of 16 bits and more.
fn sample(k: usize, c: usize) -> i16 {
    i16::try_from((k * 7 + c * 1000) % 20_000).unwrap()
}

/// A table, time along dimension 0 (`by_rows`) or 1.
fn table<T>(by_rows: bool, of: impl Fn(i16) -> T) -> Vec<T> {
    let at = |i: usize| if by_rows { (i / C, i % C) } else { (i % N, i / N) };
    (0..N * C).map(at).map(|(k, c)| of(sample(k, c))).collect()
}

struct Foreign {
    _folder: tempfile::TempDir,
    path: PathBuf,
}

impl Foreign {
    fn new(build: impl FnOnce(&NewFile)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        let file = NewFile::create(&path).unwrap();
        build(&file);
        file.close().unwrap();
        Self { _folder: folder, path }
    }

    fn hints(options: &[&str]) -> Hints {
        Hints { map: ChannelMap::of_options(options).unwrap(), ..Hints::default() }
    }

    /// Every sample of every channel, and the blocks.
    fn read(&self, options: &[&str]) -> (Vec<Vec<f64>>, Vec<Block>, CaptureReader) {
        read(&self.path, &Self::hints(options)).unwrap()
    }

    fn refused(&self, option: &str) -> String {
        let error = CaptureReader::open(&self.path, None, &Self::hints(&[option])).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("a.h5"), "names the file: {text}");
        text
    }
}

#[expect(clippy::type_complexity, reason = "three things a test looks at")]
fn read(
    path: &Path,
    hints: &Hints,
) -> Result<(Vec<Vec<f64>>, Vec<Block>, CaptureReader), CaptureError> {
    let mut reader = CaptureReader::open(path, None, hints)?;
    let mut samples = vec![Vec::new(); reader.info().channels.len()];
    let mut blocks = Vec::new();
    while let Some(block) = reader.next_block()? {
        let offset = reader.info().channels[block.channel.0].info.offset;
        samples[block.channel.0].extend(block.samples.iter().map(|&x| f64::from(x) + offset));
        blocks.push(block);
    }
    Ok((samples, blocks, reader))
}

/// Writes a table at the root.
fn put<T: H5Type>(
    file: &NewFile,
    name: &str,
    shape: &[usize],
    data: &[T],
    chunk: Option<&[usize]>,
) {
    let mut builder = file.inner.new_dataset::<T>().shape(shape);
    if let Some(chunk) = chunk {
        builder = builder.chunk(chunk).shuffle_deflate(1);
    }
    let dataset = builder.create(name).unwrap();
    if !data.is_empty() {
        dataset.write_raw(data).unwrap();
    }
}

fn expected(c: usize) -> Vec<f64> {
    (0..N).map(|k| f64::from(sample(k, c))).collect()
}

#[test]
fn tables_of_every_shape_and_type_are_read_alike() {
    let options = ["a=/x,column=2,rate=1000", "b=/x,column=0,rate=1000"];
    for by_rows in [true, false] {
        let (shape, chunks) = if by_rows {
            ([N, C], [[700, 2], [512, 3], [64, 1]])
        } else {
            ([C, N], [[2, 700], [3, 512], [1, 64]])
        };
        let storages = [None, Some(&chunks[0]), Some(&chunks[1]), Some(&chunks[2])];
        for (at, chunk) in storages.into_iter().enumerate() {
            let chunk = chunk.map(|chunk| &chunk[..]);
            let file = Foreign::new(|file| match at {
                0 => put(file, "x", &shape, &table(by_rows, f32::from), chunk),
                1 => put(file, "x", &shape, &table(by_rows, f64::from), chunk),
                2 => put(file, "x", &shape, &table(by_rows, |x| x), chunk),
                _ => put(file, "x", &shape, &table(by_rows, i32::from), chunk),
            });
            let (samples, blocks, reader) = file.read(&options);
            assert!(samples[0] == expected(2) && samples[1] == expected(0), "{by_rows} {at}");
            assert!(blocks.iter().all(|block| block.samples.len() <= 1000), "{by_rows} {at}");
            assert_eq!(reader.info().channels[0].info.sample_rate, Hz(1000.0));
        }
        let file = Foreign::new(|file| {
            put(file, "u16", &shape, &table(by_rows, |x| x.unsigned_abs()), None);
            put(file, "i64", &shape, &table(by_rows, i64::from), None);
            put(file, "u64", &shape, &table(by_rows, |x| u64::from(x.unsigned_abs())), None);
            put(file, "u32", &shape, &table(by_rows, |x| u32::from(x.unsigned_abs())), None);
        });
        for name in ["u16", "i64", "u64", "u32"] {
            let option = format!("a=/{name},column=1,rate=1000");
            assert!(file.read(&[&option]).0[0] == expected(1), "{by_rows} {name}");
        }
    }
}

#[test]
fn bytes_and_rows_and_single_columns_are_read() {
    let bytes: Vec<u8> = (0..=255).cycle().take(1000).collect();
    let signed: Vec<i8> = (-128..=127).cycle().take(1000).collect();
    let file = Foreign::new(|file| {
        put(file, "u8", &[1000], &bytes, None);
        put(file, "i8", &[1, 1000], &signed, None);
        put(file, "column", &[1000, 1], &bytes, Some(&[100, 1]));
        put(file, "wide", &[4, 6], &(0..24).collect::<Vec<i32>>(), None);
    });
    let u8s: Vec<f64> = bytes.iter().map(|&x| f64::from(x)).collect();
    let i8s: Vec<f64> = signed.iter().map(|&x| f64::from(x)).collect();
    let (samples, ..) = file.read(&["a=/u8,rate=9", "b=/i8,rate=9", "c=/column,rate=9"]);
    assert!(samples == [u8s.clone(), i8s, u8s]);
    let (samples, ..) = file.read(&["a=/wide,row=2,rate=9", "b=/wide,column=2,rate=9"]);
    assert_eq!(samples[0], samples[1], "of a C × N table a column is a row of HDF5");
    assert_eq!(samples[0], [12.0, 13.0, 14.0, 15.0, 16.0, 17.0]);
}

#[test]
fn what_the_file_says_is_found_where_the_map_says() {
    let file = Foreign::new(|file| {
        put(file, "x", &[N], &table(true, f64::from)[..N], None);
        put(file, "fs", &[1, 1], &[2000.0_f64], None);
        put(file, "rpm", &[1], &[1500_i32], None);
        put(file, "unit", &[1, 3], &"m/s".encode_utf16().collect::<Vec<u16>>(), None);
        put(file, "n", &[1], &[7_u16], None);
        file.number("dt", 0.25e-3_f64).unwrap();
        file.number("shaft_speed_hz", -1.0_f64).unwrap();
        file.text("start", "2026-03-01T12:00:00Z").unwrap();
        file.text("fs_text", " 500 ").unwrap();
        let group = file.inner.create_group("deep").unwrap();
        let inner = group.create_group("er").unwrap();
        inner.set_attr_numeric("fs", &125.0_f32).unwrap();
        inner.set_attr_string("unit", "µm").unwrap();
        let x = file.inner.new_dataset::<f32>().shape([N]).create("deep/er/x");
        x.unwrap().write_raw(&vec![1.0_f32; N]).unwrap();
        file.inner.create_soft_link("short", "/deep/er").unwrap();
    });
    let rate = |option: &str| {
        let (_, _, reader) = file.read(&[option]);
        reader.info().channels[0].info.sample_rate.0
    };
    assert!((rate("a=/x,rate=/fs") - 2000.0).abs() < 1e-9);
    assert!((rate("a=/x,interval=/@dt") - 4000.0).abs() < 1e-9);
    assert!((rate("a=/x,rate=/@fs_text") - 500.0).abs() < 1e-9);
    assert!((rate("a=/short/x,rate=/short@fs") - 125.0).abs() < 1e-9);
    let options =
        ["a=/x,rate=/fs,unit=g,scale=2,offset=1", "b=/deep/er/x,rate=9,unit=/deep/er@unit"];
    let facts = ["@shaft_speed=/rpm,unit=rpm", "@start_time=/@start"];
    let (_, _, reader) = file.read(&[&options[..], &facts[..]].concat());
    let info = reader.info();
    assert!(info.shaft_speed.is_some_and(|speed| (speed.0 - 25.0).abs() < 1e-12), "{info}");
    assert!(info.start_time.is_some());
    assert_eq!(info.channels[0].info.unit, Unit::MetrePerSecondSquared);
    assert_eq!(info.channels[1].info.unit, Unit::Micrometre);
    assert!((info.channels[0].scale - 2.0).abs() < 1e-12);
    assert!(info.notes.iter().any(|note| note.contains("shaft_speed_hz is -1")), "{info}");
    let by_caller = Hints { rate: Some(Hz(77.0)), ..Foreign::hints(&["a=/x"]) };
    let (_, _, reader) = read(&file.path, &by_caller).unwrap();
    assert!((reader.info().channels[0].info.sample_rate.0 - 77.0).abs() < 1e-9);
}

#[test]
fn times_give_rate_and_segments() {
    let time = |k: usize| k as f64 / 100.0 + if k >= 2000 { 50.0 } else { 0.0 } + 3.0;
    let times: Vec<f64> = (0..N).map(time).collect();
    let file = Foreign::new(|file| {
        put(file, "t", &[N, 1], &times, Some(&[300, 1]));
        put(file, "x", &[N, C], &table(true, f32::from), None);
        put(file, "other", &[N], &vec![0.0_f32; N], None);
    });
    let (samples, blocks, reader) = file.read(&["a=/x,column=0,time=/t", "b=/x,column=1,time=/t"]);
    assert!(samples[0] == expected(0) && samples[1] == expected(1));
    assert_eq!(reader.info().segments, Some(2));
    let second = blocks.iter().find(|block| block.segment == 1).unwrap();
    assert_eq!(second.start.0, 2000);
    assert!((second.time_s - 70.0).abs() < 1e-9, "{}", second.time_s);
    let hints = Foreign::hints(&["a=/x,column=0,time=/t", "b=/other,rate=100"]);
    let text = CaptureReader::open(&file.path, None, &hints).unwrap_err().to_string();
    assert!(text.contains("gap before element 2000"), "{text}");
    assert!(file.refused("a=/other,time=/x").contains("time=/x: the shape is 5000 × 3"));
}

#[test]
fn refusals_name_entry_finding_and_remedy() {
    let file = Foreign::new(|file| {
        put(file, "data", &[N, C], &table(true, f32::from), None);
        put(file, "cube", &[4, 4, 4], &[0.0_f32; 64], None);
        put(file, "fault", &[1], &[3.0_f64], None);
        put(file, "one", &[1], &[3.0_f64], None);
        put(file, "none", &[0], &[0.0_f64; 0], None);
        file.number("label", 3.0_f64).unwrap();
        file.group("truth").unwrap();
        file.inner.create_soft_link("way", "/truth/x").unwrap();
        file.inner.create_soft_link("ring", "/ring").unwrap();
        file.inner.create_external_link("out", "b.h5", "/x").unwrap();
    });
    for (option, words) in [
        ("a=/dat,rate=1", "--map: a: there is no /dat in the file; / holds data, out"),
        ("a=/data,rate=1", "add column=K, K from 0 to 2"),
        ("a=/data,column=3,rate=1", "column is 0 to 2"),
        ("a=/data,column=1", "no sample rate; add rate=HZ"),
        ("a=/data,column=1,rate=0", "0 samples a second"),
        ("a=/data,column=1,rate=@fs", "/data has no attribute fs"),
        ("a=/data,column=1,rate=/@label", "never read"),
        ("a=/data,column=1,rate=/fault", "never read"),
        ("a=/data,column=1,rate=1,unit=furlong", "expected one of g, m/s^2"),
        ("a=/data,column=1,rate=1,scale=0", "scale not 0"),
        ("a=/cube,rate=1", "the shape is 4 × 4 × 4; expected one or two dimensions"),
        ("a=/,rate=1", "/ is a group"),
        ("a=/none,rate=1", "0 samples"),
        ("a=/truth/x,rate=1", "/truth is never read"),
        ("a=/way,rate=1", "/truth is never read"),
        ("a=/ring,rate=1", "circle"),
        ("a=/out,rate=1", "out of this file"),
        ("@shaft_speed=/one", "no entry names a channel"),
    ] {
        let text = file.refused(option);
        assert!(text.contains(words), "{option}: {text}");
    }
    let foreign = CaptureReader::open(&file.path, None, &Hints::default()).unwrap_err().to_string();
    assert!(foreign.contains("`rotorwatch check"), "{foreign}");
}

#[test]
fn declared_sizes_are_limited() {
    let file = Foreign::new(|file| {
        let huge = file.inner.new_dataset::<f64>().shape([1 << 40, 4]).chunk(&[1 << 20, 4]);
        huge.create("tall").unwrap();
        let chunk = file.inner.new_dataset::<f64>().shape([1 << 22, 4]).chunk(&[1 << 22, 4]);
        chunk.create("chunk").unwrap();
        // Chunks of 2 MiB a column as float64, but a row of them over the 64 MiB that may be held at once.
        let wide = file.inner.new_dataset::<u8>().shape([1 << 18, 64]).chunk(&[1 << 18, 1]);
        wide.create("wide").unwrap();
    });
    assert!(file.refused("a=/tall,column=0,rate=1").contains("elements declared"));
    assert!(file.refused("a=/chunk,column=0,rate=1").contains("h5repack"));
    let last = Foreign::hints(&["a=/wide,column=0,rate=1", "b=/wide,column=63,rate=1"]);
    let text = CaptureReader::open(&file.path, None, &last).unwrap_err().to_string();
    assert!(text.contains("is over the limit"), "{text}");
    let near = Foreign::hints(&["a=/wide,column=0,rate=1", "b=/wide,column=1,rate=1"]);
    assert!(CaptureReader::open(&file.path, None, &near).is_ok());
}

#[test]
fn an_inventory_lists_and_suggests_what_then_reads() {
    let file = Foreign::new(|file| {
        put(file, "data", &[C, N], &table(false, f32::from), None);
        put(file, "Fs", &[1, 1], &[2000.0_f64], None);
        put(file, "label", &[1], &[4.0_f64], None);
        put(file, "short", &[255], &[0.0_f64; 255], None);
        let group = file.inner.create_group("my run").unwrap();
        group.set_attr_numeric("fault_size", &0.7_f64).unwrap();
        group.set_attr_numeric("wf_increment", &1e-3_f64).unwrap();
        let x = group.new_dataset::<f64>().shape([N]).create("data").unwrap();
        x.write_raw(&vec![0.5; N]).unwrap();
    });
    let inventory = Inventory::examine(&file.path).unwrap();
    let options = inventory.map_options();
    assert_eq!(
        options,
        [
            "data_0=/data,column=0,rate=/Fs",
            "data_1=/data,column=1,rate=/Fs",
            "data_2=/data,column=2,rate=/Fs",
            "data=/my run/data,interval=/my run@wf_increment",
        ]
    );
    let text = inventory.to_string();
    for words in [
        "/data: float32, 3 × 5000, contiguous\n",
        "/Fs: float64, 1 × 1, contiguous = 2000",
        "@fault_size: not read",
        "/label: float64, 1, contiguous\n",
        "'data=/my run/data,",
    ] {
        assert!(text.contains(words), "{words} not in\n{text}");
    }
    assert!(!text.contains("0.7"), "{text}");
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    let (samples, ..) = file.read(&options);
    assert!(samples[1..] == [expected(0), expected(1), expected(2)]);
}

#[test]
fn an_inventory_is_bounded() {
    let file = Foreign::new(|file| {
        for group in 0..30 {
            let group = file.inner.create_group(&format!("g{group:02}")).unwrap();
            for at in 0..10 {
                let name = format!("x{at}");
                let x = group.new_dataset::<f32>().shape([300]).create(&name).unwrap();
                x.write_raw(&[0.0_f32; 300]).unwrap();
            }
        }
    });
    let inventory = Inventory::examine(&file.path).unwrap();
    assert_eq!(inventory.map_options().len(), 64);
    let text = inventory.to_string();
    assert!(text.lines().count() < 300 && text.contains("the first 200 objects"), "{text}");
    assert!(text.contains("rate=HZ") && text.contains("put the samples a second"), "{text}");
}

#[test]
fn flipped_bytes_are_an_error_or_bounded() {
    let file = Foreign::new(|file| {
        put(file, "x", &[400, C], &table(true, f32::from)[..400 * C], Some(&[64, 2]));
        put(file, "t", &[400], &(0..400).map(f64::from).collect::<Vec<f64>>(), None);
        put(file, "fs", &[1], &[100.0_f64], None);
        file.number("dt", 1e-2_f64).unwrap();
    });
    let sound = std::fs::read(&file.path).unwrap();
    let all = ["a=/x,column=0,rate=/fs", "b=/x,column=2,interval=/@dt", "c=/x,column=1,time=/t"];
    let hints: Vec<Hints> = all.iter().map(|option| Foreign::hints(&[option])).collect();
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let (mut n_read, mut n_refused) = (0, 0);
    for case in 0..300 {
        let mut bytes = sound.clone();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..bytes.len());
            bytes[at] ^= 1 << random.random_range(0..8);
        }
        std::fs::write(&file.path, &bytes).unwrap();
        match read(&file.path, &hints[case % hints.len()]) {
            Ok((samples, ..)) => {
                let n: usize = samples.iter().map(Vec::len).sum();
                assert!(n <= 64 << 20, "{case}: {n} samples of a small file");
                n_read += 1;
            }
            Err(_) => n_refused += 1,
        }
        let _listed = Inventory::examine(&file.path).map(|inventory| inventory.to_string());
    }
    assert!(n_read > 50 && n_refused > 15, "{n_read} read, {n_refused} refused");
}

#[test]
fn values_without_dimensions_are_read_and_suggested() {
    let file = Foreign::new(|file| {
        let scalar = |name: &str, value: f64| {
            let dataset = file.inner.new_dataset::<f64>().scalar().create(name).unwrap();
            dataset.write_raw(&[value]).unwrap();
        };
        scalar("fs", 12_000.0);
        scalar("dt", 1e-3);
        let speed = file.inner.new_dataset::<i32>().scalar().create("rpm").unwrap();
        speed.write_raw(&[1500_i32]).unwrap();
        put(file, "x", &[N], &vec![0.5_f32; N], None);
    });
    let inventory = Inventory::examine(&file.path).unwrap();
    let options = inventory.map_options();
    assert_eq!(options, ["x=/x,rate=/fs", "@shaft_speed=/rpm,unit=rpm"]);
    let text = inventory.to_string();
    assert!(text.contains("/fs: float64, one element, contiguous = 12000\n"), "{text}");
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    let (_, _, reader) = file.read(&options);
    assert_eq!(reader.info().channels[0].info.sample_rate, Hz(12_000.0));
    assert_eq!(reader.info().shaft_speed, Some(Hz(25.0)));
    let (_, _, reader) = file.read(&["x=/x,interval=/dt"]);
    assert_eq!(reader.info().channels[0].info.sample_rate, Hz(1000.0));
    assert!(file.refused("x=/fs,rate=1").contains("one element"));
}

#[test]
fn times_are_in_the_unit_stated_or_told_by_their_size() {
    let file = Foreign::new(|file| {
        let of = |scale: f64| (0..N).map(|k| k as f64 * scale).collect::<Vec<f64>>();
        let units = [("ms", "ms", 0.5), ("cf", "microseconds since start", 500.0), ("h", "h", 0.5)];
        for (name, unit, scale) in units {
            let dataset = file.inner.new_dataset::<f64>().shape([N]).create(name).unwrap();
            dataset.write_raw(&of(scale)).unwrap();
            dataset
                .new_attr::<::hdf5::VarLenUnicode>()
                .create("units")
                .unwrap()
                .write_string(unit)
                .unwrap();
        }
        // 2 MHz: steps of 500 ns, where float64 has steps of 256 ns.
        let ns: Vec<i64> = (0..5000).map(|k| 1_700_000_000_000_000_003 + k * 500).collect();
        put(file, "ns", &[N], &ns, None);
        put(file, "s", &[N], &of(1.0), None);
        put(file, "x", &[N], &vec![0.5_f32; N], None);
    });
    for (times, rate_hz) in [("ms", 2000.0), ("cf", 2000.0), ("ns", 2e6), ("s", 1.0)] {
        let (_, _, reader) = file.read(&[&format!("x=/x,time=/{times}")]);
        let info = reader.info();
        let found = info.channels[0].info.sample_rate.0;
        // 5000 steps, each with a rounding.
        assert!((found / rate_hz - 1.0).abs() < 1e-9, "{times}: {found}");
        let start = (times == "ns").then_some(1_700_000_000_000_000_003);
        assert_eq!(info.start_time.map(|time| time.0), start, "{times}");
        let doubted = info.notes.iter().any(|note| note.contains("are they in seconds?"));
        assert_eq!(doubted, times == "s", "{:?}", info.notes);
    }
    assert!(file.refused("x=/x,time=/h").contains("expected s, ms, us or ns"));
}
