//! `halflight render`: one still of a scene file or of a reference case.

mod background;
mod case_light;
mod case_room;
mod compare;
mod scene_still;
mod still;

pub use compare::{Comparison, MaskError, ShadowError, compare};
pub use scene_still::of_scene;
pub(super) use scene_still::{above_horizon, middle_of};
pub(super) use still::halve_options;
pub use still::{CaseStills, Drawn, Quantity, Still, default_image, of_case};

use super::{CliError, Common, quality_flags::QualityFlags};
use crate::assets::{case, pictures, scene};
use crate::config::Settings;
use crate::engine::Engine;
use crate::math::lens::Lens;
use crate::model::picture::PictureView;
use std::path::{Path, PathBuf};

/// Draw one still of a scene file or of a reference case.
///
/// Of a scene file (its head says what it may hold) the camera's pictures are merged and are the background, shown
/// at the first picture's exposure; the light is read from the ball's pictures, from an environment, or as stated.
///
/// Of a case (a JSON file or its folder) the receivers are shaded without the objects, from the case's own
/// emitters: Lambert, exact irradiance, no interreflection. That picture stands for the camera's, and the
/// objects are drawn over it by the engine as over any other. The objects' light: one directional emitter is
/// the hard half and everything else the soft half; a constant sky alone is soft; any other light is split as
/// --split says. Where a plane z = 0 is among the receivers the lower half of a distant light is cut off.
///
/// Example: halflight render shared/reference/f4_sun45 --image sun_only --out sun.exr --compare
#[derive(clap::Args, Debug)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Scene file (TOML), or reference case (JSON, or the folder with case.json).
    #[arg(value_name = "SCENE|CASE")]
    pub input: PathBuf,
    /// Where to write: .exr (linear radiance, 32-bit float) or .png (8 bits through sRGB).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Which image of the case: its objects are present, its emitters shine. Images called ratio and diff_*
    /// give the ratio to, and the difference from, the picture without objects.
    #[arg(long, value_name = "NAME")]
    pub image: Option<String>,
    /// Print the errors against the case's own picture, overall and inside its masks.
    #[arg(long)]
    pub compare: bool,
    /// Exposure of the PNG: radiance times this many seconds is what the response turns into 8 bits
    /// [default: such that nine tenths of the picture lie below 0.8].
    #[arg(long, value_name = "SECONDS")]
    pub exposure_s: Option<f64>,
    /// Columns of the picture of a case, with rows and focal lengths in proportion [default: the case's own].
    #[arg(long, value_name = "PX", conflicts_with = "compare")]
    pub width_px: Option<u32>,
    /// Draw so many times more and report the median time of each pass.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub repeat: usize,
    /// What is shown: light, direct, global, cast, self, lambert, phong, mirror, blockers, maps or final.
    #[arg(long, value_name = "VIEW", default_value = PictureView::Final.name(), conflicts_with = "compare")]
    pub view: String,
    /// Accuracy against time.
    #[command(flatten)]
    pub quality: QualityFlags,
}

/// Runs `halflight render`.
pub fn run(arguments: Arguments, common: &Common) -> Result<(), CliError> {
    if let Some(seconds) = arguments.exposure_s
        && !(seconds.is_finite() && seconds > 0.0)
    {
        return Err(CliError(format!("--exposure-s = {seconds}: must be above 0 s")));
    }
    let save = arguments.out.as_deref().map(output_format).transpose()?;
    let view = view_named(&arguments.view)?;
    let mut settings = Settings::default();
    arguments.quality.apply(&mut settings)?;
    let quality = settings.quality;
    let mut engine = common.open_engine()?;
    let mut notes = Vec::new();
    let is_scene = arguments.input.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let (mut still, case) = if is_scene {
        if arguments.image.is_some() || arguments.width_px.is_some() {
            return Err(CliError(
                "--image, --width-px: belong to reference cases, not to scene files".into(),
            ));
        }
        let file = scene::load(&arguments.input).map_err(|e| CliError(e.to_string()))?;
        (scene_still::of_scene(&file, engine.as_mut(), &quality, &mut notes)?, None)
    } else {
        let mut case = case::load(&arguments.input).map_err(|e| CliError(e.to_string()))?;
        if let Some(width_px) = arguments.width_px {
            case.lens = scaled(&case.lens, width_px)?;
        }
        let image = match &arguments.image {
            Some(name) => name.clone(),
            None => default_image(&case)?,
        };
        (still::of_case(&case, &image, &quality)?, Some((case, image)))
    };
    still.view = view;
    let drawn = still.draw(engine.as_mut(), &quality, arguments.exposure_s, arguments.repeat)?;

    if let (Some(out), Some(format)) = (&arguments.out, save) {
        match format {
            Format::Exr => pictures::save_exr_f32(out, &drawn.radiance),
            Format::Png => pictures::save_png(out, &drawn.display),
        }
        .map_err(|e| CliError(e.to_string()))?;
    }
    let comparison = match (&case, arguments.compare) {
        (Some((case, image)), true) => Some(compare::compare(case, image, &still, &drawn)?),
        (None, true) => {
            return Err(CliError::on("--compare", "only a reference case has a picture to compare with"));
        }
        _ => None,
    };
    report(&arguments, common, engine.as_ref(), &drawn, comparison.as_ref(), &notes);
    Ok(())
}

/// What `--view` names.
pub(super) fn view_named(name: &str) -> Result<PictureView, CliError> {
    PictureView::from_name(name)
        .ok_or_else(|| CliError(format!("--view = {name}: must be one of {}", PictureView::NAMES.join(", "))))
}

/// A lens for another number of columns.
fn scaled(lens: &Lens, width_px: u32) -> Result<Lens, CliError> {
    if !(16..=4096).contains(&width_px) {
        return Err(CliError(format!("--width-px = {width_px}: must be within 16..=4096")));
    }
    let k = f64::from(width_px) / f64::from(lens.width);
    let height = ((f64::from(lens.height) * k).round() as u32).max(1);
    let (fx, fy, cx, cy) = (lens.fx * k, lens.fy * k, lens.cx * k, lens.cy * k);
    Ok(Lens { width: width_px, height, fx, fy, cx, cy, ..*lens })
}

enum Format {
    Exr,
    Png,
}

fn output_format(out: &Path) -> Result<Format, CliError> {
    match out.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("exr") => Ok(Format::Exr),
        Some("png") => Ok(Format::Png),
        _ => Err(CliError(format!("--out = {}: must end in .exr or .png", out.display()))),
    }
}

fn report(
    arguments: &Arguments,
    common: &Common,
    engine: &dyn Engine,
    drawn: &Drawn,
    comparison: Option<&Comparison>,
    notes: &[String],
) {
    let digest = common.digest.then(|| drawn.digest());
    if common.json {
        let passes: Vec<_> =
            drawn.timings.iter().map(|t| serde_json::json!({ "pass": t.pass.name(), "ms": t.ms })).collect();
        let left_out: Vec<_> = drawn
            .plan
            .left_out
            .iter()
            .map(|p| serde_json::json!({ "pass": p.pass.name(), "reason": p.reason }))
            .collect();
        let report = serde_json::json!({
            "input": arguments.input, "out": arguments.out, "engine": engine.description(),
            "width_px": drawn.radiance.width(), "height_px": drawn.radiance.height(),
            "notes": notes, "passes": passes, "left_out": left_out,
            "comparison": comparison.map(Comparison::json), "digest": digest,
        });
        println!("{report}");
        return;
    }
    println!("engine  {}", engine.description());
    for note in notes {
        println!("  {note}");
    }
    for planned in &drawn.plan.passes {
        let ms = drawn.timings.iter().find(|t| t.pass == planned.pass).map_or(0.0, |t| t.ms);
        println!("  {:<30}{ms:8.2} ms  {}", planned.pass.name(), planned.reason);
    }
    for planned in &drawn.plan.left_out {
        println!("  {:<30}left out     {}", planned.pass.name(), planned.reason);
    }
    if let Some(comparison) = comparison {
        print!("{comparison}");
    }
    if let Some(out) = &arguments.out {
        println!("wrote   {}", out.display());
    }
    if let Some(digest) = digest {
        println!("digest  {digest}");
    }
}
