//! Numbers and texts of a payload, little-endian, one after another.

use super::WireError;

/// Reads a payload from its beginning on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor<'a>(pub(super) &'a [u8]);

impl<'a> Cursor<'a> {
    pub(super) fn take(&mut self, n: usize, what: &'static str) -> Result<&'a [u8], WireError> {
        let (taken, rest) = self.0.split_at_checked(n).ok_or(WireError::Cut { what })?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], WireError> {
        let (taken, rest) = self.0.split_first_chunk().ok_or(WireError::Cut { what })?;
        self.0 = rest;
        Ok(*taken)
    }

    pub(super) fn u8(&mut self, what: &'static str) -> Result<u8, WireError> {
        Ok(self.array::<1>(what)?[0])
    }

    pub(super) fn u16(&mut self, what: &'static str) -> Result<u16, WireError> {
        Ok(u16::from_le_bytes(self.array(what)?))
    }

    pub(super) fn u32(&mut self, what: &'static str) -> Result<u32, WireError> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub(super) fn u64(&mut self, what: &'static str) -> Result<u64, WireError> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    pub(super) fn i64(&mut self, what: &'static str) -> Result<i64, WireError> {
        Ok(i64::from_le_bytes(self.array(what)?))
    }

    pub(super) fn f64(&mut self, what: &'static str) -> Result<f64, WireError> {
        Ok(f64::from_le_bytes(self.array(what)?))
    }

    /// A sequence or sample index.
    pub(super) fn index(&mut self, what: &'static str) -> Result<u64, WireError> {
        let found = self.u64(what)?;
        at_most(what, found, super::MAX_INDEX)?;
        Ok(found)
    }

    /// A text behind its length.
    pub(super) fn text(&mut self, what: &'static str, max: usize) -> Result<String, WireError> {
        let n = usize::from(self.u16(what)?);
        at_most(what, n as u64, max as u64)?;
        let bytes = self.take(n, what)?;
        std::str::from_utf8(bytes).map(str::to_owned).map_err(|_| WireError::Text { what })
    }

    /// Nothing may be left.
    pub(super) fn end(self) -> Result<(), WireError> {
        if self.0.is_empty() { Ok(()) } else { Err(WireError::Rest { found: self.0.len() }) }
    }
}

pub(super) fn at_most(what: &'static str, found: u64, limit: u64) -> Result<(), WireError> {
    if found <= limit { Ok(()) } else { Err(WireError::TooLarge { what, found, limit }) }
}

/// Writes a text behind its length.
pub(super) fn put_text(
    out: &mut Vec<u8>,
    what: &'static str,
    text: &str,
    max: usize,
) -> Result<(), WireError> {
    let found = text.len() as u64;
    let too_large = WireError::TooLarge { what, found, limit: max as u64 };
    let n = u16::try_from(text.len()).ok().filter(|n| usize::from(*n) <= max).ok_or(too_large)?;
    out.extend_from_slice(&n.to_le_bytes());
    out.extend_from_slice(text.as_bytes());
    Ok(())
}

/// Writes how many there are.
pub(super) fn put_count(
    out: &mut Vec<u8>,
    what: &'static str,
    found: usize,
    limit: usize,
) -> Result<(), WireError> {
    let too_large = WireError::TooLarge { what, found: found as u64, limit: limit as u64 };
    let n = u16::try_from(found).ok().filter(|n| usize::from(*n) <= limit).ok_or(too_large)?;
    out.extend_from_slice(&n.to_le_bytes());
    Ok(())
}
