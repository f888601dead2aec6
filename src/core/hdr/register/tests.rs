//! Warps against pictures of an analytic room: a patterned surface, a patterned sky, a mirror ball.

use super::*;
use crate::model::{
    frame::Exposure,
    response::Response,
    sensor::{CLIPPED, SensorScale},
};

const BALL: MirrorBall = MirrorBall {
    surface_radius_m: None,
    centre_world: DVec3::new(0.02, 0.03, 0.06),
    radius_m: 0.05,
    reflectance_rgb: [1.0; 3],
};

fn lens() -> Lens {
    Lens::pinhole(200, 152, 260.0, 260.0, 101.0, 75.0)
}

fn still() -> Pose {
    Pose::look_at(DVec3::new(0.1, -0.45, 0.35), DVec3::new(0.02, 0.05, 0.02), DVec3::Z)
}

/// A centimetre aside and a degree or two turned: more than a hand moves between two frames.
fn moved() -> Pose {
    Pose::look_at(
        DVec3::new(0.112, -0.442, 0.357),
        DVec3::new(0.027, 0.046, 0.025),
        DVec3::new(0.02, 0.0, 1.0),
    )
}

/// What the camera sees along a ray: within 20..=230, smooth, without an edge at the horizon (an edge that falls
/// between pixels would differ by resampling alone).
fn colour(eye: DVec3, direction: DVec3, ball: Option<&MirrorBall>) -> [f64; 3] {
    if let Some(hit) = ball.and_then(|b| reflect_off_sphere(eye, direction, b.centre_world, b.radius_m)) {
        return colour(hit.point, hit.reflected, None);
    }
    let along = -eye.z / direction.z;
    if along > 0.0 {
        let p = eye + direction * along;
        let fade = 50.0 / (1.0 + 4.0 * p.length_squared());
        let wave = |k: f64| 125.0 + fade * (9.0 * p.x + k).sin() + fade * (8.0 * p.y - k).cos();
        return [0.0, 1.0, 2.0].map(wave);
    }
    let d = direction.normalize();
    [0.0, 1.0, 2.0].map(|k| 125.0 + d.z * (60.0 * (3.0 * d.x + k).sin() + 40.0 * (4.0 * d.y - k).cos()))
}

fn picture(pose: &Pose, lens: &Lens, ball: Option<&MirrorBall>, gain: f64) -> Rgb8Image {
    let (width, height) = (lens.width as usize, lens.height as usize);
    let pixels = (0..width * height)
        .map(|i| {
            let mut sum = [0.0; 3];
            for sub in 0..4 {
                let (dx, dy) = (0.25 + 0.5 * f64::from(sub % 2), 0.25 + 0.5 * f64::from(sub / 2));
                let ray =
                    lens.unproject(DVec2::new((i % width) as f64 + dx, (i / width) as f64 + dy)).unwrap();
                let c = colour(pose.translation, pose.rotate(ray), ball);
                (0..3).for_each(|k| sum[k] += 0.25 * c[k]);
            }
            sum.map(|v| (v * gain).round().clamp(0.0, 255.0) as u8)
        })
        .collect();
    Rgb8Image::from_pixels(width, height, pixels).unwrap()
}

/// The pictures here are averages of values.
fn light() -> LinearLight {
    LinearLight::new(&Response::new([std::array::from_fn(|z| (z as f32).max(0.5).ln()); 3]).unwrap())
}

fn equal_fill() -> BoundFill {
    let exposure = Exposure { time_s: 0.01, gain: 1.0 };
    BoundFill::new(&Response::srgb(), exposure, exposure)
}

fn warped(
    newest: &Pose,
    older: &Pose,
    lens: &Lens,
    ball: Option<MirrorBall>,
) -> (Rgb8Image, Rgb8Image, Rgb8Image) {
    let mut warp = Warp::new(lens, ball);
    assert!(warp.aim(newest, older));
    let (truth, source) =
        (picture(newest, lens, ball.as_ref(), 1.0), picture(older, lens, ball.as_ref(), 1.0));
    let mut out = Rgb8Image::default();
    warp.apply(&source, &truth, (&equal_fill(), &light()), &mut out);
    (truth, source, out)
}

/// Largest, and mean, difference over the pixels that `chosen` takes, leaving out what was filled.
fn differences(a: &Rgb8Image, b: &Rgb8Image, chosen: impl Fn(usize, usize) -> bool) -> (u8, f64, usize) {
    let (mut worst, mut sum, mut count) = (0, 0.0, 0);
    for y in 0..a.height() {
        for x in (0..a.width()).filter(|&x| chosen(x, y)) {
            let (p, q) = (a.at(x, y), b.at(x, y));
            if p.iter().chain(q).all(|z| ![0, 255].contains(z)) {
                let difference = (0..3).map(|c| p[c].abs_diff(q[c])).max().unwrap();
                worst = worst.max(difference);
                sum += f64::from(difference);
                count += 1;
            }
        }
    }
    (worst, sum / count as f64, count)
}

/// Radius from the middle of the ball's outline, 1 at the outline, in the picture of `pose`.
fn ball_radius(pose: &Pose, lens: &Lens, x: usize, y: usize) -> f64 {
    let ray = pose.rotate(lens.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).unwrap());
    let to_ball = BALL.centre_world - pose.translation;
    ray.angle_between(to_ball).sin() * to_ball.length() / BALL.radius_m
}

#[test]
fn a_surface_is_registered() {
    let (truth, source, out) = warped(&moved(), &still(), &lens(), None);
    let (worst, mean, count) = differences(&truth, &out, |_, _| true);
    let (_, before, _) = differences(&truth, &source, |_, _| true);
    // Measured: 1, 0.40 (both pictures are rounded), before 2.6; nearly all of it is seen.
    assert!(worst <= 1 && mean < 0.45, "worst {worst}, mean {mean}, before {before}");
    assert!(before > 2.0 && count > 28_000, "{before} {count}");
}

#[test]
fn the_ball_is_registered_through_its_reflection() {
    let (truth, source, out) = warped(&moved(), &still(), &lens(), Some(BALL));
    let inside = |x, y| ball_radius(&moved(), &lens(), x, y) < 0.9;
    let (worst, mean, count) = differences(&truth, &out, inside);
    let (worst_before, before, _) = differences(&truth, &source, inside);
    assert!(count > 1200, "{count}");
    // Measured: worst 18 (towards the rim, where a pixel of either picture covers much of the room), mean 1.2; before
    // worst 93, mean 24.
    assert!(mean < 1.5 && worst <= 20, "worst {worst}, mean {mean}, before {worst_before} {before}");
    assert!(before > 15.0 * mean, "{before} {mean}");
    // Beside the ball, where it stood before, the surface is not known: filled, not taken from the ball.
    let beside = |x, y| (1.1..2.0).contains(&ball_radius(&moved(), &lens(), x, y));
    let (worst, _, count) = differences(&truth, &out, beside);
    assert!(worst <= 3 && count > 2000, "{worst} {count}");
}

#[test]
fn lenses_with_distortion_are_registered() {
    use crate::math::lens::Distortion;
    let bent = Lens {
        distortion: Distortion::RadialTangential([-0.25, 0.06, 0.001, -0.001, 0.0, 0.0, 0.0, 0.0]),
        ..lens()
    };
    let (truth, _, out) = warped(&moved(), &still(), &bent, Some(BALL));
    let open = |x, y| {
        let r = ball_radius(&moved(), &bent, x, y);
        !(0.9..=1.2).contains(&r)
    };
    let (worst, mean, count) = differences(&truth, &out, open);
    // Measured: 16 (on the ball), 0.42.
    assert!(worst <= 20 && mean < 0.5 && count > 25_000, "worst {worst}, mean {mean}, {count}");
}

#[test]
fn a_saturated_tap_saturates() {
    let (lens, newest, older) = (lens(), moved(), still());
    let mut warp = Warp::new(&lens, None);
    assert!(warp.aim(&newest, &older));
    let mut source = Rgb8Image::filled(200, 152, [100, 90, 80]);
    *source.at_mut(90, 70) = [254, 90, 250];
    let mut out = Rgb8Image::default();
    warp.apply(&source, &source, (&equal_fill(), &light()), &mut out);
    let red: Vec<u8> = out.pixels().iter().map(|p| p[0]).filter(|z| ![0, 100].contains(z)).collect();
    // Four pixels, sometimes a few more or less, have the bright one among their taps; none is an average.
    assert!((2..=9).contains(&red.len()) && red.iter().all(|&z| z == 255), "{red:?}");
    assert!(out.pixels().iter().all(|p| p[2] < 252));
    assert!(out.pixels().iter().all(|p| p[1] == 90 || p[1] == 0), "nothing else changes");
}

/// 8-bit values as a sensor of 16 bits would have given them.
fn of_sensor(picture: &Rgb8Image) -> SensorImage {
    let values = picture.pixels().iter().map(|p| p.map(|z| 256 * u16::from(z) + 1)).collect();
    let scale =
        SensorScale { black: 1.0, saturated: 253 * 256, step: 256.0, exposure_per_value: [1.0 / 256.0; 3] };
    SensorImage { values: Image::from_pixels(picture.width(), picture.height(), values).unwrap(), scale }
}

#[test]
fn what_a_sensor_gave_is_registered_alike_and_finer() {
    let (newest, older, lens) = (moved(), still(), lens());
    let mut warp = Warp::new(&lens, Some(BALL));
    assert!(warp.aim(&newest, &older));
    let (truth, mut source) =
        (picture(&newest, &lens, Some(&BALL), 1.0), picture(&older, &lens, Some(&BALL), 1.0));
    *source.at_mut(20, 70) = [254, 90, 250];
    let (mut coded, mut fine) = (Rgb8Image::default(), SensorImage::default());
    // The newest picture is black and white: nothing that was not seen stays.
    let newest = Rgb8Image::filled(200, 152, [255; 3]);
    warp.apply(&source, &newest, (&equal_fill(), &light()), &mut coded);
    warp.apply_to_sensor(&of_sensor(&source), &mut fine);
    let (mut seen, mut unseen, mut clipped) = (0, 0, 0);
    for (coded, fine) in coded.pixels().as_flattened().iter().zip(fine.values.pixels().as_flattened()) {
        match (*coded, *fine) {
            (255, UNSEEN_VALUE) => unseen += 1,
            (255, CLIPPED) => clipped += 1,
            (coded, fine) => {
                // Half a value of rounding; where values differ little the 8-bit way blends them as they are.
                assert!((f64::from(fine) / 256.0 - f64::from(coded)).abs() <= 0.52, "{coded} {fine}");
                seen += 1;
            }
        }
    }
    assert!(seen > 80_000 && unseen > 100 && (2..=9).contains(&clipped), "{seen} {unseen} {clipped}");
    let surface = |x, y| ball_radius(&moved(), &lens, x, y) > 2.0 && coded.at(x, y)[0] != 255;
    let mean = |of: &dyn Fn(usize, usize) -> f64| {
        let places = (0..152).flat_map(|y| (0..200).map(move |x| (x, y))).filter(|&(x, y)| surface(x, y));
        places.map(|(x, y)| (of(x, y) - f64::from(truth.at(x, y)[0])).powi(2)).sum::<f64>()
    };
    let by_value = mean(&|x, y| f64::from(coded.at(x, y)[0]));
    let by_sensor = mean(&|x, y| f64::from(fine.values.at(x, y)[0] - 1) / 256.0);
    assert!(by_sensor < by_value, "{by_sensor} {by_value}");
}

#[test]
fn what_the_older_frame_did_not_see_is_filled() {
    let lens = lens();
    let (newest, older) =
        (still(), Pose::look_at(DVec3::new(0.1, -0.45, 0.35), DVec3::new(0.4, 0.3, 0.0), DVec3::Z));
    let mut warp = Warp::new(&lens, Some(BALL));
    assert!(warp.aim(&newest, &older));
    let source = Rgb8Image::filled(200, 152, [60; 3]);
    let mut now = Rgb8Image::filled(200, 152, [127; 3]);
    now.pixels_mut()[..400].fill([255, 0, 128]);
    let mut out = Rgb8Image::default();
    let at = |time_s| Exposure { time_s, gain: 1.0 };
    let fill = BoundFill::new(&Response::srgb(), at(0.04), at(0.01));
    warp.apply(&source, &now, (&fill, &light()), &mut out);
    assert_eq!(*out.at(0, 100), [0; 3]);
    // 255 in the newest, four times longer exposure: 1/4 of full scale is sRGB 137.
    assert_eq!(*out.at(0, 0), [137, 0, 255]);
    let seen = out.pixels().iter().filter(|p| **p == [60; 3]).count();
    assert!((3_000..25_000).contains(&seen), "{seen}");
    // Towards the longer exposure it is the dark end that must not claim more: 0 counts as 0.25, four times that is 1.
    let fill = BoundFill::new(&Response::srgb(), at(0.01), at(0.04));
    assert_eq!(fill.pixel([0, 255, 10]), [1, 255, 0]);
}

#[test]
fn a_camera_that_stands_still_needs_no_warp() {
    let mut warp = Warp::new(&lens(), Some(BALL));
    assert!(!warp.aim(&still(), &still()));
    let nudged = Pose::new(still().rotation, still().translation + DVec3::splat(1e-5));
    assert!(!warp.aim(&nudged, &still()));
    assert!(warp.aim(&moved(), &still()));
    // Looking away altogether, nothing of the older picture is to be seen.
    let away = Pose::look_at(still().translation, DVec3::new(0.2, -5.0, 0.3), DVec3::Z);
    assert!(warp.aim(&away, &still()));
    let source = Rgb8Image::filled(200, 152, [60; 3]);
    let mut out = Rgb8Image::default();
    warp.apply(&source, &Rgb8Image::filled(200, 152, [90; 3]), (&equal_fill(), &light()), &mut out);
    assert!(out.pixels().iter().all(|p| *p == [0; 3]));
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| warped(&moved(), &still(), &lens(), Some(BALL)).2)
    };
    assert_eq!(run(1), run(3));
}
