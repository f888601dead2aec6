//! One frame on the device: exactly the plan's passes, each on the device or on its twin.

use super::{
    buffers::{Readback, whole_words},
    context::GpuContext,
    exchange::{Exchange, Place},
    params,
    passes::{
        composite::{Composite, Layers},
        point_maps::PointMaps,
        shade_object::{Frame, ShadeObject},
        shade_surface::ShadeSurface,
        shadow_maps::ShadowMaps,
        soft_shadow::{Soft, SoftShadow},
        subtract::{Shown, Subtract, Subtraction},
        tonemap::Tonemap,
    },
    point_pages::Spread,
    recorder::{Recorder, Timer},
    room_mesh::RoomMesh,
    scene::SceneBuffers,
    view::{self, LensDomain},
};
use crate::{
    EngineError, RelightInput,
    compose::{
        raster,
        shade_object::{LightTerms, Surroundings},
    },
    cpu,
    model::{
        picture::Picture,
        quality::{Quality, SoftAt},
        scene::Scene,
    },
    nearfield::prepare::KnownRoom,
    plan::{Foresight, FramePlan, Pass, PassSet},
};
use std::sync::Arc;

/// Passes that draw the scene's triangles.
const DRAWING: [Pass; 6] = [
    Pass::ShadowMaps,
    Pass::SoftShadow,
    Pass::Subtract,
    Pass::SubtractDisplayed,
    Pass::ShadeObject,
    Pass::ShadeSurface,
];

/// The kernel in a slot, compiled on first use.
pub fn ready<'a, K>(
    slot: &'a mut Option<K>,
    context: &GpuContext,
    new: impl FnOnce(&GpuContext) -> Result<K, EngineError>,
) -> Result<&'a mut K, EngineError> {
    if slot.is_none() {
        *slot = Some(new(context)?);
    }
    slot.as_mut().ok_or_else(|| EngineError::Input("unreachable: the slot was just filled".into()))
}

/// Scene, kernels and memory of drawing; everything is reused from frame to frame.
pub struct Relighter {
    twins: cpu::Work,
    scene: SceneBuffers,
    room_mesh: RoomMesh,
    /// How near lights' maps are spread over passes.
    pub spread: Spread,
    domain: LensDomain,
    exchange: Exchange,
    shadow_maps: Option<ShadowMaps>,
    soft_shadow: Option<SoftShadow>,
    point_maps: Option<PointMaps>,
    subtract: Option<Subtract>,
    shade_object: Option<ShadeObject>,
    shade_surface: Option<ShadeSurface>,
    composite: Option<Composite>,
    tonemap: Option<Tonemap>,
    display: Readback,
    /// The near lights' maps are in the twins' memory, too.
    near_on_host: bool,
}

impl Relighter {
    /// An empty scene; nothing is compiled.
    pub fn new() -> Self {
        Self {
            twins: cpu::Work::default(),
            scene: SceneBuffers::new(),
            room_mesh: RoomMesh::new(),
            spread: Spread::default(),
            domain: LensDomain::default(),
            exchange: Exchange::new(),
            shadow_maps: None,
            soft_shadow: None,
            point_maps: None,
            subtract: None,
            shade_object: None,
            shade_surface: None,
            composite: None,
            tonemap: None,
            display: Readback::new("display"),
            near_on_host: false,
        }
    }

    /// Takes the scene; it goes to the device with the next frame.
    pub fn load(&mut self, scene: &Scene) -> Result<(), EngineError> {
        cpu::check_room(scene, &self.twins.room)?;
        self.twins.load(scene);
        self.scene.invalidate();
        self.room_mesh.invalidate();
        Ok(())
    }

    /// Takes a known room, or none, for the scenes to come.
    pub fn take_room(&mut self, room: Option<Arc<KnownRoom>>) {
        self.twins.room.take(room);
        if let Some(subtract) = &mut self.subtract {
            subtract.invalidate();
        }
    }

    /// Which results would come out the same.
    pub fn foresee(
        &mut self,
        input: &RelightInput<'_>,
        quality: &Quality,
        out: &mut Foresight,
        time: &mut dyn FnMut(Pass, &mut (dyn FnMut() + Send)),
    ) {
        self.twins.foresee(input, quality, out, time);
    }

    /// The passes of the last frame.
    pub fn dispatched(&self) -> &[Pass] {
        self.twins.held.dispatched()
    }

    /// Draws one frame; `on_cpu` says which passes run on their twins. A frame that fails leaves nothing to be kept.
    pub fn run(
        &mut self,
        context: &GpuContext,
        timer: &mut Timer,
        on_cpu: impl Fn(Pass) -> bool,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        let drawn = self.draw(context, timer, on_cpu, plan, input, out);
        if drawn.is_err() {
            Pass::ALL.into_iter().for_each(|pass| self.twins.held.forget(pass));
        }
        drawn
    }

    fn draw(
        &mut self,
        context: &GpuContext,
        timer: &mut Timer,
        on_cpu: impl Fn(Pass) -> bool,
        plan: &FramePlan,
        input: &RelightInput<'_>,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        cpu::check(plan, input)?;
        let quality = &plan.quality;
        let light = LightTerms::of(input.light);
        let camera = raster::View::of(input.world_from_camera);
        let background = &input.background.radiance;
        let size = (background.width(), background.height());
        let exposure_s = input.shown_exposure.effective_s();
        let exposure = view::exposure_of_white(input.response, exposure_s);
        let light_params = view::light(&light, exposure);
        let uses = self.twins.begin(plan, input, &light);
        self.twins.held.take_moved(|vertices| self.scene.moved(vertices));
        let (mut runs, mut kept) = (PassSet::default(), PassSet::default());
        for pass in uses.iter().filter(|pass| !pass.is_measuring()) {
            let set = if self.twins.is_kept(plan, pass, uses) { &mut kept } else { &mut runs };
            set.insert(pass);
        }
        context.live.free_all_but(uses);
        let shades_objects = runs.has(Pass::ShadeObject) && !on_cpu(Pass::ShadeObject);
        // Objects in a known room are lit at their vertices, here, through the maps; so those are drawn here too.
        let draws_near = runs.has(Pass::PointMaps) || (kept.has(Pass::PointMaps) && !self.near_on_host);
        if draws_near && shades_objects {
            timer.host(Pass::PointMaps, || self.twins.point_maps(input, quality));
            self.near_on_host = true;
        } else if runs.has(Pass::PointMaps) {
            self.near_on_host = false;
        }
        let maps_drawn = self.near_on_host;
        if shades_objects {
            self.twins.prepare_vertices(input, &camera, &light, quality);
            for vertices in self.twins.transferred.changed() {
                self.scene.moved(vertices);
            }
        }
        if DRAWING.iter().any(|&p| runs.has(p) && !on_cpu(p)) {
            context.live.serve_the_scene();
            let cut = self.domain.cut(input.lens, &camera);
            let (objects, transferred) = (&self.twins.objects, &self.twins.transferred);
            self.scene.update(context, objects, transferred, &self.twins.surfaces, cut);
        }
        let view_params =
            view::view(input.lens, &mut self.domain, &camera, self.scene.extents().near_m(camera.eye));

        let coarse = cpu::coarse_lens(input.lens, quality.soft_step_px);
        let coarse_size = (coarse.width as usize, coarse.height as usize);
        let coarse_view = params::View {
            focal: [coarse.fx, coarse.fy, coarse.cx, coarse.cy].map(|x| x as f32),
            frame: [coarse.width as f32, coarse.height as f32, view_params.frame[2], view_params.frame[3]],
            ..view_params
        };

        let (twins, exchange) = (&mut self.twins, &mut self.exchange);
        exchange.begin(kept);
        out.t = input.t;
        let mut displayed = Place::Nowhere;
        let mut recorder = Recorder::new(context, timer);
        for pass in runs.iter() {
            twins.held.made(pass, uses);
            context.live.serve(pass);
            let host = on_cpu(pass);
            let cameras = view::shadows(twins.shadows.cameras(), quality.pcf_taps);
            match pass {
                Pass::MergeBracket | Pass::UnwrapBall | Pass::ProjectSh => {}
                Pass::ShadowMaps if host => {
                    recorder.host(pass, || twins.shadow_maps(input, &light, quality));
                    exchange.shadow_place = Place::Host;
                }
                Pass::ShadowMaps => {
                    twins.shadow_cameras(input, &light, quality);
                    let count = twins.shadows.cameras().len();
                    let cameras = view::shadows(twins.shadows.cameras(), quality.pcf_taps);
                    let kernel = ready(&mut self.shadow_maps, context, ShadowMaps::new)?;
                    let maps = &mut exchange.shadow_maps;
                    kernel.run(&mut recorder, &mut self.scene, &cameras, count, maps)?;
                    twins.held.maps_drawn(&twins.shadows);
                    exchange.shadow_place = Place::Device;
                }
                Pass::SoftShadow => {
                    twins.prepare_blockers(input, &light, quality);
                    // The twin does any number of spheres and any order.
                    if host || !twins.blockers.fit_shader() {
                        recorder.host(pass, || twins.soft_shadow(input, &camera, &light, quality));
                        exchange.soft_place = Place::Host;
                    } else {
                        let at_vertices = quality.soft_at == SoftAt::Vertex;
                        if at_vertices {
                            twins.lay_grid(input, &camera);
                            let cut = self.domain.cut(input.lens, &camera);
                            self.scene.upload_grid(context, &twins.grid, cut);
                        }
                        let kernel = ready(&mut self.soft_shadow, context, SoftShadow::new)?;
                        let picture = &mut exchange.soft;
                        kernel.run(
                            &mut recorder,
                            &mut self.scene,
                            &coarse_view,
                            &Soft {
                                blockers: &twins.blockers,
                                transfer: &twins.transfer,
                                planes: &twins.planes,
                                at_vertices,
                            },
                            picture,
                        )?;
                        exchange.soft_place = Place::Device;
                    }
                }
                Pass::PointMaps if host => {
                    if !maps_drawn {
                        recorder.host(pass, || twins.point_maps(input, quality));
                    }
                    self.near_on_host = true;
                    exchange.point_place = Place::Host;
                }
                Pass::PointMaps => {
                    if !maps_drawn {
                        recorder.host(pass, || twins.find_room_lights(input, quality));
                    }
                    twins.held.near_maps_drawn(twins.room.frame.maps().cameras());
                    let kernel = ready(&mut self.point_maps, context, PointMaps::new)?;
                    let (frame, triangles) = (&twins.room.frame, twins.room.casters());
                    kernel.run(&mut recorder, frame, triangles, self.spread, &mut exchange.point_maps)?;
                    exchange.point_place = Place::Device;
                }
                Pass::Subtract | Pass::SubtractDisplayed => {
                    let displays = pass == Pass::SubtractDisplayed;
                    let is_drawn = maps_drawn || exchange.point_place == Place::Host;
                    if !host {
                        recorder.host(pass, || {
                            twins.room.list(is_drawn);
                            if displays {
                                twins.room.deal_out(input.response);
                            }
                        });
                    }
                    if host || !Subtract::holds(context, &twins.room.frame) {
                        exchange.points_to_host(&mut recorder, twins)?;
                        exchange.shadow_to_host(&mut recorder, twins)?;
                        recorder.host(pass, || {
                            if displays {
                                twins.subtract_displayed(input, &camera, &light, quality);
                            } else {
                                twins.subtract(input, &camera, &light, quality);
                            }
                        });
                        exchange.ratio_place = Place::Host;
                    } else if let Some(known) = twins.room.known() {
                        exchange.points_to_device(&recorder, twins);
                        let cut = self.domain.cut(input.lens, &camera);
                        let of_room = twins.room.triangles();
                        let gathered = &known.field.gathered_rgb;
                        self.room_mesh.update(context, &twins.surfaces, of_room, gathered, cut);
                        let shown = twins.room.displayed.curve.as_ref().filter(|_| displays);
                        let with = Subtraction {
                            view: &view_params,
                            frame: &twins.room.frame,
                            first: of_room.0,
                            triangles: of_room.1,
                            suns: &twins.room.suns,
                            sun_cameras: &cameras,
                            sun_maps: exchange.shadow_to_device(&recorder, twins)?,
                            spread: self.spread,
                            shown: shown.map(|curve| Shown {
                                lights: &twins.room.displayed.lights,
                                curve,
                                background,
                                exposure_s: exposure_s as f32,
                            }),
                        };
                        let kernel = ready(&mut self.subtract, context, Subtract::new)?;
                        let (pages, ratios) = (&mut exchange.point_maps, &mut exchange.ratios);
                        kernel.run(&mut recorder, &with, &mut self.room_mesh, pages, ratios)?;
                        exchange.ratio_place = Place::Device;
                    }
                }
                Pass::ShadeObject if host => {
                    exchange.points_to_host(&mut recorder, twins)?;
                    exchange.shadow_to_host(&mut recorder, twins)?;
                    recorder.host(pass, || {
                        twins.shade_object(input, &camera, &light, quality);
                    });
                    exchange.object_place = Place::Host;
                }
                Pass::ShadeObject => {
                    let frame = Frame {
                        view: &view_params,
                        light: &light_params,
                        cameras: &cameras,
                        shadow_maps: &exchange.shadow_to_device(&recorder, twins)?,
                    };
                    let order = light.order;
                    let (picture, norm) = (input.environment, quality.phong_norm);
                    let surroundings = Surroundings::new(picture, &twins.reflected, norm, order);
                    let kernel = ready(&mut self.shade_object, context, ShadeObject::new)?;
                    let seen = self.scene.extents().objects_seen(input.lens, &camera);
                    let earlier: [u32; 2] = exchange.object_layer.size().into();
                    let part = seen.kept_from(earlier, [input.lens.width, input.lens.height]);
                    let layer = (&mut exchange.object_layer, part);
                    let samples = quality.coverage_samples;
                    kernel.run(&mut recorder, &mut self.scene, &frame, &surroundings, samples, layer)?;
                    exchange.object_origin = part.origin;
                    exchange.object_place = Place::Device;
                }
                Pass::ShadeSurface => {
                    if host {
                        exchange.shadow_to_host(&mut recorder, twins)?;
                        exchange.soft_to_host(&mut recorder, twins, coarse_size)?;
                        let soft_drawn = exchange.soft_place.is_somewhere();
                        recorder.host(pass, || {
                            twins.shade_surface(input, &camera, &light, soft_drawn, quality);
                        });
                        exchange.ratio_place = Place::Host;
                    } else {
                        let frame = Frame {
                            view: &view_params,
                            light: &light_params,
                            cameras: &cameras,
                            shadow_maps: &exchange.shadow_to_device(&recorder, twins)?,
                        };
                        let present = u32::from(exchange.soft_place.is_somewhere());
                        let (columns, rows) = (coarse_size.0 as u32, coarse_size.1 as u32);
                        let place =
                            params::SoftPicture { size_step: [columns, rows, quality.soft_step_px, present] };
                        let soft = (&place, exchange.soft_to_device(&recorder, twins));
                        let kernel = ready(&mut self.shade_surface, context, ShadeSurface::new)?;
                        kernel.run(&mut recorder, &mut self.scene, &frame, soft, &mut exchange.ratios)?;
                        exchange.ratio_place = Place::Device;
                    }
                }
                Pass::Composite if host => {
                    exchange.objects_to_host(&mut recorder, twins, size, exposure)?;
                    exchange.ratios_to_host(&mut recorder, twins, size)?;
                    let present = (exchange.object_place.is_somewhere(), exchange.ratio_place.is_somewhere());
                    let target = &mut out.radiance;
                    recorder.host(pass, || twins.composite(input, present.0, present.1, target));
                    exchange.radiance_place = Place::Host;
                }
                Pass::Composite => {
                    let layers = Layers {
                        objects: exchange.objects_to_device(&recorder, twins, exposure),
                        ratios: exchange.ratios_to_device(&recorder, twins),
                        has_objects: exchange.object_place.is_somewhere(),
                        has_ratios: exchange.ratio_place.is_somewhere(),
                        origin: exchange.object_origin,
                        layer_scale: 1.0 / exposure,
                    };
                    let kernel = ready(&mut self.composite, context, Composite::new)?;
                    kernel.run(&mut recorder, background, &layers, &mut exchange.radiance)?;
                    exchange.copy_radiance(&mut recorder, size.0 * size.1 * 12);
                    exchange.radiance_place = Place::Device;
                }
                // A plan without a composed picture encodes what the caller's picture holds.
                Pass::Tonemap if host || !exchange.radiance_place.is_somewhere() => {
                    recorder.submit();
                    exchange.radiance_to_host(context, size, &mut out.radiance)?;
                    recorder.host(pass, || twins.tonemap(input, out));
                    displayed = Place::Host;
                }
                Pass::Tonemap => {
                    let radiance = exchange.radiance_to_device(&recorder, &out.radiance);
                    let kernel = ready(&mut self.tonemap, context, Tonemap::new)?;
                    let pixels = size.0 * size.1;
                    kernel.run(&mut recorder, radiance, pixels, input.response, exposure_s as f32)?;
                    let target = self.display.at_least(context, 3 * pixels).clone();
                    recorder.copy(&kernel.display(context), &target, 0, whole_words(3 * pixels));
                    displayed = Place::Device;
                }
            }
        }
        context.live.serve_all();
        recorder.finish(Pass::Composite)?;
        exchange.radiance_to_host(context, size, &mut out.radiance)?;
        if displayed == Place::Device {
            out.display.reshape(size.0, size.1, [0; 3]);
            let target: &mut [u8] = bytemuck::cast_slice_mut(out.display.pixels_mut());
            self.display.read(context, Pass::Tonemap.name(), target.len(), |bytes| {
                target.copy_from_slice(bytes);
            })?;
        }
        Ok(())
    }
}
