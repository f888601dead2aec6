//! What virtual objects leave of a known room's light, as a ratio for each pixel (Section 7 of [Gib03] in the ratio form of
//! spec 9): `1 - sum over lights of L_xk M_xk / L_x`, L_xk what light k sends to the point, M_xk the share of it that
//! objects hide, L_x all light that arrives. Sums are in linear light, so no order of the lights matters, and one
//! tone map follows. Twin: `shaders/nearfield/subtract.wgsl`.

use super::{field::NearField, frame::NearFrame, sun_shadows::SunShadows};
use crate::{
    math::widest::widest,
    visibility::{point_maps::WHOLE, shadow_maps::ShadowMapSet},
};
use glam::Vec3;
use std::cell::OnceCell;

/// Light at or below this counts as none: nothing to take away, the ratio is 1.
pub const TINY_LIGHT: f32 = 1e-12;

/// Everything that the pixels of one frame share.
#[derive(Clone, Copy)]
pub struct SubtractFrame<'a> {
    /// Light that arrives at the room's corners, and who sends it.
    pub field: &'a NearField,
    /// Its lights in this frame, drawn and listed.
    pub frame: &'a NearFrame,
    /// Suns that shine in, with the room's own shadows.
    pub suns: &'a SunShadows,
    /// The objects' maps under those suns that have one in this frame (`NearFrame::sun_maps`), in the suns' order.
    pub sun_shadows: &'a ShadowMapSet,
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
    !with.frame.listed(triangle).is_empty() || with.frame.sun_maps().iter().any(Option::is_some)
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
    let kept = OnceCell::new();
    let weights = || kept.get_or_init(|| lanes(count, &weights));
    let (mut all, mut blocked) = ([[0.0f32; 3]; N], [[0.0f32; N]; 3]);
    if !with.suns.is_empty() {
        for i in 0..count {
            let maps = with.frame.sun_maps();
            let [arrives, hidden] = with.suns.at(point(i), normal, maps, with.sun_shadows, with.taps);
            all[i] = arrives;
            blocked.iter_mut().zip(hidden).for_each(|(blocked, hidden)| blocked[i] = hidden);
        }
    }
    each_hidden(with, run, &weights, |light, visible| {
        let (sent, weights) = (corners.map(|v| with.frame.sent(light, v)), weights());
        widest(
            #[inline(always)]
            || {
                for (c, blocked) in blocked.iter_mut().enumerate() {
                    let sent = sent.map(|sent| sent[c]);
                    for i in 0..N {
                        blocked[i] += interpolated(&sent, weights, i) * (1.0 - visible[i]);
                    }
                }
            },
        );
    });
    let lit = corners.map(|v| with.field.gathered_rgb.get(v as usize).copied().unwrap_or([0.0; 3]));
    for (i, out) in out.iter_mut().enumerate() {
        let blocked = [0, 1, 2].map(|c: usize| blocked[c][i]);
        *out = if blocked == [0.0; 3] {
            [1.0; 3]
        } else {
            std::array::from_fn(|c| {
                let whole = all[i][c] + interpolated(&lit.map(|lit| lit[c]), weights(), i);
                if whole > TINY_LIGHT { (1.0 - blocked[c] / whole).clamp(0.0, 1.0) } else { 1.0 }
            })
        };
    }
}

/// Corner by corner, the weights at the first `count` points of a run; the last of them stands in for the rest.
pub(super) fn lanes<const N: usize>(count: usize, weights: impl Fn(usize) -> [f32; 3]) -> [[f32; N]; 3] {
    let mut lanes = [[0.0; N]; 3];
    let mut last = [0.0; 3];
    for i in 0..N {
        if i < count {
            last = weights(i);
        }
        lanes.iter_mut().zip(last).for_each(|(lane, weight)| lane[i] = weight);
    }
    lanes
}

/// Gives each light of a run's triangle that is not seen from all of its points, and the share of it that each of them sees;
/// `weights` of the triangle's corners at each, asked for where something is near.
pub(super) fn each_hidden<'a, const N: usize>(
    with: &SubtractFrame<'_>,
    run: &RoomPoints<'_, N>,
    weights: &impl Fn() -> &'a [[f32; N]; 3],
    mut each: impl FnMut(usize, &[f32; N]),
) {
    let (corners, points, frame) = (run.corners, run.points_world, with.frame);
    for &k in frame.listed(run.triangle) {
        let light = usize::from(k);
        let (Some((camera, maps)), Some(reads)) = (frame.maps().get(light), frame.reads().get(light)) else {
            continue;
        };
        let part = || {
            let parts = corners.map(|v| frame.part(light, v).middle_half());
            seen_parts(&parts, &corners.map(|v| frame.sent(light, v)), weights())
        };
        let visible = widest(
            #[inline(always)]
            || reads.visibility(maps, camera, points, part),
        );
        if let Some(visible) = visible.filter(|visible| visible.iter().any(|v| *v < 1.0)) {
            each(light, &visible);
        }
    }
}

/// [`seen_part`] of neighbours: middles along both half axes, half lengths along both.
#[inline(always)]
fn seen_parts<const N: usize>(
    parts: &[([f32; 2], [f32; 2]); 3],
    sent: &[[f32; 3]; 3],
    weights: &[[f32; N]; 3],
) -> [[f32; N]; 4] {
    let sums = sent.map(|[r, g, b]| r + g + b);
    let mut light = [[0.0f32; N]; 3];
    let mut whole = [0.0f32; N];
    for i in 0..N {
        for k in 0..3 {
            light[k][i] = (if weights[k][i] > 0.0 { weights[k][i] } else { 0.0 }) * sums[k];
        }
        whole[i] = light[0][i] + light[1][i] + light[2][i];
    }
    let mean = |of: [f32; 3], without: f32| {
        let mut mean = [0.0f32; N];
        for i in 0..N {
            let sum = light[0][i] * of[0] + light[1][i] * of[1] + light[2][i] * of[2];
            mean[i] = if whole[i] > 0.0 { sum / whole[i] } else { without };
        }
        mean
    };
    let of = |axis: usize| [parts.map(|(middle, _)| middle[axis]), parts.map(|(_, half)| half[axis])];
    let ([middle_u, half_u], [middle_v, half_v]) = (of(0), of(1));
    [mean(middle_u, 0.0), mean(middle_v, 0.0), mean(half_u, 1.0), mean(half_v, 1.0)]
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

/// Between the corners of a triangle, at point `i` of a run.
#[inline(always)]
pub(super) fn interpolated<const N: usize>([a, b, c]: &[f32; 3], weights: &[[f32; N]; 3], i: usize) -> f32 {
    weights[0][i] * a + weights[1][i] * b + weights[2][i] * c
}
