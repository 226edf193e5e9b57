//! Lines that a spectrum of given resolution cannot tell apart.

use super::FrequencyTable;
use crate::units::Hz;

/// Two lines closer than the resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coincidence {
    /// Place of the lower line in [`FrequencyTable::lines`].
    pub a: usize,
    /// Place of the higher line.
    pub b: usize,
    /// Distance, ≥ 0.
    pub apart: Hz,
}

/// Most coincidences listed: a large machine at a coarse resolution has millions of pairs.
pub const MAX_COINCIDENCES: usize = 10_000;

impl FrequencyTable {
    /// Pairs of lines of different owner or kind that stand closer than `resolution` (K14), by
    /// ascending frequency; the first [`MAX_COINCIDENCES`] of them.
    ///
    /// Identical bearings on one shaft coincide in every line: which of them a line speaks of is
    /// then for the place of the sensors to say.
    #[must_use]
    pub fn coincidences(&self, resolution: Hz) -> Vec<Coincidence> {
        let mut by_frequency: Vec<usize> = (0..self.lines.len()).collect();
        by_frequency.sort_by(|&a, &b| {
            self.lines[a].frequency.0.total_cmp(&self.lines[b].frequency.0).then(a.cmp(&b))
        });
        let mut found = Vec::new();
        for (rank, &a) in by_frequency.iter().enumerate() {
            for &b in &by_frequency[rank + 1..] {
                let (low, high) = (&self.lines[a], &self.lines[b]);
                let apart = high.frequency.0 - low.frequency.0;
                let close = apart < resolution.0;
                if !close || found.len() == MAX_COINCIDENCES {
                    break;
                }
                if low.owner != high.owner || low.kind != high.kind {
                    found.push(Coincidence { a, b, apart: Hz(apart) });
                }
            }
        }
        found
    }
}
