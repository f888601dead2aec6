//! Reads the golden numbers and compares with them: in f64 and f32 with the tolerances of the file. Pass if
//! |got - expected| <= abs + rel |expected|; `null` must be reported as failure.
//!
//! A test takes any entry of its group: what kind an entry is of is read off its inputs, never off its id. An entry of a
//! kind that no test knows fails with its group and id.
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
    /// Its name, for messages alone.
    pub id: &'a str,
    /// The group of entries that it belongs to.
    pub group: &'a str,
    /// Where its formula stands.
    pub eq: &'a str,
    /// What goes in.
    pub inputs: &'a Value,
    /// What comes out, in f64.
    pub expected: &'a Value,
    tolerance: &'a Value,
}

impl<'a> Entry<'a> {
    /// An entry of the file. Fails where it has no group or id.
    pub fn of(entry: &'a Value) -> Self {
        let text = |key: &str| entry[key].as_str();
        let (Some(group), Some(id)) = (text("group"), text("id")) else {
            panic!("golden entry without group or id: {entry}");
        };
        Self {
            id,
            group,
            eq: text("eq").unwrap_or_default(),
            inputs: &entry["inputs"],
            expected: &entry["expected"],
            tolerance: &entry["tolerance"],
        }
    }

    /// Fails: no test knows entries of this kind.
    pub fn unknown(&self, why: &str) -> ! {
        panic!(
            "golden entry {} of group {} (eq. {}): no test knows its kind: {why}",
            self.id, self.group, self.eq
        )
    }

    /// Returns whether there is such an input.
    pub fn has(&self, key: &str) -> bool {
        !self.inputs[key].is_null()
    }

    /// An input in words; empty where there is none.
    pub fn text(&self, key: &str) -> &'a str {
        self.inputs[key].as_str().unwrap_or_default()
    }

    /// Fails where an input in words does not say what the test does.
    pub fn require(&self, key: &str, says: &str) {
        if !self.text(key).contains(says) {
            self.unknown(&format!("its {key} is {}, not {says}", self.inputs[key]));
        }
    }

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

/// Runs all entries of some groups through their test in f64 and in f32, and prints how many. Fails where the file has
/// none of all the groups; a single group may have none.
pub fn run(shared: &Path, groups: &[(&str, Check, Check)]) {
    run_entries(&file(shared), groups, "f64 and f32");
}

/// Like [`run`], for kernels that are written in f32 alone.
pub fn run_f32(shared: &Path, groups: &[(&str, Check)]) {
    let groups: Vec<(&str, Check, Check)> =
        groups.iter().map(|(name, check)| (*name, nothing as Check, *check)).collect();
    run_entries(&file(shared), &groups, "f32");
}

fn nothing(_: &Entry) {}

/// Runs the entries of a file that is read already.
pub fn run_entries(file: &Value, groups: &[(&str, Check, Check)], precisions: &str) {
    let mut ran: BTreeMap<&str, usize> = groups.iter().map(|(name, ..)| (*name, 0)).collect();
    for entry in file["entries"].as_array().into_iter().flatten().map(Entry::of) {
        let Some((name, double, single)) = groups.iter().find(|(name, ..)| *name == entry.group) else {
            continue;
        };
        double(&entry);
        single(&entry);
        *ran.entry(name).or_default() += 1;
    }
    for (group, count) in &ran {
        println!("golden {group}: {count} entries in {precisions}");
    }
    assert!(ran.values().sum::<usize>() > 0, "the file has no entry of {:?}", ran.keys());
}
