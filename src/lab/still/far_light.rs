//! Distant light before it is halved: one path from what was measured, read from a picture or stated to the light that
//! objects are drawn in, for scene files, reference cases and moments of recordings.

use crate::light::{
    below::{BelowHorizon, uniform},
    halve::{HalveOptions, halve_still, halve_still_with_rest},
    prefilter::{Prefilter, WantedEnvironment},
    project_sh::project_sh,
    split::SplitOptions,
};
use crate::model::{
    environment::EnvironmentPicture,
    light::{EnvironmentMap, HardLight, Lights, RadianceSamples, RadianceSh},
    quality::Quality,
    scene::Scene,
};
use glam::DMat3;
use std::borrow::Cow;

/// Texels a side of the picture that mirrors see of an environment picture.
const PICTURE_SIDE: usize = 512;

/// Distant light, world frame.
#[derive(Clone, Debug)]
pub struct FarLight {
    /// What is known of it.
    pub known: KnownLight,
    /// Lights that are stated as such; they come on top.
    pub direct: Vec<HardLight>,
    /// Which light comes from below the horizon.
    pub below: BelowHorizon,
    /// Whether only light from above the horizon counts as hard.
    pub above_horizon: bool,
}

/// What is known of distant light.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "a still has one of them")]
pub enum KnownLight {
    /// The same radiance from everywhere; nothing hard is hidden in it.
    Uniform([f32; 3]),
    /// Its picture: hard lights are looked for in it.
    Picture {
        /// Weighted directions, world frame.
        samples: RadianceSamples,
        /// All of it in SH as an engine projected it; `None`: to be projected from the samples.
        total: Option<RadianceSh>,
        /// The map that the samples come from, and its axes, where there is one: it is sharper than they are.
        map: Option<(EnvironmentMap, DMat3)>,
    },
}

/// Distant light, ready to draw with.
#[derive(Clone, Debug)]
pub struct HalvedLight {
    /// Hard lights, and the rest in SH.
    pub lights: Lights,
    /// What mirrors and sharp gloss see, where there are any.
    pub environment: Option<EnvironmentPicture>,
}

impl FarLight {
    /// No light at all, to be filled in.
    pub fn dark() -> Self {
        Self {
            known: KnownLight::Uniform([0.0; 3]),
            direct: Vec::new(),
            below: BelowHorizon::AsGiven,
            above_horizon: true,
        }
    }

    /// The light for a scene with these settings.
    pub fn halved(&self, scene: &Scene, quality: &Quality) -> HalvedLight {
        let (samples, below_rgb) = self.samples();
        let total = self.total(&samples, quality.sh_order);
        let (mut lights, left) = match self.known {
            KnownLight::Uniform(_) => (Lights::soft(total), None),
            KnownLight::Picture { .. } => halve_still_with_rest(&samples, &total, self.options(quality)),
        };
        for light in &self.direct {
            lights.hard.push(*light);
        }
        let wanted = WantedEnvironment::by(scene, quality.sh_order);
        let is_picture = matches!(self.known, KnownLight::Picture { .. });
        let environment = (is_picture && wanted.picture).then(|| {
            let (mut work, mut picture) = self.picture(&samples, below_rgb);
            if wanted.glossy {
                work.levels(left.as_ref(), &mut picture);
            }
            picture
        });
        HalvedLight { lights, environment }
    }

    /// What mirrors and sharp gloss would see, whatever the scene has. `None` of light that has no picture.
    pub fn environment(&self, quality: &Quality) -> Option<EnvironmentPicture> {
        if let KnownLight::Uniform(_) = self.known {
            return None;
        }
        let (samples, below_rgb) = self.samples();
        let total = self.total(&samples, quality.sh_order);
        let (_, left) = halve_still_with_rest(&samples, &total, self.options(quality));
        let (mut work, mut picture) = self.picture(&samples, below_rgb);
        work.levels(left.as_ref(), &mut picture);
        Some(picture)
    }

    /// The soft half without de-ringing; `None` of light that is not halved.
    pub fn plain_soft_half(&self, quality: &Quality) -> Option<RadianceSh> {
        let KnownLight::Picture { .. } = self.known else { return None };
        let (samples, _) = self.samples();
        let total = self.total(&samples, quality.sh_order);
        let options = HalveOptions { dering: false, ..self.options(quality) };
        Some(halve_still(&samples, &total, options).global)
    }

    /// Weighted directions as they are drawn with; empty of uniform light that is left as given. With the radiance from
    /// below the horizon where that is one for all directions.
    pub fn samples(&self) -> (Cow<'_, RadianceSamples>, Option<[f32; 3]>) {
        match (&self.known, self.below) {
            (KnownLight::Picture { samples, .. }, BelowHorizon::AsGiven) => (Cow::Borrowed(samples), None),
            (KnownLight::Picture { samples, .. }, below) => {
                let mut samples = samples.clone();
                let below_rgb = below.put(&mut samples);
                (Cow::Owned(samples), below_rgb)
            }
            (KnownLight::Uniform(_), BelowHorizon::AsGiven) => (Cow::Owned(RadianceSamples::default()), None),
            (KnownLight::Uniform(radiance_rgb), below) => {
                let mut samples = RadianceSamples::default();
                uniform(*radiance_rgb, &mut samples);
                let below_rgb = below.put(&mut samples);
                (Cow::Owned(samples), below_rgb)
            }
        }
    }

    /// All of it in SH of an order. What an engine projected is taken where it is of that order and all as given.
    pub fn total(&self, samples: &RadianceSamples, order: usize) -> RadianceSh {
        match (&self.known, self.below) {
            (KnownLight::Picture { total: Some(total), .. }, BelowHorizon::AsGiven)
                if total.order == order =>
            {
                *total
            }
            (KnownLight::Uniform(radiance_rgb), BelowHorizon::AsGiven) => {
                let mut total = RadianceSh::zero(order);
                total.rgb[0] = radiance_rgb.map(|c| c * (4.0 * std::f32::consts::PI).sqrt());
                total
            }
            _ if samples.directions.is_empty() => RadianceSh::zero(order),
            _ => project_sh(samples, order),
        }
    }

    fn picture(
        &self,
        samples: &RadianceSamples,
        below_rgb: Option<[f32; 3]>,
    ) -> (Prefilter, EnvironmentPicture) {
        let (mut work, mut picture) = (Prefilter::default(), EnvironmentPicture::default());
        match &self.known {
            KnownLight::Picture { map: Some((map, world_from_map)), .. } => {
                work.look_at_map(map, *world_from_map, PICTURE_SIDE, &mut picture);
            }
            _ => work.see(samples, 1.0, &mut picture),
        }
        if let Some(below_rgb) = below_rgb {
            BelowHorizon::put_picture(below_rgb, &mut picture);
        }
        (work, picture)
    }

    fn options(&self, quality: &Quality) -> HalveOptions {
        HalveOptions {
            kind: quality.split,
            lights: quality.lights,
            shadow_maps: quality.shadow_maps,
            net_flux: SplitOptions::default(),
            above_horizon: self.above_horizon,
            dering: quality.dering,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sh::zonal::PhongNorm;
    use crate::model::quality::SplitKind;

    fn sky(below: BelowHorizon) -> FarLight {
        let mut samples = RadianceSamples::default();
        uniform([1.0; 3], &mut samples);
        FarLight { known: KnownLight::Picture { samples, total: None, map: None }, below, ..FarLight::dark() }
    }

    #[test]
    fn stated_and_measured_uniform_light_are_the_same_light() {
        let quality = Quality { split: SplitKind::Sh, ..Quality::default() };
        for below in
            [BelowHorizon::AsGiven, BelowHorizon::Dark, BelowHorizon::Surface { albedo_rgb: [0.5; 3] }]
        {
            let stated = FarLight { known: KnownLight::Uniform([1.0; 3]), ..sky(below) };
            let scene = Scene::default();
            let [a, b] = [stated, sky(below)].map(|light| light.halved(&scene, &quality).lights);
            assert!(a.hard.as_slice().is_empty() && b.hard.as_slice().is_empty());
            for (a, b) in a.global.rows().iter().zip(b.global.rows()) {
                assert!((a[0] - b[0]).abs() < 2e-4, "{below:?}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn light_from_below_is_gone_where_it_is_dark_and_reflected_where_there_is_a_surface() {
        let band1 = |below| {
            let light = sky(below);
            light.total(&light.samples().0, 2).rgb[2][0]
        };
        let dark = band1(BelowHorizon::Dark);
        let half = band1(BelowHorizon::Surface { albedo_rgb: [0.5; 3] });
        assert!(band1(BelowHorizon::AsGiven).abs() < 1e-4);
        assert!(dark > 1.0 && (half / dark - 0.5).abs() < 1e-3, "{dark} {half}");
    }

    #[test]
    fn mirrors_get_a_picture_and_matt_things_none() {
        use crate::model::scene::{Material, Mesh, VirtualObject};
        let scene = |material| Scene {
            objects: vec![VirtualObject {
                name: String::new(),
                mesh: Mesh::default(),
                material,
                world_from_object: glam::Affine3A::IDENTITY,
                openness: Vec::new(),
            }],
            ..Scene::default()
        };
        let quality = Quality { phong_norm: PhongNorm::EnergySafe, ..Quality::default() };
        let light = sky(BelowHorizon::Dark);
        let mirror = light.halved(&scene(Material::Mirror { reflectance_rgb: [1.0; 3] }), &quality);
        let picture = mirror.environment.unwrap();
        assert!(picture.all.look(glam::Vec3::Z)[0] > 0.9 && picture.all.look(glam::Vec3::NEG_Z)[0] < 0.1);
        let matt = light.halved(&scene(Material::Lambert { albedo_rgb: [1.0; 3] }), &quality);
        assert!(matt.environment.is_none());
    }
}
