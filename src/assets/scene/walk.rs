//! Walks a TOML table key by key and gathers every mistake on the way.

use crate::error::AssetError;
use crate::near_word::nearest;
use glam::DVec3;
use std::cell::RefCell;
use std::path::Path;
use toml::{Table, Value};

/// Mistakes of one file.
pub struct Mistakes<'a> {
    file: &'a Path,
    list: RefCell<Vec<AssetError>>,
}

impl<'a> Mistakes<'a> {
    /// None so far.
    pub fn new(file: &'a Path) -> Self {
        Self { file, list: RefCell::default() }
    }

    /// Adds one.
    pub fn add(&self, mistake: AssetError) {
        self.list.borrow_mut().push(mistake);
    }

    /// All as one error, if there are any.
    pub fn into_error(self) -> Option<AssetError> {
        AssetError::together(self.list.into_inner())
    }
}

/// One table of the file. Every key is asked for once; what was not asked for is a mistake when `finish` is called.
pub struct Section<'a> {
    path: String,
    table: &'a Table,
    asked: RefCell<Vec<&'static str>>,
    mistakes: &'a Mistakes<'a>,
}

impl<'a> Section<'a> {
    /// `path` is how messages name the table, e.g. `object[1]`; empty for the whole file.
    pub fn new(path: impl Into<String>, table: &'a Table, mistakes: &'a Mistakes<'a>) -> Self {
        Self { path: path.into(), table, asked: RefCell::default(), mistakes }
    }

    fn name(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Whether the key is there.
    pub fn has(&self, key: &'static str) -> bool {
        self.table.contains_key(key)
    }

    /// The raw value; counts as asked for.
    pub fn value(&self, key: &'static str) -> Option<&'a Value> {
        self.asked.borrow_mut().push(key);
        self.table.get(key)
    }

    /// Notes that a key's value is not allowed.
    pub fn refuse(&self, key: &str, allowed: impl Into<Box<str>>) {
        let mut mistake = AssetError::new(self.mistakes.file, self.name(key)).allowed(allowed);
        if let Some(value) = self.table.get(key) {
            mistake = mistake.value(shortened(value));
        }
        self.mistakes.add(mistake);
    }

    /// A value that `read` admits; a mistake where it does not, `None` where the key is not there.
    pub fn read<T>(&self, key: &'static str, allowed: &str, read: impl Fn(&Value) -> Option<T>) -> Option<T> {
        let value = self.value(key)?;
        let found = read(value);
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

    /// A text.
    pub fn text(&self, key: &'static str) -> Option<&'a str> {
        let value = self.value(key)?;
        let found = value.as_str();
        if found.is_none() {
            self.refuse(key, "a text");
        }
        found
    }

    /// true or false, `default` where it is not there.
    pub fn switch(&self, key: &'static str, default: bool) -> bool {
        self.read(key, "true or false", Value::as_bool).unwrap_or(default)
    }

    /// A point or vector of three numbers.
    pub fn point(&self, key: &'static str) -> Option<DVec3> {
        self.read(key, "three finite numbers", point)
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
        let Some(list) = value.as_array().filter(|l| l.iter().all(Value::is_table)) else {
            self.refuse(key, format!("written as [[{key}]]"));
            return Vec::new();
        };
        let table = |(i, v): (usize, &'a Value)| {
            v.as_table().map(|t| Section::new(self.name(&format!("{key}[{i}]")), t, self.mistakes))
        };
        list.iter().enumerate().filter_map(table).collect()
    }

    /// One sub-table.
    pub fn table(&self, key: &'static str) -> Option<Section<'a>> {
        let value = self.value(key)?;
        let Some(table) = value.as_table() else {
            self.refuse(key, format!("written as [{key}]"));
            return None;
        };
        Some(Section::new(self.name(key), table, self.mistakes))
    }

    /// Every key that was not asked for is a mistake.
    pub fn finish(&self) {
        let asked = self.asked.borrow();
        for key in self.table.keys().filter(|key| !asked.contains(&key.as_str())) {
            let allowed = match nearest(key, &asked) {
                Some(found) => format!("a known key (did you mean {found}?)"),
                None => format!("one of {}", asked.join(", ")),
            };
            self.refuse(key, allowed);
        }
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

fn point(value: &Value) -> Option<DVec3> {
    let list = numbers(value)?;
    (list.len() == 3).then(|| DVec3::new(list[0], list[1], list[2]))
}

fn shortened(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() > 80 { text.chars().take(77).chain("...".chars()).collect() } else { text }
}
