//! `halflight spheres`: the spheres that stand for a model where it blocks soft light.

mod picture;

use super::{CliError, Common, common::PixelDigest};
use crate::assets::{error::AssetError, gltf, pictures, spheres};
use crate::daemon::cache_folder::cache_folder;
use crate::visibility::fit_spheres::{MAX_COUNT, MIN_COUNT};
use indicatif::{ProgressBar, ProgressStyle};
use std::{io::Write, path::PathBuf};

const AFTER_HELP: &str = "\
Fits spheres to the model at rest so that together they stand for its volume, and binds each to the node whose skin
weights are strongest around it. The result is kept in the user's cache folder ($XDG_CACHE_HOME/halflight or
~/.cache/halflight) under a hash of the geometry.

The JSON has figure, count, outside_share and uncovered_share (volume of the spheres outside the model, and of the model
outside the spheres, over the model's), mesh_volume, and spheres: node (index), node_name, centre_node and radius_node
(in that node's frame and unit), centre_rest and radius_rest (in the model's frame, z up, at rest).

Example: halflight spheres walker.glb --count 16 --out spheres.json --picture spheres.png";

/// Arguments of `halflight spheres`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER_HELP)]
pub struct Arguments {
    /// The model: .glb or .gltf.
    pub model: PathBuf,
    /// How many spheres, 4 to 64.
    #[arg(long, value_name = "N", default_value_t = gltf::DEFAULT_SPHERES)]
    pub count: usize,
    /// Write the spheres as JSON.
    #[arg(long, value_name = "FILE.json")]
    pub out: Option<PathBuf>,
    /// Write a picture of the model and its spheres, from the front and from its left, as PNG.
    #[arg(long, value_name = "FILE.png")]
    pub picture: Option<PathBuf>,
    /// Fit anew although the cache folder knows the result, and keep nothing.
    #[arg(long)]
    pub fresh: bool,
}

/// Runs `halflight spheres`.
pub fn run(arguments: Arguments, common: &Common) -> Result<(), CliError> {
    let fail = |error: &dyn std::fmt::Display| CliError(error.to_string());
    if !(MIN_COUNT..=MAX_COUNT).contains(&arguments.count) {
        let why = format!("must be within {MIN_COUNT}..={MAX_COUNT}, was {}", arguments.count);
        return Err(CliError::on("--count", why));
    }
    let loaded = gltf::load_figure(&arguments.model, 0, &|_| ()).map_err(|e| fail(&e))?;
    let (figure, objects) = (&loaded.figure, &loaded.objects);
    let bar = ProgressBar::new(100);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} % of the spheres, {eta} left") {
        bar.set_style(style);
    }
    let cache = if arguments.fresh { None } else { cache_folder() };
    let fit = spheres::fit(figure, objects, arguments.count, cache.as_deref(), &mut |share| {
        bar.set_position((share * 100.0) as u64);
    });
    bar.finish_and_clear();
    let fit = fit.ok_or_else(|| {
        let error =
            AssetError::new(&arguments.model, "triangles with an area").value(0).allowed("at least 1");
        CliError(error.to_string())
    })?;
    let bound = spheres::bound(&fit, figure, objects);
    let json = spheres::to_json(figure, &fit, &bound);
    let text = serde_json::to_string_pretty(&json).map_err(|e| fail(&e))?;
    if let Some(out) = &arguments.out {
        std::fs::write(out, &text).map_err(|e| CliError::on(out.display(), e))?;
    }
    let lines = if common.json {
        text
    } else {
        let nodes = &figure.skeleton.nodes;
        let mut lines = String::from("radius (rest)  node\n");
        for (fitted, bound) in fit.spheres.iter().zip(&bound) {
            let name = nodes.get(bound.node as usize).map_or("", |node| node.name.as_str());
            lines += &format!("{:13.4}  {} {name}\n", fitted.radius, bound.node);
        }
        let (outside, uncovered) = (100.0 * fit.outside_share, 100.0 * fit.uncovered_share);
        lines
            + &format!(
                "{} spheres: {outside:.1} % of the model's volume outside it, {uncovered:.1} % of it uncovered",
                fit.spheres.len()
            )
    };
    say(&lines)?;
    if arguments.picture.is_some() || common.digest {
        let drawn = picture::draw(&spheres::geometry(figure, objects), &fit.spheres);
        if let Some(file) = &arguments.picture {
            pictures::save_png(file, &drawn).map_err(|e| fail(&e))?;
        }
        if common.digest {
            let mut digest = PixelDigest::default();
            digest.add_bytes(drawn.pixels());
            // JSON on standard output stays alone there.
            let line = format!("digest {}", digest.hex());
            if common.json { eprintln!("{line}") } else { say(&line)? }
        }
    }
    Ok(())
}

/// Prints a text and a line end. A reader that has gone away (`| head`) is no error.
fn say(text: &str) -> Result<(), CliError> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(CliError::on("writing to standard output", error))
        }
        _ => Ok(()),
    }
}
