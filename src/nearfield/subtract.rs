//! What virtual objects leave of a known room's light, as a ratio for each pixel (Section 7 of [Gib03] in the ratio form of
//! spec 9): `1 - sum over lights of L_xk M_xk / L_x`, L_xk what light k sends to the point, M_xk the share of it that
//! objects hide, L_x all light that arrives. Sums are in linear light, so no order of the lights matters, and one
//! tone map follows. Twin: `shaders/nearfield/subtract.wgsl`.

use super::{field::NearField, frame::NearFrame, sun_shadows::SunShadows};
use crate::visibility::{point_maps, shadow_maps::ShadowMaps};
use glam::Vec3;

/// Light at or below this counts as none: nothing to take away, the ratio is 1.
pub const TINY_LIGHT: f32 = 1e-12;

/// Everything that the pixels of one frame share.
#[derive(Clone, Copy)]
pub struct SubtractFrame<'a> {
    /// The room.
    pub field: &'a NearField,
    /// Its lights in this frame, drawn and listed.
    pub frame: &'a NearFrame,
    /// Its suns.
    pub suns: &'a SunShadows,
    /// The objects' maps under the suns, one each.
    pub sun_shadows: &'a ShadowMaps,
    /// Taps a side of the suns' filter.
    pub taps: u32,
}

/// A point of a triangle of the room.
#[derive(Clone, Copy, Debug)]
pub struct RoomPoint {
    /// World frame, metres.
    pub position_world: Vec3,
    /// Weights of the triangle's corners, sum 1.
    pub weights: [f32; 3],
}

/// The ratio, each channel within [0, 1], at points of triangle `t` (its number in `NearFrame::list`, corners as numbers of
/// the field's vertices, unit normal of its front); one for each point.
pub fn at_points(
    with: &SubtractFrame<'_>,
    t: usize,
    corners: [u32; 3],
    normal: Vec3,
    points: &[RoomPoint],
    out: &mut [[f32; 3]],
) {
    let listed = with.frame.listed(t);
    if listed.is_empty() && with.suns.is_empty() {
        out.fill([1.0; 3]);
        return;
    }
    let lit = corners.map(|v| with.field.gathered_rgb.get(v as usize).copied().unwrap_or([0.0; 3]));
    for (point, out) in points.iter().zip(out.iter_mut()) {
        let [all, mut blocked] = if with.suns.is_empty() {
            [[0.0; 3]; 2]
        } else {
            with.suns.at(point.position_world, normal, with.sun_shadows, with.taps)
        };
        for &k in listed {
            let Some((camera, map)) = with.frame.maps().get(k.into()) else { continue };
            let Some(mapped) = camera.map(point.position_world) else { continue };
            let slope = camera.slope(point.position_world, normal);
            let places = &with.frame.places()[usize::from(k)];
            let visible = point_maps::visibility(map.depth(), camera, places, mapped, slope);
            if visible >= 1.0 {
                continue;
            }
            let sent = corners.map(|v| with.frame.sent(k.into(), v));
            let light = interpolated(&sent, point.weights);
            for (b, l) in blocked.iter_mut().zip(light) {
                *b += l * (1.0 - visible);
            }
        }
        *out = if blocked == [0.0; 3] {
            [1.0; 3]
        } else {
            let gathered = interpolated(&lit, point.weights);
            std::array::from_fn(|c| {
                let whole = all[c] + gathered[c];
                if whole > TINY_LIGHT { (1.0 - blocked[c] / whole).clamp(0.0, 1.0) } else { 1.0 }
            })
        };
    }
}

fn interpolated(corners: &[[f32; 3]; 3], weights: [f32; 3]) -> [f32; 3] {
    let [a, b, c] = corners;
    std::array::from_fn(|i| weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i])
}
