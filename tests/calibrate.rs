//! `halflight calibrate camera`, from drawn pictures of a board to a lens on disk.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/json_schema.rs"]
mod json_schema;
mod support;

use glam::{DQuat, DVec2, DVec3};
use halflight::assets::{calibration, pictures};
use halflight::calibrate::AprilGrid;
use halflight::math::{lens::Lens, pose::Pose};
use halflight::model::image::Rgb8Image;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const BOARD: &str = "apriltag:3x1,size=0.1,spacing=0.3";
const GRID: AprilGrid = AprilGrid { columns: 3, rows: 1, size_m: 0.1, spacing: 0.3 };
/// Codes of tag36h11, ids 0 to 2, and the cells of a quarter of their spirals (column, row), from the highest bit on.
const CODES: [u64; 3] = [0x0000_000d_7e00_984b, 0x0000_000d_da66_4ca7, 0x0000_000d_c4a1_c821];
const QUARTER: [(usize, usize); 9] = [(1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (2, 2), (3, 2), (4, 2), (3, 3)];

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("halflight-calibrate-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    fn at(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// White cells of a tag, row by row from the top, 8 x 8 with a black border of one cell.
fn cells(id: usize) -> [[bool; 8]; 8] {
    let mut cells = [[false; 8]; 8];
    for bit in 0..36 {
        let (mut x, mut y) = QUARTER[bit % 9];
        for _ in 0..bit / 9 {
            (x, y) = (7 - y, x);
        }
        cells[y][x] = CODES[id] >> (35 - bit) & 1 == 1;
    }
    cells
}

/// Light of a place of a chessboard of 10 x 7 squares of 30 mm with white around it.
fn chess_light(on_board: DVec2) -> f64 {
    let cell = on_board / 0.03;
    let is_square = (-1.0..9.0).contains(&cell.x) && (-1.0..6.0).contains(&cell.y);
    let is_black = is_square && (cell.x.floor() + cell.y.floor()).rem_euclid(2.0) == 0.0;
    if is_black { 0.03 } else { 0.8 }
}

/// The same with a border of two cells.
fn wider(cells: &[[bool; 8]; 8]) -> Vec<Vec<bool>> {
    let mut wide = vec![vec![false; 10]; 10];
    for (y, row) in cells.iter().enumerate() {
        wide[y + 1][1..9].copy_from_slice(row);
    }
    wide
}

/// Light of a place of the board of tags: white, but for the black of its tags.
fn light(on_board: DVec2, tags: &[Vec<Vec<bool>>]) -> f64 {
    let pitch = GRID.size_m * (1.0 + GRID.spacing);
    let (column, x) = ((on_board.x / pitch).floor(), on_board.x.rem_euclid(pitch) / GRID.size_m);
    let y = on_board.y / GRID.size_m;
    let is_tag = (0.0..3.0).contains(&column) && x < 1.0 && (0.0..1.0).contains(&y);
    let cells = tags[0].len();
    let cell = |share: f64| ((share * cells as f64) as usize).min(cells - 1);
    let is_white = !is_tag || tags[column as usize][cell(1.0 - y)][cell(x)];
    if is_white { 0.8 } else { 0.03 }
}

/// A view of a board, 3 x 3 samples a pixel.
fn draw(lens: &Lens, camera_from_board: &Pose, light: impl Fn(DVec2) -> f64) -> Rgb8Image {
    let board_from_camera = camera_from_board.inverse();
    let origin = board_from_camera.translation;
    let seen = |pixel: DVec2| {
        let direction = board_from_camera.rotate(lens.unproject(pixel).unwrap());
        let place = origin - direction * (origin.z / direction.z);
        light(place.truncate())
    };
    let (width, height) = (lens.width as usize, lens.height as usize);
    let pixels = (0..width * height).map(|i| {
        let corner = DVec2::new((i % width) as f64, (i / width) as f64);
        let samples = (0..9).map(|k| corner + DVec2::new((k % 3) as f64 + 0.5, (k / 3) as f64 + 0.5) / 3.0);
        let mean = samples.map(seen).sum::<f64>() / 9.0;
        let encoded = if mean <= 0.003_130_8 { 12.92 * mean } else { 1.055 * mean.powf(1.0 / 2.4) - 0.055 };
        [(255.0 * encoded).round() as u8; 3]
    });
    Rgb8Image::from_pixels(width, height, pixels.collect()).unwrap()
}

/// A dozen views of a board about its middle, as files.
fn draw_views(folder: &Folder, lens: &Lens, middle: DVec3, light: impl Fn(DVec2) -> f64) -> Vec<String> {
    let facing = DQuat::from_rotation_x(std::f64::consts::PI);
    let mut files = Vec::new();
    for k in 0..12 {
        let angle = f64::from(k) * 2.4;
        let axis = DVec3::new(angle.cos(), angle.sin(), 0.15 * f64::from(k % 3 - 1));
        let turn = DQuat::from_axis_angle(axis.normalize(), [0.75, 0.5, 0.9][k as usize % 3]) * facing;
        let roll = DQuat::from_rotation_z(f64::from(k) * 0.7);
        let rotation = roll * turn;
        let place = DVec3::new(0.05 * (1.7 * angle).cos(), 0.04 * (1.3 * angle).sin(), 0.48);
        let file = folder.at(&format!("board-{k:02}.png"));
        let picture = draw(lens, &Pose::new(rotation, place - rotation * middle), &light);
        pictures::save_png(Path::new(&file), &picture).unwrap();
        files.push(file);
    }
    files
}

fn calibrate(arguments: &[String]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_halflight"))
        .args(["calibrate", "camera"])
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn pictures_of_a_board_give_the_lens_that_drew_them() {
    let folder = Folder::new("tags");
    let lens = Lens::pinhole(480, 360, 400.0, 404.0, 246.0, 174.0);
    let middle = DVec3::new(0.5 * GRID.size_m * (3.0 + 2.0 * GRID.spacing), 0.5 * GRID.size_m, 0.0);
    let tags = [0, 1, 2].map(|id| cells(id).map(Vec::from).to_vec());
    let files = draw_views(&folder, &lens, middle, |place| light(place, &tags));
    let out = folder.at("lens.yml");
    let with = |files: &[String], more: &[&str]| {
        let more = more.iter().map(|s| (*s).to_owned());
        files
            .iter()
            .cloned()
            .chain(["--board".into(), BOARD.into(), "--out".into(), out.clone()])
            .chain(more)
            .collect()
    };
    let few: Vec<String> = with(&files[..3], &[]);
    let refused = calibrate(&few);
    let why = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && why.contains("at least 4 must"), "{why}");
    assert!(!Path::new(&out).exists());
    let done = calibrate(&with(&files, &["--json"]));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let told: Value = serde_json::from_slice(&done.stdout).unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let schema = std::fs::read_to_string(root.join("docs/json/calibrate.json")).unwrap();
    let mut found = Vec::new();
    json_schema::misfits(&told, &serde_json::from_str(&schema).unwrap(), "calibrate", &mut found);
    assert!(found.is_empty(), "{found:?}");
    let written = calibration::load(Path::new(&out)).unwrap();
    println!("rms {} px, fx {} +- {}, fy {}", told["rms_px"], written.fx, told["fx_sigma_px"], written.fy);
    assert!(told["rms_px"].as_f64().unwrap() < 0.15, "{told}");
    assert!(
        (written.fx / lens.fx - 1.0).abs() < 0.01 && (written.fy / lens.fy - 1.0).abs() < 0.01,
        "{written:?}"
    );
    assert_eq!((written.width, written.height), (480, 360));
    assert_eq!(calibrate(&with(&files, &[])).status.code(), Some(2), "what is there stays without --force");
    let printed = calibrate(&with(&files, &["--force"]));
    let text = String::from_utf8_lossy(&printed.stdout);
    assert!(printed.status.success() && text.contains("reprojection rms") && text.contains("+-"), "{text}");
}

/// Calibrates from files; the lens, and what was told of it.
fn lens_of(files: &[String], board: &str, out: &str) -> (Lens, Value) {
    let ends = ["--board", board, "--out", out, "--json"].map(str::to_owned);
    let done = calibrate(&[files, &ends].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let told: Value = serde_json::from_slice(&done.stdout).unwrap();
    (calibration::load(Path::new(out)).unwrap(), told)
}

#[test]
fn a_chessboard_gives_the_lens_that_drew_it() {
    let folder = Folder::new("chess");
    let lens = Lens::pinhole(480, 360, 400.0, 404.0, 246.0, 174.0);
    let files = draw_views(&folder, &lens, DVec3::new(0.12, 0.075, 0.0), chess_light);
    let (found, told) = lens_of(&files, "chessboard:9x6,size=0.03", &folder.at("lens.yml"));
    println!("{told}");
    assert!(told["rms_px"].as_f64().unwrap() < 0.1, "{told}");
    for (name, ours, truth) in [
        ("fx", found.fx, lens.fx),
        ("fy", found.fy, lens.fy),
        ("cx", found.cx, lens.cx),
        ("cy", found.cy, lens.cy),
    ] {
        let sigma = told[format!("{name}_sigma_px")].as_f64().unwrap();
        assert!(
            sigma < 0.5 && (ours - truth).abs() < 3.5 * sigma,
            "{name}: {ours}, not {truth}; sigma {sigma}"
        );
    }
    // A smaller board is not this one.
    let ends = ["--board", "chessboard:5x4,size=0.03", "--out", &folder.at("other.yml")].map(str::to_owned);
    assert_eq!(calibrate(&[files.as_slice(), &ends].concat()).status.code(), Some(2));
}

/// Against what OpenCV found on its own pictures. Its file has one view with 1.18 px, ours leaves such corners out.
#[test]
fn photographs_of_a_chessboard_give_the_lens_that_opencv_finds() {
    let name = "photographs_of_a_chessboard_give_the_lens_that_opencv_finds";
    let Some(shared) = support::shared(name) else { return };
    let calib = shared.join("data/calib/opencv_chess");
    let theirs = calibration::load(&calib.join("left_intrinsics.yml")).unwrap();
    let numbers = [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14];
    let files: Vec<String> =
        numbers.iter().map(|k| calib.join(format!("left{k:02}.jpg")).display().to_string()).collect();
    let folder = Folder::new("photographs");
    let (found, told) = lens_of(&files, "chessboard:9x6,size=0.025", &folder.at("lens.yml"));
    println!("{told} and theirs {theirs:?}");
    assert!(told["rms_px"].as_f64().unwrap() < 0.39, "{told}: OpenCV's own rms is 0.3926 px");
    // Where a pixel in the picture looks to, by both lenses.
    for x in [100.0, 320.0, 540.0] {
        for y in [80.0, 240.0, 400.0] {
            let ours = found.unproject(DVec2::new(x, y)).unwrap();
            let there = theirs.project(ours).unwrap();
            println!("{x} {y}: {}", there - DVec2::new(x, y));
            assert!((there - DVec2::new(x, y)).length() < 4.0, "{x} {y}: {there}");
        }
    }
}

#[test]
fn kalibr_s_border_of_two_cells_is_read() {
    let folder = Folder::new("wide");
    let lens = Lens::pinhole(480, 360, 400.0, 404.0, 246.0, 174.0);
    let middle = DVec3::new(0.5 * GRID.size_m * (3.0 + 2.0 * GRID.spacing), 0.5 * GRID.size_m, 0.0);
    let tags = [0, 1, 2].map(|id| wider(&cells(id)));
    let files = draw_views(&folder, &lens, middle, |place| light(place, &tags));
    let (found, told) = lens_of(&files, &format!("{BOARD},border=2"), &folder.at("lens.yml"));
    println!("{told}");
    assert!(told["rms_px"].as_f64().unwrap() < 0.15, "{told}");
    assert!((found.fx / lens.fx - 1.0).abs() < 0.01 && (found.fy / lens.fy - 1.0).abs() < 0.01, "{found:?}");
    // By one cell there is no tag.
    let ends = ["--board", BOARD, "--out", &folder.at("other.yml")].map(str::to_owned);
    assert_eq!(calibrate(&[files.as_slice(), &ends].concat()).status.code(), Some(2));
}
