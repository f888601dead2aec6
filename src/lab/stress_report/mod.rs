//! The hard cases on some engines as a table: for the terminal, for a browser, for the repository and for machines.

mod page;

pub use page::{html, markdown, terminal};

use crate::engine::Engine;
use crate::stress::{CaseBound, GROUPS, HardCase, Where};
use serde_json::{Value, json};

/// An engine with its name for people.
pub type NamedEngine = (&'static str, Box<dyn Engine>);

/// One engine's column.
pub struct EngineColumn {
    /// CPU, or the GPU's interface.
    pub name: &'static str,
    /// The engine in one line.
    pub description: String,
}

/// One case's row.
pub struct CaseRow {
    /// The group's title.
    pub group: &'static str,
    /// One row of the list of hard cases.
    pub case: &'static HardCase,
    /// What the textbook's formula gives.
    pub textbook: f64,
    /// What this program gives, one for each column.
    pub ours: Vec<Result<f64, String>>,
}

impl CaseRow {
    /// Whether the textbook's formula keeps the bound.
    pub fn textbook_holds(&self) -> bool {
        self.case.bound.holds(self.textbook)
    }

    /// Whether an engine keeps it.
    pub fn holds(&self, column: usize) -> bool {
        self.ours.get(column).is_some_and(|ours| ours.as_ref().is_ok_and(|n| self.case.bound.holds(*n)))
    }
}

/// All that was found.
pub struct StressReport {
    /// Engines.
    pub columns: Vec<EngineColumn>,
    /// Cases.
    pub rows: Vec<CaseRow>,
}

impl StressReport {
    /// Bounds that this program broke, over all engines.
    pub fn broken(&self) -> usize {
        let of = |row: &CaseRow| (0..self.columns.len()).filter(|&k| !row.holds(k)).count();
        self.rows.iter().map(of).sum()
    }

    /// Bounds that the textbook's formulas broke.
    pub fn textbook_broken(&self) -> usize {
        self.rows.iter().filter(|row| !row.textbook_holds()).count()
    }
}

impl StressReport {
    /// Runs the cases that are wanted by their group's title and themselves; `done` is told after each.
    pub fn of(
        mut engines: Vec<NamedEngine>,
        wanted: &dyn Fn(&str, &HardCase) -> bool,
        done: &dyn Fn(),
    ) -> Self {
        let mut rows = Vec::new();
        for group in GROUPS {
            for case in group.cases.iter().filter(|case| wanted(group.title, case)) {
                rows.push(row(group.title, case, &mut engines));
                done();
            }
        }
        let column = |(name, engine): NamedEngine| EngineColumn { name, description: engine.description() };
        Self { columns: engines.into_iter().map(column).collect(), rows }
    }
}

fn row(group: &'static str, case: &'static HardCase, engines: &mut [NamedEngine]) -> CaseRow {
    let mut textbook = f64::NAN;
    let mut ours: Vec<Result<f64, String>> = Vec::new();
    for (_, engine) in engines {
        // What no engine has a part in is the same with all.
        if case.runs == Where::Processor
            && let Some(first) = ours.first().cloned()
        {
            ours.push(first);
            continue;
        }
        let outcome = case.run(engine.as_mut());
        textbook = outcome.textbook;
        ours.push(outcome.ours);
    }
    CaseRow { group, case, textbook, ours }
}

/// What ran, in words.
fn place(case: &HardCase) -> &'static str {
    match case.runs {
        Where::Kernel(pass) => pass.name(),
        Where::Processor => "no shader",
    }
}

/// A number in as few digits as tell it from 1 to a ten-millionth.
fn short(number: f64) -> String {
    // Minus zero is zero.
    let number = number + 0.0;
    let size = number.abs();
    if number.is_nan() {
        "NaN".into()
    } else if number.is_infinite() {
        (if number > 0.0 { "inf" } else { "-inf" }).into()
    } else if size != 0.0 && !(1e-3..1e5).contains(&size) {
        format!("{number:.2e}")
    } else {
        let digits = if (size - 1.0).abs() < 1e-2 { 7 } else { 4 };
        let text = format!("{number:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    }
}

fn bound(bound: &CaseBound) -> String {
    let CaseBound { least, most } = *bound;
    let (middle, half) = (0.5 * (least + most), 0.5 * (most - least));
    if least == most {
        format!("= {}", short(least))
    } else if most >= f64::from(f32::MAX) {
        format!("from {} on, finite", short(least))
    } else if half < 0.06 * middle.abs() && least != 0.0 && middle.fract().abs() < 1e-9 {
        format!("{} ± {half:.1e}", short(middle))
    } else {
        format!("{} to {}", short(least), short(most))
    }
}

fn json_number(number: f64) -> Value {
    if number.is_finite() { json!(number) } else { json!(short(number)) }
}

/// For machines.
pub fn json(report: &StressReport) -> Value {
    let engines: Vec<_> =
        report.columns.iter().map(|c| json!({ "name": c.name, "description": c.description })).collect();
    let cases: Vec<_> = report
        .rows
        .iter()
        .map(|row| {
            let ours: Vec<_> = (report.columns.iter().zip(&row.ours).enumerate())
                .map(|(k, (column, ours))| match ours {
                    Ok(n) => {
                        json!({ "engine": column.name, "number": json_number(*n), "holds": row.holds(k) })
                    }
                    Err(why) => json!({ "engine": column.name, "error": why, "holds": false }),
                })
                .collect();
            json!({
                "group": row.group,
                "case": row.case.name,
                "measures": row.case.measures,
                "textbook_formula": row.case.formula,
                "runs": place(row.case),
                "textbook": { "number": json_number(row.textbook), "holds": row.textbook_holds() },
                "ours": ours,
                "bound": { "least": row.case.bound.least, "most": row.case.bound.most },
            })
        })
        .collect();
    json!({
        "engines": engines,
        "cases": cases,
        "broken": report.broken(),
        "textbook_broken": report.textbook_broken(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_bounds_read_well() {
        for (number, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (1.000_000_2, "1.0000002"),
            (0.25, "0.25"),
            (2048.0, "2048"),
            (-11.8, "-11.8"),
            (1.5e-7, "1.50e-7"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(short(number), text);
        }
        assert_eq!(bound(&CaseBound::exactly(0.0)), "= 0");
        assert_eq!(bound(&CaseBound::SHARE), "0 to 1");
        assert_eq!(bound(&CaseBound::about(1.0, 1e-6)), "1 ± 1.0e-6");
        assert_eq!(bound(&CaseBound::new(0.0, f64::from(f32::MAX))), "from 0 on, finite");
    }

    #[test]
    fn a_broken_bound_is_counted_and_shown() {
        let case = &GROUPS[0].cases[0];
        let column = |name| EngineColumn { name, description: "a <machine>".into() };
        let rows = vec![CaseRow {
            group: "Exposures",
            case,
            textbook: f64::NAN,
            ours: vec![Ok(1.0), Ok(f64::NAN), Err("no <memory>".into())],
        }];
        let report = StressReport { columns: vec![column("A"), column("B"), column("C")], rows };
        assert_eq!((report.broken(), report.textbook_broken()), (2, 1));
        let page = page::html(&report);
        assert!(page.contains("no &lt;memory&gt;") && page.contains("a &lt;machine&gt;"), "{page}");
        assert!(!page.contains("http"), "self-contained");
        assert!(page::terminal(&report).contains("2 bounds are broken"), "{}", page::terminal(&report));
        assert!(
            page::markdown(&report).contains("| NaN | 1 | **NaN** | **no <memory>** |"),
            "{}",
            page::markdown(&report)
        );
        let json = json(&report);
        assert_eq!(json["cases"][0]["textbook"]["number"], "NaN");
        assert_eq!(json["cases"][0]["ours"][1]["holds"], false);
    }
}
