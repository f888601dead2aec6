//! What virtual objects leave of a known room's light, as a ratio for each pixel (Section 7 of [Gib03] in the ratio form of
//! spec 9): `1 - sum over lights of L_xk M_xk / L_x`, L_xk what light k sends to the point, M_xk the share of it that
//! objects hide, L_x all light that arrives. Sums are in linear light, so no order of the lights matters, and one
//! tone map follows. Twin: `shaders/nearfield/subtract.wgsl`.

use super::{field::NearField, frame::NearFrame, sun_shadows::SunShadows};
use crate::{
    math::widest::widest,
    visibility::{point_maps::WHOLE, shadow_maps::ShadowMaps},
};
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

/// Neighbours on a triangle of the room.
#[derive(Clone, Copy, Debug)]
pub struct RoomPoints<'a, const N: usize> {
    /// Number of the triangle in `NearFrame::list`.
    pub triangle: usize,
    /// Its corners as numbers of the field's vertices.
    pub corners: [u32; 3],
    /// Unit normal of its front.
    pub normal: Vec3,
    /// World frame, metres, coordinate by coordinate; the last of those that count stands in for the rest.
    pub points_world: &'a [[f32; N]; 3],
}

/// Whether something may be taken from a triangle: elsewhere every ratio is 1.
pub fn may_take(with: &SubtractFrame<'_>, triangle: usize) -> bool {
    !(with.frame.listed(triangle).is_empty() && with.suns.is_empty())
}

/// The ratio, each channel within [0, 1], at the first points of a run along a straight line, one for each of `out` (at
/// most N); `weights` gives the weights of the triangle's corners at a point, sum 1.
pub fn at_points<const N: usize>(
    with: &SubtractFrame<'_>,
    run: &RoomPoints<'_, N>,
    weights: impl Fn(usize) -> [f32; 3],
    out: &mut [[f32; 3]],
) {
    let count = out.len().min(N);
    let out = &mut out[..count];
    let (corners, normal, points) = (run.corners, run.normal, run.points_world);
    let point = |i: usize| Vec3::from_array(points.map(|axis| axis[i]));
    let (mut all, mut blocked) = ([[0.0f32; 3]; N], [[0.0f32; 3]; N]);
    if !with.suns.is_empty() {
        for i in 0..count {
            [all[i], blocked[i]] = with.suns.at(point(i), normal, with.sun_shadows, with.taps);
        }
    }
    each_hidden(with, run, &weights, count, |light, visible| {
        let sent = corners.map(|v| with.frame.sent(light, v));
        for (i, (visible, blocked)) in visible.iter().zip(&mut blocked).enumerate().take(count) {
            if *visible < 1.0 {
                let light = interpolated(&sent, weights(i));
                for (b, l) in blocked.iter_mut().zip(light) {
                    *b += l * (1.0 - visible);
                }
            }
        }
    });
    let lit = corners.map(|v| with.field.gathered_rgb.get(v as usize).copied().unwrap_or([0.0; 3]));
    for (i, out) in out.iter_mut().enumerate() {
        *out = if blocked[i] == [0.0; 3] {
            [1.0; 3]
        } else {
            let gathered = interpolated(&lit, weights(i));
            std::array::from_fn(|c| {
                let whole = all[i][c] + gathered[c];
                if whole > TINY_LIGHT { (1.0 - blocked[i][c] / whole).clamp(0.0, 1.0) } else { 1.0 }
            })
        };
    }
}

/// Gives each light of a run's triangle that is not seen from all of its first `count` points, and the share of it that each of
/// them sees; `weights` as in [`at_points`].
pub(super) fn each_hidden<const N: usize>(
    with: &SubtractFrame<'_>,
    run: &RoomPoints<'_, N>,
    weights: &impl Fn(usize) -> [f32; 3],
    count: usize,
    mut each: impl FnMut(usize, &[f32; N]),
) {
    let (corners, points, frame) = (run.corners, run.points_world, with.frame);
    for &k in frame.listed(run.triangle) {
        let light = usize::from(k);
        let (Some((camera, maps)), Some(reads)) = (frame.maps().get(light), frame.reads().get(light)) else {
            continue;
        };
        let sent = corners.map(|v| frame.sent(light, v));
        let part = || {
            let parts = corners.map(|v| frame.part(light, v).middle_half());
            let mut seen = [[0.0; N]; 4];
            for i in 0..N {
                let ([a, b], [c, d]) = seen_part(&parts, &sent, weights(i.min(count - 1)));
                seen.iter_mut().zip([a, b, c, d]).for_each(|(seen, v)| seen[i] = v);
            }
            seen
        };
        let visible = widest(
            #[inline(always)]
            || reads.visibility(maps, camera, points, part),
        );
        let Some(visible) = visible else { continue };
        if visible[..count].iter().all(|v| *v >= 1.0) {
            continue;
        }
        each(light, &visible);
    }
}

/// Which part of a light a point of a triangle sees: between its corners' by the light that comes of each (`sent`), and their
/// weights; middle and half lengths as in [`SeenPart`](crate::visibility::point_maps::SeenPart).
#[inline(always)]
pub fn seen_part(
    parts: &[([f32; 2], [f32; 2]); 3],
    sent: &[[f32; 3]; 3],
    weights: [f32; 3],
) -> ([f32; 2], [f32; 2]) {
    let light: [f32; 3] =
        std::array::from_fn(|k| weights[k].max(0.0) * (sent[k][0] + sent[k][1] + sent[k][2]));
    let whole = light[0] + light[1] + light[2];
    if !(whole > 0.0) {
        return WHOLE;
    }
    let mean = |[a, b, c]: [[f32; 2]; 3]| {
        [0, 1].map(|i: usize| (light[0] * a[i] + light[1] * b[i] + light[2] * c[i]) / whole)
    };
    (mean(parts.map(|part| part.0)), mean(parts.map(|part| part.1)))
}

/// Between the corners of a triangle.
pub(super) fn interpolated(corners: &[[f32; 3]; 3], weights: [f32; 3]) -> [f32; 3] {
    let [a, b, c] = corners;
    std::array::from_fn(|i| weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i])
}
