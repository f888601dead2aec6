//! Small scenes that hard cases are drawn in, and the light of small environment pictures.

use crate::animate::posed::Posed;
use crate::assets::shapes;
use crate::engine::{Engine, EngineError, LightJob, MeasuredLight, RelightInput};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    animation::Figure,
    blocker::Rung,
    frame::Exposure,
    image::{HdrImage, Image, RadianceImage},
    light::{EnvironmentMap, HardLight, Lights, MapLayout, RadianceSh},
    picture::Picture,
    quality::Quality,
    response::Response,
    scene::{Material, Mesh, RealSurface, Scene, VirtualObject},
    time::Timestamp,
};
use crate::plan::{
    FramePlan,
    effects::{self, Occasion},
};
use glam::{Affine3A, DVec3, Vec3};

/// SH order of the light here.
pub const ORDER: usize = 4;

/// All that one small picture is drawn from.
#[derive(Clone, Debug)]
pub struct StressStage {
    /// Objects, surfaces, spheres.
    pub scene: Scene,
    /// Hard lights, and the rest as harmonics, world frame.
    pub light: Lights,
    /// Accuracy.
    pub quality: Quality,
    /// Where the camera is, metres.
    pub eye_world: DVec3,
    /// Where it looks, metres.
    pub target_world: DVec3,
    /// The camera's picture has this radiance everywhere.
    pub background: f32,
    /// The shown exposure, seconds at unit gain.
    pub exposure_s: f64,
    /// Width and height, pixels; the focal length is the width.
    pub size_px: [u32; 2],
    /// Whether 8-bit values are wanted, too.
    pub display: bool,
}

impl StressStage {
    /// A scene in a light: 48 x 36 pixels of radiance 1, seen from above at an angle.
    pub fn new(scene: Scene, light: Lights) -> Self {
        let quality = Quality {
            sh_order: ORDER,
            rung: Rung::Hybrid,
            soft_step_px: 1,
            coverage_samples: 1,
            shadow_map_texels: 256,
            ..Quality::default()
        };
        Self {
            scene,
            light,
            quality,
            eye_world: DVec3::new(0.25, -0.6, 0.7),
            target_world: DVec3::new(0.0, 0.0, 0.02),
            background: 1.0,
            exposure_s: 1.0,
            size_px: [48, 36],
            display: false,
        }
    }

    /// Draws one frame on an engine; whatever the engine refuses is returned.
    pub fn draw(&self, engine: &mut dyn Engine) -> Result<Picture, EngineError> {
        let [width, height] = self.size_px;
        let focal_px = f64::from(width);
        let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
        let lens = Lens::pinhole(width, height, focal_px, focal_px, cx, cy);
        let mut background = HdrImage::default();
        background.radiance.reshape(width as usize, height as usize, [self.background; 3]);
        background.flags.reshape(width as usize, height as usize, 0);
        let up = if self.eye_world.truncate() == self.target_world.truncate() { DVec3::Y } else { DVec3::Z };
        let mut plan = FramePlan::default();
        let occasion = Occasion { display: self.display, ..Occasion::SHOW };
        effects::plan(&occasion, &self.scene, &self.light, &self.quality, &mut plan);
        engine.ask_for_linear(true);
        engine.load_scene(&self.scene)?;
        let input = RelightInput {
            background: &background,
            lens: &lens,
            world_from_camera: &Pose::look_at(self.eye_world, self.target_world, up),
            light: &self.light,
            environment: None,
            posed: Some(&Posed::new(&self.scene)),
            response: &Response::srgb(),
            shown_exposure: Exposure { time_s: self.exposure_s, gain: 1.0 },
            t: Timestamp(0),
        };
        let mut picture = Picture::default();
        engine.relight(&plan, &input, &mut picture)?;
        Ok(picture)
    }

    /// The number of a drawn picture that breaks [0, 1] most, or else its least: NaN where one is not finite, its
    /// largest where that is above 1.
    pub fn least_share(&self, engine: &mut dyn Engine) -> Result<f64, EngineError> {
        Ok(least_share(&self.draw(engine)?.radiance))
    }

    /// The largest number of a drawn picture; NaN where one is not finite or negative.
    pub fn brightest(&self, engine: &mut dyn Engine) -> Result<f64, EngineError> {
        let picture = self.draw(engine)?;
        let all = picture.radiance.pixels().as_flattened();
        if all.iter().any(|c| !c.is_finite() || *c < 0.0) {
            return Ok(f64::NAN);
        }
        Ok(all.iter().map(|c| f64::from(*c)).fold(0.0, f64::max))
    }
}

fn least_share(picture: &RadianceImage) -> f64 {
    let all = picture.pixels().as_flattened();
    if all.iter().any(|c| !c.is_finite()) {
        return f64::NAN;
    }
    let (least, most) = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), c| {
        (least.min(f64::from(*c)), most.max(f64::from(*c)))
    });
    if most > 1.0 { most } else { least }
}

/// The ground: a real surface at z = 0.
pub fn ground() -> RealSurface {
    RealSurface {
        name: "ground".into(),
        mesh: shapes::plane_z0(20.0),
        receives_shadow: true,
        albedo_rgb: None,
    }
}

/// Spheres alone over the ground, each a body of its own.
pub fn spheres(spheres: impl IntoIterator<Item = (Vec3, f32)>) -> Scene {
    let body = |(k, sphere): (usize, (Vec3, f32))| {
        Figure::still(format!("sphere {k}"), k, Affine3A::IDENTITY, std::iter::once(sphere))
    };
    Scene {
        surfaces: vec![ground()],
        figures: spheres.into_iter().enumerate().map(body).collect(),
        ..Scene::default()
    }
}

/// One object.
pub fn object(name: &str, mesh: Mesh, material: Material, at_world: Vec3) -> VirtualObject {
    VirtualObject {
        name: name.into(),
        mesh,
        material,
        world_from_object: Affine3A::from_translation(at_world),
        openness: Vec::new(),
    }
}

/// One object over the ground, without spheres.
pub fn object_over_ground(object: VirtualObject) -> Scene {
    Scene { objects: vec![object], surfaces: vec![ground()], ..Scene::default() }
}

/// The same radiance from everywhere.
pub fn uniform(radiance: f32) -> Lights {
    let mut global = RadianceSh::zero(ORDER);
    global.rgb[0] = [radiance * (4.0 * std::f32::consts::PI).sqrt(); 3];
    Lights::soft(global)
}

/// One hard light, white, and nothing else.
pub fn sun(to_light_world: Vec3, irradiance: f32) -> Lights {
    let mut lights = Lights::soft(RadianceSh::zero(ORDER));
    let irradiance_rgb = [irradiance; 3];
    lights.hard.push(HardLight {
        to_light_world: to_light_world.to_array(),
        irradiance_rgb,
        extent_rad: 0.0,
    });
    lights
}

/// An equirectangular picture of one radiance.
pub fn even_map(width: usize, height: usize, radiance: f32) -> EnvironmentMap {
    EnvironmentMap { layout: MapLayout::Equirect, radiance: Image::filled(width, height, [radiance; 3]) }
}

/// The light in an environment picture, as the engine measures it.
pub fn measure(engine: &mut dyn Engine, map: &EnvironmentMap) -> Result<MeasuredLight, EngineError> {
    let quality = Quality { sh_order: ORDER, ..Quality::default() };
    engine.estimate_light(&LightJob::Map(map), &quality)
}

/// Mean radiance of light in SH, green.
pub fn mean_radiance(light: &RadianceSh) -> f64 {
    f64::from(light.rgb[0][1]) / (4.0 * std::f64::consts::PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_number_of_a_picture_is_told() {
        let of = |pixels: &[[f32; 3]]| {
            least_share(&Image::from_pixels(pixels.len(), 1, pixels.to_vec()).unwrap_or_default())
        };
        assert_eq!(of(&[[1.0; 3], [0.25, 0.5, 1.0]]), 0.25);
        assert_eq!(of(&[[1.5; 3], [0.25, 0.5, 1.0]]), 1.5);
        assert!(of(&[[0.0; 3], [f32::NAN, 0.5, 1.0]]).is_nan());
        assert!(of(&[[0.0; 3], [f32::INFINITY, 0.5, 1.0]]).is_nan());
    }
}
