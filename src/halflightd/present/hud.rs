//! An overlay of text on shown pictures: what was decided on each effect of the frame, under lines that others hand in.

use super::letters::{LETTER, is_ink, rows_of};
use crate::model::image::Rgb8Image;
use crate::plan::{EffectVerdict, FramePlan};
use std::fmt::{Arguments, Write};

/// Columns and rows of a letter's cell.
const CELL: [usize; 2] = [8, 10];
/// Pictures of so many columns have letters of twice the size, of twice as many three times.
const COLUMNS_A_SIZE: usize = 1200;
/// Free pixels around the text, at size 1.
const MARGIN: usize = 4;
/// What is behind the text is darkened to a third.
const DARKEN: u8 = 3;

/// A colour of text.
const WHITE: [u8; 3] = [255, 255, 255];
const GREEN: [u8; 3] = [140, 255, 140];
const GRAY: [u8; 3] = [170, 170, 170];

/// Lines of text; keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Hud {
    text: String,
    /// Where each line ends in the text, and its colour.
    lines: Vec<(usize, [u8; 3])>,
    /// Those that were handed in come first.
    notes: String,
    note_ends: Vec<usize>,
}

impl Hud {
    /// Hands in a line for the next picture.
    pub fn note(&mut self, line: Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.notes.write_fmt(line);
        self.note_ends.push(self.notes.len());
    }

    /// Lays the lines that were handed in, and the decisions on a frame, over a picture; those lines are used up.
    pub fn draw(&mut self, plan: &FramePlan, picture: &mut Rgb8Image) {
        self.text.clear();
        self.lines.clear();
        let mut begin = 0;
        for &end in &self.note_ends {
            self.text.push_str(self.notes.get(begin..end).unwrap_or_default());
            self.lines.push((self.text.len(), WHITE));
            begin = end;
        }
        self.notes.clear();
        self.note_ends.clear();
        for d in &plan.decisions {
            let _ = write!(self.text, "{:<4} {:<17} ", d.verdict.name(), d.effect.name());
            let _ = match d.error_bound {
                0.0 => write!(self.text, "     0"),
                bound if bound.is_finite() => write!(self.text, "{:>5.1}%", 100.0 * bound),
                _ => write!(self.text, "     -"),
            };
            let _ = write!(self.text, " {}", d.reason);
            let colour = match d.verdict {
                EffectVerdict::On => WHITE,
                EffectVerdict::Kept => GREEN,
                EffectVerdict::Off => GRAY,
            };
            self.lines.push((self.text.len(), colour));
        }
        self.lay_over(picture);
    }

    fn lay_over(&self, picture: &mut Rgb8Image) {
        let (width, height) = (picture.width(), picture.height());
        let size = 1 + width / COLUMNS_A_SIZE;
        let margin = MARGIN * size;
        let longest = (width.saturating_sub(2 * margin)) / (CELL[0] * size);
        let columns = self.texts().map(|(line, _)| line.chars().count()).max().unwrap_or(0).min(longest);
        let dark = [2 * margin + columns * CELL[0] * size, 2 * margin + self.lines.len() * CELL[1] * size];
        let rows = picture.pixels_mut().chunks_exact_mut(width.max(1));
        for row in rows.take(dark[1].min(height)) {
            row.iter_mut().take(dark[0]).for_each(|pixel| *pixel = pixel.map(|c| c / DARKEN));
        }
        for (number, (line, colour)) in self.texts().enumerate() {
            let top = margin + number * CELL[1] * size;
            for (column, letter) in line.chars().take(columns).enumerate() {
                let left = margin + column * CELL[0] * size;
                set(picture, letter, [left, top], size, colour);
            }
        }
    }

    fn texts(&self) -> impl Iterator<Item = (&str, [u8; 3])> {
        let begins = std::iter::once(0).chain(self.lines.iter().map(|(end, _)| *end));
        begins
            .zip(&self.lines)
            .map(|(begin, (end, colour))| (self.text.get(begin..*end).unwrap_or_default(), *colour))
    }
}

/// Sets one letter; what lies outside of the picture is cut off.
fn set(picture: &mut Rgb8Image, letter: char, [left, top]: [usize; 2], size: usize, colour: [u8; 3]) {
    let rows = rows_of(letter);
    let (width, height) = (picture.width(), picture.height());
    for y in 0..LETTER[1] * size {
        for x in 0..LETTER[0] * size {
            if is_ink(rows[y / size], x / size) && left + x < width && top + y < height {
                *picture.at_mut(left + x, top + y) = colour;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{Decision, Effect};

    /// What is white in a picture, row by row.
    fn ink(picture: &Rgb8Image, colour: [u8; 3]) -> Vec<String> {
        let row = |y| picture.row(y).iter().map(|p| if *p == colour { '#' } else { '.' }).collect();
        (0..picture.height()).map(row).collect()
    }

    #[test]
    fn a_line_is_set_where_it_belongs() {
        let mut hud = Hud::default();
        hud.note(format_args!("{}", "t1"));
        let mut picture = Rgb8Image::filled(32, 18, [90, 60, 30]);
        hud.draw(&FramePlan::default(), &mut picture);
        let ink = ink(&picture, WHITE);
        assert_eq!(&ink[4][4..20], dots("t1", 0));
        assert_eq!(&ink[10][4..20], dots("t1", 6));
        // Two cells with their margin are darkened, the rest is as it was.
        assert_eq!(
            (*picture.at(0, 0), *picture.at(23, 0), *picture.at(24, 0)),
            ([30, 20, 10], [30, 20, 10], [90, 60, 30])
        );
        // A line is used up with its picture.
        let mut next = Rgb8Image::filled(32, 18, [90, 60, 30]);
        hud.draw(&FramePlan::default(), &mut next);
        assert!(self::ink(&next, WHITE).concat().find('#').is_none());
    }

    /// One row of dots of a text.
    fn dots(text: &str, row: usize) -> String {
        let columns = |letter| {
            let ink = rows_of(letter)[row];
            (0..LETTER[0]).map(move |x| if is_ink(ink, x) { '#' } else { '.' })
        };
        text.chars().flat_map(columns).collect()
    }

    #[test]
    fn no_picture_is_too_small() {
        let decision = |effect| Decision {
            effect,
            verdict: EffectVerdict::Kept,
            reason: "why not",
            saving: 1.0,
            error_bound: f32::INFINITY,
        };
        let plan = FramePlan { decisions: Effect::ALL.map(decision).to_vec(), ..FramePlan::default() };
        for (width, height) in [(0, 0), (1, 1), (7, 200), (200, 7), (2000, 40)] {
            let mut picture = Rgb8Image::filled(width, height, [9; 3]);
            Hud::default().draw(&plan, &mut picture);
            assert_eq!((picture.width(), picture.height()), (width, height));
            let has_ink = picture.pixels().contains(&GREEN);
            assert_eq!(has_ink, width >= 200, "{width} {height}");
        }
    }
}
