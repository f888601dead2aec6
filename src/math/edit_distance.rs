//! How far apart two words are, for "did you mean".

/// Edits (insert, delete, replace) between two words: Levenshtein's distance.
pub fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let replace = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = replace.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// The nearest of some words, if it is near enough to be a slip (at most half of the longer word's length).
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let (edits, found) = known.iter().map(|k| (edit_distance(word, k), *k)).min()?;
    (edits <= word.chars().count().max(found.chars().count()) / 2).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        assert_eq!(edit_distance("pcf_tap", "pcf_taps"), 1);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(nearest("ordre", &["order", "threshold"]), Some("order"));
        assert_eq!(nearest("zzz", &["order", "threshold"]), None);
    }
}
