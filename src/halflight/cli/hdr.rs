//! `halflight hdr`: exposures of one view into one linear picture.

use super::output::{OutputFormat, shown, write_file};
use super::progress::Bar;
use super::{CliError, GlobalOptions};
use crate::{
    assets::pictures,
    hdr::{
        attribute::{ExposureCheck, ExposureVerdict, Tolerance, check_exposures},
        black_level::{black_level, clip_black},
        merge_bracket::MAX_PICTURES,
        response::{ResponseOrigin, SolveOptions, solve},
    },
    lab::{digest::PixelDigest, open_exr::save_exr_f32, still::bracket::LoadedBracket},
    model::{
        frame::Exposure,
        image::{HdrImage, LOWER_BOUND, RadianceImage, Rgb8Image, UPPER_BOUND},
        response::Response,
    },
};
use std::path::{Path, PathBuf};

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Merge exposures of one view into one HDR picture of linear radiance [DM97].\n\n\
The unit of radiance is that of the response. Solved: value 128 after 1 s is 1. srgb and gamma2.2: value 255 \
after 1 s is 1. The stated time of each picture is checked against its pixels. A time that the pixels \
contradict is named in a warning, and the picture is merged all the same. A picture that is black, frozen, \
far too bright or of another white balance is named and left out; one a little brighter than stated is put right.\n\n\
Examples:\n\
halflight hdr --times 1/10,1/40,1/160 a.jpg b.jpg c.jpg --out room.exr\n\
halflight hdr --times-file image_list.txt --out room.hdr --save-response camera.json\n\
halflight hdr --times 0.004,0.016 --response camera.json a.png b.png --out room.png";

/// Arguments of `halflight hdr`.
#[derive(clap::Args, Debug)]
pub struct HdrArguments {
    /// Exposure time of each picture in seconds, in order: 0.025 or 1/40, joined by commas (or apart, before the
    /// pictures). Gain counts as time: state the product where gains differ.
    #[arg(long, value_name = "S", num_args = 1.., conflicts_with = "times_file")]
    pub times: Vec<String>,
    /// Text file with a line for each picture: its name, and its exposure time in seconds (further columns and
    /// lines that begin with # are passed over). Without IMG, the pictures that it names and that
    /// exist beside it are merged.
    #[arg(long, value_name = "FILE")]
    pub times_file: Option<PathBuf>,
    /// 1 to 16 pictures of one view and one size, PNG or JPEG.
    #[arg(value_name = "IMG")]
    pub images: Vec<PathBuf>,
    /// Where to write: .exr (32-bit float), .hdr (Radiance) or .png (8 bits through sRGB, nine tenths below 0.8).
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// The camera's response: solve (from the pictures; sRGB where they cannot tell, with a warning), srgb, gamma2.2,
    /// or a JSON file with log_exposure_rgb: three lists of 256 values g(z) = ln(radiance x seconds).
    #[arg(long, value_name = "solve|srgb|gamma2.2|FILE", default_value = "solve")]
    pub response: String,
    /// Weight of smoothness when solving, above 0.
    #[arg(long, value_name = "L", default_value_t = SolveOptions::default().lambda)]
    pub lambda: f64,
    /// Keep the darkest values as they are. (Where they are the same in exposures far apart - film fog, stray light -
    /// they would be taken for light, and are set to black.)
    #[arg(long)]
    pub keep_black: bool,
    /// Take the pictures as they lie. (A tripod that was bumped, a hand that shook: by default pictures that moved are
    /// put back, by a shift and a turn in the picture's plane, and a warning says so.)
    #[arg(long)]
    pub no_align: bool,
    /// Merge what moved between the pictures (a person, a leaf) as it lies. By default the best exposed picture's own value is
    /// kept there, and a warning says so.
    #[arg(long)]
    pub keep_ghosts: bool,
    /// Write the response that was used as JSON, to be given to --response again.
    #[arg(long, value_name = "FILE")]
    pub save_response: Option<PathBuf>,
}

/// What the bar counts beside the pictures: black taken off, pictures laid over one another, the response.
const STEPS: u64 = 3;

/// Runs `halflight hdr`.
///
/// # Errors
/// A mistake in the arguments; a picture or response that cannot be read; a file that cannot be written.
pub fn run(arguments: HdrArguments, global: &GlobalOptions) -> Result<(), CliError> {
    let allowed = [OutputFormat::Exr, OutputFormat::Hdr, OutputFormat::Png];
    let format = arguments.out.as_deref().map(|out| OutputFormat::of(out, &allowed)).transpose()?;
    let (mut files, times_s) = pair_up(&arguments)?;
    let bar = Bar::of_count(Some(files.len() as u64 + STEPS), "steps");
    let mut loaded = Vec::with_capacity(files.len());
    for file in &files {
        loaded.push(pictures::load_rgb8(file)?);
        bar.add_one();
    }
    check_sizes(&files, &loaded)?;
    let mut bracket = LoadedBracket::new(loaded, &times_s);
    let sorted_out = bracket.sort_out(&mut files);
    // Fog at the dark end would be taken for light; where times are false, nothing can be said of it.
    let srgb = Response::srgb();
    let plain = check_exposures(&bracket.refs(), &bracket.exposures, &srgb, Tolerance::GUESSED_RESPONSE);
    let black = match plain.sound() && !arguments.keep_black {
        true => black_level(&bracket.refs(), &bracket.exposures),
        false => [0; 3],
    };
    if black != [0; 3] {
        bracket.pictures.iter_mut().for_each(|picture| *picture = clip_black(picture, black));
    }
    bar.add_one();
    // What false times would make of the pictures cannot be compared.
    let moved = if plain.sound() && !arguments.no_align {
        let first = choose_response(&arguments, &bracket)?;
        bracket.steady(&first.response)
    } else {
        Vec::new()
    };
    bar.add_one();
    let mut chosen = choose_response(&arguments, &bracket)?;
    chosen.warnings.splice(0..0, sorted_out);
    chosen.warnings.extend(moved);
    if plain.sound() && !arguments.keep_ghosts {
        chosen.warnings.extend(bracket.lay_ghosts(&chosen.response, &files));
    }
    bar.add_one();
    let check = check_exposures(&bracket.refs(), &bracket.exposures, &chosen.response, chosen.tolerance);
    let mut engine = global.open_engine()?;
    let merged = bracket.merge(&chosen.response, engine.as_mut())?;
    drop(bar);
    if let (Some(out), Some(format)) = (&arguments.out, format) {
        match format {
            OutputFormat::Exr => save_exr_f32(out, &merged.radiance),
            OutputFormat::Hdr => pictures::save_hdr(out, &merged.radiance),
            OutputFormat::Png => pictures::save_png(out, &display(&merged.radiance)),
        }?;
    }
    if let Some(file) = &arguments.save_response {
        write_file(file, crate::assets::response::to_json(&chosen.response))?;
    }
    let done = Merged { files, exposures: bracket.exposures, chosen, check, black, merged };
    report(&arguments, global, &done, &engine.description());
    Ok(())
}

/// Everything that was found.
struct Merged {
    files: Vec<PathBuf>,
    exposures: Vec<Exposure>,
    chosen: ChosenResponse,
    check: ExposureCheck,
    black: [u8; 3],
    merged: HdrImage,
}

/// Seconds from `0.025` or `1/40`.
pub fn exposure_time_s(text: &str) -> Option<f64> {
    let number = |part: &str| part.trim().parse::<f64>().ok();
    let time_s = match text.split_once('/') {
        Some((top, bottom)) => number(top)? / number(bottom)?,
        None => number(text)?,
    };
    (time_s.is_finite() && time_s > 0.0).then_some(time_s)
}

/// The pictures and their times.
fn pair_up(arguments: &HdrArguments) -> Result<(Vec<PathBuf>, Vec<f64>), CliError> {
    if let Some(list) = &arguments.times_file {
        return pair_by_list(list, &arguments.images);
    }
    // `--times 0.1 0.025 a.png b.png`: the first word that is no time begins the pictures.
    let is_times =
        |word: &&String| word.contains(',') || exposure_time_s(word).is_some() || word.parse::<f64>().is_ok();
    let words = arguments.times.iter().take_while(is_times).count();
    let mut times_s = Vec::new();
    for text in arguments.times[..words].iter().flat_map(|word| word.split(',')) {
        times_s.push(exposure_time_s(text).ok_or_else(|| {
            CliError(format!(
                "--times: {text:?} is no exposure time: must be seconds above 0 such as 0.025 or 1/40"
            ))
        })?);
    }
    let files: Vec<PathBuf> =
        arguments.times[words..].iter().map(PathBuf::from).chain(arguments.images.iter().cloned()).collect();
    if files.is_empty() {
        return Err(CliError(format!("no pictures: 1 to {MAX_PICTURES} are needed (IMG..)")));
    }
    if files.len() != times_s.len() {
        return Err(CliError(format!(
            "{} pictures but {} exposure times: --times must give one for each picture",
            files.len(),
            times_s.len()
        )));
    }
    limit_count(files, times_s)
}

fn limit_count(files: Vec<PathBuf>, times_s: Vec<f64>) -> Result<(Vec<PathBuf>, Vec<f64>), CliError> {
    if files.is_empty() || files.len() > MAX_PICTURES {
        return Err(CliError(format!("{} pictures: must be 1 to {MAX_PICTURES}", files.len())));
    }
    Ok((files, times_s))
}

/// Pictures named in a text file, with their times: all that exist beside it, or the given ones.
fn pair_by_list(list: &Path, images: &[PathBuf]) -> Result<(Vec<PathBuf>, Vec<f64>), CliError> {
    let text = std::fs::read_to_string(list).map_err(|e| CliError::on(list.display(), e))?;
    let mut named = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut words = line.split_whitespace();
        let (Some(name), Some(time_s)) = (words.next(), words.next().and_then(exposure_time_s)) else {
            return Err(CliError(format!(
                "{} line {}: {line:?}: must be a file name and an exposure time in seconds",
                list.display(),
                index + 1
            )));
        };
        named.push((name.to_owned(), time_s));
    }
    let folder = list.parent().unwrap_or(Path::new(""));
    let pairs: Vec<(PathBuf, f64)> = if images.is_empty() {
        named.iter().map(|(name, t)| (folder.join(name), *t)).filter(|(file, _)| file.is_file()).collect()
    } else {
        let time_of = |image: &PathBuf| {
            let wanted = image.file_name().and_then(|n| n.to_str());
            let found =
                named.iter().find(|(name, _)| Path::new(name).file_name().and_then(|n| n.to_str()) == wanted);
            let why = || CliError(format!("{}: names no time for {}", list.display(), image.display()));
            found.map(|(_, t)| (image.clone(), *t)).ok_or_else(why)
        };
        images.iter().map(time_of).collect::<Result<_, _>>()?
    };
    if pairs.is_empty() {
        return Err(CliError(format!(
            "{}: none of the {} pictures that it names exists beside it",
            list.display(),
            named.len()
        )));
    }
    let (files, times_s) = pairs.into_iter().unzip();
    limit_count(files, times_s)
}

fn check_sizes(files: &[PathBuf], loaded: &[Rgb8Image]) -> Result<(), CliError> {
    let size = |p: &Rgb8Image| (p.width(), p.height());
    let Some(first) = loaded.first() else { return Ok(()) };
    for (file, picture) in files.iter().zip(loaded) {
        if size(picture) != size(first) {
            return Err(CliError(format!(
                "{}: {} x {} pixels, but {} has {} x {}: all pictures must show one view in one size",
                file.display(),
                picture.width(),
                picture.height(),
                files[0].display(),
                first.width(),
                first.height()
            )));
        }
    }
    Ok(())
}

/// A response, where it comes from, and how far it is to be trusted.
struct ChosenResponse {
    response: Response,
    /// `solved`, `srgb`, `gamma2.2` or `file`.
    kind: &'static str,
    why: String,
    warnings: Vec<String>,
    tolerance: Tolerance,
}

fn choose_response(arguments: &HdrArguments, bracket: &LoadedBracket) -> Result<ChosenResponse, CliError> {
    let guess = |response, kind| ChosenResponse {
        response,
        kind,
        why: "as asked".into(),
        warnings: Vec::new(),
        tolerance: Tolerance::GUESSED_RESPONSE,
    };
    match arguments.response.as_str() {
        "srgb" => Ok(guess(Response::srgb(), "srgb")),
        "gamma2.2" => Ok(guess(gamma22()?, "gamma2.2")),
        "solve" => {
            if !(arguments.lambda.is_finite() && arguments.lambda > 0.0) {
                return Err(CliError(format!("--lambda = {}: must be above 0", arguments.lambda)));
            }
            let options = SolveOptions { lambda: arguments.lambda, ..SolveOptions::default() };
            let recovered = solve(&bracket.refs(), &bracket.exposures, &options);
            Ok(match recovered.origin {
                ResponseOrigin::Solved { residual_rms } => ChosenResponse {
                    response: recovered.response,
                    kind: "solved",
                    why: format!("solved from the pictures, rms {residual_rms:.3} in ln exposure"),
                    warnings: Vec::new(),
                    tolerance: Tolerance::KNOWN_RESPONSE,
                },
                ResponseOrigin::Fallback { why } => ChosenResponse {
                    response: recovered.response,
                    kind: "srgb",
                    why: format!("the pictures cannot tell: {why}"),
                    warnings: vec![format!("response not solved ({why}); sRGB stands in")],
                    tolerance: Tolerance::GUESSED_RESPONSE,
                },
            })
        }
        file => {
            let response = load_response(Path::new(file))?;
            let why = format!("from {file}");
            let tolerance = Tolerance::KNOWN_RESPONSE;
            Ok(ChosenResponse { response, kind: "file", why, warnings: Vec::new(), tolerance })
        }
    }
}

/// g(z) = 2.2 ln(z / 255), 0 taken as 0.5.
fn gamma22() -> Result<Response, CliError> {
    let g = std::array::from_fn(|z| (2.2 * ((z as f64).max(0.5) / 255.0).ln()) as f32);
    Response::new([g; 3]).ok_or_else(|| CliError::on("--response gamma2.2", "not a sound response"))
}

fn load_response(file: &Path) -> Result<Response, CliError> {
    if !file.is_file() {
        return Err(CliError(format!(
            "--response = {}: must be solve, srgb, gamma2.2 or a JSON file",
            file.display()
        )));
    }
    Ok(crate::assets::response::load(file)?)
}

/// 8 bits through sRGB, scaled so that nine tenths of the pixels lie below 0.8.
fn display(radiance: &RadianceImage) -> Rgb8Image {
    let mut luminance = luminances(radiance);
    luminance.sort_unstable_by(f32::total_cmp);
    let bright = luminance.get(luminance.len() * 9 / 10).copied().unwrap_or(0.0);
    let scale = if bright > 0.0 { 0.8 / bright } else { 1.0 };
    let srgb = Response::srgb();
    let value = |c: usize, e: f32| srgb.value_of(c, e * scale).round() as u8;
    let pixels = radiance.pixels().iter().map(|e| std::array::from_fn(|c| value(c, e[c]))).collect();
    Rgb8Image::from_pixels(radiance.width(), radiance.height(), pixels).unwrap_or_default()
}

fn luminances(radiance: &RadianceImage) -> Vec<f32> {
    radiance.pixels().iter().map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b).collect()
}

/// Darkest and brightest luminance, leaving out a thousandth at either end and bounded pixels where others exist.
fn luminance_range(merged: &HdrImage) -> (f32, f32) {
    let all = luminances(&merged.radiance);
    let known: Vec<f32> =
        all.iter().zip(merged.flags.pixels()).filter(|(_, flags)| **flags == 0).map(|(l, _)| *l).collect();
    let mut sorted = if known.is_empty() { all } else { known };
    sorted.sort_unstable_by(f32::total_cmp);
    let last = sorted.len().saturating_sub(1);
    let cut = sorted.len() / 1000;
    let at = |i: usize| sorted.get(i.min(last)).copied().unwrap_or(0.0);
    (at(cut), at(last - cut.min(last)))
}

const fn verdict_name(verdict: ExposureVerdict) -> &'static str {
    match verdict {
        ExposureVerdict::Consistent => "consistent",
        ExposureVerdict::Contradicted => "contradicted",
        ExposureVerdict::Unchecked => "unchecked",
    }
}

/// What a person must know before trusting the result.
fn warnings(done: &Merged) -> Vec<String> {
    let mut warnings = done.chosen.warnings.clone();
    for (file, report) in done.files.iter().zip(done.check.reports()) {
        if let (ExposureVerdict::Contradicted, Some(other)) = (report.verdict, report.against) {
            warnings.push(format!(
                "{}: stated {:.4} x the exposure of {}, but its pixels say {:.4} x: the time is false, or the camera did not apply it",
                file.display(),
                report.stated_ratio,
                done.files[other].display(),
                report.measured_ratio
            ));
        }
    }
    warnings
}

fn report(arguments: &HdrArguments, global: &GlobalOptions, done: &Merged, engine: &str) {
    let Merged { files, chosen, black, merged, .. } = done;
    let warnings = warnings(done);
    let count = |bit: u8| merged.flags.pixels().iter().filter(|flags| **flags & bit != 0).count();
    let (lower, upper) = (count(LOWER_BOUND), count(UPPER_BOUND));
    let (darkest, brightest) = luminance_range(merged);
    let stops = if darkest > 0.0 { f64::from(brightest / darkest).log2() } else { 0.0 };
    let digest = global.digest.then(|| {
        let mut digest = PixelDigest::default();
        digest.add_floats(merged.radiance.pixels());
        digest.hex()
    });
    if global.json {
        let report = serde_json::json!({
            "format": super::JSON_FORMAT, "out": arguments.out.as_deref().map(shown), "engine": engine,
            "width_px": merged.radiance.width(), "height_px": merged.radiance.height(),
            "pictures": pictures_json(done),
            "black_level_rgb": black, "response": { "kind": chosen.kind, "why": chosen.why },
            "dynamic_range_stops": stops, "luminance_low": darkest, "luminance_high": brightest,
            "lower_bound_px": lower, "upper_bound_px": upper,
            "warnings": warnings, "digest": digest,
        });
        println!("{report}");
        return;
    }
    for warning in &warnings {
        eprintln!("warning: {warning}");
    }
    println!("engine    {engine}");
    println!("response  {}: {}", chosen.kind, chosen.why);
    if *black != [0; 3] {
        println!("black     values up to {black:?} (r, g, b) do not change with exposure and count as black");
    }
    for ((file, exposure), report) in files.iter().zip(&done.exposures).zip(done.check.reports()) {
        print!("  {:<32} {:>11.6} s  {}", file.display(), exposure.time_s, verdict_name(report.verdict));
        match report.against {
            Some(other) => println!(
                " (to {}: stated {:.4}, measured {:.4})",
                files[other].file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
                report.stated_ratio,
                report.measured_ratio
            ),
            None => println!(" (shares too few well-exposed pixels)"),
        }
    }
    println!(
        "range     {stops:.1} stops: luminance {darkest:.4e} to {brightest:.4e}, a thousandth left out at either end"
    );
    println!("bounded   {lower} pixels only from below (saturated), {upper} only from above (black)");
    if let Some(out) = &arguments.out {
        println!("wrote     {}", out.display());
    }
    if let Some(digest) = digest {
        println!("digest    {digest}");
    }
}

fn pictures_json(done: &Merged) -> Vec<serde_json::Value> {
    let each = done.files.iter().zip(&done.exposures).zip(done.check.reports());
    each.map(|((file, exposure), report)| {
        serde_json::json!({
            "file": shown(file), "time_s": exposure.time_s, "verdict": verdict_name(report.verdict),
            "against": report.against.map(|other| shown(&done.files[other])),
            "stated_ratio": report.against.map(|_| report.stated_ratio),
            "measured_ratio": report.against.map(|_| report.measured_ratio),
        })
    })
    .collect()
}
