//! Views of every part of a picture, as Figures 3, 4 and 5 of [Now11] show them. A view changes what the engine draws
//! from (scene, light, background), leaves out passes, or is a picture of its own; engines know nothing of views.

mod panels;

use super::gray_place::GrayPlace;
use crate::animate::posed::Posed;
use crate::assets::shapes;
use crate::compose::geometry::{ObjectGeometry, SurfaceGeometry};
use crate::engine::{Engine, EngineError, RelightInput};
use crate::model::{
    frame::Exposure,
    image::{HdrImage, Rgb8Image},
    light::{HardLights, Lights, RadianceSamples, RadianceSh},
    picture::{Picture, PictureView},
    quality::Quality,
    response::Response,
    scene::{Material, Mesh, Scene, VirtualObject},
};
use crate::plan::{
    EffectVerdict, Foresight, FramePlan, Pass,
    effects::{self, Occasion},
};
use crate::visibility::shadow_maps::{Receivers, ShadowMapSet};
use glam::{Affine3A, DVec3, Mat3, Quat, Vec3};

/// White of the views that show shares of light.
const WHITE: f32 = 0.9;
/// Gray behind objects that are shown by themselves.
const BEHIND: f32 = 0.2;
/// Materials of the views that show them.
const LAMBERT: Material = Material::Lambert { albedo_rgb: [0.75; 3] };
const PHONG: Material = Material::Phong { albedo_rgb: [0.15; 3], specular_rgb: [0.6; 3], exponent: 16.0 };
const MIRROR: Material = Material::Mirror { reflectance_rgb: [0.9; 3] };

/// What a picture is drawn from.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The scene that the engine was given.
    pub scene: &'a Scene,
    /// Everything else that engines draw from.
    pub input: &'a RelightInput<'a>,
    /// Accuracy settings.
    pub quality: &'a Quality,
    /// The light as it was measured, world frame; `None`: as the engine measured it last.
    pub samples: Option<&'a RadianceSamples>,
    /// The camera's frame, where there is one.
    pub frame: Option<CameraFrame<'a>>,
}

/// What of a camera's frame matters to the picture.
#[derive(Clone, Copy)]
pub struct CameraFrame<'a> {
    /// Its pixels, where they are what the picture shows with nothing virtual in it: the frame alone was merged, at the shown
    /// exposure.
    pub shown_as_it_is: Option<&'a Rgb8Image>,
    /// The light was read from the ball in it.
    pub reads_ball: bool,
}

/// Draws pictures by views; keeps its memory from picture to picture.
pub struct Views {
    /// The newest view; the engine holds its scene.
    shown: PictureView,
    /// The scene of a view that has its own.
    scene: Scene,
    background: HdrImage,
    place: GrayPlace,
    objects: ObjectGeometry,
    surfaces: SurfaceGeometry,
    receivers: Receivers,
    shadows: ShadowMapSet,
    even_response: Response,
    /// What the engine knows of the next frame, where results of earlier ones are to be kept.
    foresight: Option<Foresight>,
}

impl Default for Views {
    fn default() -> Self {
        Self {
            shown: PictureView::Final,
            scene: Scene::default(),
            background: HdrImage::default(),
            place: GrayPlace::default(),
            objects: ObjectGeometry::default(),
            surfaces: SurfaceGeometry::default(),
            receivers: Receivers::default(),
            shadows: ShadowMapSet::default(),
            even_response: Response::srgb(),
            foresight: None,
        }
    }
}

impl Views {
    /// Pictures follow each other: what has not changed since the last is kept.
    pub fn keeping() -> Self {
        Self { foresight: Some(Foresight::NONE), ..Self::default() }
    }

    /// Plans and draws one picture. Another view than [`PictureView::Final`] may hand the engine other scenes; a later
    /// `Final` gives it back the subject's. `plan` is what was run.
    pub fn draw(
        &mut self,
        view: PictureView,
        engine: &mut dyn Engine,
        subject: &Subject<'_>,
        plan: &mut FramePlan,
        out: &mut Picture,
    ) -> Result<(), EngineError> {
        let Subject { scene, input, quality, frame, .. } = *subject;
        if matches!(view, PictureView::Light | PictureView::Maps) {
            self.draw_panel(view, engine, subject, plan, out);
            return Ok(());
        }
        self.load(view, engine, scene, input)?;
        let light = light_of(view, input.light);
        let own_background = self.draw_background(view, input, scene, &light);
        let scene = if has_own_scene(view) { &self.scene } else { scene };
        // Shares of light are shown as they are, not as a camera would expose them.
        let share = matches!(view, PictureView::Cast | PictureView::SelfShadow);
        let changed = RelightInput {
            background: if own_background { &self.background } else { input.background },
            lens: input.lens,
            world_from_camera: input.world_from_camera,
            light: &light,
            posed: if view == PictureView::Blockers { None } else { input.posed },
            // One half by itself is seen in mirrors as SH: the picture holds both.
            environment: if own_background { None } else { input.environment },
            response: if share { &self.even_response } else { input.response },
            shown_exposure: if share { Exposure { time_s: 1.0, gain: 1.0 } } else { input.shown_exposure },
            t: input.t,
        };
        if let Some(foresight) = &mut self.foresight {
            engine.foresee(&changed, quality, foresight)?;
        }
        let own_picture = frame.and_then(|f| f.shown_as_it_is).filter(|_| !own_background);
        let reads_ball = frame.is_some_and(|f| f.reads_ball);
        let occasion = Occasion {
            merge: frame.is_some(),
            ball: reads_ball,
            project: reads_ball,
            camera: Some((input.lens, input.world_from_camera)),
            camera_picture: own_picture.is_some(),
            spheres: changed.posed.map(Posed::around),
            foresight: self.foresight.as_ref(),
            ..Occasion::SHOW
        };
        effects::plan(&occasion, scene, &light, quality, plan);
        leave_out(view, plan);
        engine.relight(plan, &changed, out)?;
        if let Some(pixels) = own_picture.filter(|_| plan.passes_through) {
            out.display.reshape(pixels.width(), pixels.height(), [0; 3]);
            out.display.pixels_mut().copy_from_slice(pixels.pixels());
        }
        Ok(())
    }

    /// Draws a view of the light or of the shadow maps, which no engine draws.
    fn draw_panel(
        &mut self,
        view: PictureView,
        engine: &mut dyn Engine,
        subject: &Subject<'_>,
        plan: &mut FramePlan,
        out: &mut Picture,
    ) {
        let Subject { scene, input, quality, samples, .. } = *subject;
        let size = [input.background.radiance.width(), input.background.radiance.height()];
        effects::plan(&Occasion::default(), scene, input.light, quality, plan);
        if view == PictureView::Light {
            panels::light(samples.unwrap_or_else(|| engine.measured_samples()), input.light, size, out);
        } else {
            self.draw_maps(scene, input, quality);
            panels::maps(&self.shadows, size, out);
        }
        out.t = input.t;
    }

    /// Draws what a view has in place of the camera's picture; returns whether it has anything.
    fn draw_background(
        &mut self,
        view: PictureView,
        input: &RelightInput<'_>,
        scene: &Scene,
        light: &Lights,
    ) -> bool {
        let size = [input.background.radiance.width(), input.background.radiance.height()];
        let surfaces = if has_own_scene(view) { &self.scene.surfaces } else { &scene.surfaces };
        match view {
            PictureView::Direct | PictureView::Global => {
                self.place.draw(surfaces, input.lens, input.world_from_camera, light, &mut self.background);
            }
            PictureView::Cast => even(&mut self.background, size, WHITE),
            PictureView::SelfShadow => even(&mut self.background, size, BEHIND),
            _ => return false,
        }
        true
    }

    /// Gives the engine the scene of the view, where it does not hold it already.
    fn load(
        &mut self,
        view: PictureView,
        engine: &mut dyn Engine,
        scene: &Scene,
        input: &RelightInput<'_>,
    ) -> Result<(), EngineError> {
        let before = std::mem::replace(&mut self.shown, view);
        match view {
            // Spheres move: they are a new scene for each picture.
            PictureView::Blockers => {
                self.scene.surfaces.clone_from(&scene.surfaces);
                self.scene.figures.clear();
                spheres_as_objects(input, &mut self.scene.objects);
                engine.load_scene(&self.scene)
            }
            _ if before == view => Ok(()),
            PictureView::SelfShadow | PictureView::Lambert | PictureView::Phong | PictureView::Mirror => {
                self.scene.clone_from(scene);
                for object in &mut self.scene.objects {
                    object.material = match view {
                        PictureView::SelfShadow => Material::Lambert { albedo_rgb: [WHITE; 3] },
                        PictureView::Phong => PHONG,
                        PictureView::Mirror => MIRROR,
                        _ => LAMBERT,
                    };
                    object.mesh.tints_rgb.clear();
                }
                engine.load_scene(&self.scene)
            }
            _ if has_own_scene(before) => engine.load_scene(scene),
            _ => Ok(()),
        }
    }

    /// Shadow maps as the CPU draws them, whatever engine there is.
    fn draw_maps(&mut self, scene: &Scene, input: &RelightInput<'_>, quality: &Quality) {
        self.objects.load(scene);
        for (index, object) in input.posed.map_or(&[][..], |p| p.objects()).iter().enumerate() {
            self.objects.pose(index, &object.positions_world, &object.normals_world);
        }
        self.surfaces.load(&scene.surfaces);
        self.surfaces.receivers(&mut self.receivers);
        let objects = &self.objects;
        self.receivers.see(input.lens, input.world_from_camera, objects.bodies());
        self.shadows.fit(
            input.light.hard.as_slice(),
            &objects.positions,
            &objects.triangles,
            &self.receivers,
            quality.shadow_map_texels,
            quality.pcf_taps,
        );
        self.shadows.draw(&objects.positions, &objects.triangles);
    }
}

/// Whether the engine holds another scene than the caller's.
fn has_own_scene(view: PictureView) -> bool {
    use PictureView::{Blockers, Lambert, Mirror, Phong, SelfShadow};
    matches!(view, SelfShadow | Lambert | Phong | Mirror | Blockers)
}

/// The light that a view shows.
fn light_of(view: PictureView, measured: &Lights) -> Lights {
    let mut light = *measured;
    match view {
        PictureView::Direct => light.global = RadianceSh::zero(light.global.order),
        PictureView::Global => light.hard = HardLights::none(),
        PictureView::SelfShadow => light = even_light(light.global.order),
        _ => {}
    }
    light
}

/// Radiance 1 from everywhere.
fn even_light(order: usize) -> Lights {
    let mut sky = RadianceSh::zero(order);
    sky.rgb[0] = [(4.0 * std::f32::consts::PI).sqrt(); 3];
    Lights::soft(sky)
}

fn even(picture: &mut HdrImage, [width, height]: [usize; 2], radiance: f32) {
    picture.radiance.reshape(width, height, [radiance; 3]);
    picture.radiance.pixels_mut().fill([radiance; 3]);
    picture.flags.reshape(width, height, 0);
    picture.flags.pixels_mut().fill(0);
}

/// Takes the passes away that a view does not show.
fn leave_out(view: PictureView, plan: &mut FramePlan) {
    let gone: &[Pass] = match view {
        PictureView::Cast => &[Pass::ShadeObject],
        PictureView::SelfShadow => &[Pass::ShadowMaps, Pass::SoftShadow, Pass::ShadeSurface],
        PictureView::Blockers => &[Pass::SoftShadow, Pass::ShadeSurface],
        _ => &[],
    };
    const WHY: &str = "the view does not show it";
    let FramePlan { passes, kept, left_out, decisions, .. } = plan;
    for list in [passes, kept] {
        list.retain(|planned| {
            let is_shown = !gone.contains(&planned.pass);
            if !is_shown {
                left_out.push(crate::plan::PlannedPass { reason: WHY, ..*planned });
                let of_it = decisions.iter_mut().filter(|d| d.effect.pass() == Some(planned.pass));
                of_it.for_each(|d| (d.verdict, d.reason, d.error_bound) = (EffectVerdict::Off, WHY, 0.0));
            }
            is_shown
        });
    }
}

/// Everything that blocks soft light, spheres and boxes, matt and in a colour of its own.
fn spheres_as_objects(input: &RelightInput<'_>, objects: &mut Vec<VirtualObject>) {
    let spheres = input.posed.map_or(&[][..], |p| p.blocking());
    let boxes = input.posed.map_or(&[][..], |p| p.boxes());
    let is_sphere = |object: &&VirtualObject| object.name.starts_with("sphere");
    if objects.len() != spheres.len() + boxes.len()
        || objects.iter().filter(is_sphere).count() != spheres.len()
    {
        let made = |k: usize, what: &str, mesh: &Mesh| VirtualObject {
            name: format!("{what} {k}"),
            mesh: mesh.clone(),
            material: Material::Lambert { albedo_rgb: colour(k) },
            world_from_object: Affine3A::IDENTITY,
            openness: vec![1.0; mesh.positions.len()],
        };
        let (ball, cube) = (shapes::icosphere(1.0, 2), shapes::cuboid(DVec3::ONE));
        objects.clear();
        objects.extend((0..spheres.len()).map(|k| made(k, "sphere", &ball)));
        objects.extend((0..boxes.len()).map(|k| made(spheres.len() + k, "box", &cube)));
    }
    for (object, sphere) in objects.iter_mut().zip(spheres) {
        object.world_from_object = Affine3A::from_scale_rotation_translation(
            Vec3::splat(sphere.radius_m),
            Quat::IDENTITY,
            sphere.centre_world,
        );
    }
    for (object, of) in objects.iter_mut().skip(spheres.len()).zip(boxes) {
        // A sheet, too, has to be seen from its edge.
        let half = of.half_m.max(Vec3::splat(1e-3 * of.half_m.max_element()));
        let [x, y, z] = of.axes_world;
        let axes = Mat3::from_cols(x * half.x, y * half.y, z * half.z);
        object.world_from_object = Affine3A::from_mat3_translation(axes, of.centre_world);
    }
}

/// Neighbours in the list get hues far apart.
fn colour(k: usize) -> [f32; 3] {
    let hue = (k as f32 * 0.618_034).fract();
    std::array::from_fn(|c| {
        let angle = std::f32::consts::TAU * (hue - c as f32 / 3.0);
        0.45 + 0.35 * angle.cos()
    })
}
