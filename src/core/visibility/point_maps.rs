//! Shadow maps of near light: the depths of casters as seen from places on a light (Section 7.2 of [Gib03]). What a map holds
//! is projective, `1 - near / distance along the axis`: the same rasteriser draws it as for far light.
//! Twin: `shaders/visibility/point_maps.wgsl`.
//!
//! A light with extent is seen from n x n places on it, and the square of texels that a light has is dealt out to as many views:
//! each as many times coarser as there are places along an axis, its grid a share of a texel beside the others'. So a soft
//! shadow costs the memory of a hard one and a read for each place, is right for bodies of any shape and depth (a filter over
//! one view knows what it sees of a body only: from a wide light 8 % of the shadow was missing), and the share that each place
//! stands for is that of the part of the light that the receiver sees (`SeenPart`).

use super::shadow_maps::{EMPTY_DEPTH, ROUNDING_TEXELS, ShadowMap};
use glam::Vec3;
use rayon::prelude::*;

mod camera;
mod part;
mod reads;

pub use camera::{PlaceView, PointCamera, PointLight};
pub use part::{SeenPart, WHOLE, share};
pub use reads::PlaceReads;

/// Places along an axis of a light at most...
pub const MOST_SIDE: u32 = 8;
/// ...and views of it.
const MOST_VIEWS: usize = (MOST_SIDE * MOST_SIDE) as usize;
/// Texels a side of a view at least: beyond a box's edges little is left of a shape.
const LEAST_TEXELS: u32 = 16;
/// What less than this share of a light leaves is rounding.
const FAINT: f32 = 1e-5;
/// Positions are the same to this many texels, however they are rounded.
const BESIDE_TEXELS: f32 = 0.01;

/// Texels a side of a light's square, of those wanted: as many for each of its views, and not too few.
pub fn square_texels(wanted: u32, side: u32) -> u32 {
    let side = side.clamp(1, MOST_SIDE);
    (wanted / side).max(LEAST_TEXELS) * side
}

/// Maps of near lights; memory is kept.
#[derive(Clone, Debug, Default)]
pub struct PointMapSet {
    cameras: Vec<Option<PointCamera>>,
    /// Views of each light.
    views: usize,
    /// Texels a side of a view.
    view_texels: usize,
    /// Light by light, view by view.
    maps: Vec<ShadowMap>,
}

impl PointMapSet {
    /// No map: nothing is shadowed.
    pub fn clear(&mut self) {
        self.cameras.clear();
    }

    /// Fits the views of every light to the casters, from `side` times `side` places each, in squares of `texels` a side
    /// ([`square_texels`]); a light has none where no caster lies before it.
    pub fn fit(
        &mut self,
        lights: impl Iterator<Item = PointLight>,
        side: u32,
        casters: &[Vec3],
        texels: u32,
    ) {
        let side = side.clamp(1, MOST_SIDE);
        self.cameras.clear();
        let view_texels = square_texels(texels, side) / side;
        self.cameras.extend(lights.map(|light| PointCamera::fit_places(&light, side, casters, view_texels)));
        self.views = (side * side) as usize;
        self.view_texels = view_texels as usize;
        self.provide(self.cameras.len());
    }

    /// Provides maps for so many lights at least, after [`Self::fit`]: with the most lights of any frame, [`Self::draw`]
    /// allocates for the first frame alone.
    pub fn provide(&mut self, lights: usize) {
        let count = lights * self.views;
        if self.maps.len() < count {
            self.maps.resize_with(count, ShadowMap::of_small_tiles);
        }
    }

    /// Draws the casters into every view, after [`Self::fit`]. Same result for any number of threads.
    ///
    /// Every map gets its memory here, drawn or not. Which lights have a camera, and which of their views cut casters off at the
    /// near plane, differs from frame to frame: memory made at the first need was made in the middle of a run (twenty
    /// allocations in frame 28 of the recorded room on a processor with AVX-512, and none in that frame on others).
    ///
    /// That digests are equal does not rule it out. Tests compare digests of runs on one machine, of the first 8 or 10 frames; and a
    /// map that hides nothing of what is seen is in no digest. Which number differs first between processors is not found.
    /// The C library's choice of functions is not it: without FMA and AVX2 all 60 pictures of the room keep their bits.
    pub fn draw(&mut self, casters: &[Vec3], triangles: &[[u32; 3]]) {
        let Self { cameras, views, view_texels, maps } = self;
        let (cameras, views, view_texels) = (&*cameras, (*views).max(1), *view_texels);
        maps.par_iter_mut().enumerate().for_each(|(k, map)| {
            map.reserve(view_texels, casters.len());
            if let Some(Some(camera)) = cameras.get(k / views) {
                draw(camera, k % views, casters, triangles, map);
            }
        });
    }

    /// One for each light of [`Self::fit`].
    pub fn cameras(&self) -> &[Option<PointCamera>] {
        &self.cameras
    }

    /// Light `k`'s camera and the maps of its views, where it has one.
    pub fn get(&self, k: usize) -> Option<(&PointCamera, &[ShadowMap])> {
        let camera = self.cameras.get(k)?.as_ref()?;
        Some((camera, self.maps.get(k * self.views..(k + 1) * self.views)?))
    }

    /// Depths of light `k`, as its square holds them, row by row (`texels` times `side` a row); none where there is no camera.
    pub fn square(&self, k: usize) -> Vec<f32> {
        let Some((camera, maps)) = self.get(k) else { return Vec::new() };
        let (texels, side) = (camera.texels as usize, camera.side as usize);
        let row_of = |y: usize, column: usize| {
            let map = &maps[y / texels * side + column];
            map.depth().get(y % texels * texels..(y % texels + 1) * texels).unwrap_or(&[])
        };
        (0..texels * side).flat_map(|y| (0..side).flat_map(move |c| row_of(y, c))).copied().collect()
    }

    /// Takes light `k`'s depths that were drawn elsewhere, as [`PointMapSet::square`] gives them.
    pub fn set_square(&mut self, k: usize, depth: &[f32]) {
        let Some(Some(camera)) = self.cameras.get(k) else { return };
        let (texels, side) = (camera.texels as usize, camera.side as usize);
        let views = k * self.views..(k + 1) * self.views;
        for (view, map) in self.maps.get_mut(views).into_iter().flatten().enumerate() {
            let start = view / side * texels * texels * side + view % side * texels;
            let rows = (0..texels).filter_map(|y| {
                let begin = start + y * texels * side;
                depth.get(begin..begin + texels)
            });
            map.set_depth(rows.flatten().copied().collect());
        }
    }

    /// Whether a light's shadow may fall on some point of a polygon (world frame). `is_drawn`: what the views hold counts,
    /// else their borders alone.
    pub fn may_shadow<const N: usize>(&self, k: usize, corners_world: &[Vec3; N], is_drawn: bool) -> bool {
        let Some((camera, maps)) = self.get(k) else { return false };
        let seen = corners_world.map(|p| camera.rows.map(|r| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3]));
        // The positions that a view sees it at, or nothing where all of it is before every caster; `true`: part of it is.
        let within = |view: usize| -> Option<([f32; 2], [f32; 2], bool)> {
            let view = camera.view(view);
            let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
            let mut before = 0;
            for seen in seen {
                let Some([x, y, _]) = camera.map_seen(&view, seen) else {
                    before += 1;
                    continue;
                };
                low = [low[0].min(x), low[1].min(y)];
                high = [high[0].max(x), high[1].max(y)];
            }
            (before < N).then_some((low, high, before > 0))
        };
        let (mut low, mut high, mut before) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2], 0);
        for view in camera.outermost() {
            match within(view) {
                Some((.., true)) => return true,
                Some((l, h, false)) => {
                    for i in 0..2 {
                        (low[i], high[i]) = (low[i].min(l[i]), high[i].max(h[i]));
                    }
                }
                None => before += 1,
            }
        }
        if before > 0 {
            // Before the near planes of all places, or of some: then other places may see a part of it anywhere.
            return before < camera.outermost().len();
        }
        // What lies between the outermost views, to a texel.
        let side = camera.texels as f32 + 1.0;
        if !(high[0] >= -1.0 && high[1] >= -1.0 && low[0] <= side && low[1] <= side) {
            return false;
        }
        !is_drawn
            || maps.iter().enumerate().any(|(k, map)| match within(k) {
                Some((.., true)) => true,
                Some((low, high, false)) => {
                    let (low, high) = (low.map(|v| v - BESIDE_TEXELS), high.map(|v| v + BESIDE_TEXELS));
                    is_held(map, camera, low, high)
                }
                None => false,
            })
    }
}

/// Whether a view may hold a caster somewhere between two positions.
#[inline(always)]
fn is_held(map: &ShadowMap, camera: &PointCamera, low: [f32; 2], high: [f32; 2]) -> bool {
    let side = camera.texels as f32;
    let within = high[0] >= 0.0 && high[1] >= 0.0 && low[0] < side && low[1] < side;
    within && map.reach().is_held_box(low, high)
}

fn draw(camera: &PointCamera, view: usize, casters: &[Vec3], triangles: &[[u32; 3]], map: &mut ShadowMap) {
    let side = camera.texels as usize;
    let view = camera.view(view);
    let rows = &camera.rows;
    let seen = |p: Vec3| rows.map(|r| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3]);
    // Whole maps are one unit of parallel work each.
    if casters.iter().all(|&p| seen(p)[2] - view.ahead > camera.near_m) {
        map.set_vertices(casters.iter().filter_map(|&p| camera.map_seen(&view, seen(p))));
        map.rasterise(side, triangles, side);
        return;
    }
    map.rasterise_mapped(
        side,
        triangles.iter().flat_map(|triangle| {
            let corners = triangle.map(|i| casters.get(i as usize).copied().unwrap_or(Vec3::NAN));
            behind(camera, &view, corners)
        }),
    );
}

/// What of a triangle lies behind the near plane, in the view's texels and depths: none, one or two triangles.
fn behind(camera: &PointCamera, view: &PlaceView, corners: [Vec3; 3]) -> impl Iterator<Item = [[f32; 3]; 3]> {
    let (rows, corner) = (&camera.rows, camera.corner().map(f64::from));
    let clip = |p: Vec3| {
        let [x, y, w] = rows.map(|r| f64::from(r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3]));
        let ahead = w - f64::from(view.ahead);
        let at = |k: usize, v: f64| {
            v + corner[k] * w - f64::from(view.aside[k]) + f64::from(view.start[k]) * ahead
        };
        [at(0, x), at(1, y), ahead]
    };
    // A little behind the plane, so that depths stay above 0.
    let plane = f64::from(camera.near_m) * (1.0 + 1e-5);
    let corners = corners.map(clip);
    // One plane makes four corners of three at most.
    let (mut found, mut count) = ([[0.0f32; 3]; 4], 0);
    let limit = 8.0 * f64::from(camera.texels);
    let mut push = |[x, y, w]: [f64; 3]| {
        let at = [x, y].map(|v| (v / w).clamp(-limit, limit) as f32);
        found[count] = [at[0], at[1], (1.0 - f64::from(camera.near_m) / w) as f32];
        count += 1;
    };
    if corners.iter().flatten().all(|v| v.is_finite()) {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a[2] >= plane {
                push(a);
            }
            if (a[2] >= plane) != (b[2] >= plane) {
                let t = (plane - a[2]) / (b[2] - a[2]);
                push(std::array::from_fn(|i| a[i] + t * (b[i] - a[i])));
            }
        }
    }
    (2..count).map(move |k| [found[0], found[k - 1], found[k]])
}

/// Share of a light, 0 to 1, that reaches a point (world frame): the places from which nothing drawn is before it, each by
/// the share of the part of the light that the point sees (middle and half lengths as in [`SeenPart`]) which lies in the
/// place's cell. `normal`: the point is on a flat surface that casts itself; a texel then hides what lies behind it at the texel's
/// own middle, so that no flat surface shadows itself. Without one every point behind what a texel holds is hidden: surfaces
/// that do not cast.
pub fn visibility(
    maps: &[ShadowMap],
    camera: &PointCamera,
    (middle, half): ([f32; 2], [f32; 2]),
    point_world: Vec3,
    normal: Option<Vec3>,
) -> f32 {
    let texels = camera.texels as i32;
    let hides = |k: usize, map: &ShadowMap| {
        let Some([x, y, depth]) = camera.map(k, point_world) else { return false };
        let [i, j] = [x, y].map(f32::floor);
        let within = i >= 0.0 && j >= 0.0 && i < texels as f32 && j < texels as f32;
        let stored = within.then(|| map.depth().get((j as i32 * texels + i as i32) as usize)).flatten();
        let Some(stored) = stored else { return false };
        let limit = normal.map_or(depth, |normal| {
            let slope = camera.slope(k, point_world, normal);
            let rounding = ROUNDING_TEXELS * camera.texel * (1.0 - depth);
            (depth + slope[0] * (i + 0.5 - x) + slope[1] * (j + 0.5 - y) - rounding).min(EMPTY_DEPTH)
        });
        *stored < limit
    };
    let side = camera.side;
    if side == 1 {
        return if maps.first().is_some_and(|map| hides(0, map)) { 0.0 } else { 1.0 };
    }
    let mut hidden = 0.0;
    for (k, map) in maps.iter().enumerate().take(camera.views()) {
        if hides(k, map) {
            let [u, v] = [(k as u32 % side, 0), (k as u32 / side, 1)]
                .map(|(cell, axis): (u32, usize)| share(cell, side, middle[axis], half[axis]));
            hidden += u * v;
        }
    }
    let open = 1.0 - hidden;
    if open > FAINT { open } else { 0.0 }
}

#[cfg(test)]
mod tests;
