//! Results: tables, plots, the page, the front.

use super::{
    Results,
    axes::Point,
    errors::shown,
    measure::Measured,
    page::{Part, page},
    plot::{Plot, curves, escaped},
    subject::Subject,
};
use crate::cli::{CliError, Common};
use crate::config::presets::{FrontFile, FrontPoint};
use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

/// What was measured, and by what.
pub struct About<'a> {
    /// In their order.
    pub subjects: &'a [Subject],
    /// The engine in one line.
    pub engine: String,
    /// Whether it was the quick form.
    pub quick: bool,
}

/// Writes all files; gives their names.
pub fn write(out: &Path, about: &About<'_>, results: &Results) -> Result<Vec<PathBuf>, CliError> {
    let front = front_file(about, results);
    let mut files = vec![
        ("front.json".to_owned(), front.text()),
        ("points.csv".to_owned(), csv(about, results)),
        ("tradeoff.json".to_owned(), json(about, results).to_string() + "\n"),
    ];
    let named_of = |points: &[Measured]| -> Vec<(String, usize)> {
        let at = |i: usize| points.iter().position(|m| m.point == results.front[i].0);
        let mut named: Vec<(String, usize)> = Vec::new();
        for (name, i) in results.named.iter().filter_map(|(n, i)| Some((n, at(*i)?))) {
            match named.iter_mut().find(|(_, p)| *p == i) {
                Some((names, _)) => *names += &format!(", {name}"),
                None => named.push((name.clone(), i)),
            }
        }
        named
    };
    let mut kept = Vec::new();
    for (subject, points) in about.subjects.iter().zip(&results.points) {
        let (curves, flat) = curves(points, about.quick);
        let on_front = results.front.iter().filter_map(|(p, _)| points.iter().position(|m| m.point == *p));
        let mut notes = vec![format!("Truth: {}.", subject.truth.made_by)];
        if let Some(noise) = subject.truth.noise {
            notes[0] += &format!(
                " Its own standard error is {noise:.4}; it is taken out of the errors, and nothing far below it is shown to be real."
            );
        }
        if !flat.is_empty() {
            notes.push(format!("No difference to this picture: {}.", flat.join(", ")));
        }
        notes.push(
            "The front is that of all subjects together: on a single one its points need not lie in a line."
                .into(),
        );
        kept.push((curves, on_front.collect::<Vec<_>>(), named_of(points), notes));
    }
    let mut parts = Vec::new();
    for ((subject, points), (curves, front, named, notes)) in
        about.subjects.iter().zip(&results.points).zip(&kept)
    {
        let plot = Plot {
            title: &subject.name,
            points,
            curves,
            front,
            named,
            defaults: points.iter().position(|m| m.point == Point::default()),
            noise: subject.truth.noise,
        };
        let stem: String =
            subject.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        files.push((format!("{stem}.svg"), plot.svg()));
        let truth = shown(&subject.truth.radiance, subject.response(), subject.exposure_s());
        parts.push(Part { plot, truth, notes: notes.clone() });
    }
    files.push(("index.html".to_owned(), page("What accuracy costs in time", &head(about, &front), &parts)?));
    let mut names = Vec::new();
    for (name, text) in files {
        let file = out.join(name);
        std::fs::write(&file, text).map_err(|e| CliError::on(file.display(), e))?;
        names.push(file);
    }
    Ok(names)
}

/// The front as settings take it.
fn front_file(about: &About<'_>, results: &Results) -> FrontFile {
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

fn csv(about: &About<'_>, results: &Results) -> String {
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

fn json(about: &About<'_>, results: &Results) -> serde_json::Value {
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
                "points": points.iter().map(of).collect::<Vec<_>>(),
            })
        })
        .collect();
    serde_json::json!({ "engine": about.engine, "subjects": subjects, "front": front_file(about, results).points })
}

/// The presets, for the page's head.
fn head(about: &About<'_>, front: &FrontFile) -> String {
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
    html + "</table>"
}

/// For people, or for machines.
pub fn report(common: &Common, about: &About<'_>, results: &Results, files: &[PathBuf]) {
    if common.json {
        let mut all = json(about, results);
        all["files"] = serde_json::json!(files);
        println!("{all}");
        return;
    }
    println!("engine  {}", about.engine);
    println!("front of {} subjects, means:", about.subjects.len());
    println!("  {:>9}  {:>8}  {:<20} settings (others as by default)", "ms", "error", "preset");
    for (i, (point, [ms, error])) in results.front.iter().enumerate() {
        let names: Vec<&str> =
            results.named.iter().filter(|(_, at)| *at == i).map(|(n, _)| n.as_str()).collect();
        println!("  {ms:9.2}  {error:8.4}  {:<20} {}", names.join(", "), point.label());
    }
    for file in files {
        println!("wrote   {}", file.display());
    }
}
