//! The exact light at the ball's centre.

use super::room::{SyntheticBallView, SyntheticRoom};
use crate::math::color::gray;
use crate::math::sh::{MAX_COEFFICIENTS, MAX_ORDER, basis};
use crate::model::light::RadianceSh;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

const COLUMNS: usize = 512;
const ROWS: usize = 256;
/// A texel whose corners differ by more than this ratio is divided.
const CONTRAST: f64 = 1.05;
/// Parts along each side of a divided texel.
const PARTS: usize = 8;

/// Light at the ball's centre as used to light a virtual object on the table: above the horizon the room
/// without the ball, below it the table as if the ball had never been there (and only the table, not what
/// stands on it); beside the table, what is seen there. Order 6, world frame.
///
/// Rays over an equirectangular grid with the exact solid angle of each part; texels with an edge in them
/// are divided 8 by 8. Sums run row by row and then over the rows, so threads change nothing.
pub fn light_at_ball(room: &SyntheticRoom) -> RadianceSh {
    let origin = room.ball().centre_world;
    let look = |theta: f64, phi: f64| {
        let (s, c) = theta.sin_cos();
        let d = DVec3::new(s * phi.cos(), s * phi.sin(), c);
        (radiance(room, origin, d), d)
    };
    let rows: Vec<[DVec3; MAX_COEFFICIENTS]> = (0..ROWS)
        .into_par_iter()
        .map(|row| {
            let mut sum = [DVec3::ZERO; MAX_COEFFICIENTS];
            let (top, bottom) = (PI * row as f64 / ROWS as f64, PI * (row + 1) as f64 / ROWS as f64);
            for column in 0..COLUMNS {
                let left = TAU * column as f64 / COLUMNS as f64 - PI;
                let width = TAU / COLUMNS as f64;
                let corners = [(0.02, 0.02), (0.98, 0.02), (0.02, 0.98), (0.98, 0.98), (0.5, 0.5)]
                    .map(|(u, v)| look(top + v * (bottom - top), left + u * width).0.element_sum());
                let low = corners.iter().copied().fold(f64::INFINITY, f64::min);
                let high = corners.iter().copied().fold(0.0, f64::max);
                let parts = if high > CONTRAST * low { PARTS } else { 2 };
                for j in 0..parts {
                    let step = (bottom - top) / parts as f64;
                    let (a, b) = (top + step * j as f64, top + step * (j + 1) as f64);
                    for i in 0..parts {
                        let wide = width / parts as f64;
                        let (l, d) = look((a + b) / 2.0, left + wide * (i as f64 + 0.5));
                        let weighted = l * ((a.cos() - b.cos()) * wide);
                        let mut y = [0.0; MAX_COEFFICIENTS];
                        basis::evaluate(MAX_ORDER, d.to_array(), &mut y);
                        for (slot, y) in sum.iter_mut().zip(y) {
                            *slot += weighted * y;
                        }
                    }
                }
            }
            sum
        })
        .collect();
    let mut light = RadianceSh::zero(MAX_ORDER);
    for (k, slot) in light.rgb.iter_mut().enumerate() {
        *slot = rows.iter().map(|row| row[k]).sum::<DVec3>().as_vec3().to_array();
    }
    light
}

/// Radiance of the place as defined for the truth.
pub fn radiance(room: &SyntheticRoom, origin: DVec3, d: DVec3) -> DVec3 {
    if d.z < 0.0 {
        let foot = origin.truncate() - d.truncate() * (origin.z / d.z);
        if let Some(table) = foot.is_finite().then_some(foot).and_then(|p: DVec2| room.bare_table_radiance(p))
        {
            return table;
        }
    }
    room.radiance(origin, d, SyntheticBallView::Absent).0
}

/// The unit vector of the first moment of the gray light (Eq. 9 of [Now11]).
pub fn dominant_direction(light: &RadianceSh) -> [f32; 3] {
    let gray = |k: usize| gray(light.rgb[k].map(f64::from));
    DVec3::new(-gray(3), -gray(1), gray(2)).normalize_or(DVec3::Z).as_vec3().to_array()
}
