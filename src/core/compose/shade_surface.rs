//! What virtual objects leave of the light on real surfaces, as a ratio for each pixel: the camera's picture
//! already holds the surface's albedo and its lighting. Ratio form of spec 9, with the hard shadows of
//! Section 6 of [Now11], each tinted by the light that remains. Twin: `shaders/compose/shade_surface.wgsl`.

use super::{
    carried::RUN,
    shade_object::{LightTerms, soft_over_pi, unshadowed},
    soft_shadow::FlatReceiver,
};
use crate::math::widest::widest;
use crate::visibility::shadow_maps::{FlatLight, ShadowMapSet};
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
    /// Hard lights, and the rest as harmonics.
    pub light: &'a LightTerms,
    /// The shadow maps, one for each hard light.
    pub shadows: &'a ShadowMapSet,
    /// Taps a side of the filter.
    pub pcf_taps: u32,
}

/// The ratio at a point of a receiving surface (world frame); `normal` and `facet_normal` are unit, on the seen
/// side; `soft_taken` is what the soft half loses there (irradiance / pi); `whole_rgb` is [`whole`] of the normal where it
/// is known. A facet turned away from a light is in its full shadow; a normal turned away gets none of its light, and
/// nothing can be taken from it.
pub fn at(
    frame: &SurfaceFrame<'_>,
    point_world: Vec3,
    normal: Vec3,
    facet_normal: Vec3,
    soft_taken: [f32; 3],
    whole_rgb: Option<[f32; 3]>,
) -> [f32; 3] {
    let mut blocked = soft_taken.map(|t| (PI * t).max(0.0));
    for (k, hard) in frame.light.hard().iter().enumerate() {
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

/// [`at`] for the first `count` of [`RUN`] points (world frame, coordinate by coordinate) of a flat receiver with its
/// `lights`; `soft_taken` channel by channel. `out` gets one ratio each.
pub fn at_run(
    frame: &SurfaceFrame<'_>,
    flat: &FlatReceiver,
    lights: &[FlatLight],
    points_world: &[[f32; RUN]; 3],
    soft_taken: &[[f32; RUN]; 3],
    out: &mut [[f32; 3]],
) {
    let count = out.len().min(RUN);
    widest(
        #[inline(always)]
        || {
            let mut blocked = *soft_taken;
            blocked.iter_mut().flatten().for_each(|t| {
                let taken = PI * *t;
                *t = if taken > 0.0 { taken } else { 0.0 };
            });
            let [low, high] = corners(points_world);
            for light in lights.iter().filter(|l| frame.shadows.may_shadow(l.light, low, high)) {
                let Some(hard) = frame.light.hard().get(light.light) else { continue };
                let visible = frame.shadows.visibility_flat(light, frame.pcf_taps, points_world, count);
                let taken = visible.map(|visible| light.cosine * (1.0 - visible));
                for (blocked, e) in blocked.iter_mut().zip(hard.irradiance_rgb) {
                    for (b, taken) in blocked.iter_mut().zip(taken) {
                        *b += e * taken;
                    }
                }
            }
            for (blocked, &whole) in blocked.iter_mut().zip(&flat.whole_rgb) {
                for b in blocked.iter_mut() {
                    let left = (1.0 - *b / whole).clamp(0.0, 1.0);
                    *b = if whole > TINY_IRRADIANCE { left } else { 1.0 };
                }
            }
            for (i, out) in out.iter_mut().enumerate().take(count) {
                *out = [blocked[0][i], blocked[1][i], blocked[2][i]];
            }
        },
    );
}

/// Low and high corner of a box around points.
#[inline(always)]
fn corners(points: &[[f32; RUN]; 3]) -> [[f32; 3]; 2] {
    const LANES: usize = 8;
    let ends = |axis: &[f32; RUN]| {
        let (mut low, mut high) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        for part in axis.chunks_exact(LANES) {
            for i in 0..LANES {
                low[i] = if part[i] < low[i] { part[i] } else { low[i] };
                high[i] = if part[i] > high[i] { part[i] } else { high[i] };
            }
        }
        [low.into_iter().fold(low[0], f32::min), high.into_iter().fold(high[0], f32::max)]
    };
    let all = points.each_ref().map(ends);
    [all.map(|ends| ends[0]), all.map(|ends| ends[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::{geometry::SurfaceGeometry, soft_shadow::Planes};
    use crate::model::light::{HardLight, HardLights, Lights, RadianceSh};
    use crate::visibility::shadow_maps::Receivers;

    #[test]
    fn neighbours_on_a_flat_receiver_get_what_each_gets_by_itself() {
        let mut global = RadianceSh::zero(2);
        global.rgb[0] = [2.0, 1.0, 0.5];
        let mut hard = HardLights::none();
        for (to_light_world, e) in [
            ([0.0, 0.6, 0.8], 1.0),
            ([-0.8, 0.0, 0.6], 0.7),
            ([0.6, 0.0, -0.8], 2.0),
            ([0.0, -0.28, 0.96], 0.2),
        ] {
            hard.push(HardLight { to_light_world, irradiance_rgb: [e, 0.5 * e, 0.0], extent_rad: 0.02 });
        }
        let light = LightTerms::of(&Lights { hard, ..Lights::soft(global) });
        let casters = [
            Vec3::new(-0.1, 0.0, 0.1),
            Vec3::new(0.1, 0.0, 0.1),
            Vec3::new(0.0, 0.1, 0.15),
            Vec3::new(0.0, 0.0, 0.4),
        ];
        let mut shadows = ShadowMapSet::default();
        let triangles = [[0, 1, 2], [0, 1, 3], [0, 2, 3]];
        shadows.fit(light.hard(), &casters, &triangles, &Receivers::default(), 256, 4);
        shadows.draw(&casters, &triangles);
        let mut planes = Planes::default();
        planes.find(&SurfaceGeometry {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            facet_normals: vec![Vec3::Z],
            albedo_rgb: vec![None],
            receives: vec![true],
        });
        planes.prepare_light(&light, &shadows, 4);
        let flat = planes.flat(0, true).unwrap();
        assert_eq!(planes.lights(flat).len(), 3, "one shines from below");
        let frame = SurfaceFrame { light: &light, shadows: &shadows, pcf_taps: 4 };
        let (mut partly, mut untouched) = (0, 0);
        for row in 0..80 {
            for start in [-0.6f32, -0.2, 0.2] {
                let points: [Vec3; RUN] = std::array::from_fn(|i| {
                    Vec3::new(start + 0.0125 * i as f32, 0.015 * row as f32 - 0.6, 0.0)
                });
                let soft: [[f32; 3]; RUN] =
                    std::array::from_fn(|i| [0.01 * i as f32, 0.0, if i > 16 { -0.1 } else { 0.0 }]);
                let lanes: [[f32; RUN]; 3] = std::array::from_fn(|c| points.map(|p| p[c]));
                let taken: [[f32; RUN]; 3] = std::array::from_fn(|c| soft.map(|t| t[c]));
                let mut out = [[9.0; 3]; RUN];
                at_run(&frame, flat, planes.lights(flat), &lanes, &taken, &mut out);
                for i in 0..RUN {
                    let n = flat.normal;
                    let one = at(&frame, points[i], n, n, soft[i], Some(flat.whole_rgb));
                    assert_eq!(out[i], one, "{}", points[i]);
                    let hard_only = at(&frame, points[i], n, n, [0.0; 3], None);
                    partly += usize::from(hard_only[0] < 1.0);
                    untouched += usize::from(hard_only == [1.0; 3]);
                }
            }
        }
        assert!(partly > 300 && untouched > 5000, "{partly} {untouched}");
    }
}
