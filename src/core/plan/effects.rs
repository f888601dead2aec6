//! What a frame needs, decided from what there is: objects, light, camera, what the caller wants, and what has changed.

use super::{
    Decision, Effect, EffectVerdict, Foresight, FramePlan, Pass, PassSet, PlannedPass,
    look::{FrameLook, Ruling, Rulings},
    work::Amounts,
};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    blocker::BlockerSphere,
    light::Lights,
    quality::{Effects, Quality},
    scene::Scene,
};

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

/// Writes the passes of one frame into `out` (memory is reused): each that the frame calls for with its
/// reason, and each left out with its reason; and the decision on each effect.
///
/// In a known room its own lights are drawn instead of the far light's halves: `PointMaps` and `Subtract` where objects may
/// hide some of them, or another form of it (`Quality::near_form`), which subtracts from what an 8-bit display shows
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

    let look = FrameLook::of(occasion, scene, light, quality);
    let rulings = look.rulings();
    out.passes_through = rulings.passes_through;
    let all = quality.effects == Effects::All;
    let frame = UndecidedFrame {
        used: PassSet::where_true(|pass| rulings.of_pass(pass, quality).why.is_ok()),
        foresight: occasion.foresight.filter(|_| !all).unwrap_or(&Foresight::NONE),
        amounts: look.amounts(),
        rulings,
        quality,
        all,
    };
    for pass in Pass::ALL {
        match frame.rulings.of_pass(pass, quality).why {
            Ok(_) if frame.is_kept(pass) => out.kept.push(PlannedPass { pass, reason: kept_because(pass) }),
            Ok(reason) => out.passes.push(PlannedPass { pass, reason }),
            Err(reason) => out.left_out.push(PlannedPass { pass, reason }),
        }
    }
    out.decisions.extend(Effect::ALL.into_iter().map(|effect| frame.decision(effect)));
}

/// Why the result of an earlier frame will do.
fn kept_because(pass: Pass) -> &'static str {
    pass.facts().kept_because.unwrap_or_default()
}

/// A frame while it is decided on.
struct UndecidedFrame<'a> {
    rulings: Rulings,
    used: PassSet,
    foresight: &'a Foresight,
    amounts: Amounts,
    quality: &'a Quality,
    all: bool,
}

impl UndecidedFrame<'_> {
    /// What a pass reads has to be kept, too, or to come out the same; the engine has seen to that.
    fn is_kept(&self, pass: Pass) -> bool {
        self.used.has(pass) && self.foresight.holds(pass, self.used)
    }

    fn decision(&self, effect: Effect) -> Decision {
        match effect.part_of() {
            Some(whole) => self.of_part(effect, whole),
            None => self.of_pass(effect),
        }
    }

    /// On an effect that a pass draws.
    fn of_pass(&self, effect: Effect) -> Decision {
        let is_chosen = |pass: &Pass| {
            let facts = pass.facts();
            facts.effect == effect && facts.form.as_ref().is_none_or(|form| (form.is_chosen)(self.quality))
        };
        let pass = Pass::ALL.into_iter().find(is_chosen);
        let ruling =
            pass.map_or(Ruling::nothing("no pass draws it"), |p| self.rulings.of_pass(p, self.quality));
        let (verdict, reason) = match (ruling.why, pass) {
            (Ok(_), Some(pass)) if self.is_kept(pass) => (EffectVerdict::Kept, kept_because(pass)),
            (Ok(reason), _) => (EffectVerdict::On, reason),
            (Err(reason), _) => (EffectVerdict::Off, reason),
        };
        let units = pass.map_or(0.0, |pass| self.amounts.of(pass));
        decided(effect, ruling, verdict, reason, units)
    }

    /// On an effect that is a part of a pass.
    fn of_part(&self, effect: Effect, whole: Pass) -> Decision {
        let ruling = self.rulings.of(effect);
        let (units, held) = self.cost_and_held(effect);
        let (verdict, reason) = match (ruling.why, held) {
            (Err(reason), _) => (EffectVerdict::Off, reason),
            (Ok(_), _) if self.is_kept(whole) => (EffectVerdict::Kept, "what it goes into is kept"),
            (Ok(_), Some(reason)) if !self.all => (EffectVerdict::Kept, reason),
            (Ok(reason), _) => (EffectVerdict::On, reason),
        };
        decided(effect, ruling, verdict, reason, units)
    }

    /// Work of a part, and why an earlier frame's will do, where it will.
    fn cost_and_held(&self, effect: Effect) -> (f32, Option<&'static str>) {
        let (amounts, foresight) = (&self.amounts, self.foresight);
        match effect {
            Effect::MirrorPicture => {
                let is_held = foresight.mirror_picture_is_held;
                (amounts.pixels(), is_held.then_some("no new picture of the place came in"))
            }
            Effect::VertexLight => {
                let is_held = foresight.vertex_light_is_held;
                let reason = "light, objects and what is near them are as they were";
                (amounts.vertex_light(), is_held.then_some(reason))
            }
            Effect::ShadowFilter => {
                let taps = (amounts.pixels * self.quality.pcf_taps.pow(2) as usize) as f32;
                (0.1 * taps, None)
            }
            Effect::IrradianceVolume => (10.0 * amounts.vertices as f32, None),
            _ => (0.0, None),
        }
    }
}

fn decided(
    effect: Effect,
    ruling: Ruling,
    verdict: EffectVerdict,
    reason: &'static str,
    units: f32,
) -> Decision {
    let error_bound = if verdict == EffectVerdict::Kept { 0.0 } else { ruling.error_bound };
    Decision { effect, verdict, reason, saving: units * 1e-6, error_bound }
}

#[cfg(test)]
mod tests;
