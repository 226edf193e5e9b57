//! Lengths of transforms that are quick.
//!
//! Must not know what is transformed.

/// Smallest length ≥ `n` (and ≥ 1) of the form 2^a·3^b or 2^a·5^c, c ≤ 2, with a large power of two.
///
/// Higher powers of 5, 3 and 5 together, and few factors of 2 cost a mixed-radix transform up to twice
/// its time (50,000 = 2⁴·5⁵ against 51,200 = 2¹¹·5²).
pub(in crate::dsp) fn quick_len_at_least(n: usize) -> usize {
    (n.max(1)..).find(|length| is_quick(*length)).unwrap_or(n)
}

fn is_quick(length: usize) -> bool {
    let twos = length.trailing_zeros();
    let mut rest = length >> twos;
    if twos < 5.min(length.ilog2() / 2) {
        return false;
    }
    while rest.is_multiple_of(3) {
        rest /= 3;
    }
    matches!(rest, 1) || matches!(length >> twos, 5 | 25)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_the_next_of_their_form() {
        let found = [0, 1, 5, 17, 391, 2084, 12_500, 50_000].map(quick_len_at_least);
        assert_eq!(found, [1, 1, 6, 20, 400, 2304, 12_800, 51_200]);
        // Never far away: at most a fifth longer.
        assert!((200..20_000).all(|n| quick_len_at_least(n) <= n + n / 5));
    }
}
