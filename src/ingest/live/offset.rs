//! How far the clock of a sender is off, by the times that it states.
//!
//! Samples arrive after they were taken, some later than others: of each stretch the least delay counts. A sender that catches up on
//! what it had kept is no clock that runs late: its delay falls.

/// Length of a stretch by the daemon's clock, s: longer than a slow network, or a sender that collects for a while, holds all of its
/// blocks back.
const STRETCH_S: f64 = 30.0;

/// A delay that falls by this part of the time is one of a sender that catches up.
const CATCHES_UP: f64 = 0.1;

/// A clock is told to be behind from here on, s: as far as times may be ahead before they are refused, and more than networks and
/// buffers delay. Alarms, trends and pairs of two senders are placed by these times.
const BEHIND_S: f64 = 10.0;

/// A clock is told to be ahead from here on, s: no sample arrives before it was taken, and clocks that are set over a network agree to a
/// tenth of it.
const AHEAD_S: f64 = 1.0;

/// Watches one sender's times of a channel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Offset {
    open: Option<Stretch>,
    /// The least delay of the stretch before, and of the one before that, s.
    last_s: Option<f64>,
    before_s: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Stretch {
    begun_s: f64,
    least_s: f64,
}

impl Offset {
    /// Notes that a block came at `now_s` whose end was `late_s` before.
    pub fn observe(&mut self, now_s: f64, late_s: f64) {
        let fresh = Stretch { begun_s: now_s, least_s: late_s };
        let Some(open) = self.open else {
            self.open = Some(fresh);
            return;
        };
        let length_s = now_s - open.begun_s;
        if (0.0..STRETCH_S).contains(&length_s) {
            self.open = Some(Stretch { least_s: open.least_s.min(late_s), ..open });
            return;
        }
        // After a break, or where the daemon's clock was set, nothing is known.
        let goes_on = (STRETCH_S..2.0 * STRETCH_S).contains(&length_s);
        (self.before_s, self.last_s) =
            if goes_on { (self.last_s, Some(open.least_s)) } else { (None, None) };
        self.open = Some(fresh);
    }

    /// How far the sender's clock is behind that of the daemon, delays of the way included, s; below 0: ahead. `None`: not
    /// known, or it catches up.
    #[must_use]
    pub fn estimate_s(&self) -> Option<f64> {
        let (last_s, before_s) = (self.last_s?, self.before_s?);
        let catches_up = last_s > 0.0 && last_s < before_s - CATCHES_UP * STRETCH_S;
        (!catches_up).then_some(last_s)
    }

    /// What is wrong with the sender's clock, for people; `None`: nothing that is known.
    #[must_use]
    pub fn doubt(&self) -> Option<String> {
        let by_s = self.estimate_s()?;
        if by_s > BEHIND_S {
            return Some(format!(
                "its newest samples come {by_s:.0} s after they were taken by the sender's clock: that is behind the daemon's, or the \
                 sender is late by as much; alarms, trends and what is laid beside other senders' samples stand at those times"
            ));
        }
        (by_s < -AHEAD_S).then(|| {
            let by_s = -by_s;
            format!(
                "its samples come {by_s:.1} s before they were taken by the sender's clock: that is ahead of the daemon's, and from 10 s \
                 on it is refused; set it"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is known after blocks of a second, each late by what `late_s` says of its time.
    fn after(seconds: u32, late_s: impl Fn(f64) -> f64) -> Offset {
        let mut offset = Offset::default();
        for second in 0..seconds {
            let now_s = f64::from(second);
            offset.observe(now_s, late_s(now_s));
        }
        offset
    }

    #[test]
    fn a_clock_that_is_far_off_is_told_after_a_minute() {
        // A network that delays every third block only by a little.
        let late = |by_s: f64| move |now_s: f64| if now_s % 3.0 == 0.0 { by_s } else { by_s + 4.0 };
        assert_eq!(after(60, late(100.0)).doubt(), None, "too early");
        let told = after(62, late(100.0)).doubt().unwrap();
        assert!(told.contains("come 100 s after"), "{told}");
        assert_eq!(after(200, late(9.0)).doubt(), None, "networks and buffers delay");
        assert_eq!(after(200, late(-0.5)).doubt(), None);
        let told = after(200, late(-3.0)).doubt().unwrap();
        assert!(told.contains("3.0 s before"), "{told}");
    }

    #[test]
    fn a_sender_that_catches_up_has_no_wrong_clock_and_one_that_is_set_is_told_no_more() {
        // An hour that it had kept, sent at twice the pace at which it comes.
        assert_eq!(after(600, |now_s| 3600.0 - now_s).doubt(), None);
        let is_set = |now_s: f64| if now_s < 120.0 { 50.0 } else { 0.1 };
        assert!(after(119, is_set).doubt().is_some());
        let offset = after(200, is_set);
        assert_eq!((offset.doubt(), offset.estimate_s()), (None, Some(0.1)));
    }

    #[test]
    fn after_a_break_nothing_is_known() {
        let mut offset = after(100, |_| 50.0);
        offset.observe(1000.0, 50.0);
        assert_eq!((offset.estimate_s(), offset.doubt()), (None, None));
    }
}
