//! The scene on the device, and what all passes that draw it read of a frame: camera, light, shadow maps' cameras.

use super::{
    buffers::GrowingBuffer,
    context::GpuContext,
    params,
    room_lights::RoomLights,
    room_mesh::RoomMesh,
    scene::SceneBuffers,
    view::{self, LensDomain},
};
use crate::{
    EngineError,
    frame::{FrameJob, FrameState},
};

/// Everything here is reused from frame to frame.
pub struct DeviceScene {
    /// Objects and real surfaces.
    pub meshes: SceneBuffers,
    /// A known room.
    pub room_mesh: RoomMesh,
    /// Uploaded for the passes of a known room.
    pub room_lights: RoomLights,
    /// Camera, light and shadow maps' cameras.
    pub terms: FrameTerms,
    domain: LensDomain,
}

/// What is the same for every pass of a frame.
pub struct FrameTerms {
    /// Camera and lens.
    pub camera: params::View,
    /// The shadow maps' cameras, as of the last [`DeviceScene::update_shadow_cameras`].
    pub cameras: params::ShadowCameras,
    /// `camera` on the device.
    pub view: GrowingBuffer,
    /// Uploaded for the passes that shade.
    pub light: GrowingBuffer,
    /// `cameras` on the device.
    pub shadow_cameras: GrowingBuffer,
}

impl DeviceScene {
    /// Nothing yet.
    pub fn new() -> Self {
        Self {
            meshes: SceneBuffers::new(),
            room_mesh: RoomMesh::new(),
            room_lights: RoomLights::new(),
            terms: FrameTerms {
                camera: bytemuck::Zeroable::zeroed(),
                cameras: bytemuck::Zeroable::zeroed(),
                view: GrowingBuffer::uniform("view"),
                light: GrowingBuffer::uniform("light"),
                shadow_cameras: GrowingBuffer::uniform("shadow cameras"),
            },
            domain: LensDomain::default(),
        }
    }

    /// The next frames upload the scene anew.
    pub fn invalidate(&mut self) {
        self.meshes.invalidate();
        self.room_mesh.invalidate();
    }

    /// Uploads what has changed of the scene, and the terms of a frame.
    pub fn update(&mut self, context: &GpuContext, job: &FrameJob<'_>, state: &FrameState) {
        context.live.serve_the_scene();
        let cut = self.domain.cut(job.input.lens, &job.camera);
        self.meshes.update(context, &state.objects, &state.transferred, &state.surfaces, cut);
        let near_m = self.meshes.extents().near_m(job.camera.eye);
        self.terms.camera = view::view(job.input.lens, &mut self.domain, &job.camera, near_m);
        let light = view::light(&job.light, job.exposure_of_white());
        self.terms.view.write(context, bytemuck::bytes_of(&self.terms.camera));
        self.terms.light.write(context, bytemuck::bytes_of(&light));
        self.update_shadow_cameras(context, job, state);
    }

    /// Uploads the shadow maps' cameras, once they are fitted.
    pub fn update_shadow_cameras(&mut self, context: &GpuContext, job: &FrameJob<'_>, state: &FrameState) {
        self.terms.cameras = view::shadows(state.shadows.cameras(), job.quality.pcf_taps);
        self.terms.shadow_cameras.write(context, bytemuck::bytes_of(&self.terms.cameras));
    }

    /// Camera and lens of the coarse picture of soft shadows.
    pub fn coarse_camera(&self, job: &FrameJob<'_>) -> params::View {
        let (coarse, camera) = (job.coarse_lens(), self.terms.camera);
        params::View {
            focal: [coarse.fx, coarse.fy, coarse.cx, coarse.cy].map(|x| x as f32),
            frame: [coarse.width as f32, coarse.height as f32, camera.frame[2], camera.frame[3]],
            ..camera
        }
    }

    /// Uploads the grid of soft shadows at vertices.
    pub fn update_grid(&mut self, context: &GpuContext, job: &FrameJob<'_>, state: &FrameState) {
        let cut = self.domain.cut(job.input.lens, &job.camera);
        self.meshes.upload_grid(context, &state.grid, cut);
    }

    /// Uploads the known room unless it is there already. Errors: there is none.
    pub fn update_room(
        &mut self,
        context: &GpuContext,
        job: &FrameJob<'_>,
        state: &FrameState,
    ) -> Result<(), EngineError> {
        let Some(known) = state.room.known() else {
            return Err(EngineError::Input(
                "relight: the plan is for a known room, and there is none".into(),
            ));
        };
        let cut = self.domain.cut(job.input.lens, &job.camera);
        let of_room = state.room.triangles();
        self.room_mesh.update(context, &state.surfaces, of_room, &known.field.gathered_rgb, cut);
        Ok(())
    }
}
