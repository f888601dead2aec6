//! The shadow maps of a frame: one for each hard light.

use super::{ShadowCamera, ShadowMap, visibility};
use crate::model::light::HardLight;
use glam::Vec3;

/// Width of the filter over (a hard light's own extent times the casters' extent along it). A uniform light's full width
/// is 3.5 times its rms extent, and a caster is half its own height above the ground in the mean: 1.7 would be its penumbra
/// half way up. Less keeps contacts sharp.
const PENUMBRA: f32 = 1.0;
/// Fewest texels a side.
const LEAST_SIDE: u32 = 64;

/// Texels a side of each of `count` maps where one alone has `texels`: from 5 maps on half, from 17 a quarter. Many maps
/// stand for one wide light and are blended, so that the steps of each are not seen.
pub fn side_of_each(texels: u32, count: usize) -> u32 {
    let divisor = match count {
        0..=4 => 1,
        5..=16 => 2,
        _ => 4,
    };
    (texels / divisor).max(LEAST_SIDE.min(texels))
}

/// Cameras and depths, one for each hard light; memory is kept.
#[derive(Clone, Debug, Default)]
pub struct ShadowMaps {
    cameras: Vec<Option<ShadowCamera>>,
    maps: Vec<ShadowMap>,
}

impl ShadowMaps {
    /// No map: nothing is shadowed.
    pub fn clear(&mut self) {
        self.cameras.clear();
    }

    /// Fits a camera to the casters for each light; the filter of `taps` taps is as wide as what each light stands for asks.
    /// A light is skipped (its camera is `None`, nothing blocks it) where
    /// there is no caster.
    pub fn fit(
        &mut self,
        lights: &[HardLight],
        casters: &[Vec3],
        triangles: &[[u32; 3]],
        texels: u32,
        taps: u32,
    ) {
        let side = side_of_each(texels, lights.len());
        self.cameras.clear();
        self.cameras.extend(lights.iter().map(|light| {
            let vertices = triangles.iter().flatten().map(|&i| casters[i as usize]);
            let texel_of_depth = PENUMBRA * light.extent_rad / taps.saturating_sub(1).max(1) as f32;
            ShadowCamera::fit_soft(light.to_light_world, vertices, side, texel_of_depth)
        }));
        if self.maps.len() < lights.len() {
            self.maps.resize_with(lights.len(), ShadowMap::default);
        }
    }

    /// Draws the casters into every map, after [`Self::fit`].
    pub fn draw(&mut self, casters: &[Vec3], triangles: &[[u32; 3]]) {
        for (camera, map) in self.cameras.iter().zip(&mut self.maps) {
            if let Some(camera) = camera {
                map.draw(camera, casters, triangles);
            }
        }
    }

    /// One for each light of [`Self::fit`].
    pub fn cameras(&self) -> &[Option<ShadowCamera>] {
        &self.cameras
    }

    /// Depths of map `k`, row by row; empty where there is none.
    pub fn depth(&self, k: usize) -> &[f32] {
        self.maps.get(k).map_or(&[], ShadowMap::depth)
    }

    /// Takes depths of map `k` that were drawn elsewhere.
    pub fn set_depth(&mut self, k: usize, depth: Vec<f32>) {
        if let Some(map) = self.maps.get_mut(k) {
            map.set_depth(depth);
        }
    }

    /// Share of light `k`, 0 to 1, that reaches a point (world frame); `cos_theta` as for [`visibility`].
    pub fn visibility(&self, k: usize, taps: u32, point_world: Vec3, cos_theta: f32) -> f32 {
        match self.cameras.get(k) {
            Some(Some(camera)) if camera.covers(point_world) => {
                visibility(self.maps[k].depth(), camera, taps, point_world, cos_theta)
            }
            _ => 1.0,
        }
    }
}
