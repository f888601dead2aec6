//! What virtual objects leave of the light on real surfaces, as a ratio for each pixel: the camera's picture
//! already holds the surface's albedo and its lighting. Ratio form of spec 9, with the hard shadows of
//! Section 6 of [Now11], each tinted by the light that remains. Twin: `shaders/compose/shade_surface.wgsl`.

use super::shade_object::{LightTerms, soft_over_pi, unshadowed};
use crate::visibility::shadow_maps::ShadowMaps;
use glam::Vec3;
use std::f32::consts::PI;

/// Irradiance at or below this counts as no light: nothing to take away, the ratio is 1.
pub const TINY_IRRADIANCE: f32 = 1e-12;

/// Ratio of shadowed to unshadowed irradiance for each channel, within [0, 1]: `blocked` (not negative) is what
/// virtual objects take of the irradiance on the normal, E_g the soft half's, clamped at 0:
/// `1 - blocked / (sum of E_k max(0, n.w_k) + E_g(n))`; 1 where no light falls.
pub fn ratio(light: &LightTerms, normal: Vec3, blocked_rgb: [f32; 3]) -> [f32; 3] {
    left_of(whole(light, normal), blocked_rgb)
}

/// Irradiance of all light on a normal where nothing is in its way: the sum of `ratio`.
pub fn whole(light: &LightTerms, normal: Vec3) -> [f32; 3] {
    let (hard, soft) = (unshadowed(light, normal), soft_over_pi(light, normal));
    std::array::from_fn(|c| hard[c] + (PI * soft[c]).max(0.0))
}

fn left_of(whole_rgb: [f32; 3], blocked_rgb: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| {
        if whole_rgb[c] > TINY_IRRADIANCE {
            (1.0 - blocked_rgb[c] / whole_rgb[c]).clamp(0.0, 1.0)
        } else {
            1.0
        }
    })
}

/// Everything that the pixels of one frame share.
pub struct SurfaceFrame<'a> {
    /// The light.
    pub light: &'a LightTerms,
    /// The shadow maps, one for each hard light.
    pub shadows: &'a ShadowMaps,
    /// Taps a side of the filter.
    pub pcf_taps: u32,
}

/// The ratio at a point of a receiving surface (world frame); `normal` and `facet_normal` are unit, on the seen
/// side; `soft_taken` is what the soft half loses there (irradiance / pi); `whole_rgb` is [`whole`] of the normal where it
/// is known; `hard` says whether hard shadows may fall there. A facet turned away from a light is in its full shadow; a
/// normal turned away gets none of its light, and nothing can be taken from it.
pub fn at(
    frame: &SurfaceFrame<'_>,
    point_world: Vec3,
    normal: Vec3,
    facet_normal: Vec3,
    soft_taken: [f32; 3],
    whole_rgb: Option<[f32; 3]>,
    hard: bool,
) -> [f32; 3] {
    let mut blocked = soft_taken.map(|t| (PI * t).max(0.0));
    let lights = if hard { frame.light.hard() } else { &[] };
    for (k, hard) in lights.iter().enumerate() {
        let to_light = Vec3::from(hard.to_light_world);
        let cosine = normal.dot(to_light);
        if cosine <= 0.0 {
            continue;
        }
        let facet_cosine = facet_normal.dot(to_light);
        let visible = if facet_cosine <= 0.0 {
            0.0
        } else {
            frame.shadows.visibility(k, frame.pcf_taps, point_world, facet_cosine)
        };
        let taken = cosine * (1.0 - visible);
        for (b, e) in blocked.iter_mut().zip(hard.irradiance_rgb) {
            *b += e * taken;
        }
    }
    if blocked == [0.0; 3] {
        return [1.0; 3];
    }
    left_of(whole_rgb.unwrap_or_else(|| whole(frame.light, normal)), blocked)
}
