//! The tiers, their blocks and their files: which minute, hour or day lies in which file.

use crate::signal::Timestamp;
use jiff::civil::Date;
use jiff::civil::date;

/// How finely a trend is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// Every window.
    Windows,
    /// Smallest, mean and largest value of each minute.
    Minutes,
    /// Smallest, mean and largest value of each hour.
    Hours,
}

impl Tier {
    /// All, finest first.
    pub const ALL: [Self; 3] = [Self::Windows, Self::Minutes, Self::Hours];

    /// Name in documents and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Windows => "raw",
            Self::Minutes => "1min",
            Self::Hours => "1h",
        }
    }

    /// Reads a name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|tier| tier.name() == name)
    }

    /// Time from one point to the next, s; `None`: that of the windows.
    #[must_use]
    pub fn step_s(self) -> Option<i64> {
        match self {
            Self::Windows => None,
            Self::Minutes => Some(60),
            Self::Hours => Some(3600),
        }
    }

    /// Length of a block, s: what one row of the database holds.
    pub(super) fn block_s(self) -> i64 {
        match self {
            Self::Windows => 60,
            Self::Minutes => 3600,
            Self::Hours => 86_400,
        }
    }

    /// Points of a block; none of windows, whose times are their own.
    pub(super) fn places(self) -> usize {
        match self {
            Self::Windows => 0,
            Self::Minutes => 60,
            Self::Hours => 24,
        }
    }

    /// The next finer tier.
    pub(super) fn finer(self) -> Option<Self> {
        match self {
            Self::Windows => None,
            Self::Minutes => Some(Self::Windows),
            Self::Hours => Some(Self::Minutes),
        }
    }

    /// The next coarser tier.
    pub(super) fn coarser(self) -> Option<Self> {
        match self {
            Self::Windows => Some(Self::Minutes),
            Self::Minutes => Some(Self::Hours),
            Self::Hours => None,
        }
    }

    /// The block of a time.
    pub(super) fn block_at(self, at: Timestamp) -> i64 {
        at.0.div_euclid(1_000_000_000).div_euclid(self.block_s())
    }

    /// The block of the coarser tier that holds a block of this one.
    pub(super) fn block_above(self, block: i64) -> i64 {
        self.coarser().map_or(block, |coarser| {
            block.saturating_mul(self.block_s()).div_euclid(coarser.block_s())
        })
    }

    /// The blocks of the finer tier that a block of this one is made of.
    pub(super) fn blocks_below(self, block: i64) -> std::ops::Range<i64> {
        let finer_s = self.finer().map_or(self.block_s(), Self::block_s);
        let n = self.block_s() / finer_s;
        block * n..(block + 1) * n
    }
}

/// What one file holds: a day of windows, a month of minutes or a year of hours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Period {
    pub(super) tier: Tier,
    first: Date,
}

impl Period {
    /// The period of a block.
    pub(super) fn of(tier: Tier, block: i64) -> Self {
        let day = block.saturating_mul(tier.block_s()).div_euclid(86_400);
        let day = civil(day);
        let first = match tier {
            Tier::Windows => day,
            Tier::Minutes => day.first_of_month(),
            Tier::Hours => day.first_of_year(),
        };
        Self { tier, first }
    }

    /// Its blocks.
    pub(super) fn blocks(self) -> std::ops::Range<i64> {
        let days = days_of(self.first)..days_of(self.next());
        let at = |day: i64| day * 86_400 / self.tier.block_s();
        at(days.start)..at(days.end)
    }

    /// Its end, UTC.
    pub(super) fn end(self) -> Timestamp {
        Timestamp(days_of(self.next()).saturating_mul(86_400_000_000_000))
    }

    fn next(self) -> Date {
        let (year, month) = (self.first.year(), self.first.month());
        match self.tier {
            Tier::Windows => self.first.tomorrow().unwrap_or(Date::MAX),
            Tier::Minutes if month < 12 => date(year, month + 1, 1),
            Tier::Minutes | Tier::Hours => date(year.saturating_add(1).min(9999), 1, 1),
        }
    }

    /// Name of its file.
    pub(super) fn name(self) -> String {
        let (year, month, day) = (self.first.year(), self.first.month(), self.first.day());
        match self.tier {
            Tier::Windows => format!("{year:04}-{month:02}-{day:02}.db"),
            Tier::Minutes => format!("{year:04}-{month:02}.db"),
            Tier::Hours => format!("{year:04}.db"),
        }
    }

    /// Reads the name of a file.
    pub(super) fn parse(name: &str) -> Option<Self> {
        let stem = name.strip_suffix(".db")?;
        let parts: Vec<i16> =
            stem.split('-').map(|part| part.parse().ok()).collect::<Option<_>>()?;
        let (tier, year, month, day) = match *parts {
            [year] => (Tier::Hours, year, 1, 1),
            [year, month] => (Tier::Minutes, year, month, 1),
            [year, month, day] => (Tier::Windows, year, month, day),
            _ => return None,
        };
        let first = Date::new(year, i8::try_from(month).ok()?, i8::try_from(day).ok()?).ok()?;
        let period = Self { tier, first };
        (period.name() == name).then_some(period)
    }
}

/// The date of a day counted from 1970-01-01; times reach from 1677 to 2262.
fn civil(day: i64) -> Date {
    let days = jiff::Span::new().try_days(day).unwrap_or_default();
    date(1970, 1, 1).checked_add(days).unwrap_or(Date::MAX)
}

fn days_of(day: Date) -> i64 {
    let since = day.since((jiff::Unit::Day, date(1970, 1, 1)));
    since.map_or(0, |span| i64::from(span.get_days()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_blocks_of_periods_agree() {
        for (name, tier, n) in [
            ("2026-11-22.db", Tier::Windows, 1440),
            ("1970-01-01.db", Tier::Windows, 1440),
            ("1969-12-31.db", Tier::Windows, 1440),
            ("2026-02.db", Tier::Minutes, 28 * 24),
            ("2026-12.db", Tier::Minutes, 31 * 24),
            ("2024.db", Tier::Hours, 366),
        ] {
            let period = Period::parse(name).unwrap();
            assert_eq!((period.name().as_str(), period.tier), (name, tier));
            let blocks = period.blocks();
            assert_eq!(blocks.end - blocks.start, n, "{name}");
            assert_eq!(Period::of(tier, blocks.start), period);
            assert_eq!(Period::of(tier, blocks.end - 1), period);
            assert_ne!(Period::of(tier, blocks.end), period);
            assert_ne!(Period::of(tier, blocks.start - 1), period);
            assert_eq!(period.end().0, blocks.end * tier.block_s() * 1_000_000_000);
        }
        for name in ["2026-13.db", "2026-11-22.db-wal", "x.db", "26.db", "2026-1-2.db", "state.db"]
        {
            assert_eq!(Period::parse(name), None, "{name}");
        }
    }

    #[test]
    fn blocks_lie_in_those_of_the_coarser_tier() {
        let at = Timestamp(1_795_000_123_000_000_000);
        for tier in [Tier::Windows, Tier::Minutes] {
            let coarser = tier.coarser().unwrap();
            let above = tier.block_above(tier.block_at(at));
            assert_eq!(above, coarser.block_at(at));
            assert!(coarser.blocks_below(above).contains(&tier.block_at(at)));
        }
        assert_eq!(Tier::Windows.block_at(Timestamp(-1)), -1);
        assert_eq!(Tier::Windows.block_above(-1), -1);
    }
}
