//! Figures that were wanted, with the bounds that tests hold them to: `tests/wanted.tsv`.
//!
//! A test asserts a figure by [`hold`] alone, so that its bound stands once. The figure is also written down under
//! `target/wanted/`, from which `make test` prints the table of all figures.
#![allow(dead_code)]

use std::{
    fs::{OpenOptions, create_dir_all},
    io::Write,
    path::PathBuf,
};

const TABLE: &str = include_str!("../wanted.tsv");

/// A row of the table.
pub struct Figure<'a> {
    /// Its name: the test file and what is measured.
    pub id: &'a str,
    /// What is measured, in words.
    pub what: &'a str,
    /// What was asked for; where nothing was, the tightest bound that a test ever held.
    pub wanted: f64,
    /// The most that the test allows.
    pub bound: f64,
    /// Unit of both.
    pub unit: &'a str,
    /// Why the bound is above what was wanted.
    pub cause: &'a str,
    /// The test that measures it: `file::function`.
    pub test: &'a str,
}

/// All rows.
pub fn figures() -> impl Iterator<Item = Figure<'static>> {
    TABLE.lines().skip(1).map(|line| {
        let cells: Vec<&str> = line.split('\t').collect();
        let [id, what, wanted, bound, unit, cause, test] = cells[..] else {
            panic!("tests/wanted.tsv: seven columns are needed: {line}");
        };
        let number = |text: &str| text.parse().unwrap_or_else(|_| panic!("{id}: {text} is no number"));
        Figure { id, what, wanted: number(wanted), bound: number(bound), unit, cause, test }
    })
}

/// Writes a figure down and asserts that it is within the bound of its row, whatever its sign.
pub fn hold(id: &str, reached: f64) {
    note(id, &format!("{id}\t{}", reached.abs()));
    within(id, reached);
}

/// Asserts that a figure is within the bound of its row, whatever its sign.
pub fn within(id: &str, reached: f64) {
    let Some(Figure { what, wanted, bound, unit, cause, .. }) = figures().find(|f| f.id == id) else {
        panic!("tests/wanted.tsv has no row {id}");
    };
    assert!(
        reached.abs() <= bound,
        "{id}, {what}: {reached:.5} {unit}, at most {bound} is allowed (wanted {wanted}; {cause})"
    );
}

/// Writes down that tests were skipped, so that rows that are not reached are no failure.
pub fn note_skipped(why: &str) {
    note("SKIPPED", why);
}

/// Adds a line to a file of `target/wanted`. A folder that cannot be written is no reason to fail a test.
fn note(name: &str, line: &str) {
    let Some(folder) = folder() else { return };
    let file = create_dir_all(&folder)
        .and_then(|()| OpenOptions::new().create(true).append(true).open(folder.join(format!("{name}.tsv"))));
    if let Ok(mut file) = file {
        let _ = writeln!(file, "{line}");
    }
}

/// `target/wanted`: test programs lie in `target/debug/deps`.
fn folder() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    Some(program.ancestors().nth(3)?.join("wanted"))
}
