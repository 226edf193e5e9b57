//! A field of values over two axes, the larger the darker.

use super::Words;
use super::chart::Frame;
use super::chart::Scale;
use std::fmt::Write;

/// Steps of darkness.
const LEVELS: usize = 16;

/// A picture of a field.
#[derive(Debug, Clone, PartialEq)]
pub struct Map<'a> {
    /// Its words.
    pub words: Words<'a>,
    /// Width and height, pixels.
    pub size: (f64, f64),
    /// Ends of the x axis.
    pub x: (f64, f64),
    /// Ends of the y axis.
    pub y: (f64, f64),
    /// Values row by row from the lowest y, in equal columns; each row begins at its y and ends at the next
    /// one's, the last at the end of the axis.
    pub rows: Vec<(f64, Vec<f64>)>,
    /// Values of y with a line across, and its label.
    pub marks: Vec<(f64, String)>,
}

impl Map<'_> {
    /// Draws it; `None` without a positive value or if an axis has no length.
    #[must_use]
    pub fn svg(&self) -> Option<String> {
        let frame = Frame::new(self.size, self.x, Scale::Linear(self.y.0, self.y.1), 0)?;
        let all = || self.rows.iter().flat_map(|(_, values)| values).filter(|v| v.is_finite());
        let largest = all().copied().fold(0.0, f64::max);
        if largest <= 0.0 {
            return None;
        }
        let mut paths = vec![String::new(); LEVELS];
        for (i, (low, values)) in self.rows.iter().enumerate() {
            let high = self.rows.get(i + 1).map_or(self.y.1, |(next, _)| *next);
            let (y, height) = (frame.at_y(high), frame.at_y(*low) - frame.at_y(high));
            let width = (frame.right - frame.left) / values.len().max(1) as f64;
            // Neighbours of one level are one rectangle.
            let level = |value: f64| {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "between 0 and the number of levels; NaN gives 0"
                )]
                let level = (value / largest * LEVELS as f64).clamp(0.0, LEVELS as f64) as usize;
                level.min(LEVELS - 1)
            };
            let mut begin = 0;
            for run in values.chunk_by(|a, b| level(*a) == level(*b)) {
                let x = frame.left + width * begin as f64;
                let (right, at) = (width * run.len() as f64, level(run[0]));
                let _never =
                    write!(paths[at], "M{x:.1} {y:.1}h{right:.1}v{height:.1}h-{right:.1}z");
                begin += run.len();
            }
        }
        let mut out = String::new();
        frame.open(&mut out, &self.words);
        for (level, path) in paths.iter().enumerate().skip(1).filter(|(_, path)| !path.is_empty()) {
            let opacity = level as f64 / (LEVELS - 1) as f64;
            let _never =
                writeln!(out, "<path class=\"heat\" fill-opacity=\"{opacity:.2}\" d=\"{path}\"/>");
        }
        for (y, label) in self.marks.iter().filter(|(y, _)| self.y.0 <= *y && *y <= self.y.1) {
            let (y, label) = (frame.at_y(*y), super::escaped(label));
            let (left, right) = (frame.left, frame.right);
            let _never = writeln!(
                out,
                "<line class=\"cursor shaft\" x1=\"{left:.1}\" y1=\"{y:.1}\" x2=\"{right:.1}\" y2=\"{y:.1}\"/>\
                 <text class=\"shaft\" x=\"{:.1}\" y=\"{:.1}\">{label}</text>",
                left + 4.0,
                y - 3.0
            );
        }
        out.push_str("</svg>\n");
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: Vec<f64>) -> Map<'static> {
        Map {
            words: Words { title: "t", x: "x", y: "y" },
            size: (280.0, 168.0),
            x: (0.0, 4.0),
            y: (0.0, 1.0),
            rows: vec![(0.0, values)],
            marks: vec![(0.5, "GMF".to_owned()), (7.0, "outside".to_owned())],
        }
    }

    #[test]
    fn neighbours_of_one_level_are_one_rectangle_and_nothing_is_clear() {
        let svg = map(vec![0.0, 1.0, 1.0, 0.5]).svg().unwrap();
        // 200 pixels across from 66, 100 up and down from 28.
        assert!(
            svg.contains("fill-opacity=\"1.00\" d=\"M116.0 28.0h100.0v100.0h-100.0z\""),
            "{svg}"
        );
        assert!(svg.contains("fill-opacity=\"0.53\" d=\"M216.0 28.0h50.0v100.0h-50.0z\""), "{svg}");
        assert_eq!(svg.matches("<path").count(), 2);
        assert!(svg.contains(">GMF<") && !svg.contains("outside"));
    }

    #[test]
    fn nothing_gives_no_picture() {
        assert!(map(vec![0.0, 0.0]).svg().is_none());
        assert!(map(vec![f64::NAN]).svg().is_none());
    }
}
