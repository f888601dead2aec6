//! `halflight spheres`: the spheres that stand for a model where it blocks soft light, and boxes for what is thin.

mod picture;

use super::output::{say, say_digest, write_file};
use super::progress::Bar;
use super::{CliError, GlobalOptions};
use crate::assets::{error::AssetError, gltf, pictures, spheres};
use crate::daemon::{cache_folder::cache_folder, host::Task};
use crate::lab::digest::PixelDigest;
use crate::visibility::fit_spheres::{MAX_COUNT, MIN_COUNT};
use std::path::PathBuf;

const AFTER_HELP: &str = "\
Fits spheres to the model at rest so that together they stand for its volume, and binds each to the node whose skin
weights are strongest around it. The result is kept in the user's cache folder ($XDG_CACHE_HOME/halflight or
~/.cache/halflight) under a hash of the geometry.

The JSON has figure, count, outside_share and uncovered_share (volume of the spheres outside the model, and of the model
outside the spheres, over the model's), mesh_volume, and spheres: node (index), node_name, centre_node and radius_node
(in that node's frame and unit), centre_rest and radius_rest (in the model's frame, z up, at rest). boxes are those for
thin parts of rigid pieces: node, node_name, centre_node, axes_node, half_node (half the extents). They stand for the spheres
in them; blocking_spheres says how many spheres are left, and uncovered_share_with_boxes what neither covers: so much of
the model throws no soft shadow.

Example: halflight spheres walker.glb --count 16 --out spheres.json --picture spheres.png";

/// Arguments of `halflight spheres`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER_HELP)]
pub struct SpheresArguments {
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
pub fn run(arguments: SpheresArguments, global: &GlobalOptions) -> Result<(), CliError> {
    if !(MIN_COUNT..=MAX_COUNT).contains(&arguments.count) {
        let why = format!("must be within {MIN_COUNT}..={MAX_COUNT}, was {}", arguments.count);
        return Err(CliError::on("--count", why));
    }
    let loaded = gltf::load_figure(&arguments.model, 0, &|_| ())?;
    let (figure, objects) = (&loaded.figure, &loaded.objects);
    let bar = Bar::of_share("the spheres");
    let cache = if arguments.fresh { None } else { cache_folder() };
    let fit = spheres::fit(figure, objects, arguments.count, cache.as_deref(), &mut |share| {
        bar.reach(share);
    });
    drop(bar);
    let fit = fit.ok_or_else(|| {
        AssetError::new(&arguments.model, "triangles with an area").value(0).allowed("at least 1")
    })?;
    let bound = spheres::bound(&fit, figure, objects);
    let blocking = spheres::Blocking::of(figure, objects, &bound, arguments.count);
    let mut json = spheres::to_json(figure, &fit, &bound);
    blocking.add_to_json(figure, &mut json);
    json["format"] = super::JSON_FORMAT.into();
    let text = serde_json::to_string_pretty(&json)?;
    if let Some(out) = &arguments.out {
        write_file(out, &text)?;
    }
    let lines = if global.json {
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
            + &blocking.said()
    };
    say(&lines)?;
    if arguments.picture.is_some() || global.digest {
        let drawn = picture::draw(&spheres::geometry(figure, objects), &fit.spheres);
        if let Some(file) = &arguments.picture {
            pictures::save_png(file, &drawn)?;
        }
        if global.digest {
            let mut digest = PixelDigest::default();
            digest.add_bytes(drawn.pixels());
            say_digest(&digest.hex(), global.json)?;
        }
    }
    Ok(())
}
