//! A reference case of the room, and what its object takes away at each pixel by near light: exact visibility of the
//! object from each representative's place, so that only the algorithm is measured and no shadow map.
#![allow(dead_code)]
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use glam::{DVec2, Vec3};
use halflight::{
    assets::{case::Case, pictures},
    math::{bvh::Bvh, color},
    model::{
        image::RadianceImage,
        room::{Room, RoomPatches},
        scene::Mesh,
    },
    nearfield::{
        field::NearField,
        marks::{Marks, View, bounds_world},
        representatives::{Representative, Representatives},
        shaft::Aabb,
    },
    sources::expand::Priority,
};
use rayon::prelude::*;

/// A point of the room seen at a pixel: its patch's corners with their weights.
#[derive(Clone, Copy)]
pub struct Seen {
    pub point: Vec3,
    pub normal: Vec3,
    pub corners: [u32; 3],
    pub weights: [f32; 3],
    pub reflectance: [f32; 3],
    pub emits: bool,
}

/// The room as the camera sees it: `side` times `side` places a pixel.
pub struct RoomView {
    pub seen: Vec<Option<Seen>>,
    pub per_pixel: usize,
}

impl RoomView {
    pub fn new(case: &Case, patches: &RoomPatches, room: &Room, side: usize) -> Self {
        let positions: Vec<Vec3> = patches.vertices.iter().map(|v| v.position_world).collect();
        let mut triangles = Vec::new();
        let mut owner = Vec::new();
        for (i, patch) in patches.patches.iter().enumerate() {
            for t in patch.triangles() {
                triangles.push(t);
                owner.push(i);
            }
        }
        let bvh = Bvh::build(&positions, &triangles);
        let eye = case.world_from_camera.translation.as_vec3();
        let (width, height) = (case.lens.width as usize, case.lens.height as usize);
        let per_pixel = side * side;
        let seen = (0..width * height * per_pixel)
            .into_par_iter()
            .map(|i| {
                let (pixel, sub) = (i / per_pixel, i % per_pixel);
                let at = |whole: usize, part: usize| whole as f64 + (part as f64 + 0.5) / side as f64;
                let at = DVec2::new(at(pixel % width, sub % side), at(pixel / width, sub / side));
                let ray = case.world_from_camera.rotate(case.lens.unproject(at).unwrap()).as_vec3();
                let hit = bvh.intersect(eye, ray, 1e-4, f32::INFINITY)?;
                let patch = &patches.patches[owner[hit.triangle as usize]];
                let emits = room.surfaces[patch.surface as usize].emitted_rgb != [0.0; 3];
                Some(Seen {
                    point: eye + ray * hit.t,
                    normal: patch.normal_world,
                    corners: triangles[hit.triangle as usize],
                    weights: hit.barycentric,
                    reflectance: patch.reflectance_rgb,
                    emits,
                })
            })
            .collect();
        Self { seen, per_pixel }
    }
}

impl RoomView {
    /// The room's own radiance at every pixel, interpolated between the corners of each point's triangle: what the ratio
    /// form divides by.
    pub fn gathered(&self, field: &NearField) -> Vec<[f32; 3]> {
        let pixel = |seen: &[Option<Seen>]| {
            let mut sum = [0.0f32; 3];
            for at in seen.iter().flatten() {
                for (corner, weight) in at.corners.iter().zip(at.weights) {
                    let light = field.gathered_rgb[*corner as usize];
                    for c in 0..3 {
                        sum[c] += weight * light[c] * at.reflectance[c] / self.per_pixel as f32;
                    }
                }
            }
            sum
        };
        self.seen.chunks(self.per_pixel).map(pixel).collect()
    }
}

/// The object of a picture.
pub struct Object {
    pub bvh: Bvh,
    pub bounds: Aabb,
}

impl Object {
    pub fn new(mesh: &Mesh, shift: Vec3) -> Self {
        let positions: Vec<Vec3> = mesh.positions.iter().map(|p| *p + shift).collect();
        let bounds = bounds_world(positions.iter().copied()).unwrap();
        Self { bvh: Bvh::build(&positions, &mesh.triangles), bounds }
    }

    /// The one object of a picture of a case.
    pub fn of(case: &Case, image: &str) -> Self {
        let scene = case.scene(Some(image)).unwrap();
        let object = &scene.objects[0];
        let mesh = halflight::assets::shapes::transformed(&object.mesh, &object.world_from_object);
        Self::new(&mesh, Vec3::ZERO)
    }

    /// Whether it hides a place from a point of a surface.
    pub fn hides(&self, point: Vec3, normal: Vec3, place: Vec3) -> bool {
        let from = point + normal * 2e-4;
        self.bvh.occluded(from, place - from, 0.0, 1.0)
    }

    fn hidden_share(&self, at: &Seen, light: &Representative, side: u32) -> f32 {
        if side == 1 {
            return f32::from(self.hides(at.point, at.normal, light.centre_world));
        }
        let [long, short] = light.half_axes_world;
        let hidden = (0..side * side).filter(|k| {
            let step = |i: u32| (2.0 * i as f32 + 1.0) / side as f32 - 1.0;
            let place = light.middle_world + long * step(k % side) + short * step(k / side);
            self.hides(at.point, at.normal, place)
        });
        hidden.count() as f32 / (side * side) as f32
    }
}

/// Marks and chooses; what a frame keeps.
#[derive(Default)]
pub struct Shadows {
    pub view: View,
    pub marks: Marks,
    pub lights: Representatives,
    pub rows: Vec<[f32; 3]>,
}

impl Shadows {
    pub fn frame(&mut self, case: &Case, field: &NearField, object: &Object, count: usize, by: Priority) {
        self.view.look(field, &case.lens, &case.world_from_camera);
        self.marks.mark(field, &[object.bounds], Some(&self.view));
        self.lights.choose(field, &self.marks, &[object.bounds], None, count, by);
        self.lights.light_rows(field, &self.marks, &mut self.rows);
    }

    /// Radiance taken away at every pixel: sum over lights of rho L_xk where the object hides light k, L_xk interpolated
    /// between the corners of the point's triangle. Hard: seen from the light's place alone; soft: from `side` times
    /// `side` places on its parallelogram, as a filter over a shadow map does.
    pub fn removed(&self, view: &RoomView, field: &NearField, object: &Object, side: u32) -> Vec<[f32; 3]> {
        let vertices = field.patches.vertices.len();
        view.seen
            .par_chunks(view.per_pixel)
            .map(|seen| {
                let mut sum = [0.0f32; 3];
                for at in seen.iter().flatten() {
                    if !at.corners.iter().any(|&c| self.marks.has_vertex(c as usize)) {
                        continue;
                    }
                    for (k, light) in self.lights.near().iter().enumerate() {
                        let mut radiance = [0.0f32; 3];
                        for (corner, weight) in at.corners.iter().zip(at.weights) {
                            let row = self.rows[k * vertices + *corner as usize];
                            radiance.iter_mut().zip(row).for_each(|(sum, l)| *sum += weight * l);
                        }
                        if radiance.iter().all(|l| *l <= 0.0) {
                            continue;
                        }
                        let hidden = object.hidden_share(at, light, side);
                        for c in 0..3 {
                            sum[c] += radiance[c] * at.reflectance[c] * hidden;
                        }
                    }
                }
                sum.map(|c| c / view.per_pixel as f32)
            })
            .collect()
    }
}

/// How far off a difference is.
#[derive(Clone, Copy, Debug)]
pub struct Off {
    /// RMS of the error over RMS of the truth (luminance), over pixels that the object does not cover, and where either
    /// is above 1 % of the truth's largest.
    pub rmse: f64,
    /// Sum over the picture against the truth's.
    pub energy: f64,
}

/// Compares with `diff_X` of the case where `mask_X` is 0 and no emitter is seen.
pub fn compare(case: &Case, which: &str, got: &[[f32; 3]]) -> Off {
    let truth: RadianceImage =
        pictures::load_raw(&case.image(&format!("diff_{which}")).unwrap().file).unwrap();
    let mask = pictures::load_gray8(&case.image(&format!("mask_{which}")).unwrap().file).unwrap();
    let emitters = pictures::load_gray8(&case.image("mask_emitters").unwrap().file).unwrap();
    let valid = |i: &usize| mask.pixels()[*i] == 0 && emitters.pixels()[*i] == 0;
    let truth = |i: usize| f64::from(color::luminance(truth.pixels()[i]));
    let pixels: Vec<(f64, f64)> =
        (0..got.len()).filter(valid).map(|i| (f64::from(color::luminance(got[i])), truth(i))).collect();
    let largest = pixels.iter().map(|p| p.1).fold(0.0, f64::max);
    let (mut error, mut square) = (0.0, 0.0);
    for (got, truth) in pixels.iter().filter(|p| p.0.max(p.1) > 0.01 * largest) {
        error += (got - truth) * (got - truth);
        square += truth * truth;
    }
    let sums = pixels.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
    Off { rmse: (error / square).sqrt(), energy: sums.0 / sums.1 }
}
