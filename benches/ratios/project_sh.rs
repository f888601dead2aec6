//! `light::project_sh` against the loop one would write down, and the time of a whole ball.

use crate::timing::time_ms;
use glam::DVec3;
use halflight::{
    light::{
        project_sh::project_sh,
        unwrap_ball::{BallShot, BallUnwrapper},
    },
    math::{lens::Lens, pose::Pose, sh::basis::evaluate, sphere::reflect_off_sphere, spiral},
    model::{
        image::{HdrImage, Image, LOWER_BOUND},
        light::RadianceSamples,
        rig::MirrorBall,
    },
};
use std::hint::black_box;

/// Eq. 2 of [Now11] as one would write it down: one running f32 sum for each coefficient.
fn project_naive(samples: &RadianceSamples, order: usize) -> [[f32; 3]; 36] {
    let mut rgb = [[0.0; 3]; 36];
    let mut y = [0.0f32; 36];
    for (d, c) in samples.directions.iter().zip(&samples.radiance) {
        evaluate(order, [d[0], d[1], d[2]], &mut y);
        for (row, y) in rgb.iter_mut().zip(y).take(order * order) {
            for k in 0..3 {
                row[k] += c[k] * y * d[3];
            }
        }
    }
    rgb
}

fn samples(count: usize) -> RadianceSamples {
    let mut samples = RadianceSamples::default();
    for j in 0..count {
        let d = spiral::direction(j, count).as_vec3();
        samples.directions.push([d.x, d.y, d.z, 12.566_371 / count as f32]);
        samples.radiance.push([1.0 + d.x, 1.0 + d.y, 1.5, 0.0]);
    }
    samples
}

/// A ball on a gray table under a sky with a lamp, 640 x 480; the lamp may be saturated.
fn photograph(lens: &Lens, pose: &Pose, ball: &MirrorBall, saturated: bool) -> HdrImage {
    let (width, height) = (lens.width as usize, lens.height as usize);
    let mut radiance = Image::filled(width, height, [0.0f32; 3]);
    let mut flags = Image::filled(width, height, 0u8);
    let lamp = DVec3::new(0.5, 0.3, 0.8).normalize();
    for y in 0..height {
        for x in 0..width {
            let pixel = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let ray = pose.rotate(lens.unproject(pixel).unwrap_or(DVec3::Z));
            let hit = reflect_off_sphere(pose.translation, ray, ball.centre_world, ball.radius_m);
            let seen = hit.map_or(ray, |hit| hit.reflected);
            let light = if seen.z < 0.0 { 0.6 } else { 1.0 + seen.x };
            let shining = seen.angle_between(lamp) < 0.1;
            *radiance.at_mut(x, y) = [if shining { 12.0 } else { light as f32 }; 3];
            if shining && saturated {
                *flags.at_mut(x, y) = LOWER_BOUND;
            }
        }
    }
    HdrImage { radiance, flags }
}

pub fn run() {
    for (what, count) in [("a ball", 9_000), ("a map", 512 * 256)] {
        let samples = samples(count);
        for order in [4, 6] {
            let runs = if count > 50_000 { 21 } else { 201 };
            let (naive, _) = time_ms(runs, || {
                black_box(project_naive(black_box(&samples), order));
            });
            let (fast, _) = time_ms(runs, || {
                black_box(project_sh(black_box(&samples), order));
            });
            println!(
                "project_sh, {what} ({count} samples), order {order}: {fast:.3} ms, naive loop {naive:.3} ms, ratio {:.1}",
                naive / fast
            );
        }
    }
    let ball = MirrorBall {
        surface_radius_m: None,
        centre_world: DVec3::Z * 0.05,
        radius_m: 0.05,
        reflectance_rgb: [0.8; 3],
    };
    let lens = Lens::pinhole(640, 480, 700.0, 700.0, 320.0, 240.0);
    let pose = Pose::look_at(DVec3::new(0.1, -0.5, 0.35), ball.centre_world, DVec3::Z);
    for saturated in [false, true] {
        let picture = photograph(&lens, &pose, &ball, saturated);
        let (mut unwrapper, mut out) = (BallUnwrapper::new(), RadianceSamples::default());
        let mut flags = None;
        let shot = BallShot {
            picture: &picture,
            without_ball: None,
            lens: &lens,
            world_from_camera: &pose,
            ball: &ball,
            on_surface: true,
        };
        let (ms, _) = time_ms(31, || {
            flags = unwrapper.unwrap(&shot, &mut out).ok();
        });
        println!(
            "unwrap_ball, 640 x 480, {} samples{}: {ms:.2} ms",
            out.directions.len(),
            flags.filter(|f| f.saturated_texels > 0).map_or(String::new(), |f| format!(
                " (a lamp of {} saturated pixels read from its shadow)",
                f.saturated_texels
            ))
        );
    }
}
