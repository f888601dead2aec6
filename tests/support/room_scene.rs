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
        marks::{Marks, SeenReceivers, bounds_world},
        representatives::{Representative, Representatives},
        shaft::{Aabb, shaft_interval},
        subtract::seen_part,
        transfer::Statics,
    },
    sources::expand::{Priority, WantedNodes},
    visibility::point_maps::SeenPart,
};
use rayon::prelude::*;

/// The room of a reference case in the ids of `wanted.tsv`.
pub fn short_name(id: &str) -> &'static str {
    if id == "f3_ceiling_light" { "lamp" } else { "window" }
}

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

    /// Share of a light that the object hides from a point: of its one place, or of `side` times `side` places on the part
    /// of it that the point sees (middle and half lengths along its half axes).
    pub fn hidden(
        &self,
        point: Vec3,
        normal: Vec3,
        light: &Representative,
        side: u32,
        (middle, half): ([f32; 2], [f32; 2]),
    ) -> f32 {
        if side == 1 {
            return f32::from(self.hides(point, normal, light.centre_world));
        }
        let [long, short] = light.half_axes_world;
        let mut hidden = 0;
        for k in 0..side * side {
            let step = |i: u32| (2.0 * i as f32 + 1.0) / side as f32 - 1.0;
            let along = [step(k % side), step(k / side)];
            let [a, b] = [0, 1].map(|i: usize| middle[i] + half[i] * along[i]);
            let place = light.middle_world + long * a + short * b;
            hidden += u32::from(self.hides(point, normal, place));
        }
        hidden as f32 / (side * side) as f32
    }
}

/// Marks and chooses; what a frame keeps.
#[derive(Default)]
pub struct Shadows {
    pub view: SeenReceivers,
    pub marks: Marks,
    pub lights: Representatives,
    pub rows: Vec<[f32; 3]>,
    pub parts: Vec<SeenPart>,
}

impl Shadows {
    pub fn frame(&mut self, case: &Case, field: &NearField, object: &Object, count: usize, by: Priority) {
        self.view.look(field, &case.lens, &case.world_from_camera);
        self.marks.mark(field, &[object.bounds], Some(&self.view));
        self.lights.choose(field, &self.marks, &[object.bounds], None, WantedNodes::exactly(count), by);
        self.lights.light_rows(field, &self.marks, &mut self.rows);
        self.lights.light_parts(field, &self.marks, &mut self.parts);
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
                        let parts = at.corners.map(|c| self.parts[k * vertices + c as usize].middle_half());
                        let sent = at.corners.map(|c| self.rows[k * vertices + c as usize]);
                        let part = seen_part(&parts, &sent, at.weights);
                        let hidden = object.hidden(at.point, at.normal, light, side, part);
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

/// What an object takes away at some pixels, luminance, by rays to all of each emitter: no lights chosen, nothing
/// interpolated, and no noise to speak of.
pub struct Traced {
    pub pixels: Vec<(usize, f64)>,
}

impl Traced {
    /// At every other pixel of every other row that shows the room, and neither an emitter nor the object; `side` times
    /// `side` places on each emitter, shifted from place to place.
    pub fn new(case: &Case, which: &str, room: &Room, view: &RoomView, object: &Object, side: u32) -> Self {
        Self::of_pixels(case, &free_pixels(case, which), room, view, object, side)
    }

    /// As [`Traced::new`] for an object that is in no picture of the case.
    pub fn of_another(case: &Case, room: &Room, view: &RoomView, object: &Object, side: u32) -> Self {
        let eye = case.world_from_camera.translation.as_vec3();
        let sees_room = |at: &Option<Seen>| {
            at.as_ref()
                .is_some_and(|at| !at.emits && !object.bvh.occluded(eye, at.point - eye, 0.0, 1.0 - 1e-4))
        };
        let whole: Vec<bool> =
            view.seen.chunks(view.per_pixel).map(|seen| seen.iter().all(sees_room)).collect();
        // An edge between a pixel's places is seen at its neighbours'.
        let width = case.lens.width as usize;
        let around = |i: usize| [i.wrapping_sub(width), i.wrapping_sub(1), i, i + 1, i + width];
        let is_free = |i| around(i).iter().all(|&k| whole.get(k).copied().unwrap_or(true));
        let free: Vec<bool> = (0..whole.len()).map(is_free).collect();
        Self::of_pixels(case, &free, room, view, object, side)
    }

    fn of_pixels(
        case: &Case,
        free: &[bool],
        room: &Room,
        view: &RoomView,
        object: &Object,
        side: u32,
    ) -> Self {
        let statics = Statics::new(room);
        let emitters: Vec<([Vec3; 3], Aabb, [f32; 3])> = room
            .surfaces
            .iter()
            .filter(|s| s.emitted_rgb != [0.0; 3])
            .map(|s| {
                let c = &s.corners_world;
                ([c[0], c[1] - c[0], c[3] - c[0]], Aabb::around(c.iter().copied()), s.emitted_rgb)
            })
            .collect();
        let width = case.lens.width as usize;
        let wanted = |i: &usize| free[*i] && (i % width).is_multiple_of(2) && (i / width).is_multiple_of(2);
        let taken = |at: &Seen, seed: u32| -> [f32; 3] {
            let mut sum = [0.0f32; 3];
            let from = at.point + at.normal * 2e-4;
            for ([origin, u, v], bounds, radiance) in &emitters {
                if shaft_interval(bounds, &Aabb::around([from]), &object.bounds).is_none() {
                    continue;
                }
                let area = u.cross(*v);
                let mut share = 0.0;
                for k in 0..side * side {
                    let turn = |step: f32| (seed as f32 * step).fract();
                    let [x, y] = [(k % side, turn(0.754_877_7)), (k / side, turn(0.569_840_3))]
                        .map(|(cell, shift)| (cell as f32 + shift) / side as f32);
                    let place = *origin + *u * x + *v * y;
                    let to = place - from;
                    let (here, there) = (at.normal.dot(to), -area.dot(to));
                    if here > 0.0
                        && there > 0.0
                        && object.hides(at.point, at.normal, place)
                        && !statics.hides(from, place)
                    {
                        share += here * there / to.length_squared().powi(2);
                    }
                }
                let scale = share / (side * side) as f32 / std::f32::consts::PI;
                for c in 0..3 {
                    sum[c] += radiance[c] * at.reflectance[c] * scale;
                }
            }
            sum
        };
        let pixels = (0..view.seen.len() / view.per_pixel)
            .into_par_iter()
            .filter(wanted)
            .map(|i| {
                let places = &view.seen[i * view.per_pixel..(i + 1) * view.per_pixel];
                let mut sum = 0.0;
                for (k, at) in places.iter().enumerate() {
                    let seed = (i * view.per_pixel + k) as u32 & 0xffff;
                    sum += at.as_ref().map_or(0.0, |at| f64::from(color::luminance(taken(at, seed))));
                }
                (i, sum / view.per_pixel as f64)
            })
            .collect();
        Self { pixels }
    }

    /// How far off it is from `diff_X` of the case: the reference's noise, if both are right.
    pub fn against_reference(&self, case: &Case, which: &str) -> Off {
        let reference: RadianceImage =
            pictures::load_raw(&case.image(&format!("diff_{which}")).unwrap().file).unwrap();
        let luminance = |i: usize| f64::from(color::luminance(reference.pixels()[i]));
        Off::of(self.pixels.iter().map(|&(i, own)| (own, luminance(i))).collect())
    }

    /// How far off a picture is from it.
    pub fn compare(&self, got: &[[f32; 3]]) -> Off {
        Off::of(self.pixels.iter().map(|&(i, truth)| (f64::from(color::luminance(got[i])), truth)).collect())
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
    /// Pixels that counted.
    pub pixels: usize,
}

impl Off {
    fn of(pixels: Vec<(f64, f64)>) -> Self {
        let largest = pixels.iter().map(|p| p.1).fold(0.0, f64::max);
        let (mut error, mut square, mut count) = (0.0, 0.0, 0);
        for (got, truth) in pixels.iter().filter(|p| p.0.max(p.1) > 0.01 * largest) {
            error += (got - truth) * (got - truth);
            square += truth * truth;
            count += 1;
        }
        let sums = pixels.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        Self { rmse: (error / square).sqrt(), energy: sums.0 / sums.1, pixels: count }
    }
}

/// Pixels that show neither an emitter nor the object.
fn free_pixels(case: &Case, which: &str) -> Vec<bool> {
    let mask = pictures::load_gray8(&case.image(&format!("mask_{which}")).unwrap().file).unwrap();
    let emitters = pictures::load_gray8(&case.image("mask_emitters").unwrap().file).unwrap();
    mask.pixels().iter().zip(emitters.pixels()).map(|(mask, emitter)| *mask == 0 && *emitter == 0).collect()
}

/// Compares with `diff_X` of the case where `mask_X` is 0 and no emitter is seen.
pub fn compare(case: &Case, which: &str, got: &[[f32; 3]]) -> Off {
    let truth: RadianceImage =
        pictures::load_raw(&case.image(&format!("diff_{which}")).unwrap().file).unwrap();
    let free = free_pixels(case, which);
    let truth = |i: usize| f64::from(color::luminance(truth.pixels()[i]));
    Off::of(
        (0..got.len())
            .filter(|i| free[*i])
            .map(|i| (f64::from(color::luminance(got[i])), truth(i)))
            .collect(),
    )
}
