//! What the room's surfaces look like: diffuse albedo, linear RGB, as a function of the place.

use super::random::{noise, uniform};
use glam::{DVec2, DVec3};

/// Side of the tag's black square, metres.
pub const TAG_SIDE_M: f64 = 0.10;
/// Side of the white paper that the tag is printed on, metres.
pub const PAPER_SIDE_M: f64 = 0.15;
/// Side of the board that stands on the table in the view of the room, and of the black square on it, metres.
pub const BOARD_SIDE_M: f64 = 0.32;
/// Side of its black square.
pub const BOARD_TAG_SIDE_M: f64 = 0.24;
/// The code of tag36h11 number 0: 36 bits, the first one highest.
const TAG_CODE: u64 = 0xd_7e00_984b;
const BLACK_INK: DVec3 = DVec3::new(0.035, 0.035, 0.038);
const WHITE_PAPER: DVec3 = DVec3::new(0.80, 0.80, 0.79);

/// How a surface is painted.
#[derive(Clone, Copy, Debug)]
pub enum Paint {
    /// One colour.
    Plain(DVec3),
    /// One colour, mottled by this share.
    Mottled(DVec3, f64),
    /// The table's top: boards along x, and the paper with the tag at the origin.
    TableTop,
    /// The same boards without the tag.
    BareTable,
    /// A white square with the tag on it, seen upright from the smaller y; the back is white.
    TagBoard,
    /// Boards; width and length in metres, light and dark tone.
    Boards(f64, f64, DVec3, DVec3),
    /// A wall with a skirting board at its foot.
    Wall(DVec3),
    /// A woven carpet with a border.
    Carpet,
    /// A framed picture; the number chooses the motif.
    Picture(u64),
    /// Rows of books; the number chooses the colours.
    Books(u64),
    /// A book's cover with a title.
    Cover(DVec3, DVec3),
    /// The edges of a book's pages.
    Pages,
    /// Glazed with a stripe at this share of the height.
    Glaze(DVec3, DVec3),
    /// Green to red.
    Apple,
    /// A striped curtain.
    Curtain,
}

impl Paint {
    /// Albedo at a point of a face: uv in [0, 1], the face's lengths in metres, and the point in the world.
    pub fn albedo(&self, uv: DVec2, size: DVec2, point: DVec3) -> DVec3 {
        let at = uv * size;
        match *self {
            Self::Plain(rgb) => rgb,
            Self::Mottled(rgb, share) => {
                rgb * (1.0 + share * (2.0 * fine(7, at.x * 90.0, at.y * 90.0) - 1.0))
            }
            Self::TableTop => table_top(point),
            Self::BareTable => bare_table(point.truncate()),
            Self::TagBoard => {
                let from_middle = (uv - 0.5) * size;
                paper(DVec2::new(from_middle.x, -from_middle.y), BOARD_TAG_SIDE_M)
            }
            Self::Boards(width, length, light, dark) => boards(point.truncate(), width, length, light, dark),
            Self::Wall(rgb) => {
                if at.y < 0.07 {
                    DVec3::new(0.62, 0.60, 0.56)
                } else {
                    rgb * (0.97 + 0.06 * fine(11, at.x * 25.0, at.y * 25.0))
                }
            }
            Self::Carpet => carpet(at, size),
            Self::Picture(motif) => picture(motif, uv, at, size),
            Self::Books(seed) => books(seed, at, size),
            Self::Cover(rgb, accent) => cover(rgb, accent, uv),
            Self::Pages => {
                DVec3::new(0.70, 0.66, 0.56) * (0.88 + 0.12 * noise(17, at.x * 3.0, at.y * 1500.0))
            }
            Self::Glaze(rgb, stripe) => {
                if (0.62..0.72).contains(&uv.y) || (0.76..0.785).contains(&uv.y) {
                    stripe
                } else {
                    rgb
                }
            }
            Self::Apple => {
                let blush = noise(23, point.x * 60.0 + point.z * 25.0, point.y * 60.0);
                let ripe = (0.35 + 0.5 * (1.0 - uv.y) + 0.35 * (blush - 0.5)).clamp(0.0, 1.0);
                let skin = DVec3::new(0.36, 0.40, 0.07).lerp(DVec3::new(0.46, 0.035, 0.025), ripe);
                if uv.y < 0.06 { DVec3::new(0.10, 0.06, 0.03) } else { skin }
            }
            Self::Curtain => {
                let fold = 0.5 + 0.5 * (at.x * 75.0 + 1.3 * (at.y * 1.7).sin()).sin();
                DVec3::new(0.50, 0.44, 0.36) * (0.72 + 0.28 * fold)
            }
        }
    }
}

/// Whether a cell of the tag (column and row from the upper left, 8 by 8 with the black border) is white.
pub fn tag_cell_is_white(column: usize, row: usize) -> bool {
    if !(1..=6).contains(&column) || !(1..=6).contains(&row) {
        return false;
    }
    // The code runs through one quarter of the square and then through the same quarter turned by 90 degrees.
    const QUARTER: [(usize, usize); 9] =
        [(1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (2, 2), (3, 2), (4, 2), (3, 3)];
    (0..36).any(|bit| {
        let (mut x, mut y) = QUARTER[bit % 9];
        for _ in 0..bit / 9 {
            (x, y) = (7 - y, x);
        }
        (x, y) == (column, row) && TAG_CODE >> (35 - bit) & 1 == 1
    })
}

fn tag_whites() -> &'static [bool; 64] {
    static CELLS: std::sync::OnceLock<[bool; 64]> = std::sync::OnceLock::new();
    CELLS.get_or_init(|| std::array::from_fn(|i| tag_cell_is_white(i % 8, i / 8)))
}

fn table_top(point: DVec3) -> DVec3 {
    let p = point.truncate();
    if p.x.abs() < PAPER_SIDE_M / 2.0 && p.y.abs() < PAPER_SIDE_M / 2.0 {
        // The tag's picture has x to the right and y down; the world's y points up in it.
        return paper(DVec2::new(p.x, -p.y), TAG_SIDE_M);
    }
    bare_table(p)
}

/// White paper with the tag in the middle; `at` is x to the right and y down from there, metres.
fn paper(at: DVec2, side_m: f64) -> DVec3 {
    let cell = (at + side_m / 2.0) * (8.0 / side_m);
    let inside = cell.min_element() >= 0.0 && cell.max_element() < 8.0;
    let black = inside && !tag_whites()[cell.y as usize * 8 + cell.x as usize];
    if black { BLACK_INK } else { WHITE_PAPER }
}

fn bare_table(p: DVec2) -> DVec3 {
    boards(p, 0.125, 1.7, DVec3::new(0.47, 0.32, 0.19), DVec3::new(0.30, 0.185, 0.10))
}

/// Two octaves of noise in [0, 1].
fn fine(seed: u64, x: f64, y: f64) -> f64 {
    0.65 * noise(seed, x, y) + 0.35 * noise(seed + 1, x * 2.7, y * 2.7)
}

fn boards(p: DVec2, width: f64, length: f64, light: DVec3, dark: DVec3) -> DVec3 {
    let row = (p.y / width).floor();
    let shift = uniform([31, row as i64 as u64, 0]) * length;
    let column = ((p.x + shift) / length).floor();
    let tone = uniform([32, row as i64 as u64, column as i64 as u64]);
    let (x, y) = (p.x + 3.1 * tone, p.y + 1.7 * tone);
    // Grain: noise drawn out along the board, bent slowly.
    let bend = 0.012 * noise(33, x * 2.3, y * 5.0);
    let grain = 0.5 * noise(34, x * 4.0, (y + bend) * 170.0) + 0.3 * noise(35, x * 11.0, (y + bend) * 420.0);
    let ring = noise(36, x * 1.1, (y + 2.0 * bend) * 32.0);
    let mix = (0.15 + 0.45 * tone + 0.35 * grain + 0.30 * (ring - 0.5)).clamp(0.0, 1.0);
    let wood = light.lerp(dark, mix);
    let in_row = p.y / width - row;
    let in_column = (p.x + shift) / length - column;
    let gap = in_row.min(1.0 - in_row) * width < 0.0009 || in_column.min(1.0 - in_column) * length < 0.0009;
    if gap { wood * 0.35 } else { wood }
}

fn carpet(at: DVec2, size: DVec2) -> DVec3 {
    let edge = at.min(size - at).min_element();
    let weave = 0.85 + 0.3 * (noise(41, at.x * 260.0, at.y * 260.0) - 0.5);
    let (blue, red, cream) =
        (DVec3::new(0.06, 0.09, 0.20), DVec3::new(0.32, 0.06, 0.05), DVec3::new(0.55, 0.48, 0.36));
    let diamond = ((at.x * 5.0).fract() - 0.5).abs() + ((at.y * 5.0).fract() - 0.5).abs();
    let base = match edge {
        e if e < 0.03 => cream,
        e if e < 0.10 => blue,
        e if e < 0.115 => cream,
        _ if diamond < 0.16 => cream,
        _ if diamond < 0.27 => blue,
        _ => red,
    };
    base * weave
}

fn picture(motif: u64, uv: DVec2, at: DVec2, size: DVec2) -> DVec3 {
    let edge = at.min(size - at).min_element();
    if edge < 0.022 {
        return DVec3::new(0.10, 0.065, 0.035) * (0.8 + 0.4 * noise(51, at.x * 40.0, at.y * 40.0));
    }
    if edge < 0.065 {
        return DVec3::new(0.74, 0.73, 0.70);
    }
    let hue = |k: u64| uniform([52, motif, k]);
    // Layers of hills under a sky.
    let mut color = DVec3::new(0.35 + 0.3 * hue(0), 0.45 + 0.2 * hue(1), 0.60)
        .lerp(DVec3::new(0.75, 0.60 + 0.1 * hue(2), 0.40), (1.1 - uv.y).clamp(0.0, 1.0));
    for layer in 0..4u64 {
        let ridge = 0.72 - 0.16 * layer as f64
            + 0.16 * (noise(53 + motif, uv.x * (3.0 + layer as f64), 9.0 * layer as f64) - 0.5);
        if uv.y < ridge {
            let depth = layer as f64 / 3.0;
            color = DVec3::new(0.40, 0.44, 0.48)
                .lerp(DVec3::new(0.06 + 0.12 * hue(3), 0.13 + 0.10 * hue(4), 0.06 + 0.06 * hue(5)), depth);
        }
    }
    let sun = (uv - DVec2::new(0.3 + 0.4 * hue(6), 0.82)).length();
    if sun < 0.06 { DVec3::new(0.85, 0.72, 0.45) } else { color }
}

fn books(seed: u64, at: DVec2, size: DVec2) -> DVec3 {
    let row_height = 0.33;
    let row = (at.y / row_height).floor();
    let height = at.y - row * row_height;
    let edge = at.min(size - at).min_element();
    if height < 0.025 || edge < 0.025 {
        return DVec3::new(0.34, 0.22, 0.13);
    }
    let spine = (at.x / 0.034 + 0.35 * noise(seed, at.x * 9.0, row * 3.0)).floor();
    let pick = |k: u64| uniform([seed + k, row as i64 as u64, spine as i64 as u64]);
    if height > 0.20 + 0.10 * pick(0) || pick(9) < 0.08 {
        return DVec3::new(0.045, 0.035, 0.03);
    }
    let warm = DVec3::new(0.10 + 0.45 * pick(1), 0.06 + 0.25 * pick(2), 0.04 + 0.18 * pick(3));
    let cool = DVec3::new(0.04 + 0.12 * pick(1), 0.10 + 0.20 * pick(2), 0.12 + 0.35 * pick(3));
    let cloth = if pick(4) < 0.55 { warm } else { cool };
    let label = (height - 0.13 - 0.05 * pick(5)).abs() < 0.012;
    if label { cloth.lerp(DVec3::new(0.75, 0.70, 0.55), 0.7) } else { cloth }
}

fn cover(rgb: DVec3, accent: DVec3, uv: DVec2) -> DVec3 {
    let (x, y) = (uv.x, uv.y);
    let title =
        (0.15..0.85).contains(&x) && ((0.70..0.76).contains(&y) || ((0.60..0.64).contains(&y) && x < 0.62));
    let band = (0.16..0.20).contains(&y);
    let disc = (DVec2::new((x - 0.5) * 0.7, y - 0.40)).length() < 0.11;
    if title || band || disc { accent } else { rgb }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tag_zero_has_its_bits_and_a_black_border() {
        let whites = (0..64).filter(|i| tag_cell_is_white(i % 8, i / 8)).count();
        assert_eq!(whites, TAG_CODE.count_ones() as usize);
        assert!((0..8).all(|i| !tag_cell_is_white(i, 0) && !tag_cell_is_white(7, i)));
        // The first four bits of the code, 1101, run along the upper row.
        assert_eq!([1, 2, 3, 4].map(|x| tag_cell_is_white(x, 1)), [true, true, false, true]);
    }
}
