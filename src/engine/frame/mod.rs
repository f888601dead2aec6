//! What both engines need of a frame: the scene as it stands, cameras and lights of shadow maps, spheres that block soft
//! light, a known room, what of earlier frames is still good, and the results that are in the host's memory. Neither engine
//! knows the other; both know this.

mod check;
mod held;
mod results;
mod room;
mod shadows;
mod twin_passes;

pub(crate) use check::{check_frame, check_light};
pub(crate) use held::HeldProducts;
pub(crate) use results::HostResults;
pub(crate) use room::RoomState;
pub(crate) use twin_passes::TwinPasses;

use crate::animate::posed::Posed;
use crate::compose::{
    geometry::{ObjectGeometry, SurfaceGeometry},
    raster::View,
    reflected::Reflected,
    shade_object::{LightTerms, Surroundings},
    soft_grid::SoftGrid,
    soft_shadow::{Planes, Transfer},
    transferred::{Transferred, VertexFrame},
};
use crate::math::lens::Lens;
use crate::model::{quality::Quality, response::Response, scene::Scene};
use crate::plan::{FramePlan, PassSet};
use crate::visibility::{
    blockers::Blockers,
    shadow_maps::{Receivers, ShadowMapSet},
};
use crate::{EngineError, NearChoice, RelightInput};
use glam::Vec3;

/// One frame's inputs, and what follows from them alone.
pub(crate) struct FrameJob<'a> {
    pub input: &'a RelightInput<'a>,
    /// Its lens, and where it stands.
    pub camera: View,
    pub light: LightTerms,
    pub quality: &'a Quality,
    /// The passes whose results the picture is drawn from.
    pub uses: PassSet,
}

impl<'a> FrameJob<'a> {
    /// Of a planned frame.
    pub fn planned(plan: &'a FramePlan, input: &'a RelightInput<'a>) -> Self {
        Self { uses: plan.uses(), ..Self::looked_at(&plan.quality, input) }
    }

    /// Of a frame that is not planned yet.
    pub fn looked_at(quality: &'a Quality, input: &'a RelightInput<'a>) -> Self {
        Self {
            input,
            camera: View::of(input.world_from_camera),
            light: LightTerms::of(input.light),
            quality,
            uses: PassSet::default(),
        }
    }

    /// What mirrors and sharp gloss see.
    pub fn surroundings(&self, reflected: &'a Reflected) -> Surroundings<'a> {
        let (picture, norm) = (self.input.environment, self.quality.phong_norm);
        Surroundings::new(picture, reflected, norm, self.light.order)
    }

    /// Columns and rows of the picture.
    pub fn size(&self) -> (usize, usize) {
        let background = &self.input.background.radiance;
        (background.width(), background.height())
    }

    /// The lens of the coarse picture of soft shadows.
    pub fn coarse_lens(&self) -> Lens {
        coarse_lens(self.input.lens, self.quality.soft_step_px)
    }

    /// What brings the camera's white, at the shown exposure, to 1: a device keeps objects as 16-bit floats.
    pub fn exposure_of_white(&self) -> f32 {
        exposure_of_white(self.input.response, self.input.shown_exposure.effective_s())
    }
}

/// The scene, and all that passes of either engine are drawn from; everything here is reused from frame to frame.
#[derive(Default)]
pub(crate) struct FrameState {
    pub objects: ObjectGeometry,
    pub surfaces: SurfaceGeometry,
    /// How many scenes were loaded: the surfaces stay while this stays.
    pub scenes_loaded: u64,
    receivers: Receivers,
    /// The hard lights' maps and their cameras.
    pub shadows: ShadowMapSet,
    pub reflected: Reflected,
    /// Soft light at the vertices of objects.
    pub transferred: Transferred,
    /// Whether objects have moved since `transferred` looked.
    moved: bool,
    pub blockers: Blockers,
    pub transfer: Transfer,
    pub planes: Planes,
    pub grid: SoftGrid,
    pub results: HostResults,
    pub room: RoomState,
    /// Whether the scene stands in the room.
    stands_in_room: bool,
    pub held: HeldProducts,
}

impl FrameState {
    /// Takes a scene. Errors: it stands in a room that was not loaded.
    pub fn load(&mut self, scene: &Scene) -> Result<(), EngineError> {
        if scene.room.is_some() && self.room.known().is_none() {
            return Err(EngineError::Input(
                "the scene stands in a known room that the engine was not given".into(),
            ));
        }
        self.held.forget_scene();
        self.scenes_loaded += 1;
        self.objects.load(scene);
        self.surfaces.load(&scene.surfaces);
        self.stands_in_room = scene.room.is_some();
        if self.stands_in_room {
            self.room.place(&self.objects, &mut self.surfaces);
        }
        self.planes.find(&self.surfaces);
        self.surfaces.receivers(&mut self.receivers);
        self.reflected.load(&self.surfaces);
        self.transferred.load(scene);
        Ok(())
    }

    /// Moves what has moved.
    fn pose(&mut self, input: &RelightInput<'_>) {
        let objects = input.posed.map_or(&[][..], Posed::objects);
        for (index, object) in objects.iter().enumerate().filter(|(_, o)| o.moved) {
            let Some((vertices, _)) = self.objects.ranges.get(index).cloned() else { continue };
            let same = |a: &[Vec3], b: Option<&[Vec3]>| b.is_none_or(|b| a == b);
            if same(&object.positions_world, self.objects.positions.get(vertices.clone()))
                && same(&object.normals_world, self.objects.normals.get(vertices.clone()))
            {
                continue;
            }
            self.objects.pose(index, &object.positions_world, &object.normals_world);
            self.moved = true;
            self.held.note_moved(vertices);
        }
    }

    /// Takes over what mirrors see of a frame, and finds the soft light at the vertices of objects.
    pub fn light_vertices(&mut self, job: &FrameJob<'_>) {
        let spheres = job.input.posed.map_or(&[][..], Posed::spheres);
        self.reflected.prepare(spheres, &self.objects);
        self.transferred.update(&VertexFrame {
            light: &job.light,
            objects: &self.objects,
            moved: self.moved,
            spheres: job.input.posed.map_or(&[][..], Posed::blocking),
            boxes: job.input.posed.map_or(&[][..], Posed::boxes),
            eye_world: job.camera.eye,
            surroundings: job.surroundings(&self.reflected),
            quality: job.quality,
        });
        self.moved = false;
        self.light_by_room();
    }

    /// Takes over the spheres, the boxes and the light of a frame.
    pub fn prepare_blockers(&mut self, job: &FrameJob<'_>) {
        self.transfer.update(&job.light);
        let spheres = job.input.posed.map_or(&[][..], Posed::blocking);
        let quality = job.quality;
        self.blockers.prepare(spheres, quality.rung, job.light.order, quality.directions);
        self.blockers.add_boxes(job.input.posed.map_or(&[][..], Posed::boxes));
        self.planes.prepare(&self.blockers, &self.transfer);
    }

    /// The near lights that the last frame of the room was drawn with; `None` where the scene stands in none.
    pub fn near_choice(&self) -> Option<NearChoice> {
        self.stands_in_room.then(|| self.room.near_choice())
    }

    /// Lays the grid of soft shadows at vertices for the spheres of a frame.
    pub fn lay_grid(&mut self, job: &FrameJob<'_>) {
        let spheres = job.input.posed.map_or(&[][..], Posed::spheres);
        self.grid.lay(&self.surfaces, spheres, job.camera.eye);
    }
}

/// The lens of a picture of every `step`-th pixel of every `step`-th row, rounded up at the far borders.
fn coarse_lens(lens: &Lens, step: u32) -> Lens {
    let k = f64::from(step.max(1));
    Lens {
        width: lens.width.div_ceil(step.max(1)),
        height: lens.height.div_ceil(step.max(1)),
        fx: lens.fx / k,
        fy: lens.fy / k,
        cx: lens.cx / k,
        cy: lens.cy / k,
        ..*lens
    }
}

/// See [`FrameJob::exposure_of_white`].
fn exposure_of_white(response: &Response, effective_s: f64) -> f32 {
    let white = response.log_exposure().iter().map(|g| f64::from(g[255])).fold(f64::MIN, f64::max).exp();
    (effective_s / white).clamp(1e-30, 1e30) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_becomes_one() {
        let srgb = Response::srgb();
        assert!((exposure_of_white(&srgb, 0.02) - 0.02).abs() < 1e-9);
    }
}
