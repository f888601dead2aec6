//! What there is in a frame, and what is ruled on each effect for it.

use super::{Effect, LARGEST_ERROR, Pass, bounds, effects::Occasion, view_cone::ViewCone, work::Amounts};
use crate::math::{lens::Lens, pose::Pose, sh::zonal::phong_saturates};
use crate::model::{
    blocker::{SHADER_BOXES, SHADER_SPHERES},
    light::Lights,
    quality::{Effects, Quality, SelfShadow},
    scene::{Material, Mesh, Scene},
};
use glam::Vec3;

/// Why: `Ok` for doing something, `Err` for leaving it out.
pub type Why = Result<&'static str, &'static str>;

/// A pass or an effect that has been looked at: why it is done or left out, and what leaving it out changes at most.
#[derive(Clone, Copy)]
pub struct Ruling {
    /// `Ok` for doing it, `Err` for leaving it out.
    pub why: Why,
    /// As in [`Decision::error_bound`](super::Decision::error_bound).
    pub error_bound: f32,
}

impl Ruling {
    /// Left out because there is nothing for it.
    pub const fn nothing(reason: &'static str) -> Self {
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

/// What was ruled on each effect.
pub struct Rulings {
    of_effects: [Ruling; Effect::ALL.len()],
    /// The camera's own picture is shown as it is.
    pub passes_through: bool,
}

impl Rulings {
    /// What was decided on it.
    pub fn of(&self, effect: Effect) -> Ruling {
        self.of_effects[effect as usize]
    }

    /// On a pass: what was ruled on its effect, where it is the form of it that was chosen.
    pub fn of_pass(&self, pass: Pass, quality: &Quality) -> Ruling {
        let facts = pass.facts();
        let ruling = self.of(facts.effect);
        match (ruling.why, &facts.form) {
            (Ok(reason), Some(form)) if (form.is_chosen)(quality) => {
                Ruling { why: Ok(form.reason.unwrap_or(reason)), ..ruling }
            }
            (Ok(_), Some(form)) => Ruling::nothing(form.otherwise),
            _ => ruling,
        }
    }
}

/// What there is in a frame.
pub struct FrameLook<'a> {
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
    boxes: usize,
    is_glossy: bool,
}

impl<'a> FrameLook<'a> {
    /// Looks at a frame.
    pub fn of(occasion: &'a Occasion<'a>, scene: &'a Scene, light: &'a Lights, quality: &'a Quality) -> Self {
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
            boxes: scene.figures.iter().map(|f| f.boxes.len()).sum(),
            is_glossy: scene.objects.iter().any(|o| glossy(&o.material)),
        }
    }

    /// Rules on every effect.
    pub fn rulings(&self) -> Rulings {
        let occasion = self.occasion;
        let (shadows, soft, near, objects) =
            (self.shadow_maps(), self.soft_shadow(), self.near(), self.objects());
        let surfaces = self.surfaces(shadows, soft);
        let is_virtual = [objects, surfaces, near].iter().any(|ruling| ruling.why.is_ok());
        let passes_through = occasion.draw && occasion.camera_picture && !self.all && !is_virtual;
        let shown = |yes: &'static str, no: &'static str, wanted: bool| {
            if passes_through {
                Ruling::nothing("nothing virtual is in the picture: the camera's own is shown as it is")
            } else {
                Ruling::asked(wanted, yes, no)
            }
        };
        let of_effect = |effect: Effect| match effect {
            Effect::BracketMerge => Ruling::asked(occasion.merge, "a bracket came in", "no bracket to merge"),
            Effect::BallUnwrap => Ruling::asked(
                occasion.ball,
                "the light is read from the ball",
                "the light is not read from a ball now",
            ),
            Effect::ShProjection => Ruling::asked(
                occasion.project || occasion.ball,
                "measured light becomes SH",
                "no light is measured now",
            ),
            Effect::MirrorPicture => self.mirror_picture(objects),
            Effect::ShadowMaps => shadows,
            Effect::ShadowFilter => self.shadow_filter(shadows),
            Effect::SoftShadows => soft,
            Effect::VertexLight => self.vertex_light(objects),
            Effect::IrradianceVolume => self.irradiance_volume(objects),
            Effect::NearMaps | Effect::NearShadows => near,
            Effect::Objects => objects,
            Effect::SurfaceShadows => surfaces,
            Effect::Composition => shown("a picture is drawn", "no picture is drawn", occasion.draw),
            Effect::ToneMapping => {
                let wanted = occasion.draw && occasion.display;
                shown("the picture is shown", "no display output is wanted", wanted)
            }
        };
        Rulings { of_effects: Effect::ALL.map(of_effect), passes_through }
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
        if self.spheres + self.boxes == 0 {
            return Ruling::nothing("no virtual body has spheres");
        }
        if !self.receivers {
            return Ruling::nothing("no real surface receives shadows");
        }
        if self.light.global.rows().iter().flatten().all(|c| *c == 0.0) {
            return Ruling::nothing("no soft light");
        }
        let reason = if self.spheres > SHADER_SPHERES || self.boxes > SHADER_BOXES {
            "virtual bodies stand in soft light over real surfaces; on the CPU with either engine if more than 256 \
             spheres or 128 boxes count: shaders take no more"
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
            Ok(_) if !transfers && self.spheres + self.boxes == 0 => {
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

    /// What the work of the frame depends on.
    pub fn amounts(&self) -> Amounts {
        let quality = self.quality;
        let pixels = self.occasion.camera.map_or(0, |(lens, _)| lens.width as usize * lens.height as usize);
        let maps = self.light.hard.as_slice().len();
        let maps = self.occasion.foresight.and_then(|f| f.maps_seen).unwrap_or(maps);
        Amounts {
            pixels,
            vertices: self.scene.objects.iter().map(|o| o.mesh.positions.len()).sum(),
            maps,
            map_texels: quality.shadow_map_texels as usize,
            spheres: self.spheres + self.boxes,
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
