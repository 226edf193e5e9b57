//! Segments: where a capture is contiguous, and the time of every sample.

use crate::units::Hz;

/// How far a scaled segment start may lie from an integer and still count as one, samples.
const WHOLE_SAMPLE: f64 = 1e-6;

/// Part of a segment by which a clock may be off before two segments overlap.
const OVERLAP_SLACK: f64 = 1e-3;

/// The segments of a capture, in samples of its fastest channel; at least one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segments {
    starts: Vec<u64>,
    times_s: Vec<f64>,
    reference_rate: Hz,
}

/// One segment as a channel sees it: samples `start..end`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    pub(super) segment: u32,
    pub(super) start: u64,
    /// `u64::MAX` for the last segment.
    pub(super) end: u64,
    pub(super) time_s: f64,
}

impl Segments {
    /// One segment from time 0 on.
    pub(super) fn one(reference_rate: Hz) -> Self {
        Self { starts: vec![0], times_s: vec![0.0], reference_rate }
    }

    /// Checks the two lists; `length` = samples of the longest channel at `reference_rate`.
    ///
    /// The error says which element is wrong and what is required.
    pub(super) fn new(
        start_sample: &[i64],
        times_s: Vec<f64>,
        reference_rate: Hz,
        length: u64,
    ) -> Result<Self, String> {
        if start_sample.len() != times_s.len() {
            return Err(format!(
                "start_sample has {} elements and time_s has {}; they must have the same number",
                start_sample.len(),
                times_s.len()
            ));
        }
        let mut starts = Vec::with_capacity(start_sample.len());
        for (at, &start) in start_sample.iter().enumerate() {
            let sample =
                u64::try_from(start).ok().filter(|&sample| sample < length).ok_or_else(|| {
                    format!("start_sample[{at}] = {start} is outside the {length} samples")
                })?;
            match starts.last() {
                None if sample != 0 => {
                    return Err(format!(
                        "start_sample[0] = {sample}; the first segment must start at sample 0"
                    ));
                }
                Some(&last) if sample <= last => {
                    return Err(format!(
                        "start_sample[{at}] = {sample} does not exceed {last} before it; segments must follow one another"
                    ));
                }
                _ => starts.push(sample),
            }
        }
        if starts.is_empty() {
            return Err(
                "no segment listed; leave /segments out for one contiguous recording".into()
            );
        }
        check_times(&times_s)?;
        Ok(Self { starts, times_s, reference_rate })
    }

    /// As [`Segments::new`] for a recording, whose rows come before their samples: at the end of
    /// the lists one may lack its other half, and the last may have no samples yet. The text, if
    /// any, says what was so.
    pub(super) fn of_recording(
        start_sample: &[i64],
        mut times_s: Vec<f64>,
        reference_rate: Hz,
        length: u64,
    ) -> Result<(Self, Option<String>), String> {
        let n_rows = start_sample.len().min(times_s.len());
        let n_lists = start_sample.len().max(times_s.len());
        let start_sample = &start_sample[..n_rows];
        times_s.truncate(n_rows);
        if n_rows == 0 {
            return Ok((Self::one(reference_rate), Some("no segment row yet".to_owned())));
        }
        let is_ahead = |start: &i64| u64::try_from(*start).is_ok_and(|start| start >= length);
        let n_ahead = start_sample.iter().rev().take_while(|start| is_ahead(start)).count();
        let segments = Self::new(start_sample, times_s, reference_rate, u64::MAX)?;
        let note = match (n_lists - n_rows, n_ahead) {
            (0, 0) => None,
            (0, n) => Some(format!("segment rows at the end without samples: {n}")),
            (n, _) => Some(format!("segment rows at the end without their other half: {n}")),
        };
        Ok((segments, note))
    }

    /// What is said of segments that begin before the one before them ends; `None`: none does.
    pub(super) fn overlap(&self) -> Option<String> {
        let ends = self.starts.windows(2).zip(self.times_s.windows(2)).map(|(starts, times)| {
            let duration_s = (starts[1] - starts[0]) as f64 / self.reference_rate.0;
            let slack_s = OVERLAP_SLACK * duration_s + 2.0 / self.reference_rate.0;
            let is_overlap = times[0] + duration_s > times[1] + slack_s;
            (is_overlap, times[0] + duration_s)
        });
        let mut over = ends.enumerate().filter(|(_, (is_overlap, _))| *is_overlap);
        let (at, (_, end_s)) = over.next()?;
        let more = match over.count() {
            0 => String::new(),
            n => format!(" (so do {n} more)"),
        };
        Some(format!(
            "/segments: segment {at} lasts to {end_s} s, the next begins at {} s: they overlap in time{more}; each is judged for \
             itself, what is told of times is not right",
            self.times_s[at + 1]
        ))
    }

    pub(super) fn len(&self) -> usize {
        self.starts.len()
    }

    /// (first sample, stream time in s) of each.
    pub(super) fn listed(&self) -> impl Iterator<Item = (u64, f64)> + '_ {
        self.starts.iter().copied().zip(self.times_s.iter().copied())
    }

    pub(super) fn first_time_s(&self) -> f64 {
        self.times_s.first().copied().unwrap_or(0.0)
    }

    pub(super) fn last_time_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(0.0)
    }

    /// The segment numbered `segment` for a channel of this rate; `None` past the last.
    pub(super) fn span(&self, segment: u32, rate: Hz) -> Option<Span> {
        let at = usize::try_from(segment).ok()?;
        let start = Self::scaled(*self.starts.get(at)?, rate, self.reference_rate);
        let end = self
            .starts
            .get(at + 1)
            .map_or(u64::MAX, |&next| Self::scaled(next, rate, self.reference_rate));
        Some(Span { segment, start, end, time_s: self.times_s[at] })
    }

    /// First sample, at `rate`, that is not before sample `start` of the channel of
    /// `reference_rate`, the fastest.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "non-negative; float to int casts saturate"
    )]
    pub(super) fn scaled(start: u64, rate: Hz, reference_rate: Hz) -> u64 {
        if rate >= reference_rate {
            return start;
        }
        let exact = start as f64 * (rate.0 / reference_rate.0);
        (exact - WHOLE_SAMPLE).ceil().max(0.0) as u64
    }
}

fn check_times(times_s: &[f64]) -> Result<(), String> {
    if let Some(at) = times_s.iter().position(|time| !time.is_finite()) {
        return Err(format!("time_s[{at}] = {}; times must be finite", times_s[at]));
    }
    match times_s.windows(2).position(|pair| pair[1] < pair[0]) {
        Some(at) => Err(format!(
            "time_s[{}] = {} lies before {}; times must not decrease",
            at + 1,
            times_s[at + 1],
            times_s[at]
        )),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slower_channels_take_the_first_sample_not_before_the_start() {
        let segments =
            Segments::new(&[0, 2560, 5125], vec![0.0, 10.0, 20.0], Hz(25_600.0), 7000).unwrap();
        let fast = segments.span(1, Hz(25_600.0)).unwrap();
        assert_eq!((fast.start, fast.end), (2560, 5125));
        // 2560 samples at 25.6 kHz are 256 at 2.56 kHz; 5125 are 512.5, so 513 is the first after.
        let slow = segments.span(1, Hz(2_560.0)).unwrap();
        assert_eq!((slow.start, slow.end), (256, 513));
        assert_eq!(segments.span(2, Hz(2_560.0)).unwrap().end, u64::MAX);
        assert_eq!(segments.span(3, Hz(2_560.0)), None);
    }

    #[test]
    fn segments_that_overlap_in_time_are_told() {
        let overlap = |times: &[f64]| {
            Segments::new(&[0, 2000, 4000], times.to_vec(), Hz(1000.0), 6000).unwrap().overlap()
        };
        for fine in [[0.0, 2.0, 4.0], [0.0, 1.9995, 9.0]] {
            assert_eq!(overlap(&fine), None, "{fine:?}");
        }
        let told = overlap(&[0.0, 1.0, 3.0]).unwrap();
        assert!(
            told.contains("segment 0 lasts to 2 s, the next begins at 1 s: they overlap"),
            "{told}"
        );
        assert!(overlap(&[0.0, 1.0, 2.0]).unwrap().contains("(so do 1 more)"));
    }

    #[test]
    fn rows_at_the_end_of_a_recording_may_lack_what_comes_after_them() {
        let read = |starts: &[i64], times: &[f64]| {
            Segments::of_recording(starts, times.to_vec(), Hz(10.0), 100)
        };
        assert_eq!(read(&[0, 50], &[0.0, 9.0]).unwrap().1, None);
        let (ahead, note) = read(&[0, 100], &[0.0, 20.0]).unwrap();
        assert_eq!(ahead.len(), 2, "slower channels may be there already");
        assert!(note.unwrap().contains("without samples: 1"));
        let (half, note) = read(&[0, 50], &[0.0]).unwrap();
        assert_eq!(half.len(), 1);
        assert!(note.unwrap().contains("other half: 1"));
        assert_eq!(read(&[], &[]).unwrap().0, Segments::one(Hz(10.0)));
        assert!(read(&[0, 7, 7], &[0.0, 1.0, 2.0]).is_err(), "disorder stays one");
    }

    #[test]
    fn every_disorder_is_named() {
        let check = |starts: &[i64], times: &[f64]| {
            Segments::new(starts, times.to_vec(), Hz(10.0), 100).unwrap_err()
        };
        assert!(check(&[0], &[0.0, 1.0]).contains("same number"));
        assert!(check(&[5], &[0.0]).contains("must start at sample 0"));
        assert!(check(&[0, 100], &[0.0, 1.0]).contains("outside the 100 samples"));
        assert!(check(&[0, -1], &[0.0, 1.0]).contains("start_sample[1] = -1"));
        assert!(check(&[0, 7, 7], &[0.0, 1.0, 2.0]).contains("start_sample[2]"));
        assert!(check(&[0, 7], &[1.0, 0.5]).contains("must not decrease"));
        assert!(check(&[0, 7], &[0.0, f64::NAN]).contains("finite"));
        assert!(check(&[], &[]).contains("no segment"));
    }
}
