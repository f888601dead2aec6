//! `halflight figures`: how a picture comes about, from a recording.

use super::output::{camera_of, need_frame, shown};
use super::progress::{Bar, host};
use super::{CliError, GlobalOptions, run_folder};
use crate::assets::pictures;
use crate::lab::{figures::figures, still::moment::RecordedMoment};
use crate::model::path_text;
use std::ffi::OsString;
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
    recording: OsString,
    /// Scene file with the virtual objects. Each one gets sheets of its own (repeatable).
    #[arg(long, value_name = "FILE", required = true)]
    scene: Vec<PathBuf>,
    /// Folder for the sheets. It is made where it is missing.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The frame that is shown, counted from 0. By then the light must have settled.
    #[arg(long, value_name = "N", default_value_t = 11)]
    frame: u64,
}

/// Runs `halflight figures`.
///
/// # Errors
/// A mistake in the arguments; a recording or scene that cannot be drawn; a file that cannot be written.
pub fn run(arguments: FiguresArguments, global: &GlobalOptions) -> Result<(), CliError> {
    for scene in &arguments.scene {
        // A scene that is wrong is told before anything is drawn.
        crate::assets::scene::load(scene)?;
    }
    need_frame(&camera_of(&arguments.recording), arguments.frame)?;
    run_folder::check(&arguments.out, &["*_*.png"])?;
    let bar = Bar::of_count(Some(arguments.scene.len() as u64), "scenes");
    let mut engine = global.open_engine()?;
    let mut written = Vec::new();
    for scene in &arguments.scene {
        let stem = scene.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy().into_owned());
        let moment = moment_of(&arguments, scene, global)?;
        if written.is_empty() {
            run_folder::begin(&arguments.out, "figures", &["*_*.png"])?;
        }
        for (name, sheet) in figures(&moment.composition, engine.as_mut(), &host())? {
            let file = arguments.out.join(format!("{stem}_{name}.png"));
            pictures::save_png(&file, &sheet.picture())?;
            written.push(shown(&file));
        }
        bar.add_one();
    }
    drop(bar);
    if global.json {
        println!("{}", serde_json::json!({ "format": super::JSON_FORMAT, "written": written }));
    } else {
        for file in written {
            println!("wrote   {file}");
        }
    }
    Ok(())
}

/// The moment that the arguments name, with one of their scenes.
fn moment_of(
    arguments: &FiguresArguments,
    scene: &Path,
    global: &GlobalOptions,
) -> Result<RecordedMoment, CliError> {
    let mut settings = global.settings(None)?;
    settings.camera = camera_of(&arguments.recording);
    settings.scene_file = path_text::to_text(scene);
    let mut moment = RecordedMoment::of(&settings, arguments.frame, &host())?;
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
