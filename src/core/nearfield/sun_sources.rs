//! The suns of a known room as the leaves of a source tree, so that they share a frame's n with its near light by one
//! expansion (Section 8 of [Gib03]). Shafts end at sources in the room, so what objects may hide of a sun is found here: the
//! receivers that it reaches are known once, and a frame only asks where boxes lie between.

use super::{
    field::NearField,
    marks::{Marks, SeenReceivers},
    shaft::Aabb,
    sun_shadows::SunShadows,
};
use crate::{
    math::color,
    model::room::RoomPatch,
    sources::{
        expand::{Chosen, Marked},
        tree::SourceTree,
    },
};
use glam::Vec3;

/// Cells a side that a receiver is looked at in.
const CELLS: usize = 8;
/// Places a side of an object's box at which a sun is looked for.
const PLACES: usize = 3;
/// A sun that was marked in the frame before is so until boxes larger by this share of their diagonal hide nothing of it.
const HELD: f32 = 0.05;

/// What of a receiver a sun reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LitReceiver {
    /// Index into [`NearField::receivers`].
    receiver: u32,
    /// Its leaf of the octree.
    leaf: u32,
    /// Around the cells that are reached.
    bounds: Aabb,
    /// Luminance of the irradiance times area, over all cells.
    power: f32,
}

/// A room's suns as a tree. As made by `default` there are none.
#[derive(Clone, Debug, Default)]
pub struct SunSources {
    tree: SourceTree,
    /// In the tree's order: unit vector towards each.
    towards: Vec<Vec3>,
    /// Receivers that each reaches.
    lit: Vec<Vec<LitReceiver>>,
}

impl SunSources {
    /// The suns' tree, by their directions and irradiance, and where the room itself lets each through.
    pub fn of(field: &NearField, suns: &SunShadows) -> Self {
        let lights = || (0..suns.len()).filter_map(|k| suns.get(k)).map(|(light, _)| light);
        let towards: Vec<Vec3> = lights().map(|light| Vec3::from(light.to_light_world)).collect();
        let strength: Vec<f32> = lights().map(|light| color::luminance(light.irradiance_rgb)).collect();
        let tree = SourceTree::build(&towards, &strength);
        let order = || tree.order().iter().map(|&k| k as usize);
        let lit = order().map(|k| {
            let leaves = (0..).zip(field.octree.nodes()).filter(|(_, node)| node.is_leaf());
            let items =
                leaves.flat_map(|(leaf, node)| field.octree.items(node).iter().map(move |&i| (leaf, i)));
            let found = items.filter_map(|(leaf, receiver)| {
                let patch = field.patches.patches.get(*field.receivers.get(receiver as usize)? as usize)?;
                let cosine = patch.normal_world.dot(towards[k]);
                if !(cosine > 0.0) {
                    return None;
                }
                let (bounds, share) =
                    reached(field, patch, |p| suns.arrives_before(k, p, patch.normal_world))?;
                let power = strength[k] * cosine * share * patch.area_m2;
                Some(LitReceiver { receiver, leaf, bounds, power })
            });
            found.collect()
        });
        let lit = lit.collect();
        let towards = order().map(|k| towards[k]).collect();
        Self { tree, towards, lit }
    }
}

/// The box around the cells of a patch that light reaches at their middles, and the share of all that does; `None`: nowhere.
fn reached(field: &NearField, patch: &RoomPatch, arrives: impl Fn(Vec3) -> f32) -> Option<(Aabb, f32)> {
    let ([a, b, c, d], count) = field.patches.outline_world(patch);
    let d = if count == 3 { c } else { d };
    let at = |i: f32, j: f32| {
        let (u, v) = (i / CELLS as f32, j / CELLS as f32);
        a.lerp(b, u).lerp(d.lerp(c, u), v)
    };
    let (mut bounds, mut sum) = (Aabb::EMPTY, 0.0);
    for cell in 0..CELLS * CELLS {
        let [i, j] = [cell % CELLS, cell / CELLS].map(|k| k as f32);
        let share = arrives(at(i + 0.5, j + 0.5));
        if share > 0.0 {
            let corners = [at(i, j), at(i + 1.0, j), at(i + 1.0, j + 1.0), at(i, j + 1.0)];
            bounds = bounds.join(&Aabb::around(corners));
            sum += share;
        }
    }
    (sum > 0.0).then(|| (bounds, sum / (CELLS * CELLS) as f32))
}

/// What objects may hide of the suns in a frame, and whose map each has; keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct SunMarks {
    /// In the tree's order: what each sends to the marked receivers, and whether it was marked in the frame before.
    light: Vec<f32>,
    held: Vec<bool>,
    objects: Vec<Aabb>,
    maps: Vec<Option<u32>>,
}

impl SunMarks {
    /// Finds the light of each sun in a frame: the luminance of the irradiance that the room itself lets through, in the mean
    /// over the receivers of the leaves in `marks`, by their area, as [`Representatives::choose`] has it of a near source.
    /// Receivers that only the sun's own rays pass the objects to are added to the sum.
    ///
    /// A sun of which no object's box can hide anything is not marked and has no light: there must be a receiver in the view
    /// that it reaches and a box on the way there. One that reaches a box that may be in the picture is marked for what
    /// objects hide of it from themselves and each other, with next to no light.
    ///
    /// [`Representatives::choose`]: super::representatives::Representatives::choose
    pub fn mark(
        &mut self,
        field: &NearField,
        suns: &SunShadows,
        marks: &Marks,
        objects: &[Aabb],
        view: Option<&SeenReceivers>,
    ) {
        let SunSources { tree, towards, lit } = suns.sources();
        let area_m2: f32 = marks.leaves().iter().map(|&leaf| field.sums().area_m2(leaf as usize)).sum();
        let scale = if area_m2 > 0.0 { 1.0 / area_m2 } else { 1.0 };
        self.held.resize(tree.leaves(), false);
        self.light.clear();
        for (leaf, held) in self.held.iter_mut().enumerate() {
            self.objects.clear();
            self.objects.extend(objects.iter().filter(|b| b.is_sound()).map(|b| {
                let grow = if *held { HELD * b.diagonal() } else { 0.0 };
                Aabb { low: b.low - grow, high: b.high + grow }
            }));
            let (mut power, mut hides) = (0.0, false);
            for of in &lit[leaf] {
                let is_marked = marks.leaves().binary_search(&of.leaf).is_ok();
                if is_marked && hides {
                    power += of.power;
                    continue;
                }
                let seen = view.is_none_or(|v| v.receivers.get(of.receiver as usize).is_some_and(|r| *r));
                let between = seen && self.objects.iter().any(|b| is_between(b, towards[leaf], &of.bounds));
                power += if is_marked || between { of.power } else { 0.0 };
                hides |= between;
            }
            let sun = tree.order()[leaf] as usize;
            let on_objects = || {
                let seen = |b: &&Aabb| view.is_none_or(|v| v.may_see(b));
                self.objects.iter().filter(seen).any(|b| reaches(suns, sun, b))
            };
            *held = hides || on_objects();
            // A marked source is never left out, however faint.
            let light = if hides { power * scale } else { 0.0 };
            self.light.push(if *held { light.max(f32::MIN_POSITIVE) } else { 0.0 });
        }
        self.maps.clear();
        self.maps.resize(suns.len(), None);
    }

    /// The suns' tree with this frame's light of each leaf, to be expanded together with the near light's; `None` without
    /// suns.
    pub fn marked<'a>(&'a self, suns: &'a SunShadows) -> Option<Marked<'a>> {
        let SunSources { tree, towards, .. } = suns.sources();
        (tree.leaves() > 0).then_some(Marked { tree, light: &self.light, towards, lasting: true })
    }

    /// Takes over which nodes of that tree were chosen.
    pub fn share(&mut self, suns: &SunShadows, chosen: &[Chosen]) {
        let tree = &suns.sources().tree;
        for chosen in chosen {
            let node = tree.nodes()[chosen.node as usize];
            for leaf in (node.begin as usize..node.end as usize).filter(|&leaf| self.light[leaf] > 0.0) {
                self.maps[tree.order()[leaf] as usize] = Some(tree.order()[chosen.centre as usize]);
            }
        }
    }

    /// For each sun of the room the sun whose map of the objects it is hidden by: its own, or that of the one that stands for
    /// several; `None`: objects hide nothing of it in this frame.
    pub fn maps(&self) -> &[Option<u32>] {
        &self.maps
    }

    /// What each sun sends to the marked receivers ([`SunMarks::mark`]), in the order of the suns' tree.
    pub fn light(&self) -> &[f32] {
        &self.light
    }
}

/// Whether rays from a receiver towards a sun can meet an object.
fn is_between(object: &Aabb, towards: Vec3, receiver: &Aabb) -> bool {
    // The receiver moved by t along the rays meets it where t times the direction lies within the box of their differences.
    let (mut first, mut last) = (0.0f32, f32::INFINITY);
    for axis in 0..3 {
        let [low, high] = [object.low[axis] - receiver.high[axis], object.high[axis] - receiver.low[axis]];
        let step = towards[axis];
        if step.abs() < 1e-12 {
            if low > 0.0 || high < 0.0 {
                return false;
            }
        } else {
            let [a, b] = [low / step, high / step];
            (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
        }
    }
    first <= last
}

/// Whether a sun reaches a box at any of some places in it.
fn reaches(suns: &SunShadows, sun: usize, object: &Aabb) -> bool {
    (0..PLACES.pow(3)).any(|i| {
        let share = |k: usize| (k % PLACES) as f32 / (PLACES - 1) as f32;
        let at = Vec3::new(share(i), share(i / PLACES), share(i / (PLACES * PLACES)));
        suns.arrives(sun, object.low + (object.high - object.low) * at, 1.0) > 0.0
    })
}

#[cfg(test)]
mod tests;
