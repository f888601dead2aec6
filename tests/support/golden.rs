//! Reads the golden numbers and compares with them: in f64 and f32 with the tolerances of the file. Pass if
//! |got - expected| <= abs + rel |expected|; `null` must be reported as failure.
#![allow(dead_code)]

use halflight::math::sh::Real;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// A number type with its names in the file.
pub trait Precision: Real {
    const NAME: &'static str;
    const ABS: &'static str;
    const REL: &'static str;
    /// As f64, to compare with.
    fn wide(self) -> f64;
}

impl Precision for f64 {
    const NAME: &'static str = "f64";
    const ABS: &'static str = "abs";
    const REL: &'static str = "rel";
    fn wide(self) -> f64 {
        self
    }
}

impl Precision for f32 {
    const NAME: &'static str = "f32";
    const ABS: &'static str = "f32_abs";
    const REL: &'static str = "f32_rel";
    fn wide(self) -> f64 {
        f64::from(self)
    }
}

/// One entry of the file.
pub struct Entry<'a> {
    /// Its name.
    pub id: &'a str,
    /// What goes in.
    pub inputs: &'a Value,
    /// What comes out, in f64.
    pub expected: &'a Value,
    tolerance: &'a Value,
}

impl Entry<'_> {
    pub fn number<T: Precision>(&self, key: &str) -> T {
        T::of(self.inputs[key].as_f64().unwrap_or_else(|| panic!("{}: no number {key}", self.id)))
    }

    pub fn count(&self, key: &str) -> usize {
        self.inputs[key].as_u64().unwrap_or_else(|| panic!("{}: no count {key}", self.id)) as usize
    }

    pub fn list<T: Precision>(&self, key: &str) -> Vec<T> {
        numbers(&self.inputs[key]).into_iter().map(T::of).collect()
    }

    /// A direction, normalised in the precision under test.
    pub fn direction<T: Precision>(&self, key: &str) -> [T; 3] {
        let v = self.list::<T>(key);
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        [v[0] / length, v[1] / length, v[2] / length]
    }

    /// Compares a list with one number, a list or null.
    pub fn check<T: Precision>(&self, what: &str, expected: &Value, got: Option<&[T]>) {
        let label = format!("{} {what} in {}", self.id, T::NAME);
        if expected.is_null() {
            assert!(got.is_none(), "{label}: expected a reported failure, got {got:?}");
            return;
        }
        let expected = numbers(expected);
        let got = got.unwrap_or_else(|| panic!("{label}: reported a failure"));
        assert_eq!(got.len(), expected.len(), "{label}: length");
        let tolerance =
            |key: &str| self.tolerance[key].as_f64().unwrap_or_else(|| panic!("{label}: no {key}"));
        for (i, (got, want)) in got.iter().zip(&expected).enumerate() {
            let allowed = tolerance(T::ABS) + tolerance(T::REL) * want.abs();
            let off = (got.wide() - want).abs();
            assert!(off <= allowed, "{label}[{i}]: {got:?} instead of {want}, off by {off:e} > {allowed:e}");
        }
    }

    pub fn check_key<T: Precision>(&self, key: &str, got: Option<&[T]>) {
        let expected = self.expected.get(key).unwrap_or_else(|| panic!("{}: no {key}", self.id));
        self.check(key, expected, got);
    }
}

/// All numbers of a value, nested lists flattened.
pub fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        _ => vec![value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))],
    }
}

/// A test of one entry in one precision.
pub type Check = fn(&Entry);

/// The text of the file.
pub fn file(shared: &Path) -> Value {
    let path = shared.join("golden/golden.json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Runs all entries of some groups through their test in f64 and in f32, prints how many, and fails where a group
/// has none. Entries in `not_yet` are left out and not counted.
pub fn run(shared: &Path, groups: &[(&str, Check, Check)], not_yet: &[&str]) {
    run_in(shared, groups, not_yet, "f64 and f32");
}

fn run_in(shared: &Path, groups: &[(&str, Check, Check)], not_yet: &[&str], precisions: &str) {
    let file = file(shared);
    let mut ran: BTreeMap<&str, usize> = groups.iter().map(|(name, ..)| (*name, 0)).collect();
    for entry in file["entries"].as_array().into_iter().flatten() {
        let (Some(group), Some(id)) = (entry["group"].as_str(), entry["id"].as_str()) else {
            panic!("{entry} has no group or id");
        };
        let Some((name, double, single)) = groups.iter().find(|(name, ..)| *name == group) else { continue };
        if not_yet.contains(&id) {
            continue;
        }
        let entry = Entry {
            id,
            inputs: &entry["inputs"],
            expected: &entry["expected"],
            tolerance: &entry["tolerance"],
        };
        double(&entry);
        single(&entry);
        *ran.entry(name).or_default() += 1;
    }
    for (group, count) in ran {
        println!("golden {group}: {count} entries in {precisions}");
        assert!(count > 0, "the file has no entry of group {group}");
    }
}

/// Like [`run`], for kernels that are written in f32 alone.
pub fn run_f32(shared: &Path, groups: &[(&str, Check)]) {
    let nothing: Check = |_| {};
    for (name, check) in groups {
        run_in(shared, &[(name, nothing, *check)], &[], "f32");
    }
}
