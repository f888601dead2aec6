//! Tags out of focus, in noise and from the side: how far off their corners are, and whether the stated sigma is true.
#![allow(clippy::approx_constant, reason = "any angle will do")]
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{DQuat, DVec2, DVec3};
use halflight::math::dice::Dice;
use halflight::model::image::Image;
use halflight::track::{
    drawing::draw_light,
    tag::{TagDetector, TagOptions},
    tag_pose::corners_of_tag_m,
};
use serde_json::Value;
use std::process::Command;

/// Pictures of all tags are squares of this side, pixels.
const SIDE: usize = 240;

/// A tag made by rule from its seed.
struct Drawn {
    gray: Image<u8>,
    corners_px: [DVec2; 4],
    id: usize,
    blur_px: f64,
    noise: f64,
    tilt_deg: f64,
}

/// Drawn with pixels that are means over their area, blurred in linear light, encoded by sRGB, then noise and rounding.
fn drawn(series: u64, seed: u64) -> Drawn {
    let mut dice = Dice::new(seed * 7919 + 13 + series * 1_000_003);
    let id = (dice.unit() * 3.0) as usize;
    let (blur_px, noise, tilt_deg) =
        (dice.between(0.0, 4.0), dice.between(0.0, 6.0), dice.between(0.0, 75.0));
    let distance_m = 600.0 * 0.08 / dice.between(35.0, 110.0);
    let (azimuth, turn) = (dice.between(0.0, 6.283), dice.between(0.0, 6.283));
    let axis = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
    let rotation = DQuat::from_axis_angle(axis, tilt_deg.to_radians()) * DQuat::from_rotation_z(turn);
    let middle = DVec2::splat(120.0) + DVec2::new(dice.between(-10.0, 10.0), dice.between(-10.0, 10.0));
    let corners_px = corners_of_tag_m(0.08).map(|corner| {
        let p = rotation * corner + DVec3::Z * distance_m;
        middle + DVec2::new(p.x, p.y) * 600.0 / p.z
    });
    let levels = [dice.between(0.5, 0.95), dice.between(0.1, 0.7), dice.between(0.02, 0.06)];
    let light = blurred(&draw_light(SIDE, SIDE, id, &corners_px, levels), blur_px);
    let mut gray = Image::filled(SIDE, SIDE, 0u8);
    for (gray, light) in gray.pixels_mut().iter_mut().zip(light.pixels()) {
        *gray = (srgb(*light) * 255.0 + noise * dice.normal()).round().clamp(0.0, 255.0) as u8;
    }
    Drawn { gray, corners_px, id, blur_px, noise, tilt_deg }
}

fn srgb(light: f64) -> f64 {
    if light <= 0.0031308 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

fn blurred(light: &Image<f64>, blur_px: f64) -> Image<f64> {
    let half = (4.0 * blur_px).ceil() as i64;
    let kernel: Vec<f64> =
        (-half..=half).map(|k| (-0.5 * (k as f64 / blur_px.max(0.05)).powi(2)).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    let along = |from: &Image<f64>, step: (i64, i64)| {
        let mut to = Image::filled(SIDE, SIDE, 0.0);
        for y in 0..SIDE {
            for x in 0..SIDE {
                let at = |k: i64, t: usize, s: i64| (t as i64 + s * k).clamp(0, SIDE as i64 - 1) as usize;
                let weighted =
                    kernel.iter().zip(-half..).map(|(w, k)| w * from.at(at(k, x, step.0), at(k, y, step.1)));
                *to.at_mut(x, y) = weighted.sum::<f64>() / sum;
            }
        }
        to
    };
    along(&along(light, (1, 0)), (0, 1))
}

/// A tag that was found: what it was, its corners' errors and what was said of them.
struct Measured {
    drawn: [f64; 3],
    errors_px: [f64; 8],
    sigma_px: f64,
}

impl Measured {
    fn rms_px(&self) -> f64 {
        (self.errors_px.iter().map(|e| e * e).sum::<f64>() / 8.0).sqrt()
    }
}

fn measured(series: u64, seeds: std::ops::Range<u64>) -> Vec<Measured> {
    let mut detector = TagDetector::new(TagOptions::thorough()).unwrap();
    let mut found = Vec::new();
    let mut all = Vec::new();
    for seed in seeds {
        let tag = drawn(series, seed);
        detector.detect(&tag.gray, None, &mut found).unwrap();
        let Some(seen) = found.iter().find(|d| d.id == tag.id as u32) else { continue };
        let error = |k: usize| (seen.corners_px[k / 2] - tag.corners_px[k / 2])[k % 2].abs();
        all.push(Measured {
            drawn: [tag.blur_px, tag.noise, tag.tilt_deg],
            errors_px: std::array::from_fn(error),
            sigma_px: seen.corner_sigma_px,
        });
    }
    all
}

/// Share of the errors within the stated sigma, and the median of the tags' rms errors; printed as well.
fn coverage<'a>(name: &str, tags: impl Iterator<Item = &'a Measured>) -> (f64, f64) {
    let tags: Vec<&Measured> = tags.collect();
    let within = tags.iter().flat_map(|t| t.errors_px.iter().filter(|e| **e <= t.sigma_px)).count();
    let share = within as f64 / (8 * tags.len().max(1)) as f64;
    let mut rms: Vec<f64> = tags.iter().map(|t| t.rms_px()).collect();
    rms.sort_by(f64::total_cmp);
    let median = rms.get(rms.len() / 2).copied().unwrap_or(0.0);
    println!("{name:<20} {:>5} tags, {:5.1} % within sigma, rms {median:.4} px", tags.len(), 100.0 * share);
    (share, median)
}

/// How far a share of some tags may lie outside of 63 to 73 %: the errors of one tag hang together, so its eight coordinates
/// tell as much as three. Two standard deviations.
fn chance(tags: usize) -> f64 {
    2.0 * (0.68 * 0.32 / (3.0 * tags as f64)).sqrt()
}

/// 240 tags; with HALFLIGHT_ALL_TAGS=1 the 2,000 and as many of two other series. A fifth of them is not found: seen
/// too much from the side, or blurred until the cells run together.
#[test]
fn the_stated_sigma_holds_two_thirds_of_the_errors() {
    let all = std::env::var_os("HALFLIGHT_ALL_TAGS").is_some();
    let (count, series) = if all { (2000, &[0, 71, 902][..]) } else { (240, &[0][..]) };
    for series in series {
        let tags = measured(*series, 0..count);
        assert!(tags.len() as u64 * 10 >= count * 7, "{} of {count} found", tags.len());
        let (share, median) = coverage(&format!("series {series}"), tags.iter());
        assert!((0.63..=0.73).contains(&share), "{share}");
        // Measured: 0.012 px; 0.77 px before the blur was fitted.
        assert!(median < 0.02, "{median}");
        let blurs = &[0.0, 0.5, 1.0, 2.0, 3.0, 4.0][..];
        let tilts = &[0.0, 15.0, 30.0, 45.0, 60.0, 75.0][..];
        for (name, index, edges) in
            [("blur", 0, blurs), ("noise", 1, &[0.0, 1.5, 3.0, 4.5, 6.0][..]), ("tilt", 2, tilts)]
        {
            for band in edges.windows(2) {
                let inside = |t: &&Measured| (band[0]..band[1]).contains(&t.drawn[index]);
                hold(&format!("{name} {}..{}", band[0], band[1]), &tags, inside);
            }
        }
        for blur in blurs.windows(2) {
            for tilt in tilts.windows(2) {
                let inside = |t: &&Measured| {
                    (blur[0]..blur[1]).contains(&t.drawn[0]) && (tilt[0]..tilt[1]).contains(&t.drawn[2])
                };
                hold(&format!("blur {}.., tilt {}..", blur[0], tilt[0]), &tags, inside);
            }
        }
        // Nothing is far off and says nothing of it.
        let lost = tags.iter().filter(|t| t.rms_px() > 6.0 * t.sigma_px).count();
        assert!(lost * 100 <= tags.len(), "{lost} of {}", tags.len());
    }
}

/// Tags of a bin from which on its middle error is held, too.
const MANY: usize = 15;

/// Holds one bin of tags: as close to 68 % as so few of them can tell.
fn hold(name: &str, tags: &[Measured], inside: impl Fn(&&Measured) -> bool) {
    let count = tags.iter().filter(&inside).count();
    if count == 0 {
        return;
    }
    let (share, median) = coverage(name, tags.iter().filter(inside));
    let allowed = 0.63 - chance(count)..=0.73 + chance(count);
    // The middle one of a few tags with much noise says nothing of all.
    let is_near = count < MANY || median < 0.04;
    assert!(allowed.contains(&share) && is_near, "{name}, {count} tags: {share}, {median} px");
}

fn tool(arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_halflight"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn the_handed_tag_out_of_focus_is_where_it_is() {
    let Some(shared) = support::shared("the_handed_tag_out_of_focus") else { return };
    for name in ["input.png", "sharp.png"] {
        for decimate in ["1", "2"] {
            let picture = shared.join("cases/tag-blurred").join(name);
            let focal = ["--focal", "600,600,320,240", "--size", "0.08", "--decimate", decimate, "--json"];
            let tags = &tool(&[&["tags", picture.to_str().unwrap()][..], &focal[..]].concat())["tags"];
            let at = |row: usize| tags[0]["camera_from_tag"][row][3].as_f64().unwrap();
            let off_mm = DVec3::new(at(0), at(1), at(2)).distance(DVec3::new(0.02, -0.01, 0.5)) * 1e3;
            println!(
                "{name} at decimate {decimate}: {off_mm:.3} mm off, sigma {}",
                tags[0]["corner_sigma_px"]
            );
            // Measured: at most 0.1 mm; 13 mm before.
            assert!(off_mm < 0.5, "{name} at decimate {decimate}: {off_mm} mm");
            assert!(tags[0]["corner_sigma_px"].as_f64().unwrap() < 0.05);
        }
    }
}

#[test]
fn the_oblique_tag_of_the_room_is_found_in_a_reduced_picture() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("room_reduced");
    std::fs::create_dir_all(&folder).unwrap();
    let settings = folder.join("settings.toml");
    std::fs::write(&settings, "[track]\ndecimate = 2\n").unwrap();
    let out = folder.join("run");
    let (settings, out) = (settings.to_str().unwrap(), out.to_str().unwrap());
    let replay = ["replay", "tests/recordings/room.mcap", "--config", settings, "--out", out];
    let report = tool(&[&replay[..], &["--frames", "12", "--no-frames", "--json"][..]].concat());
    println!("{:#}", report["pose"]);
    assert_eq!(report["pose"]["measured_frames"], 12);
    assert!(report["pose"]["position_error"]["max_mm"].as_f64().unwrap() < 5.0);
}
