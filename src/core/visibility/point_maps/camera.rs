//! The camera at a near light: one projection for the light's middle, and from it those of all places of the light.

use super::MOST_SIDE;
use crate::visibility::shadow_maps::MAX_BIAS_TEXELS;
use glam::Vec3;

/// A map looks no farther off its axis than this tangent (80 degrees): what lies beyond is lit.
const WIDEST: f32 = 5.7;
/// The near plane lies no nearer to the light than this share of the farthest caster's distance. Casters nearer than it
/// are cut off there: only a body around the light comes so near.
const NEAREST_SHARE: f32 = 0.02;
/// Nor nearer than this, metres.
const NEAREST_M: f32 = 1e-3;
/// Room between the near plane and the nearest caster, as a share of its distance.
const NEAR_ROOM: f32 = 1e-3;
/// Free texels at each border of a view.
const EDGE_TEXELS: f64 = 2.0;

/// A light with its extent, as a map is fitted to it; world frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// The middle.
    pub place_world: Vec3,
    /// Half axes of the parallelogram about it that its places lie on.
    pub half_axes_world: [Vec3; 2],
    /// Away from its front; any length, zero: none. A light whose middle lies within the casters' box looks there, for they
    /// may be all around it.
    pub front: Vec3,
}

/// A perspective camera at a light, that looks along a world axis: from `side` times `side` places on the light, one view
/// from each. All views have the same texels, near plane and axes, and each is shifted as the casters are seen shifted from
/// its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointCamera {
    /// Rows of the projective map from world metres, seen from the middle: column and row in texels, both times w, and w, the
    /// distance from the light along the axis in metres. `w = rows[2].xyz . p + rows[2].w`.
    pub rows: [[f32; 4]; 3],
    /// Distance of the near plane, metres.
    pub near_m: f32,
    /// Side of a texel one metre before a place, metres.
    pub texel: f32,
    /// Texels a side of a view.
    pub texels: u32,
    /// The light's middle, world frame, metres.
    pub place_world: Vec3,
    /// Half axes of the parallelogram of its places: right, up and forward, metres. Zero for one place.
    pub half_axes: [[f32; 3]; 2],
    /// Places along each: 1 to 8.
    pub side: u32,
    /// How far the view from a place is shifted, texels for a metre aside: casters at their middle distance are seen at one
    /// position from all places.
    pub shift: f32,
    /// The three axes right, up and forward, as numbers of the world's axes and their signs.
    axes: [(usize, f32); 3],
}

/// The projection from one place, by that from the middle: `(x + corner w - aside) / (w - ahead) + start` is the column of
/// what the middle's rows map to x and w.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaceView {
    /// The place, right and up of the middle, in texels one metre before it.
    pub aside: [f32; 2],
    /// And before it, metres.
    pub ahead: f32,
    /// First position of the view.
    pub start: [f32; 2],
}

impl PointCamera {
    /// The map of a light without extent: see [`PointCamera::fit_places`].
    pub fn fit(place_world: Vec3, front: Vec3, casters: &[Vec3], texels: u32) -> Option<Self> {
        let light = PointLight { place_world, half_axes_world: [Vec3::ZERO; 2], front };
        Self::fit_places(&light, 1, casters, texels)
    }

    /// Fits views of `texels` a side from `side` times `side` places to the casters (world frame, metres). They look along the
    /// world axis next to the casters' middle, and their texels lie on a fixed grid about each place, a ladder of 8 sizes an
    /// octave, so that shadows do not swim with what moves. `None` where no caster lies before the light, or something is not
    /// finite.
    pub fn fit_places(light: &PointLight, side: u32, casters: &[Vec3], texels: u32) -> Option<Self> {
        let (place_world, side) = (light.place_world, side.clamp(1, MOST_SIDE));
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &p in casters.iter().filter(|p| p.is_finite()) {
            (low, high) = (low.min(p), high.max(p));
        }
        let towards = 0.5 * (low + high) - place_world;
        if !(towards.is_finite() && place_world.is_finite()) || texels < 16 {
            return None;
        }
        let is_within = place_world.cmpge(low).all() && place_world.cmple(high).all();
        let forward = largest(if is_within && light.front != Vec3::ZERO { light.front } else { towards });
        let axes = [((forward.0 + 1) % 3, 1.0), ((forward.0 + 2) % 3, 1.0), forward];
        let along = |v: Vec3| axes.map(|(axis, sign)| sign * v[axis]);
        let is_wide = side > 1 && light.half_axes_world.iter().all(|v| v.is_finite());
        let half_axes = light.half_axes_world.map(|v| if is_wide { along(v) } else { [0.0; 3] });
        let of_place = outermost(&half_axes, side);
        let seen = |p: Vec3| along(p - place_world);
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0f32);
        let (mut first, mut last) = (f32::INFINITY, f32::NEG_INFINITY);
        for w in casters.iter().map(|&p| seen(p)[2]).filter(|w| w.is_finite()) {
            (first, last) = (first.min(w), last.max(w));
            for [.., ahead] in of_place {
                (nearest, farthest) = (nearest.min(w - ahead), farthest.max(w - ahead));
            }
        }
        let least = (NEAREST_SHARE * farthest).max(NEAREST_M);
        if !(farthest > least) {
            return None;
        }
        let is_cut = nearest * (1.0 - NEAR_ROOM) < least;
        let near_m = if is_cut { least } else { nearest * (1.0 - NEAR_ROOM) };
        // On a ladder, too, so that views stay where they are while something moves a little.
        let middle_m = f64::from((0.5 * (first + last)).max(least));
        let nearness = 1.0 / ((middle_m.log2() * 8.0).ceil() / 8.0).exp2();
        let (mut from, mut to) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut add = |at: [f64; 2]| {
            for (k, v) in at.into_iter().enumerate() {
                (from[k], to[k]) = (from[k].min(v), to[k].max(v));
            }
        };
        for place in of_place {
            let shifted = |tangent: f32, k: usize| {
                f64::from(tangent.clamp(-WIDEST, WIDEST)) + f64::from(place[k]) * nearness
            };
            if is_cut {
                add([0, 1].map(|k| shifted(-WIDEST, k)));
                add([0, 1].map(|k| shifted(WIDEST, k)));
                continue;
            }
            for p in casters.iter().map(|&p| seen(p)).filter(|p| p[2] - place[2] > 0.0) {
                let w = p[2] - place[2];
                add([0, 1].map(|k: usize| shifted((p[k] - place[k]) / w, k)));
            }
        }
        let across = (to[0] - from[0]).max(to[1] - from[1]);
        if !(across >= 0.0) {
            return None;
        }
        // One for the grid, one for the places' shares of a texel.
        let usable = f64::from(texels) - 2.0 * EDGE_TEXELS - if side > 1 { 2.0 } else { 1.0 };
        let tight = (across / usable).max(1e-7);
        let texel = ((tight.log2() * 8.0).ceil() / 8.0).exp2();
        let corner = from.map(|v| (v / texel).floor() - EDGE_TEXELS);
        Some(Self {
            rows: rows(axes, place_world, texel, corner),
            near_m,
            texel: texel as f32,
            texels,
            place_world,
            half_axes,
            side,
            shift: (nearness / texel) as f32,
            axes,
        })
    }

    /// Views: one from each place.
    pub fn views(&self) -> usize {
        (self.side * self.side) as usize
    }

    /// Place `k`, row by row along the second half axis, in the camera's axes from the middle, metres.
    pub fn place(&self, k: usize) -> [f32; 3] {
        let step = |i: u32| (2.0 * i as f32 + 1.0) / self.side as f32 - 1.0;
        let (a, b) = (step(k as u32 % self.side), step(k as u32 / self.side));
        let [u, v] = self.half_axes;
        std::array::from_fn(|i| u[i] * a + v[i] * b)
    }

    /// The projection from place `k`. Each view's grid lies a share of a texel beside the others', so that they are as fine
    /// together as one map of all their texels.
    pub fn view(&self, k: usize) -> PlaceView {
        let [right, up, ahead] = self.place(k);
        let n = self.side as f32;
        let beside = [(k as u32 % self.side) as f32 / n, (k as u32 / self.side) as f32 / n];
        let corner = self.corner();
        PlaceView {
            aside: [right / self.texel, up / self.texel],
            ahead,
            start: [right * self.shift - corner[0] + beside[0], up * self.shift - corner[1] + beside[1]],
        }
    }

    /// Column and row (texels) in the view from place `k`, and depth there, of a point in the world frame: depths are above 0
    /// behind the near plane and below 1. `None` for points before it.
    pub fn map(&self, k: usize, p: Vec3) -> Option<[f32; 3]> {
        let seen = self.rows.map(|r| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3]);
        self.map_seen(&self.view(k), seen)
    }

    /// The same of what the rows gave.
    #[inline(always)]
    pub(super) fn map_seen(&self, view: &PlaceView, [x, y, w]: [f32; 3]) -> Option<[f32; 3]> {
        let corner = self.corner();
        let ahead = w - view.ahead;
        (ahead > self.near_m).then(|| {
            let inverse = 1.0 / ahead;
            [
                (x + corner[0] * w - view.aside[0]) * inverse + view.start[0],
                (y + corner[1] * w - view.aside[1]) * inverse + view.start[1],
                1.0 - self.near_m * inverse,
            ]
        })
    }

    /// A vector of the world in the camera's axes: right, up, forward.
    pub fn along_axes(&self, v: Vec3) -> [f32; 3] {
        self.axes.map(|(axis, sign)| sign * v[axis])
    }

    /// How the depth of a flat receiver through `point` with a unit `normal` changes from texel to texel along columns and
    /// rows of the view from place `k`, everywhere alike (the depth of a plane is affine over the view); bounded where the
    /// place lies nearly in its plane.
    pub fn slope(&self, k: usize, point_world: Vec3, normal: Vec3) -> [f32; 2] {
        let place = self.place(k);
        let seen = self.along_axes(point_world - self.place_world);
        let from_place: [f32; 3] = std::array::from_fn(|i| seen[i] - place[i]);
        let along = self.along_axes(normal);
        let off: f32 = along.iter().zip(from_place).map(|(n, d)| n * d).sum();
        let w = from_place[2].max(self.near_m);
        let most = MAX_BIAS_TEXELS * self.texel * self.near_m / w;
        [along[0], along[1]].map(|n| {
            let slope = -self.near_m * self.texel * n / off;
            if slope.is_finite() { slope.clamp(-most, most) } else { 0.0 }
        })
    }

    /// The tangents of the middle's corner, in texels.
    #[inline(always)]
    pub(super) fn corner(&self) -> [f32; 2] {
        // rows[k] = lateral / texel - corner * w.
        let (axis, sign) = self.axes[2];
        [0, 1].map(|k: usize| -self.rows[k][axis] * sign)
    }

    /// Numbers of the outermost views, whose positions those of all others lie between.
    pub(super) fn outermost(&self) -> [usize; 4] {
        let last = self.side as usize - 1;
        [0, last, last * self.side as usize, self.views() - 1]
    }
}

/// Rows of the map from world metres: column and row in texels, both times w, and w.
fn rows(axes: [(usize, f32); 3], place_world: Vec3, texel: f64, corner: [f64; 2]) -> [[f32; 4]; 3] {
    let row = |(axis, sign): (usize, f32)| {
        let mut row = [0.0f64; 4];
        row[axis] = f64::from(sign);
        row[3] = -f64::from(sign) * f64::from(place_world[axis]);
        row
    };
    let w = row(axes[2]);
    let mapped = |k: usize| {
        let lateral = row(axes[k]);
        std::array::from_fn(|i| (lateral[i] / texel - corner[k] * w[i]) as f32)
    };
    [mapped(0), mapped(1), w.map(|v| v as f32)]
}

/// Corners of the grid of places.
fn outermost([u, v]: &[[f32; 3]; 2], side: u32) -> [[f32; 3]; 4] {
    let end = 1.0 - 1.0 / side as f32;
    [(-end, -end), (end, -end), (-end, end), (end, end)]
        .map(|(a, b)| std::array::from_fn(|i| u[i] * a + v[i] * b))
}

/// The axis of largest component and its sign.
fn largest(v: Vec3) -> (usize, f32) {
    let a = v.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    (axis, if v[axis] < 0.0 { -1.0 } else { 1.0 })
}
