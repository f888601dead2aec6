//! A known room on the device, triangle by triangle, with what never changes from frame to frame; all other real surfaces
//! stand before it and hide it.

use super::{
    context::GpuContext,
    params::RoomVertex,
    scene::{Cut, DeviceMesh, cut_long_edges, mean},
};
use crate::compose::{
    geometry::SurfaceGeometry,
    halving::{Halve, Halving},
};
use glam::Vec3;

impl Halve for RoomVertex {
    fn position(&self) -> Vec3 {
        self.position.into()
    }

    fn between(&self, other: &Self) -> Self {
        Self {
            position: mean(self.position, other.position),
            gathered: mean(self.gathered, other.gathered),
            weights: mean(self.weights, other.weights),
            ..*self
        }
    }
}

/// Real surfaces of which the last ones are the room's.
pub struct RoomMesh {
    mesh: DeviceMesh,
    /// Whether they are there, and for what they were cut.
    uploaded: Option<Option<Cut>>,
    halving: Halving,
    /// The triangles as they were uploaded, and of which triangle of the room each is a part: none, `u32::MAX`.
    triangles: Vec<([u32; 3], u32)>,
}

impl RoomMesh {
    /// None yet.
    pub fn new() -> Self {
        Self { mesh: DeviceMesh::new(), uploaded: None, halving: Halving::default(), triangles: Vec::new() }
    }

    /// The next `update` uploads anew.
    pub fn invalidate(&mut self) {
        self.uploaded = None;
    }

    /// Uploads the surfaces unless they are there already. The room's triangles begin with number `first`, their corners
    /// as vertices of the room are `triangles`, and `gathered_rgb` is the light at those; `cut`: if the lens has distortion.
    pub fn update(
        &mut self,
        context: &GpuContext,
        surfaces: &SurfaceGeometry,
        (first, triangles): (usize, &[[u32; 3]]),
        gathered_rgb: &[[f32; 3]],
        cut: Option<Cut>,
    ) {
        if self.uploaded == Some(cut) && self.mesh.is_live() {
            return;
        }
        const WEIGHTS: [[f32; 2]; 3] = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]];
        let mut vertices = Vec::with_capacity(3 * surfaces.triangles.len());
        for (t, (corners, normal)) in surfaces.triangles.iter().zip(&surfaces.facet_normals).enumerate() {
            let own = t.checked_sub(first).and_then(|own| Some((own as u32, triangles.get(own)?)));
            for (k, (&corner, weights)) in corners.iter().zip(WEIGHTS).enumerate() {
                let gathered = own.and_then(|(_, of_room)| gathered_rgb.get(of_room[k] as usize));
                vertices.push(RoomVertex {
                    position: surfaces.positions[corner as usize].to_array(),
                    normal: normal.to_array(),
                    gathered: gathered.copied().unwrap_or([0.0; 3]),
                    weights,
                    triangle: own.map_or(u32::MAX, |(own, _)| own),
                });
            }
        }
        let count = vertices.len() as u32 / 3;
        let own = |t: u32| vertices.get(3 * t as usize).map_or(u32::MAX, |vertex| vertex.triangle);
        self.triangles.clear();
        self.triangles.extend((0..count).map(|t| ([3 * t, 3 * t + 1, 3 * t + 2], own(t))));
        if let Some(cut) = cut {
            self.triangles = cut_long_edges(&mut self.halving, &mut vertices, &self.triangles, cut);
        }
        let triangles: Vec<_> = self.triangles.iter().map(|&(corners, _)| corners).collect();
        self.mesh.write(context, &vertices, &triangles);
        self.uploaded = Some(cut);
    }

    /// Draws them all.
    pub fn draw(&mut self, context: &GpuContext, pass: &mut wgpu::RenderPass<'_>) {
        self.mesh.draw(context, pass, 1);
    }

    /// Appends what was uploaded of the room's triangles with these numbers, as corners of the mesh.
    pub fn parts_of(&self, is_chosen: impl Fn(usize) -> bool, out: &mut Vec<[u32; 3]>) {
        let is_part = |own: u32| own != u32::MAX && is_chosen(own as usize);
        out.extend(self.triangles.iter().filter(|(_, own)| is_part(*own)).map(|&(corners, _)| corners));
    }

    /// Draws such parts.
    pub fn draw_parts(
        &mut self,
        context: &GpuContext,
        pass: &mut wgpu::RenderPass<'_>,
        parts: &wgpu::Buffer,
        range: std::ops::Range<u32>,
    ) {
        self.mesh.draw_indices(context, pass, parts, range);
    }

    /// Draws some of the room's triangles by their numbers, in `chosen`'s memory; all, where they were cut.
    pub fn draw_some(
        &mut self,
        context: &GpuContext,
        pass: &mut wgpu::RenderPass<'_>,
        chosen: &wgpu::Buffer,
        range: std::ops::Range<u32>,
    ) {
        match self.uploaded {
            Some(None) => self.mesh.draw_indices(context, pass, chosen, range),
            _ => self.draw(context, pass),
        }
    }
}
