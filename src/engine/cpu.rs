//! The CPU twins in order: the readable description of one frame.

mod check;
mod finish;
mod fragments;
mod held;
mod room;
mod soft;

pub(super) use check::{check, check_frame, check_light, check_room};
pub(super) use fragments::coarse_lens;

use super::{Bracket, Engine, EngineError, LightJob, Live, MeasuredLight, RelightInput};
use crate::animate::posed::Posed;
use crate::compose::{
    carried::{Coarse, RUN, SeenPlane},
    geometry::{MIRROR_EXPONENT, ObjectGeometry, SurfaceGeometry},
    raster::{self, Fragment, Points, Projected, Rays, Row, Samples, View},
    reflected::Reflected,
    shade_object::{self, LightTerms, Surroundings},
    shade_surface::{self, SurfaceFrame},
    soft_grid::SoftGrid,
    soft_shadow::{self, CoarsePoint, Planes, Transfer},
    tonemap::ToneTable,
    transferred::{Transferred, VertexFrame},
};
use crate::light::{maps, project_sh::project_sh, unwrap_ball::BallUnwrapper};
use crate::math::widest::widest;
use crate::model::{
    image::{HdrImage, Image, RadianceImage},
    light::RadianceSamples,
    picture::Picture,
    quality::Quality,
    response::Response,
    scene::Scene,
};
use crate::nearfield::prepare::KnownRoom;
use crate::plan::{Foresight, FramePlan, Pass, PassTiming};
use crate::visibility::{
    blockers::Blockers,
    shadow_maps::{Receivers, ShadowMaps},
};
use fragments::{object_point, surface_normals};
use glam::Vec3;
use held::RATIOS;
use room::RoomWork;
use std::sync::Arc;

/// Timings kept until somebody takes them.
const TIMINGS_KEPT: usize = 256;

/// What some neighbours see of one triangle.
fn points_of(row: &Row<'_>, k: usize, count: usize) -> Option<Points<RUN>> {
    widest(
        #[inline(always)]
        || row.points::<RUN>(k, count),
    )
}

/// From so many neighbours of one triangle on they are shaded together.
const LEAST_RUN: usize = 4;

/// The engine that needs nothing but the processor. Its results do not depend on the number of threads.
pub struct CpuEngine {
    pool: rayon::ThreadPool,
    work: Work,
    unwrapper: BallUnwrapper,
    samples: RadianceSamples,
    timings: Vec<PassTiming>,
}

/// Scene and memory of the engine; everything here is reused from frame to frame.
#[derive(Default)]
pub(super) struct Work {
    pub(super) objects: ObjectGeometry,
    pub(super) surfaces: SurfaceGeometry,
    rays: Rays,
    seen_objects: Projected,
    seen_surfaces: Projected,
    /// The view of `seen_surfaces`.
    seen_from: Option<View>,
    samples: Samples,
    receivers: Receivers,
    pub(super) shadows: ShadowMaps,
    pub(super) reflected: Reflected,
    pub(super) transferred: Transferred,
    /// Whether objects have moved since `transferred` looked.
    moved: bool,
    pub(super) blockers: Blockers,
    pub(super) transfer: Transfer,
    pub(super) planes: Planes,
    coarse_rays: Rays,
    coarse_surfaces: Projected,
    coarse: Image<CoarsePoint>,
    pub(super) grid: SoftGrid,
    /// What is taken of the soft light (r, g, b) and the inverse depth (a).
    pub(super) soft: Image<[f32; 4]>,
    pub(super) object_layer: Image<[f32; 4]>,
    pub(super) ratio: RadianceImage,
    tone: Option<ToneTable>,
    pub(super) room: RoomWork,
    /// Whether the scene stands in the room.
    stands_in_room: bool,
    pub(super) held: held::Held,
}

impl CpuEngine {
    /// An engine with its own pool of so many threads; `None`: one for each core.
    pub fn new(threads: Option<usize>) -> Result<Self, EngineError> {
        if threads == Some(0) {
            return Err(EngineError::Input("threads = 0: must be 1 or more".into()));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .thread_name(|i| format!("engine-{i}"))
            .build()
            .map_err(|e| EngineError::Input(format!("the engine's threads could not be started: {e}")))?;
        Ok(Self {
            pool,
            work: Work::default(),
            unwrapper: BallUnwrapper::new(),
            samples: RadianceSamples::default(),
            timings: Vec::with_capacity(TIMINGS_KEPT),
        })
    }
}

impl Engine for CpuEngine {
    fn description(&self) -> String {
        format!("cpu, {} threads", self.pool.current_num_threads())
    }

    fn load_room(&mut self, room: Option<Arc<KnownRoom>>) -> Result<(), EngineError> {
        self.work.room.take(room);
        Ok(())
    }

    fn load_scene(&mut self, scene: &Scene) -> Result<(), EngineError> {
        check_room(scene, &self.work.room)?;
        self.work.load(scene);
        Ok(())
    }

    fn merge_bracket(
        &mut self,
        bracket: &Bracket<'_>,
        response: &Response,
        out: &mut HdrImage,
    ) -> Result<(), EngineError> {
        timed(&mut self.timings, Pass::MergeBracket, || {
            let merge = || {
                crate::hdr::merge_bracket::merge_bracket(bracket.pictures, bracket.exposures, response, out)
            };
            self.pool.install(merge).map_err(|e| EngineError::Input(e.to_string()))
        })
    }

    fn estimate_light(
        &mut self,
        job: &LightJob<'_>,
        quality: &Quality,
    ) -> Result<MeasuredLight, EngineError> {
        check_light(job, quality)?;
        let (samples, unwrapper, timings) = (&mut self.samples, &mut self.unwrapper, &mut self.timings);
        self.pool.install(|| {
            let flags = match job {
                LightJob::Ball(shot) => timed(timings, Pass::UnwrapBall, || unwrapper.unwrap(shot, samples))
                    .map_err(|e| EngineError::Input(e.to_string()))?,
                LightJob::Map(map) => maps::samples_of_map(map, samples),
            };
            let total = timed(timings, Pass::ProjectSh, || project_sh(samples, quality.sh_order));
            Ok(MeasuredLight { total, flags })
        })
    }

    fn measured_samples(&self) -> &RadianceSamples {
        &self.samples
    }

    fn relight(
        &mut self,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        check(plan, input)?;
        let (work, timings) = (&mut self.work, &mut self.timings);
        self.pool.install(|| work.relight(plan, input, timings, out));
        Ok(())
    }

    fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
    ) -> Result<(), EngineError> {
        check_frame(quality, input)?;
        let (work, timings) = (&mut self.work, &mut self.timings);
        self.pool.install(|| {
            work.foresee(input, quality, out, &mut |pass, part| timed(timings, pass, part));
        });
        Ok(())
    }

    fn live(&self, out: &mut Vec<Live>) {
        self.work.live(out);
    }

    fn dispatched(&self) -> &[Pass] {
        self.work.held.dispatched()
    }

    fn take_timings(&mut self, out: &mut Vec<PassTiming>) {
        out.clear();
        out.append(&mut self.timings);
    }
}

/// Runs one pass and notes how long it took.
#[allow(clippy::disallowed_methods, reason = "an engine times its passes; nothing else depends on it")]
fn timed<T>(timings: &mut Vec<PassTiming>, pass: Pass, work: impl FnOnce() -> T) -> T {
    let start = std::time::Instant::now();
    let result = work();
    let ms = start.elapsed().as_secs_f32() * 1e3;
    match timings.last_mut() {
        // Parts of one pass.
        Some(last) if last.pass == pass => last.ms += ms,
        _ => {
            if timings.len() >= TIMINGS_KEPT {
                timings.remove(0);
            }
            timings.push(PassTiming { pass, ms });
        }
    }
    result
}

impl Work {
    pub(super) fn load(&mut self, scene: &Scene) {
        self.held.another_scene();
        self.objects.load(scene);
        self.surfaces.load(&scene.surfaces);
        self.stands_in_room = scene.room.is_some();
        if self.stands_in_room {
            self.room.place(&self.objects, &mut self.surfaces);
        }
        self.seen_from = None;
        self.planes.find(&self.surfaces);
        self.surfaces.receivers(&mut self.receivers);
        self.reflected.load(&self.surfaces);
        self.transferred.load(scene);
    }

    /// Exactly the plan's passes, in the order of a frame. What a later pass would read of one that the plan leaves out
    /// counts as absent: no object layer, no ratio, no shadow. Merging and reading the light have their own calls.
    fn relight(
        &mut self,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        timings: &mut Vec<PassTiming>,
        out: &mut Picture,
    ) {
        let light = LightTerms::of(input.light);
        let view = View::of(input.world_from_camera);
        let quality = &plan.quality;
        let uses = self.begin(plan, input, &light);
        out.t = input.t;
        for pass in uses.iter().filter(|pass| !pass.is_measuring()) {
            if self.is_kept(plan, pass, uses) {
                continue;
            }
            timed(timings, pass, || match pass {
                Pass::MergeBracket | Pass::UnwrapBall | Pass::ProjectSh => {}
                Pass::ShadowMaps => self.shadow_maps(input, &light, quality),
                Pass::SoftShadow => self.soft_shadow(input, &view, &light, quality),
                Pass::PointMaps => self.point_maps(input, quality),
                Pass::Subtract => self.subtract(input, &view, &light, quality),
                Pass::SubtractDisplayed => self.subtract_displayed(input, &view, &light, quality),
                Pass::ShadeObject => self.shade_object(input, &view, &light, quality),
                Pass::ShadeSurface => {
                    self.shade_surface(input, &view, &light, uses.has(Pass::SoftShadow), quality);
                }
                Pass::Composite => {
                    let ratio_drawn = RATIOS.into_iter().any(|pass| uses.has(pass));
                    self.composite(input, uses.has(Pass::ShadeObject), ratio_drawn, &mut out.radiance);
                }
                Pass::Tonemap => self.tonemap(input, out),
            });
            self.held.made(pass, uses);
        }
    }

    pub(super) fn shadow_maps(&mut self, input: &RelightInput<'_>, light: &LightTerms, quality: &Quality) {
        self.shadow_cameras(input, light, quality);
        self.shadows.draw(&self.objects.positions, &self.objects.triangles);
        self.held.maps_drawn(&self.shadows);
    }

    /// Takes over what mirrors see of a frame, and finds the soft light at the vertices of objects.
    pub(super) fn prepare_vertices(
        &mut self,
        input: &RelightInput<'_>,
        view: &View,
        light: &LightTerms,
        quality: &Quality,
    ) {
        let spheres = input.posed.map_or(&[][..], Posed::spheres);
        self.reflected.prepare(spheres, &self.objects);
        self.transferred.update(&VertexFrame {
            light,
            objects: &self.objects,
            moved: self.moved,
            spheres,
            eye_world: view.eye,
            surroundings: Surroundings::new(
                input.environment,
                &self.reflected,
                quality.phong_norm,
                light.order,
            ),
            quality,
        });
        self.moved = false;
        self.light_by_room();
    }

    pub(super) fn shade_object(
        &mut self,
        input: &RelightInput<'_>,
        view: &View,
        light: &LightTerms,
        quality: &Quality,
    ) {
        self.project_surfaces(input, view, quality);
        self.prepare_vertices(input, view, light, quality);
        let transferred = &self.transferred;
        let (objects, shadows) = (&self.objects, &self.shadows);
        let surroundings =
            Surroundings::new(input.environment, &self.reflected, quality.phong_norm, light.order);
        self.seen_objects.prepare(&self.rays, view, &objects.positions, &objects.triangles);
        let shade = |fragment: &Fragment| {
            let (point, facet) = object_point(objects, transferred, fragment);
            let material = objects.material_of_triangle[fragment.triangle];
            let terms = &objects.materials[material as usize];
            let is_mirror = terms.exponent == MIRROR_EXPONENT;
            shade_object::shade(light, &surroundings, terms, &point, |k, at, cosine| {
                // The bias follows the facet, which may lean further from the light than the interpolated normal.
                let to_light = Vec3::from(light.hard()[k].to_light_world);
                let cosine = if is_mirror { cosine } else { cosine.min(facet.dot(to_light)) };
                shadows.visibility(k, quality.pcf_taps, at, cosine)
            })
        };
        raster::draw_objects(
            &self.rays,
            view,
            &self.seen_objects,
            &self.seen_surfaces,
            shade,
            &mut self.samples,
            &mut self.object_layer,
        );
    }

    pub(super) fn shade_surface(
        &mut self,
        input: &RelightInput<'_>,
        view: &View,
        light: &LightTerms,
        soft_drawn: bool,
        quality: &Quality,
    ) {
        self.project_surfaces(input, view, quality);
        self.planes.prepare_light(light, &self.shadows, quality.pcf_taps);
        let width = self.rays.width();
        let planes = &self.planes;
        let coarse = Coarse {
            pixels: self.soft.pixels(),
            width: self.soft.width(),
            height: self.soft.height(),
            rays: &self.coarse_rays,
            step: quality.soft_step_px as usize,
        };
        let (blockers, transfer) = (&self.blockers, &self.transfer);
        let camera_from_world = view.world_from_camera.transpose();
        let seen_plane = |facet: Vec3, point_world: Vec3| SeenPlane {
            normal_camera: camera_from_world * facet,
            to_plane: facet.dot(point_world - view.eye),
        };
        let soft_taken = |fragment: &Fragment, normal: Vec3, facet: Vec3| {
            let plane = seen_plane(facet, fragment.point_world);
            let carried = coarse.at(&plane, fragment.pixel % width, fragment.pixel / width);
            carried.unwrap_or_else(|| {
                let plane = planes.of(fragment.triangle, normal);
                soft_shadow::taken(blockers, transfer, plane, fragment.point_world, normal)
            })
        };
        let frame = SurfaceFrame { light, shadows: &self.shadows, pcf_taps: quality.pcf_taps };
        let surfaces = &self.surfaces;
        let shade = |fragment: &Fragment| {
            let (normal, facet) = surface_normals(surfaces, fragment);
            let is_front = surfaces.facet_normals[fragment.triangle].dot(fragment.to_eye) >= 0.0;
            let flat = planes.flat(fragment.triangle, is_front);
            let (normal, facet) = flat.map_or((normal, facet), |flat| (flat.normal, flat.normal));
            let taken = if soft_drawn { soft_taken(fragment, normal, facet) } else { [0.0; 3] };
            let whole_rgb = flat.map(|flat| flat.whole_rgb);
            shade_surface::at(&frame, fragment.point_world, normal, facet, taken, whole_rgb)
        };
        // Neighbours on a flat triangle together; false where they need a look one by one.
        let shade_flat = |row: &Row<'_>, k: usize, out: &mut [[f32; 3]]| {
            let Some(flat) = row.triangle(k).and_then(|t| planes.flat(t, true)) else { return false };
            let Some(points) = points_of(row, k, out.len()) else { return false };
            let facet = surfaces.facet_normals[row.triangle(k).unwrap_or(0)];
            if !points.see_front(facet) {
                return false;
            }
            let mut taken = [[0.0; RUN]; 3];
            if soft_drawn {
                let plane = seen_plane(flat.normal, points.first());
                let (x, y) = (row.pixel(k) % width, row.pixel(k) / width);
                if !coarse.run(&plane, x, y, out.len(), &mut taken) {
                    return false;
                }
            }
            shade_surface::at_run(&frame, flat, planes.lights(flat), &points.point_world, &taken, out);
            true
        };
        let shade_row = |row: &Row<'_>, out: &mut [[f32; 3]]| {
            let mut k = 0;
            while k < out.len() {
                let end = (k + row.run(k, RUN).max(1)).min(out.len());
                let receives = row.triangle(k).is_some_and(|t| surfaces.receives[t]);
                if receives && !(end - k >= LEAST_RUN && shade_flat(row, k, &mut out[k..end])) {
                    for (i, pixel) in out.iter_mut().enumerate().take(end).skip(k) {
                        *pixel = row.fragment(i).map_or(*pixel, |fragment| shade(&fragment));
                    }
                }
                k = end;
            }
        };
        raster::draw_rows(
            &self.rays,
            view,
            &self.seen_surfaces,
            [1.0; 3],
            shade_row,
            &mut self.samples,
            &mut self.ratio,
        );
    }

    /// Real surfaces through the lens. Each pass that needs them asks, as passes do not lean on each other; done once a view.
    fn project_surfaces(&mut self, input: &RelightInput<'_>, view: &View, quality: &Quality) {
        let changed = self.rays.update(input.lens, quality.coverage_samples);
        if changed || self.seen_from != Some(*view) {
            let surfaces = &self.surfaces;
            self.seen_surfaces.prepare(&self.rays, view, &surfaces.positions, &surfaces.triangles);
            self.seen_from = Some(*view);
        }
    }
}
