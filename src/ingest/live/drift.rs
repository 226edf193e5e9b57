//! How a sample clock runs against the wall clock.
//!
//! Of each stretch of stream time the earliest arrival counts, since a network can only delay; over these points the
//! median of all slopes is taken (Theil and Sen), which a step of the clock or some late blocks do not move.

/// Points that are kept; with more, stretches become twice as long.
const MAX_POINTS: usize = 32;

/// Length of the first stretches, s.
const FIRST_STRETCH_S: f64 = 1.0;

/// Fewest points, and shortest time, of an estimate.
const FEWEST_POINTS: usize = 8;

/// See [`FEWEST_POINTS`]; s.
const SHORTEST_S: f64 = 10.0;

/// A rate that is this far off is no drift but a mistake: a hundred times what cheap crystals do.
pub const TOLERANCE_PPM: f64 = 1000.0;

/// What is known of a sample clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// How much more samples a second of the wall clock come than stated, parts in a million.
    pub ppm: f64,
    /// Time over which it was seen, s.
    pub span_s: f64,
}

impl Estimate {
    /// Samples a second by the wall clock, of a nominal rate.
    #[must_use]
    pub fn rate_hz(&self, nominal_hz: f64) -> f64 {
        nominal_hz * (1.0 + 1e-6 * self.ppm)
    }

    /// Whether it is too much for a drift.
    #[must_use]
    pub fn is_wrong_rate(&self) -> bool {
        self.ppm.abs() > TOLERANCE_PPM
    }

    /// What is wrong with a nominal rate, for people; `None`: nothing. Five digits: what is beyond a tenth of a percent.
    #[must_use]
    pub fn doubt(&self, nominal_hz: f64) -> Option<String> {
        let percent = 1e-4 * self.ppm;
        self.is_wrong_rate().then(|| {
            format!(
                "{percent:+.2} % more samples come than the stated {nominal_hz} a second: all frequencies are off by as much, \
                 check the rate that the sender states"
            )
        })
    }
}

/// Watches one sample clock.
#[derive(Debug, Clone, Default)]
pub struct Drift {
    /// Time by the samples, and how far the wall clock is ahead of it, s; the earliest of each stretch.
    points: Vec<(f64, f64)>,
    /// The stretch under way: its begin, and its earliest point.
    open: Option<(f64, (f64, f64))>,
    /// Doublings of the stretch.
    n_doubled: i32,
    /// The estimate of as many observed points as are counted here: it costs half a thousand slopes.
    known: (u64, Option<Estimate>),
    n_complete: u64,
}

impl Drift {
    /// A sample of time `sample_s` by the sample clock was taken at `wall_s` by the wall clock, s, both from the same moment.
    pub fn observe(&mut self, sample_s: f64, wall_s: f64) {
        let point = (sample_s, wall_s - sample_s);
        let stretch_s = FIRST_STRETCH_S * 2.0_f64.powi(self.n_doubled);
        match &mut self.open {
            Some((begin_s, earliest)) if sample_s < *begin_s + stretch_s => {
                if point.1 < earliest.1 {
                    *earliest = point;
                }
            }
            open => {
                let complete = open.replace((sample_s, point));
                self.n_complete += u64::from(complete.is_some());
                self.points.extend(complete.map(|(_, earliest)| earliest));
            }
        }
        if self.points.len() >= MAX_POINTS {
            let earlier = |pair: &[(f64, f64)]| {
                pair.iter().copied().reduce(|a, b| if b.1 < a.1 { b } else { a })
            };
            self.points = self.points.chunks(2).filter_map(earlier).collect();
            self.n_doubled += 1;
        }
    }

    /// What is known; `None`: too little has been seen.
    pub fn estimate(&mut self) -> Option<Estimate> {
        if self.known.0 != self.n_complete {
            self.known = (self.n_complete, self.slope());
        }
        self.known.1
    }

    fn slope(&self) -> Option<Estimate> {
        let (first, last) = (self.points.first()?, self.points.last()?);
        let span_s = last.0 - first.0;
        if self.points.len() < FEWEST_POINTS || span_s < SHORTEST_S {
            return None;
        }
        let mut slopes = Vec::with_capacity(MAX_POINTS * MAX_POINTS / 2);
        for (i, a) in self.points.iter().enumerate() {
            let later = self.points[i + 1..].iter().filter(|b| b.0 > a.0);
            slopes.extend(later.map(|b| (b.1 - a.1) / (b.0 - a.0)));
        }
        slopes.sort_by(f64::total_cmp);
        let slope = *slopes.get(slopes.len() / 2)?;
        // The wall clock takes 1 + slope for a second of samples.
        let ppm = 1e6 * ((1.0 + slope).recip() - 1.0);
        ppm.is_finite().then_some(Estimate { ppm, span_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    /// A clock that gives `ppm` more samples than stated, seen every tenth of a second for `seconds` with delays.
    fn seen(ppm: f64, seconds: u32, mut delay_s: impl FnMut(u32) -> f64) -> Drift {
        let mut drift = Drift::default();
        for i in 0..10 * seconds {
            let wall_s = f64::from(i) / 10.0;
            drift.observe(wall_s * (1.0 + 1e-6 * ppm), wall_s + delay_s(i));
        }
        drift
    }

    #[test]
    fn a_drift_is_found_in_jitter_steps_and_over_days() {
        let mut random = Pcg64::seed_from_u64(1);
        // Delays of a network: mostly a few ms, at times half a second.
        let mut jitter = |_| {
            let usual = 0.01 * random.random::<f64>();
            if random.random::<f64>() < 0.05 { usual + 0.5 } else { usual }
        };
        for ppm in [-200.0, -20.0, 0.0, 50.0, 900.0] {
            let found = seen(ppm, 3600, &mut jitter).estimate().unwrap();
            // The earliest of a minute's 600 delays varies by 20 µs or so: less than 1 ppm over an hour.
            assert!((found.ppm - ppm).abs() < 1.0, "{ppm}: {found:?}");
            assert!(!found.is_wrong_rate());
        }
        // The wall clock is set by three seconds in the last tenth.
        let stepped = seen(50.0, 3600, |i| if i > 32_400 { 3.0 } else { 0.0 }).estimate().unwrap();
        assert!((stepped.ppm - 50.0).abs() < 20.0, "{stepped:?}");
    }

    #[test]
    fn a_wrong_rate_is_told_and_nothing_before_there_is_enough() {
        let wrong = seen(24_000.0, 30, |_| 0.0).estimate().unwrap();
        assert!((wrong.ppm - 24_000.0).abs() < 1.0 && wrong.is_wrong_rate(), "{wrong:?}");
        assert!((wrong.rate_hz(10_000.0) - 10_240.0).abs() < 0.1);
        assert_eq!(seen(24_000.0, 9, |_| 0.0).estimate(), None);
        assert_eq!(Drift::default().estimate(), None);
    }

    #[test]
    fn memory_is_bounded() {
        let mut drift = Drift::default();
        for i in 0..1_000_000 {
            drift.observe(f64::from(i), f64::from(i));
            assert!(drift.points.len() < MAX_POINTS);
        }
        assert!(drift.estimate().unwrap().ppm.abs() < 1e-6);
    }
}
