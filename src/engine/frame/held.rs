//! What of earlier frames is still good, for either engine: results are held together with all that they were made from,
//! and count as the same only where that is the same to the last bit.

use super::{FrameJob, FrameState};
use crate::animate::posed::Posed;
use crate::compose::{shade_object::LightTerms, transferred::VertexFrame};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    blocker::{BlockerBox, BlockerSphere},
    quality::Quality,
};
use crate::plan::{Foresight, FramePlan, Pass, PassSet, Product};
use crate::visibility::{point_maps::PointCamera, shadow_maps::ShadowCamera};
use std::ops::Range;

/// All that the passes of a frame between the shadow maps and the composing are made from.
#[derive(Clone, Debug, PartialEq)]
struct MadeFrom {
    lens: Lens,
    world_from_camera: Pose,
    light: LightTerms,
    environment: Option<u64>,
    quality: Quality,
    /// What objects are scaled by on a device.
    exposure: f32,
    /// Which scene, and how often anything in it has moved.
    geometry: u64,
}

/// Which frame made what. Keeps its memory.
#[derive(Debug, Default)]
pub(crate) struct HeldProducts {
    inputs: Option<Box<MadeFrom>>,
    spheres: Vec<BlockerSphere>,
    boxes: Vec<BlockerBox>,
    /// Grows with every change of the inputs: a number is never one of other inputs.
    frame: u64,
    geometry: u64,
    /// For each pass the inputs and the passes that its result was made from.
    made: [Option<(u64, PassSet)>; Pass::ALL.len()],
    /// The frame that the shadow maps' cameras are fitted for; the near maps'.
    fitted: Option<u64>,
    near_fitted: Option<u64>,
    /// What the shadow maps were drawn from.
    drawn: Option<u64>,
    drawn_cameras: Vec<Option<ShadowCamera>>,
    /// What the near maps were drawn from.
    near_drawn: Option<u64>,
    near_cameras: Vec<Option<PointCamera>>,
    /// Of the newest picture of the place.
    environment: Option<u64>,
    dispatched: Vec<Pass>,
    /// Vertices that moved since a device asked.
    moved: Vec<Range<usize>>,
}

impl HeldProducts {
    /// Forgets all that was made of the scene: another one comes.
    pub fn forget_scene(&mut self) {
        self.geometry += 1;
        self.moved.clear();
        self.made = Default::default();
        (self.drawn, self.near_drawn) = (None, None);
    }

    /// Notes vertices that have moved.
    pub fn note_moved(&mut self, vertices: Range<usize>) {
        self.geometry += 1;
        if !self.moved.contains(&vertices) {
            self.moved.push(vertices);
        }
    }

    /// Notes that a pass was dispatched and its result stays.
    pub fn mark_made(&mut self, pass: Pass, uses: PassSet) {
        self.made[pass as usize] = Some((self.frame, uses.meet(pass.reads())));
        self.dispatched.push(pass);
    }

    /// Forgets what a pass has made: it is no longer there.
    pub fn forget(&mut self, pass: Pass) {
        self.made[pass as usize] = None;
        match pass.facts().writes {
            Product::ShadowMaps => self.drawn = None,
            Product::PointMaps => self.near_drawn = None,
            _ => {}
        }
    }

    /// Forgets which near lights were found; returns whether there were any.
    pub fn forget_near_lights(&mut self) -> bool {
        self.near_fitted.take().is_some()
    }

    /// Notes that the shadow maps are drawn by these cameras.
    pub fn note_shadow_maps(&mut self, cameras: &[Option<ShadowCamera>]) {
        self.drawn = Some(self.geometry);
        self.drawn_cameras.clear();
        self.drawn_cameras.extend_from_slice(cameras);
    }

    /// Whether the shadow maps are as these cameras would draw them.
    pub fn has_shadow_maps(&self, cameras: &[Option<ShadowCamera>]) -> bool {
        self.drawn == Some(self.geometry) && self.drawn_cameras == cameras
    }

    /// Notes that the near maps are drawn by these cameras.
    pub fn note_point_maps(&mut self, cameras: &[Option<PointCamera>]) {
        self.near_drawn = Some(self.geometry);
        self.near_cameras.clear();
        self.near_cameras.extend_from_slice(cameras);
    }

    /// Whether the near maps are as these cameras would draw them.
    pub fn has_point_maps(&self, cameras: &[Option<PointCamera>]) -> bool {
        self.near_drawn == Some(self.geometry) && self.near_cameras == cameras
    }

    /// The passes of the last frame.
    pub fn dispatched(&self) -> &[Pass] {
        &self.dispatched
    }

    /// Takes away the ranges of vertices that moved.
    pub fn take_moved(&mut self, mut each: impl FnMut(Range<usize>)) {
        self.moved.drain(..).for_each(&mut each);
    }

    /// Whether the cameras of hard lights are fitted for the frame at hand.
    pub fn is_fitted(&self) -> bool {
        self.fitted == Some(self.frame)
    }

    /// Notes that they are.
    pub fn mark_fitted(&mut self) {
        self.fitted = Some(self.frame);
    }

    /// Whether the near lights are found for the frame at hand.
    pub fn near_is_fitted(&self) -> bool {
        self.near_fitted == Some(self.frame)
    }

    /// Notes that they are.
    pub fn mark_near_fitted(&mut self) {
        self.near_fitted = Some(self.frame);
    }

    /// The passes that a pass's result was made from, where it was made from the inputs at hand.
    fn made_now(&self, pass: Pass) -> Option<PassSet> {
        self.made[pass as usize].filter(|(frame, _)| *frame == self.frame).map(|(_, with)| with)
    }

    /// Takes over the inputs of a frame.
    fn take(&mut self, job: &FrameJob<'_>) {
        let input = job.input;
        let spheres = input.posed.map_or(&[][..], Posed::spheres);
        let boxes = input.posed.map_or(&[][..], Posed::boxes);
        let now = MadeFrom {
            lens: *input.lens,
            world_from_camera: *input.world_from_camera,
            light: job.light,
            environment: input.environment.map(|picture| picture.revision),
            quality: *job.quality,
            exposure: job.exposure_of_white(),
            geometry: self.geometry,
        };
        match &mut self.inputs {
            Some(before) if **before == now && self.spheres == spheres && self.boxes == boxes => return,
            Some(before) => **before = now,
            before => *before = Some(Box::new(now)),
        }
        self.spheres.clear();
        self.spheres.extend_from_slice(spheres);
        self.boxes.clear();
        self.boxes.extend_from_slice(boxes);
        self.frame += 1;
    }
}

impl FrameState {
    /// Takes over the inputs of a frame.
    fn look(&mut self, job: &FrameJob<'_>) {
        self.pose(job.input);
        self.held.take(job);
    }

    /// Which results would come out the same; fits the shadow maps' cameras on the way. `time` runs the parts that belong
    /// to a pass.
    pub fn foresee(
        &mut self,
        job: &FrameJob<'_>,
        out: &mut Foresight,
        time: &mut dyn FnMut(Pass, &mut (dyn FnMut() + Send)),
    ) {
        self.look(job);
        *out = Foresight::NONE;
        for pass in Pass::ALL.into_iter().filter(|pass| pass.facts().kept_because.is_some()) {
            out.held[pass as usize] = self.held.made_now(pass);
        }
        // Maps stay good while what they are fitted to stays, whatever else has changed.
        out.held[Pass::ShadowMaps as usize] = None;
        if !job.light.hard().is_empty() && !self.objects.triangles.is_empty() {
            time(Pass::ShadowMaps, &mut || self.fit_shadow_cameras(job));
            out.maps_seen = Some(self.shadows.cameras().iter().flatten().count());
            out.held[Pass::ShadowMaps as usize] = self.shadow_maps_are_drawn().then(PassSet::default);
        }
        if self.stands_in_room
            && out.held[Pass::PointMaps as usize].is_none()
            && self.held.near_drawn.is_some()
        {
            time(Pass::PointMaps, &mut || self.find_room_lights(job));
            out.held[Pass::PointMaps as usize] = self.point_maps_are_drawn().then(PassSet::default);
        }
        let revision = job.input.environment.map(|picture| picture.revision);
        out.mirror_picture_is_held = revision.is_some() && revision == self.held.environment;
        out.vertex_light_is_held = !self.stands_in_room && self.vertex_light_is_held(job);
    }

    fn vertex_light_is_held(&mut self, job: &FrameJob<'_>) -> bool {
        !self.transferred.would_change(&VertexFrame {
            light: &job.light,
            objects: &self.objects,
            moved: self.moved,
            spheres: job.input.posed.map_or(&[][..], Posed::blocking),
            boxes: job.input.posed.map_or(&[][..], Posed::boxes),
            eye_world: job.input.world_from_camera.translation.as_vec3(),
            surroundings: job.surroundings(&self.reflected),
            quality: job.quality,
        })
    }

    /// Begins a planned frame: takes over its inputs, and frees what it does not use.
    pub fn begin(&mut self, plan: &FramePlan, job: &FrameJob<'_>) {
        self.look(job);
        self.held.dispatched.clear();
        let uses = job.uses;
        if plan.keeps(Pass::ShadowMaps) {
            self.fit_shadow_cameras(job);
        } else if !(uses.has(Pass::ShadowMaps) && self.held.is_fitted()) {
            self.shadows.clear();
            self.held.fitted = None;
        }
        if plan.keeps(Pass::PointMaps) {
            self.find_room_lights(job);
        }
        self.free_all_but(uses);
        if uses.has(Pass::ShadeObject) {
            self.held.environment = job.input.environment.map(|picture| picture.revision);
        }
    }

    /// The passes of a frame that use the result of an earlier one: the plan keeps it, and it is there.
    pub fn kept(&self, plan: &FramePlan, uses: PassSet) -> PassSet {
        PassSet::where_true(|pass| {
            plan.keeps(pass)
                && match pass {
                    Pass::ShadowMaps => self.shadow_maps_are_drawn(),
                    Pass::PointMaps => self.point_maps_are_drawn(),
                    _ => self.held.made_now(pass) == Some(uses.meet(pass.reads())),
                }
        })
    }
}
