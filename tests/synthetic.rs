//! The synthetic room against its own truth: where things appear, how bright, how they move.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::{DQuat, DVec2, DVec3};
use halflight::device::synthetic::{self, PAPER_SIDE_M, SyntheticOptions, TAG_SIDE_M};
use halflight::device::{ErrorKind, FrameSource, ImuSource};
use halflight::math::lens::Lens;
use halflight::math::pose::Pose;
use halflight::math::sphere::reflect_off_sphere;
use halflight::model::frame::Exposure;
use halflight::model::image::Rgb8Image;
use halflight::model::time::Timestamp;

const NEVER: Timestamp = Timestamp(i64::MAX);
/// A small picture with coarse light: the geometry and the arithmetic are those of the large one.
fn open(more: &str) -> (synthetic::SyntheticSource, synthetic::SyntheticImu) {
    synthetic::open(&SyntheticOptions::parse(&format!("size=320x240,frames=6,texel_mm=5,{more}")).unwrap())
}

fn project(lens: &Lens, world_from_camera: &Pose, p: DVec3) -> DVec2 {
    let c = world_from_camera.inverse().transform(p);
    assert!(c.z > 0.0);
    DVec2::new(lens.fx * c.x / c.z + lens.cx, lens.fy * c.y / c.z + lens.cy)
}

fn gray(image: &Rgb8Image, at: DVec2) -> f64 {
    let p = image.at(at.x as usize, at.y as usize);
    p.iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0
}

#[test]
fn the_tag_appears_where_the_truth_puts_it() {
    let (mut source, _) = open("noise=0");
    let rig = source.rig().unwrap();
    let tag = rig.tags[0];
    assert_eq!((tag.id, tag.side_m), (0, TAG_SIDE_M));
    for i in 0..6 {
        let frame = source.next(NEVER).unwrap();
        let pose = source.truth().unwrap().pose.world_from_camera;
        // On the diagonals: black inside each corner, white paper outside, by 7 % of half the side.
        for (x, y) in [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
            let look = |scale: f64| {
                let p = tag.world_from_tag.transform(DVec3::new(x, y, 0.0) * (scale * tag.side_m / 2.0));
                gray(&frame.pixels, project(&rig.lens, &pose, p))
            };
            let (inside, outside) = (look(0.93), look(1.14));
            // White reflects 22 times as much as black; even the shortest exposure shows it.
            assert!(outside > 1.9 * inside + 1.0, "frame {i}, corner {x} {y}: {inside} {outside}");
        }
        // The cells of the code's first row, 1 1 0 1 and one more, then the black border.
        if i % 3 == 2 {
            let cell = |column: f64, row: f64| {
                let at = (DVec2::new(column, row) + 0.5 - 4.0) * (tag.side_m / 8.0);
                gray(&frame.pixels, project(&rig.lens, &pose, tag.world_from_tag.transform(at.extend(0.0))))
            };
            let row: Vec<bool> = (0..8).map(|c| cell(f64::from(c), 1.0) > 110.0).collect();
            let mut bits: Vec<bool> = (0..5).map(|b| 0xd_7e00_984b_u64 >> (35 - b) & 1 == 1).collect();
            // The sixth white cell of that row is the tenth bit: the second quarter of the code begins there.
            bits.push(0xd_7e00_984b_u64 >> 26 & 1 == 1);
            assert_eq!(row, [vec![false], bits, vec![false]].concat());
        }
    }
    const { assert!(PAPER_SIDE_M > 1.25 * TAG_SIDE_M) };
}

#[test]
fn tag_ball_and_free_place_are_in_view_all_the_time() {
    // Long enough for the slow drift to reach its ends, for several seeds, in the picture's full frame.
    for seed in 1..6 {
        let trajectory = synthetic::motion::Trajectory::new(seed, 1.0, synthetic::SyntheticSubject::Desk);
        let lens = Lens::pinhole(640, 480, 652.8, 652.8, 320.0, 240.0);
        for k in 0..600 {
            let pose = trajectory.world_from_camera(1.0 + f64::from(k) * 0.1);
            let inside = |p: DVec3, margin: f64| {
                let at = project(&lens, &pose, p);
                let room = at.min(DVec2::new(640.0, 480.0) - at).min_element();
                assert!(room > margin, "seed {seed}, step {k}: {p} at {at}");
            };
            let ball = DVec3::new(-0.20, 0.04, 0.06);
            for side in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
                inside(ball + side * 0.06, 3.0);
            }
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                inside(DVec3::new(x, y, 0.0) * (PAPER_SIDE_M / 2.0), 10.0);
                inside(DVec3::new(0.20 + 0.1 * x, -0.02 + 0.1 * y, 0.0), 3.0);
            }
        }
    }
}

#[test]
fn the_ball_is_a_mirror_with_the_stated_outline_and_reflectance() {
    let (source, _) = open("noise=0");
    let rig = source.rig().unwrap();
    let ball = rig.ball.unwrap();
    let pose = source.world_from_camera(1.0);
    let eye = pose.translation;
    let centre = project(&rig.lens, &pose, ball.centre_world);
    // Inside the outline a pixel is the reflectance times what the reflected ray sees. Rays are compared one by one.
    let mut ratios = Vec::new();
    for k in 0..3600 {
        let (x, y) = (centre.x as usize - 30 + k % 60, centre.y as usize - 30 + k / 60);
        let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let d = DVec3::new((at.x - rig.lens.cx) / rig.lens.fx, (at.y - rig.lens.cy) / rig.lens.fy, 1.0);
        let ray = pose.rotate(d.normalize());
        let Some(hit) = reflect_off_sphere(eye, ray, ball.centre_world, ball.radius_m) else { continue };
        // Down onto the free table in front: its radiance as the camera itself sees it.
        if hit.reflected.z > -0.2 {
            continue;
        }
        let foot = hit.point - hit.reflected * (hit.point.z / hit.reflected.z);
        let seen = project(&rig.lens, &pose, foot);
        let free = (-0.35..-0.05).contains(&foot.x) && (-0.25..-0.12).contains(&foot.y);
        if !free || seen.y > 238.0 || seen.x < 2.0 {
            continue;
        }
        let mirrored = source.radiance_at(pose, x, y)[1];
        let direct = source.radiance_at(pose, seen.x as usize, seen.y as usize)[1];
        ratios.push(mirrored / direct / f64::from(ball.reflectance_rgb[1]));
    }
    ratios.sort_by(f64::total_cmp);
    assert!(ratios.len() >= 20, "{}", ratios.len());
    // One ray's foot lies between the boards' grain that a pixel averages; the median of many does not care.
    let median = ratios[ratios.len() / 2];
    assert!((median - 1.0).abs() < 0.06, "{median} of {}", ratios.len());
}

#[test]
fn exposures_scale_the_linear_picture() {
    let (mut source, _) = open("noise=0,motion=0");
    let response = source.response().unwrap();
    let frames: Vec<_> = (0..3).map(|_| source.next(NEVER).unwrap()).collect();
    let g = response.log_exposure();
    // Where both pictures are well exposed, ln X differs by the logarithm of the ratio of the times.
    for (a, b) in [(0, 1), (1, 2)] {
        let expected = (frames[b].exposure.time_s / frames[a].exposure.time_s).ln();
        let (mut sum, mut n) = (0.0, 0);
        for (p, q) in frames[a].pixels.pixels().iter().zip(frames[b].pixels.pixels()) {
            for c in 0..3 {
                if p[c] >= 24 && q[c] <= 240 {
                    sum += f64::from(g[c][q[c] as usize] - g[c][p[c] as usize]);
                    n += 1;
                }
            }
        }
        assert!(n > 1000, "{n}");
        // Rounding to 8 bits alone, averaged over a thousand pixels: 0.5 %.
        assert!(
            (sum / f64::from(n) - expected).abs() < 0.005 * expected,
            "{} {expected}",
            sum / f64::from(n)
        );
    }
}

#[test]
fn the_shortest_exposure_keeps_the_lamp() {
    let (mut source, _) = open("noise=1");
    let frame = source.next(NEVER).unwrap();
    let brightest = frame.pixels.pixels().iter().flatten().max().copied().unwrap();
    assert!((200..255).contains(&brightest), "{brightest}");
}

#[test]
fn equal_options_give_equal_pixels_for_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let options = SyntheticOptions::parse("seed=3,size=96x64,texel_mm=10").unwrap();
            let (mut source, mut imu) = synthetic::open_anew(&options);
            let frame = source.next(NEVER).unwrap();
            let mut samples = Vec::new();
            imu.samples_until(frame.t_mid, &mut samples).unwrap();
            (frame.pixels, source.truth(), samples)
        })
    };
    let (one, two) = (run(1), run(2));
    assert!(one == two);
    assert!(!one.2.is_empty());
}

#[test]
fn the_light_is_that_of_a_lit_room() {
    let (mut source, _) = open("");
    source.next(NEVER).unwrap();
    let truth = source.truth().unwrap();
    let light = truth.light;
    assert_eq!(light.order, 6);
    let d = DVec3::from(truth.to_light_world.map(f64::from));
    assert!((d.length() - 1.0).abs() < 1e-6);
    // The lamp stands at (-1.30, 0.64, 1.58); the window on the same side pulls the first moment down to it.
    let to_lamp = (DVec3::new(-1.30, 0.64, 1.58) - DVec3::new(-0.20, 0.04, 0.06)).normalize();
    assert!(d.dot(to_lamp) > 15f64.to_radians().cos(), "{d}");
    assert!(d.z > 0.5, "{d}");
    for c in 0..3 {
        let l = |k: usize| f64::from(light.rgb[k][c]);
        // No light is negative: the first moment is not longer than the zeroth (Eq. 8 of [Now11] and L >= 0).
        let first = (4.0 * std::f64::consts::PI / 3.0).sqrt() * DVec3::new(-l(3), -l(1), l(2)).length();
        let zeroth = (4.0 * std::f64::consts::PI).sqrt() * l(0);
        assert!(first < zeroth && first > 0.2 * zeroth, "{first} {zeroth}");
    }
}

#[test]
fn the_table_is_as_bright_as_the_true_light_says() {
    // The irradiance of an upward plane from the true light's bands, times the wood's albedo over pi, must be
    // what the camera sees of the table; the paper's albedo is known. The lamp is 1.97 m from the ball and 2.17 m
    // from this place and stands lower there: its part is 0.78 of that at the ball, and the rest about equal.
    let (source, _) = open("noise=0,motion=0");
    let (mut other, _) = open("noise=0,motion=0");
    other.next(NEVER).unwrap();
    let light = other.truth().unwrap().light;
    let pose = source.world_from_camera(1.0);
    let rig = source.rig().unwrap();
    let at = project(&rig.lens, &pose, DVec3::new(0.0625, 0.03, 0.0));
    let paper = source.radiance_at(pose, at.x as usize, at.y as usize);
    let bands = [std::f64::consts::PI, 2.0 * std::f64::consts::PI / 3.0, std::f64::consts::FRAC_PI_4];
    for c in 0..3 {
        let l = |k: usize| f64::from(light.rgb[k][c]);
        let pi = std::f64::consts::PI;
        let y = [(1.0 / (4.0 * pi)).sqrt(), (3.0 / (4.0 * pi)).sqrt(), (5.0 / (4.0 * pi)).sqrt()];
        // Bands 0, 1, 2 and 4 of the clamped cosine about +z.
        let irradiance = bands[0] * l(0) * y[0] + bands[1] * l(2) * y[1] + bands[2] * l(6) * y[2]
            - pi / 24.0 * l(20) * (9.0 / (4.0 * pi)).sqrt();
        let ratio = paper[c] * pi / 0.79 / irradiance;
        assert!((0.72..0.92).contains(&ratio), "{c}: {ratio}");
    }
}

#[test]
fn the_imu_integrates_to_the_motion() {
    // Without noise and bias: gyroscope integrated to a turn, accelerometer twice to a path, over 0.6 s.
    let (source, mut imu) = open("noise=0,imu_offset_s=0.004");
    let truth = imu.imu_truth().unwrap();
    assert_eq!((truth.gyro_bias_rad_s, truth.time_offset_s), ([0.0; 3], 0.004));
    let mut samples = Vec::new();
    imu.samples_until(NEVER, &mut samples).unwrap();
    // 6 frames at 30 a second and 0.2 s on either side.
    assert_eq!(samples.len(), (0.6 * 200.0) as usize + 1);
    let true_s = |k: usize| samples[k].t.seconds() - truth.time_offset_s;
    let start = source.world_from_camera(true_s(0));
    let mut rotation = start.rotation;
    let h = 1e-4;
    let mut velocity = (source.world_from_camera(true_s(0) + h).translation
        - source.world_from_camera(true_s(0) - h).translation)
        / (2.0 * h);
    let mut position = start.translation;
    let gravity = DVec3::new(0.0, 0.0, -9.806_65);
    for k in 0..samples.len() - 1 {
        let dt = true_s(k + 1) - true_s(k);
        // Trapezoids.
        let rate = (DVec3::from(samples[k].gyro_rad_s) + DVec3::from(samples[k + 1].gyro_rad_s)) / 2.0;
        let next = (rotation * DQuat::from_scaled_axis(rate * dt)).normalize();
        let before = rotation * DVec3::from(samples[k].accel_m_s2) + gravity;
        let after = next * DVec3::from(samples[k + 1].accel_m_s2) + gravity;
        position += velocity * dt + before * (dt * dt / 2.0);
        velocity += (before + after) * (dt / 2.0);
        rotation = next;
    }
    let end = source.world_from_camera(true_s(samples.len() - 1));
    let turned = Pose::new(rotation, position).angle_to(&end);
    // The camera turned by degrees and moved by centimetres; what is left is the trapezoids' error.
    assert!(start.angle_to(&end) > 0.01 && start.translation.distance(end.translation) > 0.01);
    assert!(turned < 1e-4, "{turned}");
    assert!(position.distance(end.translation) < 1e-3, "{}", position.distance(end.translation));
}

#[test]
fn noise_bias_and_offset_are_what_the_truth_says() {
    let (_, mut noisy) = open("seed=5");
    let (_, mut clean) = open("seed=5,noise=0");
    let truth = noisy.imu_truth().unwrap();
    assert!(truth.gyro_bias_rad_s.iter().all(|b| *b != 0.0));
    let (mut a, mut b) = (Vec::new(), Vec::new());
    noisy.samples_until(NEVER, &mut a).unwrap();
    clean.samples_until(NEVER, &mut b).unwrap();
    let n = a.len() as f64;
    for axis in 0..3 {
        let mean = a.iter().zip(&b).map(|(a, b)| a.gyro_rad_s[axis] - b.gyro_rad_s[axis]).sum::<f64>() / n;
        // Four standard errors of the mean.
        let limit = 4.0 * truth.gyro_noise_rad_s / n.sqrt();
        assert!((mean - truth.gyro_bias_rad_s[axis]).abs() < limit, "{axis}: {mean}");
    }
}

#[test]
fn the_source_ends_and_takes_sensible_exposures_only() {
    let (mut source, _) = open("motion=0");
    assert_eq!(source.frames_left(), Some(6));
    let chosen = [Exposure { time_s: 0.001, gain: 1.0 }, Exposure { time_s: 0.004, gain: 2.0 }];
    assert_eq!(source.set_exposures(&chosen).unwrap(), chosen);
    for bad in
        [vec![], vec![Exposure { time_s: 1.0, gain: 1.0 }], vec![Exposure { time_s: 0.01, gain: f64::NAN }]]
    {
        assert_eq!(source.set_exposures(&bad).unwrap_err().kind, ErrorKind::Refused);
    }
    let mut last = None;
    for i in 0..6u64 {
        let frame = source.next(NEVER).unwrap();
        assert_eq!((frame.sequence, frame.exposure), (i, chosen[i as usize % 2]));
        assert!(last.is_none_or(|t| frame.t_mid > t));
        last = Some(frame.t_mid);
    }
    assert_eq!(source.next(NEVER).unwrap_err().kind, ErrorKind::Ended);
}
