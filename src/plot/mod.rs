//! Numbers as pictures: SVG texts without scripts.
//!
//! [`chart`] draws lines and cursors over linear axes or a logarithmic one, [`map`] a field of values, both in classes
//! that the page they stand in colours, light or dark; [`log_log`] a picture that stands alone; [`decimate`] thins
//! long columns so that no extreme is lost. Must not know what is drawn.

pub mod chart;
pub mod decimate;
pub mod log_log;
pub mod map;

/// Words of a plot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Words<'a> {
    /// Above it.
    pub title: &'a str,
    /// Of the two axes, with units.
    pub x: &'a str,
    /// See `x`.
    pub y: &'a str,
}

/// Text that can stand inside SVG and HTML, in attributes too.
#[must_use]
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // Documents may not hold them, whatever the escape.
            c if c.is_control() && c != '\n' && c != '\t' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// Round numbers inside `low`…`high`, about `n` of them; none if there is no such range.
#[must_use]
pub(crate) fn ticks(low: f64, high: f64, n: f64) -> Vec<f64> {
    let raw = (high - low) / n;
    if !(raw.is_finite() && raw > 0.0) {
        return Vec::new();
    }
    let power = 10_f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw * 0.999);
    let step = step.unwrap_or(10.0 * power);
    let first = (low / step).ceil();
    (0..100)
        .map(|i| (first + f64::from(i)) * step)
        .take_while(|tick| *tick <= high + 1e-9 * step)
        .map(|tick| if tick.abs() < 1e-9 * step { 0.0 } else { tick })
        .collect()
}

/// A tick's number, as short as it can be told from its neighbours.
#[must_use]
pub(crate) fn tick_text(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if !(1e-3..1e6).contains(&size) {
        format!("{value:e}").replace("0000000", "")
    } else {
        let text = format!("{value:.6}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 10.0, 5.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks(-1.0, 1.0, 4.0), [-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert!(ticks(1.0, 1.0, 5.0).is_empty() && ticks(0.0, f64::NAN, 5.0).is_empty());
        assert_eq!([0.0, 0.5, 1500.0, 2e-5].map(tick_text), ["0", "0.5", "1500", "2e-5"]);
    }

    #[test]
    fn what_is_escaped_cannot_end_a_text_or_an_attribute() {
        assert_eq!(
            escaped("<a b=\"1\" c='2'>&\u{1b}"),
            "&lt;a b=&quot;1&quot; c=&#39;2&#39;&gt;&amp;\u{fffd}"
        );
    }
}
