//! A settings file as typed, with the place of each key.

use std::io::Read;
use std::path::Path;
use toml::{Spanned, Table, Value, de::DeTable, de::DeValue};

/// One key as typed.
#[derive(Clone, Debug, PartialEq)]
pub struct TypedKey {
    /// `section.name`.
    pub name: String,
    /// As typed, not checked yet.
    pub value: Value,
    /// Line and column of its value in the text, from 1; `None` where there is no text.
    pub place: Option<[usize; 2]>,
}

/// All keys of a text, in its order where it is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TypedSettings {
    /// As typed, not checked yet.
    pub keys: Vec<TypedKey>,
}

impl From<&Table> for TypedSettings {
    /// Without places.
    fn from(table: &Table) -> Self {
        Self { keys: flatten(table) }
    }
}

/// Larger files are no settings, bytes.
pub const LARGEST: u64 = 1 << 20;

/// Reads a settings file. Errors name it.
pub fn text(path: &Path) -> Result<String, String> {
    regular_text(path, LARGEST)
}

/// Reads a text file of at most so many bytes. A pipe or a device, which may never end, is not opened.
pub fn regular_text(path: &Path, largest: u64) -> Result<String, String> {
    let on = |what: String| format!("{}: {what}", path.display());
    let cannot = |e: std::io::Error| on(format!("cannot be read: {e}"));
    let about = std::fs::metadata(path).map_err(cannot)?;
    if !about.is_file() {
        return Err(on("cannot be read: must be a regular file".into()));
    }
    let mut content = String::new();
    let file = std::fs::File::open(path).map_err(cannot)?;
    // What grows while it is read counts, too.
    file.take(largest + 1).read_to_string(&mut content).map_err(cannot)?;
    if content.len() as u64 > largest {
        return Err(on(format!("size: must be at most {largest} bytes")));
    }
    Ok(content)
}

/// Reads a file's keys. Errors name the file and, for broken TOML, the place.
pub fn read(path: &Path) -> Result<TypedSettings, String> {
    parse(&text(path)?).map_err(|e| format!("{}: {e}", path.display()))
}

/// Parses text.
pub fn parse(text: &str) -> Result<TypedSettings, String> {
    let broken = |e: toml::de::Error| format!("not valid TOML: {}", e.to_string().trim_end());
    let mut keys = flatten(&text.parse::<Table>().map_err(broken)?);
    let mut places = Vec::new();
    collect_places("", DeTable::parse(text).map_err(broken)?.get_ref(), &mut places);
    for key in &mut keys {
        let start = places.iter().find(|(name, _)| *name == key.name).map(|(_, start)| *start);
        key.place = start.map(|start| line_and_column(text, start));
    }
    keys.sort_by_key(|key| key.place);
    Ok(TypedSettings { keys })
}

fn flatten(table: &Table) -> Vec<TypedKey> {
    let mut out = Vec::new();
    for (name, value) in table {
        match value {
            Value::Table(inner) => {
                out.extend(
                    flatten(inner).into_iter().map(|key| TypedKey { name: joined(name, &key.name), ..key }),
                );
            }
            _ => out.push(TypedKey { name: name.clone(), value: value.clone(), place: None }),
        }
    }
    out
}

/// Where each value begins, bytes.
fn collect_places(section: &str, table: &DeTable<'_>, out: &mut Vec<(String, usize)>) {
    for (name, value) in table {
        let name = joined(section, name.get_ref());
        match value.get_ref() {
            DeValue::Table(inner) => collect_places(&name, inner, out),
            _ => out.push((name, Spanned::span(value).start)),
        }
    }
}

fn joined(section: &str, name: &str) -> String {
    if section.is_empty() { name.to_owned() } else { format!("{section}.{name}") }
}

/// Line and column from 1 of a byte of a text; columns count characters.
fn line_and_column(text: &str, at: usize) -> [usize; 2] {
    let before = text.get(..at).unwrap_or(text);
    let line = before.rsplit('\n').next().unwrap_or("");
    [before.matches('\n').count() + 1, line.chars().count() + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_their_places() {
        let typed =
            parse("quality.spheres = 7\n\n[light]\n# how many\norder  =  3\n'tau' = \"é\" # s\n").unwrap();
        let keys: Vec<_> = typed.keys.iter().map(|k| (k.name.as_str(), k.place.unwrap())).collect();
        assert_eq!(keys, [("quality.spheres", [1, 19]), ("light.order", [5, 11]), ("light.tau", [6, 9])]);
        assert_eq!(line_and_column("é = 1", 5), [1, 5], "columns are characters");
    }

    #[test]
    fn broken_text_names_the_place() {
        let error = parse("a = 1\nb = = 2").unwrap_err();
        assert!(error.contains("line 2, column 5"), "{error}");
    }
}
