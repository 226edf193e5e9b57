//! Filters of HDF5 chunks: their names, and which of them can be read.

use super::hdf5::format::messages::filter;

/// A filter of a data set's chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ChunkFilter {
    number: u16,
    /// What the library does not do with this filter, or does wrong.
    missing: Option<&'static str>,
}

impl ChunkFilter {
    pub(super) fn new(filter: &filter::Filter) -> Self {
        /// Place of the compression inside among the parameters of bitshuffle, and zstd's number.
        const BITSHUFFLE_ZSTD: (usize, u32) = (4, 3);
        /// Place of the byte order among the parameters of scaleoffset, and big endian's number.
        const SCALEOFFSET_BIG: (usize, u32) = (6, 1);
        let has = |(at, value): (usize, u32)| filter.cd_values.get(at) == Some(&value);
        let missing = match filter.id {
            filter::FILTER_BSHUF if has(BITSHUFFLE_ZSTD) => Some("with zstd inside"),
            // Chunks that need all bits come out in the other byte order.
            filter::FILTER_SCALEOFFSET if has(SCALEOFFSET_BIG) => Some("of big-endian numbers"),
            _ => None,
        };
        Self { number: filter.id, missing }
    }
}

/// Names of the filters that can be read.
const FILTERS: &[(u16, &str)] = &[
    (filter::FILTER_DEFLATE, "gzip"),
    (filter::FILTER_SHUFFLE, "shuffle"),
    (filter::FILTER_FLETCHER32, "fletcher32"),
    (filter::FILTER_SZIP, "szip"),
    (filter::FILTER_NBIT, "nbit"),
    (filter::FILTER_SCALEOFFSET, "scaleoffset"),
    (filter::FILTER_BZIP2, "bzip2"),
    (filter::FILTER_LZF, "lzf"),
    (filter::FILTER_BLOSC, "blosc"),
    (filter::FILTER_LZ4, "lz4"),
    (filter::FILTER_BSHUF, "bitshuffle"),
    (filter::FILTER_ZSTD, "zstd"),
];

/// Names of filters met in the field that cannot be read.
const UNREADABLE_FILTERS: &[(u16, &str)] = &[
    (filter::FILTER_ZFP, "zfp"),
    (filter::FILTER_JPEG, "jpeg"),
    (filter::FILTER_BITGROOM, "bitgroom"),
    (filter::FILTER_BITROUND, "bitround"),
    (filter::FILTER_BLOSC2, "blosc2"),
    (32017, "sz"),
    (32018, "fcidecomp"),
    (32024, "sz3"),
    (32028, "sperr"),
    (32033, "htj2k"),
];

/// Gives a filter's name if it can be read, else its description as the error.
pub(super) fn filter_name(filter: ChunkFilter) -> Result<&'static str, String> {
    let id = filter.number;
    let find = |list: &'static [(u16, &'static str)]| {
        list.iter().find(|(known, _)| *known == id).map(|(_, name)| *name)
    };
    match (find(FILTERS), filter.missing) {
        (Some(name), None) => Ok(name),
        (Some(name), Some(missing)) => Err(format!("filter {name} {missing}")),
        (None, _) => Err(match find(UNREADABLE_FILTERS) {
            Some(name) => format!("filter {name} (number {id})"),
            None => format!("filter number {id}"),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_are_named() {
        let name = |id, cd_values| {
            filter_name(ChunkFilter::new(&filter::Filter { id, flags: 0, cd_values }))
        };
        assert_eq!(name(1, vec![4]), Ok("gzip"));
        assert_eq!(name(32013, vec![]), Err("filter zfp (number 32013)".into()));
        assert_eq!(name(999, vec![]), Err("filter number 999".into()));
        assert_eq!(name(32008, vec![0, 4, 8, 0, 2]), Ok("bitshuffle"));
        let zstd = name(32008, vec![0, 4, 8, 0, 3, 3]);
        assert_eq!(zstd, Err("filter bitshuffle with zstd inside".into()));
        assert_eq!(name(6, vec![2, 0, 4096, 0, 2, 1, 0]), Ok("scaleoffset"));
        let big = name(6, vec![2, 0, 4096, 0, 2, 1, 1]);
        assert_eq!(big, Err("filter scaleoffset of big-endian numbers".into()));
    }
}
