//! Soft light at the vertices of objects: what has been precomputed for those that never move (Eq. 19 and 20 of [Now11]),
//! and what the spheres of other bodies take. The device gets the results as vertex attributes.
//!
//! # Gloss
//! L_out = sum of (L_g)_i (M^V f)_i, f the lobe turned to the mirror direction. Gamma is symmetric, so this is (M^{L_g} f) . V
//! and f . (M^{L_g} V), exactly for the truncated series (a test holds it): a vertex keeps the order^2 numbers of V, not the
//! order^4 of M^V. The lighting product matrix is built once for each light, and with it the products M^{L_g} (1 - V), so
//! that turning the camera costs order^2 multiplications a vertex and channel. What is handed on is the *share* of the lobe's
//! light that is left, within 0 to 1: pixels keep their own highlights, which change faster than a mesh's vertices follow,
//! and a vertex that nothing blocks changes none of them.
//!
//! A lobe that SH is too smooth for is read from the picture of the environment instead, times V~ = clamp(sum of
//! V_i y_i(r), 0, 1), and times what each sphere of another body leaves of the lobe.
//!
//! # Whose spheres
//! An object with precomputed transfer knows all that never moves by its rays; it counts the spheres of what moves. Any other
//! object counts those of all bodies but its own, V times V of the spheres being cut to the order and then bounded.

use super::geometry::{MIRROR_EXPONENT, MaterialTerms, ObjectGeometry};
use super::shade_object::{LightTerms, Surroundings};
use super::soft_shadow::Transfer;
use crate::math::sh::{MAX_COEFFICIENTS, basis, lanes, log_exp::whole, product};
use crate::model::{
    blocker::{BlockerBox, BlockerSphere, Rung},
    quality::{Quality, SelfShadow},
    scene::Scene,
    transfer::SceneTransfer,
};
use crate::visibility::{blockers::Blockers, lobes};
use glam::Vec3;
use half::f16;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Vertices that one task takes.
const CHUNK: usize = 64;

/// A lobe's light below this share of L_0 counts as none.
const DARK: f32 = 1e-3;

type ShRow = [f32; MAX_COEFFICIENTS];

/// What a frame asks of the vertices.
#[derive(Clone, Copy)]
pub struct VertexFrame<'a> {
    /// Hard lights, and the rest as harmonics.
    pub light: &'a LightTerms,
    /// Where the vertices are.
    pub objects: &'a ObjectGeometry,
    /// Whether any object has moved since the last frame.
    pub moved: bool,
    /// Spheres of all bodies that block soft light, world frame.
    pub spheres: &'a [BlockerSphere],
    /// Boxes for the thin parts of all bodies, likewise.
    pub boxes: &'a [BlockerBox],
    /// The camera, world frame, metres.
    pub eye_world: Vec3,
    /// Which lobes are sharp.
    pub surroundings: Surroundings<'a>,
    /// `self_shadow`, `rung` and `directions` count.
    pub quality: &'a Quality,
}

/// What an object is to its vertices.
#[derive(Clone, Debug, Default)]
struct BodyVertices {
    vertices: Range<usize>,
    /// Whether it has rows of transfer, and of visibility.
    has_rows: bool,
    has_blocked: bool,
    /// Where its products begin.
    first_product: usize,
    /// Whether the spheres of others may block its light.
    is_blocked: bool,
    /// Whether its two results changed with the last update.
    changed: bool,
}

/// For all vertices of a scene what soft light does there. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Transferred {
    transfer: Option<Arc<SceneTransfer>>,
    parts: Vec<BodyVertices>,
    /// Bodies that move.
    movers: Vec<u32>,
    soft: Vec<[f32; 4]>,
    gloss: Vec<[f32; 3]>,
    matrix: Transfer,
    /// M^{L_g} (1 - V) of the vertices with visibility, order^2 numbers each.
    products: Vec<[f32; 3]>,
    /// All spheres, and those of what moves.
    all: Blockers,
    moving: Blockers,
    spheres: Vec<BlockerSphere>,
    moving_spheres: Vec<BlockerSphere>,
    moving_boxes: Vec<BlockerBox>,
    last: Option<VertexInputs>,
}

/// What the results were made for.
#[derive(Clone, Copy, Debug, PartialEq)]
struct VertexInputs {
    eye_world: Vec3,
    self_shadow: SelfShadow,
    rung: Rung,
    directions: usize,
    has_levels: bool,
}

impl Transferred {
    /// Takes a scene and its transfer; objects whose number of vertices does not fit are left to their openness.
    pub fn load(&mut self, scene: &Scene) {
        self.transfer.clone_from(&scene.transfer);
        let order = self.transfer.as_ref().map_or(0, |t| t.order);
        self.parts.clear();
        self.movers.clear();
        let (mut first, mut first_product) = (0, 0);
        for (index, object) in scene.objects.iter().enumerate() {
            let end = first + object.mesh.positions.len();
            let numbers = (end - first) * order * order;
            let rows = self.transfer.as_ref().and_then(|t| t.objects.get(index)?.as_ref());
            let has_rows = numbers > 0 && rows.is_some_and(|o| o.rows.len() == numbers);
            let has_blocked = has_rows && rows.is_some_and(|o| o.blocked.len() == numbers);
            self.parts.push(BodyVertices {
                vertices: first..end,
                has_rows,
                has_blocked,
                first_product,
                ..BodyVertices::default()
            });
            first_product += if has_blocked { end - first } else { 0 };
            first = end;
        }
        let first_part =
            |figure: &crate::model::animation::Figure| figure.parts.first().map(|p| p.object as u32);
        self.movers.extend(scene.figures.iter().filter(|f| !f.is_still()).filter_map(first_part));
        self.soft.clear();
        self.soft.resize(first, [0.0; 4]);
        self.gloss.clear();
        self.gloss.resize(first, [1.0; 3]);
        self.last = None;
    }

    /// Takes over the light, the camera, the spheres and the settings of a frame. Free where nothing has changed.
    pub fn update(&mut self, frame: &VertexFrame<'_>) {
        let new_light = self.matrix.update(frame.light) || self.last.is_none();
        let now = VertexInputs {
            eye_world: frame.eye_world,
            self_shadow: frame.quality.self_shadow,
            rung: frame.quality.rung,
            directions: frame.quality.directions,
            has_levels: frame.surroundings.has_levels(),
        };
        let new_settings =
            self.last.is_none_or(|last| VertexInputs { eye_world: now.eye_world, ..last } != now)
                || new_light;
        let new_kind = self.last.is_none_or(|last| last.self_shadow != now.self_shadow);
        let new_eye = self.last.is_none_or(|last| last.eye_world != now.eye_world);
        self.last = Some(now);
        let new_spheres = self.spheres != frame.spheres || frame.moved;
        self.take_spheres(frame, new_spheres || new_settings);
        let uses_transfer = now.self_shadow == SelfShadow::Transfer;
        if new_settings && uses_transfer {
            self.take_products();
        }
        let mut parts = std::mem::take(&mut self.parts);
        for (part, material) in parts.iter_mut().zip(&frame.objects.materials) {
            let precomputed = uses_transfer && part.has_rows;
            let blockers = if precomputed { &self.moving } else { &self.all };
            let was_blocked = part.is_blocked;
            part.is_blocked = blockers.has_others(material.body);
            let new_blockers = new_spheres && (part.is_blocked || was_blocked);
            let is_glossy = material.exponent != MIRROR_EXPONENT && material.specular_rgb != [0.0; 3];
            let sees_eye = is_glossy && (part.is_blocked || (precomputed && part.has_blocked));
            let by_light = new_settings && (precomputed || part.is_blocked);
            part.changed = by_light || new_kind || new_blockers || (new_eye && sees_eye);
        }
        let (mut soft, mut gloss) = (std::mem::take(&mut self.soft), std::mem::take(&mut self.gloss));
        for (index, (part, material)) in parts.iter().zip(&frame.objects.materials).enumerate() {
            if part.changed {
                let object = Object::new(self, frame, index, part, material);
                let range = part.vertices.clone();
                let out = soft[range.clone()].par_chunks_mut(CHUNK).zip(gloss[range].par_chunks_mut(CHUNK));
                out.enumerate().for_each(|(chunk, (soft, gloss))| object.chunk(chunk * CHUNK, soft, gloss));
            }
        }
        (self.parts, self.soft, self.gloss) = (parts, soft, gloss);
    }

    /// Whether an update for a frame would change any result; says so, too, where it cannot be sure.
    pub fn would_change(&self, frame: &VertexFrame<'_>) -> bool {
        let Some(last) = self.last else { return true };
        let now = VertexInputs {
            eye_world: frame.eye_world,
            self_shadow: frame.quality.self_shadow,
            rung: frame.quality.rung,
            directions: frame.quality.directions,
            has_levels: frame.surroundings.has_levels(),
        };
        let is_same = VertexInputs { eye_world: now.eye_world, ..last } == now
            && self.matrix.is_of(frame.light)
            && self.spheres == frame.spheres
            && !frame.moved;
        let sees_eye = |(part, material): (&BodyVertices, &MaterialTerms)| {
            let is_glossy = material.exponent != MIRROR_EXPONENT && material.specular_rgb != [0.0; 3];
            is_glossy && (part.is_blocked || part.has_blocked)
        };
        let by_eye = || self.parts.iter().zip(&frame.objects.materials).any(sees_eye);
        !is_same || (last.eye_world != now.eye_world && by_eye())
    }

    /// Ranges of vertices whose results the last update has changed.
    pub fn changed(&self) -> impl Iterator<Item = Range<usize>> {
        self.parts.iter().filter(|part| part.changed).map(|part| part.vertices.clone())
    }

    /// Replaces the soft light at every vertex by light that is known there otherwise, such as a room's: `white` gives for
    /// an object and a vertex of the scene what a white matt surface radiates there, its own shadow counted.
    pub fn put(&mut self, white: impl Fn(usize, usize) -> [f32; 3] + Sync) {
        for (index, part) in self.parts.iter_mut().enumerate() {
            part.changed = true;
            let first = part.vertices.start;
            let soft = self.soft[part.vertices.clone()].par_chunks_mut(CHUNK).enumerate();
            soft.for_each(|(chunk, soft)| {
                for (k, slot) in soft.iter_mut().enumerate() {
                    let [r, g, b] = white(index, first + chunk * CHUNK + k);
                    *slot = [r, g, b, 1.0];
                }
            });
        }
    }

    /// For each vertex of the scene: what a white matt surface radiates there under the soft half, and 1, where it has
    /// transfer; else what the spheres of others take of that, and 0.
    pub fn soft(&self) -> &[[f32; 4]] {
        &self.soft
    }

    /// For each vertex the share, 0 to 1, that is left of the light of its glossy lobe as seen from the camera, each channel.
    pub fn gloss(&self) -> &[[f32; 3]] {
        &self.gloss
    }

    fn take_spheres(&mut self, frame: &VertexFrame<'_>, changed: bool) {
        if !changed {
            return;
        }
        self.spheres.clear();
        self.spheres.extend_from_slice(frame.spheres);
        let (rung, order, directions) = (frame.quality.rung, frame.light.order, frame.quality.directions);
        self.all.prepare(frame.spheres, rung, order, directions);
        self.all.add_boxes(frame.boxes);
        self.moving_spheres.clear();
        let moving = frame.spheres.iter().filter(|sphere| self.movers.contains(&sphere.body));
        self.moving_spheres.extend(moving);
        self.moving.prepare(&self.moving_spheres, rung, order, directions);
        self.moving_boxes.clear();
        self.moving_boxes.extend(frame.boxes.iter().filter(|b| self.movers.contains(&b.body)));
        self.moving.add_boxes(&self.moving_boxes);
    }

    /// M^{L_g} (1 - V) for the light at hand.
    fn take_products(&mut self) {
        let Some(transfer) = &self.transfer else { return };
        let matrix = &self.matrix;
        let count = matrix.order() * matrix.order();
        let vertices = self.parts.iter().filter(|p| p.has_blocked).map(|p| p.vertices.len()).sum::<usize>();
        self.products.resize(vertices * count, [0.0; 3]);
        for (part, rows) in self.parts.iter().zip(&transfer.objects).filter(|(part, _)| part.has_blocked) {
            let Some(rows) = rows else { continue };
            let first = part.first_product * count;
            let out = self.products[first..first + part.vertices.len() * count].par_chunks_mut(count);
            out.zip(rows.blocked.par_chunks(transfer.order * transfer.order)).for_each(|(out, row)| {
                let blocked = widened(row, matrix.order());
                if blocked[0] == 0.0 {
                    out.fill([0.0; 3]);
                } else {
                    out.copy_from_slice(&matrix.of_lobe(&blocked)[..count]);
                }
            });
        }
    }
}

/// The first bands of a kept row.
fn widened(row: &[f16], order: usize) -> ShRow {
    let mut out = [0.0; MAX_COEFFICIENTS];
    for (out, t) in out.iter_mut().zip(row).take(order * order) {
        *out = t.to_f32();
    }
    out
}

/// One object of a frame.
struct Object<'a> {
    geometry: &'a ObjectGeometry,
    vertices: Range<usize>,
    material: &'a MaterialTerms,
    light: &'a LightTerms,
    matrix: &'a Transfer,
    eye_world: Vec3,
    /// Rows of transfer and of 1 - V, and the products with the latter, vertex by vertex.
    rows: Option<&'a [f16]>,
    blocked: Option<&'a [f16]>,
    products: &'a [[f32; 3]],
    /// Numbers of a kept row.
    kept: usize,
    is_glossy: bool,
    is_sharp: bool,
    blockers: Option<&'a Blockers>,
}

impl<'a> Object<'a> {
    fn new(
        whole: &'a Transferred,
        frame: &'a VertexFrame<'a>,
        index: usize,
        part: &BodyVertices,
        material: &'a MaterialTerms,
    ) -> Self {
        let transfer =
            whole.transfer.as_deref().filter(|_| frame.quality.self_shadow == SelfShadow::Transfer);
        let rows = transfer.filter(|_| part.has_rows).and_then(|t| t.objects.get(index)?.as_ref());
        let is_glossy = material.exponent != MIRROR_EXPONENT && material.specular_rgb != [0.0; 3];
        let blockers = if rows.is_some() { &whole.moving } else { &whole.all };
        let count = whole.matrix.order() * whole.matrix.order();
        let first = part.first_product * count;
        Self {
            geometry: frame.objects,
            vertices: part.vertices.clone(),
            material,
            light: frame.light,
            matrix: &whole.matrix,
            eye_world: frame.eye_world,
            rows: rows.map(|o| &o.rows[..]),
            blocked: rows.map(|o| &o.blocked[..]).filter(|_| part.has_blocked && is_glossy),
            products: whole.products.get(first..).unwrap_or_default(),
            kept: transfer.map_or(0, |t| t.order * t.order),
            is_glossy,
            is_sharp: frame.surroundings.is_sharp(material.exponent),
            blockers: Some(blockers).filter(|_| part.is_blocked),
        }
    }

    /// The vertices from number `first` of the object on.
    fn chunk(&self, first: usize, soft: &mut [[f32; 4]], gloss: &mut [[f32; 3]]) {
        let Some(blockers) = self.blockers else {
            for (k, (soft, gloss)) in soft.iter_mut().zip(gloss).enumerate() {
                (*soft, *gloss) = self.vertex(first + k, None);
            }
            return;
        };
        let here = self.vertices.start + first..self.vertices.start + first + soft.len();
        let (points, normals) = (&self.geometry.positions[here.clone()], &self.geometry.normals[here]);
        blockers.visibility_many(points, normals, Some(self.material.body), |k, v| {
            let is_open = v[0] == whole::<f32>() && v[1..].iter().all(|v| *v == 0.0);
            (soft[k], gloss[k]) = self.vertex(first + k, Some(v).filter(|_| !is_open));
        });
    }

    /// Both results; `seen`: V of the spheres of others, where they block anything.
    fn vertex(&self, k: usize, seen: Option<&ShRow>) -> ([f32; 4], [f32; 3]) {
        let order = self.matrix.order();
        let normal = self.geometry.normals[self.vertices.start + k];
        let openness = self.geometry.tint_openness[self.vertices.start + k][3];
        let row = |rows: &[f16]| widened(&rows[k * self.kept..(k + 1) * self.kept], order);
        let transfer = self.rows.map(row);
        let taken = seen.map(|v| {
            let answer = match &transfer {
                Some(transfer) => self.matrix.of_lobe(transfer),
                None => self.matrix.of_normal(normal).map(|rgb| rgb.map(|c| openness * c)),
            };
            gathered(&answer, &without(v), order)
        });
        let taken = taken.unwrap_or([0.0; 3]);
        let soft = match &transfer {
            Some(transfer) => {
                let [r, g, b] = gathered(&self.light.global_rgb, transfer, order);
                [r - taken[0], g - taken[1], b - taken[2], 1.0]
            }
            None => [taken[0], taken[1], taken[2], 0.0],
        };
        if !self.is_glossy {
            return (soft, [openness; 3]);
        }
        let share = if self.blocked.is_some() { 1.0 } else { openness };
        let blocked = self.blocked.map(row).filter(|b| b[0] != 0.0);
        if blocked.is_none() && seen.is_none() {
            return (soft, [share; 3]);
        }
        let to_eye = (self.eye_world - self.geometry.positions[self.vertices.start + k]).normalize_or_zero();
        let along = 2.0 * normal.dot(to_eye) * normal - to_eye;
        if self.is_sharp {
            return (soft, [share * self.share_along(k, along, normal, blocked.as_ref(), seen); 3]);
        }
        let mut lobe = [0.0; MAX_COEFFICIENTS];
        basis::evaluate(order, along.to_array(), &mut lobe);
        for (i, f) in lobe.iter_mut().enumerate().take(order * order) {
            *f *= self.material.lobe[i.isqrt()];
        }
        let hidden = match (&blocked, seen) {
            (Some(blocked), Some(v)) => Some(both(order, blocked, v)),
            (None, Some(v)) => Some(without(v)),
            _ => None,
        };
        let taken = match &hidden {
            Some(hidden) => gathered(&self.matrix.of_lobe(&lobe), hidden, order),
            None => gathered(&self.products[k * order * order..(k + 1) * order * order], &lobe, order),
        };
        let open = gathered(&self.light.global_rgb, &lobe, order);
        // Where hardly any light comes from, what is left of it is a matter of directions alone.
        let of_directions = || {
            let hidden = hidden.as_ref().or(blocked.as_ref());
            1.0 - hidden.map_or(0.0, |h| h.iter().zip(&lobe).map(|(h, f)| h * f).sum::<f32>())
        };
        let left = std::array::from_fn(|c| {
            let is_lit = open[c] > DARK * self.light.global_rgb[0][c].abs();
            let left = if is_lit { (open[c] - taken[c]) / open[c] } else { of_directions() };
            share * left.clamp(0.0, 1.0)
        });
        (soft, left)
    }

    /// V~ of a sharp lobe about a unit direction.
    fn share_along(
        &self,
        k: usize,
        along: Vec3,
        normal: Vec3,
        blocked: Option<&ShRow>,
        seen: Option<&ShRow>,
    ) -> f32 {
        let mut left = 1.0;
        if let Some(blocked) = blocked {
            let mut y = [0.0; MAX_COEFFICIENTS];
            basis::evaluate(self.matrix.order(), along.to_array(), &mut y);
            let hidden: f32 = blocked.iter().zip(y).map(|(b, y)| b * y).sum();
            left = (1.0 - hidden).clamp(0.0, 1.0);
        }
        let point = self.geometry.positions[self.vertices.start + k];
        if let (Some(_), Some(blockers)) = (seen, self.blockers) {
            for sphere in blockers.spheres().iter().filter(|sphere| sphere.body != self.material.body) {
                left *= lobes::share_left(self.material.exponent, along, point, normal, sphere);
            }
            for b in blockers.boxes().iter().filter(|b| b.body != self.material.body) {
                left *= lobes::share_left_by_box(self.material.exponent, along, point, normal, b);
            }
        }
        left
    }
}

/// 1 - V.
fn without(v: &ShRow) -> ShRow {
    let mut blocked = v.map(|v| -v);
    blocked[0] += whole::<f32>();
    blocked
}

/// 1 - V V', V = 1 - `blocked`: the product cut to the order, then within what 0 <= V <= 1 allows.
fn both(order: usize, blocked: &ShRow, seen: &ShRow) -> ShRow {
    let mut out = [0.0; MAX_COEFFICIENTS];
    product::product(order, &without(blocked), seen, &mut out);
    let mut lanes = out.map(|v| lanes::Lane([v]));
    match order {
        0..=2 => lanes::guard::<f32, 2, 1>(&mut lanes),
        3 => lanes::guard::<f32, 3, 1>(&mut lanes),
        4 => lanes::guard::<f32, 4, 1>(&mut lanes),
        5 => lanes::guard::<f32, 5, 1>(&mut lanes),
        _ => lanes::guard::<f32, 6, 1>(&mut lanes),
    }
    without(&lanes.map(|lane| lane.0[0]))
}

fn gathered(rows: &[[f32; 3]], weights: &ShRow, order: usize) -> [f32; 3] {
    let mut sum = [0.0f32; 3];
    for (row, weight) in rows.iter().zip(weights).take(order * order) {
        sum.iter_mut().zip(row).for_each(|(s, c)| *s += weight * c);
    }
    sum
}

#[cfg(test)]
mod tests;
