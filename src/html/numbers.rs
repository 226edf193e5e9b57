//! Numbers for people: as many figures as mean something.

/// Three significant figures, without an exponent from 0.001 to 9,999,999.
#[must_use]
pub fn significant(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        return "-".to_owned();
    }
    if size < 1e-12 {
        return "0".to_owned();
    }
    if !(1e-3..1e7).contains(&size) {
        return format!("{value:.2e}");
    }
    let decimals = match size {
        s if s < 0.00995 => 5,
        s if s < 0.0995 => 4,
        s if s < 0.995 => 3,
        s if s < 9.95 => 2,
        s if s < 99.5 => 1,
        _ => 0,
    };
    format!("{value:.decimals$}")
}

/// A duration or time in seconds, to the millisecond at most, without trailing zeros.
#[must_use]
pub fn seconds(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A probability: small ones by their power of ten.
#[must_use]
pub fn probability(value: f64) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    match value {
        p if p <= 0.0 => "0".to_owned(),
        p if p < 1e-12 => "<1e-12".to_owned(),
        p if p < 1e-3 => format!("{p:.0e}"),
        p => format!("{p:.3}"),
    }
}

/// A whole number in groups of three: `363,000`.
#[must_use]
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_figures_whatever_the_size() {
        for (value, text) in [
            (0.0, "0"),
            (68.03, "68.0"),
            (0.3111, "0.311"),
            (9.996, "10.0"),
            (-1.2345, "-1.23"),
            (0.00123456, "0.00123"),
            (1234.4, "1234"),
            (1.2e-6, "1.20e-6"),
            (f64::INFINITY, "-"),
        ] {
            assert_eq!(significant(value), text);
        }
    }

    #[test]
    fn times_counts_and_probabilities_read_well() {
        assert_eq!([seconds(10.0), seconds(0.25), seconds(100.1239)], ["10", "0.25", "100.124"]);
        assert_eq!(
            [count(7), count(999), count(1000), count(12_345_678)],
            ["7", "999", "1,000", "12,345,678"]
        );
        assert_eq!(
            [probability(1e-158), probability(3e-7), probability(0.25)],
            ["<1e-12", "3e-7", "0.250"]
        );
    }
}
