//! Makes receivers finer where the room's own shadows have their edges: light is interpolated between the corners of a
//! patch, and an edge between them would be smeared over all of it.

use super::transfer::Statics;
use glam::{DVec3, Vec3};

use std::f64::consts::PI;

/// Lights that stand for all that shines while edges are looked for.
const LIGHTS: usize = 48;
/// A patch dimmer than this share of the mean is judged as if it were as bright: nobody sees edges in the dark.
const DARK: f64 = 0.02;

/// A place from which a share of all light comes.
struct Light {
    place: Vec3,
    normal: Vec3,
    power: f64,
    /// Of what it stands for, over pi, square metres: a disc of it is never brighter than this makes it, however near.
    spread_m2: f64,
}

/// Tells how far interpolation over a patch is off where shadows end.
pub struct ShadowEdges {
    statics: Statics,
    lights: Vec<Light>,
    lift: f64,
    mean: f64,
}

/// What shines: middle, normal, power (luminance of radiance times area), and that luminance.
pub type Shining = (DVec3, DVec3, f64, f64);

impl ShadowEdges {
    /// Draws the lights evenly by power from `shining`, in its order. `lift` metres keep a surface from hiding the room
    /// from itself.
    pub fn new(statics: Statics, shining: &[Shining], lift: f64) -> Self {
        let total: f64 = shining.iter().map(|s| s.2).sum();
        let mut lights: Vec<Light> = Vec::new();
        let (mut sum, mut next) = (0.0, 0.5);
        for (centre, normal, power, luminance) in shining {
            sum += power * LIGHTS as f64 / total;
            let mut hits = 0.0;
            while next < sum && next < LIGHTS as f64 {
                hits += 1.0;
                next += 1.0;
            }
            if hits > 0.0 {
                let (place, normal) = (centre.as_vec3(), normal.as_vec3());
                let power = hits * total / LIGHTS as f64;
                lights.push(Light { place, normal, power, spread_m2: power / (luminance * PI) });
            }
        }
        Self { statics, lights, lift, mean: 0.0 }
    }

    /// Takes the mean light of these places as what is bright.
    pub fn set_mean(&mut self, places: &[(DVec3, DVec3)]) {
        let mut here = vec![0.0; self.lights.len()];
        let mut sum = 0.0;
        for (place, normal) in places {
            self.gather(*place, *normal, &mut here);
            sum += here.iter().sum::<f64>();
        }
        self.mean = sum / places.len().max(1) as f64;
    }

    /// How wrong interpolation between the corners is, in the mean over the middle and the places half way from it to each
    /// corner, times the area: light by light, so that opposite mistakes do not make up for each other. Over the root of the
    /// light there and of the mean light: the ratio form divides by the one, and what is seen of it is a share of the
    /// other.
    pub fn error(&self, corners: &[DVec3], centre: DVec3, normal: DVec3, area: f64) -> f64 {
        let (lights, count) = (self.lights.len(), corners.len());
        let mut at_corners = vec![0.0; lights * count];
        for (corner, row) in corners.iter().zip(at_corners.chunks_mut(lights.max(1))) {
            self.gather(corner.lerp(centre, 0.02), normal, row);
        }
        let mut here = vec![0.0; lights];
        let (mut off, mut light) = (0.0, 0.0);
        for place in 0..=count {
            let mut weights = [0.0; 4];
            weights[..count].fill(1.0 / count as f64);
            if place < count {
                half_way(&mut weights[..count], place);
            }
            let point = corners.iter().zip(weights).fold(DVec3::ZERO, |sum, (c, w)| sum + *c * w);
            self.gather(point, normal, &mut here);
            for (l, here) in here.iter().enumerate() {
                let between: f64 = (0..count).map(|k| weights[k] * at_corners[k * lights + l]).sum();
                off += (here - between).abs();
                light += 0.5 * (here + between);
            }
        }
        let places = (count + 1) as f64;
        let light = light / places + DARK * self.mean;
        area * off / (places * (light * self.mean).sqrt() + f64::MIN_POSITIVE)
    }

    fn gather(&self, place: DVec3, normal: DVec3, out: &mut [f64]) {
        let at = (place + normal * self.lift).as_vec3();
        let facing = normal.as_vec3();
        for (slot, light) in out.iter_mut().zip(&self.lights) {
            let to = light.place - at;
            let (here, there) = (facing.dot(to), -light.normal.dot(to));
            let squared = f64::from(to.length_squared());
            *slot = if here > 0.0 && there > 0.0 && !self.statics.hides(at, light.place) {
                light.power * f64::from(here) * f64::from(there) / (squared * (squared + light.spread_m2))
            } else {
                0.0
            };
        }
    }
}

/// Weights of a patch's corners half way from its middle to one of them: between four, each way a quarter of a side from it.
fn half_way(weights: &mut [f64], corner: usize) {
    let count = weights.len();
    for (k, weight) in weights.iter_mut().enumerate() {
        *weight = match ((k + count - corner) % count, count) {
            (0, 4) => 0.5625,
            (2, 4) => 0.0625,
            (_, 4) => 0.1875,
            (0, _) => 2.0 / 3.0,
            _ => 1.0 / 6.0,
        };
    }
}
