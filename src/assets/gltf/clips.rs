//! Animations as clips.

use super::{accessor::floats, source::Source};
use crate::{
    error::AssetError,
    model::animation::{AnimationChannel, Clip, Interpolation, Moves},
    names::UniqueNames,
};
use glam::{Vec3, Vec4};
use gltf::{Document, animation::Property};
use std::collections::HashSet;

/// Reads all animations. Channels of morph weights, and of nodes that are not part of a tree, are left out; of two
/// channels for one property of a node the first counts. An animation of which nothing is left stays as an empty clip.
/// One without a name is called `animation N`, and a name that was had before gets a number.
///
/// # Errors
/// Times that do not rise strictly from 0 on or are not finite, another number of values than of times, values that
/// are not finite, a rotation that is zero.
pub fn load(source: &Source, document: &Document, index_of: &[Option<u32>]) -> Result<Vec<Clip>, AssetError> {
    let mut clips: Vec<Clip> = Vec::new();
    let mut names = UniqueNames::default();
    let mut morphs = false;
    for animation in document.animations() {
        let stated =
            animation.name().map_or_else(|| format!("animation {}", animation.index()), str::to_owned);
        let name = names.give(stated);
        let mut channels: Vec<AnimationChannel> = Vec::new();
        let mut moved = HashSet::new();
        for channel in animation.channels() {
            let moves = match channel.target().property() {
                Property::Translation => Moves::Translation,
                Property::Rotation => Moves::Rotation,
                Property::Scale => Moves::Scale,
                Property::MorphTargetWeights => {
                    morphs = true;
                    continue;
                }
            };
            let Some(node) = index_of.get(channel.target().node().index()).copied().flatten() else {
                continue;
            };
            if !moved.insert((node, moves as u8)) {
                continue;
            }
            let part = format!("animations[{}].channels[{}]", animation.index(), channel.index());
            channels.push(keys(source, &channel, node, moves).map_err(|e| e.inside(part))?);
        }
        let ends = |c: &AnimationChannel| Some((*c.times_s.first()?, *c.times_s.last()?));
        let range = channels.iter().filter_map(ends).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        let (start_s, end_s) = range.unwrap_or((0.0, 0.0));
        clips.push(Clip { name, start_s, duration_s: end_s - start_s, channels });
    }
    if morphs {
        tracing::warn!("{}: animated morph weights are not shown", source.file.display());
    }
    Ok(clips)
}

fn keys(
    source: &Source,
    channel: &gltf::animation::Channel,
    node: u32,
    moves: Moves,
) -> Result<AnimationChannel, AssetError> {
    let wrong = |what: &str, allowed: &str| AssetError::new(source.file, what).allowed(allowed);
    let sampler = channel.sampler();
    let (interpolation, rows_a_key) = match sampler.interpolation() {
        gltf::animation::Interpolation::Step => (Interpolation::Step, 1),
        gltf::animation::Interpolation::Linear => (Interpolation::Linear, 1),
        gltf::animation::Interpolation::CubicSpline => (Interpolation::CubicSpline, 3),
    };
    let times_s: Vec<f32> = floats::<1>(source, &sampler.input(), 0.0)?.into_iter().map(|[t]| t).collect();
    // Written so that a NaN fails.
    let rises = times_s.windows(2).all(|pair| pair[1] > pair[0]);
    let sound = rises && times_s.first().is_some_and(|&t| t >= 0.0) && times_s.iter().all(|t| t.is_finite());
    if !sound {
        return Err(wrong("times", "at least one, finite, from 0 on, each after the one before"));
    }
    let values: Vec<Vec4> = match moves {
        Moves::Rotation => floats::<4>(source, &sampler.output(), 0.0)?.into_iter().map(Vec4::from).collect(),
        Moves::Translation | Moves::Scale => floats::<3>(source, &sampler.output(), 0.0)?
            .into_iter()
            .map(|row| Vec3::from(row).extend(0.0))
            .collect(),
    };
    if values.len() != rows_a_key * times_s.len() {
        return Err(wrong("values", &format!("{} for {} times", rows_a_key * times_s.len(), times_s.len()))
            .value(values.len()));
    }
    if !values.iter().all(|v| v.is_finite()) {
        return Err(wrong("values", "finite"));
    }
    let middle = rows_a_key / 2;
    let mut own = values.iter().skip(middle).step_by(rows_a_key);
    if moves == Moves::Rotation && !own.all(|q| q.try_normalize().is_some()) {
        return Err(wrong("values", "rotations that are not zero"));
    }
    Ok(AnimationChannel { node, moves, interpolation, times_s, values })
}
