//! Pictures that no engine draws: the light in four panels, the shadow maps side by side.

use crate::light::maps::equirect_of_samples;
use crate::math::{
    color::{luminance, srgb_encode},
    sh::{MAX_COEFFICIENTS, basis::evaluate},
    sphere,
};
use crate::model::{
    image::RadianceImage,
    light::{HardLight, Lights, RadianceSamples},
    picture::Picture,
};
use crate::visibility::shadow_maps::{EMPTY_DEPTH, ShadowMapSet};
use glam::DVec3;

/// Pixels between panels.
const GAP: usize = 4;
const FRAME: [f32; 3] = [0.02; 3];
/// Of maps where nothing is, and of the mark around a hard light.
const EMPTY: [f32; 3] = [0.01, 0.02, 0.06];
const MARK: [f32; 3] = [1.0, 0.12, 0.02];
/// Radius of a hard light's spot, radians, and of the mark around it, pixels.
const SPOT_RAD: f64 = 0.035;
const MARK_PX: f64 = 5.0;
/// Where negative radiance of the soft half shows, in blue.
const NEGATIVE: [f32; 3] = [0.02, 0.1, 0.8];

/// The light in four equirectangular panels (the top is +z, the middle +x): as measured (black where it was not) and
/// all of it in SH, above; the hard half, marked, and the soft half, below. Bright places are pressed together,
/// x/(1+x), with x = 1 where nine tenths of the measured light lie below; where the harmonics are negative it is blue.
pub fn light(samples: &RadianceSamples, light: &Lights, size: [usize; 2], out: &mut Picture) {
    let [width, height] = size;
    let rows = ((width.saturating_sub(3 * GAP)) / 4).min(height.saturating_sub(3 * GAP) / 2);
    out.radiance.reshape(width, height, FRAME);
    out.radiance.pixels_mut().fill(FRAME);
    if rows > 0 {
        let columns = 2 * rows;
        let left = (width - (2 * columns + GAP)) / 2;
        let top = (height - (2 * rows + GAP)) / 2;
        let measured = equirect_of_samples(samples, rows);
        let hard = light.hard.as_slice();
        let white = white_of(light, measured.as_ref());
        let place = |k: usize| [left + (k % 2) * (columns + GAP), top + (k / 2) * (rows + GAP)];
        for y in 0..rows {
            for x in 0..columns {
                let direction = sphere::equirect_direction(
                    (x as f64 + 0.5) / columns as f64,
                    (y as f64 + 0.5) / rows as f64,
                );
                let mut basis = [0.0; MAX_COEFFICIENTS];
                evaluate(light.global.order, direction.as_vec3().to_array(), &mut basis);
                let soft = sum(light.global.rows(), &basis);
                let panels = [
                    measured.as_ref().map_or([0.0; 3], |picture| *picture.at(x, y)),
                    std::array::from_fn(|c| soft[c] + in_sh(hard, light.global.order, &basis)[c]),
                    spot(hard, direction).map(|e| 12.0 * e * white),
                    soft,
                ];
                for (k, radiance) in panels.into_iter().enumerate() {
                    let [x0, y0] = place(k);
                    let dark = luminance(radiance) < 0.0;
                    *out.radiance.at_mut(x0 + x, y0 + y) = if dark {
                        let depth = (-luminance(radiance) / white).min(1.0);
                        NEGATIVE.map(|c| c * (0.25 + 0.75 * depth))
                    } else {
                        radiance.map(|c| (c / white).max(0.0)).map(|x| x / (1.0 + x))
                    };
                }
            }
        }
        for light in hard {
            for k in [0, 2] {
                mark(light, place(k), [columns, rows], &mut out.radiance);
            }
        }
    }
    show(out);
}

fn sum(rows: &[[f32; 3]], basis: &[f32]) -> [f32; 3] {
    std::array::from_fn(|c| rows.iter().zip(basis).map(|(row, y)| row[c] * y).sum())
}

/// The hard half in as many bands as the soft one: the sum of E_k y(w_k).
fn in_sh(hard: &[HardLight], order: usize, basis: &[f32]) -> [f32; 3] {
    let mut out = [0.0; 3];
    let mut y = [0.0; MAX_COEFFICIENTS];
    for light in hard {
        evaluate(order, light.to_light_world, &mut y);
        let kernel: f32 = y.iter().zip(basis).take(order * order).map(|(a, b)| a * b).sum();
        for (out, e) in out.iter_mut().zip(light.irradiance_rgb) {
            *out += e * kernel;
        }
    }
    out
}

/// Share of the strongest light in a direction: hard lights have no extent, so each is shown as a small disc.
fn spot(hard: &[HardLight], direction: DVec3) -> [f32; 3] {
    let strongest = hard.iter().flat_map(|h| h.irradiance_rgb).fold(0.0f32, f32::max);
    let mut out = [0.0f32; 3];
    for light in hard {
        let to_light = DVec3::from(light.to_light_world.map(f64::from));
        if strongest > 0.0 && direction.dot(to_light) > SPOT_RAD.cos() {
            for (out, e) in out.iter_mut().zip(light.irradiance_rgb) {
                // The root lets faint lights of many be seen beside the strongest.
                *out = out.max((e / strongest).max(0.0).sqrt());
            }
        }
    }
    out
}

/// What nine tenths of the measured light stay below; the mean of the soft half, where none was measured.
fn white_of(light: &Lights, measured: Option<&RadianceImage>) -> f32 {
    let mut all: Vec<f32> = match measured {
        Some(picture) => picture.pixels().iter().map(|c| luminance(*c)).collect(),
        None => vec![luminance(light.global.rgb[0]).max(0.0) / (4.0 * std::f32::consts::PI).sqrt()],
    };
    all.sort_unstable_by(f32::total_cmp);
    let bright = all.get(all.len() * 9 / 10).or(all.last()).copied().unwrap_or(0.0);
    if bright > 0.0 && bright.is_finite() { bright } else { 1.0 }
}

/// A ring around a light's place in a panel; it wraps from side to side.
fn mark(light: &HardLight, [x0, y0]: [usize; 2], [columns, rows]: [usize; 2], out: &mut RadianceImage) {
    let (u, v) = sphere::equirect_uv(DVec3::from(light.to_light_world.map(f64::from)));
    let (cx, cy) = (u * columns as f64, v * rows as f64);
    let reach = MARK_PX as i64 + 2;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (x, y) = (cx.floor() as i64 + dx, cy.floor() as i64 + dy);
            let radius = (x as f64 + 0.5 - cx).hypot(y as f64 + 0.5 - cy);
            if (radius - MARK_PX).abs() < 0.7 && (0..rows as i64).contains(&y) {
                *out.at_mut(x0 + x.rem_euclid(columns as i64) as usize, y0 + y as usize) = MARK;
            }
        }
    }
}

/// Depths of all shadow maps in one sheet, in their order, each cut to what is in it: near white, far gray, blue where
/// nothing is.
pub fn maps(shadows: &ShadowMapSet, size: [usize; 2], out: &mut Picture) {
    let [width, height] = size;
    out.radiance.reshape(width, height, FRAME);
    out.radiance.pixels_mut().fill(FRAME);
    let count = shadows.cameras().len();
    let side = |columns: usize| {
        let rows = count.div_ceil(columns);
        (width / columns).min(height / rows).saturating_sub(GAP)
    };
    if let Some(columns) = (1..=count).max_by_key(|&columns| (side(columns), columns)) {
        let (side, rows) = (side(columns), count.div_ceil(columns));
        let left = width.saturating_sub(columns * (side + GAP)) / 2;
        let top = height.saturating_sub(rows * (side + GAP)) / 2;
        for (k, camera) in shadows.cameras().iter().enumerate() {
            let texels = camera.as_ref().map_or(0, |c| c.texels as usize);
            let depth = shadows.depth(k);
            let square = filled(depth, texels);
            let (x0, y0) = (left + (k % columns) * (side + GAP), top + (k / columns) * (side + GAP));
            for y in 0..side {
                for x in 0..side {
                    let nearest = nearest(depth, texels, square, side, [x, y]);
                    *out.radiance.at_mut(x0 + x, y0 + y) =
                        if nearest < EMPTY_DEPTH { [0.9 - 0.75 * nearest.max(0.0); 3] } else { EMPTY };
                }
            }
        }
    }
    show(out);
}

/// The square of texels that holds all that a map has drawn: its first column, first row, and side; 0 where it is empty.
fn filled(depth: &[f32], texels: usize) -> [usize; 3] {
    let (mut low, mut high) = ([texels; 2], [0; 2]);
    for (i, _) in depth.iter().enumerate().filter(|(_, d)| **d < EMPTY_DEPTH) {
        for (axis, at) in [i % texels.max(1), i / texels.max(1)].into_iter().enumerate() {
            low[axis] = low[axis].min(at);
            high[axis] = high[axis].max(at + 1);
        }
    }
    if low[0] >= high[0] {
        return [0; 3];
    }
    let side = (high[0] - low[0]).max(high[1] - low[1]);
    // An eighth of a margin, as far as the map has it.
    let side = (side + side / 4).min(texels);
    let first = |axis: usize| ((low[axis] + high[axis]) / 2).saturating_sub(side / 2).min(texels - side);
    [first(0), first(1), side]
}

/// The least depth of the texels under a pixel of a tile that shows a square of them.
fn nearest(
    depth: &[f32],
    texels: usize,
    [column, row, square]: [usize; 3],
    side: usize,
    at: [usize; 2],
) -> f32 {
    let span = |i: usize, begin: usize| {
        let first = i * square / side;
        begin + first..begin + ((i + 1) * square / side).max(first + 1).min(square)
    };
    let mut least = EMPTY_DEPTH;
    for row in span(at[1], row) {
        for column in span(at[0], column) {
            least = least.min(depth.get(row * texels + column).copied().unwrap_or(EMPTY_DEPTH));
        }
    }
    least
}

fn show(out: &mut Picture) {
    let (width, height) = (out.radiance.width(), out.radiance.height());
    out.display.reshape(width, height, [0; 3]);
    for (display, radiance) in out.display.pixels_mut().iter_mut().zip(out.radiance.pixels()) {
        *display = radiance.map(|c| (255.0 * srgb_encode(c.clamp(0.0, 1.0))).round() as u8);
    }
}
