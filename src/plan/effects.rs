//! What a frame needs, decided from what there is: objects, light, camera and what the caller wants.

use super::{FramePlan, Pass, PlannedPass};
use crate::math::{lens::Lens, pose::Pose};
use crate::model::{
    blocker::SHADER_SPHERES,
    light::Lights,
    quality::{NearForm, Quality},
    scene::{Scene, VirtualObject},
};
use glam::{DVec2, DVec3, Vec3};

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
}

impl Occasion<'_> {
    /// A picture drawn and shown with light that is known already.
    pub const SHOW: Self =
        Self { merge: false, ball: false, project: false, draw: true, display: true, camera: None };
}

/// Writes the passes of one frame into `out` (memory is reused): each that the frame calls for with its
/// reason, and each left out with its reason.
///
/// In a known room its own lights are drawn instead of the far light's halves: `PointMaps` and `Subtract` where objects may
/// hide some of them, or `SubtractDisplayed` in its place (`Quality::near_form`): it subtracts from what an 8-bit display shows
/// of the place alone, before any object is drawn over it, so that objects need no mask and keep their clean edges, and hands
/// on what is left as a ratio, so that all later passes are the same; `SoftShadow` and `ShadeSurface` not at all; `ShadowMaps` for the suns that shine in. Elsewhere:
///
/// * `ShadowMaps`: a hard light that shines, an object that can cast, and something lit to cast on:
///   an object in view, or a receiving surface that faces the light.
/// * `SoftShadow`: soft light, a surface that receives shadows, and a body with spheres. Its reason says where it has
///   more of them than shaders take, so that it runs on the CPU twin with either engine.
/// * `ShadeSurface`: with `ShadowMaps`, where a receiving surface faces a hard light, or with `SoftShadow`.
/// * `ShadeObject`: an object is in view.
/// * `Composite`: a picture is drawn. `Tonemap`: it is shown.
pub fn plan(occasion: &Occasion<'_>, scene: &Scene, light: &Lights, quality: &Quality, out: &mut FramePlan) {
    out.passes.clear();
    out.left_out.clear();
    out.passes.reserve(Pass::ALL.len());
    out.left_out.reserve(Pass::ALL.len());
    out.quality = *quality;

    let draw = occasion.draw;
    let objects = scene.objects.iter().any(|o| !o.mesh.triangles.is_empty());
    let seen = objects
        && occasion.camera.is_none_or(|(lens, pose)| {
            let cone = ViewCone::new(lens, pose);
            // What moves may be anywhere.
            scene.figures.iter().any(|f| !f.is_still() && !f.parts.is_empty())
                || scene.objects.iter().any(|o| cone.may_see(o))
        });
    let hard = || {
        let shines = |e: &[f32; 3]| e.iter().any(|&e| e > 0.0 && e.is_finite());
        light
            .hard
            .as_slice()
            .iter()
            .filter(move |h| shines(&h.irradiance_rgb))
            .map(|h| Vec3::from(h.to_light_world))
    };
    let lit = hard().next().is_some();
    let receivers = scene.surfaces.iter().any(|s| s.receives_shadow);
    let faces = hard().any(|w| scene.surfaces.iter().any(|s| s.receives_shadow && faces_light(&s.mesh, w)));

    let mut decide = |pass: Pass, why: Result<&'static str, &'static str>| match why {
        Ok(reason) => out.passes.push(PlannedPass { pass, reason }),
        Err(reason) => out.left_out.push(PlannedPass { pass, reason }),
    };
    let asked = |wanted: bool, yes: &'static str, no: &'static str| if wanted { Ok(yes) } else { Err(no) };

    decide(Pass::MergeBracket, asked(occasion.merge, "a bracket came in", "no bracket to merge"));
    decide(
        Pass::UnwrapBall,
        asked(occasion.ball, "the light is read from the ball", "the light is not read from a ball now"),
    );
    decide(
        Pass::ProjectSh,
        asked(occasion.project || occasion.ball, "measured light becomes SH", "no light is measured now"),
    );
    let in_room = scene.room.is_some();
    let near = if !in_room {
        Err("no known room")
    } else if !draw {
        Err("no picture is drawn")
    } else if !objects {
        Err("no virtual object hides any light")
    } else {
        Ok("virtual objects stand in a known room")
    };
    let shadows = if !draw {
        Err("no picture is drawn")
    } else if !objects {
        Err("no virtual object casts a shadow")
    } else if !lit {
        Err("no hard light")
    } else if seen {
        Ok("virtual objects in view stand in hard light")
    } else if in_room {
        Ok("the sun shines into the known room")
    } else if faces {
        Ok("shadows of objects out of view fall on real surfaces")
    } else {
        Err("the hard light reaches nothing in view")
    };
    decide(Pass::ShadowMaps, shadows);
    let spheres: usize = scene.figures.iter().map(|f| f.spheres.len()).sum();
    let soft = if !draw {
        Err("no picture is drawn")
    } else if in_room {
        Err("the known room's own lights throw the shadows")
    } else if spheres == 0 {
        Err("no virtual body has spheres")
    } else if !receivers {
        Err("no real surface receives shadows")
    } else if light.global.rows().iter().flatten().all(|c| *c == 0.0) {
        Err("no soft light")
    } else {
        Ok(if spheres > SHADER_SPHERES {
            "virtual bodies stand in soft light over real surfaces; on the CPU with either engine if more than 256 \
             spheres count: shaders take no more"
        } else {
            "virtual bodies stand in soft light over real surfaces"
        })
    };
    decide(Pass::SoftShadow, soft);
    decide(Pass::PointMaps, near);
    let (ratio, displayed) = match (near, quality.near_form) {
        (Err(reason), _) => (Err(reason), Err(reason)),
        (Ok(reason), NearForm::Ratio) => {
            (Ok(reason), Err("the known room's light is taken in linear light, as a ratio"))
        }
        (Ok(_), NearForm::Ldr) => (
            Err("the known room's light is taken from 8-bit values"),
            Ok("virtual objects stand in a known room, and 8-bit values were asked for"),
        ),
    };
    decide(Pass::Subtract, ratio);
    decide(Pass::SubtractDisplayed, displayed);
    let shade = if !draw {
        Err("no picture is drawn")
    } else if !objects {
        Err("no virtual object")
    } else if !seen {
        Err("every virtual object is out of view")
    } else {
        Ok("virtual objects are in view")
    };
    decide(Pass::ShadeObject, shade);
    let surface = if in_room {
        Err("the known room's own lights throw the shadows")
    } else if soft.is_ok() {
        Ok("soft light is blocked over a receiving surface")
    } else if shadows.is_err() {
        shadows
    } else if !receivers {
        Err("no real surface receives shadows")
    } else if !faces {
        Err("the hard light is below every receiving surface")
    } else {
        Ok("a receiving surface faces a hard light")
    };
    decide(Pass::ShadeSurface, surface);
    decide(Pass::Composite, asked(draw, "a picture is drawn", "no picture is drawn"));
    decide(
        Pass::Tonemap,
        asked(draw && occasion.display, "the picture is shown", "no display output is wanted"),
    );
}

/// Whether light from `to_light` falls on the front of some triangle of a mesh in the world frame.
fn faces_light(mesh: &crate::model::scene::Mesh, to_light: Vec3) -> bool {
    mesh.triangles.iter().any(|t| {
        let [Some(a), Some(b), Some(c)] = t.map(|i| mesh.positions.get(i as usize)) else { return false };
        let normal = (*b - *a).cross(*c - *a);
        normal.dot(to_light) > 0.0
    })
}

/// A cone around the camera's axis that holds the whole picture.
struct ViewCone {
    eye: DVec3,
    axis: DVec3,
    half_angle_rad: f64,
}

impl ViewCone {
    fn new(lens: &Lens, world_from_camera: &Pose) -> Self {
        let (w, h) = (f64::from(lens.width), f64::from(lens.height));
        // The widest rays of a picture lie on its border.
        let mut half_angle_rad = 0.0f64;
        for k in 0..=8 {
            let t = f64::from(k) / 8.0;
            for p in [(t * w, 0.0), (t * w, h), (0.0, t * h), (w, t * h)] {
                let angle = lens
                    .unproject(DVec2::new(p.0, p.1))
                    .map_or(std::f64::consts::PI, |d| d.z.clamp(-1.0, 1.0).acos());
                half_angle_rad = half_angle_rad.max(angle);
            }
        }
        Self {
            eye: world_from_camera.translation,
            axis: world_from_camera.rotate(DVec3::Z),
            half_angle_rad: half_angle_rad + 0.01,
        }
    }

    /// Whether the bounding sphere of an object reaches into the cone.
    fn may_see(&self, object: &VirtualObject) -> bool {
        let mut low = Vec3::INFINITY;
        let mut high = Vec3::NEG_INFINITY;
        for &p in &object.mesh.positions {
            low = low.min(p);
            high = high.max(p);
        }
        if !(low.is_finite() && high.is_finite()) {
            return false;
        }
        let to_world = object.world_from_object;
        let centre = to_world.transform_point3(0.5 * (low + high));
        let half = 0.5 * (high - low);
        let m = to_world.matrix3;
        let reach = Vec3::from(m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z);
        let radius_m = f64::from(reach.length());
        let to_centre = centre.as_dvec3() - self.eye;
        let distance_m = to_centre.length();
        if distance_m <= radius_m {
            return true;
        }
        let off_axis = self.axis.dot(to_centre / distance_m).clamp(-1.0, 1.0).acos();
        off_axis <= self.half_angle_rad + (radius_m / distance_m).asin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{
        blocker::Rung,
        light::{HardLight, RadianceSh},
        scene::{Material, Mesh, RealSurface},
    };
    use glam::Affine3A;

    fn mesh() -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            tints_rgb: vec![[1.0; 3]; 3],
            triangles: vec![[0, 1, 2]],
        }
    }

    fn scene(objects: usize, receives: Option<bool>) -> Scene {
        let object = VirtualObject {
            name: "o".into(),
            mesh: mesh(),
            material: Material::Lambert { albedo_rgb: [0.5; 3] },
            world_from_object: Affine3A::IDENTITY,
            openness: vec![1.0; 3],
        };
        let surface = |receives_shadow| RealSurface {
            name: "s".into(),
            mesh: mesh(),
            receives_shadow,
            albedo_rgb: None,
        };
        Scene {
            objects: vec![object; objects],
            surfaces: receives.map(surface).into_iter().collect(),
            ..Scene::default()
        }
    }

    fn sun(to_light_world: [f32; 3], e: f32) -> Lights {
        let mut lights = Lights::soft(RadianceSh::zero(4));
        lights.hard.push(HardLight { to_light_world, irradiance_rgb: [e; 3], extent_rad: 0.0 });
        lights
    }

    fn passes(occasion: &Occasion<'_>, scene: &Scene, light: &Lights) -> Vec<Pass> {
        let mut out = FramePlan::default();
        plan(occasion, scene, light, &Quality::default(), &mut out);
        let mut all: Vec<Pass> = out.passes.iter().chain(&out.left_out).map(|p| p.pass).collect();
        all.sort();
        assert_eq!(all, Pass::ALL, "every pass is either planned or left out");
        assert!(out.passes.is_sorted_by_key(|p| p.pass), "in the order of the frame");
        out.passes.iter().map(|p| p.pass).collect()
    }

    const UP: [f32; 3] = [0.0, 0.0, 1.0];
    const DOWN: [f32; 3] = [0.0, 0.0, -1.0];

    #[test]
    fn only_what_the_scene_calls_for() {
        use Pass::{Composite, ShadeObject, ShadeSurface, ShadowMaps, Tonemap};
        let show = Occasion::SHOW;
        let full = scene(1, Some(true));
        assert_eq!(
            passes(&show, &full, &sun(UP, 2.0)),
            [ShadowMaps, ShadeObject, ShadeSurface, Composite, Tonemap]
        );
        // No sun, or a sun without power, or below the ground: no shadow on it.
        let dark = Lights::soft(RadianceSh::zero(4));
        for light in [dark, sun(UP, 0.0), sun(UP, -1.0)] {
            assert_eq!(passes(&show, &full, &light), [ShadeObject, Composite, Tonemap]);
        }
        assert_eq!(passes(&show, &full, &sun(DOWN, 2.0)), [ShadowMaps, ShadeObject, Composite, Tonemap]);
        // A surface that only hides, or none.
        for surfaces in [Some(false), None] {
            let out = passes(&show, &scene(1, surfaces), &sun(UP, 2.0));
            assert_eq!(out, [ShadowMaps, ShadeObject, Composite, Tonemap]);
        }
        // Nothing virtual.
        assert_eq!(passes(&show, &scene(0, Some(true)), &sun(UP, 2.0)), [Composite, Tonemap]);
        let linear = Occasion { display: false, ..show };
        assert_eq!(passes(&linear, &scene(0, None), &sun(UP, 2.0)), [Composite]);
    }

    #[test]
    fn the_reason_says_what_no_shader_can_do() {
        let mut place = scene(1, Some(true));
        let light = |order| {
            let mut global = RadianceSh::zero(order);
            global.rgb[0] = [1.0; 3];
            Lights::soft(global)
        };
        let reason = |place: &Scene, rung, order| {
            let mut out = FramePlan::default();
            let quality = Quality { rung, sh_order: order, ..Quality::default() };
            plan(&Occasion::SHOW, place, &light(order), &quality, &mut out);
            out.passes.iter().find(|p| p.pass == Pass::SoftShadow).expect("soft shadows").reason
        };
        let body = |count| {
            let spheres = (0..count).map(|k| (Vec3::X * k as f32, 0.1));
            crate::model::animation::Figure::still("body".into(), 0, Affine3A::IDENTITY, spheres)
        };
        place.figures = vec![body(128), body(128)];
        for rung in Rung::ALL {
            for order in 2..=6 {
                assert!(!reason(&place, rung, order).contains("CPU"), "{} {order}", rung.name());
            }
        }
        place.figures = vec![body(128), body(128), body(1)];
        assert!(reason(&place, Rung::Directions, 4).contains("more than 256 spheres"));
    }

    #[test]
    fn a_known_room_is_drawn_by_its_own_light() {
        use Pass::{Composite, PointMaps, ShadeObject, ShadowMaps, Subtract, Tonemap};
        let mut place = scene(1, Some(true));
        place.room = Some(std::sync::Arc::default());
        let mut light = Lights::soft(RadianceSh::zero(4));
        light.global.rgb[0] = [1.0; 3];
        // Soft light alone, as of a room: no halves of far light.
        let near = [PointMaps, Subtract, ShadeObject, Composite, Tonemap];
        assert_eq!(passes(&Occasion::SHOW, &place, &light), near);
        // A sun shines in: the objects' map under it, too, even where no real surface outside of the room faces it.
        for to_light in [UP, DOWN] {
            let with_sun = [ShadowMaps, PointMaps, Subtract, ShadeObject, Composite, Tonemap];
            assert_eq!(passes(&Occasion::SHOW, &place, &sun(to_light, 2.0)), with_sun);
        }
        // From 8-bit values instead.
        let mut out = FramePlan::default();
        let ldr = Quality { near_form: NearForm::Ldr, ..Quality::default() };
        plan(&Occasion::SHOW, &place, &light, &ldr, &mut out);
        assert!(out.has(Pass::SubtractDisplayed) && !out.has(Subtract) && out.has(PointMaps));
        // Nothing virtual: nothing is taken.
        place.objects.clear();
        assert_eq!(passes(&Occasion::SHOW, &place, &sun(UP, 2.0)), [Composite, Tonemap]);
    }

    #[test]
    fn measuring_and_drawing_are_independent() {
        use Pass::{MergeBracket, ProjectSh, UnwrapBall};
        let measure = Occasion { merge: true, ball: true, ..Occasion::default() };
        let out = passes(&measure, &scene(1, Some(true)), &sun(UP, 2.0));
        assert_eq!(out, [MergeBracket, UnwrapBall, ProjectSh]);
        let map = Occasion { project: true, ..Occasion::default() };
        assert_eq!(passes(&map, &scene(0, None), &sun(UP, 2.0)), [ProjectSh]);
    }

    #[test]
    fn objects_out_of_view_still_throw_shadows_into_it() {
        use Pass::{Composite, ShadeObject, ShadeSurface, ShadowMaps, Tonemap};
        let lens = Lens::pinhole(64, 48, 60.0, 60.0, 32.0, 24.0);
        let at = Pose::look_at(DVec3::new(0.3, -4.0, 1.0), DVec3::new(0.3, 0.3, 0.0), DVec3::Z);
        let away = Pose::look_at(DVec3::new(0.3, -4.0, 1.0), DVec3::new(0.3, -9.0, 0.0), DVec3::Z);
        let full = scene(1, Some(true));
        let with = |pose| {
            let occasion = Occasion { camera: Some((&lens, pose)), ..Occasion::SHOW };
            passes(&occasion, &full, &sun(UP, 2.0))
        };
        assert_eq!(with(&at), [ShadowMaps, ShadeObject, ShadeSurface, Composite, Tonemap]);
        assert_eq!(with(&away), [ShadowMaps, ShadeSurface, Composite, Tonemap]);
    }
}
