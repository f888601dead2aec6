//! Stills: what one is composed of, and the drawing of it by the product's own engine and views.

pub mod bracket;
mod draw;
pub mod far_light;
pub mod moment;
mod of_scene;
pub mod traced;

pub use draw::Drawn;
pub(crate) use of_scene::faces_up;
pub use of_scene::{compose_scene, of_scene};

use crate::animate::posed::Posed;
use crate::daemon::{dress::dress, host::Host};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    environment::EnvironmentPicture,
    image::{HdrImage, RadianceImage},
    light::{Lights, RadianceSamples},
    picture::PictureView,
    quality::Quality,
    response::Response,
    scene::Scene,
};
use crate::nearfield::{faces::Faces, objects, prepare::KnownRoom};
use far_light::{FarLight, HalvedLight};
use glam::Vec3;
use std::sync::Arc;

/// What of the picture is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureQuantity {
    /// The picture.
    Radiance,
    /// The picture over the one without objects.
    Ratio,
    /// The picture without objects less the picture.
    Difference,
}

/// Everything that one still is drawn from.
#[derive(Clone, Debug)]
pub struct Still {
    /// What stands where.
    pub scene: Scene,
    /// Intrinsics and distortion, pixels.
    pub lens: Lens,
    /// Pose of the camera, metres: takes points of its frame to the world.
    pub world_from_camera: Pose,
    /// The light of the objects.
    pub light: Lights,
    /// What mirrors and sharp gloss see.
    pub environment: Option<EnvironmentPicture>,
    /// The place without the objects.
    pub background: HdrImage,
    /// For the 8-bit picture.
    pub response: Response,
    /// Exposure of the 8-bit picture where the still itself has one.
    pub exposure_s: Option<f64>,
    /// What of the picture is wanted.
    pub quantity: PictureQuantity,
    /// The known room that the scene stands in.
    pub room: Option<Arc<KnownRoom>>,
    /// Which part of the work is shown.
    pub view: PictureView,
    /// The light as it was measured, world frame; empty where it was not.
    pub samples: RadianceSamples,
    /// Time in the scene: where what moves is, seconds.
    pub time_s: f64,
}

/// What a still is composed of, before any setting of accuracy is applied.
#[derive(Clone, Debug)]
pub struct Composition {
    /// What stands where; no spheres or transfers fitted to it.
    pub scene: Scene,
    /// Intrinsics and distortion, pixels.
    pub lens: Lens,
    /// Pose of the camera, metres: takes points of its frame to the world.
    pub world_from_camera: Pose,
    /// Distant light; in a known room it has no part.
    pub far: FarLight,
    /// The known room that the scene stands in.
    pub room: Option<Arc<KnownRoom>>,
    /// The place without the objects.
    pub background: HdrImage,
    /// For the 8-bit picture.
    pub response: Response,
    /// Exposure of the 8-bit picture where the still itself has one.
    pub exposure_s: Option<f64>,
    /// What of the picture is wanted.
    pub quantity: PictureQuantity,
    /// Time in the scene: where what moves is, seconds.
    pub time_s: f64,
}

impl Composition {
    /// The still with these settings of accuracy: its bodies carry the spheres and transfers that they ask for, and its
    /// light is halved by them.
    pub fn still(&self, quality: &Quality, host: &Host<'_>) -> Still {
        let mut scene = self.scene.clone();
        dress(&mut scene, quality, host.progress);
        let HalvedLight { lights, environment } = self.halved(quality);
        Still {
            scene,
            lens: self.lens,
            world_from_camera: self.world_from_camera,
            light: lights,
            environment,
            background: self.background.clone(),
            response: self.response.clone(),
            exposure_s: self.exposure_s,
            quantity: self.quantity,
            room: self.room.clone(),
            view: PictureView::Final,
            samples: self.far.samples().0.into_owned(),
            time_s: self.time_s,
        }
    }

    /// The light of the objects with these settings: in a known room, its light where they are.
    pub fn halved(&self, quality: &Quality) -> HalvedLight {
        match &self.room {
            Some(room) => {
                let middle = middle_of(&posed(&self.scene, self.time_s));
                let lights = objects::lights_at(room, &Faces::of_room(&room.room), middle);
                HalvedLight { lights, environment: None }
            }
            None => self.far.halved(&self.scene, quality),
        }
    }
}

impl Still {
    /// What moves, where it is.
    pub fn posed(&self) -> Posed {
        posed(&self.scene, self.time_s)
    }

    /// Exposure of its 8-bit picture where none is asked for, seconds.
    pub fn shown_exposure_s(&self) -> f64 {
        self.exposure_s.unwrap_or_else(|| pleasant_exposure_s(&self.background.radiance))
    }
}

fn posed(scene: &Scene, time_s: f64) -> Posed {
    let mut posed = Posed::new(scene);
    posed.update(scene, time_s);
    posed
}

/// The middle of all virtual objects.
fn middle_of(posed: &Posed) -> Vec3 {
    let points = posed.objects().iter().flat_map(|o| &o.positions_world).filter(|p| p.is_finite());
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = points.fold(start, |(low, high), p| (low.min(*p), high.max(*p)));
    if low.is_finite() { low.midpoint(high) } else { Vec3::ZERO }
}

/// Exposure that puts nine tenths of all channels below 0.8; 1 of a black picture.
pub fn pleasant_exposure_s(picture: &RadianceImage) -> f64 {
    let mut all: Vec<f32> = picture.pixels().iter().flatten().copied().filter(|c| *c > 0.0).collect();
    all.sort_by(f32::total_cmp);
    all.get(all.len() * 9 / 10).map_or(1.0, |&high| 0.8 / f64::from(high))
}
