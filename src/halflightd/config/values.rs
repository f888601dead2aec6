//! Between TOML's values and those of settings.

use super::range::real;
use toml::Value;

/// A whole number; 0 for anything else.
pub(super) fn integer(value: &Value) -> i64 {
    value.as_integer().unwrap_or_default()
}

/// A number; 0 for anything else.
pub(super) fn number(value: &Value) -> f64 {
    real(value).unwrap_or_default()
}

/// A text; empty for anything else.
pub(super) fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

/// A number, or `false` for none.
pub(super) fn optional(number: Option<f64>) -> Value {
    number.map_or(Value::Boolean(false), Value::Float)
}

/// A list of texts.
pub(super) fn texts(words: &[String]) -> Value {
    Value::Array(words.iter().cloned().map(Value::String).collect())
}

/// One text.
pub(super) fn word(word: &str) -> Value {
    Value::String(word.to_owned())
}
