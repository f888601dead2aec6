//! What a mirror sees (Eq. 21 of [Now11], the blockers tested one by one): the nearest real surface or the nearest
//! sphere of another virtual body along the reflected ray, else the picture of the environment.
//! Twin: `shaders/shared/surroundings.wgsl`.
//!
//! # What is approximate
//! * A real surface of known albedo radiates albedo / pi times its irradiance. Where the albedo is not known the picture
//!   of the environment is taken in the ray's direction: below the horizon that of a ball on a surface already is the
//!   unshadowed surface. Either is scaled by what virtual objects leave of the light at the point: the hard lights by their
//!   shadow maps, the soft light by what each sphere takes of the hemisphere, cosine-weighted, as if alone.
//! * Another body is its spheres, each matt in the body's mean colour, in unshadowed light.
//! * The device knows the [`MOST_TRIANGLES`] largest triangles of the real surfaces, this twin all of them.

use super::geometry::{ObjectGeometry, SurfaceGeometry};
use super::shade_object::{LightTerms, soft_over_pi, unshadowed};
use crate::math::bvh::Bvh;
use crate::model::{blocker::BlockerSphere, environment::EnvironmentPicture, light::MAX_HARD_LIGHTS};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Spheres that mirrors see at most.
pub const MOST_SPHERES: usize = 64;
/// Triangles of real surfaces that the device has room for.
pub const MOST_TRIANGLES: usize = 64;
/// Rays begin so far off the mirror, metres.
pub const START_M: f32 = 1e-4;

/// A triangle of a real surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenTriangle {
    /// A corner and the two edges from it, world frame, metres.
    pub corner: Vec3,
    /// To the second corner.
    pub edge_u: Vec3,
    /// To the third corner.
    pub edge_v: Vec3,
    /// Unit.
    pub normal: Vec3,
    /// Lambert's albedo, where it is known.
    pub albedo_rgb: Option<[f32; 3]>,
    /// Whether virtual shadows fall on it.
    pub receives: bool,
}

/// A sphere of a virtual body, and its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenSphere {
    /// Where it is, and whose.
    pub sphere: BlockerSphere,
    /// What it reflects of white light.
    pub rgb: [f32; 3],
}

/// All that mirrors can meet. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Reflected {
    bvh: Bvh,
    triangles: Vec<SeenTriangle>,
    largest: Vec<SeenTriangle>,
    spheres: Vec<SeenSphere>,
}

impl Reflected {
    /// Takes the real surfaces of a scene.
    pub fn load(&mut self, surfaces: &SurfaceGeometry) {
        self.bvh = Bvh::build(&surfaces.positions, &surfaces.triangles);
        self.triangles.clear();
        for (i, corners) in surfaces.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|v| surfaces.positions[v as usize]);
            self.triangles.push(SeenTriangle {
                corner: a,
                edge_u: b - a,
                edge_v: c - a,
                normal: surfaces.facet_normals[i],
                albedo_rgb: surfaces.albedo_rgb[i],
                receives: surfaces.receives[i],
            });
        }
        self.largest.clone_from(&self.triangles);
        if self.largest.len() > MOST_TRIANGLES {
            let area = |t: &SeenTriangle| t.edge_u.cross(t.edge_v).length();
            // Stable: equal areas stay in the scene's order.
            self.largest.sort_by(|a, b| area(b).total_cmp(&area(a)));
            self.largest.truncate(MOST_TRIANGLES);
        }
    }

    /// Takes the spheres of a frame, the first [`MOST_SPHERES`] of them, with the colours of their bodies.
    pub fn prepare(&mut self, spheres: &[BlockerSphere], objects: &ObjectGeometry) {
        self.spheres.clear();
        self.spheres.extend(spheres.iter().take(MOST_SPHERES).map(|&sphere| {
            let rgb = objects.mean_rgb.get(sphere.body as usize).copied().unwrap_or([0.0; 3]);
            SeenSphere { sphere, rgb }
        }));
    }

    /// The spheres of the frame.
    pub fn spheres(&self) -> &[SeenSphere] {
        &self.spheres
    }

    /// The largest triangles of the scene, as many as the device has room for.
    pub fn largest_triangles(&self) -> &[SeenTriangle] {
        &self.largest
    }

    /// Radiance that comes to `origin` from the unit direction `along`, linear RGB, not negative; a body does not see its
    /// own spheres. `visibility(k, point, cosine)` is the share of hard light k at a point of a surface (world frame) whose
    /// normal has that cosine to the light.
    pub fn seen(
        &self,
        light: &LightTerms,
        picture: &EnvironmentPicture,
        origin: Vec3,
        along: Vec3,
        body: u32,
        visibility: impl Fn(usize, Vec3, f32) -> f32,
    ) -> [f32; 3] {
        let hit = self.bvh.intersect(origin, along, START_M, f32::INFINITY);
        let wall = hit.map_or(f32::INFINITY, |h| h.t);
        let mut nearest: Option<(f32, &SeenSphere)> = None;
        for sphere in self.spheres.iter().filter(|s| s.sphere.body != body) {
            if let Some(t) = meets(&sphere.sphere, origin, along)
                && t < nearest.map_or(wall, |n| n.0)
            {
                nearest = Some((t, sphere));
            }
        }
        if let Some((t, sphere)) = nearest {
            let normal = (origin + t * along - sphere.sphere.centre_world).normalize_or(-along);
            let (hard, soft) = (unshadowed(light, normal), soft_over_pi(light, normal));
            return std::array::from_fn(|c| sphere.rgb[c] * (hard[c] * FRAC_1_PI + soft[c]).max(0.0));
        }
        let Some(hit) = hit else { return picture.all.look(along) };
        let triangle = &self.triangles[hit.triangle as usize];
        self.surface(light, picture, triangle, origin + hit.t * along, along, visibility)
    }

    fn surface(
        &self,
        light: &LightTerms,
        picture: &EnvironmentPicture,
        triangle: &SeenTriangle,
        point: Vec3,
        along: Vec3,
        visibility: impl Fn(usize, Vec3, f32) -> f32,
    ) -> [f32; 3] {
        let normal = if triangle.normal.dot(along) > 0.0 { -triangle.normal } else { triangle.normal };
        let (mut whole, mut left) = ([0.0f32; 3], [0.0f32; 3]);
        let open = if triangle.receives { self.openness(point, normal) } else { 1.0 };
        let soft = soft_over_pi(light, normal);
        for c in 0..3 {
            whole[c] = soft[c].max(0.0);
            left[c] = whole[c] * open;
        }
        for (k, hard) in light.hard().iter().enumerate().take(MAX_HARD_LIGHTS) {
            let cosine = normal.dot(Vec3::from(hard.to_light_world));
            if cosine <= 0.0 {
                continue;
            }
            let visible = if triangle.receives { visibility(k, point, cosine) } else { 1.0 };
            for c in 0..3 {
                let radiated = hard.irradiance_rgb[c] * cosine * FRAC_1_PI;
                whole[c] += radiated;
                left[c] += radiated * visible;
            }
        }
        match triangle.albedo_rgb {
            Some(albedo) => std::array::from_fn(|c| albedo[c] * left[c]),
            None => {
                let seen = picture.all.look(along);
                std::array::from_fn(|c| seen[c] * if whole[c] > 0.0 { left[c] / whole[c] } else { 1.0 })
            }
        }
    }

    /// Cosine-weighted share of the hemisphere that the spheres leave open, each as if alone: product of
    /// 1 - max(0, n.w) R, exact for one sphere above the horizon.
    fn openness(&self, point: Vec3, normal: Vec3) -> f32 {
        let mut open = 1.0;
        for seen in &self.spheres {
            let to_centre = seen.sphere.centre_world - point;
            let squared = to_centre.length_squared();
            let up = normal.dot(to_centre);
            if up > 0.0 && squared > 0.0 {
                let share = (seen.sphere.radius_m * seen.sphere.radius_m / squared).min(1.0);
                open *= 1.0 - up / squared.sqrt() * share;
            }
        }
        open
    }
}

/// How far along a ray from outside a sphere is met.
fn meets(sphere: &BlockerSphere, origin: Vec3, along: Vec3) -> Option<f32> {
    let to_centre = sphere.centre_world - origin;
    let middle = to_centre.dot(along);
    // The miss as a vector: no difference of large squares.
    let miss = (to_centre - middle * along).length_squared();
    let radius = sphere.radius_m * sphere.radius_m;
    if middle <= 0.0 || miss >= radius || to_centre.length_squared() <= radius {
        return None;
    }
    Some(middle - (radius - miss).sqrt())
}

#[cfg(test)]
mod tests;
