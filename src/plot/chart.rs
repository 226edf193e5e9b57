//! Lines over two axes, with cursors at places worth a look.

use super::Words;
use super::escaped;
use super::tick_text;
use super::ticks;
use std::fmt::Write;

/// Margins: left, top without labels of cursors, right, bottom; pixels.
const MARGINS: (f64, f64, f64, f64) = (66.0, 28.0, 14.0, 40.0);

/// Rows of cursor labels, their height, and the width of a letter; pixels.
const LABEL_ROWS: usize = 3;
const LABEL_HEIGHT: f64 = 12.0;
const LETTER: f64 = 6.3;

/// Decades shown of a logarithmic axis at most.
const DECADES: i32 = 5;

/// How values of y are laid out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// From the first to the second value.
    Linear(f64, f64),
    /// Whole decades up to this value.
    Logarithmic(f64),
}

/// A place on the x axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Cursor {
    /// Where.
    pub x: f64,
    /// What is there; shown while there is room, always told by the pointer.
    pub label: String,
    /// Class of the line, for its colour.
    pub class: &'static str,
}

/// A picture of lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart<'a> {
    /// Its words.
    pub words: Words<'a>,
    /// Width and height, pixels.
    pub size: (f64, f64),
    /// Ends of the x axis.
    pub x: (f64, f64),
    /// The y axis.
    pub y: Scale,
    /// Class and points of each line, in order.
    pub lines: Vec<(&'static str, Vec<(f64, f64)>)>,
    /// Cursors; those outside the x axis are left out.
    pub cursors: Vec<Cursor>,
}

impl Chart<'_> {
    /// Draws it; `None` if an axis has no length.
    #[must_use]
    pub fn svg(&self) -> Option<String> {
        let label_rows = if self.cursors.is_empty() { 0 } else { LABEL_ROWS };
        let frame = Frame::new(self.size, self.x, self.y, label_rows)?;
        let mut out = String::new();
        frame.open(&mut out, &self.words);
        self.draw_cursors(&mut out, &frame);
        for (class, points) in &self.lines {
            let mut places = String::new();
            for (x, y) in points.iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
                let _never = write!(places, "{:.1},{:.1} ", frame.at_x(*x), frame.at_y(*y));
            }
            let _never =
                writeln!(out, "<polyline class=\"{class}\" points=\"{}\"/>", places.trim_end());
        }
        out.push_str("</svg>\n");
        Some(out)
    }

    /// Lines at the cursors, labels above in rows so that none covers another.
    fn draw_cursors(&self, out: &mut String, frame: &Frame) {
        let mut ends = [f64::NEG_INFINITY; LABEL_ROWS];
        let (top, bottom) = (frame.top, frame.bottom);
        let mut shown: Vec<&Cursor> = self.cursors.iter().collect();
        shown.retain(|cursor| self.x.0 <= cursor.x && cursor.x <= self.x.1);
        shown.sort_by(|a, b| a.x.total_cmp(&b.x));
        for cursor in shown {
            let (x, class, label) = (frame.at_x(cursor.x), cursor.class, escaped(&cursor.label));
            let _never = writeln!(
                out,
                "<line class=\"cursor {class}\" x1=\"{x:.1}\" y1=\"{top:.1}\" x2=\"{x:.1}\" y2=\"{bottom:.1}\">\
                 <title>{label}: {:.2}</title></line>",
                cursor.x
            );
            let width = LETTER * cursor.label.chars().count() as f64;
            // A label near the end of the axis stays on the picture.
            let middle = x.min(frame.size.0 - 0.5 * width);
            let left = middle - 0.5 * width;
            if let Some(row) = ends.iter().position(|end| *end < left) {
                ends[row] = left + width;
                let y = top - 4.0 - LABEL_HEIGHT * row as f64;
                let _never = writeln!(
                    out,
                    "<text class=\"{class}\" x=\"{middle:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{label}</text>"
                );
            }
        }
    }
}

/// Where values lie on the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    size: (f64, f64),
    x: (f64, f64),
    /// Ends as drawn: of a logarithmic axis the exponents.
    y: (f64, f64),
    is_log: bool,
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Frame {
    pub(super) fn new(
        size: (f64, f64),
        x: (f64, f64),
        y: Scale,
        label_rows: usize,
    ) -> Option<Self> {
        let (y, is_log) = match y {
            Scale::Linear(low, high) => ((low, high), false),
            Scale::Logarithmic(high) => {
                let top = high.log10().ceil();
                ((top - f64::from(DECADES), top), true)
            }
        };
        let is_range = |(low, high): (f64, f64)| low.is_finite() && high.is_finite() && low < high;
        let (left, top, right, bottom) = MARGINS;
        let top = top + LABEL_HEIGHT * label_rows as f64;
        (is_range(x) && is_range(y)).then_some(Self {
            size,
            x,
            y,
            is_log,
            left,
            top,
            right: size.0 - right,
            bottom: size.1 - bottom,
        })
    }

    pub(super) fn at_x(&self, x: f64) -> f64 {
        let part = ((x - self.x.0) / (self.x.1 - self.x.0)).clamp(0.0, 1.0);
        self.left + part * (self.right - self.left)
    }

    pub(super) fn at_y(&self, y: f64) -> f64 {
        let y = if self.is_log { y.max(f64::MIN_POSITIVE).log10() } else { y };
        let part = ((y - self.y.0) / (self.y.1 - self.y.0)).clamp(0.0, 1.0);
        self.bottom - part * (self.bottom - self.top)
    }

    /// The opening tag, axes, grid and words.
    pub(super) fn open(&self, out: &mut String, words: &Words<'_>) {
        let ((width, height), title) = (self.size, escaped(words.title));
        let mut push = |line: String| {
            out.push_str(&line);
            out.push('\n');
        };
        push(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"{title}\">"
        ));
        push(format!("<text class=\"title\" x=\"{:.1}\" y=\"16\">{title}</text>", self.left));
        let (left, top, right, bottom) = (self.left, self.top, self.right, self.bottom);
        let grid = |(x1, y1): (f64, f64), (x2, y2): (f64, f64)| {
            format!(
                "<line class=\"grid\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>"
            )
        };
        for tick in ticks(self.x.0, self.x.1, 0.012 * (right - left)) {
            let (x, text) = (self.at_x(tick), tick_text(tick));
            push(grid((x, top), (x, bottom)));
            push(format!(
                "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>",
                bottom + 15.0
            ));
        }
        for tick in ticks(self.y.0, self.y.1, 5.0) {
            let value = if self.is_log { 10_f64.powf(tick) } else { tick };
            let text = if self.is_log { format!("1e{tick}") } else { tick_text(tick) };
            let y = self.at_y(value);
            push(grid((left, y), (right, y)));
            push(format!(
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>",
                left - 5.0,
                y + 4.0
            ));
        }
        push(format!(
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            0.5 * (left + right),
            height - 8.0,
            escaped(words.x)
        ));
        push(format!(
            "<text transform=\"translate(13 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            0.5 * (top + bottom),
            escaped(words.y)
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(y: Scale, points: Vec<(f64, f64)>) -> Chart<'static> {
        Chart {
            words: Words { title: "a < b", x: "x (Hz)", y: "y" },
            size: (600.0, 300.0),
            x: (0.0, 100.0),
            y,
            lines: vec![("line", points)],
            cursors: Vec::new(),
        }
    }

    #[test]
    fn points_lie_where_their_values_say() {
        let svg = chart(Scale::Linear(0.0, 2.0), vec![(0.0, 0.0), (100.0, 2.0), (50.0, 1.0)]);
        let svg = svg.svg().unwrap();
        // Margins 66 and 14 across, 28 and 40 up and down.
        assert!(svg.contains("points=\"66.0,260.0 586.0,28.0 326.0,144.0\""), "{svg}");
        assert!(svg.contains("a &lt; b") && svg.ends_with("</svg>\n"));
        let log = chart(Scale::Logarithmic(9.0), vec![(0.0, 10.0), (0.0, 1e-4), (0.0, 0.0)]);
        assert!(log.svg().unwrap().contains("points=\"66.0,28.0 66.0,260.0 66.0,260.0\""));
    }

    #[test]
    fn an_axis_without_length_gives_no_picture() {
        assert!(chart(Scale::Linear(1.0, 1.0), Vec::new()).svg().is_none());
        assert!(chart(Scale::Logarithmic(0.0), Vec::new()).svg().is_none());
        assert!(chart(Scale::Linear(0.0, f64::NAN), Vec::new()).svg().is_none());
    }

    #[test]
    fn labels_of_cursors_do_not_cover_each_other() {
        let mut crowded = chart(Scale::Linear(0.0, 1.0), Vec::new());
        let cursor = |i: u32| Cursor { x: f64::from(i), label: format!("{i}× f"), class: "c" };
        crowded.cursors = (40..60).chain([300]).map(cursor).collect();
        let svg = crowded.svg().unwrap();
        assert_eq!(svg.matches("class=\"cursor c\"").count(), 20, "300 lies outside");
        let labels = svg.matches("<text class=\"c\"").count();
        assert!((LABEL_ROWS..20).contains(&labels), "{labels}");
    }
}
