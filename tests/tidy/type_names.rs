//! A type's name stands for one thing in all of `src/`, so that a search for it finds that thing alone.

use super::{assert_none, code_only, texts};
use std::collections::BTreeMap;

/// Columns before the first word.
fn indent(line: &str) -> usize {
    line.len() - line.trim_start().len()
}

/// A line without `pub`, `pub(super)` and the like.
fn item(line: &str) -> &str {
    let line = line.trim_start();
    let Some(rest) = line.strip_prefix("pub") else { return line };
    let rest = rest.strip_prefix('(').and_then(|r| r.split_once(')')).map_or(rest, |(_, rest)| rest);
    rest.trim_start()
}

/// Whether the last of these lines stands in a trait or in an implementation, where types belong to another type.
fn is_associated(lines: &[&str]) -> bool {
    let Some((last, before)) = lines.split_last() else { return false };
    let mut column = indent(last);
    // A head of several lines ends with lines of its own.
    let is_end_of_head = |line: &str| ["", "where", "{"].contains(&line.trim());
    for line in before.iter().rev().filter(|line| !is_end_of_head(line)) {
        if indent(line) < column {
            column = indent(line);
            let head = item(line);
            if ["impl", "unsafe impl", "trait", "unsafe trait"].iter().any(|word| head.starts_with(word)) {
                return true;
            }
        }
    }
    false
}

/// Names of the types that a file defines, each with its line.
fn defined(text: &str) -> Vec<(String, usize)> {
    let code = code_only(text);
    let lines: Vec<&str> = code.lines().collect();
    let mut found = Vec::new();
    for (at, line) in lines.iter().enumerate() {
        let mut words = item(line).split_whitespace();
        let Some(word) = words.next() else { continue };
        let defines = match word {
            "struct" | "enum" | "union" | "trait" => true,
            "type" => !is_associated(&lines[..=at]),
            _ => false,
        };
        let name = words.next().unwrap_or_default();
        let end = name.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(name.len());
        if defines && end > 0 {
            found.push((name[..end].to_owned(), at + 1));
        }
    }
    found
}

/// The names that these files define more than once, with the places.
fn repeated(files: &[(String, String)]) -> Vec<String> {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (path, text) in files.iter().filter(|(path, _)| path.ends_with(".rs")) {
        for (name, line) in defined(text) {
            places.entry(name).or_default().push(format!("{path}:{line}"));
        }
    }
    let twice = places.into_iter().filter(|(_, places)| places.len() > 1);
    twice.map(|(name, places)| format!("{name}: {}", places.join(", "))).collect()
}

#[test]
fn a_type_name_is_defined_once() {
    assert_none(
        "a type's name is defined once in `src/` (say what kind of thing it is)",
        repeated(&texts("src")),
    );
}

#[test]
fn every_kind_of_definition_is_found() {
    let text = "pub struct A<T>(T);\npub(in crate::x) enum B {\n    C,\n}\n// struct D;\npub trait E {\n    type F;\n}\n\
                impl<T> E for A<T>\nwhere\n    T: Copy,\n{\n    type F = T;\n}\ntype G = u8;\nmod tests {\n    struct H;\n    \
                type I = u8;\n}\n";
    let names: Vec<String> = defined(text).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["A", "B", "E", "G", "H", "I"]);
    let file = |path: &str, text: &str| (path.to_owned(), text.to_owned());
    let files =
        [file("a.rs", "struct A;"), file("b.rs", "mod m {\n    type A = u8;\n}"), file("c.md", "struct A;")];
    assert_eq!(repeated(&files), ["A: a.rs:1, b.rs:2"]);
}
