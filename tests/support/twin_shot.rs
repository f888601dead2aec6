//! A frame of the twins' scene, and all that it is drawn from.

use super::twin_scene::{environment, scene};
use glam::{DVec3, Vec3};
use halflight::{
    animate::posed::Posed,
    engine::{Engine, RelightInput},
    math::{
        dice::Dice,
        lens::{Distortion, Lens},
        pose::Pose,
    },
    model::{
        environment::EnvironmentPicture,
        frame::Exposure,
        image::HdrImage,
        light::{HardLight, Lights, RadianceSh},
        picture::Picture,
        quality::{Quality, SelfShadow, SoftAt},
        response::Response,
        time::Timestamp,
    },
    plan::{
        FramePlan,
        effects::{self, Occasion},
    },
};

/// All that a frame is drawn from.
pub struct Shot {
    pub lens: Lens,
    pub pose: Pose,
    pub light: Lights,
    pub environment: EnvironmentPicture,
    pub background: HdrImage,
    pub response: Response,
    pub posed: Posed,
    pub plan: FramePlan,
}

impl Shot {
    /// Through a lens, with 1 or 4 samples a pixel.
    pub fn new(distortion: Distortion, coverage_samples: u32) -> Self {
        let (width, height) = (160, 120);
        let focal = if matches!(distortion, Distortion::Equidistant(_)) { 90.0 } else { 170.0 };
        let lens = Lens { distortion, ..Lens::pinhole(width, height, focal, focal, 81.0, 59.0) };
        let mut dice = Dice::new(3);
        let mut background = HdrImage::default();
        background.radiance.reshape(width as usize, height as usize, [0.0; 3]);
        background.flags.reshape(width as usize, height as usize, 0);
        background.radiance.pixels_mut().fill_with(|| [(); 3].map(|()| 0.2 + 0.6 * dice.unit_f32()));
        let mut global = RadianceSh::zero(5);
        for (i, row) in global.rgb[..25].iter_mut().enumerate() {
            *row = [(); 3].map(|()| (dice.unit_f32() - 0.5) * 0.3 + if i == 0 { 1.3 } else { 0.0 });
        }
        let mut light = Lights::soft(global);
        light.hard.push(HardLight {
            to_light_world: Vec3::new(0.4, 0.3, 0.7).normalize().to_array(),
            irradiance_rgb: [3.0, 2.8, 2.4],
            extent_rad: 0.0,
        });
        // Six maps: an array that a GL driver could take for a cube map.
        for k in 0..5 {
            let to_light = Vec3::new(-0.5 + 0.05 * k as f32, 0.2, 0.8 - 0.1 * k as f32).normalize();
            light.hard.push(HardLight {
                to_light_world: to_light.to_array(),
                irradiance_rgb: [0.2, 0.25, 0.3],
                extent_rad: 0.0,
            });
        }
        let mut plan = FramePlan::default();
        let soft_step_px = coverage_samples;
        let quality = Quality {
            coverage_samples,
            soft_step_px,
            // One of the lenses with soft shadows at vertices: the device cuts the grid once more for a bent lens.
            soft_at: match distortion {
                Distortion::RadialTangential(_) => SoftAt::Vertex,
                _ => SoftAt::Pixel,
            },
            shadow_map_texels: 512,
            self_shadow: SelfShadow::Transfer,
            ..Quality::default()
        };
        effects::plan(&Occasion::SHOW, &scene(), &light, &quality, &mut plan);
        let pose = Pose::look_at(DVec3::new(0.3, -0.6, 0.5), DVec3::new(0.0, 0.0, 0.05), DVec3::Z);
        let (response, posed) = (Response::srgb(), Posed::new(&scene()));
        Self { lens, pose, light, environment: environment(), background, response, posed, plan }
    }

    /// What an engine gets.
    pub fn input(&self) -> RelightInput<'_> {
        RelightInput {
            background: &self.background,
            lens: &self.lens,
            world_from_camera: &self.pose,
            light: &self.light,
            environment: Some(&self.environment),
            posed: Some(&self.posed),
            response: &self.response,
            shown_exposure: Exposure { time_s: 0.7, gain: 1.0 },
            t: Timestamp(7),
        }
    }

    /// Draws it, linear radiance too.
    pub fn draw(&self, engine: &mut dyn Engine) -> Picture {
        let mut out = Picture::default();
        engine.ask_for_linear(true);
        engine.load_scene(&scene()).expect("a sound scene");
        engine.relight(&self.plan, &self.input(), &mut out).expect("a sound frame");
        assert_eq!(out.t, Timestamp(7));
        out
    }
}
