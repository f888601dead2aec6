//! The picture of the environment for mirrors and for gloss that SH of the light's order is too smooth for: weighted
//! directions to a map, and the map under Phong lobes (section 5 of the project's formulas).

use crate::math::{octahedral, sphere};
use crate::model::{
    environment::{EnvironmentPicture, MOST_GLOSSY_LEVELS, OctahedralMap},
    light::{EnvironmentMap, MapLayout, RadianceSamples},
};
use glam::{DMat3, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Fewest and most texels a side of a map made of samples.
const SIDES: (usize, usize) = (32, 256);
/// Texels a side of what a prefiltered level is summed from come in blocks of so many.
const BLOCK: usize = 8;
/// A lobe ends where it has fallen to this.
const LOBE_END: f32 = 1e-4;

/// What is wanted of an environment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WantedEnvironment {
    /// The picture itself.
    pub picture: bool,
    /// The levels for gloss.
    pub glossy: bool,
}

impl WantedEnvironment {
    /// What a scene needs with light of an SH order: the picture for mirrors, the levels for sharp gloss.
    pub fn by(scene: &crate::model::scene::Scene, order: usize) -> Self {
        use crate::model::scene::Material;
        let mut wanted = Self::default();
        for object in &scene.objects {
            match object.material {
                Material::Mirror { .. } => wanted.picture = true,
                Material::Phong { exponent, specular_rgb, .. } if specular_rgb != [0.0; 3] => {
                    wanted.glossy |= crate::math::sh::zonal::phong_saturates(order, exponent);
                }
                Material::Phong { .. } | Material::Lambert { .. } => {}
            }
        }
        wanted.picture |= wanted.glossy;
        wanted
    }
}

/// A number that no picture had before.
fn next_revision() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    LAST.fetch_add(1, Ordering::Relaxed) + 1
}

/// Makes the pictures, and keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Prefilter {
    splatted: Vec<[f32; 4]>,
    coarser: Vec<Vec<[f32; 4]>>,
    filled: Vec<(usize, [f32; 4])>,
    left: OctahedralMap,
    smaller: OctahedralMap,
    rays: Vec<[f32; 4]>,
}

impl Prefilter {
    /// The map of weighted directions (world frame), with weight `alpha` against what `picture` held before; texels that
    /// no sample fell on get what lies around them. The map's size follows the number of samples. Samples that are not
    /// finite count as not seen. The prefiltered levels stay as they were, unless the map's size changes.
    pub fn see(&mut self, samples: &RadianceSamples, alpha: f32, picture: &mut EnvironmentPicture) {
        let side = self.splat(samples);
        let is_new = picture.all.side() != side;
        let begins = is_new || alpha.is_nan() || alpha >= 1.0;
        picture.all.reshape(side);
        for (texel, new) in picture.all.texels_mut().iter_mut().zip(&self.splatted) {
            for c in 0..3 {
                texel[c] = if begins { new[c] } else { texel[c] + alpha * (new[c] - texel[c]) };
            }
        }
        if is_new {
            picture.glossy.clear();
        }
        picture.revision = next_revision();
    }

    /// Mean radiance of the samples that fall on each texel; returns the texels a side.
    fn splat(&mut self, samples: &RadianceSamples) -> usize {
        let count = samples.directions.len().min(samples.radiance.len());
        let side = ((0.75 * count as f32).sqrt() as usize).clamp(SIDES.0, SIDES.1) / 16 * 16;
        self.splatted.clear();
        self.splatted.resize(side * side, [0.0; 4]);
        for (d, r) in samples.directions.iter().zip(&samples.radiance) {
            let direction = Vec3::new(d[0], d[1], d[2]);
            let sound = direction.is_finite() && d[3] > 0.0 && r.iter().take(3).all(|c| c.is_finite());
            if !sound {
                continue;
            }
            let at = (octahedral::place(direction) + Vec2::ONE) * (0.5 * side as f32);
            let (x, y) = ((at.x as usize).min(side - 1), (at.y as usize).min(side - 1));
            let texel = &mut self.splatted[y * side + x];
            for c in 0..3 {
                texel[c] += r[c].max(0.0) * d[3];
            }
            texel[3] += d[3];
        }
        self.fill_holes(side);
        for texel in &mut self.splatted {
            let weight = texel[3];
            texel.iter_mut().for_each(|c| *c = if weight > 0.0 { *c / weight } else { 0.0 });
        }
        side
    }

    /// The map of an environment picture, `side` texels a side: bilinear at four points of each texel.
    pub fn look_at_map(
        &mut self,
        map: &EnvironmentMap,
        world_from_map: DMat3,
        side: usize,
        picture: &mut EnvironmentPicture,
    ) {
        let map_from_world = world_from_map.transpose();
        picture.all.reshape(side);
        let side = picture.all.side();
        picture.all.texels_mut().par_chunks_mut(side).enumerate().for_each(|(row, texels)| {
            for (column, texel) in texels.iter_mut().enumerate() {
                let mut sum = [0.0f32; 3];
                for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                    let at = octahedral::centre(column, row, side) + Vec2::new(dx, dy) * (2.0 / side as f32);
                    let direction = map_from_world * octahedral::direction(at).as_dvec3();
                    let seen = look_up(map, direction);
                    sum.iter_mut().zip(seen).for_each(|(s, c)| *s += 0.25 * c);
                }
                *texel = sum.map(|c| if c.is_finite() { c.max(0.0) } else { 0.0 });
            }
        });
        picture.glossy.clear();
        picture.revision = next_revision();
    }

    /// The prefiltered levels of a picture, up to the sharpest that its size can show. `left`: the same light without the
    /// hard lights, as weighted directions; `None`: the levels hold all light, the hard lights too.
    pub fn levels(&mut self, left: Option<&RadianceSamples>, picture: &mut EnvironmentPicture) {
        picture.holds_hard_lights = left.is_none();
        if let Some(left) = left {
            let side = self.splat(left);
            self.left.reshape(side);
            for (texel, new) in self.left.texels_mut().iter_mut().zip(&self.splatted) {
                *texel = [new[0], new[1], new[2]];
            }
        } else {
            self.left.clone_from(&picture.all);
        }
        let mut count = 0;
        while count < MOST_GLOSSY_LEVELS && side_of(count) <= self.left.side() {
            count += 1;
        }
        picture.glossy.truncate(count);
        picture.glossy.resize_with(count, OctahedralMap::default);
        for (level, out) in picture.glossy.iter_mut().enumerate() {
            // One and a half texels of the source or more for one of the level.
            shrink(&self.left, side_of(level) * 3 / 2, &mut self.smaller);
            out.reshape(side_of(level));
            lobe_means(&self.smaller, 3 + level as u32, &mut self.rays, out);
        }
        picture.revision = next_revision();
    }

    /// Gives texels without a sample the mean of what lies around them, from coarser and coarser maps.
    fn fill_holes(&mut self, side: usize) {
        if self.splatted.iter().all(|t| t[3] > 0.0) {
            return;
        }
        let mut sides = vec![side];
        while sides.last().is_some_and(|s| s % 2 == 0 && *s > 1) {
            sides.push(sides[sides.len() - 1] / 2);
        }
        self.coarser.resize_with(sides.len() - 1, Vec::new);
        for level in 1..sides.len() {
            let (wide, narrow) = (sides[level - 1], sides[level]);
            let mut sums = std::mem::take(&mut self.coarser[level - 1]);
            sums.clear();
            sums.resize(narrow * narrow, [0.0; 4]);
            let finer = if level == 1 { &self.splatted } else { &self.coarser[level - 2] };
            for (i, texel) in finer.iter().enumerate() {
                let sum = &mut sums[i / wide / 2 * narrow + i % wide / 2];
                sum.iter_mut().zip(texel).for_each(|(s, c)| *s += c);
            }
            self.coarser[level - 1] = sums;
        }
        let whole = self.coarser.last().or(Some(&self.splatted)).map_or([0.0; 4], |all| {
            all.iter().fold([0.0; 4], |sum, t| std::array::from_fn(|c| sum[c] + t[c]))
        });
        for i in 0..side * side {
            if self.splatted[i][3] > 0.0 {
                continue;
            }
            let (x, y) = (i % side, i / side);
            let found = self.coarser.iter().enumerate().find_map(|(k, all)| {
                let sum = all[(y >> (k + 1)) * sides[k + 1] + (x >> (k + 1))];
                (sum[3] > 0.0).then_some(sum)
            });
            let sum = found.unwrap_or(whole);
            self.filled.push((i, sum));
        }
        // Written only now: what is filled is not itself a source for others.
        for (i, sum) in self.filled.drain(..) {
            self.splatted[i] = sum;
        }
    }
}

/// Texels a side of a level: from one to the next 0.4 or 0.6 of the standard deviation of its lobe, 1 / sqrt(s).
fn side_of(level: usize) -> usize {
    24 << (level / 2)
}

/// Means of square groups of texels, 1 to 16 a side, a power of two that divides the map: as large as leaves `side` a side.
fn shrink(map: &OctahedralMap, side: usize, out: &mut OctahedralMap) {
    let fits = |group: usize| map.side().is_multiple_of(group) && map.side() / group >= side;
    let group = [16, 8, 4, 2].into_iter().find(|&group| fits(group)).unwrap_or(1);
    let (wide, narrow) = (map.side(), map.side() / group);
    out.reshape(narrow);
    let narrow = out.side();
    for (i, texel) in out.texels_mut().iter_mut().enumerate() {
        let (x, y) = (i % narrow * group, i / narrow * group);
        let (mut sum, mut weight) = ([0.0f32; 3], 0.0f32);
        for row in y..y + group {
            for column in x..x + group {
                let sr = octahedral::texel_sr(column, row, wide);
                sum.iter_mut().zip(map.texels()[row * wide + column]).for_each(|(s, c)| *s += sr * c);
                weight += sr;
            }
        }
        *texel = sum.map(|c| c / weight);
    }
}

/// The mean of a map under the lobe cos^(2^doublings) about each texel of `out`: sum of lobe * L / sum of lobe, so that
/// constant light stays what it is.
fn lobe_means(source: &OctahedralMap, doublings: u32, rays: &mut Vec<[f32; 4]>, out: &mut OctahedralMap) {
    let side = source.side();
    rays.clear();
    rays.extend((0..side * side).map(|i| {
        let at = octahedral::centre(i % side, i / side, side);
        octahedral::direction(at).extend(octahedral::texel_sr(i % side, i / side, side)).to_array()
    }));
    let exponent = f64::from(doublings).exp2();
    let end = f64::from(LOBE_END).powf(1.0 / exponent).acos();
    // Blocks of texels: axis, and the least cosine to it at which the lobe may still reach in.
    let blocks_a_side = side.div_ceil(BLOCK);
    let blocks: Vec<(Vec3, f32)> = (0..blocks_a_side * blocks_a_side)
        .map(|b| {
            let mut axis = Vec3::ZERO;
            let texels = texels_of(b, blocks_a_side, side);
            texels.clone().for_each(|i| axis += Vec3::from_slice(&rays[i]));
            let axis = axis.normalize_or(Vec3::Z);
            let radius = texels
                .map(|i| Vec3::from_slice(&rays[i]).dot(axis))
                .fold(1.0, f32::min)
                .clamp(-1.0, 1.0)
                .acos();
            (axis, (end + f64::from(radius)).min(std::f64::consts::PI).cos() as f32)
        })
        .collect();
    let least = end.cos() as f32;
    let (width, rays) = (out.side(), &*rays);
    out.texels_mut().par_chunks_mut(width).enumerate().for_each(|(row, texels)| {
        for (column, texel) in texels.iter_mut().enumerate() {
            let about = octahedral::direction(octahedral::centre(column, row, width));
            let mut sum = [0.0f32; 4];
            for (b, (axis, reach)) in blocks.iter().enumerate() {
                if axis.dot(about) < *reach {
                    continue;
                }
                for i in texels_of(b, blocks_a_side, side) {
                    let [x, y, z, sr] = rays[i];
                    let cosine = about.x * x + about.y * y + about.z * z;
                    if cosine < least {
                        continue;
                    }
                    let mut lobe = cosine.min(1.0);
                    for _ in 0..doublings {
                        lobe *= lobe;
                    }
                    let weight = lobe * sr;
                    let seen = source.texels()[i];
                    for c in 0..3 {
                        sum[c] += weight * seen[c];
                    }
                    sum[3] += weight;
                }
            }
            *texel = [sum[0] / sum[3], sum[1] / sum[3], sum[2] / sum[3]]
                .map(|c| if c.is_finite() { c } else { 0.0 });
        }
    });
}

/// Indices of the texels of a block.
fn texels_of(block: usize, blocks_a_side: usize, side: usize) -> impl Iterator<Item = usize> + Clone {
    let (left, top) = (block % blocks_a_side * BLOCK, block / blocks_a_side * BLOCK);
    let columns = left..(left + BLOCK).min(side);
    (top..(top + BLOCK).min(side)).flat_map(move |row| columns.clone().map(move |column| row * side + column))
}

/// Radiance of a map of any layout in a direction of its own frame, bilinear between texel centres.
fn look_up(map: &EnvironmentMap, direction: DVec3) -> [f32; 3] {
    let (width, height) = (map.radiance.width(), map.radiance.height());
    if width == 0 || height == 0 {
        return [0.0; 3];
    }
    // Continuous place, and the rows that neighbours may come from (one face of a cube).
    let (x, y, rows) = match map.layout {
        MapLayout::Equirect => {
            let (u, v) = sphere::equirect_uv(direction);
            (u * width as f64, v * height as f64, 0..height)
        }
        MapLayout::Angular => {
            // The middle is +x, the right -y, the top +z.
            let (u, v) = sphere::angular_uv(DVec3::new(-direction.y, direction.z, direction.x));
            (0.5 * (u + 1.0) * width as f64, 0.5 * (1.0 - v) * height as f64, 0..height)
        }
        MapLayout::Cube => {
            let (face, u, v) = sphere::cube_face_uv(direction);
            let first = (face * width).min(height - 1);
            let y = first as f64 + 0.5 * (v + 1.0) * width as f64;
            (0.5 * (u + 1.0) * width as f64, y, first..(first + width).min(height))
        }
    };
    let (x, y) = (x - 0.5, (y - 0.5).clamp(rows.start as f64, rows.end as f64 - 1.0));
    let (fx, fy) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
    let wraps = map.layout == MapLayout::Equirect;
    let column = |dx: i64| {
        let at = x.floor() as i64 + dx;
        (if wraps { at.rem_euclid(width as i64) } else { at.clamp(0, width as i64 - 1) }) as usize
    };
    let (left, right, top) = (column(0), column(1), y.floor() as usize);
    let bottom = (top + 1).min(rows.end - 1);
    std::array::from_fn(|c| {
        let at = |x: usize, y: usize| map.radiance.at(x, y)[c];
        (1.0 - fy) * ((1.0 - fx) * at(left, top) + fx * at(right, top))
            + fy * ((1.0 - fx) * at(left, bottom) + fx * at(right, bottom))
    })
}

#[cfg(test)]
mod tests;
