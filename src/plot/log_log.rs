//! A plot of points on two logarithmic axes, as SVG.

use super::Words;
use super::escaped;
use std::fmt::Write;

/// Size of the picture and its margins: left, top, right, bottom; pixels.
const SIZE: (f64, f64) = (760.0, 480.0);
const MARGINS: (f64, f64, f64, f64) = (70.0, 40.0, 220.0, 50.0);

/// Colours that people with impaired colour vision can tell apart (Okabe & Ito).
const COLOURS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#000000"];

/// Points that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name.
    pub name: String,
    /// x and y, both above 0; others are left out.
    pub points: Vec<(f64, f64)>,
}

/// Whole decades, the first and the last exponent.
type Decades = (i32, i32);

/// The plot; `None` without any point.
#[must_use]
pub fn log_log(words: &Words<'_>, series: &[Series]) -> Option<String> {
    let is_shown = |(x, y): &&(f64, f64)| *x > 0.0 && *y > 0.0 && x.is_finite() && y.is_finite();
    let shown: Vec<Vec<(f64, f64)>> =
        series.iter().map(|s| s.points.iter().filter(is_shown).copied().collect()).collect();
    let across = decades(shown.iter().flatten().map(|(x, _)| *x))?;
    let up = decades(shown.iter().flatten().map(|(_, y)| *y))?;
    let (left, top, right, bottom) = MARGINS;
    let part =
        |value: f64, (low, high): Decades| (value.log10() - f64::from(low)) / f64::from(high - low);
    let at_x = |x: f64| left + part(x, across) * (SIZE.0 - left - right);
    let at_y = |y: f64| SIZE.1 - bottom - part(y, up) * (SIZE.1 - top - bottom);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        SIZE.0, SIZE.1
    );
    let mut push = |line: String| {
        // Into a string nothing fails.
        let _never = writeln!(svg, "{line}");
    };
    let (x_end, y_end) = (SIZE.0 - right, SIZE.1 - bottom);
    for e in across.0..=across.1 {
        let x = at_x(10_f64.powi(e));
        push(rule((x, top), (x, y_end)));
        push(label((x, y_end + 18.0), "middle", &power(e)));
    }
    for e in up.0..=up.1 {
        let y = at_y(10_f64.powi(e));
        push(rule((left, y), (x_end, y)));
        push(label((left - 6.0, y + 4.0), "end", &power(e)));
    }
    push(label((left, 22.0), "start", &escaped(words.title)));
    push(label((0.5 * (left + x_end), SIZE.1 - 12.0), "middle", &escaped(words.x)));
    let (x, y) = (18.0, 0.5 * (top + y_end));
    push(format!(
        "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        escaped(words.y)
    ));
    for (i, (series, points)) in series.iter().zip(&shown).enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let places: Vec<String> =
            points.iter().map(|(x, y)| format!("{:.1},{:.1}", at_x(*x), at_y(*y))).collect();
        push(format!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
            places.join(" ")
        ));
        for (x, y) in points {
            push(dot((at_x(*x), at_y(*y)), colour));
        }
        let y = top + 10.0 + 18.0 * i as f64;
        push(dot((x_end + 16.0, y - 4.0), colour));
        push(label((x_end + 26.0, y), "start", &escaped(&series.name)));
    }
    Some(svg + "</svg>\n")
}

fn decades(values: impl Iterator<Item = f64>) -> Option<Decades> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values {
        (low, high) = (low.min(value.log10()), high.max(value.log10()));
    }
    #[expect(clippy::cast_possible_truncation, reason = "exponents of finite numbers")]
    let (first, last) = (low.floor() as i32, high.ceil() as i32);
    (low <= high).then(|| (first, last.max(first + 1)))
}

fn power(exponent: i32) -> String {
    format!("1e{exponent}")
}

fn rule((x1, y1): (f64, f64), (x2, y2): (f64, f64)) -> String {
    format!("<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"#ddd\"/>")
}

fn dot((x, y): (f64, f64), colour: &str) -> String {
    format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{colour}\"/>")
}

fn label((x, y): (f64, f64), anchor: &str, text: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_stand_where_their_logarithms_are() {
        let words = Words { title: "a < b", x: "x, s", y: "y" };
        let series = |points: &[(f64, f64)]| [Series { name: "s".into(), points: points.to_vec() }];
        let svg = log_log(&words, &series(&[(1.0, 1e-4), (100.0, 1e-2), (10.0, 1e-3)])).unwrap();
        // The corners of the field (70 to 540, 430 to 40), and its middle.
        for place in
            ["cx=\"70.0\" cy=\"430.0\"", "cx=\"540.0\" cy=\"40.0\"", "cx=\"305.0\" cy=\"235.0\""]
        {
            assert!(svg.contains(place), "{place} not in {svg}");
        }
        assert!(svg.contains("a &lt; b") && svg.ends_with("</svg>\n"));
        assert_eq!(log_log(&words, &series(&[(0.0, 1.0), (1.0, f64::NAN)])), None);
    }
}
