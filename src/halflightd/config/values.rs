//! Between TOML's values and those of settings.

use super::range::real;
use crate::device::bracket::plan::Mains;
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
/// `camera.mains` in words.
pub(super) fn mains_word(mains: Option<Mains>) -> &'static str {
    match mains {
        None => "any",
        Some(Mains::Hz50) => "50 Hz",
        Some(Mains::Hz60) => "60 Hz",
    }
}

/// `camera.mains` from words; none for anything else.
pub(super) fn mains_of(text: &str) -> Option<Mains> {
    match text {
        "50 Hz" => Some(Mains::Hz50),
        "60 Hz" => Some(Mains::Hz60),
        _ => None,
    }
}
