//! Plain English and true lists: comments that only repeat a name, figures written one for another, the table of wanted
//! figures, and that `tests/README.md` names every test file.
//!
//! Each rule is a function of text, so that the tests below can also see it fail.

mod support;
#[path = "support/tree.rs"]
mod tree;

use std::collections::BTreeSet;
use support::wanted;
use tree::{assert_none, root, sources, texts};

/// Words that say nothing beside a name.
const FILLERS: [&str; 19] = [
    "a", "an", "the", "of", "in", "its", "it", "this", "that", "is", "are", "and", "or", "to", "for", "with",
    "by", "from", "on",
];

/// A word without its plural.
fn stem(word: &str) -> String {
    let word = word.to_lowercase();
    for (end, instead) in [("ies", "y"), ("es", ""), ("s", "")] {
        if let Some(stem) = word.strip_suffix(end).filter(|stem| stem.len() >= 3) {
            return format!("{stem}{instead}");
        }
    }
    word
}

/// The words of all names in a line: `WorldFromCamera` and `world_from_camera` have three each.
fn words(text: &str) -> BTreeSet<String> {
    let mut words = BTreeSet::new();
    let mut word = String::new();
    let mut before = ' ';
    for character in text.chars().chain([' ']) {
        let begins = character.is_uppercase() && !before.is_uppercase();
        if (begins || !character.is_alphanumeric()) && !word.is_empty() {
            words.insert(stem(&std::mem::take(&mut word)));
        }
        if character.is_alphanumeric() {
            word.push(character);
        }
        before = character;
    }
    words
}

/// The words of a comment line, or nothing where the line is code or documents a module.
fn comment(line: &str) -> Option<&str> {
    let line = line.trim();
    line.strip_prefix("//")
        .filter(|rest| !rest.starts_with('!'))
        .map(|rest| rest.trim_start_matches('/').trim())
}

/// Comments of one line and at most three words, all of which stand in the name that follows.
fn repeated_names(path: &str, text: &str) -> Vec<String> {
    let lines: Vec<&str> = text.lines().collect();
    let is_comment =
        |at: Option<usize>| at.and_then(|at| lines.get(at)).is_some_and(|l| comment(l).is_some());
    let mut found = Vec::new();
    for (at, line) in lines.iter().enumerate() {
        let Some(comment) = comment(line) else { continue };
        // A formula, and what something is called elsewhere, say more than the name.
        let is_exact = comment.starts_with('`') || comment.contains(['-', '+', '*', '/', '^', '=', '<', '>']);
        let stands_alone = !is_comment(at.checked_sub(1)) && !is_comment(Some(at + 1));
        if is_exact || !stands_alone || comment.split_whitespace().count() > 3 {
            continue;
        }
        let item =
            lines[at + 1..].iter().find(|line| !line.trim().starts_with("#[")).copied().unwrap_or_default();
        let (said, named) = (words(comment), words(item));
        let mut rest = said.iter().filter(|word| !FILLERS.contains(&word.as_str())).peekable();
        if rest.peek().is_some() && rest.all(|word| named.contains(word)) {
            found.push(format!("{path}:{}: {} => {}", at + 1, line.trim(), item.trim()));
        }
    }
    found
}

/// Places where one figure stands "for" another, as in "0.25 for 0.5".
fn figures_for_figures(path: &str, text: &str) -> Vec<String> {
    let is_figure = |word: &str| {
        let word = word.trim_matches(|c: char| "+-(),;:%".contains(c)).trim_end_matches('.');
        word.contains('.') && word.parse::<f64>().is_ok()
    };
    let mut found = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let all: Vec<&str> = line.split_whitespace().collect();
        for (k, _) in all.iter().enumerate().filter(|(_, word)| **word == "for") {
            // A unit may stand between.
            let before = all[..k].iter().rev().take(2).any(|word| is_figure(word));
            let after = all[k + 1..].iter().take(1).any(|word| is_figure(word));
            if before && after {
                found.push(format!("{path}:{}: {}", at + 1, line.trim()));
            }
        }
    }
    found
}

/// Files that a table of Markdown does not name between backticks.
fn not_listed<'a>(list: &str, files: impl Iterator<Item = &'a str>) -> Vec<String> {
    files.filter(|file| !list.contains(&format!("`{file}`"))).map(str::to_owned).collect()
}

#[test]
fn comments_say_more_than_names() {
    let found: Vec<String> =
        sources().into_iter().flat_map(|(path, text)| repeated_names(&path, &text)).collect();
    assert_none("a comment says more than the name below it, or it goes", found);
}

#[test]
fn no_figure_stands_for_another() {
    let folders = ["docs", "config", "tests", "src"].into_iter().flat_map(texts);
    let prose = folders.filter(|(path, _)| path.ends_with(".md"));
    let top = ["README.md", "CHANGELOG.md"]
        .map(|name| (name.to_owned(), std::fs::read_to_string(root().join(name)).expect("it is there")));
    let found = prose
        .chain(top)
        .chain(sources())
        .filter(|(path, _)| path != "tests/prose.rs")
        .flat_map(|(path, text)| figures_for_figures(&path, &text))
        .collect();
    assert_none("say what it was: 0.11 (was 0.26)", found);
}

#[test]
fn every_test_file_is_in_the_list() {
    let list = std::fs::read_to_string(root().join("tests/README.md")).expect("it is there");
    let entries = std::fs::read_dir(root().join("tests")).expect("it is there");
    let mut files: Vec<String> = entries
        .flatten()
        .map(|entry| {
            let folder = if entry.path().is_dir() { "/" } else { "" };
            format!("{}{folder}", entry.file_name().to_string_lossy())
        })
        .filter(|name| name != "README.md")
        .collect();
    files.sort();
    assert!(files.len() > 50, "{files:?}");
    assert_none(
        "tests/README.md lists every file and folder beside it",
        not_listed(&list, files.iter().map(String::as_str)),
    );
    // And no file that is gone.
    let listed = list.lines().filter_map(|line| line.strip_prefix("| ")?.split('|').next());
    let gone = listed
        .flat_map(|cell| cell.split('`').skip(1).step_by(2))
        .filter(|name| name.ends_with(".rs") && !files.iter().any(|file| file == name))
        .map(str::to_owned)
        .collect();
    assert_none("tests/README.md lists no file that is not there", gone);
}

/// How often each test file is in a program: named by `Cargo.toml`, or by a program that holds several.
fn times_in_programs<'a>(programs: &str, files: impl Iterator<Item = &'a str>) -> Vec<(&'a str, usize)> {
    let times = |file: &str| {
        programs.matches(&format!("\"tests/{file}\"")).count()
            + programs.matches(&format!("\"../{file}\"")).count()
    };
    files.map(|file| (file, times(file))).collect()
}

#[test]
fn every_test_file_is_in_one_program() {
    let read = |path: &str| std::fs::read_to_string(root().join(path)).expect("it is there");
    let files_in = |folder: &str| -> Vec<String> {
        let entries = std::fs::read_dir(root().join(folder)).expect("it is there").flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        names.filter(|name| name.ends_with(".rs")).collect()
    };
    let mut programs = read("Cargo.toml");
    let groups: Vec<String> =
        files_in("tests/programs").into_iter().map(|name| format!("programs/{name}")).collect();
    groups.iter().for_each(|name| programs += &read(&format!("tests/{name}")));
    let files = files_in("tests");
    assert!(files.len() > 50 && groups.len() > 2, "{files:?} {groups:?}");
    let wrong = times_in_programs(&programs, files.iter().chain(&groups).map(String::as_str))
        .into_iter()
        .filter(|(_, times)| *times != 1)
        .map(|(file, times)| format!("tests/{file}: in {times} programs"))
        .collect();
    assert_none(
        "each test file is in one program: `[[test]]` in Cargo.toml, or a file of tests/programs",
        wrong,
    );
}

#[test]
fn the_table_of_wanted_figures_is_sound() {
    let (mut found, mut ids) = (Vec::new(), BTreeSet::new());
    let tests = texts("tests");
    for figure in wanted::figures() {
        let id = figure.id;
        if !ids.insert(id) {
            found.push(format!("{id} stands twice"));
        }
        if [figure.what, figure.unit, figure.test].iter().any(|text| text.is_empty()) {
            found.push(format!("{id} has an empty cell"));
        }
        if !(figure.bound >= 0.0 && figure.wanted >= 0.0) {
            found.push(format!("{id}: {} and {} must be ceilings", figure.wanted, figure.bound));
        }
        if figure.bound > figure.wanted && figure.cause.is_empty() {
            found.push(format!("{id}: the bound is above what was wanted, and no cause is named"));
        }
        let (file, function) = figure.test.split_once("::").unwrap_or((figure.test, ""));
        let places = [format!("tests/{file}.rs"), format!("tests/{file}/")];
        let own =
            tests.iter().filter(|(path, _)| places.iter().any(|place| path.starts_with(place.as_str())));
        let is_there = own.into_iter().any(|(_, text)| text.contains(&format!("fn {function}(")));
        if function.is_empty() || !is_there {
            found.push(format!("{id}: there is no test {}", figure.test));
        }
    }
    assert!(ids.len() > 100, "{}", ids.len());
    assert_none("tests/wanted.tsv", found);
}

#[test]
fn what_is_not_a_row_or_is_above_its_bound_fails() {
    let fails =
        |id: &'static str, reached: f64| std::panic::catch_unwind(|| wanted::within(id, reached)).is_err();
    assert!(!fails("replay.position", 1.9) && !fails("replay.position", -1.9));
    assert!(
        fails("replay.position", 2.1) && fails("replay.position", -2.1) && fails("replay.position", f64::NAN)
    );
    assert!(fails("replay.nothing", 0.0));
}

/// The rules can fail.
mod rules {
    use super::*;

    #[test]
    fn repeated_names_are_found() {
        for text in [
            "/// Its lens.\npub lens: Lens,",
            "/// Camera to world.\n#[serde(default)]\npub world_from_camera: Pose,",
            "// The pages\nstruct PointPages;",
            "/// Cities.\nconst CITY: u8 = 0;",
        ] {
            assert_eq!(repeated_names("a", text).len(), 1, "{text}");
        }
        for text in [
            "/// Metres.\npub radius: f32,",
            "/// Its lens,\n/// undistorted.\npub lens: Lens,",
            "/// The lens of the left eye.\npub lens: Lens,",
            "//! Lens.\nmod lens;",
            "/// `light.threshold`\npub light_threshold: f64,",
            "/// 1 - V.\nfn without_v(v: f64) -> f64 {",
            "/// Of a.\nlet x = 1;",
        ] {
            assert_eq!(repeated_names("a", text), Vec::<String>::new(), "{text}");
        }
    }

    #[test]
    fn figures_for_figures_are_found() {
        for text in ["an error of 0.11 for 0.26.", "takes 0.35 s for 0.24 s", "(-0.90 for 0.88 in its core)"]
        {
            assert_eq!(figures_for_figures("a", text).len(), 1, "{text}");
        }
        for text in
            ["0.11 (was 0.26)", "0.5 ms for 10 lights", "0.3 for each of 0.5 m", "for 0.5 of the light"]
        {
            assert!(figures_for_figures("a", text).is_empty(), "{text}");
        }
    }

    #[test]
    fn files_in_no_program_or_in_two_are_found() {
        let programs = "path = \"tests/a.rs\"\n#[path = \"../b.rs\"]\npath = \"tests/b.rs\"";
        let times = times_in_programs(programs, ["a.rs", "b.rs", "c.rs"].into_iter());
        assert_eq!(times, [("a.rs", 1), ("b.rs", 2), ("c.rs", 0)]);
    }

    #[test]
    fn files_that_are_not_listed_are_found() {
        assert_eq!(not_listed("| `a.rs` | x |", ["a.rs", "b.rs"].into_iter()), ["b.rs"]);
    }
}
