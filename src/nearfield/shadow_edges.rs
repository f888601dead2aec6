//! Makes receivers finer where the room's own shadows have their edges: light is interpolated between the corners of a
//! patch, and an edge between them would be smeared over all of it.

use super::transfer::Statics;
use glam::{DVec3, Vec3};

/// Lights that stand for all that shines while edges are looked for.
const LIGHTS: usize = 48;
/// A patch dimmer than this share of the mean is judged as if it were as bright: nobody sees edges in the dark.
const DARK: f64 = 0.02;

/// A place from which a share of all light comes.
struct Light {
    place: Vec3,
    normal: Vec3,
    power: f64,
}

/// Judges patches.
pub struct ShadowEdges {
    statics: Statics,
    lights: Vec<Light>,
    lift: f64,
    mean: f64,
}

/// What shines: middle, normal, and power (luminance of radiance times area).
pub type Shining = (DVec3, DVec3, f64);

impl ShadowEdges {
    /// Draws the lights evenly by power from `shining`, in its order. `lift` metres keep a surface from hiding the room
    /// from itself.
    pub fn new(statics: Statics, shining: &[Shining], lift: f64) -> Self {
        let total: f64 = shining.iter().map(|s| s.2).sum();
        let mut lights: Vec<Light> = Vec::new();
        let (mut sum, mut next) = (0.0, 0.5);
        for (centre, normal, power) in shining {
            sum += power * LIGHTS as f64 / total;
            let mut hits = 0.0;
            while next < sum && next < LIGHTS as f64 {
                hits += 1.0;
                next += 1.0;
            }
            if hits > 0.0 {
                let (place, normal) = (centre.as_vec3(), normal.as_vec3());
                lights.push(Light { place, normal, power: hits * total / LIGHTS as f64 });
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

    /// How wrong interpolation between the corners is in the middle, over the light there, times the area: light by
    /// light, so that opposite mistakes do not make up for each other.
    pub fn error(&self, corners: &[DVec3], centre: DVec3, normal: DVec3, area: f64) -> f64 {
        let count = self.lights.len();
        let (mut middle, mut mean, mut here) = (vec![0.0; count], vec![0.0; count], vec![0.0; count]);
        self.gather(centre, normal, &mut middle);
        for corner in corners {
            self.gather(corner.lerp(centre, 0.02), normal, &mut here);
            mean.iter_mut().zip(&here).for_each(|(m, h)| *m += h / corners.len() as f64);
        }
        let off: f64 = middle.iter().zip(&mean).map(|(a, b)| (a - b).abs()).sum();
        let light = 0.5 * (middle.iter().sum::<f64>() + mean.iter().sum::<f64>());
        area * off / (light + DARK * self.mean + f64::MIN_POSITIVE)
    }

    fn gather(&self, place: DVec3, normal: DVec3, out: &mut [f64]) {
        let at = (place + normal * self.lift).as_vec3();
        let facing = normal.as_vec3();
        for (slot, light) in out.iter_mut().zip(&self.lights) {
            let to = light.place - at;
            let (here, there) = (facing.dot(to), -light.normal.dot(to));
            let squared = f64::from(to.length_squared());
            *slot = if here > 0.0 && there > 0.0 && !self.statics.hides(at, light.place) {
                light.power * f64::from(here) * f64::from(there) / (squared * squared)
            } else {
                0.0
            };
        }
    }
}
