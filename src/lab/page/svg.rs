//! SVG for plots.

use super::html::escaped;
use std::fmt::Write;

/// Where a text stands to its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// Its middle is there.
    Middle,
    /// It ends there.
    End,
}

/// A picture that is being written; pixels, y down.
#[derive(Clone, Debug)]
pub struct Svg(String);

impl Svg {
    /// An empty one with letters of a size.
    pub fn new([width, height]: [f64; 2], letter_px: u32) -> Self {
        Self(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
             font-size=\"{letter_px}\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        ))
    }

    /// A line of text.
    pub fn text(&mut self, at: [f64; 2], anchor: Anchor, text: &str) {
        self.styled_text(at, anchor, "", text);
    }

    /// A line of text with attributes such as `fill="#777"`.
    pub fn styled_text(&mut self, [x, y]: [f64; 2], anchor: Anchor, style: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let gap = if style.is_empty() { "" } else { " " };
        let _ =
            writeln!(self.0, "<text x=\"{x:.1}\" y=\"{y:.1}\"{anchor}{gap}{style}>{}</text>", escaped(text));
    }

    /// A text that reads upwards, its middle at a place.
    pub fn upright_text(&mut self, [x, y]: [f64; 2], text: &str) {
        let _ = writeln!(
            self.0,
            "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            escaped(text)
        );
    }

    /// A path with attributes.
    pub fn path(&mut self, d: &str, style: &str) {
        let _ = writeln!(self.0, "<path d=\"{d}\" {style}/>");
    }

    /// A straight line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], style: &str) {
        self.path(&format!("M{:.1} {:.1}L{:.1} {:.1}", from[0], from[1], to[0], to[1]), style);
    }

    /// A line through points; it breaks where there is none.
    pub fn curve(&mut self, points: impl Iterator<Item = Option<[f64; 2]>>, colour: &str, width_px: f64) {
        self.dashed_curve(points, colour, width_px, "");
    }

    /// The same in dashes such as `6 3`; whole where `dashes` is empty.
    pub fn dashed_curve(
        &mut self,
        points: impl Iterator<Item = Option<[f64; 2]>>,
        colour: &str,
        width_px: f64,
        dashes: &str,
    ) {
        let style =
            format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width_px}\"{}", dashed(dashes));
        self.path(&through(points), &style);
    }

    /// The area between two lines of points from left to right.
    pub fn band(&mut self, upper: &[[f64; 2]], lower: &[[f64; 2]], colour: &str) {
        let around = upper.iter().chain(lower.iter().rev()).map(|p| Some(*p));
        self.path(&(through(around) + "Z"), &format!("fill=\"{colour}\" opacity=\"0.15\""));
    }

    /// A dot with attributes and the text that shows where a pointer rests on it.
    pub fn dot(&mut self, [x, y]: [f64; 2], radius_px: f64, style: &str, title: &str) {
        let _ = writeln!(
            self.0,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius_px}\" {style}><title>{}</title></circle>",
            escaped(title)
        );
    }

    /// One line of a legend: a short stroke and its name.
    pub fn key(&mut self, [x, y]: [f64; 2], colour: &str, dashes: &str, name: &str) {
        let style = format!("stroke=\"{colour}\" stroke-width=\"2\"{}", dashed(dashes));
        self.line([x, y], [x + 20.0, y], &style);
        self.text([x + 26.0, y + 4.0], Anchor::Start, name);
    }

    /// The whole picture.
    pub fn finish(mut self) -> String {
        self.0.push_str("</svg>\n");
        self.0
    }
}

fn dashed(dashes: &str) -> String {
    if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") }
}

/// A path through points that begins anew after each gap.
fn through(points: impl Iterator<Item = Option<[f64; 2]>>) -> String {
    let (mut d, mut pen) = (String::new(), 'M');
    for point in points {
        match point.filter(|p| p.iter().all(|x| x.is_finite())) {
            Some([x, y]) => {
                let _ = write!(d, "{pen}{x:.1} {y:.1}");
                pen = 'L';
            }
            None => pen = 'M',
        }
    }
    d
}

/// From values to pixels along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The ends in values; above 0 where it is logarithmic.
    pub values: [f64; 2],
    /// The same in pixels.
    pub pixels: [f64; 2],
    /// Whether equal steps are equal factors.
    pub is_log: bool,
}

impl Scale {
    /// Equal steps are equal differences.
    pub fn linear(values: [f64; 2], pixels: [f64; 2]) -> Self {
        Self { values, pixels, is_log: false }
    }

    /// Equal steps are equal factors.
    pub fn logarithmic(values: [f64; 2], pixels: [f64; 2]) -> Self {
        Self { values, pixels, is_log: true }
    }

    /// The pixel of a value; values beyond an end lie on it.
    pub fn at(&self, value: f64) -> f64 {
        let [low, high] = self.values;
        let value = value.clamp(low.min(high), low.max(high));
        let share = match self.is_log {
            true => (value / low).ln() / (high / low).ln(),
            false => (value - low) / (high - low),
        };
        self.pixels[0] + share * (self.pixels[1] - self.pixels[0])
    }

    /// The 1, 2 and 5 times a power of ten within a logarithmic one.
    pub fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.values;
        let mut out = Vec::new();
        for exponent in (low.log10().floor() as i32)..=(high.log10().ceil() as i32) {
            out.extend([1.0, 2.0, 5.0].map(|digit| digit * 10f64.powi(exponent)));
        }
        out.retain(|tick| (low..=high).contains(tick));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_meet_their_ends_and_stay_within() {
        let log = Scale::logarithmic([0.1, 10.0], [20.0, 220.0]);
        assert!((log.at(1.0) - 120.0).abs() < 1e-9);
        assert_eq!((log.at(0.0), log.at(1e9)), (20.0, 220.0));
        let down = Scale::linear([-1.0, 3.0], [200.0, 0.0]);
        assert_eq!([-1.0, 1.0, 3.0, 9.0].map(|v| down.at(v)), [200.0, 100.0, 0.0, 0.0]);
        assert_eq!(Scale::logarithmic([0.3, 7.0], [0.0, 1.0]).ticks(), [0.5, 1.0, 2.0, 5.0]);
    }

    #[test]
    fn curves_break_where_nothing_is_known() {
        let points = [Some([0.0, 1.0]), Some([1.0, 2.0]), None, Some([f64::NAN, 0.0]), Some([3.0, 4.0])];
        assert_eq!(through(points.into_iter()), "M0.0 1.0L1.0 2.0M3.0 4.0");
        let mut svg = Svg::new([10.0, 10.0], 12);
        svg.text([1.0, 2.0], Anchor::End, "a < b");
        svg.key([0.0, 0.0], "#000", "6 3", "dashed");
        let svg = svg.finish();
        assert!(svg.contains("text-anchor=\"end\">a &lt; b</text>") && svg.ends_with("</svg>\n"), "{svg}");
        assert!(svg.contains("stroke-dasharray=\"6 3\""));
    }
}
