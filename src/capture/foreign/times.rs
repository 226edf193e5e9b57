//! A vector of the samples' times: the rate it stands for, and where it has gaps.
//!
//! The rate is that of the whole span, gaps left out; every time must then lie within half a sample
//! of its place. Read twice, a piece at a time: once for gaps and span, once to hold each time
//! against its place. Must not know channels.

use super::grid::Strip;
use super::objects::{Element, Number};
use super::places::{Places, Problem};
use crate::capture::checks::Chunks;
use crate::capture::hdf5::{Attribute, Dataset};
use crate::capture::since_1970;
use crate::units::Hz;

/// Elements read at once, rounded up to whole chunks.
const PIECE: u64 = 65_536;

/// A step longer than this is a gap, in intervals.
const GAP_INTERVALS: f64 = 1.5;

/// Segments at most.
const SEGMENTS_MAX: usize = 1_000_000;

/// Samples over which the interval is first estimated.
const STRIDE: usize = 16;

/// What a vector of times says.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TimeAxis {
    /// Samples a second between gaps.
    pub(super) rate: Hz,
    /// First sample of each contiguous run.
    pub(super) starts: Vec<i64>,
    /// Time of each of them after the first sample, s.
    pub(super) times_s: Vec<f64>,
    /// Nanoseconds since 1970 of the first sample, if the times count from there.
    pub(super) start_ns: Option<i64>,
}

impl TimeAxis {
    /// Reads the vector at `path`, of `length` elements.
    pub(super) fn read(places: Places<'_>, path: &str, length: u64) -> Result<Self, Problem> {
        let (dataset, at) = places.dataset(path)?;
        let library = |e| places.checks.library(path, e);
        let number = match dataset.element().map_err(library)? {
            Element::Number(number) => number,
            Element::Text => {
                return Err(format!("time={path} holds texts; expected seconds").into());
            }
            Element::Other(what) => {
                return Err(format!("time={path} holds {what}; expected seconds").into());
            }
        };
        let strip = Strip::find(&dataset.shape(), None, None)
            .map_err(|words| format!("time={path}: {words}"))?;
        if strip.length != length {
            return Err(format!(
                "time={path} has {} times for {length} samples; give rate=HZ instead",
                strip.length
            )
            .into());
        }
        let slab: Vec<u64> = strip.extents(1, 1).iter().map(|&n| n as u64).collect();
        let bytes = (number.bytes(), 8);
        let chunks = &mut Chunks::default();
        let (chunk, _) = places.checks.box_storage(&dataset, &at, bytes, &slab, chunks)?;
        let chunk = chunk.map_or(1, |extents| extents[strip.axis]);
        let piece = PIECE.next_multiple_of(chunk.max(1));
        let stored = Stored { places, path, dataset, number, strip };
        let scale = Scale::find(&stored, length)?;
        let read = |start: u64, count: u64| scale.seconds(&stored, start, count);
        let mut axis = Builder::default();
        each_piece(length, piece, &read, |times| axis.take(times))
            .and_then(|()| axis.finish().map_err(Problem::Words))
            .and_then(|axis| {
                let mut check = Check { axis: &axis, run: 0, at: 0, first: None };
                each_piece(length, piece, &read, |times| check.take(times))?;
                Ok(Self { start_ns: scale.start_ns, ..axis })
            })
            .map_err(|problem| match problem {
                Problem::Words(words) => Problem::Words(format!("time={path}: {words}")),
                whole @ Problem::Whole(_) => whole,
            })
    }
}

/// The numbers of a vector of times as they are stored.
struct Stored<'a> {
    places: Places<'a>,
    path: &'a str,
    dataset: Dataset,
    number: Number,
    strip: Strip,
}

/// How stored numbers become seconds.
struct Scale {
    unit_s: f64,
    /// What is taken off, so that differences keep their digits.
    base: f64,
    base_integer: i64,
    start_ns: Option<i64>,
}

impl Scale {
    /// By the attribute `unit` or `units`, and by the magnitude of the first time.
    fn find(stored: &Stored<'_>, length: u64) -> Result<Self, Problem> {
        let stated_s = stored.unit_s()?;
        let none = Self { unit_s: 1.0, base: 0.0, base_integer: 0, start_ns: None };
        let (corner, extents) = stored.place(0, length.min(1));
        let library = |e| stored.places.checks.library(stored.path, e);
        let integers = stored.dataset.integers_of_64_bits(stored.number, &corner, &extents);
        let integer = integers.map_err(library)?.and_then(|found| found.first().copied());
        let first = none.seconds(stored, 0, length.min(1))?.first().copied().unwrap_or(0.0);
        let unit_ns = since_1970::unit_ns(first, stated_s);
        let of_unit = |unit_ns: i64| match integer {
            Some(integer) => integer.checked_mul(unit_ns),
            #[expect(clippy::cast_possible_truncation, reason = "a float saturates")]
            None => Some((first * unit_ns as f64).round() as i64),
        };
        Ok(Self {
            unit_s: unit_ns.map_or(stated_s.unwrap_or(1.0), |unit_ns| unit_ns as f64 * 1e-9),
            base: if unit_ns.is_some() { first } else { 0.0 },
            base_integer: integer.filter(|_| unit_ns.is_some()).unwrap_or(0),
            start_ns: unit_ns.and_then(of_unit),
        })
    }

    fn seconds(&self, stored: &Stored<'_>, start: u64, count: u64) -> Result<Vec<f64>, Problem> {
        let (corner, extents) = stored.place(start, count);
        let library = |e| stored.places.checks.library(stored.path, e);
        let integers = stored.dataset.integers_of_64_bits(stored.number, &corner, &extents);
        if let Some(integers) = integers.map_err(library)? {
            let since = |time: i64| time.wrapping_sub(self.base_integer) as f64;
            return Ok(integers.into_iter().map(|time| since(time) * self.unit_s).collect());
        }
        let times = stored.dataset.numbers(stored.number, &corner, &extents).map_err(library)?;
        Ok(times.into_iter().map(|time| (time - self.base) * self.unit_s).collect())
    }
}

impl Stored<'_> {
    fn place(&self, start: u64, count: u64) -> (Vec<usize>, Vec<usize>) {
        let clamp = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
        (self.strip.corner(clamp(start), self.strip.at), self.strip.extents(clamp(count), 1))
    }

    /// Seconds in the unit that an attribute of the times states.
    fn unit_s(&self) -> Result<Option<f64>, Problem> {
        for name in ["unit", "units"] {
            let found = self.dataset.attribute(name);
            let found = found.map_err(|e| self.places.checks.library(self.path, e))?;
            let Some(Attribute::Text(text)) = found else { continue };
            // "seconds since 1970-01-01", as climate conventions write it.
            let word = text.split(" since ").next().unwrap_or_default().trim().to_lowercase();
            return match word.as_str() {
                "" => continue,
                "s" | "sec" | "secs" | "second" | "seconds" => Ok(Some(1.0)),
                "ms" | "msec" | "millisecond" | "milliseconds" => Ok(Some(1e-3)),
                "us" | "µs" | "μs" | "usec" | "microsecond" | "microseconds" => Ok(Some(1e-6)),
                "ns" | "nsec" | "nanosecond" | "nanoseconds" => Ok(Some(1e-9)),
                _ => {
                    let (path, found) = (self.path, Attribute::Text(text).describe());
                    Err(format!(
                        "time={path}: attribute {name} is {found}; expected s, ms, us or ns; or give rate=HZ instead"
                    )
                    .into())
                }
            };
        }
        Ok(None)
    }
}

fn each_piece(
    length: u64,
    piece: u64,
    read: &dyn Fn(u64, u64) -> Result<Vec<f64>, Problem>,
    mut take: impl FnMut(&[f64]) -> Result<(), String>,
) -> Result<(), Problem> {
    let mut at = 0;
    while at < length {
        let count = piece.min(length - at);
        let times = read(at, count)?;
        if times.len() as u64 != count {
            return Err(format!("{} of {count} times can be read from {at} on", times.len()).into());
        }
        take(&times)?;
        at += count;
    }
    Ok(())
}

/// First pass: gaps, and the span between them.
#[derive(Default)]
struct Builder {
    /// Estimate from the first piece, s.
    interval_s: f64,
    n: u64,
    first: f64,
    last: f64,
    starts: Vec<i64>,
    times_s: Vec<f64>,
    /// Sum of the steps that are no gaps, s, and their number.
    span_s: f64,
    n_steps: u64,
}

impl Builder {
    fn take(&mut self, times: &[f64]) -> Result<(), String> {
        if self.n == 0 {
            self.interval_s = estimate(times)?;
        }
        for &time in times {
            if !time.is_finite() {
                return Err(format!("element {} is {time}; times must be finite", self.n));
            }
            let step = time - self.last;
            if self.n == 0 {
                self.first = time;
                self.begin(time);
            } else if step <= 0.0 {
                let (n, last) = (self.n, self.last);
                return Err(format!(
                    "element {n} is {time} s, not later than {last} s before it; give rate=HZ instead"
                ));
            } else if step > GAP_INTERVALS * self.interval_s {
                if self.starts.len() >= SEGMENTS_MAX {
                    return Err(format!("more than {SEGMENTS_MAX} gaps; give rate=HZ instead"));
                }
                self.begin(time);
            } else {
                self.span_s += step;
                self.n_steps += 1;
            }
            self.last = time;
            self.n += 1;
        }
        Ok(())
    }

    fn begin(&mut self, time: f64) {
        self.starts.push(i64::try_from(self.n).unwrap_or(i64::MAX));
        self.times_s.push(time - self.first);
    }

    fn finish(self) -> Result<TimeAxis, String> {
        if self.n_steps == 0 {
            return Err("no two times without a gap between them; give rate=HZ instead".into());
        }
        let rate = Hz(self.n_steps as f64 / self.span_s);
        Ok(TimeAxis { rate, starts: self.starts, times_s: self.times_s, start_ns: None })
    }
}

/// Interval of the first times, s: the median over runs of a few, which rounding disturbs little.
fn estimate(times: &[f64]) -> Result<f64, String> {
    let stride = STRIDE.min(times.len().saturating_sub(1));
    if stride == 0 {
        return Err("one time makes no rate; give rate=HZ instead".into());
    }
    let mut intervals: Vec<f64> = times
        .windows(stride + 1)
        .step_by(stride)
        .map(|run| (run[stride] - run[0]) / stride as f64)
        .filter(|interval| interval.is_finite())
        .collect();
    intervals.sort_by(f64::total_cmp);
    let middle = intervals.get(intervals.len() / 2).copied().unwrap_or(f64::NAN);
    if middle > 0.0 {
        return Ok(middle);
    }
    Err("the first times do not rise; expected seconds, rising; or give rate=HZ instead".into())
}

/// Second pass: every time against its place.
struct Check<'a> {
    axis: &'a TimeAxis,
    run: usize,
    at: u64,
    first: Option<f64>,
}

impl Check<'_> {
    fn take(&mut self, times: &[f64]) -> Result<(), String> {
        let TimeAxis { rate, starts, times_s, .. } = self.axis;
        for &time in times {
            let begins = |start: &i64| u64::try_from(*start).is_ok_and(|start| start <= self.at);
            while starts.get(self.run + 1).is_some_and(begins) {
                self.run += 1;
            }
            let first = *self.first.get_or_insert(time);
            let start = u64::try_from(starts[self.run]).unwrap_or(0);
            let place_s = times_s[self.run] + (self.at - start) as f64 / rate.0;
            let off = (time - first - place_s) * rate.0;
            if off.abs() > 0.5 {
                return Err(format!(
                    "element {} is {time} s, {:.2} samples off its place at {} Hz; not uniform: give rate=HZ instead if it is known",
                    self.at, off, rate.0
                ));
            }
            self.at += 1;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both passes over times, `piece` at once.
    fn axis(times: &[f64], piece: usize) -> Result<TimeAxis, String> {
        let mut builder = Builder::default();
        times.chunks(piece).try_for_each(|piece| builder.take(piece))?;
        let axis = builder.finish()?;
        let mut check = Check { axis: &axis, run: 0, at: 0, first: None };
        times.chunks(piece).try_for_each(|piece| check.take(piece))?;
        Ok(axis)
    }

    #[test]
    fn the_rate_is_that_of_the_whole_span() {
        // Rounded to 1 µs at 12 kHz: a step is off by 1.2 %, the span of 10 000 by 1e-6 of itself.
        let times: Vec<f64> =
            (0..10_000).map(|k| (f64::from(k) / 12_000.0 * 1e6).round() / 1e6 + 7.0).collect();
        let axis = axis(&times, 1000).unwrap();
        assert!((axis.rate.0 - 12_000.0).abs() < 12_000.0 * 2e-6, "{}", axis.rate.0);
        assert_eq!((axis.starts, axis.times_s), (vec![0], vec![0.0]));
    }

    #[test]
    fn gaps_become_segments() {
        let time = |k: u32| f64::from(k) / 1000.0 + if k >= 300 { 2.0 } else { 0.0 };
        let times: Vec<f64> = (0..1000).map(time).collect();
        let axis = axis(&times, 64).unwrap();
        assert_eq!(axis.starts, [0, 300]);
        assert!((axis.times_s[1] - 2.3).abs() < 1e-12, "{:?}", axis.times_s);
        // Sum of 998 steps, each rounded to 2e-16 · 3 s.
        assert!((axis.rate.0 - 1000.0).abs() < 1e-6, "{}", axis.rate.0);
    }

    #[test]
    fn what_is_not_uniform_is_told_with_its_place() {
        // 1 % slower from sample 500 on: half a sample after about 2000 more, of 10 000.
        let time = |k: u32| f64::from(k) / 1000.0 + 1e-5 * f64::from(k.saturating_sub(500));
        let times: Vec<f64> = (0..1000).map(time).collect();
        let words = axis(&times, 100).unwrap_err();
        assert!(words.starts_with("element ") && words.contains("not uniform"), "{words}");
        let words = axis(&[0.0, 0.1, 0.2, f64::NAN, 0.4], 9).unwrap_err();
        assert!(words.starts_with("element 3 is NaN"), "{words}");
        let words = axis(&[0.0, 0.1, 0.2, 0.2, 0.4], 9).unwrap_err();
        assert!(words.starts_with("element 3 is 0.2 s, not later"), "{words}");
        assert!(axis(&[0.0], 9).unwrap_err().contains("one time"));
        assert!(axis(&[2.0, 1.0, 0.0], 9).unwrap_err().contains("do not rise"));
    }
}
