//! The house rules, held as tests over the source tree: lengths, names, arrows between layers, doors for clocks and
//! the environment, where `unsafe` may stand, and that every pass has its twin and its shader.
//!
//! Each rule is a function of text, so that the tests below can also see it fail.

#[path = "support/tree.rs"]
mod tree;
#[path = "tidy/type_names.rs"]
mod type_names;

use halflight::plan::Pass;
use std::fs;
use tree::{assert_none, root, sources, texts};

/// Longest file, in lines.
const LONGEST: usize = 500;

/// Folders within one crate and their layers: a file uses only layers below its own. Between crates Cargo holds the
/// arrows.
const LAYERS: [(&str, u8); 15] = [
    ("model", 1),
    ("calibrate", 2),
    ("hdr", 2),
    ("track", 2),
    ("light", 2),
    ("sources", 2),
    ("visibility", 2),
    ("nearfield", 2),
    ("compose", 2),
    ("plan", 2),
    ("animate", 2),
    ("present", 4),
    ("pipeline", 5),
    ("config", 6),
    ("daemon", 7),
];

/// Crates whose folders have layers.
const LAYERED: [&str; 2] = ["src/core/", "src/halflightd/"];

/// Arrows within one layer that the map draws.
const DRAWN: [(&str, &str); 5] = [
    ("compose", "visibility"),
    ("light", "sources"),
    ("nearfield", "sources"),
    ("nearfield", "visibility"),
    ("nearfield", "light"),
];

/// Names that say nothing.
const EMPTY_NAMES: [&str; 9] =
    ["util", "utils", "common", "helper", "helpers", "manager", "types", "data", "misc"];

/// What only some places may touch, and where: paths that begin with one of these.
const DOORS: [(&[&str], &[&str]); 3] = [
    (
        &["Instant", "SystemTime", "thread::sleep"],
        &[
            "src/device/clock.rs",
            "src/engine/",
            "src/halflight/",
            "src/halflightd/daemon/",
            "src/halflightd/main.rs",
        ],
    ),
    (
        &["env::var", "env::vars", "env::var_os"],
        &["src/engine/", "src/halflight/", "src/halflightd/daemon/", "src/halflightd/main.rs"],
    ),
    (
        &["std::fs", "std::net", "File::open", "File::create", "thread::spawn"],
        &["src/device/", "src/engine/", "src/assets/", "src/halflightd/", "src/halflight/", "src/lab/"],
    ),
];

/// Beginnings of paths that exist on one machine only.
const MACHINE_PATHS: [&str; 5] = ["/home/", "/root/", "/Users/", "/work/", "C:\\"];

/// Rust code with comments and the insides of strings and characters blanked; lines stay where they are.
fn code_only(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out = bytes.to_vec();
    let mut at = 0;
    let starts = |at: usize, what: &str| bytes[at..].starts_with(what.as_bytes());
    let find = |from: usize, what: &str| {
        text.get(from..).and_then(|t| t.find(what)).map_or(bytes.len(), |i| from + i)
    };
    let is_word = |b: u8| b.is_ascii_alphanumeric() || b == b'_';
    while at < bytes.len() {
        let begin = at;
        // (first and last byte to blank, where to go on)
        let (from, to) = if starts(at, "//") {
            at = find(at, "\n");
            (begin, at)
        } else if starts(at, "/*") {
            let mut depth = 0;
            while at < bytes.len() {
                if starts(at, "/*") {
                    depth += 1;
                    at += 2;
                } else if starts(at, "*/") {
                    depth -= 1;
                    at += 2;
                    if depth == 0 {
                        break;
                    }
                } else {
                    at += 1;
                }
            }
            (begin, at.min(bytes.len()))
        } else if bytes[at] == b'r'
            && (at == 0 || !is_word(bytes[at - 1]) || bytes[at - 1] == b'b')
            && bytes[at + 1..].iter().find(|b| **b != b'#') == Some(&b'"')
        {
            let hashes = bytes[at + 1..].iter().take_while(|b| **b == b'#').count();
            let end = format!("\"{}", "#".repeat(hashes));
            at = (find(at + hashes + 2, &end) + end.len()).min(bytes.len());
            (begin, at)
        } else if bytes[at] == b'"' {
            at += 1;
            while at < bytes.len() && bytes[at] != b'"' {
                at += if bytes[at] == b'\\' { 2 } else { 1 };
            }
            at = (at + 1).min(bytes.len());
            (begin, at)
        } else if bytes[at] == b'\'' && (starts(at + 1, "\\") || bytes.get(at + 2) == Some(&b'\'')) {
            at = (find(at + if starts(at + 1, "\\") { 3 } else { 2 }, "'") + 1).min(bytes.len());
            (begin, at)
        } else {
            at += 1;
            continue;
        };
        for byte in &mut out[from..to] {
            if *byte != b'\n' {
                *byte = b' ';
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// Code (as from `code_only`) without the items under `#[cfg(test)]`.
fn without_tests(code: &str) -> String {
    let marker = "#[cfg(test)]";
    let mut out = String::new();
    let mut rest = code;
    while let Some(begin) = rest.find(marker) {
        out.push_str(&rest[..begin]);
        let item = &rest[begin + marker.len()..];
        let mut depth = 0;
        let mut end = item.len();
        for (at, character) in item.char_indices() {
            match character {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            if depth == 0 && (character == '}' || character == ';') {
                end = at + 1;
                break;
            }
        }
        // Lines keep their numbers.
        out.extend(item[..end].chars().filter(|c| *c == '\n'));
        rest = &item[end..];
    }
    out.push_str(rest);
    out
}

/// Where a word stands in code, as line numbers from 1; `a::b` counts as a word.
fn lines_with(code: &str, word: &str) -> Vec<usize> {
    let is_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    code.match_indices(word)
        .filter(|(at, _)| {
            !is_word(code[..*at].chars().next_back()) && !is_word(code[at + word.len()..].chars().next())
        })
        .map(|(at, _)| code[..at].matches('\n').count() + 1)
        .collect()
}

/// Module path of a file in its crate: `src/core/light/sh/mod.rs` is light, sh.
fn module_of(path: &str) -> Vec<String> {
    let inner = LAYERED.iter().find_map(|folder| path.strip_prefix(folder)).unwrap_or(path);
    let inner = inner.trim_end_matches(".rs");
    let mut module: Vec<String> = inner.split('/').map(str::to_owned).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib")) {
        module.pop();
    }
    module
}

/// Adds the top-level names that a path reaches, beginning at a module; `text` goes on after `crate::` or is the
/// path itself. Groups in braces are followed.
fn reach(module: &[String], text: &str, found: &mut Vec<String>) {
    let text = text.trim_start();
    if let Some(group) = text.strip_prefix('{') {
        let (mut depth, mut begin) = (0, 0);
        for (at, character) in group.char_indices() {
            match character {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' | '}' if depth == 0 => {
                    reach(module, &group[begin..at], found);
                    begin = at + 1;
                    if character == '}' {
                        return;
                    }
                }
                _ => {}
            }
        }
        return;
    }
    let name: String = text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    let after = text[name.len()..].trim_start().strip_prefix("::");
    match (name.as_str(), after) {
        ("super", Some(after)) => reach(&module[..module.len().saturating_sub(1)], after, found),
        ("self", Some(after)) => reach(module, after, found),
        ("", _) => {}
        _ => found.push(module.first().cloned().unwrap_or(name)),
    }
}

/// Top-level names that code (without comments) of a file reaches by `crate::` or `super::`, with lines.
fn reached(path: &str, code: &str) -> Vec<(usize, String)> {
    let module = module_of(path);
    let mut all = Vec::new();
    for (word, start) in [("crate::", &[][..]), ("super::", &module[..module.len().saturating_sub(1)])] {
        for (at, _) in code.match_indices(word) {
            let before = code[..at].chars().next_back();
            // The second `super` of a chain and the inside of longer names are not beginnings.
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':' || c == '$') {
                continue;
            }
            let mut found = Vec::new();
            reach(start, &code[at + word.len()..], &mut found);
            let line = code[..at].matches('\n').count() + 1;
            all.extend(found.into_iter().map(|name| (line, name)));
        }
    }
    all
}

fn layer(folder: &str) -> Option<u8> {
    LAYERS.iter().find(|(name, _)| *name == folder).map(|(_, layer)| *layer)
}

/// Arrows of one file that point up or sideways.
fn wrong_arrows(path: &str, text: &str) -> Vec<String> {
    let module = module_of(path);
    let Some(from) = module.first() else { return Vec::new() };
    let Some(own) = layer(from) else {
        return vec![format!(
            "{path}: folder `{from}` has no layer; give it one in tests/tidy.rs and src/README.md"
        )];
    };
    reached(path, &without_tests(&code_only(text)))
        .into_iter()
        .filter(|(_, to)| {
            layer(to).is_some_and(|below| {
                to != from && below >= own && !DRAWN.contains(&(from.as_str(), to.as_str()))
            })
        })
        .map(|(line, to)| format!("{path}:{line}: `{from}` (layer {own}) may not use `{to}`"))
        .collect()
}

/// Whether a file is test code as a whole.
fn is_test_file(path: &str) -> bool {
    !path.starts_with("src/") || path.ends_with("/tests.rs") || path.contains("/tests/")
}

/// Uses of clocks, sleep, the environment, files and threads outside their doors.
fn through_the_wall(path: &str, text: &str) -> Vec<String> {
    let code = without_tests(&code_only(text));
    let mut findings = Vec::new();
    for (words, doors) in DOORS {
        if is_test_file(path) || doors.iter().any(|door| path.starts_with(door)) {
            continue;
        }
        for word in words {
            for line in lines_with(&code, word) {
                findings.push(format!("{path}:{line}: `{word}` belongs to {}", doors.join(", ")));
            }
        }
    }
    findings
}

/// Whether a path has a name that says nothing.
fn has_empty_name(path: &str) -> bool {
    let stem = path.rsplit_once('.').map_or(path, |(stem, _)| stem);
    stem.split('/').any(|part| EMPTY_NAMES.contains(&part))
}

#[test]
fn files_are_short() {
    let long = sources()
        .into_iter()
        .map(|(path, text)| (path, text.lines().count()))
        .filter(|(_, lines)| *lines > LONGEST)
        .map(|(path, lines)| format!("{path}: {lines} lines"))
        .collect();
    assert_none("files of at most 500 lines (cut along a seam of meaning)", long);
}

#[test]
fn arrows_point_down() {
    let wrong = texts("src")
        .into_iter()
        .filter(|(path, _)| LAYERED.iter().any(|folder| path.starts_with(folder)) && path.ends_with(".rs"))
        .filter(|(path, _)| !path.ends_with("/lib.rs") && !path.ends_with("/main.rs"))
        .filter(|(path, _)| !is_test_file(path))
        .flat_map(|(path, text)| wrong_arrows(&path, &text))
        .collect();
    assert_none("a file uses only layers below its own", wrong);
}

#[test]
fn unsafe_only_in_sys() {
    let found = sources()
        .into_iter()
        .filter(|(path, _)| path.ends_with(".rs") && !path.ends_with("/sys.rs"))
        .flat_map(|(path, text)| {
            lines_with(&code_only(&text), "unsafe").into_iter().map(move |line| format!("{path}:{line}"))
        })
        .collect();
    assert_none("`unsafe` only in files called sys.rs", found);
}

#[test]
fn names_say_something() {
    let empty = sources().into_iter().map(|(path, _)| path).filter(|path| has_empty_name(path)).collect();
    assert_none("no file or folder is called utils, common, helper, manager, types or data", empty);
}

#[test]
fn every_pass_has_its_twin_and_its_shader() {
    let missing = Pass::ALL
        .iter()
        .flat_map(|pass| [format!("src/core/{}.rs", pass.name()), format!("shaders/{}.wgsl", pass.name())])
        .filter(|path| !root().join(path).is_file())
        .collect();
    assert_none("a kernel is one name", missing);
}

/// Lines of an engine's file that name the other engine.
fn names_the_other_engine(path: &str, text: &str) -> Vec<String> {
    let other: &[&str] = if path.starts_with("src/engine/cpu") {
        &["gpu", "GpuEngine", "wgpu"]
    } else if path.starts_with("src/engine/gpu") {
        &["cpu", "CpuEngine", "Twins"]
    } else if path.starts_with("src/engine/frame") {
        &["gpu", "GpuEngine", "wgpu", "cpu", "CpuEngine", "Twins"]
    } else {
        &[]
    };
    let code = code_only(text);
    let found = other.iter().flat_map(|name| lines_with(&code, name));
    found.map(|line| format!("{path}:{line}")).collect()
}

#[test]
fn neither_engine_knows_the_other() {
    let found = sources().into_iter().flat_map(|(path, text)| names_the_other_engine(&path, &text)).collect();
    assert_none("engine/cpu and engine/gpu meet in engine/door.rs alone", found);
    assert_eq!(names_the_other_engine("src/engine/gpu/a.rs", "use crate::cpu::Twins;").len(), 2);
    assert_eq!(names_the_other_engine("src/engine/cpu/a.rs", "use crate::gpu::view;").len(), 1);
    assert!(names_the_other_engine("src/engine/door.rs", "use crate::{cpu::Twins, gpu};").is_empty());
}

#[test]
fn clocks_and_files_stay_behind_their_doors() {
    let found = sources().into_iter().flat_map(|(path, text)| through_the_wall(&path, &text)).collect();
    assert_none("clock, sleep, environment and files are used only behind their doors", found);
}

#[test]
fn nothing_is_left_for_later() {
    // Put together here, so that this file does not find itself.
    let words =
        [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("todo", "!("), concat!("unimplemented", "!(")];
    let everything =
        sources().into_iter().chain(texts("config")).chain(texts("systemd")).chain(texts("docs"));
    let found = everything
        .flat_map(|(path, text)| {
            words
                .iter()
                .flat_map(|word| text.match_indices(word).map(|(at, _)| at).collect::<Vec<_>>())
                .map(|at| format!("{path}:{}", text[..at].matches('\n').count() + 1))
                .collect::<Vec<_>>()
        })
        .collect();
    assert_none("no note to do or mend something later (write an issue)", found);
}

#[test]
fn no_path_of_one_machine() {
    let top = fs::read_dir(root()).expect("the root is readable").flatten().filter_map(|entry| {
        let name = entry.file_name().to_string_lossy().into_owned();
        // A worktree's `.git` is a file that holds a path.
        let text = entry.path().is_file().then(|| fs::read_to_string(entry.path()).ok()).flatten()?;
        (name != ".git").then_some((name, text))
    });
    let folders = ["config", "systemd", "docs", ".ci", ".cargo"].into_iter().flat_map(texts);
    let found = sources()
        .into_iter()
        .chain(folders)
        .chain(top)
        .filter(|(path, _)| path != "tests/tidy.rs")
        .flat_map(|(path, text)| machine_paths(&path, &text))
        .collect();
    assert_none("no absolute path of one machine", found);
}

fn machine_paths(path: &str, text: &str) -> Vec<String> {
    MACHINE_PATHS
        .iter()
        .flat_map(|start| text.match_indices(start))
        .filter(|(at, _)| {
            !text[..*at].chars().next_back().is_some_and(|c| c.is_alphanumeric() || "._-*$}".contains(c))
        })
        .map(|(at, start)| format!("{path}:{}: {start}", text[..at].matches('\n').count() + 1))
        .collect()
}

/// The rules can fail.
mod rules {
    use super::*;

    #[test]
    fn comments_strings_and_tests_do_not_count() {
        let text = "fn a() {} // crate::cli\n/* crate::cli /* x */ */ let s = \"crate::cli\"; let r = r#\"crate::\"cli\"#;\n\
                    let c = '\"'; let d = '\\''; fn f<'a>(x: &'a str) {} use crate::math::pose;\n\
                    #[cfg(test)]\nmod tests {\n    use crate::cli;\n}\nuse crate::hdr;\n";
        let code = code_only(text);
        assert_eq!(code.matches("crate::").count(), 3, "{code}");
        let found = reached("src/core/light/split.rs", &without_tests(&code));
        assert_eq!(found, [(3, "math".to_owned()), (8, "hdr".to_owned())]);
    }

    #[test]
    fn arrows_up_and_sideways_are_found() {
        assert_eq!(wrong_arrows("src/core/light/a.rs", "use crate::{math::pose, hdr::response};").len(), 1);
        assert_eq!(wrong_arrows("src/core/model/a.rs", "let x = crate::hdr::response::T;").len(), 1);
        assert_eq!(wrong_arrows("src/core/hdr/a.rs", "use super::super::track::tag;").len(), 1);
        assert_eq!(wrong_arrows("src/core/hdr/mod.rs", "use super::{track, model};").len(), 1);
        assert_eq!(wrong_arrows("src/halflightd/config/a.rs", "use crate::daemon::x;").len(), 1);
        assert_eq!(wrong_arrows("src/core/attic/a.rs", "").len(), 1, "a folder without a layer");
        for (path, fine) in [
            ("src/core/compose/a.rs", "use crate::visibility::shadow_maps;"),
            ("src/core/light/a.rs", "use super::super::model; use super::{Real, basis};"),
            ("src/halflightd/daemon/a.rs", "use crate::{config, pipeline::{event, frame}};"),
            ("src/core/plan/a.rs", "use crate::model; macro_rules! m { () => { $crate::light::x() } }"),
        ] {
            assert_eq!(wrong_arrows(path, fine), Vec::<String>::new());
        }
    }

    #[test]
    fn doors_names_and_paths_are_watched() {
        assert_eq!(
            through_the_wall("src/light/a.rs", "use std::time::Instant;\nstd::thread::sleep(d);").len(),
            2
        );
        assert_eq!(through_the_wall("src/track/a.rs", "std::env::var_os(\"X\");").len(), 1);
        assert_eq!(through_the_wall("src/hdr/a.rs", "use std::fs::read;").len(), 1);
        assert!(through_the_wall("src/device/clock.rs", "use std::time::Instant;").is_empty());
        assert!(through_the_wall("src/light/a.rs", "struct InstantLight;").is_empty());
        assert!(has_empty_name("src/light/utils.rs") && has_empty_name("src/data/mod.rs"));
        assert!(has_empty_name("src/device/common.rs") && !has_empty_name("src/device/replay.rs"));
        let home = format!("see {}me/x", "/ho");
        assert_eq!(machine_paths("a", &home).len(), 1);
        assert!(machine_paths("a", "../frame/work/x and a/home/b").is_empty());
        assert_eq!(lines_with("a\nunsafe {}\nunsafety", "unsafe"), [2]);
    }
}
