//! Camera, light and shadow camera as the shaders read them.

use glam::{DVec3, Vec3};

use super::params;
use crate::{
    compose::{raster, shade_object},
    math::lens::{Distortion, Lens},
    model::response::Response,
    visibility::shadow_maps,
};

/// Steps of the search for the largest radius that a lens takes.
const STEPS: u32 = 40;
/// tan of the widest angle that a lens with a plane picture takes.
const LARGEST_TANGENT: f64 = 600.0;
/// Directions around the axis in which the domain is probed.
const PROBES: u32 = 16;

/// A lens with what has to be searched for it, kept while the lens stays.
#[derive(Default)]
pub struct LensDomain {
    lens: Option<Lens>,
    largest: f32,
}

impl LensDomain {
    /// Largest squared radius on the plane z = 1 (radial) or angle (equidistant) at which the model still rises.
    fn of(&mut self, lens: &Lens) -> f32 {
        if self.lens.as_ref() != Some(lens) {
            self.lens = Some(*lens);
            self.largest = match lens.distortion {
                Distortion::None => f32::MAX,
                Distortion::RadialTangential(_) => {
                    let tangent =
                        largest(LARGEST_TANGENT, |t, x, y| lens.project(DVec3::new(t * x, t * y, 1.0)));
                    (tangent * tangent) as f32
                }
                Distortion::Equidistant(_) => {
                    let end = std::f64::consts::PI - 1e-3;
                    largest(end, |a, x, y| lens.project(DVec3::new(a.sin() * x, a.sin() * y, a.cos()))) as f32
                }
            };
        }
        self.largest
    }
}

/// The largest of 0..=limit that `project` takes in every direction (x, y) around the axis.
fn largest<T>(limit: f64, project: impl Fn(f64, f64, f64) -> Option<T>) -> f64 {
    let taken = |r: f64| {
        (0..PROBES).all(|k| {
            let (y, x) = (f64::from(k) / f64::from(PROBES) * std::f64::consts::TAU).sin_cos();
            project(r, x, y).is_some()
        })
    };
    if taken(limit) {
        return limit;
    }
    let (mut low, mut high) = (0.0, limit);
    for _ in 0..STEPS {
        let middle = 0.5 * (low + high);
        if taken(middle) { low = middle } else { high = middle }
    }
    low
}

fn four(v: Vec3) -> [f32; 4] {
    [v.x, v.y, v.z, 0.0]
}

fn rgb4(rgb: [f32; 3]) -> [f32; 4] {
    [rgb[0], rgb[1], rgb[2], 0.0]
}

/// Camera and lens.
pub fn view(lens: &Lens, domain: &mut LensDomain, view: &raster::View, near_m: f32) -> params::View {
    let camera_from_world = view.world_from_camera.transpose();
    let f = |x: f64| x as f32;
    let (model, distortion, distortion_more) = match lens.distortion {
        Distortion::None => (0, [0.0; 4], [0.0; 4]),
        Distortion::RadialTangential([a, b, c, d, e, g, h, i]) => {
            (1, [a, b, c, d].map(f), [e, g, h, i].map(f))
        }
        Distortion::Equidistant(k) => (2, k.map(f), [0.0; 4]),
    };
    params::View {
        eye: four(view.eye),
        right: four(camera_from_world.row(0)),
        down: four(camera_from_world.row(1)),
        forward: four(camera_from_world.row(2)),
        focal: [lens.fx, lens.fy, lens.cx, lens.cy].map(f),
        frame: [lens.width as f32, lens.height as f32, near_m, domain.of(lens)],
        distortion,
        distortion_more,
        model: [model, 0, 0, 0],
    }
}

/// The light; `exposure` multiplies the radiance of objects.
pub fn light(light: &shade_object::LightTerms, exposure: f32) -> params::LightTerms {
    params::LightTerms {
        to_light: rgb4(light.to_light_world),
        direct_rgb: rgb4(light.direct_rgb),
        order: [light.order as u32, 0, 0, 0],
        exposure: [exposure, 0.0, 0.0, 0.0],
        soft_rgb: light.soft_rgb.map(rgb4),
        global_rgb: light.global_rgb.map(rgb4),
        total_rgb: light.total_rgb.map(rgb4),
    }
}

/// The shadow map's camera; `None`: there is no map and everything is lit.
pub fn shadow(camera: Option<&shadow_maps::ShadowCamera>, taps: u32) -> params::ShadowCamera {
    camera.map_or(bytemuck::Zeroable::zeroed(), |camera| params::ShadowCamera {
        column: camera.rows[0],
        row: camera.rows[1],
        depth: camera.rows[2],
        texel_depth_m: [camera.texel_m, camera.depth_m, 0.0, 0.0],
        texels_taps: [camera.texels, taps, 0, 0],
    })
}

/// What brings the camera's white, at the shown exposure, to 1: objects are kept as 16-bit floats.
pub fn exposure_of_white(response: &Response, effective_s: f64) -> f32 {
    let white = response.log_exposure().iter().map(|g| f64::from(g[255])).fold(f64::MIN, f64::max).exp();
    (effective_s / white).clamp(1e-30, 1e30) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_domain_ends_where_the_model_folds() {
        let pinhole = Lens::pinhole(640, 480, 500.0, 500.0, 320.0, 240.0);
        // r (1 + k1 r^2) rises up to r^2 = -1 / (3 k1).
        let radial = Distortion::RadialTangential([-0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let folds = Lens { distortion: radial, ..pinhole };
        let mut domain = LensDomain::default();
        assert!((domain.of(&folds) - 1.0 / 0.6).abs() < 1e-4);
        let wide = Lens { distortion: Distortion::Equidistant([0.0; 4]), ..pinhole };
        assert!((domain.of(&wide) - (std::f32::consts::PI - 1e-3)).abs() < 1e-6);
        assert_eq!(domain.of(&pinhole), f32::MAX);
    }

    #[test]
    fn white_becomes_one() {
        let srgb = Response::srgb();
        assert!((exposure_of_white(&srgb, 0.02) - 0.02).abs() < 1e-9);
    }
}
