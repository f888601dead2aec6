//! A model with its spheres as two parallel views, drawn by rays.

use crate::math::{bvh::Bvh, color::srgb_encode};
use crate::model::image::{Image, Rgb8Image};
use crate::visibility::fit_spheres::FittedSphere;
use glam::Vec3;
use rayon::prelude::*;

/// Side of one view, pixels.
const VIEW_PX: usize = 480;
/// Samples along each side of a pixel.
const SAMPLES: usize = 2;
const BACKGROUND: Vec3 = Vec3::new(0.9, 0.9, 0.9);
/// How much of a sphere's colour lies over what is behind it.
const TINT: f32 = 0.45;

/// Front (seen along +y, x to the right) and left side (seen along -x, y to the right), side by side.
pub fn draw((positions, triangles): &(Vec<Vec3>, Vec<[u32; 3]>), spheres: &[FittedSphere]) -> Rgb8Image {
    let bvh = Bvh::build(positions, triangles);
    let mut low = Vec3::INFINITY;
    let mut high = Vec3::NEG_INFINITY;
    if let Some((l, h)) = bvh.bounds() {
        (low, high) = (l, h);
    }
    for sphere in spheres {
        low = low.min(sphere.centre - sphere.radius);
        high = high.max(sphere.centre + sphere.radius);
    }
    let middle = (low + high) * 0.5;
    let width = (high - low).max_element().max(1e-12) * 1.06;
    let views = [(Vec3::Y, Vec3::X), (Vec3::NEG_X, Vec3::Y)];
    let mut out: Rgb8Image = Image::filled(2 * VIEW_PX, VIEW_PX, [0; 3]);
    out.pixels_mut().par_chunks_mut(2 * VIEW_PX).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let (forward, right) = views[column / VIEW_PX];
            let mut sum = Vec3::ZERO;
            for sample in 0..SAMPLES * SAMPLES {
                let part = |k: usize| (k as f32 + 0.5) / SAMPLES as f32;
                let x = ((column % VIEW_PX) as f32 + part(sample % SAMPLES)) / VIEW_PX as f32 - 0.5;
                let y = 0.5 - (row as f32 + part(sample / SAMPLES)) / VIEW_PX as f32;
                let origin = middle + (right * x + Vec3::Z * y - forward) * width;
                sum += colour(&bvh, (positions, triangles), spheres, origin, forward);
            }
            let mean = sum / (SAMPLES * SAMPLES) as f32;
            *pixel = mean.to_array().map(|c| (srgb_encode(c) * 255.0 + 0.5) as u8);
        }
    });
    out
}

/// Linear colour along a ray: the mesh in grey, spheres as films of colour before it, faint where they lie behind its
/// surface.
fn colour(
    bvh: &Bvh,
    (positions, triangles): (&[Vec3], &[[u32; 3]]),
    spheres: &[FittedSphere],
    origin: Vec3,
    forward: Vec3,
) -> Vec3 {
    let hit = bvh.intersect(origin, forward, 0.0, f32::INFINITY);
    let (mut colour, depth) = match hit {
        Some(hit) => {
            let [a, b, c] = triangles[hit.triangle as usize].map(|i| positions[i as usize]);
            let facing = (b - a).cross(c - a).normalize_or_zero().dot(forward).abs();
            (Vec3::splat(0.1 + 0.35 * facing), hit.t)
        }
        None => (BACKGROUND, f32::INFINITY),
    };
    // The nearest sphere only: films over films are mud.
    let mut nearest: Option<(f32, f32, usize)> = None;
    for (k, sphere) in spheres.iter().enumerate() {
        let to = sphere.centre - origin;
        let along = to.dot(forward);
        let aside2 = to.length_squared() - along * along;
        let half2 = sphere.radius * sphere.radius - aside2;
        if half2 > 0.0 && nearest.is_none_or(|(t, ..)| along - half2.sqrt() < t) {
            nearest = Some((along - half2.sqrt(), half2.sqrt() / sphere.radius, k));
        }
    }
    if let Some((t, facing, k)) = nearest {
        let film = hue(k) * (0.35 + 0.65 * facing);
        let share = if t < depth { TINT + 0.25 * (1.0 - facing) } else { TINT * 0.6 };
        colour = colour.lerp(film, share);
    }
    colour
}

/// Colours far from each other for neighbouring numbers.
fn hue(k: usize) -> Vec3 {
    let turn = k as f32 * 0.618_034;
    let channel = |shift: f32| {
        let t = (turn + shift).fract() * 6.0;
        ((t - 3.0).abs() - 1.0).clamp(0.0, 1.0)
    };
    Vec3::new(channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0)) * 0.85 + 0.05
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_and_mesh_show_where_they_are() {
        // A square across x and z, its left half under a sphere.
        let positions =
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, z]| Vec3::new(x, 0.0, z));
        let mesh = (positions.to_vec(), vec![[0, 1, 2], [0, 2, 3]]);
        let sphere = FittedSphere { centre: Vec3::new(-1.0, 0.0, 0.0), radius: 0.5 };
        let picture = draw(&mesh, &[sphere]);
        let grey = |p: &[u8; 3]| p[0] == p[1] && p[1] == p[2];
        // The whole is 2.5 wide from -1.5 to 1 (and 6 % more): x = -1 is left of the middle, x = 0.9 right of it.
        let column = |x: f32| ((x + 0.25) / (2.5 * 1.06) * 480.0 + 240.0) as usize;
        assert!(!grey(picture.at(column(-1.0), 240)) && !grey(picture.at(column(-1.4), 240)));
        assert!(grey(picture.at(column(0.9), 240)) && picture.at(column(0.9), 240)[0] < 200);
        assert!(picture.at(2, 2)[0] > 230, "background");
        // From the side the square is a line and the sphere a disc in the middle.
        assert!(!grey(picture.at(480 + 240, 240)) && picture.at(480 + 40, 240)[0] > 230);
        assert_eq!(picture, draw(&mesh, &[sphere]));
    }
}
