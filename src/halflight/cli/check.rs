//! `halflight check`: is a settings file, a scene file or a room sound?

use super::output::shown;
use super::{CliError, GlobalOptions};
use crate::assets::scene::{self, LightSource, RoomLightSource, SceneFile};
use crate::config::{Settings, file, keys, manual, resolve};
use crate::lab::READERS;
use crate::model::path_text;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Check a settings file, a scene file, or a room. Prints all mistakes at once, each with its line and column.\n\n\
Of a scene file the tags, the ball and the camera (the rig) are looked at, the models that it names are \
read, and so are its room and the pictures of its light. A room is a glTF or a reference case.\n\n\
Examples:\n\
halflight check my.toml\n\
halflight check tests/scenes/still.toml\n\
halflight check tests/scenes/room.glb\n\
halflight check --manual";

/// Arguments of `halflight check`.
#[derive(clap::Args, Debug)]
pub struct CheckArguments {
    /// Settings file or scene file (TOML), or room (.glb, .gltf, or the folder of a reference case).
    #[arg(required_unless_present_any = ["manual", "scene_manual"])]
    file: Option<PathBuf>,
    /// What the file is [default: what its keys and its name say].
    #[arg(long = "as", value_enum, value_name = "KIND")]
    kind: Option<Kind>,
    /// Print every key of settings with unit, range, effect and default.
    #[arg(long)]
    manual: bool,
    /// The same of scene files (docs/scenes.md).
    #[arg(long)]
    scene_manual: bool,
}

/// What a file is.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Settings of the daemon.
    Settings,
    /// Things in a place, and a rig.
    Scene,
    /// The geometry of a real place.
    Room,
}

impl Kind {
    const fn name(self) -> &'static str {
        match self {
            Self::Settings => "settings",
            Self::Scene => "scene",
            Self::Room => "room",
        }
    }
}

/// What was found in a sound file.
struct FoundInFile {
    /// For people: `3 objects`.
    lines: Vec<String>,
    /// For machines.
    json: Value,
}

/// Runs `halflight check`.
///
/// # Errors
/// Every mistake of the file.
pub fn run(arguments: CheckArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if arguments.manual {
        print!("{}", manual::manual());
    }
    if arguments.scene_manual {
        print!("{}", scene::keys::manual());
    }
    let Some(path) = arguments.file else { return Ok(()) };
    let kind = match arguments.kind {
        Some(kind) => kind,
        None => kind_of(&path)?,
    };
    let found = match kind {
        Kind::Settings => settings(&path)?,
        Kind::Scene => scene_file(&path)?,
        Kind::Room => room(&path)?,
    };
    if global.json {
        let mut report = found.json;
        report["format"] = super::JSON_FORMAT.into();
        report["file"] = shown(&path).into();
        report["kind"] = kind.name().into();
        report["sound"] = true.into();
        println!("{report}");
    } else {
        println!("{}: sound, {}", path.display(), found.lines.join(", "));
    }
    Ok(())
}

/// By the file's name, and of TOML by its tables: those of both kinds hold keys of one.
fn kind_of(path: &Path) -> Result<Kind, CliError> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if path.is_dir() || ["glb", "gltf", "json"].contains(&ending.as_str()) {
        return Ok(Kind::Room);
    }
    let name = shown(path);
    let text = file::text(path).map_err(|text| CliError::in_file(&name, text))?;
    let Ok(typed) = text.parse::<toml::Table>() else {
        // Whoever reads it says what is wrong.
        return Ok(if text.contains("[[") { Kind::Scene } else { Kind::Settings });
    };
    let is_setting = |name: &str| keys::KEYS.iter().any(|key| key.name == name);
    let has = |section: &str| scene::keys::SECTIONS.iter().any(|(known, ..)| *known == section);
    let of_settings = typed.iter().any(|(section, value)| {
        let inner =
            value.as_table().is_some_and(|t| t.keys().any(|key| is_setting(&format!("{section}.{key}"))));
        inner || !has(section)
    });
    let of_scene =
        ["room", "ball", "tag", "surface", "object"].iter().any(|section| typed.contains_key(*section));
    let is_plain = typed.is_empty() || (of_settings && !of_scene);
    Ok(if is_plain { Kind::Settings } else { Kind::Scene })
}

fn settings(path: &Path) -> Result<FoundInFile, CliError> {
    let name = shown(path);
    let in_file = |text| CliError::in_file(&name, text);
    let read = file::read(path).map_err(in_file)?;
    let typed = read.keys.len();
    let settings = resolve(&name, &read, &Settings::default()).map_err(|e| in_file(e.to_string()))?;
    if settings.front != "bundled" {
        let front = crate::config::presets::front(&settings.front);
        front.map_err(|e| in_file(format!("{name}: quality.front = \"{}\": {e}", settings.front)))?;
    }
    Ok(FoundInFile {
        lines: vec![format!("{typed} of {} keys set", keys::KEYS.len())],
        json: json!({ "keys": typed }),
    })
}

fn scene_file(path: &Path) -> Result<FoundInFile, CliError> {
    let scene = scene::load(path)?;
    check_named(&scene)?;
    let counts = [
        ("objects", scene.scene.objects.len()),
        ("surfaces", scene.scene.surfaces.len()),
        ("tags", scene.tags.len()),
    ];
    let parts = [
        ("camera", scene.camera.is_some()),
        ("light", scene.light != LightSource::Unstated),
        ("ball", scene.ball.is_some()),
        ("room", scene.room.is_some()),
    ];
    let mut lines: Vec<String> = counts.iter().map(|(name, count)| format!("{count} {name}")).collect();
    lines.extend(parts.iter().filter(|(_, is)| *is).map(|(name, _)| format!("a {name}")));
    let mut json = json!({});
    for (name, count) in counts {
        json[name] = count.into();
    }
    for (name, is) in parts {
        json[name] = is.into();
    }
    Ok(FoundInFile { lines, json })
}

/// Files that a scene names and that are read only when it is drawn.
fn check_named(scene: &SceneFile) -> Result<(), CliError> {
    if let Some(source) = &scene.room {
        (READERS.room)(&source.file)?;
        if let RoomLightSource::Probe { file, .. } = &source.light {
            (READERS.radiance)(file)?;
        }
    }
    if let LightSource::File { file, .. } = &scene.light {
        (READERS.radiance)(file)?;
    }
    let of_light = match &scene.light {
        LightSource::Ball(pictures) => Some(pictures),
        _ => None,
    };
    let of_camera = scene.camera.as_ref().map(|camera| &camera.pictures);
    for pictures in of_camera.into_iter().chain(of_light) {
        for file in &pictures.files {
            crate::lab::open_exr::load_radiance(file)?;
        }
        if !["srgb", "solve"].contains(&pictures.response.as_str()) {
            crate::assets::response::load(&path_text::to_path(&pictures.response))?;
        }
    }
    Ok(())
}

fn room(path: &Path) -> Result<FoundInFile, CliError> {
    let loaded = (READERS.room)(path)?;
    for note in &loaded.notes {
        eprintln!("warning: {}: {note}", path.display());
    }
    let surfaces = loaded.room.surfaces.len();
    let faces: usize = loaded.room.surfaces.iter().map(|s| s.faces.len()).sum();
    Ok(FoundInFile {
        lines: vec![format!("{surfaces} surfaces of {faces} faces")],
        json: json!({ "surfaces": surfaces, "faces": faces, "notes": loaded.notes }),
    })
}
