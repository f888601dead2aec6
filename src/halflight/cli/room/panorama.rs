//! Panoramas of a room's patches.

use crate::math::color::{luminance, srgb_encode};
use crate::math::sphere;
use crate::model::image::{Image, Rgb8Image};
use crate::nearfield::{faces::Faces, prepare::KnownRoom};
use glam::Vec3;
use rayon::prelude::*;

/// Rays of a pixel, a side.
const SIDE: usize = 2;
/// Lines between patches keep this share of the light.
const LINE: f32 = 0.55;
/// The median of what is seen is shown this bright (linear).
const MIDDLE: f32 = 0.18;

/// What a ray met.
#[derive(Clone, Copy)]
struct PatchHit {
    patch: u32,
    is_front: bool,
    corners: [u32; 3],
    weights: [f32; 3],
}

/// What every ray of a panorama meets.
pub struct Panorama {
    width: usize,
    height: usize,
    seen: Vec<Option<PatchHit>>,
}

impl Panorama {
    /// From a place, `rows` pixels high and twice as wide; the middle looks to +x, left of it is +y.
    pub fn new(known: &KnownRoom, from: Vec3, rows: usize) -> Self {
        let faces = Faces::of_patches(&known.field.patches);
        let (width, height) = (2 * rows * SIDE, rows * SIDE);
        let seen = (0..width * height)
            .into_par_iter()
            .map(|k| {
                let (u, v) =
                    (((k % width) as f64 + 0.5) / width as f64, ((k / width) as f64 + 0.5) / height as f64);
                let met = faces.first(from, sphere::equirect_direction(1.0 - u, v).as_vec3())?;
                let corners = faces.corners(met.triangle);
                Some(PatchHit { patch: met.index, is_front: met.is_front, corners, weights: met.barycentric })
            })
            .collect();
        Self { width, height, seen }
    }

    /// Radiance, gathered light, reflectance, and what is known.
    pub fn draw(&self, known: &KnownRoom, with_camera: bool) -> [Rgb8Image; 4] {
        let field = &known.field;
        let patch = |s: &PatchHit| &field.patches.patches[s.patch as usize];
        let radiance = |s: &PatchHit| patch(s).radiance_rgb;
        let gathered = |s: &PatchHit| {
            let mut sum = [0.0f32; 3];
            for (&corner, weight) in s.corners.iter().zip(s.weights) {
                let (near, sun) = (field.gathered_rgb[corner as usize], known.sun_rgb[corner as usize]);
                (0..3).for_each(|c| sum[c] += weight * (near[c] + sun[c]));
            }
            sum
        };
        let (bright, arriving) = (self.exposure(&radiance), self.exposure(&gathered));
        let known_rgb = |s: &PatchHit| {
            let measured = !with_camera || known.reflectance_measured[s.patch as usize];
            let [r, g, b]: [f32; 3] =
                if patch(s).seen || known.report.probe.is_none() { [0.6; 3] } else { [0.6, 0.1, 0.1] };
            if measured { [r, g, b] } else { [0.6 * r, 0.8 * g, b.max(0.5)] }
        };
        [
            self.picture(&|s| compressed(radiance(s), bright)),
            self.picture(&|s| compressed(gathered(s), arriving)),
            self.picture(&|s| patch(s).reflectance_rgb),
            self.picture(&known_rgb),
        ]
    }

    /// Brings the median of what is lit to a middle grey; 1 where nothing is.
    fn exposure(&self, of: &dyn Fn(&PatchHit) -> [f32; 3]) -> f32 {
        let lit = self.seen.iter().flatten().filter(|s| s.is_front).map(|s| luminance(of(s)));
        let mut list: Vec<f32> = lit.filter(|l| *l > 0.0).collect();
        list.sort_unstable_by(f32::total_cmp);
        list.get(list.len() / 2).map_or(1.0, |median| MIDDLE / median)
    }

    /// Backs are dark blue, nothing is black; lines where neighbours belong to different patches.
    fn picture(&self, of: &(dyn Fn(&PatchHit) -> [f32; 3] + Sync)) -> Rgb8Image {
        let ray = |x: usize, y: usize| self.seen[y * self.width + x % self.width];
        let colour = |x: usize, y: usize| {
            let Some(seen) = ray(x, y) else { return [0.0; 3] };
            if !seen.is_front {
                return [0.0, 0.0, 0.08];
            }
            let index = |s: Option<PatchHit>| s.map(|s| s.patch);
            let below = ray(x, (y + 1).min(self.height - 1));
            let edge = index(ray(x + 1, y)) != Some(seen.patch) || index(below) != Some(seen.patch);
            of(&seen).map(|c| if edge { LINE * c } else { c })
        };
        let (width, height) = (self.width / SIDE, self.height / SIDE);
        let mut image = Image::filled(width, height, [0u8; 3]);
        image.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let mut sum = [0.0f32; 3];
                for k in 0..SIDE * SIDE {
                    let rgb = colour(column * SIDE + k % SIDE, row * SIDE + k / SIDE);
                    (0..3).for_each(|c| sum[c] += rgb[c].clamp(0.0, 1.0) / (SIDE * SIDE) as f32);
                }
                *pixel = sum.map(|c| (srgb_encode(c) * 255.0).round() as u8);
            }
        });
        image
    }
}

/// Bright colours nearer to 1 without changing their hue.
fn compressed(rgb: [f32; 3], exposure: f32) -> [f32; 3] {
    let shown = rgb.map(|c| c * exposure);
    let bright = luminance(shown);
    shown.map(|c| c * (1.0 + bright / 16.0) / (1.0 + bright))
}
