//! The parameters in a device's name: `scheme:key=value,key=value`. Pure.

use super::{DeviceError, ErrorKind};
use std::fmt::Display;
use std::str::FromStr;

/// Keys and values of one device name, taken out one by one.
#[derive(Debug)]
pub struct Parameters {
    device: String,
    pairs: Vec<(String, String)>,
}

impl Parameters {
    /// Splits `key=value,key=value` (or nothing). Every key must be one of `known` and stand there once;
    /// a misspelt one is answered with its nearest neighbour.
    pub fn parse(device: &str, text: &str, known: &[&str]) -> Result<Self, DeviceError> {
        let refuse = |why: String| DeviceError::new(device, why, ErrorKind::Refused);
        let mut pairs: Vec<(String, String)> = Vec::new();
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (key, text) = part
                .split_once('=')
                .ok_or_else(|| refuse(format!("parameter \"{part}\": must be key=value, e.g. frames=90")))?;
            let key = key.trim();
            if !known.contains(&key) {
                let hint = nearest(key, known).map(|k| format!("did you mean \"{k}\"? ")).unwrap_or_default();
                return Err(refuse(format!(
                    "unknown parameter \"{key}\": {hint}Known: {}",
                    known.join(", ")
                )));
            }
            if pairs.iter().any(|(k, _)| k == key) {
                return Err(refuse(format!("parameter \"{key}\" is given twice")));
            }
            pairs.push((key.to_owned(), text.trim().to_owned()));
        }
        Ok(Self { device: device.to_owned(), pairs })
    }

    /// The text of a key.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.pairs.iter().find(|(k, _)| k == key).map(|(_, text)| text.as_str())
    }

    /// The number of a key within a range, or `default` where it is not given.
    pub fn number<T>(&self, key: &str, default: T, low: T, high: T, unit: &str) -> Result<T, DeviceError>
    where
        T: FromStr + PartialOrd + Display + Copy,
    {
        let Some(text) = self.text(key) else { return Ok(default) };
        let number: Option<T> = text.parse().ok();
        number
            .filter(|n| *n >= low && *n <= high)
            .ok_or_else(|| self.refuse(key, text, &format!("must be a number within {low}..={high}{unit}")))
    }

    /// An error about one key.
    pub fn refuse(&self, key: &str, text: &str, allowed: &str) -> DeviceError {
        DeviceError::new(&self.device, format!("{key} = {text}: {allowed}"), ErrorKind::Refused)
    }
}

/// The known word that differs in the fewest letters; `None` where none is near.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    known.iter().map(|k| (distance(word, k), *k)).min().filter(|(d, k)| *d <= 1 + k.len() / 3).map(|(_, k)| k)
}

/// Edit distance: insertions, deletions and changes of one letter.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(row[j] + 1).min(row[j + 1] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [&str; 3] = ["frames", "seed", "size"];

    #[test]
    fn good_names_are_read() {
        let p = Parameters::parse("synthetic:", " frames=9, seed=2 ", &KNOWN).unwrap();
        assert_eq!(p.number("frames", 1u64, 1, 10, "").unwrap(), 9);
        assert_eq!(p.number("size", 5u64, 1, 10, "").unwrap(), 5);
        assert_eq!(p.text("seed"), Some("2"));
    }

    #[test]
    fn bad_names_say_what_is_wrong_and_what_is_allowed() {
        let error = |text: &str| Parameters::parse("d", text, &KNOWN).unwrap_err();
        assert_eq!(error("frmes=3").kind, ErrorKind::Refused);
        assert!(error("frmes=3").to_string().contains("did you mean \"frames\""));
        assert!(error("zebra=3").to_string().contains("Known: frames, seed, size"));
        assert!(error("frames").to_string().contains("key=value"));
        assert!(error("seed=1,seed=2").to_string().contains("twice"));
        let p = Parameters::parse("d", "frames=0,seed=x", &KNOWN).unwrap();
        let low = p.number("frames", 1u64, 1, 10, " frames").unwrap_err().to_string();
        assert!(low.contains("frames = 0") && low.contains("1..=10 frames"), "{low}");
        assert!(p.number("seed", 1u64, 0, 10, "").is_err());
    }

    #[test]
    fn distance_is_an_edit_distance() {
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("", "abc"), 3);
        assert_eq!(distance("same", "same"), 0);
    }
}
