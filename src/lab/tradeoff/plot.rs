//! Error against time, both logarithmic, as SVG.

use super::{
    axes::{AXES, TriedPoint, shown_value},
    measure::Measured,
};
use crate::page::svg::{Anchor, Scale, Svg};

const SIZE: [f64; 2] = [960.0, 560.0];
/// Left, top, right, bottom of the field.
const FIELD: [f64; 4] = [64.0, 40.0, 700.0, 500.0];
const COLOURS: [&str; 9] =
    ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2", "#bcbd22"];
const INK: &str = "#222";
const GRID: &str = "stroke=\"#e3e3e3\"";

/// The points of one setting that was changed alone.
pub struct AxisCurve {
    /// The key.
    pub name: String,
    /// Indices into all points with the setting's value, in the order of its values.
    pub points: Vec<(usize, String)>,
}

/// What is drawn of one subject.
pub struct FrontPlot<'a> {
    /// Above it.
    pub title: &'a str,
    /// All points.
    pub points: &'a [Measured],
    /// Single settings.
    pub curves: &'a [AxisCurve],
    /// Points of the front by rising time.
    pub front: &'a [usize],
    /// Points with a name.
    pub named: &'a [(String, usize)],
    /// Index of the defaults.
    pub defaults: Option<usize>,
    /// The truth's own noise, in the measure of the error.
    pub noise: Option<f64>,
}

/// From milliseconds and errors to pixels.
struct PlotField {
    ms: Scale,
    error: Scale,
}

impl PlotField {
    fn at(&self, m: &Measured) -> [f64; 2] {
        [self.ms.at(m.ms), self.error.at(m.errors.shadow)]
    }
}

impl FrontPlot<'_> {
    /// The picture.
    pub fn svg(&self) -> String {
        let [left, top, right, bottom] = FIELD;
        let field = PlotField {
            ms: Scale::logarithmic(self.span(|m| m.ms, None), [left, right]),
            error: Scale::logarithmic(self.span(|m| m.errors.shadow, self.noise), [bottom, top]),
        };
        let mut svg = Svg::new(SIZE, 12);
        svg.styled_text([left, 22.0], Anchor::Start, "font-size=\"15\"", self.title);
        self.grid(&mut svg, &field);
        for (k, curve) in self.curves.iter().enumerate() {
            self.curve(&mut svg, k, curve, &field);
        }
        self.front(&mut svg, &field);
        svg.finish()
    }

    /// From a little below the least to a little above the most.
    fn span(&self, of: impl Fn(&Measured) -> f64, more: Option<f64>) -> [f64; 2] {
        let all = self.points.iter().map(of).chain(more).filter(|x| x.is_finite() && *x > 0.0);
        let (low, high) = all.fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(x), h.max(x)));
        if low <= high { [0.85 * low, 1.18 * high] } else { [0.1, 1.0] }
    }

    fn grid(&self, svg: &mut Svg, field: &PlotField) {
        let [left, top, right, bottom] = FIELD;
        for tick in field.ms.ticks() {
            let x = field.ms.at(tick);
            svg.line([x, top], [x, bottom], GRID);
            svg.text([x, bottom + 16.0], Anchor::Middle, &tick.to_string());
        }
        for tick in field.error.ticks() {
            let y = field.error.at(tick);
            svg.line([left, y], [right, y], GRID);
            svg.text([left - 6.0, y + 4.0], Anchor::End, &tick.to_string());
        }
        if let Some(noise) = self.noise {
            let y = field.error.at(noise);
            svg.line([left, y], [right, y], "stroke=\"#888\" stroke-dasharray=\"5 4\"");
            svg.styled_text([right - 4.0, y - 4.0], Anchor::End, "fill=\"#777\"", "noise of the truth");
        }
        svg.text([0.5 * (left + right), bottom + 40.0], Anchor::Middle, "time of a picture, milliseconds");
        svg.upright_text([18.0, 0.5 * (top + bottom)], "error of shadows, relative RMSE");
        svg.key([right + 14.0, top + 6.0], INK, "", "front of all together");
    }

    fn curve(&self, svg: &mut Svg, k: usize, curve: &AxisCurve, field: &PlotField) {
        let colour = COLOURS[k % COLOURS.len()];
        let dashes = if k < COLOURS.len() { "" } else { "6 3" };
        let place = |i: usize| field.at(&self.points[i]);
        svg.dashed_curve(curve.points.iter().map(|(i, _)| Some(place(*i))), colour, 1.3, dashes);
        for (i, value) in &curve.points {
            self.dot(svg, *i, colour, 3.0, field);
            let [x, y] = place(*i);
            let style = format!("font-size=\"9\" fill=\"{colour}\"");
            svg.styled_text([x + 4.0, y + 10.0], Anchor::Start, &style, value);
        }
        svg.key([FIELD[2] + 14.0, FIELD[1] + 26.0 + 18.0 * k as f64], colour, dashes, &curve.name);
    }

    fn front(&self, svg: &mut Svg, field: &PlotField) {
        let place = |i: usize| field.at(&self.points[i]);
        svg.curve(self.front.iter().map(|&i| Some(place(i))), INK, 2.5);
        for &i in self.front {
            self.dot(svg, i, INK, 3.5, field);
        }
        for (k, (name, i)) in self.named.iter().enumerate() {
            let [x, y] = place(*i);
            let diamond = format!("M{x:.1} {:.1}l7 7l-7 7l-7 -7z", y - 7.0);
            svg.path(&diamond, "fill=\"#ffd54a\" stroke=\"#222\"");
            let beside = [x + 9.0, y - 8.0 - 11.0 * (k % 2) as f64];
            svg.styled_text(beside, Anchor::Start, "font-weight=\"bold\"", name);
        }
        if let Some(i) = self.defaults {
            let [x, y] = place(i);
            let style = "fill=\"none\" stroke=\"#d62728\" stroke-width=\"2.5\"";
            svg.dot([x, y], 8.0, style, "defaults");
            svg.styled_text([x - 4.0, y + 22.0], Anchor::Start, "fill=\"#d62728\"", "defaults");
        }
    }

    fn dot(&self, svg: &mut Svg, i: usize, colour: &str, radius_px: f64, field: &PlotField) {
        let m = &self.points[i];
        let style = format!("fill=\"{colour}\" data-point=\"{i}\"");
        let title = format!("{}: {:.2} ms, error {:.4}", m.point.label(), m.ms, m.errors.shadow);
        svg.dot(field.at(m), radius_px, &style, &title);
    }
}

/// The curves of single settings among points, each with its values in order. Settings that do not change the error by a
/// hundredth are left out, and told.
pub fn curves(points: &[Measured], quick: bool) -> (Vec<AxisCurve>, Vec<&'static str>) {
    let (mut curves, mut flat) = (Vec::new(), Vec::new());
    for axis in &AXES {
        let on_axis = |value: &toml::Value| {
            let point = TriedPoint::default().with(axis, value.clone());
            points.iter().position(|m| m.point == point)
        };
        let found: Vec<(usize, String)> =
            axis.values(quick).iter().filter_map(|v| Some((on_axis(v)?, shown_value(v)))).collect();
        if found.len() < 2 {
            continue;
        }
        let errors = found.iter().map(|(i, _)| points[*i].errors.shadow);
        let (low, high) = errors.fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(x), h.max(x)));
        if high / low.max(1e-12) < 1.01 {
            flat.push(axis.key);
        } else {
            curves.push(AxisCurve { name: axis.key.into(), points: found });
        }
    }
    (curves, flat)
}
