//! The scene on the device: vertex and index buffers, uploaded when the scene changes; of objects that move, their
//! vertices alone.
//!
//! The rasteriser draws straight edges. Through a lens with distortion they should bow, so for such lenses
//! what is in view is cut anew for every pose, until no edge looks long from the eye; through a pinhole the triangles
//! stay as they are.

use std::ops::Range;

use glam::Vec3;

use super::{
    buffers::{GrowingBuffer, write_bytes},
    context::GpuContext,
    extents::Extents,
    params::{MaterialTerms, ObjectVertex, SurfaceVertex},
};
use crate::compose::geometry::{ObjectGeometry, SurfaceGeometry};
use crate::compose::{
    halving::{Halve, Halving, distance_to_segment},
    soft_grid::{GridVertex, SoftGrid},
    transferred::Transferred,
};

/// Bytes from one material to the next: the largest alignment that a device may ask for.
pub const MATERIAL_STRIDE: usize = 256;
/// Shorter edges are never cut, metres.
const SHORTEST_CUT_M: f32 = 1e-3;
/// Triangles at most after cutting.
const MOST_TRIANGLES: usize = 400_000;

/// Indexed triangles on the device.
pub struct DeviceMesh {
    vertices: GrowingBuffer,
    indices: GrowingBuffer,
    count: u32,
}

impl DeviceMesh {
    /// None yet.
    pub const fn new() -> Self {
        let usage = wgpu::BufferUsages::VERTEX;
        Self {
            vertices: GrowingBuffer::new("vertices", usage),
            indices: GrowingBuffer::new("indices", wgpu::BufferUsages::INDEX),
            count: 0,
        }
    }

    /// Whether what was uploaded is still there.
    pub fn is_live(&self) -> bool {
        self.vertices.is_live() && self.indices.is_live()
    }

    /// Uploads.
    pub fn write<V: bytemuck::Pod>(&mut self, context: &GpuContext, vertices: &[V], triangles: &[[u32; 3]]) {
        self.vertices.write(context, bytemuck::cast_slice(vertices));
        self.indices.write(context, bytemuck::cast_slice(triangles));
        self.count = 3 * triangles.len() as u32;
    }

    /// Draws all of it, so many times.
    pub fn draw(&mut self, context: &GpuContext, pass: &mut wgpu::RenderPass<'_>, instances: u32) {
        if self.count > 0 && instances > 0 {
            self.bind(context, pass);
            pass.draw_indexed(0..self.count, 0, 0..instances);
        }
    }

    /// Draws triangles of its vertices by other indices.
    pub fn draw_indices(
        &mut self,
        context: &GpuContext,
        pass: &mut wgpu::RenderPass<'_>,
        indices: &wgpu::Buffer,
        range: Range<u32>,
    ) {
        if !range.is_empty() {
            pass.set_vertex_buffer(0, self.vertices.at_least(context, 0).slice(..));
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(range, 0, 0..1);
        }
    }

    fn bind(&mut self, context: &GpuContext, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.vertices.at_least(context, 0).slice(..));
        pass.set_index_buffer(self.indices.at_least(context, 0).slice(..), wgpu::IndexFormat::Uint32);
    }
}

/// How meshes are cut: from where they are seen, and how long an edge may look from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Camera's position, world frame, metres.
    pub eye: Vec3,
    /// Camera's axis, unit, world frame.
    pub axis: Vec3,
    /// Half angle of a cone around the axis; what lies outside of it is left out.
    pub half_angle_rad: f32,
    /// Length over distance.
    pub longest_rad: f32,
}

impl Cut {
    /// Whether a triangle may reach into the cone.
    fn may_see(&self, corners: [Vec3; 3]) -> bool {
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let radius = corners.iter().map(|c| c.distance(centre)).fold(0.0, f32::max);
        let to_centre = centre - self.eye;
        let distance = to_centre.length();
        distance <= radius
            || (self.axis.dot(to_centre) / distance).clamp(-1.0, 1.0).acos()
                <= self.half_angle_rad + (radius / distance).asin()
    }
}

/// Objects and surfaces on the device.
pub struct SceneBuffers {
    /// All objects as they are: what casts shadows.
    casters: DeviceMesh,
    /// Objects in view, cut; unused through a pinhole.
    objects: DeviceMesh,
    /// Surfaces, cut where need be.
    surfaces: DeviceMesh,
    /// For each object its indices and its material.
    draws: Vec<(Range<u32>, u32)>,
    materials: GrowingBuffer,
    /// Of each material the specular reflectance and the exponent.
    shine: Vec<([f32; 3], f32)>,
    /// Whether the scene is there, and for what it was cut.
    uploaded: Option<Option<Cut>>,
    /// Vertices that have moved since.
    moved: Vec<Range<usize>>,
    /// On their way to the device; kept from frame to frame.
    vertices: Vec<ObjectVertex>,
    halving: Halving,
    /// Surfaces as a grid for soft shadows at its vertices.
    grid: DeviceMesh,
    extents: Extents,
}

impl SceneBuffers {
    /// Nothing yet.
    pub fn new() -> Self {
        Self {
            casters: DeviceMesh::new(),
            objects: DeviceMesh::new(),
            surfaces: DeviceMesh::new(),
            draws: Vec::new(),
            materials: GrowingBuffer::uniform("materials"),
            shine: Vec::new(),
            uploaded: None,
            moved: Vec::new(),
            vertices: Vec::new(),
            halving: Halving::default(),
            grid: DeviceMesh::new(),
            extents: Extents::default(),
        }
    }

    /// The next `update` uploads anew.
    pub fn invalidate(&mut self) {
        self.uploaded = None;
    }

    /// The next `update` uploads these vertices of the objects; materials, triangles and surfaces stay.
    pub fn note_moved(&mut self, vertices: Range<usize>) {
        if !self.moved.contains(&vertices) {
            self.moved.push(vertices);
        }
    }

    /// Uploads the scene unless it is there already; `cut`: if the lens has distortion.
    pub fn update(
        &mut self,
        context: &GpuContext,
        objects: &ObjectGeometry,
        soft: &Transferred,
        surfaces: &SurfaceGeometry,
        cut: Option<Cut>,
    ) {
        if !(self.casters.is_live() && self.surfaces.is_live()) {
            self.uploaded = None;
        }
        let has_moved = !self.moved.is_empty();
        let is_cut_anew = self.uploaded != Some(cut);
        if self.uploaded.is_none() {
            self.extents.take_objects(objects);
            self.extents.take_surfaces(surfaces);
            self.upload_materials(context, objects);
        } else if has_moved {
            self.extents.take_objects(objects);
            self.upload_moved(context, objects, soft);
        }
        self.moved.clear();
        if is_cut_anew || (has_moved && cut.is_some()) {
            self.upload_objects(context, objects, soft, cut);
        }
        if is_cut_anew {
            self.upload_surfaces(context, surfaces, cut);
        }
        self.uploaded = Some(cut);
    }

    fn upload_moved(&mut self, context: &GpuContext, objects: &ObjectGeometry, soft: &Transferred) {
        for range in &self.moved {
            let vertices = &mut self.vertices;
            vertices.clear();
            let all =
                (range.end <= objects.positions.len()).then(|| object_vertices(objects, soft, range.clone()));
            vertices.extend(all.into_iter().flatten());
            let offset = (range.start * size_of::<ObjectVertex>()) as u64;
            let buffer = self.casters.vertices.at_least(context, 0);
            write_bytes(context, buffer, offset, bytemuck::cast_slice(vertices));
        }
    }

    fn upload_objects(
        &mut self,
        context: &GpuContext,
        objects: &ObjectGeometry,
        soft: &Transferred,
        cut: Option<Cut>,
    ) {
        let mut vertices = std::mem::take(&mut self.vertices);
        vertices.clear();
        vertices.extend(object_vertices(objects, soft, 0..objects.positions.len()));
        if self.uploaded.is_none() {
            self.casters.write(context, &vertices, &objects.triangles);
        }
        let materials = objects.material_of_triangle.iter().copied();
        let mut triangles: Vec<_> = objects.triangles.iter().copied().zip(materials).collect();
        if let Some(cut) = cut {
            triangles = cut_long_edges(&mut self.halving, &mut vertices, &triangles, cut);
            let triangles: Vec<_> = triangles.iter().map(|&(corners, _)| corners).collect();
            self.objects.write(context, &vertices, &triangles);
        }
        self.draws.clear();
        for (number, &(_, material)) in (0u32..).zip(&triangles) {
            match self.draws.last_mut() {
                Some((range, last)) if *last == material => range.end = 3 * (number + 1),
                _ => self.draws.push((3 * number..3 * (number + 1), material)),
            }
        }
        self.vertices = vertices;
    }

    fn upload_materials(&mut self, context: &GpuContext, objects: &ObjectGeometry) {
        let mut bytes = vec![0; MATERIAL_STRIDE * objects.materials.len().max(1)];
        for (slot, m) in bytes.chunks_exact_mut(MATERIAL_STRIDE).zip(&objects.materials) {
            let [a, b, c, d, e, f] = m.lobe;
            let terms = MaterialTerms {
                albedo_rgb: four(m.albedo_rgb, 0.0),
                specular_exponent: four(m.specular_rgb, m.exponent),
                lobe_low: [a, b, c, d],
                lobe_high: [e, f, m.body as f32, 0.0],
            };
            slot[..size_of::<MaterialTerms>()].copy_from_slice(bytemuck::bytes_of(&terms));
        }
        self.materials.write(context, &bytes);
        self.shine.clear();
        self.shine.extend(objects.materials.iter().map(|m| (m.specular_rgb, m.exponent)));
    }

    fn upload_surfaces(&mut self, context: &GpuContext, surfaces: &SurfaceGeometry, cut: Option<Cut>) {
        let mut receives = vec![0.0f32; surfaces.positions.len()];
        // Surfaces share no vertices, so each vertex lies in triangles of one kind only.
        for (corners, &flag) in surfaces.triangles.iter().zip(&surfaces.receives) {
            for &corner in corners {
                receives[corner as usize] = if flag { 1.0 } else { 0.0 };
            }
        }
        let vertices = surfaces.positions.iter().zip(&surfaces.normals).zip(receives);
        let mut vertices: Vec<_> = vertices
            .map(|((position, normal), receives)| SurfaceVertex {
                position: four(position.to_array(), receives),
                normal: normal.to_array(),
            })
            .collect();
        let mut triangles: Vec<_> = surfaces.triangles.iter().map(|&corners| (corners, ())).collect();
        if let Some(cut) = cut {
            triangles = cut_long_edges(&mut self.halving, &mut vertices, &triangles, cut);
        }
        let triangles: Vec<_> = triangles.into_iter().map(|(corners, ())| corners).collect();
        self.surfaces.write(context, &vertices, &triangles);
    }

    /// The materials, one every `MATERIAL_STRIDE` bytes.
    pub fn materials(&mut self, context: &GpuContext) -> wgpu::Buffer {
        self.materials.at_least(context, 0).clone()
    }

    /// Specular reflectance and exponent of each material.
    pub fn shine(&self) -> &[([f32; 3], f32)] {
        &self.shine
    }

    /// Draws all that casts shadows.
    pub fn draw_casters(&mut self, context: &GpuContext, pass: &mut wgpu::RenderPass<'_>) {
        self.casters.draw(context, pass, 1);
    }

    /// Draws the objects of one material after the other; `select` is told each material's number first.
    pub fn draw_objects(
        &mut self,
        context: &GpuContext,
        pass: &mut wgpu::RenderPass<'_>,
        mut select: impl FnMut(&mut wgpu::RenderPass<'_>, u32),
    ) {
        let cut = self.uploaded.flatten().is_some();
        let mesh = if cut { &mut self.objects } else { &mut self.casters };
        if mesh.count > 0 {
            mesh.bind(context, pass);
            for (range, material) in &self.draws {
                select(pass, *material);
                pass.draw_indexed(range.clone(), 0, 0..1);
            }
        }
    }

    /// Draws all real surfaces.
    pub fn draw_surfaces(&mut self, context: &GpuContext, pass: &mut wgpu::RenderPass<'_>) {
        self.surfaces.draw(context, pass, 1);
    }

    /// Uploads the grid of a frame; `cut`: if the lens has distortion.
    pub fn upload_grid(&mut self, context: &GpuContext, grid: &SoftGrid, cut: Option<Cut>) {
        let vertex = |v: &GridVertex| SurfaceVertex {
            position: four(v.position_world.to_array(), if v.receiver == u32::MAX { 0.0 } else { 1.0 }),
            normal: v.normal.to_array(),
        };
        let mut vertices: Vec<_> = grid.vertices().iter().map(vertex).collect();
        let Some(cut) = cut else { return self.grid.write(context, &vertices, grid.triangles()) };
        let triangles: Vec<_> = grid.triangles().iter().map(|&corners| (corners, ())).collect();
        let triangles = cut_long_edges(&mut self.halving, &mut vertices, &triangles, cut);
        let triangles: Vec<_> = triangles.into_iter().map(|(corners, ())| corners).collect();
        self.grid.write(context, &vertices, &triangles);
    }

    /// Records one draw of all its triangles.
    pub fn draw_grid(&mut self, context: &GpuContext, pass: &mut wgpu::RenderPass<'_>) {
        self.grid.draw(context, pass, 1);
    }

    /// Boxes around all that was uploaded.
    pub fn extents(&self) -> &Extents {
        &self.extents
    }
}

/// Vertices of a range as the device has them.
fn object_vertices<'a>(
    objects: &'a ObjectGeometry,
    soft: &'a Transferred,
    range: Range<usize>,
) -> impl Iterator<Item = ObjectVertex> + use<'a> {
    let points = objects.positions[range.clone()].iter().zip(&objects.normals[range.clone()]);
    let answers = soft.soft()[range.clone()].iter().zip(&soft.gloss()[range.clone()]);
    let answers = objects.tint_openness[range].iter().zip(answers);
    points.zip(answers).map(|((position, normal), (&tint_openness, (&soft, &gloss)))| {
        let (position, normal) = (position.to_array(), normal.to_array());
        ObjectVertex { position, normal, tint_openness, soft, gloss }
    })
}

fn four([x, y, z]: [f32; 3], w: f32) -> [f32; 4] {
    [x, y, z, w]
}

/// Half way between.
pub fn mean<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|i| 0.5 * (a[i] + b[i]))
}

impl Halve for ObjectVertex {
    fn position(&self) -> Vec3 {
        self.position.into()
    }

    fn between(&self, other: &Self) -> Self {
        Self {
            position: mean(self.position, other.position),
            normal: mean(self.normal, other.normal),
            tint_openness: mean(self.tint_openness, other.tint_openness),
            soft: mean(self.soft, other.soft),
            gloss: mean(self.gloss, other.gloss),
        }
    }
}

impl Halve for SurfaceVertex {
    fn position(&self) -> Vec3 {
        Vec3::from_slice(&self.position)
    }

    fn between(&self, other: &Self) -> Self {
        Self { position: mean(self.position, other.position), normal: mean(self.normal, other.normal) }
    }
}

/// Halves every edge that looks longer than a limit from the eye, and leaves out what is not in view.
pub fn cut_long_edges<V: Halve, T: Copy>(
    halving: &mut Halving,
    vertices: &mut Vec<V>,
    triangles: &[([u32; 3], T)],
    cut: Cut,
) -> Vec<([u32; 3], T)> {
    let limit_m =
        |a: Vec3, b: Vec3| (cut.longest_rad * distance_to_segment(cut.eye, a, b)).max(SHORTEST_CUT_M);
    let mut out = Vec::with_capacity(triangles.len());
    let may_see = |corners| cut.may_see(corners);
    halving.cut(vertices, triangles.iter().copied(), limit_m, may_see, MOST_TRIANGLES, &mut out);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vertex(x: f32, y: f32) -> SurfaceVertex {
        SurfaceVertex { position: [x, y, 0.0, 1.0], normal: [0.0, 0.0, 1.0] }
    }

    const EVERYWHERE: Cut =
        Cut { eye: Vec3::ZERO, axis: Vec3::NEG_Z, half_angle_rad: std::f32::consts::PI, longest_rad: 1.0 };

    #[test]
    fn what_is_out_of_view_is_left_out() {
        let mut vertices =
            vec![vertex(-50.0, -50.0), vertex(50.0, -50.0), vertex(50.0, 50.0), vertex(-50.0, 50.0)];
        let how = Cut { eye: 0.5 * Vec3::Z, half_angle_rad: 0.5, longest_rad: 0.05, ..EVERYWHERE };
        let cut =
            cut_long_edges(&mut Halving::default(), &mut vertices, &[([0, 1, 2], ()), ([0, 2, 3], ())], how);
        assert!(cut.len() > 500 && cut.len() < 5000, "{}", cut.len());
        for (corners, ()) in cut {
            let centre: Vec3 =
                corners.map(|i| vertices[i as usize].position()).into_iter().sum::<Vec3>() / 3.0;
            assert!(centre.length() < 0.5 * 0.62f32.tan(), "{centre}");
        }
    }

    #[test]
    fn cutting_keeps_the_area_and_leaves_no_gap() {
        let mut vertices = vec![vertex(0.0, 0.0), vertex(3.0, 0.0), vertex(3.0, 1.0), vertex(0.0, 1.0)];
        let how = Cut { eye: Vec3::new(1.0, 0.3, 0.4), longest_rad: 0.05, ..EVERYWHERE };
        let cut =
            cut_long_edges(&mut Halving::default(), &mut vertices, &[([0, 1, 2], 0), ([0, 2, 3], 1)], how);
        assert!(cut.len() > 3000 && cut.len() < 30_000, "{}", cut.len());
        let mut area = 0.0f64;
        let mut sides = std::collections::HashMap::new();
        for (corners, _) in &cut {
            let [a, b, c] = corners.map(|i| vertices[i as usize].position());
            area += 0.5 * f64::from((b - a).cross(c - a).z);
            for k in 0..3 {
                let (p, q) = (corners[k], corners[(k + 1) % 3]);
                *sides.entry((p.min(q), p.max(q))).or_insert(0) += 1;
                let (p, q) = (vertices[p as usize].position(), vertices[q as usize].position());
                assert!(p.distance(q) <= 1.001 * how.longest_rad * distance_to_segment(how.eye, p, q));
            }
        }
        assert!((area - 3.0).abs() < 1e-4, "{area}");
        // Every inner side belongs to two pieces; a gap would show as a side of one piece off the border.
        for ((p, q), count) in sides {
            let (p, q) = (vertices[p as usize].position(), vertices[q as usize].position());
            let border =
                (p.x == q.x && (p.x == 0.0 || p.x == 3.0)) || (p.y == q.y && (p.y == 0.0 || p.y == 1.0));
            assert_eq!(count, if border { 1 } else { 2 }, "{p} {q}");
        }
    }

    #[test]
    fn edges_that_look_short_stay() {
        let mut vertices = vec![vertex(0.0, 0.0), vertex(0.025, 0.0), vertex(0.0, 0.025)];
        let how = Cut { eye: Vec3::Z, longest_rad: 0.03, ..EVERYWHERE };
        let cut = cut_long_edges(&mut Halving::default(), &mut vertices, &[([0, 1, 2], ())], how);
        assert_eq!((cut.len(), vertices.len()), (2, 4), "only the diagonal of 35 mm at 1 m is halved");
    }
}
