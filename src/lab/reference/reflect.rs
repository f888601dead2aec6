//! How a point reflects, and directions drawn in proportion to that.

use super::world::SurfaceMeeting;
use crate::math::{color::gray, sh::zonal::PhongNorm};
use crate::model::scene::Material;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, TAU};

/// A matt or glossy point seen along a ray.
#[derive(Clone, Copy, Debug)]
pub struct Reflects {
    albedo: Vec3,
    specular: Vec3,
    exponent: f32,
    /// Shading normal, and the mirrored ray.
    normal: Vec3,
    mirrored: Vec3,
    /// The geometric normal: nothing comes from below it.
    facing: Vec3,
    /// Share of directions that are drawn from the matt part.
    matt_share: f32,
}

/// How much a direction counts.
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    /// f+: the share of radiance that is sent on, foreshortening included.
    pub value: Vec3,
    /// Density with which `draw` gives the direction, per steradian.
    pub density: f32,
}

impl Reflects {
    /// Of a point met by a ray of unit direction `incoming`; `None` for a mirror, and for what reflects nothing.
    #[inline]
    pub fn new(meeting: &SurfaceMeeting, incoming: Vec3, norm: PhongNorm) -> Option<Self> {
        let (albedo, specular, exponent) = match meeting.material? {
            Material::Lambert { albedo_rgb } => (Vec3::from(albedo_rgb), Vec3::ZERO, 0.0),
            Material::Phong { albedo_rgb, specular_rgb, exponent } => {
                let scale = match norm {
                    PhongNorm::EnergySafe => 1.0,
                    PhongNorm::Paper => (exponent + 2.0) / (exponent + 1.0),
                };
                (Vec3::from(albedo_rgb), scale * Vec3::from(specular_rgb), exponent.max(0.0))
            }
            Material::Mirror { .. } => return None,
        };
        let (matt, glossy) = (gray(albedo.to_array()), gray(specular.to_array()));
        (matt + glossy > 0.0).then(|| Self {
            albedo,
            specular,
            exponent,
            normal: meeting.shading,
            mirrored: mirror(incoming, meeting.shading),
            facing: meeting.facing,
            matt_share: matt / (matt + glossy),
        })
    }

    /// Whether it has more than a matt part.
    pub fn is_glossy(&self) -> bool {
        self.matt_share < 1.0
    }

    /// f+ and density of a unit direction. Lambert: albedo / pi max(0, n.w); gloss:
    /// reflectance (s + 1) / (2 pi) max(0, r.w)^s. Nothing from below the surface.
    #[inline]
    pub fn look(&self, direction: Vec3) -> Lobe {
        let cosine = self.normal.dot(direction).max(0.0);
        let mut lobe =
            Lobe { value: self.albedo * (cosine * FRAC_1_PI), density: self.matt_share * cosine * FRAC_1_PI };
        if self.matt_share < 1.0 {
            let along = self.mirrored.dot(direction).min(1.0);
            if along > 0.0 {
                let power = (self.exponent + 1.0) / TAU * along.powf(self.exponent);
                // Like the product's: both lobes end at the shading normal's horizon.
                if cosine > 0.0 {
                    lobe.value += self.specular * power;
                }
                lobe.density += (1.0 - self.matt_share) * power;
            }
        }
        if self.facing.dot(direction) <= 0.0 {
            lobe.value = Vec3::ZERO;
        }
        lobe
    }

    /// A unit direction drawn by the lobes from two numbers in [0, 1).
    #[inline]
    pub fn draw(&self, numbers: [f32; 2]) -> Vec3 {
        let [u, v] = numbers;
        if u < self.matt_share {
            let height = (1.0 - v).sqrt();
            return around(self.normal, height, TAU * (u / self.matt_share).min(1.0));
        }
        let height = (1.0 - v).powf(1.0 / (self.exponent + 1.0));
        around(self.mirrored, height, TAU * ((u - self.matt_share) / (1.0 - self.matt_share)).min(1.0))
    }
}

/// The direction into which a mirror of a normal sends a ray.
#[inline]
pub fn mirror(incoming: Vec3, normal: Vec3) -> Vec3 {
    (incoming - 2.0 * incoming.dot(normal) * normal).normalize_or(normal)
}

/// The unit direction at a height above the plane of an axis, turned about it.
#[inline]
fn around(axis: Vec3, height: f32, turn: f32) -> Vec3 {
    let (u, v) = axis.any_orthonormal_pair();
    let (sine, cosine) = turn.sin_cos();
    let radius = (1.0 - height * height).max(0.0).sqrt();
    u * (radius * cosine) + v * (radius * sine) + axis * height
}
