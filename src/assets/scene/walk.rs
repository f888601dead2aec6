//! Walks a TOML document key by key and gathers every mistake on the way, each with its place in the file.

use crate::error::{AssetError, TextPosition};
use crate::model::limits::MAX_PLACE_M;
use crate::near_word::nearest;
use glam::DVec3;
use std::cell::RefCell;
use std::ops::Range;
use std::path::Path;
use toml::{
    Spanned, Table, Value,
    de::{DeTable, DeValue},
};

/// Characters of a value that a message shows at most.
const MOST_SHOWN: usize = 80;

/// Mistakes of one file.
pub struct Mistakes<'a> {
    file: &'a Path,
    text: &'a str,
    list: RefCell<Vec<AssetError>>,
}

impl<'a> Mistakes<'a> {
    /// None so far, in a file of this text.
    pub fn new(file: &'a Path, text: &'a str) -> Self {
        Self { file, text, list: RefCell::default() }
    }

    /// Adds a mistake that was found elsewhere, such as in a file that is named.
    pub fn add(&self, mistake: AssetError) {
        self.list.borrow_mut().push(mistake);
    }

    /// All as one error, if there are any: in the order of the file, those of other files last.
    pub fn into_error(self) -> Option<AssetError> {
        let mut list = self.list.into_inner();
        list.sort_by_key(|mistake| mistake.position.map_or((u32::MAX, 0), |at| (at.line, at.column)));
        AssetError::together(list)
    }

    /// A part of the text as it was typed, its white space in one line, cut where it is long.
    fn shown(&self, span: Range<usize>) -> String {
        let typed = self.text.get(span).unwrap_or_default();
        let text = typed.split_whitespace().collect::<Vec<_>>().join(" ");
        if text.chars().count() > MOST_SHOWN {
            text.chars().take(MOST_SHOWN - 3).chain("...".chars()).collect()
        } else {
            text
        }
    }
}

/// One table of the file. Every key is asked for once; what was not asked for is a mistake when `finish` is called.
pub struct Section<'a> {
    path: String,
    table: &'a DeTable<'a>,
    /// Where the table begins, bytes.
    begins_at: usize,
    asked: RefCell<Vec<&'static str>>,
    mistakes: &'a Mistakes<'a>,
}

impl<'a> Section<'a> {
    /// `path` is how messages name the table, e.g. `object[1]`; empty for the whole file.
    pub fn new(
        path: impl Into<String>,
        table: &'a DeTable<'a>,
        begins_at: usize,
        mistakes: &'a Mistakes<'a>,
    ) -> Self {
        Self { path: path.into(), table, begins_at, asked: RefCell::default(), mistakes }
    }

    fn name(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Whether the key is there.
    pub fn has(&self, key: &'static str) -> bool {
        self.table.contains_key(key)
    }

    /// The value as it stands in the file; counts as asked for.
    fn value(&self, key: &'static str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.asked.borrow_mut().push(key);
        self.table.get(key)
    }

    /// Notes that a key's value is not allowed, or that a key is missing.
    pub fn refuse(&self, key: &str, allowed: impl Into<Box<str>>) {
        let value = self.table.get(key).map(Spanned::span);
        let at = value.as_ref().map_or(self.begins_at, |span| span.start);
        self.note(key, at, value, allowed.into());
    }

    fn note(&self, key: &str, at: usize, value: Option<Range<usize>>, allowed: Box<str>) {
        let mistake = AssetError::new(self.mistakes.file, self.name(key))
            .at(TextPosition::of(self.mistakes.text, at))
            .allowed(allowed);
        self.mistakes.add(match value {
            Some(span) => mistake.value(self.mistakes.shown(span)),
            None => mistake,
        });
    }

    /// A value that `read` admits; a mistake where it does not, `None` where the key is not there.
    pub fn read<T>(&self, key: &'static str, allowed: &str, read: impl Fn(&Value) -> Option<T>) -> Option<T> {
        let found = read(&plain(self.value(key)?.get_ref()));
        if found.is_none() {
            self.refuse(key, allowed);
        }
        found
    }

    /// Like `read`, and a mistake where the key is not there.
    pub fn need<T>(&self, key: &'static str, allowed: &str, get: impl Fn(&Value) -> Option<T>) -> Option<T> {
        if !self.has(key) {
            self.asked.borrow_mut().push(key);
            self.refuse(key, format!("given: {allowed}"));
            return None;
        }
        self.read(key, allowed, get)
    }

    /// A number within min..=max.
    pub fn number(&self, key: &'static str, min: f64, max: f64) -> Option<f64> {
        self.read(key, &format!("a number within {min}..={max}"), |v| {
            number(v).filter(|n| (min..=max).contains(n))
        })
    }

    /// A key's text; a mistake where it is something else.
    pub fn text(&self, key: &'static str) -> Option<&'a str> {
        let found = self.value(key)?.get_ref().as_str();
        if found.is_none() {
            self.refuse(key, "a text");
        }
        found
    }

    /// true or false, `default` where it is not there.
    pub fn switch(&self, key: &'static str, default: bool) -> bool {
        self.read(key, "true or false", Value::as_bool).unwrap_or(default)
    }

    /// A place in the world, metres.
    pub fn point(&self, key: &'static str) -> Option<DVec3> {
        self.read(key, &format!("three numbers within {PLACES}, metres"), place)
    }

    /// A direction of any length.
    pub fn direction(&self, key: &'static str) -> Option<DVec3> {
        self.read(key, "three numbers within -1e6..=1e6 that are not all 0", |v| {
            point(v).filter(|p| p.abs().cmple(DVec3::splat(1e6)).all() && p.try_normalize().is_some())
        })
    }

    /// Linear RGB, each channel within 0..=max.
    pub fn color(&self, key: &'static str, max: f64) -> Option<[f32; 3]> {
        self.read(key, &format!("three numbers within 0..={max}"), |v| {
            point(v)
                .filter(|p| p.min_element() >= 0.0 && p.max_element() <= max)
                .map(|p| p.as_vec3().to_array())
        })
    }

    /// Sub-tables of an array of tables, e.g. all `[[object]]`.
    pub fn tables(&self, key: &'static str) -> Vec<Section<'a>> {
        let Some(value) = self.value(key) else { return Vec::new() };
        let Some(list) = value.get_ref().as_array().filter(|l| l.iter().all(|v| v.get_ref().is_table()))
        else {
            self.refuse(key, format!("written as [[{key}]]"));
            return Vec::new();
        };
        let of = |(i, v): (usize, &'a Spanned<DeValue<'a>>)| self.section(&format!("{key}[{i}]"), v);
        list.iter().enumerate().filter_map(of).collect()
    }

    /// A key's table; a mistake where it is something else.
    pub fn table(&self, key: &'static str) -> Option<Section<'a>> {
        let found = self.section(key, self.value(key)?);
        if found.is_none() {
            self.refuse(key, format!("written as [{key}]"));
        }
        found
    }

    fn section(&self, name: &str, value: &'a Spanned<DeValue<'a>>) -> Option<Section<'a>> {
        let table = value.get_ref().as_table()?;
        Some(Section::new(self.name(name), table, value.span().start, self.mistakes))
    }

    /// Every key that was not asked for is a mistake.
    pub fn finish(&self) {
        let asked = self.asked.borrow();
        for (key, value) in self.table.iter().filter(|(key, _)| !asked.contains(&&**key.get_ref())) {
            let allowed = match nearest(key.get_ref(), &asked) {
                Some(found) => format!("a known key (did you mean {found}?)"),
                None => format!("one of {}", asked.join(", ")),
            };
            self.note(key.get_ref(), key.span().start, Some(value.span()), allowed.into());
        }
    }
}

/// A value without its place. An integer beyond 64 bits becomes a number that is not finite: no key allows it.
fn plain(value: &DeValue<'_>) -> Value {
    match value {
        DeValue::String(text) => Value::String(text.to_string()),
        DeValue::Integer(number) => match i64::from_str_radix(number.as_str(), number.radix()) {
            Ok(number) => Value::Integer(number),
            Err(_) => Value::Float(f64::INFINITY),
        },
        DeValue::Float(number) => Value::Float(number.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(is) => Value::Boolean(*is),
        DeValue::Datetime(time) => Value::Datetime(*time),
        DeValue::Array(list) => Value::Array(list.iter().map(|v| plain(v.get_ref())).collect()),
        DeValue::Table(table) => Value::Table(
            table.iter().map(|(k, v)| (k.get_ref().to_string(), plain(v.get_ref()))).collect::<Table>(),
        ),
    }
}

/// A finite number, written with or without a point.
pub fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|v| v as f64)).filter(|v| v.is_finite())
}

/// A list of finite numbers.
pub fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(number).collect()
}

/// Where things may be along each axis, for messages.
pub const PLACES: &str = "-10000..=10000";

/// A place within the limits of a scene.
pub fn place(value: &Value) -> Option<DVec3> {
    point(value).filter(|p| is_place(*p))
}

/// Whether a place lies within the limits of a scene.
pub fn is_place(place: DVec3) -> bool {
    place.abs().cmple(DVec3::splat(MAX_PLACE_M)).all()
}

fn point(value: &Value) -> Option<DVec3> {
    let list = numbers(value)?;
    (list.len() == 3).then(|| DVec3::new(list[0], list[1], list[2]))
}
