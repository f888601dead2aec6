//! The twins of the passes of a frame, with their own memory.

use crate::compose::{
    carried::RUN,
    raster::{Points, Projected, Rays, Row, Samples, View},
    soft_shadow::CoarsePoint,
    tonemap::ToneTable,
};
use crate::frame::{FrameJob, FrameState, TwinPasses};
use crate::math::widest::widest;
use crate::model::{image::Image, picture::Picture};
use crate::nearfield::{
    subtract,
    subtract_displayed::{self, DisplayCurve, DisplayedFrame, DisplayedLights},
};
use crate::plan::{Pass, PassSet, Product};

/// What only the twins need; everything here is reused from frame to frame.
#[derive(Default)]
pub(crate) struct Twins {
    pub(super) rays: Rays,
    pub(super) seen_objects: Projected,
    pub(super) seen_surfaces: Projected,
    /// The view of `seen_surfaces`, and of which scene they are.
    seen_from: Option<(View, u64)>,
    pub(super) samples: Samples,
    pub(super) coarse_rays: Rays,
    pub(super) coarse_surfaces: Projected,
    pub(super) coarse: Image<CoarsePoint>,
    pub(super) tone: Option<ToneTable>,
    displayed_lights: DisplayedLights,
    display_curve: Option<DisplayCurve>,
}

impl TwinPasses for Twins {
    fn begin(&mut self, uses: PassSet) {
        if !uses.make(Product::SoftShadows) {
            self.coarse = Image::default();
        }
    }

    fn run(&mut self, pass: Pass, job: &FrameJob<'_>, state: &mut FrameState, out: &mut Picture) {
        match pass {
            Pass::MergeBracket | Pass::UnwrapBall | Pass::ProjectSh => {}
            Pass::ShadowMaps => state.draw_shadow_maps(job),
            Pass::SoftShadow => self.soft_shadow(job, state),
            Pass::PointMaps => state.draw_point_maps(job),
            Pass::Subtract => self.draw_room(job, state, |with, run, of, out| {
                subtract::at_points(with, run, |i| of.weights(i), out);
            }),
            Pass::SubtractDisplayed => self.subtract_displayed(job, state),
            Pass::ShadeObject => self.shade_object(job, state),
            Pass::ShadeSurface => self.shade_surface(job, state),
            Pass::Composite => Self::composite(job, state, &mut out.radiance),
            Pass::Tonemap => self.tonemap(job, out),
        }
    }
}

impl Twins {
    /// What objects leave of a known room's light, from the values that a display shows of the place.
    fn subtract_displayed(&mut self, job: &FrameJob<'_>, state: &mut FrameState) {
        let input = job.input;
        let mut lights = std::mem::take(&mut self.displayed_lights);
        lights.update(&state.room.frame);
        let mut curve = self.display_curve.take().unwrap_or_else(|| DisplayCurve::of(input.response));
        curve.update(input.response);
        let (background, exposure_s) =
            (input.background.radiance.pixels(), input.shown_exposure.effective_s() as f32);
        let exposure = |pixel: usize| background[pixel].map(|c| c * exposure_s);
        self.draw_room(job, state, |with, run, of, out| {
            let shared = DisplayedFrame { with: *with, lights: &lights, curve: &curve };
            subtract_displayed::at_points(&shared, run, |i| of.weights(i), |i| exposure(of.pixel(i)), out);
        });
        (self.displayed_lights, self.display_curve) = (lights, Some(curve));
    }

    /// Real surfaces through the lens. Each pass that needs them asks, as passes do not lean on each other; done once a view.
    pub(super) fn project_surfaces(&mut self, job: &FrameJob<'_>, state: &FrameState) {
        let changed = self.rays.update(job.input.lens, job.quality.coverage_samples);
        let seen_from = Some((job.camera, state.scenes_loaded));
        if changed || self.seen_from != seen_from {
            let surfaces = &state.surfaces;
            self.seen_surfaces.prepare(&self.rays, &job.camera, &surfaces.positions, &surfaces.triangles);
            self.seen_from = seen_from;
        }
    }
}

/// What some neighbours see of one triangle.
pub(super) fn points_of(row: &Row<'_>, k: usize, count: usize) -> Option<Points<RUN>> {
    widest(
        #[inline(always)]
        || row.points::<RUN>(k, count),
    )
}
