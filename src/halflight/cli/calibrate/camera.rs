//! `halflight calibrate camera`.

use super::board::{BoardFinder, CalibrationBoard};
use crate::assets::{calibration, pictures};
use crate::calibrate::{BoardPoint, CalibratedLens, DistortionKind, LEAST_POINTS, calibrate};
use crate::cli::output::{shown, write_file};
use crate::cli::progress::Bar;
use crate::cli::run_folder::{need_folder_of, refuse_existing};
use crate::cli::{CliError, GlobalOptions, JSON_FORMAT};
use crate::math::lens::Distortion;
use crate::model::image::Image;
use crate::track::tag::gray_of;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Arguments of `halflight calibrate camera`.
#[derive(clap::Args, Debug)]
pub struct CameraArguments {
    /// Pictures of the board (PNG or JPEG, as the camera gave them, of one size): tilted to all sides, into all corners.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// The board. apriltag: = a grid of tag36h11 tags as Kalibr lays it out, tag 0 at the lower left; side of a tag's black square
    /// in metres, gap as a share of it; border=2 for Kalibr's own prints, whose black border has two cells. chessboard:9x6,size=0.025 = squares with so many corners inside,
    /// side of a square in metres; a part of the board is enough.
    #[arg(long, value_name = "BOARD")]
    board: String,
    /// Solve for a fisheye (equidistant, k1 to k4) in place of k1 k2 p1 p2 k3.
    #[arg(long)]
    fisheye: bool,
    /// The calibration to write (OpenCV's YAML).
    #[arg(long, value_name = "FILE.yml")]
    out: PathBuf,
    /// Replace a file that is there.
    #[arg(long)]
    force: bool,
}

/// Runs `halflight calibrate camera`.
pub fn run(a: CameraArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let board = CalibrationBoard::parse(&a.board)?;
    need_folder_of(&a.out)?;
    refuse_existing(&a.out, a.force)?;
    need_own_name(&a)?;
    let BoardViews { views, size, notes } = views_of(&a.pictures, &board)?;
    let kind = match a.fisheye {
        true => DistortionKind::Equidistant,
        false => DistortionKind::RadialTangential,
    };
    let found = calibrate(&views, size, kind).map_err(|e| {
        let seen = notes.iter().zip(&a.pictures).find_map(|(note, file)| Some((note.as_ref()?, file)));
        let seen = seen.map_or(String::new(), |(note, file)| format!("; {}: {note}", file.display()));
        CliError(format!("{}: {e}{seen}", a.board))
    })?;
    let note = format!(
        "halflight calibrate camera: {} views, rms {:.3} px, fx +- {:.2} px, fy +- {:.2} px",
        found.views.len(),
        found.rms_px,
        found.sigma_px[0],
        found.sigma_px[1]
    );
    write_file(&a.out, calibration::to_yaml(&found.lens, &note))?;
    if global.json {
        println!("{}", json_of(&a, &found, &views));
    } else {
        print(&a, &found, &views);
    }
    Ok(())
}

/// The calibration is no picture: `--force` must not replace one.
fn need_own_name(a: &CameraArguments) -> Result<(), CliError> {
    let is_yaml =
        a.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("yml") || e.eq_ignore_ascii_case("yaml"));
    if !is_yaml || a.out.is_dir() {
        let why = "must be the name of a file that ends in .yml or .yaml";
        return Err(CliError::on(format!("--out {}", a.out.display()), why));
    }
    Ok(())
}

/// The points of the board in each picture.
struct BoardViews {
    views: Vec<Vec<BoardPoint>>,
    /// Columns and rows of the pictures.
    size: (u32, u32),
    /// For each picture what was seen in place of the board.
    notes: Vec<Option<String>>,
}

fn views_of(files: &[PathBuf], board: &CalibrationBoard) -> Result<BoardViews, CliError> {
    let mut finder = BoardFinder::new(board)?;
    let mut gray = Image::default();
    let (mut views, mut notes, mut size) = (Vec::new(), Vec::new(), None);
    let bar = Bar::of_count(Some(files.len() as u64), "pictures");
    for file in files {
        let picture = pictures::load_rgb8(file)?;
        let this = (picture.width(), picture.height());
        let (width, height) = *size.get_or_insert(this);
        if this != (width, height) {
            let why = format!("is {} x {}, the pictures before it {width} x {height}", this.0, this.1);
            return Err(CliError::on(file.display(), why));
        }
        gray_of(&picture, &mut gray);
        let seen = finder.points(&gray).map_err(|e| CliError::on(file.display(), e))?;
        if let Some(note) = &seen.note {
            tracing::warn!("{}: {note}", file.display());
        }
        views.push(seen.points);
        notes.push(seen.note);
        bar.add_one();
    }
    let (width, height) = size.unwrap_or_default();
    Ok(BoardViews { views, size: (width as u32, height as u32), notes })
}

/// Pictures that show too little of the board.
fn left_out<'a>(a: &'a CameraArguments, views: &[Vec<BoardPoint>]) -> Vec<(&'a Path, usize)> {
    let few = a.pictures.iter().zip(views).filter(|(_, view)| view.len() < LEAST_POINTS);
    few.map(|(file, view)| (file.as_path(), view.len())).collect()
}

fn model_of(distortion: Distortion) -> (&'static str, Vec<f64>) {
    match distortion {
        Distortion::None => ("none", Vec::new()),
        Distortion::RadialTangential(k) => ("plumb_bob", k[..5].to_vec()),
        Distortion::Equidistant(k) => ("equidistant", k.to_vec()),
    }
}

fn json_of(a: &CameraArguments, found: &CalibratedLens, views: &[Vec<BoardPoint>]) -> serde_json::Value {
    let (lens, [fx, fy, cx, cy]) = (&found.lens, found.sigma_px);
    let (model, distortion) = model_of(lens.distortion);
    let seen: Vec<_> = (found.views.iter())
        .map(|v| {
            json!({
                "picture": shown(&a.pictures[v.index]), "points": v.points, "rms_px": v.rms_px,
                "tilt_deg": v.tilt_deg,
            })
        })
        .collect();
    let few: Vec<_> = (left_out(a, views).into_iter())
        .map(|(file, points)| json!({ "picture": shown(file), "points": points }))
        .collect();
    json!({
        "format": JSON_FORMAT, "what": "camera", "file": shown(&a.out), "rms_px": found.rms_px,
        "coverage": found.coverage, "outliers": found.outliers, "width_px": lens.width, "height_px": lens.height,
        "fx_px": lens.fx, "fy_px": lens.fy, "cx_px": lens.cx, "cy_px": lens.cy, "fx_sigma_px": fx, "fy_sigma_px": fy,
        "cx_sigma_px": cx, "cy_sigma_px": cy, "distortion_model": model, "distortion": distortion, "views": seen,
        "left_out": few,
    })
}

fn print(a: &CameraArguments, found: &CalibratedLens, views: &[Vec<BoardPoint>]) {
    let (lens, [fx, fy, cx, cy]) = (&found.lens, found.sigma_px);
    println!("picture                            points   rms px   tilt");
    for v in &found.views {
        let name = shown(&a.pictures[v.index]);
        println!("{name:<34} {:>6}   {:>6.3}   {:>3.0} deg", v.points, v.rms_px, v.tilt_deg);
    }
    for (file, points) in left_out(a, views) {
        println!("{:<34} {points:>6}   left out: shows fewer than {LEAST_POINTS} corners", shown(file));
    }
    println!("{}: reprojection rms {:.3} px", a.out.display(), found.rms_px);
    println!("fx {:.2} +- {fx:.2} px, fy {:.2} +- {fy:.2} px", lens.fx, lens.fy);
    println!("cx {:.2} +- {cx:.2} px, cy {:.2} +- {cy:.2} px", lens.cx, lens.cy);
    let (model, distortion) = model_of(lens.distortion);
    let numbers: Vec<String> = distortion.iter().map(|k| format!("{k:.5}")).collect();
    println!("distortion ({model}): {}", numbers.join(", "));
    println!("the board was seen in {:.0} % of the picture", 100.0 * found.coverage);
    if found.outliers > 0 {
        println!("{} corners fit nothing and were left out", found.outliers);
    }
}
