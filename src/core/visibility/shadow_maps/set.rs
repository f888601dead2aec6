//! The shadow maps of a frame: one for each hard light.

use super::{BAND_ROWS, Receivers, ShadowCamera, ShadowMap, visibility};
use crate::model::light::HardLight;
use glam::Vec3;
use rayon::prelude::*;

/// Width of the filter over (a hard light's own extent times the casters' extent along it). A uniform light's full width
/// is 3.5 times its rms extent, and a caster is half its own height above the ground in the mean: 1.7 would be its penumbra
/// half way up. Less keeps contacts sharp.
const PENUMBRA: f32 = 1.0;
/// From so many maps on each is one unit of parallel work.
const WHOLE_FROM: usize = 4;
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
pub struct ShadowMapSet {
    pub(super) cameras: Vec<Option<ShadowCamera>>,
    pub(super) maps: Vec<ShadowMap>,
    /// The casters' vertices that triangles use.
    used: Vec<Vec3>,
    is_used: Vec<bool>,
}

impl ShadowMapSet {
    /// No map: nothing is shadowed.
    pub fn clear(&mut self) {
        self.cameras.clear();
    }

    /// No map, and no memory for any.
    pub fn free(&mut self) {
        self.clear();
        self.maps.iter_mut().for_each(|map| *map = ShadowMap::default());
    }

    /// Fits a camera for each light to the casters' shadows that are seen; the filter of `taps` taps is as wide as what each
    /// light stands for asks. A light is skipped (its camera is `None`, nothing blocks it, it has no map and costs nothing)
    /// where there is no caster, and where no receiver is seen that it shines on behind or among the casters.
    pub fn fit(
        &mut self,
        lights: &[HardLight],
        casters: &[Vec3],
        triangles: &[[u32; 3]],
        receivers: &Receivers,
        texels: u32,
        taps: u32,
    ) {
        let side = side_of_each(texels, lights.len());
        self.is_used.clear();
        self.is_used.resize(casters.len(), false);
        triangles.iter().flatten().for_each(|&i| self.is_used[i as usize] = true);
        self.used.clear();
        self.used.extend(casters.iter().zip(&self.is_used).filter(|(_, used)| **used).map(|(p, _)| *p));
        let used = &self.used;
        self.cameras.resize(lights.len(), None);
        self.cameras.par_iter_mut().zip(lights.par_iter()).for_each(|(camera, light)| {
            let texel_of_depth = PENUMBRA * light.extent_rad / taps.saturating_sub(1).max(1) as f32;
            let vertices = used.iter().copied();
            *camera = ShadowCamera::fit_soft(light.to_light_world, vertices, receivers, side, texel_of_depth);
        });
        if self.maps.len() < lights.len() {
            self.maps.resize_with(lights.len(), ShadowMap::default);
        }
    }

    /// Leaves out lights of [`Self::fit`] that are not wanted, by their number: nothing blocks them, and they have no map.
    pub fn keep(&mut self, wanted: impl Fn(usize) -> bool) {
        for (_, camera) in self.cameras.iter_mut().enumerate().filter(|(k, _)| !wanted(*k)) {
            *camera = None;
        }
    }

    /// Draws the casters into every map, after [`Self::fit`].
    pub fn draw(&mut self, casters: &[Vec3], triangles: &[[u32; 3]]) {
        // Many maps keep all threads busy as they are; of few each is cut into bands.
        let whole = self.cameras.len() >= WHOLE_FROM;
        self.cameras.par_iter().zip(&mut self.maps).for_each(|(camera, map)| {
            if let Some(camera) = camera {
                let rows = if whole { camera.texels as usize } else { BAND_ROWS };
                map.draw_in_bands(camera, casters, triangles, rows);
            }
        });
    }

    /// One for each light of [`Self::fit`].
    pub fn cameras(&self) -> &[Option<ShadowCamera>] {
        &self.cameras
    }

    /// Depths of map `k`, row by row; empty where there is none.
    pub fn depth(&self, k: usize) -> &[f32] {
        let is_drawn = self.cameras.get(k).is_some_and(Option::is_some);
        self.maps.get(k).filter(|_| is_drawn).map_or(&[], ShadowMap::depth)
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
