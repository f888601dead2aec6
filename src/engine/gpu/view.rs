//! Camera, light and shadow camera as the shaders read them.

use glam::{DVec2, DVec3, Vec3};

use super::{params, scene::Cut};
use crate::{
    compose::{raster, shade_object},
    math::lens::{Distortion, Lens},
    model::light::MAX_HARD_LIGHTS,
    nearfield::{frame::NearFrame, sun_shadows::SunShadows},
    visibility::{point_maps, shadow_maps},
};

/// Steps of the search for the largest radius that a lens takes.
const STEPS: u32 = 40;
/// tan of the widest angle that a lens with a plane picture takes.
const LARGEST_TANGENT: f64 = 600.0;
/// Directions around the axis in which the domain is probed.
const PROBES: u32 = 16;

/// How far the middle of an edge may be drawn from where it belongs, pixels.
const ASIDE_PX: f64 = 0.03;
/// Angle of the edges by which that is measured, radians.
const PROBE_EDGE_RAD: f64 = 0.02;
/// Shortest and longest edges that are asked for, radians: between 0.01 and 0.2 nothing else is practical.
const EDGE_RAD: std::ops::RangeInclusive<f64> = 0.01..=0.2;

/// A lens with what has to be searched for it, kept while the lens stays.
#[derive(Default)]
pub struct LensDomain {
    lens: Option<Lens>,
    largest: f32,
    edge_rad: f32,
    half_angle_rad: f32,
}

impl LensDomain {
    /// How meshes have to be cut so that their edges can be drawn straight; `None` for a pinhole.
    pub fn cut(&mut self, lens: &Lens, view: &raster::View) -> Option<Cut> {
        self.of(lens);
        (lens.distortion != Distortion::None).then_some(Cut {
            eye: view.eye,
            axis: view.world_from_camera.z_axis,
            half_angle_rad: self.half_angle_rad,
            longest_rad: self.edge_rad,
        })
    }

    /// Largest squared radius on the plane z = 1 (radial) or angle (equidistant) at which the model still rises.
    fn of(&mut self, lens: &Lens) -> f32 {
        if self.lens.as_ref() != Some(lens) {
            self.lens = Some(*lens);
            self.edge_rad = longest_edge_rad(lens) as f32;
            self.half_angle_rad = half_angle_rad(lens) as f32;
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

/// Half angle of a cone around the axis that holds the whole picture.
fn half_angle_rad(lens: &Lens) -> f64 {
    const STEPS: u32 = 32;
    let (width, height) = (f64::from(lens.width), f64::from(lens.height));
    let border = (0..=STEPS).flat_map(|k| {
        let t = f64::from(k) / f64::from(STEPS);
        [(t * width, 0.0), (t * width, height), (0.0, t * height), (width, t * height)]
    });
    let angle =
        |(x, y)| lens.unproject(DVec2::new(x, y)).map_or(std::f64::consts::PI, |d| d.angle_between(DVec3::Z));
    // The rays between the probes, with room to spare.
    border.map(angle).fold(0.0, f64::max) + 0.02
}

/// How far the middle of an edge lands from where the rasteriser puts it grows with the square of the edge's angle:
/// measured on short edges all over the picture.
fn longest_edge_rad(lens: &Lens) -> f64 {
    const GRID: u32 = 8;
    let mut shortest = *EDGE_RAD.end();
    for cell in 0..(GRID + 1) * (GRID + 1) {
        let share = |k: u32, size: u32| f64::from(k) / f64::from(GRID) * f64::from(size);
        let pixel = DVec2::new(share(cell % (GRID + 1), lens.width), share(cell / (GRID + 1), lens.height));
        let Some(middle) = lens.unproject(pixel) else { continue };
        // Ends of equal w, so that the rasteriser's middle is the chord's.
        let (across, along) = match lens.distortion {
            Distortion::Equidistant(_) => middle.any_orthonormal_pair(),
            _ => (DVec3::X, DVec3::Y),
        };
        for k in 0..PROBES {
            let (sin, cos) = (f64::from(k) / f64::from(PROBES) * std::f64::consts::PI).sin_cos();
            let half = (0.5 * PROBE_EDGE_RAD) * (across * cos + along * sin);
            let (from, to) = (middle - half, middle + half);
            if let (Some(a), Some(b)) = (lens.project(from), lens.project(to)) {
                let aside_px = (pixel - 0.5 * (a + b)).length();
                shortest = shortest.min(from.angle_between(to) * (ASIDE_PX / aside_px.max(1e-9)).sqrt());
            }
        }
    }
    shortest.max(*EDGE_RAD.start())
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
    let mut hard = [[[0.0; 4]; 2]; MAX_HARD_LIGHTS];
    for (slot, light) in hard.iter_mut().zip(light.hard()) {
        *slot = [rgb4(light.to_light_world), rgb4(light.irradiance_rgb)];
    }
    params::LightTerms {
        order_hard: [light.order as u32, light.hard().len() as u32, 0, 0],
        exposure: [exposure, 0.0, 0.0, 0.0],
        soft_rgb: light.soft_rgb.map(rgb4),
        global_rgb: light.global_rgb.map(rgb4),
        total_rgb: light.total_rgb.map(rgb4),
        hard,
    }
}

/// The shadow maps' cameras; none: everything is lit.
pub fn shadows(cameras: &[Option<shadow_maps::ShadowCamera>], taps: u32) -> params::ShadowCameras {
    let mut all: params::ShadowCameras = bytemuck::Zeroable::zeroed();
    for (slot, camera) in all.cameras.iter_mut().zip(cameras) {
        *slot = shadow(camera.as_ref(), taps);
    }
    all
}

/// A shadow map's camera; `None`: there is no map and everything is lit.
fn shadow(camera: Option<&shadow_maps::ShadowCamera>, taps: u32) -> params::ShadowCamera {
    camera.map_or(bytemuck::Zeroable::zeroed(), |camera| params::ShadowCamera {
        column: camera.rows[0],
        row: camera.rows[1],
        depth: camera.rows[2],
        texel_depth_m: [camera.texel_m, camera.depth_m, 0.0, 0.0],
        texels_taps: [camera.texels, taps, 0, 0],
    })
}

/// The cameras of near lights; where one has none everything is lit.
pub fn near_cameras(cameras: &[Option<point_maps::PointCamera>], out: &mut params::PointCameras) {
    for (slot, camera) in out.cameras.iter_mut().zip(cameras) {
        *slot = camera.as_ref().map_or(bytemuck::Zeroable::zeroed(), |camera| {
            let [column, row, forward] = camera.rows;
            let [x, y, z] = camera.place_world.to_array();
            params::PointCamera { column, row, forward, place_near: [x, y, z, camera.near_m] }
        });
    }
}

/// Their places, and how their maps are spread: tiles a side of a page, maps a page, texels a side of a map.
pub fn near_lights(frame: &NearFrame, [tiles, maps, texels]: [u32; 3], out: &mut params::PointLights) {
    let cameras = frame.maps().cameras();
    let side = cameras.iter().flatten().next().map_or(1, |camera| camera.side);
    out.tiles_maps_texels_side = [tiles, maps, texels, side];
    for (slot, camera) in out.half_axes.iter_mut().zip(cameras) {
        *slot = camera.as_ref().map_or(bytemuck::Zeroable::zeroed(), |camera| {
            let [[a, b, c], [d, e, f]] = camera.half_axes;
            [[a, b, c, camera.texel], [d, e, f, camera.shift]]
        });
    }
}

/// The suns of a known room, and whose map of the objects each is hidden by in a frame.
pub fn suns(suns: &SunShadows, frame: &NearFrame) -> params::SunTerms {
    let mut terms: params::SunTerms = bytemuck::Zeroable::zeroed();
    terms.counts[0] = suns.len().min(MAX_HARD_LIGHTS) as u32;
    for (k, slot) in terms.suns.iter_mut().enumerate() {
        if let Some((light, _)) = suns.get(k) {
            let map = frame.sun_maps().get(k).copied().flatten().map_or(0, |map| map + 1);
            let [r, g, b] = light.irradiance_rgb;
            *slot = [rgb4(light.to_light_world), [r, g, b, map as f32]];
        }
    }
    terms
}

/// The cameras of the room's own maps under them.
pub fn room_cameras(suns: &SunShadows) -> params::ShadowCameras {
    let mut all: params::ShadowCameras = bytemuck::Zeroable::zeroed();
    for (k, slot) in all.cameras.iter_mut().enumerate() {
        let camera = suns.get(k).and_then(|(_, maps)| maps.cameras().first().and_then(Option::as_ref));
        *slot = shadow(camera, 0);
    }
    all
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
    fn edges_are_as_short_as_the_distortion_asks() {
        let pinhole = Lens::pinhole(640, 480, 600.0, 600.0, 320.0, 240.0);
        let mut domain = LensDomain::default();
        let view = raster::View::of(&crate::math::pose::Pose::IDENTITY);
        assert_eq!(domain.cut(&pinhole, &view), None);
        let bent = |k1: f64| {
            let distortion = Distortion::RadialTangential([k1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
            Lens { distortion, ..pinhole }
        };
        let mut edge = |k1| domain.cut(&bent(k1), &view).expect("distorted").longest_rad;
        let (weak, strong) = (edge(-0.01), edge(-0.25));
        // The bow is proportional to k1, the edge to its root.
        assert!(strong < 0.04 && weak > 4.0 * strong && weak < 7.0 * strong, "{weak} {strong}");
    }
}
