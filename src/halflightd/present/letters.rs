//! Letters of 8 x 8 dots, for text over pictures and for captions: the font of the crate `font8x8`.

use font8x8::{UnicodeFonts, legacy::BASIC_LEGACY};

/// Columns and rows of a letter.
pub const LETTER: [usize; 2] = [8, 8];

/// What stands for a letter that the font lacks: a box.
const UNKNOWN: [u8; 8] = [0x7f, 0x41, 0x41, 0x41, 0x41, 0x41, 0x7f, 0];

/// Rows of a letter from the top; the leftmost column is the lowest bit.
pub fn rows_of(letter: char) -> [u8; 8] {
    match usize::try_from(u32::from(letter)) {
        Ok(code) if (0x20..0x7f).contains(&code) => BASIC_LEGACY[code],
        _ => font8x8::LATIN_FONTS.get(letter).unwrap_or(UNKNOWN),
    }
}

/// Whether the dot in that column of a letter's row is ink.
pub fn is_ink(row: u8, column: usize) -> bool {
    column < LETTER[0] && row >> column & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_letter_has_a_shape_of_its_own() {
        let all: Vec<char> = (' '..='~').collect();
        for (k, a) in all.iter().enumerate() {
            for b in &all[k + 1..] {
                assert_ne!(rows_of(*a), rows_of(*b), "{a} {b}");
            }
        }
        assert_ne!(rows_of('a'), rows_of('A'));
        assert!(![UNKNOWN, rows_of('e')].contains(&rows_of('é')));
        assert_eq!(rows_of('漢'), UNKNOWN);
    }

    #[test]
    fn the_lowest_bit_is_on_the_left() {
        // An L has its stem on the left and its foot at the bottom.
        let rows = rows_of('L');
        assert!(is_ink(rows[0], 1) && !is_ink(rows[0], 5));
        assert!(is_ink(rows[6], 1) && is_ink(rows[6], 5));
        assert!(!is_ink(0xff, 8));
    }
}
