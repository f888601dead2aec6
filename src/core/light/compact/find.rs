//! Finds lights in the picture of the environment and keeps them apart over time.

use super::grid::{LightGrid, Texel};
use crate::math::color;
use crate::model::light::{CompactLight, MAX_LIGHTS};
use crate::sources::cut::Leaf;
use glam::Vec3;

/// Half angle of the cap that may hold a light, degrees: a window as seen from a table.
pub const CAP_DEG: f32 = 25.0;
/// Outer half angle of the ring around it that shows the background, degrees.
const RING_DEG: f32 = 35.0;
/// A light must add this share of the whole luminous flux; one that is there already may fall to half of it.
pub const LEAST_SHARE: f32 = 0.02;
/// Lights come and go within this time, seconds.
pub const FADE_S: f64 = 0.3;
/// A full set of lights gives one up for a brighter one at most once in this time, seconds.
pub const SWAP_S: f64 = 10.0;
/// And only where the new one has this many times its flux.
const SWAP_RATIO: f32 = 1.5;
/// Steps by which a cap moves to the centroid of its light.
const CENTRE_STEPS: usize = 4;

/// A light that is followed.
#[derive(Clone, Copy, Debug)]
struct Followed {
    light: CompactLight,
    /// Centre of its cap.
    centre: Vec3,
    /// On its way out.
    leaving: bool,
}

/// Finds and follows; keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Finder {
    texels: Vec<Texel>,
    /// Texels that may hold light (the rest only count for the whole flux).
    open: usize,
    ring: Vec<(f32, f32)>,
    leaves: Vec<Leaf>,
    followed: [Option<Followed>; MAX_LIGHTS],
    born: u32,
    since_swap_s: f64,
    begun: bool,
    /// Slots that are not to be used, at the end.
    unused: usize,
}

/// What a cap holds beyond its background.
struct BrightCap {
    centre: Vec3,
    background_rgb: [f32; 3],
    /// Luminous flux beyond the background.
    flux: f32,
}

impl Finder {
    /// What of each texel belongs to a light: root = the light's id.
    pub fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }

    /// The lights, each in its slot.
    pub fn lights(&self) -> [Option<CompactLight>; MAX_LIGHTS] {
        self.followed.map(|f| f.map(|f| f.light))
    }

    /// Finds no more than so many lights, 1 to 4; those beyond are on their way out.
    pub fn keep_at_most(&mut self, lights: usize) {
        self.unused = MAX_LIGHTS - lights.clamp(1, MAX_LIGHTS);
    }

    /// Looks at the picture, `dt_s` after the last time.
    pub fn update(&mut self, grid: &LightGrid, dt_s: f64, above_horizon: bool) {
        grid.texels(&mut self.texels);
        let texel_sr = grid.texel_sr();
        let whole: f32 = self.texels.iter().map(|t| luminance(t) * t.solid_angle_sr).sum();
        self.leaves.clear();
        self.since_swap_s += dt_s.max(0.0);
        let step = if self.begun { (dt_s.max(0.0) / FADE_S).min(1.0) as f32 } else { 1.0 };
        if !(whole > 0.0 && whole.is_finite()) {
            self.followed = [None; MAX_LIGHTS];
            return;
        }
        self.begun = true;
        if above_horizon {
            // Unstable sorts allocate nothing, and equal input still gives equal order.
            self.texels.sort_unstable_by_key(|t| t.direction.z <= 0.0);
            self.open = self.texels.partition_point(|t| t.direction.z > 0.0);
        } else {
            self.open = self.texels.len();
        }
        let least = LEAST_SHARE * whole;
        for slot in 0..MAX_LIGHTS {
            let Some(mut followed) = self.followed[slot] else { continue };
            let cap = self.cap_around(followed.centre);
            if cap.flux < 0.5 * least || slot >= MAX_LIGHTS - self.unused {
                followed.leaving = true;
            } else if cap.flux >= least {
                followed.leaving = false;
            }
            followed.centre = cap.centre;
            let fade = followed.light.fade + if followed.leaving { -step } else { step };
            followed.light.fade = fade.clamp(0.0, 1.0);
            self.followed[slot] = (followed.light.fade > 0.0).then_some(followed);
            if followed.light.fade > 0.0 {
                self.take(slot, &cap, whole);
            }
        }
        self.find_new(least, step, texel_sr, whole);
    }

    /// Fills free slots with the brightest of what is left; with none free, the faintest light may have to go.
    fn find_new(&mut self, least: f32, step: f32, texel_sr: f32, whole: f32) {
        while let Some(seed) = self.brightest(texel_sr) {
            let cap = self.cap_around(seed);
            if cap.flux < least {
                return;
            }
            let Some(slot) = self.followed[..MAX_LIGHTS - self.unused].iter().position(Option::is_none)
            else {
                self.consider_swap(&cap);
                return;
            };
            let light = CompactLight {
                id: self.born,
                to_light_world: cap.centre.to_array(),
                flux_rgb: [0.0; 3],
                extent_rad: 0.0,
                fade: step,
            };
            self.born = self.born.wrapping_add(1);
            self.followed[slot] = Some(Followed { light, centre: cap.centre, leaving: false });
            if step <= 0.0 {
                return;
            }
            self.take(slot, &cap, whole);
        }
    }

    fn consider_swap(&mut self, cap: &BrightCap) {
        let flux = |f: &Option<Followed>| f.map_or(0.0, |f| color::luminance(f.light.flux_rgb));
        let faintest = (0..MAX_LIGHTS - self.unused)
            .min_by(|&a, &b| flux(&self.followed[a]).total_cmp(&flux(&self.followed[b])));
        let all_stay = self.followed.iter().flatten().all(|f| !f.leaving && f.light.fade >= 1.0);
        if let Some(slot) = faintest
            && all_stay
            && self.since_swap_s >= SWAP_S
            && cap.flux > SWAP_RATIO * flux(&self.followed[slot])
            && let Some(followed) = &mut self.followed[slot]
        {
            followed.leaving = true;
            self.since_swap_s = 0.0;
        }
    }

    /// Direction of the brightest texel that is left. Slivers of texels, whose radiance is noise, count less.
    fn brightest(&self, texel_sr: f32) -> Option<Vec3> {
        let score = |t: &Texel| luminance(t) * t.solid_angle_sr / (t.solid_angle_sr + 0.1 * texel_sr);
        self.texels[..self.open]
            .iter()
            .max_by(|a, b| score(a).total_cmp(&score(b)))
            .filter(|t| score(t) > 0.0)
            .map(|t| t.direction)
    }

    /// The cap whose centre is the centroid of the light in it, beginning from `seed`.
    fn cap_around(&mut self, seed: Vec3) -> BrightCap {
        let (cos_cap, cos_ring) = (CAP_DEG.to_radians().cos(), RING_DEG.to_radians().cos());
        let mut cap = BrightCap { centre: seed, background_rgb: [0.0; 3], flux: 0.0 };
        for step in 0..CENTRE_STEPS {
            cap.background_rgb = self.background(cap.centre, cos_cap, cos_ring);
            let (mut moment, mut flux) = (Vec3::ZERO, 0.0);
            for texel in &self.texels[..self.open] {
                if texel.direction.dot(cap.centre) >= cos_cap {
                    let beyond = color::luminance(beyond(texel, &cap.background_rgb)) * texel.solid_angle_sr;
                    moment += beyond * texel.direction;
                    flux += beyond;
                }
            }
            cap.flux = flux;
            let centre = moment.normalize_or(cap.centre);
            // The seed stays inside by a margin; the last background belongs to the last centre.
            if step + 1 == CENTRE_STEPS || centre.dot(seed) < (0.8 * CAP_DEG.to_radians()).cos() {
                break;
            }
            cap.centre = centre;
        }
        cap
    }

    /// Median radiance of the ring around a cap, weighted by solid angle; each channel for itself. Nothing where no ring was
    /// seen.
    fn background(&mut self, centre: Vec3, cos_cap: f32, cos_ring: f32) -> [f32; 3] {
        let (texels, ring) = (&self.texels[..self.open], &mut self.ring);
        std::array::from_fn(|channel| {
            ring.clear();
            for texel in texels {
                let cosine = texel.direction.dot(centre);
                if cosine < cos_cap && cosine >= cos_ring {
                    ring.push((texel.radiance_rgb[channel], texel.solid_angle_sr));
                }
            }
            ring.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let half = 0.5 * ring.iter().map(|r| r.1).sum::<f32>();
            let mut sum = 0.0;
            for &(radiance, solid_angle_sr) in ring.iter() {
                sum += solid_angle_sr;
                if sum >= half {
                    return radiance;
                }
            }
            0.0
        })
    }

    /// Takes a light's share out of the texels of its cap, and puts the background in its place.
    fn take(&mut self, slot: usize, cap: &BrightCap, whole: f32) {
        let Some(followed) = &mut self.followed[slot] else { return };
        let light = &mut followed.light;
        let cos_cap = CAP_DEG.to_radians().cos();
        let first = self.leaves.len();
        // Texels that hold next to nothing of it stay soft: they cost time and change nothing.
        let negligible = 1e-7 * whole;
        let (mut flux, mut moment) = ([0.0f64; 3], Vec3::ZERO);
        for texel in &mut self.texels[..self.open] {
            if texel.direction.dot(cap.centre) < cos_cap {
                continue;
            }
            let beyond = beyond(texel, &cap.background_rgb).map(|c| light.fade * c);
            let flux_rgb = beyond.map(|c| c * texel.solid_angle_sr);
            let luminous = color::luminance(flux_rgb);
            if luminous <= negligible {
                continue;
            }
            for (c, taken) in texel.radiance_rgb.iter_mut().zip(beyond) {
                *c -= taken;
            }
            for (sum, c) in flux.iter_mut().zip(flux_rgb) {
                *sum += f64::from(c);
            }
            moment += luminous * texel.direction;
            self.leaves.push(Leaf { at: texel.direction, flux_rgb, root: light.id });
        }
        let to_light = moment.normalize_or(cap.centre);
        let (mut squares, mut all) = (0.0, 0.0);
        for leaf in &self.leaves[first..] {
            let luminous = color::luminance(leaf.flux_rgb);
            squares += luminous * leaf.at.angle_between(to_light).powi(2);
            all += luminous;
        }
        light.to_light_world = to_light.to_array();
        light.flux_rgb = flux.map(|c| c as f32);
        light.extent_rad = if all > 0.0 { (squares / all).sqrt() } else { 0.0 };
    }
}

fn luminance(texel: &Texel) -> f32 {
    color::luminance(texel.radiance_rgb)
}

fn beyond(texel: &Texel, background_rgb: &[f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| (texel.radiance_rgb[c] - background_rgb[c]).max(0.0))
}
