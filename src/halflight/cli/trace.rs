//! `halflight trace`: ground truth of a still, by ray tracing.

use super::output::{make_folder, shown, write_file};
use super::progress::{Bar, host};
use super::run_folder::{self, refuse_existing};
use super::{CliError, GlobalOptions, render::is_scene_file};
use crate::assets::{pictures, scene as scene_file};
use crate::lab::case::{self, default_image, is_a_mask};
use crate::lab::digest::PixelDigest;
use crate::lab::open_exr::save_exr_f32;
use crate::lab::still::{
    of_scene, pleasant_exposure_s,
    traced::{LightOf, of_still},
};
use crate::math::color::srgb_encode;
use crate::model::{
    image::{Image, RadianceImage, Rgb8Image},
    quality::Quality,
};
use crate::reference::{
    self, SHADOW_BELOW, TraceError, TraceNoise, TraceScene, TraceSettings, Traced, Tracer,
};
use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// What a trace leaves in its folder.
const LEFT: [&str; 4] = ["*.exr", "*.png", "noise.json", CHECKPOINT];
/// How often an unfinished trace is written down.
const KEEP_EVERY: Duration = Duration::from_secs(10);
/// Name of the file that it is written to.
const CHECKPOINT: &str = "trace.checkpoint";

const AFTER_HELP: &str = "\
Traces the scene twice at once, with and without its virtual objects, on the same random numbers, and leaves in DIR:
with.exr and without.exr (linear radiance), ratio.exr (with / without), difference.exr (without - with), their standard
errors (*_error.exr), objects.exr (light of the objects alone, times their coverage), coverage.png, over.exr (a scene
file: the objects over the camera's own picture, whose surfaces are dimmed by the ratio), previews (*.png), noise.json,
and trace.checkpoint, from which --resume goes on, also to more samples than were asked for at first.

Of a case spheres are exact, surfaces reflect from their front and only direct light counts, as in its own pictures. Of a
scene file camera, light and things are those of halflight render; real surfaces of unknown albedo count as 0.5, and
virtual objects get from them what the environment shows in their direction.

Pictures do not depend on the number of threads, nor on where a trace was cut and taken up again.

Example: halflight trace shared/reference/f4_sun45 --image sun_only --out truth --samples 256";

/// Arguments of `halflight trace`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER_HELP)]
pub struct TraceArguments {
    /// Scene file (TOML), or reference case (JSON, or the folder with case.json).
    #[arg(value_name = "SCENE|CASE")]
    pub input: PathBuf,
    /// Folder to write to. It is made where it is missing.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Which image of the case: its objects are present, its emitters shine.
    #[arg(long, value_name = "NAME")]
    pub image: Option<String>,
    /// Samples of each pixel. Where --noise is given, at most this many.
    #[arg(long, value_name = "N", default_value_t = TraceSettings::default().samples)]
    pub samples: u32,
    /// Samples of each pixel that are stratified together: a power of two. The noise is known from two passes on
    /// [default: 64, or half of --samples where that is less].
    #[arg(long, value_name = "N")]
    pub samples_a_pass: Option<u32>,
    /// How many more times light may be reflected after the first time. 0: direct light only.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub bounces: u32,
    /// Stop when noise adds less than this to a relative RMSE of the ratio in the shadow, such as 0.005.
    #[arg(long, value_name = "SHARE")]
    pub noise: Option<f64>,
    /// Seed of the random numbers: another seed gives other noise.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u32,
    /// Trace only every k-th pixel of every k-th row.
    #[arg(long, value_name = "K", default_value_t = 1)]
    pub step_px: u32,
    /// Replace what an earlier trace has left in DIR.
    #[arg(long)]
    pub force: bool,
    /// Go on from DIR/trace.checkpoint where there is one.
    #[arg(long)]
    pub resume: bool,
}

impl TraceArguments {
    fn settings(&self) -> TraceSettings {
        TraceSettings {
            samples: self.samples,
            samples_a_pass: self.samples_a_pass.unwrap_or_else(|| samples_a_pass(self.samples)),
            bounces: self.bounces,
            seed: self.seed,
            step_px: self.step_px,
            shadow_noise: self.noise,
        }
    }
}

/// Samples of a pass, where so many of a pixel are asked for: no more than asked, and two passes where two can be.
fn samples_a_pass(samples: u32) -> u32 {
    let most = (samples / 2).clamp(1, TraceSettings::default().samples_a_pass);
    1 << most.ilog2()
}

/// What is traced, and the camera's own picture where there is one.
struct TraceInput {
    scene: TraceScene,
    /// Linear radiance.
    place: Option<RadianceImage>,
}

/// Reads a scene file or a case. `notes` gets lines for people.
fn read_input(
    arguments: &TraceArguments,
    global: &GlobalOptions,
    notes: &mut Vec<String>,
) -> Result<TraceInput, CliError> {
    let (input, image) = (&arguments.input, arguments.image.as_deref());
    if is_scene_file(input) {
        if image.is_some() {
            return Err(CliError("--image: belongs to reference cases, not to scene files".into()));
        }
        let file = scene_file::load(input)?;
        let quality = Quality::default();
        let mut engine = global.open_engine()?;
        let still = of_scene(&file, engine.as_mut(), &quality, &host(), notes)?;
        let scene = of_still(LightOf::File(&file), &still, &quality)?;
        let has_picture = file.camera.as_ref().is_some_and(|camera| !camera.pictures.files.is_empty());
        return Ok(TraceInput { scene, place: has_picture.then_some(still.background.radiance) });
    }
    let case = case::load(input)?;
    let image = match image {
        Some(name) => name.to_owned(),
        None => default_image(&case)?,
    };
    if case.image(&image)?.is_mask() {
        return Err(is_a_mask(&case, &image).into());
    }
    Ok(TraceInput { scene: case.trace_scene(Some(&image))?, place: None })
}

/// Runs `halflight trace`.
///
/// # Errors
/// A mistake in the arguments; an input that cannot be traced; a file that cannot be read or written.
pub fn run(arguments: TraceArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let mut notes = Vec::new();
    let out = &arguments.out;
    refuse_existing(out, arguments.force || arguments.resume)?;
    let threads = global.threads()?;
    let input = read_input(&arguments, global, &mut notes)?;
    // Nothing is left in the folder for a setting that is out of its range.
    reference::check(&input.scene, &arguments.settings())?;
    if arguments.resume {
        make_folder(out)?;
    } else {
        run_folder::begin(out, "trace", &LEFT)?;
    }
    let work = || work(&arguments, &input.scene);
    let (traced, speed) = match threads {
        None => work()?,
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.map_err(|e| CliError::on(format!("--threads = {threads}"), e))?.install(work)?
        }
    };
    let digest = save(out, &traced, input.place.as_ref())?;
    let noise = known_noise(&traced, &arguments.settings());
    let noise_report = noise_json(&traced, &noise, &speed);
    write_file(&out.join("noise.json"), serde_json::to_string_pretty(&noise_report)?)?;
    if global.json {
        let mut report = serde_json::json!({"format": super::JSON_FORMAT, "input": shown(&arguments.input), "out": shown(out), "notes": notes, "noise": noise_report});
        if global.digest {
            report["digest"] = digest.into();
        }
        println!("{report}");
        return Ok(());
    }
    for note in &notes {
        println!("  {note}");
    }
    print!("{}", report(&traced, &noise, &speed));
    println!("wrote   {}", out.display());
    if global.digest {
        println!("digest  {digest}");
    }
    Ok(())
}

/// How fast it went.
struct Speed {
    samples: u64,
    seconds: f64,
}

impl Speed {
    fn msamples_a_second(&self) -> f64 {
        if self.seconds > 0.0 { self.samples as f64 * 1e-6 / self.seconds } else { 0.0 }
    }
}

/// Traces with a bar, and writes down what was done every now and then.
fn work(arguments: &TraceArguments, scene: &TraceScene) -> Result<(Traced, Speed), CliError> {
    let file = arguments.out.join(CHECKPOINT);
    let on_file = |e: TraceError| match e {
        TraceError::Checkpoint(why) => CliError(format!("{}: {why}", file.display())),
        other => other.into(),
    };
    let mut tracer = Tracer::new(scene, &arguments.settings()).map_err(on_file)?;
    if arguments.resume && file.exists() {
        let bytes = std::fs::read(&file).map_err(|e| CliError::on(file.display(), e))?;
        tracer.resume(&bytes).map_err(on_file)?;
    }
    let bar = Bar::of_count(Some(u64::from(arguments.samples)), "samples a pixel");
    bar.set_count(u64::from(tracer.samples()));
    bar.begin_here();
    let (start, begun_at) = (Instant::now(), tracer.samples());
    let mut kept = start;
    while !tracer.is_done() {
        tracer.pass();
        bar.set_count(u64::from(tracer.samples()));
        if kept.elapsed() > KEEP_EVERY {
            keep(&file, &tracer)?;
            kept = Instant::now();
            bar.say(format!("({:.2} % noise)", 100.0 * tracer.noise().with_relative));
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    drop(bar);
    let samples = u64::from(tracer.samples() - begun_at) * tracer.pixels() as u64;
    if samples > 0 {
        keep(&file, &tracer)?;
    }
    Ok((tracer.finish(), Speed { samples, seconds }))
}

/// Writes down what was traced so far.
fn keep(file: &Path, tracer: &Tracer) -> Result<(), CliError> {
    write_file(file, tracer.checkpoint())
}

/// Writes all pictures; returns the digest of with and without.
fn save(out: &Path, traced: &Traced, place: Option<&RadianceImage>) -> Result<String, CliError> {
    let (with, without) = (traced.with(), traced.without());
    let mut digest = PixelDigest::default();
    digest.add_floats(with.pixels());
    digest.add_floats(without.pixels());
    let exposure = pleasant_exposure_s(&without) as f32;
    let over = place.and_then(|place| traced.over(place));
    let gray = |value: &f32| [(255.0 * value.clamp(0.0, 1.0)).round() as u8; 3];
    let coverage = of_pixels(&traced.coverage(), gray);
    for (name, picture) in [
        ("ratio", &traced.ratio()),
        ("difference", &traced.difference()),
        ("with_error", &traced.with_error()),
        ("without_error", &traced.without_error()),
        ("ratio_error", &traced.ratio_error()),
        ("difference_error", &traced.difference_error()),
        ("objects", &traced.objects()),
        ("with", &with),
        ("without", &without),
    ]
    .into_iter()
    .chain(over.as_ref().map(|over| ("over", over)))
    {
        save_exr_f32(&out.join(format!("{name}.exr")), picture)?;
    }
    let preview =
        |picture: &RadianceImage, scale: f32| of_pixels(picture, |rgb| rgb.map(|c| encoded(scale * c)));
    let mut previews = vec![
        ("with", preview(&with, exposure)),
        ("without", preview(&without, exposure)),
        ("ratio", preview(&traced.ratio(), 1.0)),
        ("difference", preview(&traced.difference(), exposure)),
        ("coverage", coverage),
    ];
    if let Some(over) = &over {
        previews.push(("over", preview(over, pleasant_exposure_s(over) as f32)));
    }
    for (name, picture) in &previews {
        pictures::save_png(&out.join(format!("{name}.png")), picture)?;
    }
    Ok(digest.hex())
}

fn of_pixels<P: Clone>(picture: &Image<P>, value: impl Fn(&P) -> [u8; 3]) -> Rgb8Image {
    let pixels = picture.pixels().iter().map(value).collect();
    Rgb8Image::from_pixels(picture.width(), picture.height(), pixels).unwrap_or_default()
}

fn encoded(linear: f32) -> u8 {
    (255.0 * srgb_encode(linear.clamp(0.0, 1.0))).round() as u8
}

/// The noise of a trace: nothing is known of it after a single pass, which has nothing to be compared with.
fn known_noise(traced: &Traced, settings: &TraceSettings) -> TraceNoise {
    let unknown = traced.samples <= settings.samples_a_pass;
    let known = |share: f64| if unknown { f64::NAN } else { share };
    TraceNoise {
        with_relative: known(traced.noise.with_relative),
        without_relative: known(traced.noise.without_relative),
        shadow_relative: known(traced.noise.shadow_relative),
        ..traced.noise
    }
}

/// For machines; what is not known is null.
fn noise_json(traced: &Traced, noise: &TraceNoise, speed: &Speed) -> serde_json::Value {
    let TraceNoise { with_relative, without_relative, shadow_pixels, shadow_relative, dropped } = *noise;
    serde_json::json!({
        "samples_a_pixel": traced.samples, "with_relative": with_relative, "without_relative": without_relative,
        "shadow_pixels": shadow_pixels, "shadow_relative": shadow_relative, "dropped_samples": dropped,
        "seconds": speed.seconds, "msamples_a_second": speed.msamples_a_second(),
    })
}

fn report(traced: &Traced, noise: &TraceNoise, speed: &Speed) -> String {
    let percent = |share: f64| {
        if share.is_finite() {
            format!("{:.3} %", 100.0 * share)
        } else {
            "not known from a single pass".into()
        }
    };
    let mut lines = format!("{} samples a pixel", traced.samples);
    if speed.samples > 0 {
        lines +=
            &format!(", {:.2} s, {:.2} million samples a second", speed.seconds, speed.msamples_a_second());
    }
    lines += &format!(
        "\nnoise (root mean square standard error over the mean)\n  with    {}\n  without {}\n  shadow  {} of the ratio's mean, over {} pixels with a ratio below {SHADOW_BELOW}\n",
        percent(noise.with_relative),
        percent(noise.without_relative),
        percent(noise.shadow_relative),
        noise.shadow_pixels
    );
    if noise.dropped > 0 {
        lines += &format!("  {} samples were not finite and are left out\n", noise.dropped);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_samples_are_traced_as_are_asked_for_in_two_passes_or_more() {
        for (samples, a_pass) in [(1, 1), (2, 1), (3, 1), (16, 8), (24, 8), (128, 64), (1000, 64)] {
            assert_eq!(samples_a_pass(samples), a_pass, "{samples}");
        }
    }
}
