//! A settings file as typed.

use std::path::Path;
use toml::{Table, Value};

/// Reads a file into its table. Errors name the file and, for broken TOML, the place.
pub fn read(path: &Path) -> Result<Table, String> {
    let text =
        std::fs::read_to_string(path).map_err(|e| format!("{}: cannot be read: {e}", path.display()))?;
    parse(&text).map_err(|e| format!("{}: {e}", path.display()))
}

/// Parses text.
pub fn parse(text: &str) -> Result<Table, String> {
    text.parse::<Table>().map_err(|e| format!("not valid TOML: {}", e.to_string().trim_end()))
}

/// Flattens tables to `section.name` and value, in order of the file's keys.
pub fn flatten(table: &Table) -> Vec<(String, &Value)> {
    let mut out = Vec::new();
    for (name, value) in table {
        match value {
            Value::Table(inner) => {
                out.extend(flatten(inner).into_iter().map(|(rest, value)| (format!("{name}.{rest}"), value)));
            }
            _ => out.push((name.clone(), value)),
        }
    }
    out
}
