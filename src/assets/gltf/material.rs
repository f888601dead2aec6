//! Metallic-roughness materials as Lambert, Phong or mirror, and textures sampled at vertices.
//!
//! With base colour c, metalness m and roughness r (means over the vertices where textured):
//! * m >= 0.9 and r <= 0.1: a mirror of reflectance c.
//! * m < 0.5 and r >= 0.6: matt with albedo c. (A rough metal part is taken as matt: its highlight is as wide.)
//! * else Phong: albedo 0.96 c (1 - m), lobe 0.04 (1 - m) + c m, exponent 2 / r^4 - 2 within 1 to 2000 (the
//!   exponent whose lobe is as wide as a microfacet distribution of alpha = r^2). Both sum to at most 1.

use super::{accessor::floats, source::Source};
use crate::{
    error::AssetError,
    math::color::srgb_decode,
    model::{image::Rgb8Image, scene::Material},
};
use gltf::{Primitive, Semantic, texture::WrappingMode};
use std::rc::Rc;

/// Colour, roughness and metalness in the mean over vertices.
#[derive(Clone, Debug, Default)]
pub struct Means {
    vertices: f64,
    tint_rgb: [f64; 3],
    rough_metal: [f64; 2],
}

impl Means {
    /// Takes one vertex into the means.
    pub fn count(&mut self, tint_rgb: [f32; 3], rough_metal: [f32; 2]) {
        self.vertices += 1.0;
        (0..3).for_each(|k| self.tint_rgb[k] += f64::from(tint_rgb[k]));
        (0..2).for_each(|k| self.rough_metal[k] += f64::from(rough_metal[k]));
    }

    /// Takes the vertices of another primitive into the means.
    pub fn add(&mut self, other: &Self) {
        self.vertices += other.vertices;
        (0..3).for_each(|k| self.tint_rgb[k] += other.tint_rgb[k]);
        (0..2).for_each(|k| self.rough_metal[k] += other.rough_metal[k]);
    }
}

/// The material of ours that is nearest (see the module); the default material where the file has none.
pub fn of(material: Option<&gltf::Material>, means: &Means) -> Material {
    let pbr = material.map(gltf::Material::pbr_metallic_roughness);
    let share = |x: f32| if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 };
    let factor = pbr.as_ref().map_or([1.0; 4], |p| p.base_color_factor());
    let base = [factor[0], factor[1], factor[2]].map(share);
    let mean = |sum: f64| if means.vertices > 0.0 { (sum / means.vertices) as f32 } else { 1.0 };
    let [rough, metal] = means.rough_metal.map(mean);
    // Without a material the surface is matt, not the metal that glTF's default factors would make it.
    let metal = share(pbr.as_ref().map_or(0.0, |p| p.metallic_factor()) * metal);
    let rough = share(pbr.as_ref().map_or(1.0, |p| p.roughness_factor()) * rough);
    // The lobe has no tints of its own, so it takes their mean.
    let tinted: [f32; 3] = std::array::from_fn(|k| base[k] * mean(means.tint_rgb[k]));
    if metal >= 0.9 && rough <= 0.1 {
        return Material::Mirror { reflectance_rgb: tinted };
    }
    if metal < 0.5 && rough >= 0.6 {
        return Material::Lambert { albedo_rgb: base };
    }
    Material::Phong {
        albedo_rgb: base.map(|c| 0.96 * c * (1.0 - metal)),
        specular_rgb: tinted.map(|c| 0.04 * (1.0 - metal) + c * metal),
        exponent: (2.0 / rough.max(1e-3).powi(4) - 2.0).clamp(1.0, 2000.0),
    }
}

/// A texture and where each vertex looks it up.
pub struct Texture {
    picture: Rc<Rgb8Image>,
    at: Vec<[f32; 2]>,
    wrap: [WrappingMode; 2],
}

impl Texture {
    /// Opens a texture for a primitive; `None` where the primitive lacks the coordinates it asks for.
    pub fn open(
        source: &mut Source,
        primitive: &Primitive,
        info: &gltf::texture::Info,
        count: usize,
    ) -> Result<Option<Self>, AssetError> {
        let Some(accessor) = primitive.get(&Semantic::TexCoords(info.tex_coord())) else { return Ok(None) };
        let at: Vec<[f32; 2]> = floats(source, &accessor, 0.0)?;
        if at.len() != count {
            return Err(AssetError::new(source.file, "TEXCOORD").allowed("as many as positions"));
        }
        let texture = info.texture();
        let image = source.document.as_json().textures.get(texture.index()).map(|t| t.source.value());
        let image =
            image.ok_or_else(|| AssetError::new(source.file, "texture source").allowed("an image"))?;
        let sampler = texture.sampler();
        let picture = source.picture(image)?;
        Ok(Some(Self { picture, at, wrap: [sampler.wrap_s(), sampler.wrap_t()] }))
    }

    /// Base colour at a vertex, linear, between the four nearest texels.
    pub fn linear(&self, vertex: usize) -> [f32; 3] {
        self.mix(vertex, |byte| srgb_decode(f32::from(byte) / 255.0))
    }

    /// Roughness (green) and metalness (blue) at a vertex.
    pub fn rough_metal(&self, vertex: usize) -> [f32; 2] {
        let [_, rough, metal] = self.mix(vertex, |byte| f32::from(byte) / 255.0);
        [rough, metal]
    }

    fn mix(&self, vertex: usize, decode: impl Fn(u8) -> f32) -> [f32; 3] {
        let size = [self.picture.width(), self.picture.height()];
        // Texel centres are at half texels, v downwards from the top row.
        let place: [f64; 2] = std::array::from_fn(|k| {
            let uv = f64::from(self.at[vertex][k]);
            // Beyond this nothing of a fraction is left.
            if uv.abs() < 1e6 { uv * size[k] as f64 - 0.5 } else { 0.0 }
        });
        let floor = place.map(f64::floor);
        let mut sum = [0.0f32; 3];
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let weight = |k: usize, d: i64| {
                let t = (place[k] - floor[k]) as f32;
                if d == 0 { 1.0 - t } else { t }
            };
            let x = wrapped(floor[0] as i64 + dx, size[0] as i64, self.wrap[0]);
            let y = wrapped(floor[1] as i64 + dy, size[1] as i64, self.wrap[1]);
            let texel = self.picture.at(x, y);
            let weight = weight(0, dx) * weight(1, dy);
            (0..3).for_each(|k| sum[k] += weight * decode(texel[k]));
        }
        sum
    }
}

fn wrapped(at: i64, size: i64, mode: WrappingMode) -> usize {
    let inside = match mode {
        WrappingMode::ClampToEdge => at.clamp(0, size - 1),
        WrappingMode::Repeat => at.rem_euclid(size),
        WrappingMode::MirroredRepeat => {
            let twice = at.rem_euclid(2 * size);
            if twice < size { twice } else { 2 * size - 1 - twice }
        }
    };
    inside as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_follows_its_mode() {
        let row = |mode| (-3..7).map(|i| wrapped(i, 3, mode)).collect::<Vec<_>>();
        assert_eq!(row(WrappingMode::ClampToEdge), [0, 0, 0, 0, 1, 2, 2, 2, 2, 2]);
        assert_eq!(row(WrappingMode::Repeat), [0, 1, 2, 0, 1, 2, 0, 1, 2, 0]);
        assert_eq!(row(WrappingMode::MirroredRepeat), [2, 1, 0, 0, 1, 2, 2, 1, 0, 0]);
    }

    #[test]
    fn no_material_is_matt_white() {
        assert_eq!(of(None, &Means::default()), Material::Lambert { albedo_rgb: [1.0; 3] });
    }
}
