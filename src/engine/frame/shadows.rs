//! Cameras of shadow maps: fitted to what is seen, once a frame, and whether the maps are drawn as the cameras are.

use super::{FrameJob, FrameState};

impl FrameState {
    /// Fits the shadow maps' cameras to what is seen of the shadows; what the maps hold is as it was. In a known room the hard
    /// lights are its suns in their order, and those have maps that are among the frame's n lights.
    pub fn fit_shadow_cameras(&mut self, job: &FrameJob<'_>) {
        if self.held.is_fitted() {
            return;
        }
        self.held.mark_fitted();
        let (objects, quality) = (&self.objects, job.quality);
        self.receivers.see(job.input.lens, job.input.world_from_camera, objects.bodies());
        self.shadows.fit(
            job.light.hard(),
            &objects.positions,
            &objects.triangles,
            &self.receivers,
            quality.shadow_map_texels,
            quality.pcf_taps,
        );
        if self.stands_in_room {
            self.find_room_lights(job);
            let (frame, suns) = (&self.room.frame, self.room.suns.len());
            self.shadows.keep(|k| k >= suns || frame.has_sun_map(k));
        }
    }

    /// Draws the shadow maps here.
    pub fn draw_shadow_maps(&mut self, job: &FrameJob<'_>) {
        self.fit_shadow_cameras(job);
        self.shadows.draw(&self.objects.positions, &self.objects.triangles);
        self.note_shadow_maps();
    }

    /// Notes that the shadow maps, wherever they are, are as their cameras are.
    pub fn note_shadow_maps(&mut self) {
        self.held.note_shadow_maps(self.shadows.cameras());
    }

    /// Whether what the shadow maps hold is what would be drawn.
    pub(super) fn shadow_maps_are_drawn(&self) -> bool {
        self.held.has_shadow_maps(self.shadows.cameras())
    }

    /// Finds the lights of a known room for a frame.
    pub fn find_room_lights(&mut self, job: &FrameJob<'_>) {
        if !self.held.near_is_fitted() {
            self.held.mark_near_fitted();
            self.room.find_lights(&self.objects, job.input, job.quality);
        }
    }

    /// Draws the maps of a known room's lights here.
    pub fn draw_point_maps(&mut self, job: &FrameJob<'_>) {
        self.find_room_lights(job);
        self.room.draw_maps();
        self.note_point_maps();
    }

    /// Notes that the near maps, wherever they are, are as their cameras are.
    pub fn note_point_maps(&mut self) {
        self.held.note_point_maps(self.room.frame.maps().cameras());
    }

    /// Whether what the near maps hold is what would be drawn.
    pub(super) fn point_maps_are_drawn(&self) -> bool {
        self.held.has_point_maps(self.room.frame.maps().cameras())
    }
}
