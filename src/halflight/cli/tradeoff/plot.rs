//! Error against time, log-log, as SVG.

use super::{axes::AXES, measure::Measured};
use std::fmt::Write;

const SIZE: [f64; 2] = [960.0, 560.0];
/// Left, top, right, bottom of the field.
const FIELD: [f64; 4] = [64.0, 40.0, 700.0, 500.0];
const COLOURS: [&str; 9] =
    ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2", "#bcbd22"];

/// A curve: points of one setting, by index into all points.
pub struct Curve {
    /// The key.
    pub name: String,
    /// Indices, in the order of its values.
    pub points: Vec<(usize, String)>,
}

/// What is drawn.
pub struct Plot<'a> {
    /// Above it.
    pub title: &'a str,
    /// All points.
    pub points: &'a [Measured],
    /// Single settings.
    pub curves: &'a [Curve],
    /// Points of the front by rising time.
    pub front: &'a [usize],
    /// Points with a name.
    pub named: &'a [(String, usize)],
    /// Index of the defaults.
    pub defaults: Option<usize>,
    /// The truth's own noise, in the measure of the error.
    pub noise: Option<f64>,
}

/// The nearest of 1, 2, 5 times a power of ten within low..=high.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let mut out = Vec::new();
    for exponent in (low.log10().floor() as i32)..=(high.log10().ceil() as i32) {
        for digit in [1.0, 2.0, 5.0] {
            let tick = digit * 10f64.powi(exponent);
            if (low..=high).contains(&tick) {
                out.push(tick);
            }
        }
    }
    out
}

/// Text within SVG and HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

impl Plot<'_> {
    /// The picture.
    pub fn svg(&self) -> String {
        let finite = |x: f64| x.is_finite() && x > 0.0;
        let span = |of: &dyn Fn(&Measured) -> f64, more: Option<f64>| {
            let all = self.points.iter().map(of).chain(more).filter(|x| finite(*x));
            let (low, high) = all.fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(x), h.max(x)));
            if low <= high { (0.85 * low, 1.18 * high) } else { (0.1, 1.0) }
        };
        let (ms, error) = (span(&|m| m.ms, None), span(&|m| m.errors.shadow, self.noise));
        let [left, top, right, bottom] = FIELD;
        let x = |v: f64| left + (right - left) * (v.max(ms.0) / ms.0).ln() / (ms.1 / ms.0).ln();
        let y = |v: f64| bottom - (bottom - top) * (v.max(error.0) / error.0).ln() / (error.1 / error.0).ln();
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" \
             font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
             <text x=\"{left}\" y=\"22\" font-size=\"15\">{}</text>\n",
            SIZE[0],
            SIZE[1],
            escaped(self.title)
        );
        self.grid(&mut svg, (ms, error), (&x, &y));
        for (k, curve) in self.curves.iter().enumerate() {
            self.curve(&mut svg, k, curve, (&x, &y));
        }
        let on = |i: usize| [x(self.points[i].ms), y(self.points[i].errors.shadow)];
        let mut path = String::new();
        for (k, &i) in self.front.iter().enumerate() {
            let _ = write!(path, "{}{:.1} {:.1}", if k == 0 { 'M' } else { 'L' }, on(i)[0], on(i)[1]);
        }
        let _ = writeln!(svg, "<path d=\"{path}\" fill=\"none\" stroke=\"#222\" stroke-width=\"2.5\"/>");
        for &i in self.front {
            self.dot(&mut svg, i, "#222", 3.5, on(i));
        }
        for (k, (name, i)) in self.named.iter().enumerate() {
            let at = on(*i);
            let _ = writeln!(
                svg,
                "<path d=\"M{:.1} {:.1}l7 7l-7 7l-7 -7z\" fill=\"#ffd54a\" stroke=\"#222\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" font-weight=\"bold\">{}</text>",
                at[0],
                at[1] - 7.0,
                at[0] + 9.0,
                at[1] - 8.0 - 11.0 * (k % 2) as f64,
                escaped(name)
            );
        }
        if let Some(i) = self.defaults {
            let at = on(i);
            let _ = writeln!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"8\" fill=\"none\" stroke=\"#d62728\" stroke-width=\"2.5\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" fill=\"#d62728\">defaults</text>",
                at[0],
                at[1],
                at[0] - 4.0,
                at[1] + 22.0
            );
        }
        svg.push_str("</svg>\n");
        svg
    }

    fn grid(&self, svg: &mut String, spans: ((f64, f64), (f64, f64)), to: To<'_>) {
        let [left, top, right, bottom] = FIELD;
        for tick in ticks(spans.0.0, spans.0.1) {
            let x = to.0(tick);
            let _ = writeln!(
                svg,
                "<path d=\"M{x:.1} {top}V{bottom}\" stroke=\"#e3e3e3\"/>\
                 <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{tick}</text>",
                bottom + 16.0
            );
        }
        for tick in ticks(spans.1.0, spans.1.1) {
            let y = to.1(tick);
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#e3e3e3\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{tick}</text>",
                left - 6.0,
                y + 4.0
            );
        }
        if let Some(noise) = self.noise {
            let y = to.1(noise);
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#888\" stroke-dasharray=\"5 4\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#777\">noise of the truth</text>",
                right - 4.0,
                y - 4.0
            );
        }
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">time of a picture, milliseconds</text>\
             <text transform=\"translate(18 {}) rotate(-90)\" text-anchor=\"middle\">error of shadows, relative RMSE</text>",
            0.5 * (left + right),
            bottom + 40.0,
            0.5 * (top + bottom)
        );
        let _ = writeln!(
            svg,
            "<path d=\"M{0} {1}h18\" stroke=\"#222\" stroke-width=\"2.5\"/><text x=\"{2}\" y=\"{3}\">front of all together</text>",
            right + 14.0,
            top + 6.0,
            right + 38.0,
            top + 10.0
        );
    }

    fn curve(&self, svg: &mut String, k: usize, curve: &Curve, to: To<'_>) {
        let colour = COLOURS[k % COLOURS.len()];
        let dashes = if k < COLOURS.len() { "" } else { " stroke-dasharray=\"6 3\"" };
        let places: Vec<[f64; 2]> = curve
            .points
            .iter()
            .map(|(i, _)| [to.0(self.points[*i].ms), to.1(self.points[*i].errors.shadow)])
            .collect();
        let line: Vec<String> = places.iter().map(|p| format!("{:.1} {:.1}", p[0], p[1])).collect();
        let _ = writeln!(
            svg,
            "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.3\"{dashes}/>",
            line.join("L")
        );
        for ((i, value), at) in curve.points.iter().zip(&places) {
            self.dot(svg, *i, colour, 3.0, *at);
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"9\" fill=\"{colour}\">{}</text>",
                at[0] + 4.0,
                at[1] + 10.0,
                escaped(value)
            );
        }
        let row = FIELD[1] + 26.0 + 18.0 * k as f64;
        let _ = writeln!(
            svg,
            "<path d=\"M{0} {row}h18\" stroke=\"{colour}\" stroke-width=\"2\"{dashes}/><text x=\"{1}\" y=\"{2}\">{3}</text>",
            FIELD[2] + 14.0,
            FIELD[2] + 38.0,
            row + 4.0,
            escaped(&curve.name)
        );
    }

    fn dot(&self, svg: &mut String, i: usize, colour: &str, radius: f64, at: [f64; 2]) {
        let m = &self.points[i];
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\" fill=\"{colour}\" data-point=\"{i}\">\
             <title>{}: {:.2} ms, error {:.4}</title></circle>",
            at[0],
            at[1],
            escaped(&m.point.label()),
            m.ms,
            m.errors.shadow
        );
    }
}

type To<'a> = (&'a dyn Fn(f64) -> f64, &'a dyn Fn(f64) -> f64);

/// The curves of single settings among points, each with its values in order. Settings that change neither error nor time
/// by a hundredth are left out, and told.
pub fn curves(points: &[Measured], quick: bool) -> (Vec<Curve>, Vec<&'static str>) {
    let (mut curves, mut flat) = (Vec::new(), Vec::new());
    for axis in &AXES {
        let on_axis = |value: &toml::Value| {
            let point = super::axes::Point::default().with(axis, value.clone());
            points.iter().position(|m| m.point == point)
        };
        let shown = |v: &toml::Value| v.as_str().map_or_else(|| v.to_string(), str::to_owned);
        let found: Vec<(usize, String)> =
            axis.values(quick).iter().filter_map(|v| Some((on_axis(v)?, shown(v)))).collect();
        if found.len() < 2 {
            continue;
        }
        let spread = |of: &dyn Fn(&Measured) -> f64| {
            let all = found.iter().map(|(i, _)| of(&points[*i]));
            let (low, high) = all.fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(x), h.max(x)));
            high / low.max(1e-12)
        };
        if spread(&|m| m.errors.shadow) < 1.01 {
            flat.push(axis.key);
        } else {
            curves.push(Curve { name: axis.key.into(), points: found });
        }
    }
    (curves, flat)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_lie_within() {
        assert_eq!(ticks(0.3, 7.0), [0.5, 1.0, 2.0, 5.0]);
        assert_eq!(escaped("a<b & \"c\""), "a&lt;b &amp; &quot;c&quot;");
    }
}
