//! Pictures side by side with captions.

use crate::model::image::{Image, Rgb8Image};
use crate::present::letters::{self, is_ink, rows_of};

/// Pixels around and between pictures.
const GAP: usize = 12;
const PAPER: [u8; 3] = [250, 250, 248];
const INK: [u8; 3] = [40, 40, 44];
/// A dot of a letter is this many pixels a side.
const DOT: usize = 2;
const LETTER: [usize; 2] = [letters::LETTER[0] * DOT, letters::LETTER[1] * DOT];
const LINE: usize = LETTER[1] + 8;
/// Height of the title.
const TITLE: usize = GAP + LETTER[1] + 16;

/// A figure: a title over rows of captioned pictures.
pub struct FigureSheet {
    title: String,
    columns: usize,
    tiles: Vec<(String, Rgb8Image)>,
}

impl FigureSheet {
    /// An empty one, so many pictures wide.
    pub fn new(title: impl Into<String>, columns: usize) -> Self {
        Self { title: title.into(), columns: columns.max(1), tiles: Vec::new() }
    }

    /// Appends a picture.
    pub fn add(&mut self, caption: impl Into<String>, picture: Rgb8Image) {
        self.tiles.push((caption.into(), picture));
    }

    /// All of it as one picture; every cell has the size of the largest picture.
    pub fn picture(&self) -> Rgb8Image {
        let widest = |of: fn(&Rgb8Image) -> usize| self.tiles.iter().map(|(_, p)| of(p)).max().unwrap_or(0);
        let (w, h) = (widest(Image::width), widest(Image::height));
        let columns = self.columns.min(self.tiles.len().max(1));
        let rows = self.tiles.len().div_ceil(columns);
        let width = (GAP + columns * (w + GAP)).max(2 * GAP + self.title.len() * LETTER[0]);
        let top = TITLE;
        let mut out = Image::filled(width, top + rows * (LINE + h + GAP), PAPER);
        write(&mut out, &self.title, GAP, GAP);
        for (k, (caption, picture)) in self.tiles.iter().enumerate() {
            let (x0, y0) = (GAP + (k % columns) * (w + GAP), top + (k / columns) * (LINE + h + GAP));
            write(&mut out, caption, x0, y0);
            for y in 0..picture.height() {
                for x in 0..picture.width() {
                    *out.at_mut(x0 + x, y0 + LINE + y) = *picture.at(x, y);
                }
            }
        }
        out
    }
}

/// Writes a line from (x, y) on; what leaves the picture is cut off.
fn write(picture: &mut Rgb8Image, line: &str, x: usize, y: usize) {
    for (place, letter) in line.chars().enumerate() {
        for (row, dots) in rows_of(letter).into_iter().enumerate() {
            for column in (0..letters::LETTER[0]).filter(|column| is_ink(dots, *column)) {
                for (dx, dy) in (0..DOT * DOT).map(|k| (k % DOT, k / DOT)) {
                    let (px, py) = (x + place * LETTER[0] + column * DOT + dx, y + row * DOT + dy);
                    if px < picture.width() && py < picture.height() {
                        *picture.at_mut(px, py) = INK;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_and_captions_have_their_places() {
        let mut sheet = FigureSheet::new("t", 2);
        for k in 0..3u8 {
            sheet.add("i", Image::filled(40, 30, [k, 0, 0]));
        }
        let picture = sheet.picture();
        assert_eq!((picture.width(), picture.height()), (3 * GAP + 80, TITLE + 2 * (LINE + 30 + GAP)));
        let (x, y) = (GAP, TITLE + LINE);
        assert_eq!(*picture.at(x, y), [0, 0, 0]);
        assert_eq!(*picture.at(x + 40 + GAP, y + 29), [1, 0, 0]);
        assert_eq!(*picture.at(x, y + 30 + GAP + LINE), [2, 0, 0]);
        // The stem of an i is ink, the corner beside it is paper.
        let stem = (0..letters::LETTER[0]).find(|x| is_ink(rows_of('i')[4], *x)).unwrap();
        assert_eq!(*picture.at(GAP + stem * DOT, TITLE + 4 * DOT), INK);
        assert_eq!(*picture.at(GAP, TITLE + 4 * DOT), PAPER);
        // An empty sheet is a title.
        assert_eq!(FigureSheet::new("", 3).picture().height(), TITLE);
    }
}
