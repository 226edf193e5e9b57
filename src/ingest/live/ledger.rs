//! What became of every sample of a channel, in counts that only rise.

/// The counts of one channel since the start of the daemon.
///
/// Every sample that came is counted once in `received` and once in what became of it ([`Self::is_conserved`]).
/// Every place in the stream is counted once in `used`, `lost`, `not_finite`, `out_of_range` or `dropped`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ledger {
    /// Samples that came, in frames without an error.
    pub received: u64,
    /// Samples handed on to the analysis.
    pub used: u64,
    /// Samples that came after later ones had come; they are counted in `lost` too.
    pub late: u64,
    /// Samples that had come before.
    pub duplicate: u64,
    /// Samples that are no finite numbers.
    pub not_finite: u64,
    /// Samples beyond the range of the converter, or of any sensor.
    pub out_of_range: u64,
    /// Samples that found no room because their sender sent more than it had credit for.
    pub dropped: u64,
    /// Samples that had not come when later ones did, by their indices.
    pub lost: u64,
    /// Times that samples were lost.
    pub gaps: u64,
    /// Of the samples used, those at the ends of the converter's range.
    pub clipped: u64,
    /// Blocks that came.
    pub blocks: u64,
    /// Blocks that had not come when later ones did, by their sequences.
    pub blocks_lost: u64,
}

impl Ledger {
    /// Samples that came and were not used.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.late + self.duplicate + self.not_finite + self.out_of_range + self.dropped
    }

    /// Whether every sample that came is accounted for.
    #[must_use]
    pub fn is_conserved(&self) -> bool {
        self.received == self.used + self.rejected()
    }

    /// Places in the stream that are accounted for.
    #[must_use]
    pub fn places(&self) -> u64 {
        self.used + self.lost + self.not_finite + self.out_of_range + self.dropped
    }

    /// What became of samples, by name.
    #[must_use]
    pub fn fates(&self) -> [(&'static str, u64); 9] {
        [
            ("received", self.received),
            ("used", self.used),
            ("late", self.late),
            ("duplicate", self.duplicate),
            ("not_finite", self.not_finite),
            ("out_of_range", self.out_of_range),
            ("dropped", self.dropped),
            ("lost", self.lost),
            ("clipped", self.clipped),
        ]
    }
}
