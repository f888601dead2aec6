//! What virtual objects leave of the light on real surfaces, as a ratio for each pixel: the camera's picture
//! already holds the surface's albedo and its lighting. Ratio form of spec 9, with the one hard shadow of
//! Section 6 of [Now11]. Twin: `shaders/compose/shade_surface.wgsl`.

use super::shade_object::{LightTerms, soft_over_pi};
use crate::visibility::shadow_maps::{self, ShadowCamera};
use glam::Vec3;
use std::f32::consts::PI;

/// Irradiance at or below this counts as no light: nothing to take away, the ratio is 1.
pub const TINY_IRRADIANCE: f32 = 1e-12;

/// Ratio of shadowed to unshadowed irradiance for each channel, within [0, 1]:
/// `(E_d max(0, n.w_d) V + E_g(n)) / (E_d max(0, n.w_d) + E_g(n))`, E_g clamped at 0; 1 where no light falls.
/// `normal`: unit, world frame, on the seen side; `visibility` within [0, 1].
pub fn ratio(light: &LightTerms, normal: Vec3, visibility: f32) -> [f32; 3] {
    let cosine = normal.dot(Vec3::from(light.to_light_world)).max(0.0);
    let soft = soft_over_pi(light, normal);
    std::array::from_fn(|c| {
        let direct = light.direct_rgb[c] * cosine;
        let global = (PI * soft[c]).max(0.0);
        let all = direct + global;
        if all > TINY_IRRADIANCE { (direct * visibility + global) / all } else { 1.0 }
    })
}

/// Everything that the pixels of one frame share.
pub struct SurfaceFrame<'a> {
    /// The light.
    pub light: &'a LightTerms,
    /// The shadow camera.
    pub camera: &'a ShadowCamera,
    /// Its map.
    pub map: &'a [f32],
    /// Taps a side of the filter.
    pub pcf_taps: u32,
}

/// The ratio at a point of a receiving surface (world frame); `normal` and `facet_normal` are unit, on the seen
/// side. A facet turned away from the light is in full shadow, a normal turned away gets no direct light and the
/// ratio is 1 whatever the shadow.
pub fn at(frame: &SurfaceFrame<'_>, point_world: Vec3, normal: Vec3, facet_normal: Vec3) -> [f32; 3] {
    let to_light = Vec3::from(frame.light.to_light_world);
    if normal.dot(to_light) <= 0.0 {
        return [1.0; 3];
    }
    let cosine = facet_normal.dot(to_light);
    let visible = if cosine <= 0.0 {
        0.0
    } else {
        shadow_maps::visibility(frame.map, frame.camera, frame.pcf_taps, point_world, cosine)
    };
    if visible >= 1.0 { [1.0; 3] } else { ratio(frame.light, normal, visible) }
}
