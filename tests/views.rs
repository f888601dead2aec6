//! Views of every part of a picture: each shows what it says, and together they are the picture.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use glam::{Affine3A, DVec3, Vec3};
use halflight::animate::posed::Posed;
use halflight::assets::shapes;
use halflight::engine::{Engine, RelightInput, cpu::CpuEngine};
use halflight::math::{lens::Lens, pose::Pose};
use halflight::model::{
    animation::Figure,
    frame::Exposure,
    image::HdrImage,
    light::{HardLight, Lights, RadianceSamples, RadianceSh},
    picture::{Picture, PictureView},
    quality::Quality,
    response::Response,
    scene::{Material, RealSurface, Scene, VirtualObject},
    time::Timestamp,
};
use halflight::plan::{FramePlan, Pass};
use halflight::present::views::{Subject, Views};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const BALL: Vec3 = Vec3::new(0.0, 0.0, 0.3);
const RADIUS: f32 = 0.2;

/// A ball above a table, a spotlight and an uneven sky.
struct Place {
    scene: Scene,
    posed: Posed,
    light: Lights,
    lens: Lens,
    pose: Pose,
    background: HdrImage,
    response: Response,
    engine: CpuEngine,
    views: Views,
}

impl Place {
    fn new(material: Material) -> Self {
        let mesh = shapes::icosphere(1.0, 4);
        let openness = vec![0.5; mesh.positions.len()];
        let world_from_object = Affine3A::from_translation(BALL) * Affine3A::from_scale(Vec3::splat(RADIUS));
        let ball = VirtualObject { name: "ball".into(), mesh, material, world_from_object, openness };
        let mut table = shapes::plane_z0(3.0);
        table.tints_rgb.clear();
        let scene = Scene {
            objects: vec![ball],
            surfaces: vec![RealSurface {
                name: "table".into(),
                mesh: table,
                receives_shadow: true,
                albedo_rgb: None,
            }],
            figures: vec![Figure::still(
                "ball".into(),
                0,
                world_from_object,
                [(Vec3::ZERO, 1.0)].into_iter(),
            )],
            transfer: None,
            room: None,
        };
        let mut global = RadianceSh::zero(4);
        global.rgb[0] = [1.2, 1.3, 1.6];
        global.rgb[2] = [0.3, 0.3, 0.5];
        let mut light = Lights::soft(global);
        light.hard.push(HardLight {
            to_light_world: Vec3::new(0.5, 0.3, 0.8).normalize().to_array(),
            irradiance_rgb: [3.0, 2.5, 2.0],
            extent_rad: 0.0,
        });
        let mut background = HdrImage::default();
        background.radiance.reshape(WIDTH, HEIGHT, [0.7, 0.6, 0.5]);
        background.flags.reshape(WIDTH, HEIGHT, 0);
        let mut engine = CpuEngine::new(Some(2)).unwrap();
        engine.load_scene(&scene).unwrap();
        Self {
            posed: Posed::new(&scene),
            scene,
            light,
            lens: Lens::pinhole(WIDTH as u32, HEIGHT as u32, 150.0, 150.0, 80.0, 60.0),
            pose: Pose::look_at(DVec3::new(0.0, -1.6, 1.1), DVec3::new(0.0, 0.0, 0.2), DVec3::Z),
            background,
            response: Response::srgb(),
            engine,
            views: Views::default(),
        }
    }

    fn seen_in(
        &mut self,
        view: PictureView,
        quality: &Quality,
        samples: &RadianceSamples,
    ) -> (Picture, FramePlan) {
        let input = RelightInput {
            background: &self.background,
            lens: &self.lens,
            world_from_camera: &self.pose,
            light: &self.light,
            posed: Some(&self.posed),
            environment: None,
            response: &self.response,
            shown_exposure: Exposure { time_s: 0.5, gain: 1.0 },
            t: Timestamp(7),
        };
        let subject =
            Subject { scene: &self.scene, input: &input, quality, samples: Some(samples), frame: None };
        let (mut plan, mut picture) = (FramePlan::default(), Picture::default());
        self.views.draw(view, &mut self.engine, &subject, &mut plan, &mut picture).unwrap();
        assert_eq!(
            (picture.t, picture.display.width(), picture.display.height()),
            (Timestamp(7), WIDTH, HEIGHT)
        );
        (picture, plan)
    }

    fn radiance(&mut self, view: PictureView) -> Vec<[f32; 3]> {
        self.seen_in(view, &Quality::default(), &RadianceSamples::default()).0.radiance.pixels().to_vec()
    }

    /// The pixel that a point of the world is seen in.
    fn pixel(&self, point: Vec3) -> usize {
        let p = self.lens.project(self.pose.inverse().transform(point.as_dvec3())).unwrap();
        p.y as usize * WIDTH + p.x as usize
    }
}

const MATT: Material = Material::Lambert { albedo_rgb: [0.8, 0.5, 0.3] };

#[test]
fn both_halves_together_are_the_picture() {
    let mut place = Place::new(MATT);
    let whole = place.radiance(PictureView::Final);
    let (direct, global) = (place.radiance(PictureView::Direct), place.radiance(PictureView::Global));
    let on_ball = place.pixel(BALL + RADIUS * Vec3::new(0.3, -0.8, 0.5).normalize());
    for c in 0..3 {
        let sum = direct[on_ball][c] + global[on_ball][c];
        assert!(
            (sum - whole[on_ball][c]).abs() < 1e-6 && direct[on_ball][c] > 0.05 && global[on_ball][c] > 0.05
        );
    }
    // Beside the ball and its shadows: gray of albedo 1/2 in each half.
    let far = place.pixel(Vec3::new(-0.9, 0.3, 0.0));
    let cosine = place.light.hard.as_slice()[0].to_light_world[2];
    let expected = 0.5 * 3.0 * cosine / std::f32::consts::PI;
    assert!((direct[far][0] - expected).abs() < 1e-5, "{} {expected}", direct[far][0]);
    // In the hard shadow there is no direct light, and soft light all the same.
    let shadow = place.pixel(Vec3::new(-0.5 / 0.8 * 0.3, -0.3 / 0.8 * 0.3, 0.0));
    assert!(direct[shadow] == [0.0; 3] && global[shadow][0] > 0.1, "{:?}", direct[shadow]);
    assert!(global[shadow][0] < 0.9 * global[far][0], "soft light is blocked under the ball");
}

#[test]
fn cast_shadows_are_the_ratio_on_white() {
    let mut place = Place::new(MATT);
    let (cast, plan) = place.seen_in(PictureView::Cast, &Quality::default(), &RadianceSamples::default());
    assert!(plan.has(Pass::ShadeSurface) && !plan.has(Pass::ShadeObject));
    assert!(plan.left_out.iter().any(|p| p.pass == Pass::ShadeObject && p.reason.contains("view")));
    let whole = place.radiance(PictureView::Final);
    for point in [Vec3::new(-0.19, -0.11, 0.0), Vec3::new(-0.9, 0.3, 0.0), Vec3::new(0.3, -0.2, 0.0)] {
        let i = place.pixel(point);
        for c in 0..3 {
            let ratio = whole[i][c] / [0.7, 0.6, 0.5][c];
            assert!((cast.radiance.pixels()[i][c] - 0.9 * ratio).abs() < 1e-5, "{point}");
        }
    }
    let shadow = place.pixel(Vec3::new(-0.19, -0.11, 0.0));
    assert!(cast.radiance.pixels()[shadow][0] < 0.6);
    // The display is sRGB of the share, whatever the exposure.
    let far = place.pixel(Vec3::new(-0.9, 0.3, 0.0));
    assert!(cast.display.pixels()[far][0] > 235, "{:?}", cast.display.pixels()[far]);
}

#[test]
fn self_shadows_are_openness_on_white() {
    let mut place = Place::new(MATT);
    let seen = place.radiance(PictureView::SelfShadow);
    let on_ball = place.pixel(BALL);
    for c in 0..3 {
        assert!((seen[on_ball][c] - 0.9 * 0.5).abs() < 1e-5, "{:?}", seen[on_ball]);
        assert_eq!(seen[0][c], 0.2);
    }
}

#[test]
fn materials_are_those_of_scenes_that_have_them() {
    let views = [
        (PictureView::Lambert, Material::Lambert { albedo_rgb: [0.75; 3] }),
        (
            PictureView::Phong,
            Material::Phong { albedo_rgb: [0.15; 3], specular_rgb: [0.6; 3], exponent: 16.0 },
        ),
        (PictureView::Mirror, Material::Mirror { reflectance_rgb: [0.9; 3] }),
    ];
    let mut place = Place::new(MATT);
    for (view, material) in views {
        let seen = place.radiance(view);
        assert_eq!(seen, Place::new(material).radiance(PictureView::Final), "{view:?}");
        assert_ne!(seen, Place::new(MATT).radiance(PictureView::Final));
    }
}

#[test]
fn the_picture_comes_back_after_every_view() {
    let mut place = Place::new(MATT);
    let before = place.radiance(PictureView::Final);
    for view in PictureView::ALL {
        let first = place.radiance(view);
        assert_eq!(place.radiance(view), first, "{view:?} is not the same twice");
        assert_eq!(place.radiance(PictureView::Final), before, "after {view:?}");
    }
}

#[test]
fn blockers_are_drawn_where_they_are() {
    let mut place = Place::new(MATT);
    let seen = place.radiance(PictureView::Blockers);
    // The sphere of the ball is the ball: another colour in the same outline.
    let whole = place.radiance(PictureView::Final);
    let on_ball = place.pixel(BALL);
    assert_ne!(seen[on_ball], whole[on_ball]);
    assert_ne!(seen[on_ball], [0.7, 0.6, 0.5]);
    let above = place.pixel(BALL + Vec3::new(0.0, 0.0, 1.4 * RADIUS));
    assert_eq!(seen[above], [0.7, 0.6, 0.5]);
}

#[test]
fn the_light_shows_where_it_is() {
    let mut place = Place::new(MATT);
    let to_light = Vec3::from(place.light.hard.as_slice()[0].to_light_world);
    // Measured: radiance 1 above, 0 below.
    let mut samples = RadianceSamples::default();
    for k in 0..4000 {
        let z = 1.0 - (k as f32 + 0.5) / 2000.0;
        let (s, c) = (2.399_963_3 * k as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        samples.directions.push([r * c, r * s, z, std::f32::consts::PI / 1000.0]);
        samples.radiance.push([if z > 0.0 { 1.0 } else { 0.0 }; 4]);
    }
    let (picture, plan) = place.seen_in(PictureView::Light, &Quality::default(), &samples);
    assert!(plan.passes.is_empty());
    // Panels of 74 x 37: (160 - 3 * 4) / 4 rows; left at 4, top at (120 - 78) / 2.
    let (columns, rows, left, top) = (74usize, 37usize, 4usize, 21usize);
    let at = |k: usize, d: Vec3| {
        let (u, v) = halflight::math::sphere::equirect_uv(d.as_dvec3());
        let x = left + (k % 2) * (columns + 4) + (u * columns as f64) as usize;
        let y = top + (k / 2) * (rows + 4) + (v * rows as f64) as usize;
        picture.radiance.at(x, y)[1]
    };
    let away = Vec3::new(-0.6, -0.5, 0.3).normalize();
    // Radiance 1 is what nine tenths lie below: 1/2.
    assert!((at(0, Vec3::new(0.1, 0.1, 1.0)) - 0.5).abs() < 0.01, "as measured");
    assert!(at(0, Vec3::new(0.1, 0.1, -1.0)) < 0.01, "as measured");
    assert!(at(1, to_light) > 1.3 * at(1, away), "all of it in SH");
    assert!(at(2, to_light) > 0.9 && at(2, away) == 0.0, "the hard half");
    assert!(at(3, Vec3::Z) > at(3, -Vec3::Z) && at(3, to_light) < at(1, to_light), "the soft half");
}

#[test]
fn every_shadow_map_is_on_the_sheet() {
    let mut place = Place::new(MATT);
    let lit = |place: &mut Place| {
        let quality = Quality { shadow_map_texels: 128, ..Quality::default() };
        let (picture, _) = place.seen_in(PictureView::Maps, &quality, &RadianceSamples::default());
        let near = picture.radiance.pixels().iter().filter(|c| c[0] > 0.1).count();
        (near as f32 / (WIDTH * HEIGHT) as f32, picture)
    };
    // One map: a disc that nearly fills a square of 116 pixels.
    let (share, picture) = lit(&mut place);
    assert!((0.3..0.75).contains(&share), "{share}");
    let centre = picture.radiance.at(WIDTH / 2, HEIGHT / 2)[0];
    // The middle of the ball is nearest.
    assert!(centre > 0.85, "{centre}");
    for k in 1..4 {
        let to_light_world = Vec3::new(0.2 * k as f32, -0.3, 0.8).normalize().to_array();
        place.light.hard.push(HardLight { to_light_world, irradiance_rgb: [1.0; 3], extent_rad: 0.0 });
    }
    let (share, _) = lit(&mut place);
    assert!((0.25..0.75).contains(&share), "{share}");
    place.light.hard = halflight::model::light::HardLights::none();
    assert_eq!(lit(&mut place).0, 0.0);
}
