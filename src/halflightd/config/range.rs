//! What a key may hold, in code and in words.

use toml::Value;

/// What a key may hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// An integer from min to max.
    Integer(i64, i64),
    /// One of these integers.
    IntegerChoice(&'static [i64]),
    /// A number from min to max.
    Real(f64, f64),
    /// 1 to 9 numbers, each from min to max.
    Reals(f64, f64),
    /// One of these words.
    Choice(&'static [&'static str]),
    /// Any text.
    Text,
    /// A list of words out of these.
    Words(&'static [&'static str]),
    /// true or false.
    Switch,
    /// false, or a number from min to max.
    Optional(f64, f64),
}

impl Range {
    /// In words, as after "must be".
    pub fn describe(&self) -> String {
        match self {
            Self::Integer(min, max) => format!("an integer within {min}..={max}"),
            Self::IntegerChoice(list) => {
                format!("one of {}", list.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "))
            }
            Self::Real(min, max) => format!("a number within {min}..={max}"),
            Self::Reals(min, max) => format!("a list of 1 to 9 numbers, each within {min}..={max}"),
            Self::Choice(list) => format!("one of {}", quoted(list)),
            Self::Text => "a text".into(),
            Self::Words(list) => format!("a list of words out of {}", quoted(list)),
            Self::Switch => "true or false".into(),
            Self::Optional(min, max) => format!("false (none), or a number within {min}..={max}"),
        }
    }

    /// Whether a value fits.
    pub fn admits(&self, value: &Value) -> bool {
        match self {
            Self::Integer(min, max) => value.as_integer().is_some_and(|v| (*min..=*max).contains(&v)),
            Self::IntegerChoice(list) => value.as_integer().is_some_and(|v| list.contains(&v)),
            Self::Real(min, max) => real(value).is_some_and(|v| (*min..=*max).contains(&v)),
            Self::Reals(min, max) => value.as_array().is_some_and(|list| {
                (1..=9).contains(&list.len())
                    && list.iter().all(|v| real(v).is_some_and(|v| (*min..=*max).contains(&v)))
            }),
            Self::Choice(list) => value.as_str().is_some_and(|v| list.contains(&v)),
            Self::Text => value.is_str(),
            Self::Words(list) => value
                .as_array()
                .is_some_and(|words| words.iter().all(|v| v.as_str().is_some_and(|v| list.contains(&v)))),
            Self::Switch => value.is_bool(),
            Self::Optional(min, max) => {
                value.as_bool() == Some(false) || real(value).is_some_and(|v| (*min..=*max).contains(&v))
            }
        }
    }
}

fn quoted(list: &[&str]) -> String {
    list.iter().map(|w| format!("\"{w}\"")).collect::<Vec<_>>().join(", ")
}

/// An integer or a finite number as a number.
pub(super) fn real(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|v| v as f64)).filter(|v| v.is_finite())
}
