//! `halflight figures`: how a picture comes about, from a recording.

use super::output::make_folder;
use super::progress::host;
use super::{CliError, GlobalOptions};
use crate::assets::pictures;
use crate::lab::{figures::figures, still::moment::Moment};
use std::path::{Path, PathBuf};

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Show how pictures come about. Each figure is a sheet of pictures with captions: the light in its halves, \
every part of a picture, materials, numbers of shadow maps, and the rungs of the ladder with their errors.\n\n\
Example: halflight figures tests/recordings/desk.mcap --scene tests/scenes/walker.toml --out out/figures";

/// Arguments of `halflight figures`.
#[derive(clap::Args, Debug)]
pub struct FiguresArguments {
    /// Recording (MCAP), or any device name such as synthetic:frames=30.
    #[arg(value_name = "REC")]
    recording: String,
    /// Scene file with the virtual objects. Each one gets sheets of its own (repeatable).
    #[arg(long, value_name = "FILE", required = true)]
    scene: Vec<PathBuf>,
    /// Folder for the sheets. It is made where it is missing.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The frame that is shown, counted from 1. By then the light must have settled.
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u64).range(1..))]
    frame: u64,
}

/// Runs `halflight figures`.
///
/// # Errors
/// A mistake in the arguments; a recording or scene that cannot be drawn; a file that cannot be written.
pub fn run(arguments: FiguresArguments, global: &GlobalOptions) -> Result<(), CliError> {
    make_folder(&arguments.out)?;
    let mut engine = global.open_engine()?;
    let mut written = Vec::new();
    for scene in &arguments.scene {
        let stem = scene.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy().into_owned());
        let moment = moment_of(&arguments, scene, global)?;
        for (name, sheet) in figures(&moment.composition, engine.as_mut(), &host())? {
            let file = arguments.out.join(format!("{stem}_{name}.png"));
            pictures::save_png(&file, &sheet.picture())?;
            if !global.json {
                println!("wrote   {}", file.display());
            }
            written.push(file);
        }
    }
    if global.json {
        println!("{}", serde_json::json!({ "written": written }));
    }
    Ok(())
}

/// The moment that the arguments name, with one of their scenes.
fn moment_of(arguments: &FiguresArguments, scene: &Path, global: &GlobalOptions) -> Result<Moment, CliError> {
    let mut settings = global.settings(None)?;
    let name = &arguments.recording;
    settings.camera = if name.contains(':') { name.clone() } else { format!("replay:{name}") };
    settings.scene_file = scene.display().to_string();
    let mut moment = Moment::of(&settings, arguments.frame, &host())?;
    // The scene as it begins, whatever frame has the settled light.
    moment.composition.time_s = 0.0;
    if moment.composition.room.is_some() {
        return Err(CliError::on(
            scene.display(),
            "[room]: must be left out here: the figures show the halves of far light",
        ));
    }
    Ok(moment)
}
