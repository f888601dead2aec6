//! The table for the terminal, for a browser, and for the repository.

use super::{CaseRow, StressReport, bound, place, short};
use crate::page::html::escaped;
use std::fmt::Write;

/// What a cell says of an engine.
fn cell(row: &CaseRow, column: usize) -> String {
    match row.ours.get(column) {
        Some(Ok(number)) => short(*number),
        Some(Err(why)) => why.clone(),
        None => String::new(),
    }
}

/// What came of it, in a sentence.
fn summary(report: &StressReport) -> String {
    let cases = report.rows.len();
    let ours = match report.broken() {
        0 => "ours keep all".to_owned(),
        1 => "1 bound is broken by ours".to_owned(),
        n => format!("{n} bounds are broken by ours"),
    };
    format!(
        "{cases} cases; the textbook's formulas break {} of the bounds, {ours}.",
        report.textbook_broken()
    )
}

/// Lines of text, in columns.
pub fn terminal(report: &StressReport) -> String {
    let mut out = String::new();
    let wide = |of: &dyn Fn(&CaseRow) -> String, least: usize| {
        report.rows.iter().map(|row| of(row).chars().count()).max().unwrap_or(0).max(least)
    };
    let names = wide(&|row| row.case.name.into(), 4);
    let bounds = wide(&|row| bound(&row.case.bound), 5);
    for column in &report.columns {
        let _ = writeln!(out, "{}: {}", column.name, column.description);
    }
    let mut group = "";
    for row in &report.rows {
        if row.group != group {
            group = row.group;
            let _ = write!(out, "\n{group:<names$}  {:>10}", "textbook");
            for column in &report.columns {
                let _ = write!(out, "  {:>10}", column.name);
            }
            let _ = writeln!(out, "  {:<bounds$}      measures", "bound");
        }
        let _ = write!(out, "{:<names$}  {:>10}", row.case.name, short(row.textbook));
        for k in 0..report.columns.len() {
            let _ = write!(out, "  {:>10}", cell(row, k));
        }
        let holds = (0..report.columns.len()).all(|k| row.holds(k));
        let ok = if holds { "ok" } else { "BROKEN" };
        let _ = writeln!(out, "  {:<bounds$}  {ok:<6}  {}", bound(&row.case.bound), row.case.measures);
    }
    let total = match report.broken() {
        1 => "\n1 bound is broken.\n".to_owned(),
        n if n > 1 => format!("\n{n} bounds are broken.\n"),
        _ => String::new(),
    };
    let _ = write!(out, "\n{}{total}", summary(report) + "\n");
    out
}

/// For the repository.
pub fn markdown(report: &StressReport) -> String {
    let mut out = String::from(
        "# Hard cases\n\nWhat the textbook's formulas give in f32 where they are weakest, and what this program gives; made by\n\
         `halflight stress --all --markdown docs/stability.md`. `tests/stability` holds every engine to the bounds, to\n\
         continuity through the singular points and to invariance, and runs random cases around them.\n\n",
    );
    let _ = writeln!(out, "{}\n", summary(report));
    for column in &report.columns {
        let _ = writeln!(out, "* {}: {}", column.name, column.description);
    }
    let mut group = "";
    for row in &report.rows {
        if row.group != group {
            group = row.group;
            let names: String = report.columns.iter().map(|c| format!(" {} |", c.name)).collect();
            let lines: String = report.columns.iter().map(|_| "---|").collect();
            let _ = writeln!(
                out,
                "\n## {group}\n\n| case | measures | textbook form | gives |{names} bound | runs |"
            );
            let _ = writeln!(out, "|---|---|---|---|{lines}---|---|");
        }
        let cells: String = (0..report.columns.len())
            .map(|k| {
                if row.holds(k) { format!(" {} |", cell(row, k)) } else { format!(" **{}** |", cell(row, k)) }
            })
            .collect();
        let case = row.case;
        let formula = case.formula.replace('|', "\\|");
        let _ = writeln!(
            out,
            "| {} | {} | {formula} | {} |{cells} {} | {} |",
            case.name,
            case.measures.replace('|', "\\|"),
            short(row.textbook),
            bound(&case.bound),
            place(case),
        );
    }
    out
}

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1d2126; --faint: #68707a; --paper: #fbfbf9; --card: #fff; --line: #e3e4e0;
  --good: #14713d; --good-back: #e5f4ea; --bad: #a3221b; --bad-back: #fce9e7; --accent: #3a5a9c; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8ea; --faint: #9aa3ad; --paper: #14171a; --card: #1b1f23;
  --line: #2c3238; --good: #79d19a; --good-back: #143022; --bad: #ff9a92; --bad-back: #3a1a18; --accent: #9db9f3; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 15px/1.45 system-ui, sans-serif; }
main { max-width: 1240px; margin: 0 auto; padding: 32px 20px 80px; }
h1 { font-size: 30px; margin: 0 0 6px; letter-spacing: -.01em; }
h2 { font-size: 18px; margin: 34px 0 10px; }
p { margin: 4px 0; color: var(--faint); max-width: 75ch; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 22px 0 8px; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: 10px; padding: 12px 18px; min-width: 150px; }
.tile b { display: block; font-size: 28px; line-height: 1.1; font-variant-numeric: tabular-nums; }
.tile span { color: var(--faint); font-size: 13px; }
.wide { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: 10px; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: 9px 12px; border-bottom: 1px solid var(--line); }
tr:last-child td { border-bottom: 0; }
th { font-size: 12px; font-weight: 600; color: var(--faint); white-space: nowrap; }
td small { display: block; color: var(--faint); }
td.case { min-width: 250px; }
td.formula { color: var(--faint); font-size: 13px; min-width: 210px; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
.good, .bad { display: inline-block; border-radius: 6px; padding: 1px 8px; font-variant-numeric: tabular-nums; }
.good { color: var(--good); background: var(--good-back); }
.bad { color: var(--bad); background: var(--bad-back); }
.bad.text { white-space: normal; }
code { font-size: 12px; color: var(--accent); }
";

fn mark(text: &str, holds: bool) -> String {
    let class = if holds { "good" } else { "bad" };
    let sign = if holds { "✓" } else { "✗" };
    format!("<span class=\"{class}\">{sign} {}</span>", escaped(text))
}

/// For a browser: one file, nothing is fetched.
pub fn html(report: &StressReport) -> String {
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>half-light: hard cases</title><style>{STYLE}</style></head><body><main>\n<h1>Hard cases</h1>\n\
         <p>What the textbook's formulas give in 32-bit floats where they are weakest, what this program gives, and the bound \
         that must hold.</p>\n<div class=\"tiles\">"
    );
    let tile =
        |number: usize, text: &str| format!("<div class=\"tile\"><b>{number}</b><span>{text}</span></div>");
    out += &tile(report.rows.len(), "cases");
    out += &tile(report.textbook_broken(), "bounds that the textbook breaks");
    out += &tile(report.broken(), "bounds that we break");
    out += &tile(report.columns.len(), if report.columns.len() == 1 { "engine" } else { "engines" });
    out += "</div>\n";
    for column in &report.columns {
        let _ = writeln!(out, "<p><b>{}</b> {}</p>", escaped(column.name), escaped(&column.description));
    }
    let mut group = "";
    for row in &report.rows {
        if row.group != group {
            if !group.is_empty() {
                out += "</table></div>\n";
            }
            group = row.group;
            let _ = write!(
                out,
                "<h2>{}</h2>\n<div class=\"wide\"><table><tr><th>case</th><th>textbook form</th><th>gives</th>",
                escaped(group)
            );
            for column in &report.columns {
                let _ = write!(out, "<th>{}</th>", escaped(column.name));
            }
            out += "<th>bound</th></tr>\n";
        }
        let case = row.case;
        let _ = write!(
            out,
            "<tr><td class=\"case\">{}<small>{}</small><code>{}</code></td><td class=\"formula\">{}</td><td class=\"number\">{}</td>",
            escaped(case.name),
            escaped(case.measures),
            place(case),
            escaped(case.formula),
            mark(&short(row.textbook), row.textbook_holds()),
        );
        for k in 0..report.columns.len() {
            let _ = write!(out, "<td class=\"number\">{}</td>", mark(&cell(row, k), row.holds(k)));
        }
        let _ = writeln!(out, "<td class=\"number\">{}</td></tr>", escaped(&bound(&case.bound)));
    }
    if !group.is_empty() {
        out += "</table></div>\n";
    }
    out + "</main></body></html>\n"
}
