//! Each kernel on the device against its CPU twin, on every backend that is found. Software adapters will do.

#[path = "support/gles.rs"]
mod gles;
mod support;
#[path = "support/twin_scene.rs"]
mod twin_scene;
#[path = "support/twin_shot.rs"]
mod twin_shot;

use halflight::light::unwrap_ball::BallShot;
use twin_scene::scene;
use twin_shot::Shot;

use std::sync::{Mutex, PoisonError};

use halflight::{
    engine::{
        Bracket, Engine, LightJob, RelightInput, SensorBracket, Timings,
        cpu::CpuEngine,
        gpu::{Backend, GpuEngine},
    },
    hdr::merge_bracket::{merge_bracket, merge_sensor},
    math::{
        dice::Dice,
        lens::{Distortion, Lens},
        pose::Pose,
        sh::basis,
    },
    model::{
        frame::Exposure,
        image::{HdrImage, Image, Rgb8Image},
        light::RadianceSamples,
        picture::Picture,
        quality::Quality,
        response::Response,
        rig::MirrorBall,
        sensor::{CLIPPED, SensorImage, SensorScale, UNSEEN},
        time::Timestamp,
    },
    plan::Pass,
};

use glam::DVec3;

fn merge_matches(engine: &mut GpuEngine) {
    let mut dice = Dice::new(1);
    // Not a multiple of 4 pixels, so that the last word is padded.
    let (width, height) = (161, 119);
    for count in [1usize, 3, 9] {
        let mut pictures: Vec<Rgb8Image> = (0..count)
            .map(|_| {
                let pixels = (0..width * height)
                    .map(|_| [(); 3].map(|()| (dice.unit_f32() * 300.0 - 22.0).clamp(0.0, 255.0) as u8))
                    .collect();
                Rgb8Image::from_pixels(width, height, pixels).expect("as many as were made")
            })
            .collect();
        // Pixels that are 0 and 255 in every combination.
        for (k, picture) in pictures.iter_mut().enumerate() {
            for i in 0..512 {
                picture.pixels_mut()[i] = [(); 3].map(|()| if i >> k & 1 == 1 { 255 } else { 0 });
            }
        }
        let exposures: Vec<_> =
            (0..count).map(|k| Exposure { time_s: 0.001 * 2f64.powi(k as i32), gain: 1.5 }).collect();
        let pictures: Vec<_> = pictures.iter().collect();
        let response = Response::srgb();
        let (mut device, mut twin) = (HdrImage::default(), HdrImage::default());
        let bracket = Bracket { pictures: &pictures, exposures: &exposures };
        engine.merge_bracket(&bracket, &response, &mut device).expect("a sound bracket");
        merge_bracket(&pictures, &exposures, &response, &mut twin).expect("a sound bracket");
        assert_eq!(device.flags, twin.flags);
        assert_eq!((device.radiance.width(), device.radiance.height()), (width, height));
        let worst = largest_ratio(&device, &twin);
        println!("merge of {count}: {worst:.1e}");
        // Measured 1.2e-7: the same operations in the same order. A device may fuse multiply and add and divide
        // to 2.5 units in the last place; the logarithm (up to 8 in size) enters with its absolute error.
        assert!(worst < 1e-6, "merge of {count}: relative difference {worst}");
    }
}

/// Largest relative difference; what is 0 on both sides has none.
fn largest_ratio(device: &HdrImage, twin: &HdrImage) -> f64 {
    let pairs = device.radiance.pixels().as_flattened().iter().zip(twin.radiance.pixels().as_flattened());
    pairs.map(|(d, t)| if d == t { 0.0 } else { f64::from((d / t - 1.0).abs()) }).fold(0.0, f64::max)
}

/// What sensors gave: values of all sizes, among them those that are unseen, black, nearly saturated and clipped.
fn sensor_merge_matches(engine: &mut GpuEngine) {
    let mut dice = Dice::new(13);
    let (width, height) = (161, 119);
    for count in [1usize, 3, 9] {
        let pictures: Vec<SensorImage> = (0..count)
            .map(|k| {
                let mut value = || match dice.unit_f32() * 8.0 {
                    kind if kind < 1.0 => [UNSEEN, CLIPPED, 1024, 61_999][(kind * 4.0) as usize],
                    kind if kind < 3.0 => 900 + (dice.unit_f32() * 300.0) as u16,
                    _ => (dice.unit_f32() * 65_535.0) as u16,
                };
                let pixels = (0..width * height).map(|_| [value(), value(), value()]).collect();
                SensorImage {
                    values: Image::from_pixels(width, height, pixels).expect("as many as were made"),
                    scale: SensorScale {
                        black: 1024.0 + k as f32,
                        saturated: 62_000,
                        step: 16.0,
                        exposure_per_value: [1.7e-5, 1e-5, 2.1e-5],
                    },
                }
            })
            .collect();
        let exposures: Vec<_> = (0..count)
            .map(|k| Exposure { time_s: 0.001 * 2f64.powi(k as i32), gain: 1.0 + k as f64 })
            .collect();
        let pictures: Vec<_> = pictures.iter().collect();
        let (mut device, mut twin) = (HdrImage::default(), HdrImage::default());
        let bracket = SensorBracket { pictures: &pictures, exposures: &exposures };
        engine.merge_sensor(&bracket, &mut device).expect("a sound bracket");
        merge_sensor(&pictures, &exposures, &mut twin).expect("a sound bracket");
        let differing = device.flags.pixels().iter().zip(twin.flags.pixels()).filter(|(d, t)| d != t).count();
        let worst = largest_ratio(&device, &twin);
        println!("merge of {count} from sensors: {worst:.1e}, {differing} flags differ");
        // A sum near black may have lost digits, and lie on either side of half a step.
        assert!(worst < 1e-4 && differing <= 2, "merge of {count} from sensors: {worst}, {differing}");
    }
}

fn projection_matches_and_repeats(engine: &mut GpuEngine) {
    let mut dice = Dice::new(2);
    for (count, order) in [(1usize, 6usize), (255, 2), (5000, 4), (70_001, 6)] {
        let mut samples = RadianceSamples::default();
        for _ in 0..count {
            let d = glam::Vec3::new(dice.unit_f32() - 0.5, dice.unit_f32() - 0.5, dice.unit_f32() - 0.5)
                .normalize();
            samples.directions.push([d.x, d.y, d.z, dice.unit_f32() * 1e-3]);
            let bright = if dice.unit_f32() > 0.999 { 1e5 } else { 1.0 };
            samples.radiance.push([dice.unit_f32() * bright, dice.unit_f32(), dice.unit_f32(), 0.0]);
        }
        let device = engine.project_sh(&samples, order).expect("sums");
        let mut exact = [[0.0f64; 3]; 36];
        let mut size = [0.0f64; 3];
        for (d, l) in samples.directions.iter().zip(&samples.radiance) {
            let mut y = [0.0f64; 36];
            basis::evaluate(order, [f64::from(d[0]), f64::from(d[1]), f64::from(d[2])], &mut y);
            for c in 0..3 {
                let weighted = f64::from(d[3]) * f64::from(l[c]);
                size[c] += weighted;
                for (sum, y) in exact.iter_mut().zip(y) {
                    sum[c] += weighted * y;
                }
            }
        }
        let mut worst = 0.0f64;
        for (row, want) in device.rows().iter().zip(exact) {
            for c in 0..3 {
                worst = worst.max((f64::from(row[c]) - want[c]).abs() / size[c]);
            }
        }
        println!("projection of {count} samples, order {order}: {worst:.1e}");
        // Measured 8e-8 of the summed light: sums of 16 in order, then a tree; the basis has up to 8e-7 (spec 1).
        assert!(worst < 5e-7, "{count} samples, order {order}: {worst}");
        assert!(device.rgb[order * order..].iter().all(|row| *row == [0.0; 3]));
        let again = engine.project_sh(&samples, order).expect("sums");
        assert_eq!(device.rgb.map(|row| row.map(f32::to_bits)), again.rgb.map(|row| row.map(f32::to_bits)));
    }
}

fn ball_matches(engine: GpuEngine) -> GpuEngine {
    let radial = Distortion::RadialTangential([-0.25, 0.06, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    let ball = MirrorBall {
        surface_radius_m: None,
        centre_world: DVec3::new(0.0, 0.0, 0.05),
        radius_m: 0.05,
        reflectance_rgb: [0.6, 0.58, 0.55],
    };
    let world_from_camera = Pose::look_at(DVec3::new(0.3, -0.4, 0.4), DVec3::new(0.02, 0.01, 0.04), DVec3::Z);
    let mut picture = HdrImage::default();
    picture.radiance.reshape(160, 120, [0.0; 3]);
    picture.flags.reshape(160, 120, 0);
    for (i, pixel) in picture.radiance.pixels_mut().iter_mut().enumerate() {
        let (x, y) = ((i % 160) as f32 * 0.05, (i / 160) as f32 * 0.07);
        *pixel = [1.0 + 0.8 * x.sin() * y.cos(), 1.2 + (x + y).cos(), if i % 97 == 0 { 30.0 } else { 0.5 }];
    }
    let mut engine = engine;
    let twins = [Pass::UnwrapBall.name().to_owned(), Pass::ProjectSh.name().to_owned()];
    for distortion in [Distortion::None, radial] {
        let lens = Lens { distortion, ..Lens::pinhole(160, 120, 400.0, 400.0, 81.0, 59.0) };
        for on_surface in [false, true] {
            let job = LightJob::Ball(BallShot {
                picture: &picture,
                lens: &lens,
                world_from_camera: &world_from_camera,
                ball: &ball,
                on_surface,
                without_ball: None,
            });
            let quality = Quality { sh_order: 6, ..Quality::default() };
            let device = engine.estimate_light(&job, &quality).expect("a visible ball");
            engine = engine.with_cpu_kernels(&twins).expect("known kernels");
            let twin = engine.estimate_light(&job, &quality).expect("a visible ball");
            engine = engine.with_cpu_kernels(&[]).expect("no kernel");
            let all = device.total.rgb.as_flattened().iter().zip(twin.total.rgb.as_flattened());
            let worst = all.map(|(d, t)| (d - t).abs() / twin.total.rgb[0][1]).fold(0.0, f32::max);
            println!("ball, {:?}, {on_surface}: {worst:.1e}, {:?}", lens.distortion, device.flags);
            // The same f32 steps; a pixel whose corner is on the rim to the last digit may come or go, and is
            // then filled instead.
            assert!(worst < 2e-5, "{worst}");
            let counts = (device.flags.saturated_texels, device.flags.not_finite_texels);
            assert_eq!(counts, (twin.flags.saturated_texels, twin.flags.not_finite_texels));
            assert!(device.flags.texels.abs_diff(twin.flags.texels) <= 4);
        }
    }
    engine
}

/// How much two pictures differ.
#[derive(Clone, Copy, Debug, Default)]
struct Difference {
    /// Share of pixels whose radiance differs by more than 1e-3 of itself.
    radiance: f64,
    /// Share of pixels whose 8-bit values differ at all.
    bytes: f64,
    /// Share of pixels whose 8-bit values differ by more than one.
    beyond_one: f64,
    /// Mean absolute difference of the 8-bit values.
    mean: f64,
}

fn difference(device: &Picture, twin: &Picture) -> Difference {
    let count = twin.radiance.pixels().len() as f64;
    assert_eq!(device.radiance.pixels().len(), twin.radiance.pixels().len());
    assert_eq!(device.display.pixels().len(), twin.display.pixels().len());
    assert!(device.radiance.pixels().as_flattened().iter().all(|x| x.is_finite() && *x >= 0.0));
    let mut out = Difference::default();
    for (d, t) in device.radiance.pixels().iter().zip(twin.radiance.pixels()) {
        let apart = |c: usize| (d[c] - t[c]).abs() > 1e-3 * t[c].abs().max(0.01);
        out.radiance += f64::from(u8::from((0..3).any(apart))) / count;
    }
    for (d, t) in device.display.pixels().iter().zip(twin.display.pixels()) {
        let apart: [u8; 3] = std::array::from_fn(|c| d[c].abs_diff(t[c]));
        out.bytes += f64::from(u8::from(apart.iter().any(|&a| a > 0))) / count;
        out.beyond_one += f64::from(u8::from(apart.iter().any(|&a| a > 1))) / count;
        out.mean += apart.iter().map(|&a| f64::from(a)).sum::<f64>() / (3.0 * count);
    }
    out
}

/// What is allowed for a pass on the device (`None`: all of them), about twice what was measured on llvmpipe.
fn allowed(own: Option<Pass>, samples: u32, distorted: bool, at_vertices: bool) -> Difference {
    // Depths differ in the last place; a tap of the filter may change sides. Measured: no pixel differs.
    let shadow_maps = Difference { radiance: 1e-3, bytes: 1e-3, beyond_one: 2e-4, mean: 1e-3 };
    // The layer has 11 bits: every object pixel may round to the other byte. With four samples the twin shades
    // an edge pixel at the mean of what it sees of a triangle, the device at the pixel's centre; on the balls, of
    // 2.5 pixels a triangle, that is every pixel, and the mirror and the highlight change quickly there. Bent
    // edges are drawn as short straight ones.
    let shade_object = match samples {
        4 => Difference { radiance: 0.14, bytes: 0.09, beyond_one: 0.02, mean: 0.18 },
        _ if distorted => Difference { radiance: 0.015, bytes: 0.02, beyond_one: 4e-4, mean: 0.02 },
        _ => Difference { radiance: 1e-3, bytes: 0.015, beyond_one: 2e-4, mean: 0.01 },
    };
    // A tap that changes sides is up to 1/9 of the direct light in a penumbra pixel. Measured: 0.0075 through a bent lens.
    let shade_surface = Difference { radiance: 0.015, bytes: 4e-3, beyond_one: 4e-4, mean: 2e-3 };
    // A coarse pixel at the edge of a surface lands on either side; the device takes the nearest in depth where the twin
    // looks again. Measured: a third of a percent of the pixels.
    // At vertices, through a bent lens, the device's grid has more of them: 0.08 of the pixels change by more than a
    // thousandth, hardly any by more than a byte.
    let soft_shadow = if at_vertices {
        Difference { radiance: 0.16, bytes: 0.1, beyond_one: 2e-3, mean: 0.04 }
    } else {
        Difference { radiance: 7e-3, bytes: 6e-3, beyond_one: 1.5e-3, mean: 6e-3 }
    };
    // The twin's layer is rounded to 11 bits on its way to the device.
    let composite = Difference { radiance: 0.0, bytes: 0.01, beyond_one: 0.0, mean: 6e-3 };
    // Counts the same thresholds.
    let tonemap = Difference::default();
    match own {
        Some(Pass::ShadowMaps) => shadow_maps,
        Some(Pass::SoftShadow) => soft_shadow,
        Some(Pass::ShadeObject) => shade_object,
        Some(Pass::ShadeSurface) => shade_surface,
        Some(Pass::Composite) => composite,
        Some(_) => tonemap,
        None => Difference {
            radiance: shade_object.radiance + shade_surface.radiance + soft_shadow.radiance,
            bytes: shade_object.bytes + shade_surface.bytes + soft_shadow.bytes,
            beyond_one: shade_object.beyond_one + shade_surface.beyond_one + soft_shadow.beyond_one,
            mean: shade_object.mean + shade_surface.mean + soft_shadow.mean,
        },
    }
}

fn drawing_matches(mut engine: GpuEngine, cpu: &mut CpuEngine) -> GpuEngine {
    let radial = Distortion::RadialTangential([-0.25, 0.06, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    let fisheye = Distortion::Equidistant([0.02, 0.001, 0.0, 0.0]);
    let kernels: Vec<_> = FRAME.map(Pass::name).into_iter().map(str::to_owned).collect();
    let shots = [("pinhole", Distortion::None, 4), ("pinhole", Distortion::None, 1), ("radial", radial, 1)];
    let close = ("pinhole close by", Distortion::None, 1);
    for (lens, distortion, samples) in shots.into_iter().chain([("fisheye", fisheye, 4), close]) {
        let mut shot = Shot::new(distortion, samples);
        if lens == close.0 {
            // Only the end of the cube's shadow under the first light is seen: its map holds a part of the cube, the
            // other lights have none.
            shot.pose = Pose::look_at(DVec3::new(-0.36, 0.12, 0.1), DVec3::new(-0.33, 0.1, 0.0), DVec3::Z);
        }
        let twin = shot.draw(cpu);
        for own in FRAME.map(Some).into_iter().chain([None]) {
            // One kernel on the device and all others on their twins; then all on the device.
            let others: Vec<_> =
                kernels.iter().filter(|name| own.is_some_and(|own| own.name() != **name)).cloned().collect();
            engine = engine.with_cpu_kernels(&others).expect("known kernels");
            let device = shot.draw(&mut engine);
            let (found, most) = (
                difference(&device, &twin),
                allowed(own, samples, distortion != Distortion::None, lens == "radial"),
            );
            let what = format!("{lens}, {samples} samples, {}: {found:?}", own.map_or("all", Pass::name));
            println!("{what}");
            let within = found.radiance <= most.radiance
                && found.bytes <= most.bytes
                && found.beyond_one <= most.beyond_one
                && found.mean <= most.mean;
            assert!(within, "{what}, allowed {most:?}");
            if own.is_none() {
                let again = shot.draw(&mut engine);
                assert_eq!(again.radiance, device.radiance, "{what}: the same every time");
                assert_eq!(again.display, device.display, "{what}: the same every time");
            }
        }
    }
    engine.with_cpu_kernels(&[]).expect("no kernel")
}

/// Linear radiance is there where it is asked for, and changes no display; nor does a frame without display bytes in between.
fn asked_for_alone(engine: &mut GpuEngine) {
    let mut shots: Vec<Shot> = (0..4).map(|_| Shot::new(Distortion::None, 1)).collect();
    for (k, shot) in shots.iter_mut().enumerate() {
        let eye = DVec3::new(0.3 - 0.1 * k as f64, -0.6, 0.5);
        shot.pose = Pose::look_at(eye, DVec3::new(0.0, 0.0, 0.05), DVec3::Z);
    }
    shots[2].plan.passes.retain(|planned| planned.pass != Pass::Tonemap);
    let mut draw_all = |wants_linear: bool| -> Vec<Picture> {
        engine.ask_for_linear(wants_linear);
        engine.load_scene(&scene()).expect("a sound scene");
        let draw = |(k, shot): (usize, &Shot)| {
            let mut out = Picture::default();
            let input = RelightInput { t: Timestamp(k as i64), ..shot.input() };
            engine.relight(&shot.plan, &input, &mut out).expect("a sound frame");
            assert_eq!(out.t, Timestamp(k as i64));
            assert!(out.radiance.pixels().is_empty() != wants_linear, "frame {k}");
            out
        };
        shots.iter().enumerate().map(draw).collect()
    };
    let (without, with) = (draw_all(false), draw_all(true));
    assert!(with[0].display != with[1].display, "the camera moves");
    for (k, (without, with)) in without.iter().zip(&with).enumerate() {
        assert!(without.display == with.display, "frame {k}");
    }
}

/// How passes are timed changes no picture. What is not fenced is timed where the device can tell.
fn timings_change_nothing(mut engine: GpuEngine) -> GpuEngine {
    let shot = Shot::new(Distortion::None, 1);
    let mut first: Option<Picture> = None;
    for timings in [Timings::Off, Timings::Stamps, Timings::Fenced] {
        engine = engine.with_timings(timings);
        let picture = shot.draw(&mut engine);
        assert!(first.get_or_insert_with(|| picture.clone()).display == picture.display, "{timings:?}");
        let mut times = Vec::new();
        engine.take_timings(&mut times);
        let is_timed = times.iter().any(|timing| timing.pass == Pass::Composite);
        let expected = match timings {
            Timings::Off => false,
            Timings::Stamps => engine.context().has_timestamps(),
            Timings::Fenced => true,
        };
        assert_eq!(is_timed, expected, "{timings:?}: {times:?}");
        assert!(timings != Timings::Off || times.is_empty());
    }
    engine
}

/// The kernels of a frame.
const FRAME: [Pass; 6] = [
    Pass::ShadowMaps,
    Pass::SoftShadow,
    Pass::ShadeObject,
    Pass::ShadeSurface,
    Pass::Composite,
    Pass::Tonemap,
];

/// Software devices share the cores: one at a time is as fast, and easier to read.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn all_kernels(backend: Backend) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let test = format!("twins on {}", backend.name());
    let mut engine = match GpuEngine::new(Some(backend)) {
        Ok(engine) => engine,
        Err(error) => return support::skip_gpu(&test, &error.to_string()),
    };
    println!("{}", engine.description());
    merge_matches(&mut engine);
    sensor_merge_matches(&mut engine);
    projection_matches_and_repeats(&mut engine);
    let mut cpu = CpuEngine::new(None).expect("threads");
    engine = ball_matches(engine);
    engine = drawing_matches(engine, &mut cpu);
    asked_for_alone(&mut engine);
    engine = timings_change_nothing(engine);
    let mut timings = Vec::new();
    engine.take_timings(&mut timings);
    println!("{timings:?}");
}

#[test]
fn vulkan_matches_the_twins() {
    all_kernels(Backend::Vulkan);
}

#[test]
fn gl_matches_the_twins() {
    all_kernels(Backend::Gl);
}

#[test]
fn gles_3_1_matches_the_twins() {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    gles::assert_gles_3_1(&gles::child("gl_matches_the_twins", "3.1"));
}

#[test]
fn gles_3_0_is_refused_by_name() {
    if std::env::var(gles::CHILD).is_err() {
        let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        gles::child("gles_3_0_is_refused_by_name", "3.0");
        return;
    }
    match GpuEngine::new(Some(Backend::Gl)) {
        Ok(engine) if engine.description().contains("Mesa") => panic!("accepted: {}", engine.description()),
        Ok(engine) => println!("{}: cannot be made to offer less", engine.description()),
        Err(error) => {
            println!("{error}");
            let text = error.to_string();
            assert!(text.contains("no usable GPU adapter") && text.contains("OpenGL ES 3.1"), "{text}");
            assert!(text.contains("lacks compute shaders") || text.contains("no adapter at all"), "{text}");
        }
    }
}

#[test]
fn unknown_kernels_are_refused_with_the_known_ones() {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let engine = match GpuEngine::new(None) {
        Ok(engine) => engine,
        Err(error) => return support::skip_gpu("unknown kernels", &error.to_string()),
    };
    let engine = engine.with_cpu_kernels(&["light/project_sh".to_owned()]).expect("a kernel");
    assert!(engine.description().ends_with("on the CPU: light/project_sh"), "{}", engine.description());
    let error =
        engine.with_cpu_kernels(&["light/unwrap".to_owned()]).err().expect("no such kernel").to_string();
    assert!(error.contains("light/unwrap") && error.contains("light/unwrap_ball"), "{error}");
    assert!(Pass::ALL.iter().all(|pass| error.contains(pass.name())), "{error}");
}
