//! What of earlier frames is still good, for either engine: results are held together with all that they were made from,
//! and count as the same only where that is the same to the last bit.

use super::Work;
use crate::animate::posed::Posed;
use crate::compose::{
    shade_object::{LightTerms, Surroundings},
    transferred::VertexFrame,
};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{blocker::BlockerSphere, image::Image, quality::Quality};
use crate::nearfield::frame::NearFrame;
use crate::plan::{Foresight, FramePlan, Pass, PassSet};
use crate::visibility::{
    point_maps::PointCamera,
    shadow_maps::{ShadowCamera, ShadowMaps},
};
use crate::{Live, RelightInput, gpu::view::exposure_of_white};
use glam::Vec3;
use std::ops::Range;

/// Passes that make ratios.
pub(super) const RATIOS: [Pass; 3] = [Pass::Subtract, Pass::SubtractDisplayed, Pass::ShadeSurface];

/// All that the passes of a frame between the shadow maps and the composing are made from.
#[derive(Clone, Debug, PartialEq)]
struct Inputs {
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
pub(crate) struct Held {
    inputs: Option<Box<Inputs>>,
    spheres: Vec<BlockerSphere>,
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

impl Held {
    /// Nothing is held of another scene.
    pub fn another_scene(&mut self) {
        self.geometry += 1;
        self.moved.clear();
        self.made = Default::default();
        (self.drawn, self.near_drawn) = (None, None);
    }

    /// A pass was dispatched and its result stays.
    pub fn made(&mut self, pass: Pass, uses: PassSet) {
        self.made[pass as usize] = Some((self.frame, uses.meet(pass.reads())));
        self.dispatched.push(pass);
    }

    /// What a pass has made is no longer there.
    pub fn forget(&mut self, pass: Pass) {
        self.made[pass as usize] = None;
        match pass {
            Pass::ShadowMaps => self.drawn = None,
            Pass::PointMaps => self.near_drawn = None,
            _ => {}
        }
    }

    /// The shadow maps are as their cameras are.
    pub fn maps_drawn(&mut self, maps: &ShadowMaps) {
        self.drawn = Some(self.geometry);
        self.drawn_cameras.clear();
        self.drawn_cameras.extend_from_slice(maps.cameras());
    }

    /// The near maps are as their cameras are.
    pub fn near_maps_drawn(&mut self, cameras: &[Option<PointCamera>]) {
        self.near_drawn = Some(self.geometry);
        self.near_cameras.clear();
        self.near_cameras.extend_from_slice(cameras);
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

    /// They are.
    pub fn fitted(&mut self) {
        self.fitted = Some(self.frame);
    }

    /// Whether the near lights are found for the frame at hand.
    pub fn near_is_fitted(&self) -> bool {
        self.near_fitted == Some(self.frame)
    }

    /// They are.
    pub fn near_fitted(&mut self) {
        self.near_fitted = Some(self.frame);
    }

    /// Takes over the inputs of a frame.
    fn take(&mut self, input: &RelightInput<'_>, light: &LightTerms, quality: &Quality) {
        let spheres = input.posed.map_or(&[][..], Posed::spheres);
        let now = Inputs {
            lens: *input.lens,
            world_from_camera: *input.world_from_camera,
            light: *light,
            environment: input.environment.map(|picture| picture.revision),
            quality: *quality,
            exposure: exposure_of_white(input.response, input.shown_exposure.effective_s()),
            geometry: self.geometry,
        };
        match &mut self.inputs {
            Some(before) if **before == now && self.spheres == spheres => return,
            Some(before) => **before = now,
            before => *before = Some(Box::new(now)),
        }
        self.spheres.clear();
        self.spheres.extend_from_slice(spheres);
        self.frame += 1;
    }
}

impl Work {
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
            self.held.geometry += 1;
            if !self.held.moved.contains(&vertices) {
                self.held.moved.push(vertices);
            }
        }
    }

    /// Takes over the inputs of a frame.
    pub(crate) fn look(&mut self, input: &RelightInput<'_>, light: &LightTerms, quality: &Quality) {
        self.pose(input);
        self.held.take(input, light, quality);
    }

    /// Which results would come out the same; fits the shadow maps' cameras on the way. `time` runs the parts that belong
    /// to a pass.
    pub(crate) fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
        time: &mut dyn FnMut(Pass, &mut (dyn FnMut() + Send)),
    ) {
        let light = LightTerms::of(input.light);
        self.look(input, &light, quality);
        *out = Foresight::NONE;
        for pass in Pass::ALL.into_iter().filter(|pass| {
            !pass.is_measuring()
                && !matches!(
                    pass,
                    // It depends on the camera's picture, too.
                    Pass::SubtractDisplayed | Pass::ShadowMaps | Pass::Composite | Pass::Tonemap
                )
        }) {
            let made = self.held.made[pass as usize];
            out.held[pass as usize] =
                made.filter(|(frame, _)| *frame == self.held.frame).map(|(_, with)| with);
        }
        if !light.hard().is_empty() && !self.objects.triangles.is_empty() {
            time(Pass::ShadowMaps, &mut || self.shadow_cameras(input, &light, quality));
            out.maps_seen = Some(self.shadows.cameras().iter().flatten().count());
            out.held[Pass::ShadowMaps as usize] = self.maps_are_drawn().then(PassSet::default);
        }
        if self.stands_in_room
            && out.held[Pass::PointMaps as usize].is_none()
            && self.held.near_drawn.is_some()
        {
            time(Pass::PointMaps, &mut || self.find_room_lights(input, quality));
            out.held[Pass::PointMaps as usize] = self.near_maps_are_drawn().then(PassSet::default);
        }
        let revision = input.environment.map(|picture| picture.revision);
        out.mirror_picture_is_held = revision.is_some() && revision == self.held.environment;
        out.vertex_light_is_held = !self.stands_in_room && self.vertex_light_is_held(input, &light, quality);
    }

    /// Fits the shadow maps' cameras to what is seen of the shadows; what the maps hold is as it was. In a known room the hard
    /// lights are its suns in their order, and those have maps that are among the frame's n lights.
    pub(crate) fn shadow_cameras(&mut self, input: &RelightInput<'_>, light: &LightTerms, quality: &Quality) {
        if self.held.is_fitted() {
            return;
        }
        self.held.fitted();
        let objects = &self.objects;
        self.receivers.see(input.lens, input.world_from_camera, objects.bodies());
        self.shadows.fit(
            light.hard(),
            &objects.positions,
            &objects.triangles,
            &self.receivers,
            quality.shadow_map_texels,
            quality.pcf_taps,
        );
        if self.stands_in_room {
            self.find_room_lights(input, quality);
            let (frame, suns) = (&self.room.frame, self.room.suns.len());
            self.shadows.keep(|k| k >= suns || frame.has_sun_map(k));
        }
    }

    fn maps_are_drawn(&self) -> bool {
        self.held.drawn == Some(self.held.geometry) && self.held.drawn_cameras == self.shadows.cameras()
    }

    fn near_maps_are_drawn(&self) -> bool {
        self.held.near_drawn == Some(self.held.geometry)
            && self.held.near_cameras == self.room.frame.maps().cameras()
    }

    fn vertex_light_is_held(
        &mut self,
        input: &RelightInput<'_>,
        light: &LightTerms,
        quality: &Quality,
    ) -> bool {
        let surroundings =
            Surroundings::new(input.environment, &self.reflected, quality.phong_norm, light.order);
        !self.transferred.would_change(&VertexFrame {
            light,
            objects: &self.objects,
            moved: self.moved,
            spheres: input.posed.map_or(&[][..], Posed::spheres),
            eye_world: input.world_from_camera.translation.as_vec3(),
            surroundings,
            quality,
        })
    }

    /// A planned frame begins: takes over its inputs, and gives the passes whose results it uses.
    pub(crate) fn begin(
        &mut self,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        light: &LightTerms,
    ) -> PassSet {
        self.look(input, light, &plan.quality);
        self.held.dispatched.clear();
        let uses = plan.uses();
        if plan.keeps(Pass::ShadowMaps) {
            self.shadow_cameras(input, light, &plan.quality);
        } else if !(uses.has(Pass::ShadowMaps) && self.held.is_fitted()) {
            self.shadows.clear();
            self.held.fitted = None;
        }
        if plan.keeps(Pass::PointMaps) {
            self.find_room_lights(input, &plan.quality);
        }
        self.free_all_but(uses);
        if uses.has(Pass::ShadeObject) {
            self.held.environment = input.environment.map(|picture| picture.revision);
        }
        uses
    }

    /// Frees the results of passes that a frame does not use.
    fn free_all_but(&mut self, uses: PassSet) {
        for pass in Pass::ALL.into_iter().filter(|pass| !pass.is_measuring() && !uses.has(*pass)) {
            self.held.forget(pass);
        }
        if !uses.has(Pass::ShadowMaps) {
            self.shadows.free();
        }
        if !uses.has(Pass::SoftShadow) {
            (self.coarse, self.soft) = Default::default();
        }
        if !uses.has(Pass::PointMaps) && self.held.near_fitted.take().is_some() {
            self.room.frame = NearFrame::default();
        }
        if !uses.has(Pass::ShadeObject) {
            self.object_layer = Image::default();
        }
        if !RATIOS.into_iter().any(|pass| uses.has(pass)) {
            self.ratio = Image::default();
        }
    }

    /// Lists what passes have made.
    pub(crate) fn live(&self, out: &mut Vec<Live>) {
        fn of<P: Clone>(image: &Image<P>) -> usize {
            size_of_val(image.pixels())
        }
        let maps = |k: usize| size_of_val(self.shadows.depth(k));
        let near = self.room.frame.maps();
        let near_map = |k: usize| {
            near.get(k).map_or(0, |(_, maps)| maps.iter().map(|map| size_of_val(map.depth())).sum())
        };
        out.clear();
        for (name, bytes) in [
            ("near maps", (0..near.cameras().len()).map(near_map).sum()),
            ("object layer", of(&self.object_layer)),
            ("ratios", of(&self.ratio)),
            ("shadow maps", (0..self.shadows.cameras().len()).map(maps).sum()),
            ("soft shadows", of(&self.soft)),
        ] {
            if bytes > 0 {
                out.push(Live { name, bytes: bytes as u64 });
            }
        }
    }

    /// Whether the plan keeps a pass's result, and it is there.
    pub(crate) fn is_kept(&self, plan: &FramePlan, pass: Pass, uses: PassSet) -> bool {
        plan.keeps(pass)
            && match pass {
                Pass::ShadowMaps => self.maps_are_drawn(),
                Pass::PointMaps => self.near_maps_are_drawn(),
                _ => self.held.made[pass as usize] == Some((self.held.frame, uses.meet(pass.reads()))),
            }
    }
}
