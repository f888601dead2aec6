//! What a frame needs, decided from what there is: objects, light, camera, what the caller wants, and what has changed.

use super::{
    Decision, Effect, Foresight, FramePlan, LARGEST_ERROR, Pass, PassSet, PlannedPass, Verdict, bounds,
    view_cone::ViewCone, work::Amounts,
};
use crate::math::{lens::Lens, pose::Pose, sh::zonal::phong_saturates};
use crate::model::{
    blocker::{BlockerSphere, SHADER_SPHERES},
    light::Lights,
    quality::{Effects, NearForm, Quality, SelfShadow},
    scene::{Material, Mesh, Scene},
};
use glam::Vec3;

/// What the caller does with this frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Occasion<'a> {
    /// A bracket is to be merged.
    pub merge: bool,
    /// The light is to be read from a ball in the picture.
    pub ball: bool,
    /// Directions with radiance are to be projected to SH (a ball or an environment picture).
    pub project: bool,
    /// A picture is to be drawn.
    pub draw: bool,
    /// The picture is to be shown: 8 bits through the camera's response.
    pub display: bool,
    /// Lens and pose; objects that it cannot see are not shaded. `None`: everything may be seen.
    pub camera: Option<(&'a Lens, &'a Pose)>,
    /// The camera's own picture can be shown as it is, where nothing virtual is in it.
    pub camera_picture: bool,
    /// Where the spheres of the scene's bodies are now; `None`: not known.
    pub spheres: Option<&'a [BlockerSphere]>,
    /// What the engine holds of earlier frames; `None`: nothing.
    pub foresight: Option<&'a Foresight>,
}

impl Occasion<'_> {
    /// A picture drawn and shown with light that is known already.
    pub const SHOW: Self = Self {
        merge: false,
        ball: false,
        project: false,
        draw: true,
        display: true,
        camera: None,
        camera_picture: false,
        spheres: None,
        foresight: None,
    };
}

/// Why: `Ok` for doing something, `Err` for leaving it out.
type Why = Result<&'static str, &'static str>;

/// A pass or an effect that has been looked at: why it is done or left out, and what leaving it out changes at most.
#[derive(Clone, Copy)]
struct Ruling {
    why: Why,
    error_bound: f32,
}

impl Ruling {
    /// Left out because there is nothing for it.
    const fn nothing(reason: &'static str) -> Self {
        Self { why: Err(reason), error_bound: 0.0 }
    }

    /// Done, with what leaving it out could change.
    const fn on(reason: &'static str, error_bound: f32) -> Self {
        Self { why: Ok(reason), error_bound }
    }

    fn asked(wanted: bool, yes: &'static str, no: &'static str) -> Self {
        if wanted { Self::on(yes, f32::INFINITY) } else { Self::nothing(no) }
    }
}

/// Writes the passes of one frame into `out` (memory is reused): each that the frame calls for with its
/// reason, and each left out with its reason; and the decision on each effect.
///
/// In a known room its own lights are drawn instead of the far light's halves: `PointMaps` and `Subtract` where objects may
/// hide some of them, or `SubtractDisplayed` in its place (`Quality::near_form`): it subtracts from what an 8-bit display shows
/// of the place alone, before any object is drawn over it, so that objects need no mask and keep their clean edges, and hands
/// on what is left as a ratio, so that all later passes are the same; `SoftShadow` and `ShadeSurface` not at all; `ShadowMaps` for
/// suns that are among the frame's lights. Elsewhere:
///
/// * `ShadowMaps`: a hard light that shines, an object that can cast, and something lit to cast on:
///   an object in view, or a receiving surface that faces the light; and not so little light that nobody sees its shadow.
/// * `SoftShadow`: soft light, a surface that receives shadows, and a body with spheres. Its reason says where it has
///   more of them than shaders take, so that it runs on the CPU twin with either engine.
/// * `ShadeSurface`: with `ShadowMaps`, where a receiving surface faces a hard light, or with `SoftShadow`.
/// * `ShadeObject`: an object is in view.
/// * `Composite`: a picture is drawn, unless the camera's own is shown as it is. `Tonemap`: it is shown.
///
/// A pass whose result the engine holds and that would come out the same is kept. With `Effects::All` whatever there is
/// anything for is drawn, seen or not, and nothing is kept.
pub fn plan(occasion: &Occasion<'_>, scene: &Scene, light: &Lights, quality: &Quality, out: &mut FramePlan) {
    out.passes.clear();
    out.kept.clear();
    out.left_out.clear();
    out.decisions.clear();
    for list in [&mut out.passes, &mut out.kept, &mut out.left_out] {
        list.reserve(Pass::ALL.len());
    }
    out.decisions.reserve(Effect::ALL.len());
    out.quality = *quality;

    let look = Look::of(occasion, scene, light, quality);
    let all = quality.effects == Effects::All;
    let shadows = look.shadow_maps();
    let soft = look.soft_shadow();
    let near = look.near();
    let objects = look.objects();
    let surfaces = look.surfaces(shadows, soft);
    let draws = |r: Ruling| r.why.is_ok();
    out.passes_through = occasion.draw
        && occasion.camera_picture
        && !all
        && !draws(objects)
        && !draws(surfaces)
        && !draws(near);
    let shown = |yes: &'static str, no: &'static str, wanted: bool| {
        if out.passes_through {
            Ruling::nothing("nothing virtual is in the picture: the camera's own is shown as it is")
        } else {
            Ruling::asked(wanted, yes, no)
        }
    };
    let reads = occasion.project || occasion.ball;
    let rulings: [Ruling; Pass::ALL.len()] = [
        Ruling::asked(occasion.merge, "a bracket came in", "no bracket to merge"),
        Ruling::asked(
            occasion.ball,
            "the light is read from the ball",
            "the light is not read from a ball now",
        ),
        Ruling::asked(reads, "measured light becomes SH", "no light is measured now"),
        shadows,
        soft,
        near,
        look.near_form(near, NearForm::Ratio),
        look.near_form(near, NearForm::Ldr),
        objects,
        surfaces,
        shown("a picture is drawn", "no picture is drawn", occasion.draw),
        shown("the picture is shown", "no display output is wanted", occasion.draw && occasion.display),
    ];

    let mut used = PassSet::default();
    for (pass, _) in Pass::ALL.into_iter().zip(&rulings).filter(|(_, r)| draws(**r)) {
        used.insert(pass);
    }
    let foresight = occasion.foresight.filter(|_| !all).unwrap_or(&Foresight::NONE);
    // What a pass reads has to be kept, too, or to come out the same; the engine has seen to that.
    let is_kept = |pass: Pass| used.has(pass) && foresight.holds(pass, used);
    for (pass, ruling) in Pass::ALL.into_iter().zip(&rulings) {
        match ruling.why {
            Ok(_) if is_kept(pass) => out.kept.push(PlannedPass { pass, reason: kept_because(pass) }),
            Ok(reason) => out.passes.push(PlannedPass { pass, reason }),
            Err(reason) => out.left_out.push(PlannedPass { pass, reason }),
        }
    }

    let amounts = look.amounts();
    let of_pass = |effect, pass: Pass| {
        let ruling = rulings[pass as usize];
        let (verdict, reason) = match ruling.why {
            Ok(_) if is_kept(pass) => (Verdict::Kept, kept_because(pass)),
            Ok(reason) => (Verdict::On, reason),
            Err(reason) => (Verdict::Off, reason),
        };
        let error_bound = if verdict == Verdict::Kept { 0.0 } else { ruling.error_bound };
        Decision { effect, verdict, reason, saving: amounts.of(pass) * 1e-6, error_bound }
    };
    let within = |effect, ruling: Ruling, whole: Pass, held: Option<&'static str>, units: f32| {
        let (verdict, reason) = match (ruling.why, held) {
            (Err(reason), _) => (Verdict::Off, reason),
            (Ok(_), _) if is_kept(whole) => (Verdict::Kept, "what it goes into is kept"),
            (Ok(_), Some(reason)) if !all => (Verdict::Kept, reason),
            (Ok(reason), _) => (Verdict::On, reason),
        };
        let error_bound = if verdict == Verdict::Kept { 0.0 } else { ruling.error_bound };
        Decision { effect, verdict, reason, saving: units * 1e-6, error_bound }
    };
    let (mirror, filter) = (look.mirror_picture(objects), look.shadow_filter(shadows));
    let (vertices, volume) = (look.vertex_light(objects), look.irradiance_volume(objects));
    let same_vertices =
        foresight.vertex_light_is_held.then_some("light, objects and what is near them are as they were");
    let same_mirror = foresight.mirror_picture_is_held.then_some("no new picture of the place came in");
    let taps = (amounts.pixels * quality.pcf_taps.pow(2) as usize) as f32;
    let decisions = [
        of_pass(Effect::BracketMerge, Pass::MergeBracket),
        of_pass(Effect::BallUnwrap, Pass::UnwrapBall),
        of_pass(Effect::ShProjection, Pass::ProjectSh),
        within(Effect::MirrorPicture, mirror, Pass::ShadeObject, same_mirror, amounts.pixels as f32),
        of_pass(Effect::ShadowMaps, Pass::ShadowMaps),
        within(Effect::ShadowFilter, filter, Pass::ShadowMaps, None, 0.1 * taps),
        of_pass(Effect::SoftShadows, Pass::SoftShadow),
        within(Effect::VertexLight, vertices, Pass::ShadeObject, same_vertices, amounts.vertex_light()),
        within(Effect::IrradianceVolume, volume, Pass::ShadeObject, None, 10.0 * amounts.vertices as f32),
        of_pass(Effect::NearMaps, Pass::PointMaps),
        of_pass(
            Effect::NearShadows,
            match quality.near_form {
                NearForm::Ratio => Pass::Subtract,
                NearForm::Ldr => Pass::SubtractDisplayed,
            },
        ),
        of_pass(Effect::Objects, Pass::ShadeObject),
        of_pass(Effect::SurfaceShadows, Pass::ShadeSurface),
        of_pass(Effect::Composition, Pass::Composite),
        of_pass(Effect::ToneMapping, Pass::Tonemap),
    ];
    out.decisions.extend(decisions);
}

/// Why the result of an earlier frame will do.
const fn kept_because(pass: Pass) -> &'static str {
    match pass {
        Pass::ShadowMaps => "neither objects nor lights nor what the maps are fitted to have changed",
        Pass::PointMaps => {
            "neither objects nor the room's lights nor what the maps are fitted to have changed"
        }
        _ => "neither light nor camera nor objects have changed",
    }
}

/// What there is in a frame.
struct Look<'a> {
    occasion: &'a Occasion<'a>,
    scene: &'a Scene,
    light: &'a Lights,
    quality: &'a Quality,
    all: bool,
    in_room: bool,
    /// There are virtual objects; they may be seen.
    has_objects: bool,
    seen: bool,
    /// Hard light shines; it falls on the front of a surface that receives shadows; there is such a surface.
    lit: bool,
    faces: bool,
    receivers: bool,
    spheres: usize,
    is_glossy: bool,
}

impl<'a> Look<'a> {
    fn of(occasion: &'a Occasion<'a>, scene: &'a Scene, light: &'a Lights, quality: &'a Quality) -> Self {
        let all = quality.effects == Effects::All;
        let has_objects = scene.objects.iter().any(|o| !o.mesh.triangles.is_empty());
        let in_view = |(lens, pose): (&Lens, &Pose)| {
            let cone = ViewCone::new(lens, pose);
            // What moves may be anywhere.
            scene.figures.iter().any(|f| !f.is_still() && !f.parts.is_empty())
                || scene.objects.iter().any(|o| cone.may_see(o))
        };
        let seen = has_objects && (all || occasion.camera.is_none_or(in_view));
        let shines = |e: &[f32; 3]| e.iter().any(|&e| e > 0.0 && e.is_finite());
        let hard = || {
            let shining = light.hard.as_slice().iter().filter(move |h| shines(&h.irradiance_rgb));
            shining.map(|h| Vec3::from(h.to_light_world))
        };
        let receiving = || scene.surfaces.iter().filter(|s| s.receives_shadow);
        let glossy =
            |m: &Material| matches!(m, Material::Phong { specular_rgb, .. } if *specular_rgb != [0.0; 3]);
        Self {
            occasion,
            scene,
            light,
            quality,
            all,
            in_room: scene.room.is_some(),
            has_objects,
            seen,
            lit: hard().next().is_some(),
            faces: hard().any(|w| receiving().any(|s| faces_light(&s.mesh, w))),
            receivers: receiving().next().is_some(),
            spheres: scene.figures.iter().map(|f| f.spheres.len()).sum(),
            is_glossy: scene.objects.iter().any(|o| glossy(&o.material)),
        }
    }

    fn shadow_maps(&self) -> Ruling {
        if !self.occasion.draw {
            return Ruling::nothing("no picture is drawn");
        }
        if !self.has_objects {
            return Ruling::nothing("no virtual object casts a shadow");
        }
        if !self.lit {
            return Ruling::nothing("no hard light");
        }
        let reason = if self.seen {
            "virtual objects in view stand in hard light"
        } else if self.in_room {
            "the sun shines into the known room"
        } else if self.faces {
            "shadows of objects out of view fall on real surfaces"
        } else {
            return Ruling::nothing("the hard light reaches nothing in view");
        };
        if self.all {
            return Ruling::on(reason, f32::INFINITY);
        }
        if self.occasion.foresight.is_some_and(|f| f.maps_seen == Some(0)) {
            return Ruling::nothing(if self.in_room {
                "no sun is among the lights of which objects hide something in the picture"
            } else {
                "every hard shadow falls outside of the picture"
            });
        }
        // The light of a known room is not that of `light` alone.
        let share = if self.in_room { f32::INFINITY } else { bounds::hard_share(self.scene, self.light) };
        if share <= LARGEST_ERROR {
            return Ruling {
                why: Err("the hard light is too faint for its shadow to be seen"),
                error_bound: share,
            };
        }
        Ruling::on(reason, share)
    }

    fn shadow_filter(&self, shadows: Ruling) -> Ruling {
        match shadows.why {
            Err(_) => Ruling::nothing("no shadow maps"),
            Ok(_) if self.quality.pcf_taps <= 1 => Ruling::nothing("one tap is asked for"),
            // A pixel at a shadow's edge would be all light or all shadow.
            Ok(_) => Ruling::on("edges of shadows would have steps", shadows.error_bound),
        }
    }

    fn soft_shadow(&self) -> Ruling {
        if !self.occasion.draw {
            return Ruling::nothing("no picture is drawn");
        }
        if self.in_room {
            return Ruling::nothing("the known room's own lights throw the shadows");
        }
        if self.spheres == 0 {
            return Ruling::nothing("no virtual body has spheres");
        }
        if !self.receivers {
            return Ruling::nothing("no real surface receives shadows");
        }
        if self.light.global.rows().iter().flatten().all(|c| *c == 0.0) {
            return Ruling::nothing("no soft light");
        }
        let reason = if self.spheres > SHADER_SPHERES {
            "virtual bodies stand in soft light over real surfaces; on the CPU with either engine if more than 256 \
             spheres count: shaders take no more"
        } else {
            "virtual bodies stand in soft light over real surfaces"
        };
        if self.all {
            return Ruling::on(reason, f32::INFINITY);
        }
        let share = bounds::soft_share(self.scene, self.light, self.quality.rung, self.occasion.spheres);
        if share <= LARGEST_ERROR {
            let why = Err("what virtual bodies hide of the soft light is too little to be seen");
            return Ruling { why, error_bound: share };
        }
        Ruling::on(reason, share)
    }

    fn near(&self) -> Ruling {
        if !self.in_room {
            Ruling::nothing("no known room")
        } else if !self.occasion.draw {
            Ruling::nothing("no picture is drawn")
        } else if !self.has_objects {
            Ruling::nothing("no virtual object hides any light")
        } else {
            // The ratio lies within 0 and 1.
            Ruling::on("virtual objects stand in a known room", 1.0)
        }
    }

    /// One of the two ways to take what objects hide.
    fn near_form(&self, near: Ruling, form: NearForm) -> Ruling {
        match (near.why, self.quality.near_form, form) {
            (Ok(_), NearForm::Ldr, NearForm::Ldr) => {
                Ruling::on("virtual objects stand in a known room, and 8-bit values were asked for", 1.0)
            }
            (Ok(_), NearForm::Ratio, NearForm::Ldr) => {
                Ruling::nothing("the known room's light is taken in linear light, as a ratio")
            }
            (Ok(_), NearForm::Ldr, NearForm::Ratio) => {
                Ruling::nothing("the known room's light is taken from 8-bit values")
            }
            _ => near,
        }
    }

    fn objects(&self) -> Ruling {
        if !self.occasion.draw {
            Ruling::nothing("no picture is drawn")
        } else if !self.has_objects {
            Ruling::nothing("no virtual object")
        } else if !self.seen {
            Ruling::nothing("every virtual object is out of view")
        } else {
            Ruling::on("virtual objects are in view", f32::INFINITY)
        }
    }

    fn surfaces(&self, shadows: Ruling, soft: Ruling) -> Ruling {
        if self.in_room {
            Ruling::nothing("the known room's own lights throw the shadows")
        } else if soft.why.is_ok() {
            Ruling::on("soft light is blocked over a receiving surface", 1.0)
        } else if shadows.why.is_err() {
            // What it would draw has been left out already, with its own bound.
            Ruling { error_bound: 0.0, ..shadows }
        } else if !self.receivers {
            Ruling::nothing("no real surface receives shadows")
        } else if !self.faces && !self.all {
            Ruling::nothing("the hard light is below every receiving surface")
        } else {
            Ruling::on("a receiving surface faces a hard light", 1.0)
        }
    }

    fn mirror_picture(&self, objects: Ruling) -> Ruling {
        let order = self.light.global.order;
        let reads = |m: &Material| match *m {
            Material::Mirror { .. } => true,
            Material::Phong { specular_rgb, exponent, .. } => {
                specular_rgb != [0.0; 3] && phong_saturates(order, exponent)
            }
            Material::Lambert { .. } => false,
        };
        match objects.why {
            Err(reason) => Ruling::nothing(reason),
            Ok(_) if !self.scene.objects.iter().any(|o| reads(&o.material)) => {
                Ruling::nothing("no mirror and no sharp gloss")
            }
            Ok(_) => Ruling::on("mirrors or sharp gloss show the place", f32::INFINITY),
        }
    }

    fn vertex_light(&self, objects: Ruling) -> Ruling {
        let transfers = self.quality.self_shadow == SelfShadow::Transfer
            && self.scene.transfer.as_ref().is_some_and(|t| t.objects.iter().any(Option::is_some));
        match objects.why {
            Err(reason) => Ruling::nothing(reason),
            Ok(_) if self.in_room => Ruling::nothing("the known room lights the vertices"),
            Ok(_) if !transfers && self.spheres == 0 => {
                Ruling::nothing("no precomputed transfer, and no spheres to be hidden by")
            }
            Ok(_) if self.light.global.rows().iter().flatten().all(|c| *c == 0.0) => {
                Ruling::nothing("no soft light")
            }
            Ok(_) => Ruling::on(
                "soft light on objects is hidden by themselves and each other",
                if self.is_glossy { f32::INFINITY } else { 1.0 },
            ),
        }
    }

    fn irradiance_volume(&self, objects: Ruling) -> Ruling {
        match objects.why {
            _ if !self.in_room => Ruling::nothing("no known room"),
            Err(reason) => Ruling::nothing(reason),
            Ok(_) => Ruling::on("objects are lit by the known room", f32::INFINITY),
        }
    }

    fn amounts(&self) -> Amounts {
        let quality = self.quality;
        let pixels = self.occasion.camera.map_or(0, |(lens, _)| lens.width as usize * lens.height as usize);
        let maps = self.light.hard.as_slice().len();
        let maps = self.occasion.foresight.and_then(|f| f.maps_seen).unwrap_or(maps);
        Amounts {
            pixels,
            vertices: self.scene.objects.iter().map(|o| o.mesh.positions.len()).sum(),
            maps,
            map_texels: quality.shadow_map_texels as usize,
            spheres: self.spheres,
            soft_step_px: quality.soft_step_px as usize,
            near_lights: if self.in_room { quality.shadow_maps.saturating_sub(maps) } else { 0 },
            near_texels: quality.shadow_map_texels as usize / 4,
            coefficients: quality.sh_order * quality.sh_order,
            brackets: quality.brackets,
        }
    }
}

/// Whether light from `to_light` falls on the front of some triangle of a mesh in the world frame.
fn faces_light(mesh: &Mesh, to_light: Vec3) -> bool {
    mesh.triangles.iter().any(|t| {
        let [Some(a), Some(b), Some(c)] = t.map(|i| mesh.positions.get(i as usize)) else { return false };
        let normal = (*b - *a).cross(*c - *a);
        normal.dot(to_light) > 0.0
    })
}

#[cfg(test)]
mod tests;
