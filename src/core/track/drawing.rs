//! Draws tags for tests.

use crate::model::image::Image;
use glam::{DMat3, DVec2, DVec3};

/// Codes of tag36h11, ids 0 to 2.
const CODES: [u64; 3] = [0x0000_000d_7e00_984b, 0x0000_000d_da66_4ca7, 0x0000_000d_c4a1_c821];
/// Cells of one quarter of the ring and square spirals in which the bits are laid out (column, row), from the
/// highest bit on; the other quarters follow by turning about the middle.
const QUARTER: [(i32, i32); 9] = [(1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (2, 2), (3, 2), (4, 2), (3, 3)];

/// Whether the cell (0..8 within the black square) is white.
pub fn cell_is_white(id: usize, column: i32, row: i32) -> bool {
    (0..36).any(|bit| {
        let (mut x, mut y) = QUARTER[bit % 9];
        for _ in 0..bit / 9 {
            (x, y) = (7 - y, x);
        }
        (x, y) == (column, row) && CODES[id] >> (35 - bit) & 1 == 1
    })
}

/// Corners, in the library's order, of an upright square turned by `angle_rad` (clockwise as seen).
pub fn corners_of(middle_px: DVec2, side_px: f64, angle_rad: f64) -> [DVec2; 4] {
    [(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)]
        .map(|(x, y)| middle_px + DVec2::from_angle(angle_rad).rotate(DVec2::new(x, y) * side_px))
}

/// Draws a tag with its white rim on gray, box-filtered over 8x8 samples a pixel; `encode` maps linear light
/// (white 0.9, gray 0.45, black 0.04) to 0..=1.
pub fn draw(
    width: usize,
    height: usize,
    id: usize,
    corners_px: &[DVec2; 4],
    encode: impl Fn(f64) -> f64,
) -> Image<u8> {
    let light = draw_light(width, height, id, corners_px, [0.9, 0.45, 0.04]);
    let mut gray = Image::filled(width, height, 0u8);
    for (gray, light) in gray.pixels_mut().iter_mut().zip(light.pixels()) {
        *gray = (encode(*light).clamp(0.0, 1.0) * 255.0).round() as u8;
    }
    gray
}

/// The same in linear light, with the light of white, of what lies beyond the rim, and of black.
pub fn draw_light(
    width: usize,
    height: usize,
    id: usize,
    corners_px: &[DVec2; 4],
    [white, beyond, black]: [f64; 3],
) -> Image<f64> {
    let homography = super::tag_pose::homography_from_square(corners_px).expect("a proper square");
    let tag_from_pixel: DMat3 = homography.inverse();
    let cells: [[bool; 8]; 8] =
        std::array::from_fn(|row| std::array::from_fn(|column| cell_is_white(id, column as i32, row as i32)));
    let linear = |p: DVec2| {
        let q = tag_from_pixel * DVec3::new(p.x, p.y, 1.0);
        // Tag coordinates: the black square is -1..1, y down.
        let (x, y) = (q.x / q.z, q.y / q.z);
        if x.abs().max(y.abs()) > 1.25 {
            return beyond;
        }
        let (column, row) = (((x + 1.0) * 4.0).floor() as i32, ((y + 1.0) * 4.0).floor() as i32);
        let inside = (0..8).contains(&column) && (0..8).contains(&row);
        if !inside || cells[row as usize][column as usize] { white } else { black }
    };
    let mut light = Image::filled(width, height, 0.0);
    for j in 0..height {
        for i in 0..width {
            let mut sum = 0.0;
            for s in 0..64 {
                let p = DVec2::new((s % 8) as f64 + 0.5, (s / 8) as f64 + 0.5) / 8.0;
                sum += linear(DVec2::new(i as f64, j as f64) + p);
            }
            *light.at_mut(i, j) = sum / 64.0;
        }
    }
    light
}
