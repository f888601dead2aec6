//! Exposures to radiance: real brackets, known responses, and whatever chance brings.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use halflight::math::dice::Dice;
use halflight::{
    assets::{case, pictures},
    hdr::{
        attribute::{ExposureVerdict, Tolerance, attribute, check_exposures},
        black_level::{black_level, clip_black},
        merge_bracket::{MAX_PICTURES, merge_bracket},
        response::{ResponseOrigin, SolveOptions, solve},
    },
    model::{
        frame::Exposure,
        image::{HdrImage, LOWER_BOUND, Rgb8Image, UPPER_BOUND},
        response::Response,
    },
};
use proptest::prelude::*;
use std::{
    path::{Path, PathBuf},
    process::Command,
};

fn seconds(times_s: &[f64]) -> Vec<Exposure> {
    times_s.iter().map(|&time_s| Exposure { time_s, gain: 1.0 }).collect()
}

/// A bracket from files.
struct Real {
    name: String,
    pictures: Vec<Rgb8Image>,
    times_s: Vec<f64>,
}

impl Real {
    fn load(name: &str, folder: &Path, files: &[(&str, f64)]) -> Self {
        let pictures =
            files.iter().map(|(file, _)| pictures::load_rgb8(&folder.join(file)).unwrap()).collect();
        Self { name: name.into(), pictures, times_s: files.iter().map(|f| f.1).collect() }
    }

    fn refs(&self) -> Vec<&Rgb8Image> {
        self.pictures.iter().collect()
    }

    fn verdicts(&self, response: &Response, tolerance: Tolerance) -> Vec<ExposureVerdict> {
        let check = check_exposures(&self.refs(), &seconds(&self.times_s), response, tolerance);
        check.reports().iter().map(|r| r.verdict).collect()
    }
}

fn living_room(shared: &Path) -> Real {
    // As image_list.txt states them.
    let files = [("DSC_0071.png", 0.25), ("DSC_0073.png", 1.0), ("DSC_0075.png", 4.0)];
    Real::load("living_room1_negative", &shared.join("data/brackets/living_room1_negative"), &files)
}

/// Columns and rows of the memorial pictures that are free of the scans' blue borders in every picture.
const MEMORIAL_INSIDE: [std::ops::Range<usize>; 2] = [14..496, 34..714];

fn memorial(shared: &Path) -> Real {
    let names: Vec<(String, f64)> =
        (0..16).map(|k| (format!("memorial{:04}.png", 61 + k), 32.0 / f64::from(1 << k))).collect();
    let files: Vec<(&str, f64)> = names.iter().map(|(n, t)| (n.as_str(), *t)).collect();
    let mut real = Real::load("memorial", &shared.join("data/brackets/memorial"), &files);
    let [columns, rows] = MEMORIAL_INSIDE;
    for picture in &mut real.pictures {
        let pixels = rows.clone().flat_map(|y| picture.row(y)[columns.clone()].to_vec()).collect();
        *picture = Rgb8Image::from_pixels(columns.len(), rows.len(), pixels).unwrap();
    }
    real
}

fn mirror_ball(shared: &Path) -> Real {
    let files = [("ola_raw1.jpg", 1.0 / 10.0), ("ola_raw2.jpg", 1.0 / 40.0), ("ola_raw3.jpg", 1.0 / 160.0)];
    Real::load("mirrorball", &shared.join("data/mirrorball"), &files)
}

const F5: [&str; 4] = ["f5_overcast_city", "f5_room_windows", "f5_studio_lamps", "f5_sun_beach"];

fn f5(shared: &Path, name: &str) -> (Real, Response) {
    let photographs = case::load(&shared.join("reference").join(name)).unwrap().photographs.unwrap();
    let pictures = photographs.exposures.iter().map(|(file, _)| pictures::load_rgb8(file).unwrap()).collect();
    let times_s = photographs.exposures.iter().map(|(_, t)| *t).collect();
    (Real { name: name.into(), pictures, times_s }, photographs.response)
}

fn solved(real: &Real) -> Response {
    let recovered = solve(&real.refs(), &seconds(&real.times_s), &SolveOptions::default());
    assert!(
        matches!(recovered.origin, ResponseOrigin::Solved { .. }),
        "{}: {:?}",
        real.name,
        recovered.origin
    );
    recovered.response
}

#[test]
fn memorial_agrees_with_the_authors_own_merge() {
    let Some(shared) = support::shared("memorial_agrees_with_the_authors_own_merge") else { return };
    let mut real = memorial(&shared);
    // The scans hold no value below 14: fog, which the exposures tell from light.
    let level = black_level(&real.refs(), &seconds(&real.times_s));
    println!("memorial: black level {level:?}");
    assert!(level.iter().all(|z| (15..=25).contains(z)), "{level:?}");
    for picture in &mut real.pictures {
        *picture = clip_black(picture, level);
    }
    let theirs = pictures::load_radiance(&shared.join("data/brackets/memorial/memorial.hdr")).unwrap();
    let [columns, rows] = MEMORIAL_INSIDE;
    let mut ours = HdrImage::default();
    merge_bracket(&real.refs(), &seconds(&real.times_s), &solved(&real), &mut ours).unwrap();
    let log = |[r, g, b]: [f32; 3]| f64::from(0.2126 * r + 0.7152 * g + 0.0722 * b).max(1e-9).ln();
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for j in rows.clone() {
        for i in columns.clone() {
            x.push(log(*ours.radiance.at(i - columns.start, j - rows.start)));
            y.push(log(*theirs.hdr.radiance.at(i, j)));
        }
    }
    let r = correlation(&x, &y);
    println!("memorial: log-luminance correlation {r:.5}");
    assert!(r >= 0.999, "{r}");
}

fn correlation(x: &[f64], y: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (mx, my) = (mean(x), mean(y));
    let dot = |a: &[f64], ma: f64, b: &[f64], mb: f64| -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum()
    };
    dot(x, mx, y, my) / (dot(x, mx, x, mx) * dot(y, my, y, my)).sqrt()
}

#[test]
fn false_times_are_noticed() {
    let Some(shared) = support::shared("false_times_are_noticed") else { return };
    let real = living_room(&shared);
    let verdicts = real.verdicts(&Response::srgb(), Tolerance::GUESSED_RESPONSE);
    assert_eq!(verdicts, [ExposureVerdict::Contradicted; 3]);
    // Nor can a response be made of them.
    let recovered = solve(&real.refs(), &seconds(&real.times_s), &SolveOptions::default());
    let ResponseOrigin::Fallback { why } = recovered.origin else { panic!("{:?}", recovered.origin) };
    assert!(why.contains("contradict the stated exposures"), "{why}");
    assert_eq!(recovered.response, Response::srgb());
}

#[test]
fn true_times_raise_no_alarm() {
    let Some(shared) = support::shared("true_times_raise_no_alarm") else { return };
    let mut all = vec![memorial(&shared), mirror_ball(&shared)];
    all.extend(F5.map(|name| f5(&shared, name).0));
    for real in &all {
        for (response, tolerance) in
            [(Response::srgb(), Tolerance::GUESSED_RESPONSE), (solved(real), Tolerance::KNOWN_RESPONSE)]
        {
            let verdicts = real.verdicts(&response, tolerance);
            assert!(!verdicts.contains(&ExposureVerdict::Contradicted), "{}: {verdicts:?}", real.name);
            let consistent = verdicts.iter().filter(|v| **v == ExposureVerdict::Consistent).count();
            // The three darkest of memorial share too little with the others.
            assert!(consistent >= verdicts.len().min(13), "{}: {verdicts:?}", real.name);
        }
    }
}

#[test]
fn a_late_statement_is_noticed_and_put_right() {
    let Some(shared) = support::shared("a_late_statement_is_noticed_and_put_right") else { return };
    let (mut real, response) = f5(&shared, "f5_room_windows");
    let truth = seconds(&real.times_s);
    // Each frame states the exposure of the frame before it.
    real.times_s.rotate_right(1);
    let verdicts = real.verdicts(&response, Tolerance::KNOWN_RESPONSE);
    assert!(verdicts.contains(&ExposureVerdict::Contradicted), "{verdicts:?}");
    for (k, frame) in real.pictures.iter().enumerate() {
        let reference = (k + 1) % 3;
        let (index, measured_s) =
            attribute(frame, &real.pictures[reference], truth[reference], &truth, &response).unwrap();
        assert_eq!(index, k);
        // Calibrated response; shot noise and 8 bits leave a percent.
        assert!((measured_s / truth[k].time_s - 1.0).abs() < 0.02, "{measured_s} {}", truth[k].time_s);
    }
}

#[test]
fn f5_is_merged_to_its_hdr_picture() {
    let Some(shared) = support::shared("f5_is_merged_to_its_hdr_picture") else { return };
    for name in F5 {
        let (real, response) = f5(&shared, name);
        let truth = pictures::load_radiance(&shared.join("reference").join(name).join("hdr.exr")).unwrap();
        let mut ours = HdrImage::default();
        merge_bracket(&real.refs(), &seconds(&real.times_s), &response, &mut ours).unwrap();
        let mut errors: Vec<f64> = Vec::new();
        let all = ours.radiance.pixels().iter().zip(truth.hdr.radiance.pixels()).zip(ours.flags.pixels());
        for (i, ((ours, truth), flags)) in all.enumerate() {
            if *flags == 0 {
                // Where some picture is well exposed.
                let good = |c: &usize| real.pictures.iter().any(|p| (30..=225).contains(&p.pixels()[i][*c]));
                errors.extend((0..3).filter(good).map(|c| f64::from((ours[c] / truth[c]).ln())));
            } else if *flags == LOWER_BOUND {
                let sure = (0..3).all(|c| ours[c] <= truth[c] * 1.15 + 1e-3);
                assert!(sure, "{name}: a lower bound above the truth: {ours:?} {truth:?}");
            }
        }
        let count = errors.len();
        errors.sort_by(f64::total_cmp);
        let (low, median, high) = (errors[count / 100], errors[count / 2], errors[count * 99 / 100]);
        println!("{name}: ln error 1 % {low:.3}, median {median:.4}, 99 % {high:.3}");
        assert!(median.abs() < 0.005 && low > -0.2 && high < 0.2, "{name}: {low} {median} {high}");
    }
}

/// Standard normal, near enough.
fn normal(dice: &mut Dice) -> f64 {
    (0..12).map(|_| dice.unit()).sum::<f64>() - 6.0
}

/// Patches of radiance over e^7, seen at these times through a response, with noise in units of 8-bit values.
fn patches(times_s: &[f64], response: &Response, noise: f64) -> Vec<Rgb8Image> {
    let mut dice = Dice::new(7);
    let radiance: Vec<f64> = (0..40 * 30).map(|_| (7.0 * dice.unit() - 3.5).exp()).collect();
    times_s
        .iter()
        .map(|t| {
            let pixels = (0..160 * 120)
                .map(|i| {
                    let patch = (i / 160 / 4) * 40 + i % 160 / 4;
                    std::array::from_fn(|c| {
                        let z = f64::from(response.value_of(c, (radiance[patch] * t) as f32));
                        (z + noise * normal(&mut dice)).round().clamp(0.0, 255.0) as u8
                    })
                })
                .collect();
            Rgb8Image::from_pixels(160, 120, pixels).unwrap()
        })
        .collect()
}

fn gamma(exponent: f64) -> Response {
    Response::new([std::array::from_fn(|z| (exponent * ((z as f64).max(0.5) / 255.0).ln()) as f32); 3])
        .unwrap()
}

#[test]
fn a_known_response_is_recovered() {
    let times_s = [0.02, 0.06, 0.2, 0.6, 2.0];
    // Spec 3: max |g - g_true| over 10..245 with lambda 20 is 0.28, 0.35, 0.57. Without a toe (gamma 1.6) noise bends the dark end more.
    let cases = [
        ("gamma 2.2", gamma(2.2), [0.28, 0.35, 0.57]),
        ("sRGB", Response::srgb(), [0.28, 0.35, 0.57]),
        ("gamma 1.6", gamma(1.6), [0.28, 0.35, 0.65]),
    ];
    for (name, truth, most) in cases {
        for (noise, most) in [0.0, 1.0, 3.0].into_iter().zip(most) {
            let pictures = patches(&times_s, &truth, noise);
            let pictures: Vec<_> = pictures.iter().collect();
            let log_exposure_at_128 = truth.log_exposure().map(|g| f64::from(g[128]));
            let options = SolveOptions { log_exposure_at_128, ..SolveOptions::default() };
            let recovered = solve(&pictures, &seconds(&times_s), &options);
            assert!(matches!(recovered.origin, ResponseOrigin::Solved { .. }), "{:?}", recovered.origin);
            let mut worst = 0.0f32;
            for (found, truth) in recovered.response.log_exposure().iter().zip(truth.log_exposure()) {
                assert_eq!(found[128], truth[128], "the gauge");
                assert!(found.windows(2).all(|pair| pair[1] >= pair[0]));
                worst = (10..=245).map(|z| (found[z] - truth[z]).abs()).fold(worst, f32::max);
            }
            println!("{name}, noise {noise} DN: max |g - g_true| = {worst:.3} (at most {most})");
            assert!(worst <= most, "{name}, noise {noise}: {worst}");
        }
    }
}

#[test]
fn what_tells_no_response_falls_back() {
    let srgb = Response::srgb();
    let why = |real_s: &[f64], stated_s: &[f64]| {
        let pictures = patches(real_s, &srgb, 1.0);
        let pictures: Vec<_> = pictures.iter().collect();
        let recovered = solve(&pictures, &seconds(stated_s), &SolveOptions::default());
        assert_eq!(recovered.response, srgb);
        match recovered.origin {
            ResponseOrigin::Fallback { why } => why,
            ResponseOrigin::Solved { .. } => panic!("{real_s:?} {stated_s:?} was solved"),
        }
    };
    assert!(why(&[0.1, 0.1, 0.1], &[0.1, 0.1, 0.1]).contains("at least 2 is needed"));
    assert!(why(&[1e4, 4e4], &[1e4, 4e4]).contains("usable pixels"));
    assert!(why(&[1e-6, 4e-6], &[1e-6, 4e-6]).contains("usable pixels"));
    assert!(why(&[0.1, 0.1, 0.1], &[0.1, 0.4, 1.6]).contains("contradict"));
}

/// Up to 16 random pictures of one size with exposures over twelve decades.
fn bracket() -> impl Strategy<Value = (Vec<Rgb8Image>, Vec<Exposure>)> {
    // Ends of the scale, where the weights vanish, come often.
    let value = prop_oneof![Just(0u8), Just(255u8), any::<u8>()];
    (1..=MAX_PICTURES, 1..40usize, 1..5usize).prop_flat_map(move |(count, width, height)| {
        let pixels = proptest::collection::vec([value.clone(), value.clone(), value.clone()], width * height);
        let picture = pixels.prop_map(move |p| Rgb8Image::from_pixels(width, height, p).unwrap());
        let exposure = (-6.0..6.0f64, 0.5..32.0f64)
            .prop_map(|(log_t, gain)| Exposure { time_s: 10f64.powf(log_t), gain });
        (proptest::collection::vec(picture, count), proptest::collection::vec(exposure, count))
    })
}

fn response() -> impl Strategy<Value = Response> {
    proptest::collection::vec(0.0..0.2f32, 256).prop_map(|steps| {
        let mut sum = -15.0;
        Response::new(
            [std::array::from_fn(|z| {
                sum += steps[z];
                sum
            }); 3],
        )
        .unwrap()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn merges_are_finite_not_negative_and_rightly_flagged((pictures, exposures) in bracket(), response in response()) {
        let pictures: Vec<_> = pictures.iter().collect();
        let mut out = HdrImage::default();
        merge_bracket(&pictures, &exposures, &response, &mut out).unwrap();
        for i in 0..out.radiance.pixels().len() {
            let mut flags = 0;
            for (c, &e) in out.radiance.pixels()[i].iter().enumerate() {
                prop_assert!(e.is_finite() && e >= 0.0);
                let z: Vec<u8> = pictures.iter().map(|p| p.pixels()[i][c]).collect();
                if z.iter().all(|z| [0, 255].contains(z)) {
                    flags |= if z.contains(&255) { LOWER_BOUND } else { 0 };
                    flags |= if z.contains(&0) { UPPER_BOUND } else { 0 };
                }
                // A weighted mean lies between its parts.
                let parts = z.iter().zip(&exposures).map(|(&z, exposure)| {
                    f64::from(response.log_exposure()[c][usize::from(z)]) - exposure.effective_s().ln()
                });
                let low = parts.clone().fold(f64::INFINITY, f64::min);
                let high = parts.fold(f64::NEG_INFINITY, f64::max);
                let log = f64::from(e).ln();
                prop_assert!(log >= low - 1e-5 && log <= high + 1e-5, "{low} {log} {high}");
            }
            prop_assert_eq!(out.flags.pixels()[i], flags);
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let times_s = [0.01, 0.04, 0.16];
    let pictures = patches(&times_s, &Response::srgb(), 2.0);
    let pictures: Vec<_> = pictures.iter().collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut out = HdrImage::default();
        pool.install(|| merge_bracket(&pictures, &seconds(&times_s), &Response::srgb(), &mut out)).unwrap();
        out
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}

/// Runs `halflight hdr`; exit status, standard output, standard error.
fn tool(arguments: &[&str]) -> (i32, String, String) {
    let done = Command::new(env!("CARGO_BIN_EXE_halflight")).arg("hdr").args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (done.status.code().unwrap(), text(done.stdout), text(done.stderr))
}

/// An empty folder of this test's own.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("hdr_{test}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn write_patches(folder: &Path, times_s: &[f64]) -> Vec<String> {
    let pictures = patches(times_s, &Response::srgb(), 0.0);
    pictures
        .iter()
        .enumerate()
        .map(|(k, picture)| {
            let file = folder.join(format!("{k}.png"));
            pictures::save_png(&file, picture).unwrap();
            file.to_str().unwrap().to_owned()
        })
        .collect()
}

#[test]
fn the_tool_merges_and_says_how() {
    let folder = folder("merges");
    let files = write_patches(&folder, &[0.05, 0.2, 0.8]);
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (exr, camera) = (path("out.exr"), path("camera.json"));
    let mut words = vec!["--times", "1/20,0.2,0.8"];
    words.extend(files.iter().map(String::as_str));
    words.extend(["--out", &exr, "--save-response", &camera, "--json", "--digest"]);
    let (status, out, err) = tool(&words);
    assert_eq!(status, 0, "{err}");
    let json: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(json["response"]["kind"], "solved");
    assert_eq!((&json["width_px"], &json["height_px"]), (&160.into(), &120.into()));
    assert_eq!(json["warnings"].as_array().unwrap().len(), 0);
    assert_eq!(json["pictures"][0]["verdict"], "consistent");
    assert!(
        json["digest"].as_str().unwrap().len() == 64 && json["dynamic_range_stops"].as_f64().unwrap() > 5.0
    );
    // The saved response gives the same picture; times may also stand apart.
    let mut again = vec!["--times", "0.05", "0.2", "0.8"];
    again.extend(files.iter().map(String::as_str));
    again.extend(["--response", &camera, "--json", "--digest", "--threads", "1"]);
    let (status, out, err) = tool(&again);
    assert_eq!(status, 0, "{err}");
    let repeated: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(repeated["digest"], json["digest"]);
    let written = pictures::load_radiance(Path::new(&exr)).unwrap();
    assert!(written.hdr.radiance.pixels().iter().flatten().all(|e| e.is_finite() && *e >= 0.0));
    // Two equal pictures with different times: merged, with a warning for people.
    let (status, out, err) = tool(&["--times", "0.05,0.2", &files[0], &files[0], "--out", &path("x.png")]);
    assert_eq!(status, 0, "{err}");
    assert!(err.contains("but its pixels say 1.0") && err.contains("sRGB stands in"), "{err}");
    assert!(out.contains("contradicted"), "{out}");
}

#[test]
fn the_tool_refuses_what_it_cannot_do() {
    let folder = folder("refuses");
    let files = write_patches(&folder, &[0.05, 0.2]);
    let (a, b) = (files[0].as_str(), files[1].as_str());
    let small = folder.join("small.png").to_str().unwrap().to_owned();
    pictures::save_png(Path::new(&small), &Rgb8Image::filled(20, 10, [9; 3])).unwrap();
    let broken = folder.join("broken.png").to_str().unwrap().to_owned();
    std::fs::write(&broken, &std::fs::read(a).unwrap()[..200]).unwrap();
    let table = folder.join("table.json").to_str().unwrap().to_owned();
    std::fs::write(&table, r#"{"log_exposure_rgb":[[1.0],[],[]]}"#).unwrap();
    let list = folder.join("list.txt").to_str().unwrap().to_owned();
    std::fs::write(&list, "# name seconds\n0.png 0.05\n1.png soon\n").unwrap();
    let cases: [(&[&str], &str); 13] = [
        (&["--times", "0.05", a, b], "2 pictures but 1 exposure times"),
        (&[a, b], "2 pictures but 0 exposure times"),
        (&["--times", "0.05,0.2"], "no pictures: 1 to 16 are needed"),
        (&["--times", "0.05,0", a, b], "\"0\" is no exposure time: must be seconds above 0"),
        (&["--times", "0.05,1/0", a, b], "\"1/0\" is no exposure time"),
        (&["--times", "0.05,0.2", a, &small], "small.png: 20 x 10 pixels, but"),
        (&["--times", "0.05,0.2", a, "nowhere.png"], "nowhere.png"),
        (&["--times", "0.05,0.2", a, &broken], "broken.png"),
        (&["--times", "0.05,0.2", a, b, "--out", "x.tiff"], "x.tiff: must end in .exr, .hdr or .png"),
        (&["--times", "0.05,0.2", a, b, "--response", "log"], "must be solve, srgb, gamma2.2 or a JSON file"),
        (&["--times", "0.05,0.2", a, b, "--response", &table], "log_exposure_rgb: must be three lists"),
        (&["--times", "0.05,0.2", a, b, "--lambda", "0"], "--lambda = 0: must be above 0"),
        (&["--times-file", &list], "line 3"),
    ];
    for (words, expected) in cases {
        let (status, out, err) = tool(words);
        assert!(status == 2 && err.contains(expected) && out.is_empty(), "{words:?}: {status} {err}");
    }
}
