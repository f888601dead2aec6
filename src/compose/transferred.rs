//! Soft light on matt vertices by precomputed transfer: the sum of t_i L_i (Eq. 20 of [Now11]), made anew when the light
//! changes. The device gets the result as a vertex attribute.

use super::shade_object::LightTerms;
use crate::math::sh::MAX_COEFFICIENTS;
use crate::model::{quality::SelfShadow, scene::Scene, transfer::SceneTransfer};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// What white matt vertices radiate under the soft half, for all objects of a scene. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Transferred {
    transfer: Option<Arc<SceneTransfer>>,
    /// Vertices of each object.
    ranges: Vec<Range<usize>>,
    rgb: Vec<[f32; 4]>,
    /// What `rgb` was made for.
    of: Option<(usize, [[f32; 3]; MAX_COEFFICIENTS])>,
}

impl Transferred {
    /// Takes a scene's transfer; objects whose number of vertices does not fit are left to their openness.
    pub fn load(&mut self, scene: &Scene) {
        self.transfer.clone_from(&scene.transfer);
        self.ranges.clear();
        let mut first = 0;
        for object in &scene.objects {
            let end = first + object.mesh.positions.len();
            self.ranges.push(first..end);
            first = end;
        }
        self.rgb.clear();
        self.rgb.resize(first, [0.0; 4]);
        self.of = None;
    }

    /// Takes over the light and the setting. Whether any vertex changed; free where nothing has.
    pub fn update(&mut self, light: &LightTerms, self_shadow: SelfShadow) -> bool {
        let transfer = self.transfer.clone().filter(|_| self_shadow == SelfShadow::Transfer);
        let Some(transfer) = transfer else {
            let had = self.of.take().is_some();
            if had {
                self.rgb.fill([0.0; 4]);
            }
            return had;
        };
        if self.of.is_some_and(|of| of == (light.order, light.global_rgb)) {
            return false;
        }
        self.of = Some((light.order, light.global_rgb));
        let order = light.order.min(transfer.order);
        let global_rgb = &light.global_rgb[..order * order];
        for (object, range) in self.ranges.iter().enumerate() {
            let Some(rows) = transfer.rows(object).filter(|rows| rows.len() == range.len()) else { continue };
            let out = &mut self.rgb[range.clone()];
            out.par_iter_mut().zip(rows.collect::<Vec<_>>()).for_each(|(out, row)| {
                let mut sum = [0.0f32; 3];
                for (t, l) in row.iter().zip(global_rgb) {
                    let t = t.to_f32();
                    sum.iter_mut().zip(l).for_each(|(s, l)| *s += t * l);
                }
                *out = [sum[0], sum[1], sum[2], 1.0];
            });
        }
        true
    }

    /// For each vertex of the scene r, g, b and 1; all 0 where there is no transfer.
    pub fn rgb(&self) -> &[[f32; 4]] {
        &self.rgb
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::shade_object::soft_over_pi;
    use crate::model::{
        light::{Lights, RadianceSh},
        scene::{Material, Mesh, VirtualObject},
    };
    use crate::visibility::transfer::{Standing, bake};
    use glam::{Affine3A, Vec3};

    #[test]
    fn open_vertices_get_what_they_get_without_transfer() {
        let normals = [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.48, 0.6, 0.64)];
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X * 1e-3, Vec3::Y * 1e-3],
            normals: normals.to_vec(),
            ..Mesh::default()
        };
        let object = VirtualObject {
            name: "o".into(),
            mesh: mesh.clone(),
            material: Material::Lambert { albedo_rgb: [1.0; 3] },
            world_from_object: Affine3A::IDENTITY,
            openness: vec![],
        };
        let standing =
            Standing { positions_world: &mesh.positions, normals_world: &mesh.normals, triangles: &[] };
        let mut objects: Vec<_> = bake(&[standing], 4, 16, &|_| ()).into_iter().map(Some).collect();
        objects.push(None);
        let transfer = Some(Arc::new(SceneTransfer { order: 4, objects }));
        let scene = Scene { objects: vec![object.clone(), object], transfer, ..Scene::default() };
        let mut global = RadianceSh::zero(4);
        for (i, row) in global.rgb[..16].iter_mut().enumerate() {
            *row = [1.0 / (1 + i) as f32, 0.5 - 0.1 * i as f32, if i == 0 { 2.0 } else { 0.0 }];
        }
        let light = LightTerms::of(&Lights::soft(global));
        let mut transferred = Transferred::default();
        transferred.load(&scene);
        assert!(!transferred.update(&light, SelfShadow::Openness));
        assert!(transferred.rgb().iter().all(|v| *v == [0.0; 4]));
        assert!(transferred.update(&light, SelfShadow::Transfer));
        assert!(!transferred.update(&light, SelfShadow::Transfer));
        for (got, normal) in transferred.rgb().iter().zip(normals) {
            let want = soft_over_pi(&light, normal);
            // 16-bit rows: sixteen terms, each good to 2^-11 of itself.
            assert!((0..3).all(|c| (got[c] - want[c]).abs() < 1e-3), "{got:?} {want:?}");
            assert_eq!(got[3], 1.0);
        }
        assert!(transferred.rgb()[3..].iter().all(|v| *v == [0.0; 4]), "the second object has none");
        assert!(transferred.update(&light, SelfShadow::Openness));
        assert!(transferred.rgb().iter().all(|v| *v == [0.0; 4]));
    }
}
