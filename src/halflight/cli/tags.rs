//! `halflight tags`: AprilTags in one picture, and where they are.

use super::output::{say, say_digest};
use super::{CliError, GlobalOptions};
use crate::assets::{calibration, pictures};
use crate::lab::digest::PixelDigest;
use crate::math::{lens::Lens, pose::Pose};
use crate::model::image::{Image, Rgb8Image};
use crate::track::{
    tag::{TagDetection, TagDetector, TagOptions, gray_of},
    tag_pose::{TagPoses, solve},
};
use glam::{DVec2, DVec3};
use serde::Serialize;
use std::path::PathBuf;

const AFTER_HELP: &str = "\
Finds tag36h11 AprilTags in a picture and the pose of each in the camera's frame (x right, y down, z forward;
metres). The tag's own frame: origin in its middle, x right and y down in its upright picture, z into it.

--json prints format and tags, a list; each tag has id, corners_px (lower left, lower right, upper right, upper left of the black
square in its upright picture; pixel (0, 0) covers 0 to 1), camera_from_tag (4x4, row by row), reprojection_px
(root mean square over the corners' coordinates), ambiguity (error of the second pose over that of the first; below
2 the corners leave the choice open; 1e6 where there is no second pose), and that second pose.

Example: halflight tags desk.png --camera camera.yml --size 0.08 --out found.png";

/// Arguments of `halflight tags`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER_HELP)]
#[command(group = clap::ArgGroup::new("lens").required(true).args(["camera", "focal"]))]
pub struct TagsArguments {
    /// The picture: PNG or JPEG, 8-bit, as the camera gave it.
    pub image: PathBuf,
    /// Calibration of the camera: OpenCV YAML, ROS camera_info YAML, or lists K and D. FILE#NAME picks one of
    /// several cameras, e.g. stereo.yml#M2.
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// A lens without distortion, in pixels: focal lengths and principal point. Pixel (0, 0) covers 0 to 1, so a
    /// principal point in the middle of 640 x 480 is 320,240.
    #[arg(long, value_name = "FX,FY,CX,CY", allow_hyphen_values = true)]
    pub focal: Option<String>,
    /// Side of the tags' black square, metres.
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    pub size: f64,
    /// Look for tags in a picture reduced by this whole factor, 1 to 8: 2 is four times as fast and misses tags
    /// below about 25 pixels.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub decimate: u32,
    /// Mend up to this many wrong bits, 0 to 2: more finds worse prints, and more that is no tag.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub mended_bits: u32,
    /// Write the picture with outlines and axes (x red, y green, z blue; half a side long) as PNG.
    #[arg(long, value_name = "FILE.png")]
    pub out: Option<PathBuf>,
}

/// One tag in `--json`.
#[derive(Serialize)]
struct TagReport {
    id: u32,
    corners_px: [[f64; 2]; 4],
    /// Row by row; null where the corners are no picture of a square through this lens.
    camera_from_tag: Option<[[f64; 4]; 4]>,
    reprojection_px: Option<f64>,
    ambiguity: Option<f64>,
    other_camera_from_tag: Option<[[f64; 4]; 4]>,
    other_reprojection_px: Option<f64>,
    distance_m: Option<f64>,
    hamming: u32,
    decision_margin: f32,
    corner_sigma_px: f64,
}

/// Runs `halflight tags`.
pub fn run(arguments: TagsArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if !(arguments.size > 0.0 && arguments.size.is_finite()) {
        let why = format!("must be above 0 metres, was {}", arguments.size);
        return Err(CliError::on("--size", why));
    }
    let picture = pictures::load_rgb8(&arguments.image)?;
    let lens = lens_of(&arguments, &picture)?;
    let options = TagOptions {
        decimate: arguments.decimate,
        mended_bits: arguments.mended_bits,
        ..TagOptions::thorough()
    };
    let mut gray = Image::default();
    gray_of(&picture, &mut gray);
    let mut tags = Vec::new();
    let mut detector = TagDetector::new(options)?;
    detector.detect(&gray, None, &mut tags).map_err(|e| CliError::on(arguments.image.display(), e))?;
    let poses: Vec<Option<TagPoses>> =
        tags.iter().map(|t| solve(&t.corners_px, arguments.size, &lens)).collect();
    if global.json {
        let reports: Vec<TagReport> = tags.iter().zip(&poses).map(|(t, p)| report(t, p.as_ref())).collect();
        let report = serde_json::json!({ "format": super::JSON_FORMAT, "tags": reports });
        say(&serde_json::to_string_pretty(&report)?)?;
    } else {
        say(&table(&tags, &poses))?;
    }
    if arguments.out.is_some() || global.digest {
        let mut drawn = picture;
        for (tag, poses) in tags.iter().zip(&poses) {
            annotate(&mut drawn, tag, poses.as_ref(), arguments.size, &lens);
        }
        if let Some(out) = &arguments.out {
            pictures::save_png(out, &drawn)?;
        }
        if global.digest {
            let mut digest = PixelDigest::default();
            digest.add_bytes(drawn.pixels());
            say_digest(&digest.hex(), global.json)?;
        }
    }
    Ok(())
}

fn lens_of(arguments: &TagsArguments, picture: &Rgb8Image) -> Result<Lens, CliError> {
    let (width, height) = (picture.width(), picture.height());
    if let Some(file) = &arguments.camera {
        let lens = calibration::load(file)?;
        return Ok(calibration::for_picture(lens, width, height, file)?);
    }
    let text = arguments.focal.as_deref().unwrap_or_default();
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [fx, fy, cx, cy]
            if text.split(',').count() == 4
                && fx > 0.0
                && fy > 0.0
                && numbers.iter().all(|n| n.is_finite()) =>
        {
            Ok(Lens::pinhole(width as u32, height as u32, fx, fy, cx, cy))
        }
        _ => Err(CliError(format!(
            "--focal {text}: must be four numbers FX,FY,CX,CY in pixels, FX and FY above 0, e.g. 535,535,320,240"
        ))),
    }
}

fn report(tag: &TagDetection, poses: Option<&TagPoses>) -> TagReport {
    let other = poses.and_then(|p| p.other);
    TagReport {
        id: tag.id,
        corners_px: tag.corners_px.map(|c| c.to_array()),
        camera_from_tag: poses.map(|p| p.best.camera_from_tag.to_rows()),
        reprojection_px: poses.map(|p| p.best.rms_px),
        ambiguity: poses.map(|p| p.ambiguity),
        other_camera_from_tag: other.map(|o| o.camera_from_tag.to_rows()),
        other_reprojection_px: other.map(|o| o.rms_px),
        distance_m: poses.map(|p| p.best.camera_from_tag.translation.length()),
        hamming: tag.hamming,
        decision_margin: tag.decision_margin,
        corner_sigma_px: tag.corner_sigma_px,
    }
}

fn table(tags: &[TagDetection], poses: &[Option<TagPoses>]) -> String {
    if tags.is_empty() {
        return "no tag36h11 tag found".to_owned();
    }
    let mut text = String::from(
        "  id     middle (px)      distance   position in the camera's frame (m)  reprojection  second pose\n",
    );
    for (tag, poses) in tags.iter().zip(poses) {
        let middle = tag.middle_px();
        text += &format!("{:4}  {:7.1} {:7.1}", tag.id, middle.x, middle.y);
        let Some(poses) = poses else {
            text += "   no pose: the corners are no picture of a square through this lens\n";
            continue;
        };
        let best = &poses.best;
        let t = best.camera_from_tag.translation;
        text += &format!("  {:9.4} m  {:10.4} {:10.4} {:10.4}", t.length(), t.x, t.y, t.z);
        text += &format!("    {:7.3} px  ", best.rms_px);
        text += &match &poses.other {
            Some(_) if poses.is_ambiguous(tag.corner_sigma_px) => {
                format!("{:.1} times the error: ambiguous\n", poses.ambiguity)
            }
            Some(_) => format!("{:.1} times the error\n", poses.ambiguity),
            None => "none\n".to_owned(),
        };
    }
    let plural = if tags.len() == 1 { "" } else { "s" };
    text + &format!("{} tag{plural}", tags.len())
}

/// Draws a tag's outline (first corner marked) and its axes.
fn annotate(picture: &mut Rgb8Image, tag: &TagDetection, poses: Option<&TagPoses>, side_m: f64, lens: &Lens) {
    for i in 0..4 {
        line(picture, tag.corners_px[i], tag.corners_px[(i + 1) % 4], [255, 220, 0]);
    }
    for (dx, dy) in [(-3.0, -3.0), (-3.0, 3.0)] {
        let arm = DVec2::new(dx, dy);
        line(picture, tag.corners_px[0] - arm, tag.corners_px[0] + arm, [255, 0, 255]);
    }
    let Some(poses) = poses else { return };
    let pose: &Pose = &poses.best.camera_from_tag;
    let colours = [[255, 60, 60], [60, 255, 60], [80, 140, 255]];
    for (axis, colour) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(colours) {
        let ends = [DVec3::ZERO, axis * side_m / 2.0].map(|p| lens.project(pose.transform(p)));
        if let [Some(from), Some(to)] = ends {
            line(picture, from, to, colour);
        }
    }
}

/// A line two pixels wide; what lies outside the picture is left out.
fn line(picture: &mut Rgb8Image, from: DVec2, to: DVec2, colour: [u8; 3]) {
    // Nothing reaches this far; it bounds the number of steps for wild projections.
    let limit = 4.0 * (picture.width() + picture.height()) as f64;
    if !(from.length() < limit && to.length() < limit) {
        return;
    }
    let steps = (from.distance(to) * 2.0).ceil().max(1.0) as usize;
    for k in 0..=steps {
        let p = from.lerp(to, k as f64 / steps as f64);
        for offset in [DVec2::splat(-0.5), DVec2::new(0.5, -0.5), DVec2::new(-0.5, 0.5), DVec2::splat(0.5)] {
            let q = (p + offset).floor();
            if q.x >= 0.0 && q.y >= 0.0 {
                let (x, y) = (q.x as usize, q.y as usize);
                if x < picture.width() && y < picture.height() {
                    *picture.at_mut(x, y) = colour;
                }
            }
        }
    }
}
