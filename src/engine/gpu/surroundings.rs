//! What mirrors and sharp gloss see, on the device.

use super::{buffers::GrowingBuffer, context::GpuContext, kernel::Resource, params, textures::KeptTexture};
use crate::{
    compose::shade_object::Surroundings,
    math::sh::zonal::PhongNorm,
    model::environment::{EnvironmentPicture, OctahedralMap},
};

const HOLDS_HARD_LIGHTS: u32 = 2;

/// The uniform and the texture; the picture goes to the device when it has changed.
pub struct SurroundingsBuffers {
    uniform: GrowingBuffer,
    environment: KeptTexture,
    terms: Box<params::Surroundings>,
    texels: Vec<[f32; 4]>,
    /// Of the picture that is there.
    revision: Option<u64>,
}

impl SurroundingsBuffers {
    /// Nothing yet.
    pub fn new() -> Self {
        Self {
            uniform: GrowingBuffer::uniform("surroundings"),
            environment: KeptTexture::uploaded("environment", wgpu::TextureFormat::Rgba32Float),
            terms: bytemuck::zeroed_box(),
            texels: Vec::new(),
            revision: None,
        }
    }

    /// Uploads what has changed; the uniform and the texture to bind.
    pub fn write(&mut self, context: &GpuContext, surroundings: &Surroundings<'_>) -> [Resource; 2] {
        if surroundings.picture.is_none() && self.revision.is_some() {
            self.environment.free();
        }
        if !self.environment.is_live() {
            self.revision = None;
        }
        let reflected = surroundings.reflected;
        let (spheres, triangles) = (reflected.spheres(), reflected.largest_triangles());
        let picture = surroundings.picture;
        let terms = &mut *self.terms;
        let flags = picture.map_or(0, |p| if p.holds_hard_lights { HOLDS_HARD_LIGHTS } else { 0 });
        let levels = picture.map_or(0, |p| p.glossy.len().min(terms.levels.len() - 1));
        terms.counts = [spheres.len() as u32, triangles.len() as u32, levels as u32, flags];
        let paper = if surroundings.norm == PhongNorm::Paper { 1.0 } else { 0.0 };
        terms.settings = [paper, 0.0, 0.0, 0.0];
        for (slot, seen) in terms.spheres.iter_mut().zip(spheres) {
            let [r, g, b] = seen.rgb;
            let place = seen.sphere.centre_world.extend(seen.sphere.radius_m);
            *slot = [place.to_array(), [r, g, b, seen.sphere.body as f32]];
        }
        for (slot, seen) in terms.triangles.iter_mut().zip(triangles) {
            let flag = |is: bool| if is { 1.0 } else { 0.0 };
            let [r, g, b] = seen.albedo_rgb.unwrap_or_default();
            *slot = [
                seen.corner.extend(flag(seen.albedo_rgb.is_some())).to_array(),
                seen.edge_u.extend(flag(seen.receives)).to_array(),
                seen.edge_v.extend(0.0).to_array(),
                [r, g, b, 0.0],
            ];
        }
        if let Some(picture) = picture
            && self.revision != Some(picture.revision)
        {
            self.upload(context, picture);
        }
        [self.uniform.write(context, bytemuck::bytes_of(&*self.terms)), self.environment.bind(context)]
    }

    /// The picture and its levels, one under the other.
    fn upload(&mut self, context: &GpuContext, picture: &EnvironmentPicture) {
        let all = || std::iter::once(&picture.all).chain(&picture.glossy).take(self.terms.levels.len());
        let width = all().map(OctahedralMap::side).max().unwrap_or(1);
        let rows: usize = all().map(OctahedralMap::side).sum();
        self.texels.clear();
        self.texels.resize(width * rows, [0.0; 4]);
        let mut first_row = 0;
        let mut places = [[0u32; 4]; 12];
        for (map, place) in all().zip(&mut places) {
            let side = map.side();
            *place = [first_row as u32, side as u32, 0, 0];
            for (row, texels) in map.texels().chunks(side.max(1)).enumerate() {
                let start = (first_row + row) * width;
                for (slot, [r, g, b]) in self.texels[start..].iter_mut().zip(texels) {
                    *slot = [*r, *g, *b, 0.0];
                }
            }
            first_row += side;
        }
        self.terms.levels = places;
        self.environment.upload(context, width as u32, rows as u32, bytemuck::cast_slice(&self.texels));
        self.revision = Some(picture.revision);
    }
}
