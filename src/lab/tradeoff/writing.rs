//! Results: tables, plots, the page, the front.

use super::{
    axes::TriedPoint,
    errors::shown,
    measure::Measured,
    page::{SubjectPart, page},
    plot::{AxisCurve, FrontPlot, curves},
    study::StudyResults,
    subject::StudySubject,
};
use crate::assets::whole;
use crate::config::presets::{FrontFile, FrontPoint};
use crate::error::LabError;
use crate::page::html::escaped;
use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

/// What was measured, and by what.
pub struct About<'a> {
    /// In their order.
    pub subjects: &'a [StudySubject],
    /// The engine in one line.
    pub engine: String,
    /// Whether it was the quick form.
    pub quick: bool,
}

/// Writes all files into a folder that exists; returns their names.
///
/// # Errors
/// A file that cannot be written.
pub fn write(out: &Path, about: &About<'_>, results: &StudyResults) -> Result<Vec<PathBuf>, LabError> {
    let front = front_file(about, results);
    let mut files = vec![
        ("front.json".to_owned(), front.text()),
        ("points.csv".to_owned(), csv(about, results)),
        ("tradeoff.json".to_owned(), json(about, results).to_string() + "\n"),
    ];
    let drawn: Vec<DrawnSubject> = (about.subjects.iter().zip(&results.points))
        .map(|(subject, points)| DrawnSubject::of(subject, points, about.quick, results))
        .collect();
    let mut parts = Vec::new();
    for ((subject, points), drawn) in about.subjects.iter().zip(&results.points).zip(&drawn) {
        let plot = FrontPlot {
            title: &subject.name,
            points,
            curves: &drawn.curves,
            front: &drawn.front,
            named: &drawn.named,
            defaults: points.iter().position(|m| m.point == TriedPoint::default()),
            noise: subject.truth.noise,
        };
        let stem: String =
            subject.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        files.push((format!("{stem}.svg"), plot.svg()));
        let truth = shown(&subject.truth.radiance, subject.response(), subject.exposure_s());
        let without = shown(&subject.truth.without, subject.response(), subject.exposure_s());
        parts.push(SubjectPart { plot, truth, without, notes: drawn.notes.clone() });
    }
    let head = head(about, &front, &results.shared_names());
    files.push(("index.html".to_owned(), page("What accuracy costs in time", &head, &parts)?));
    let mut names = Vec::new();
    for (name, text) in files {
        let file = out.join(name);
        whole::write(&file, text)?;
        names.push(file);
    }
    Ok(names)
}

/// What is drawn of a subject: indices are into its points.
struct DrawnSubject {
    curves: Vec<AxisCurve>,
    front: Vec<usize>,
    named: Vec<(String, usize)>,
    notes: Vec<String>,
}

impl DrawnSubject {
    fn of(subject: &StudySubject, points: &[Measured], quick: bool, results: &StudyResults) -> Self {
        let (curves, flat) = curves(points, quick);
        let place = |point: &TriedPoint| points.iter().position(|m| m.point == *point);
        let mut named: Vec<(String, usize)> = Vec::new();
        for (name, i) in &results.named {
            let Some(at) = place(&results.front[*i].0) else { continue };
            match named.iter_mut().find(|(_, p)| *p == at) {
                Some((names, _)) => *names += &format!(", {name}"),
                None => named.push((name.clone(), at)),
            }
        }
        let mut notes = vec![format!("Truth: {}.", subject.truth.made_by)];
        if let Some(noise) = subject.truth.noise {
            notes[0] += &format!(
                " Its own standard error is {noise:.4}. It is taken out of the errors; differences of errors below {:.4} mean nothing.",
                subject.truth.difference_noise
            );
        } else {
            notes[0] += " Its own standard error is not known.";
        }
        if let Some(note) = noise_note(subject, results) {
            notes.push(note);
        }
        if !flat.is_empty() {
            notes.push(format!("No difference to this picture: {}.", flat.join(", ")));
        }
        if results.untold > 0 {
            notes.push(format!(
                "{} points of the front have no name: their times overlap with a cheaper one's, or their error is no smaller than the truth can tell.",
                results.untold
            ));
        }
        notes.push(
            "The front is that of all subjects together: on a single one its points need not lie in a line."
                .into(),
        );
        Self { curves, front: results.front.iter().filter_map(|(p, _)| place(p)).collect(), named, notes }
    }
}

/// What is said of a truth that was not traced until it tells; none where it was.
pub fn noise_note(subject: &StudySubject, results: &StudyResults) -> Option<String> {
    let noise = subject.truth.noise.filter(|_| results.is_noisy(subject))?;
    Some(format!(
        "{}: the truth's noise of {noise:.4} is more than half of the front's best error, {:.4}; the limit of {} rays a pixel ended it (--most-samples)",
        subject.name,
        results.best_error(),
        subject.truth_samples().unwrap_or(0)
    ))
}

/// The front as settings take it.
fn front_file(about: &About<'_>, results: &StudyResults) -> FrontFile {
    let points = results.front.iter().enumerate().map(|(i, (point, [ms, error]))| {
        let own: Vec<&Measured> =
            results.points.iter().filter_map(|all| all.iter().find(|m| m.point == *point)).collect();
        let mean = |of: &dyn Fn(&Measured) -> f64| {
            rounded(own.iter().map(|m| of(m)).sum::<f64>() / own.len() as f64)
        };
        let of = |value: &toml::Value| serde_json::to_value(value).unwrap_or_default();
        FrontPoint {
            presets: results.named.iter().filter(|(_, at)| *at == i).map(|(n, _)| n.clone()).collect(),
            error: rounded(*error),
            flip_mean: mean(&|m| m.errors.flip_mean),
            flip_p95: mean(&|m| m.errors.flip_p95),
            energy: mean(&|m| m.errors.energy.abs()),
            ms: rounded(*ms),
            settings: point.differing().iter().map(|(key, v)| ((*key).to_owned(), of(v))).collect(),
        }
    });
    let points = points.collect();
    FrontFile::new(about.engine.clone(), about.subjects.iter().map(|s| s.name.clone()).collect(), points)
}

/// To five digits: more are noise.
pub fn rounded(x: f64) -> f64 {
    format!("{x:.4e}").parse().unwrap_or(x)
}

fn csv(about: &About<'_>, results: &StudyResults) -> String {
    let mut text = String::from(
        "subject,settings,on_front,presets,error,flip_mean,flip_p95,energy,ms,lower_quartile_ms,upper_quartile_ms,stages_ms\n",
    );
    for (subject, points) in about.subjects.iter().zip(&results.points) {
        for m in points {
            let on = results.front.iter().position(|(p, _)| *p == m.point);
            let names: Vec<&str> =
                results.named.iter().filter(|(_, i)| Some(*i) == on).map(|(n, _)| n.as_str()).collect();
            let stages: Vec<String> = m.stages_ms.iter().map(|(n, ms)| format!("{n} {ms:.3}")).collect();
            let _ = writeln!(
                text,
                "\"{}\",\"{}\",{},\"{}\",{:.6},{:.6},{:.6},{:.6},{:.4},{:.4},{:.4},\"{}\"",
                subject.name.replace('"', "'"),
                m.point.label(),
                on.is_some(),
                names.join(" "),
                m.errors.shadow,
                m.errors.flip_mean,
                m.errors.flip_p95,
                m.errors.energy,
                m.ms,
                m.quartiles_ms[0],
                m.quartiles_ms[1],
                stages.join("; ")
            );
        }
    }
    text
}

/// The same for machines.
pub fn json(about: &About<'_>, results: &StudyResults) -> serde_json::Value {
    let of = |m: &Measured| {
        let stages: Vec<_> =
            m.stages_ms.iter().map(|(n, ms)| serde_json::json!({ "stage": n, "ms": ms })).collect();
        serde_json::json!({
            "settings": m.point.differing(), "error": m.errors.shadow, "flip_mean": m.errors.flip_mean,
            "flip_p95": m.errors.flip_p95, "energy": m.errors.energy, "ms": m.ms,
            "quartiles_ms": m.quartiles_ms, "stages": stages,
        })
    };
    let subjects: Vec<_> = about
        .subjects
        .iter()
        .zip(&results.points)
        .map(|(subject, points)| {
            serde_json::json!({
                "name": subject.name, "truth": subject.truth.made_by, "noise": subject.truth.noise,
                "truth_samples": subject.truth_samples(), "noise_ended_by_limit": results.is_noisy(subject),
                "points": points.iter().map(of).collect::<Vec<_>>(),
            })
        })
        .collect();
    serde_json::json!({ "engine": about.engine, "subjects": subjects, "front": front_file(about, results).points, "not_told_apart": results.untold })
}

/// The presets, for the page's head.
fn head(about: &About<'_>, front: &FrontFile, shared: &[String]) -> String {
    let mut html = format!(
        "<p>Error of shadows: root mean squared error of the share of light that virtual objects leave on real surfaces, over \
         the mean share that they take in shadow. Time: of drawing a picture, median of interleaved rounds, on {}.</p>\n\
         <table><tr><th>preset</th><th>ms</th><th>error</th><th>FLIP</th><th>FLIP 95 %</th><th>settings (others as by \
         default)</th></tr>",
        escaped(&about.engine)
    );
    for point in front.points.iter().filter(|p| !p.presets.is_empty()) {
        let settings: Vec<String> = point.settings.iter().map(|(k, v)| format!("{k} = {v}")).collect();
        let _ = write!(
            html,
            "<tr><td>{}</td><td>{:.2}</td><td>{:.4}</td><td>{:.4}</td><td>{:.4}</td><td>{}</td></tr>",
            point.presets.join(", "),
            point.ms,
            point.error,
            point.flip_mean,
            point.flip_p95,
            escaped(&settings.join(", "))
        );
    }
    html += "</table>";
    for names in shared {
        let _ = write!(html, "<p class=\"note\">{names}: one point. Nothing between them is told apart.</p>");
    }
    html
}
