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

/// Where a ray meets a real surface.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceHit {
    /// Metres along the ray.
    pub distance_m: f32,
    /// Unit shading normal on the seen side, world frame.
    pub normal: Vec3,
    /// Unit facet normal on the seen side, world frame.
    pub facet_normal: Vec3,
    /// Whether virtual shadows fall on it.
    pub receives: bool,
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
    /// Camera's position, world frame, metres.
    pub eye: Vec3,
}

/// One pixel: the ratio where its ray (unit, world frame) meets a receiving surface inside of the shadow
/// volume, else 1. `nearest(ray, longest_m)` finds the nearest real surface up to a distance; it is not asked
/// where the ray misses the volume behind the casters that the map covers.
pub fn pixel(
    frame: &SurfaceFrame<'_>,
    ray: Vec3,
    nearest: impl Fn(Vec3, f32) -> Option<SurfaceHit>,
) -> [f32; 3] {
    const UNTOUCHED: [f32; 3] = [1.0; 3];
    let Some((first_m, last_m)) = span_in_volume(frame.camera, frame.eye, ray) else { return UNTOUCHED };
    let Some(hit) = nearest(ray, last_m) else { return UNTOUCHED };
    if !hit.receives || hit.distance_m < first_m {
        return UNTOUCHED;
    }
    let to_light = Vec3::from(frame.light.to_light_world);
    if hit.normal.dot(to_light) <= 0.0 {
        return UNTOUCHED; // The ratio is 1 whatever the shadow.
    }
    let point = frame.eye + hit.distance_m * ray;
    let cosine = hit.facet_normal.dot(to_light);
    let visible = if cosine <= 0.0 {
        0.0
    } else {
        shadow_maps::visibility(frame.map, frame.camera, frame.pcf_taps, point, cosine)
    };
    if visible >= 1.0 { UNTOUCHED } else { ratio(frame.light, hit.normal, visible) }
}

/// From where to where, in metres along a ray from `eye`, a shadow is possible: inside of the map's square and
/// not nearer to the light than every caster. `None` where nowhere.
pub fn span_in_volume(camera: &ShadowCamera, eye: Vec3, ray: Vec3) -> Option<(f32, f32)> {
    let start = camera.map(eye);
    let step = camera.map_direction(ray);
    let side = camera.texels as f32;
    let (mut first, mut last) = (0.0f32, f32::INFINITY);
    for (s, d, low, high) in [
        (start[0], step[0], 0.0, side),
        (start[1], step[1], 0.0, side),
        (start[2], step[2], 0.0, f32::INFINITY),
    ] {
        if d == 0.0 {
            if s < low || s > high {
                return None;
            }
            continue;
        }
        let (a, b) = ((low - s) / d, (high - s) / d);
        first = first.max(a.min(b));
        last = last.min(a.max(b));
    }
    (first <= last).then_some((first, last))
}
