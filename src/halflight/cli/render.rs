//! `halflight render`: one still of a scene file or of a reference case.

use super::output::{self, OutputFormat};
use super::progress::host;
use super::{CliError, GlobalOptions, quality_flags::QualityFlags, run_folder::need_folder_of};
use crate::assets::{pictures, scene};
use crate::engine::Engine;
use crate::lab::case::{self, Case, CaseStills, Comparison, compare, default_image};
use crate::lab::still::{Drawn, Still, of_scene};
use crate::math::lens::Lens;
use crate::model::{picture::PictureView, quality::Quality};
use std::path::{Path, PathBuf};

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Draw one still of a scene file or of a reference case.\n\n\
Of a scene file: the camera's pictures are merged. They are the background, and are shown at the first \
picture's exposure. The light is read from the ball's pictures, taken from an environment picture, or stated \
in numbers.\n\n\
Of a case (a JSON file or its folder): the receivers are shaded without the objects, in the light of the \
case's own emitters. They are matt, their irradiance is exact, and no light goes from one to another. This \
picture stands for the camera's. Objects are drawn over it as over any other picture. A directional emitter \
is hard light, a constant sky is soft light, and any other light is split as --split says. Where the case \
has a plane z = 0, no light comes from below it.\n\n\
Example: halflight render shared/reference/f4_sun45 --image sun_only --out sun.exr --compare";

/// Arguments of `halflight render`.
#[derive(clap::Args, Debug)]
pub struct RenderArguments {
    /// Scene file (TOML), or reference case (JSON, or the folder with case.json).
    #[arg(value_name = "SCENE|CASE")]
    pub input: PathBuf,
    /// Where to write: .exr (linear radiance, 32-bit float) or .png (8 bits through sRGB).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Which image of the case: its objects are present, its emitters shine. An image called ratio is the picture over the
    /// picture without objects; one called diff_* is the difference of the two.
    #[arg(long, value_name = "NAME")]
    pub image: Option<String>,
    /// Print the errors against the case's own picture, overall and inside its masks.
    #[arg(long)]
    pub compare: bool,
    /// Exposure of the PNG: the response turns radiance times this many seconds into 8 bits
    /// [default: nine tenths of the picture lie below 0.8].
    #[arg(long, value_name = "SECONDS")]
    pub exposure_s: Option<f64>,
    /// Columns of the picture of a case, with rows and focal lengths in proportion [default: the case's own].
    #[arg(long, value_name = "PX", conflicts_with = "compare")]
    pub width_px: Option<u32>,
    /// Draw this many times more, and report the median time of each pass.
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
///
/// # Errors
/// A mistake in the arguments; an input that cannot be drawn; a file that cannot be written.
pub fn run(arguments: RenderArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if let Some(seconds) = arguments.exposure_s.filter(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(CliError(format!("--exposure-s = {seconds}: must be above 0 s")));
    }
    let allowed = [OutputFormat::Exr, OutputFormat::Png];
    let format = arguments.out.as_deref().map(|out| OutputFormat::of(out, &allowed)).transpose()?;
    let view = view_named(&arguments.view)?;
    if let Some(out) = &arguments.out {
        need_folder_of(out)?;
    }
    let mut settings = global.settings(None)?;
    arguments.quality.apply(&mut settings)?;
    let quality = settings.quality;
    let mut engine = global.open_engine()?;
    let mut notes = Vec::new();
    let (mut still, case) = still_of(&arguments, engine.as_mut(), &quality, &mut notes)?;
    still.view = view;
    let drawn = still.draw(engine.as_mut(), &quality, arguments.exposure_s, arguments.repeat)?;
    if let Some(near) = engine.near_choice() {
        notes.push(format!(
            "the room's light is drawn as {} near lights, {:.1} degrees wide on average, and {} suns",
            near.lights,
            near.width_rad.to_degrees(),
            near.suns
        ));
    }
    if let (Some(out), Some(format)) = (&arguments.out, format) {
        match format {
            OutputFormat::Exr => crate::lab::open_exr::save_exr_f32(out, &drawn.radiance),
            OutputFormat::Hdr | OutputFormat::Png => pictures::save_png(out, &drawn.display),
        }?;
    }
    let comparison = match (&case, arguments.compare) {
        (Some((case, image)), true) => Some(compare(case, image, &still, &drawn)?),
        (None, true) => {
            return Err(CliError::on("--compare", "only a reference case has a picture to compare with"));
        }
        _ => None,
    };
    let shown = ShownStill { drawn: &drawn, comparison: comparison.as_ref(), notes: &notes };
    report(&arguments, global, engine.as_ref(), &shown);
    Ok(())
}

/// The still that the arguments ask for; of a case with the case and the image.
fn still_of(
    arguments: &RenderArguments,
    engine: &mut dyn Engine,
    quality: &Quality,
    notes: &mut Vec<String>,
) -> Result<(Still, Option<(Case, String)>), CliError> {
    if is_scene_file(&arguments.input) {
        if arguments.image.is_some() || arguments.width_px.is_some() {
            let why = "belong to reference cases, not to scene files";
            return Err(CliError::on("--image, --width-px", why));
        }
        let file = scene::load(&arguments.input)?;
        return Ok((of_scene(&file, engine, quality, &host(), notes)?, None));
    }
    let mut case = case::load(&arguments.input)?;
    if let Some(width_px) = arguments.width_px {
        case.lens = scaled(&case.lens, width_px)?;
    }
    let image = match &arguments.image {
        Some(name) => name.clone(),
        None => default_image(&case)?,
    };
    let still = CaseStills::new(&case, &image)?.still(quality, &host());
    Ok((still, Some((case, image))))
}

/// Whether an input is a scene file, by its ending.
pub(super) fn is_scene_file(input: &Path) -> bool {
    input.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
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

/// What is told of a still.
struct ShownStill<'a> {
    drawn: &'a Drawn,
    comparison: Option<&'a Comparison>,
    notes: &'a [String],
}

fn report(arguments: &RenderArguments, global: &GlobalOptions, engine: &dyn Engine, shown: &ShownStill<'_>) {
    let ShownStill { drawn, comparison, notes } = *shown;
    let digest = global.digest.then(|| drawn.digest());
    if global.json {
        let passes: Vec<_> =
            drawn.timings.iter().map(|t| serde_json::json!({ "pass": t.pass.name(), "ms": t.ms })).collect();
        let left_out: Vec<_> = drawn
            .plan
            .left_out
            .iter()
            .map(|p| serde_json::json!({ "pass": p.pass.name(), "reason": p.reason }))
            .collect();
        let report = serde_json::json!({
            "format": super::JSON_FORMAT, "input": output::shown(&arguments.input),
            "out": arguments.out.as_deref().map(output::shown), "engine": engine.description(),
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
