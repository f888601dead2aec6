//! The real case: the light of a living room from photographs of a mirror ball on a pouf.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use halflight::assets::{pictures, scene};
use halflight::hdr::merge_bracket::merge_bracket;
use halflight::light::{
    project_sh::project_sh,
    split::{SplitOptions, split},
    unwrap_ball::unwrap_ball,
};
use halflight::model::{
    frame::Exposure,
    image::{HdrImage, Rgb8Image},
    light::RadianceSamples,
    response::Response,
};
use std::path::Path;

#[test]
fn the_living_room_is_lit_by_its_lamps_and_its_window() {
    if support::shared("the_living_room_is_lit_by_its_lamps_and_its_window").is_none() {
        return;
    }
    let file = scene::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/real/ola.toml")).unwrap();
    let scene::LightSource::Ball(bracket) = &file.light else { panic!("{:?}", file.light) };
    let taken: Vec<Rgb8Image> = bracket.files.iter().map(|f| pictures::load_rgb8(f).unwrap()).collect();
    let borrowed: Vec<&Rgb8Image> = taken.iter().collect();
    let exposures: Vec<Exposure> =
        bracket.exposures_s.iter().map(|t| Exposure { time_s: *t, gain: 1.0 }).collect();
    let mut merged = HdrImage::default();
    merge_bracket(&borrowed, &exposures, &Response::srgb(), &mut merged).unwrap();
    let (camera, ball) = (file.camera.unwrap(), file.ball.unwrap());
    let mut samples = RadianceSamples::default();
    let flags =
        unwrap_ball(&merged, &camera.lens, &camera.world_from_camera, &ball, true, &mut samples).unwrap();
    let light = split(&project_sh(&samples, 4), &SplitOptions::default());
    let direct = light.direct.unwrap();
    println!("{flags:?}\n{direct:?}\nsurface {:?}", samples.radiance.last());
    for (d, c) in samples.directions.iter().zip(&samples.radiance).filter(|(_, c)| c[3] as u8 & 1 != 0) {
        println!("  clipped {d:.3?} {c:.1?}");
    }
    // The lamps hang over the pouf.
    assert!(direct.to_light_world[2] > 0.3, "{direct:?}");
    assert!(direct.irradiance_rgb.iter().all(|e| *e > 0.0));
    assert!(flags.filled_share < 0.06 && flags.not_finite_texels == 0, "{flags:?}");
}
