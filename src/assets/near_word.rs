//! "Did you mean": which known word a mistyped one is.

/// The known word with the fewest edits (insert, delete, replace), if it is near enough to be a slip: at most half of the
/// longer word's length.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let (edits, found) = known.iter().map(|k| (strsim::levenshtein(word, k), *k)).min()?;
    (edits <= word.chars().count().max(found.chars().count()) / 2).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn slips_are_found_and_other_words_are_not() {
        assert_eq!(nearest("ordre", &["order", "threshold"]), Some("order"));
        assert_eq!(nearest("pcf_tap", &["pcf", "pcf_taps"]), Some("pcf_taps"));
        assert_eq!(nearest("zzz", &["order", "threshold"]), None);
        assert_eq!(nearest("zzz", &[]), None);
    }
}
