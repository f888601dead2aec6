//! A contact sheet: evenly spread pictures, reduced, side by side.

use crate::model::image::{Image, Rgb8Image};

/// Columns of the sheet.
const COLUMNS: usize = 4;
/// Pictures on the sheet at most.
const TILES: usize = 12;
/// Pixels between tiles.
const GAP: usize = 4;

/// Collects pictures for a sheet without keeping all of them: every time it is full, every other one goes.
#[derive(Default)]
pub struct ContactSheet {
    tiles: Vec<Rgb8Image>,
    every: usize,
    seen: usize,
}

impl ContactSheet {
    /// Counts one more, and keeps it at half its size where its turn comes.
    pub fn offer(&mut self, picture: &Rgb8Image) {
        self.every = self.every.max(1);
        if self.seen.is_multiple_of(self.every) {
            self.tiles.push(halved(picture));
            if self.tiles.len() > 2 * TILES {
                let mut index = 0;
                self.tiles.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
                self.every *= 2;
            }
        }
        self.seen += 1;
    }

    /// The sheet; `None` without pictures.
    pub fn picture(&self) -> Option<Rgb8Image> {
        let count = self.tiles.len().min(TILES);
        let first = self.tiles.first()?;
        let (w, h) = (first.width(), first.height());
        let columns = COLUMNS.min(count);
        let rows = count.div_ceil(columns);
        let mut out = Image::filled(columns * (w + GAP) + GAP, rows * (h + GAP) + GAP, [24; 3]);
        for k in 0..count {
            // Spread over all, the last one included.
            let index = if count > 1 { k * (self.tiles.len() - 1) / (count - 1) } else { 0 };
            let tile = &self.tiles[index];
            let (x0, y0) = (GAP + (k % columns) * (w + GAP), GAP + (k / columns) * (h + GAP));
            for y in 0..tile.height().min(h) {
                for x in 0..tile.width().min(w) {
                    *out.at_mut(x0 + x, y0 + y) = *tile.at(x, y);
                }
            }
        }
        Some(out)
    }
}

/// Half the size, each pixel the mean of four.
fn halved(picture: &Rgb8Image) -> Rgb8Image {
    let (w, h) = ((picture.width() / 2).max(1), (picture.height() / 2).max(1));
    let mut out = Image::filled(w, h, [0; 3]);
    for y in 0..h {
        for x in 0..w {
            let mut sum = [0u16; 3];
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (sx, sy) =
                    ((2 * x + dx).min(picture.width() - 1), (2 * y + dy).min(picture.height() - 1));
                for (s, c) in sum.iter_mut().zip(picture.at(sx, sy)) {
                    *s += u16::from(*c);
                }
            }
            *out.at_mut(x, y) = sum.map(|s| ((s + 2) / 4) as u8);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheet_spans_first_to_last() {
        let mut sheet = ContactSheet::default();
        for i in 0..90u8 {
            sheet.offer(&Image::filled(8, 6, [i, 0, 0]));
        }
        let picture = sheet.picture().unwrap();
        assert_eq!((picture.width(), picture.height()), (4 * (4 + GAP) + GAP, 3 * (3 + GAP) + GAP));
        assert_eq!(picture.at(GAP, GAP)[0], 0);
        let last = picture.at(picture.width() - GAP - 1, picture.height() - GAP - 1)[0];
        assert!(last >= 80, "{last}");
    }

    #[test]
    fn no_pictures_no_sheet() {
        assert!(ContactSheet::default().picture().is_none());
    }
}
