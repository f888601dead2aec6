//! Light, as measured and as split.

use super::image::RadianceImage;
use crate::math::sh::MAX_COEFFICIENTS;

/// SH coefficients of *radiance* (never of irradiance), RGB, order 1 to 6. Unused rows are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadianceSh {
    /// Order n: bands 0..n-1.
    pub order: usize,
    /// Row l(l+1)+m: r, g, b.
    pub rgb: [[f32; 3]; MAX_COEFFICIENTS],
}

impl RadianceSh {
    /// No light.
    pub const fn zero(order: usize) -> Self {
        Self { order, rgb: [[0.0; 3]; MAX_COEFFICIENTS] }
    }

    /// The rows in use: order squared of them.
    pub fn rows(&self) -> &[[f32; 3]] {
        &self.rgb[..self.order * self.order]
    }
}

/// A light at infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalLight {
    /// Unit vector towards the light, world frame.
    pub to_light_world: [f32; 3],
    /// E_d: irradiance on a plane that faces the light.
    pub irradiance_rgb: [f32; 3],
    /// How much of E_d's fade-in has been applied, 0 to 1 (anisotropy between tau and 4 tau).
    pub fade: f32,
}

/// The light split into its two halves (Section 5 of [Now11] as corrected): L = E_d y(w_d) + L_g.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitLight {
    /// The hard half; `None` where no direction dominates.
    pub direct: Option<DirectionalLight>,
    /// The soft half. Coefficients may stand for a function that is negative in places; clamp the final shade.
    pub global: RadianceSh,
}

/// Compact lights at most.
pub const MAX_LIGHTS: usize = 4;
/// Hard lights, each with a shadow map of its own, at most.
pub const MAX_HARD_LIGHTS: usize = 64;

/// One hard light of the direct term: a representative of a compact light, or a whole directional light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HardLight {
    /// Unit vector towards the light, world frame.
    pub to_light_world: [f32; 3],
    /// Irradiance on a plane that faces it; not negative.
    pub irradiance_rgb: [f32; 3],
    /// Root mean square angle of what it stands for to its own direction, radians; 0: a point.
    pub extent_rad: f32,
}

/// At most [`MAX_HARD_LIGHTS`] of them, brightest compact light first.
#[derive(Clone, Copy, PartialEq)]
pub struct HardLights {
    count: usize,
    lights: [HardLight; MAX_HARD_LIGHTS],
}

impl HardLights {
    /// No hard light at all.
    pub const fn none() -> Self {
        let dark = HardLight { to_light_world: [0.0; 3], irradiance_rgb: [0.0; 3], extent_rad: 0.0 };
        Self { count: 0, lights: [dark; MAX_HARD_LIGHTS] }
    }

    /// Appends one; beyond the capacity it is refused: `false`.
    pub fn push(&mut self, light: HardLight) -> bool {
        let Some(slot) = self.lights.get_mut(self.count) else { return false };
        *slot = light;
        self.count += 1;
        true
    }

    /// Those in use.
    pub fn as_slice(&self) -> &[HardLight] {
        &self.lights[..self.count]
    }
}

impl std::fmt::Debug for HardLights {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.as_slice().fmt(f)
    }
}

/// A light with an extent, found in the picture of the environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompactLight {
    /// Stays with the light from frame to frame.
    pub id: u32,
    /// Unit vector to its centroid by flux, world frame.
    pub to_light_world: [f32; 3],
    /// Integral of its radiance over its solid angle.
    pub flux_rgb: [f32; 3],
    /// Root mean square angle to its centroid, by flux, radians.
    pub extent_rad: f32,
    /// How much of it is taken out of the soft half, 0 to 1: lights come and go gradually.
    pub fade: f32,
}

/// Light as it is shaded with: hard lights with shadow maps, and the rest in SH. Together they are all of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lights {
    /// What the hard lights stand for; empty slots are `None`. A light without extent that came from SH alone is not
    /// listed.
    pub compact: [Option<CompactLight>; MAX_LIGHTS],
    /// The hard half.
    pub hard: HardLights,
    /// The soft half. Coefficients may stand for a function that is negative in places; clamp the final shade.
    pub global: RadianceSh,
}

impl Lights {
    /// Soft light alone.
    pub const fn soft(global: RadianceSh) -> Self {
        Self { compact: [None; MAX_LIGHTS], hard: HardLights::none(), global }
    }
}

impl From<SplitLight> for Lights {
    /// One hard light at most: none where it has no power.
    fn from(split: SplitLight) -> Self {
        let mut lights = Self::soft(split.global);
        if let Some(DirectionalLight { to_light_world, irradiance_rgb, .. }) = split.direct
            && irradiance_rgb.iter().any(|&e| e > 0.0)
        {
            lights.hard.push(HardLight { to_light_world, irradiance_rgb, extent_rad: 0.0 });
        }
        lights
    }
}

/// How an environment picture covers the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapLayout {
    /// Width 2:1 height; theta = pi v from +z, phi = 2 pi u - pi from +x towards +y.
    Equirect,
    /// Debevec's angular map, square; axis = the map's forward direction.
    Angular,
    /// Six square faces one under the other, in the order +x -x +y -y +z -z.
    Cube,
}

/// An environment picture.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    /// How texels map to directions.
    pub layout: MapLayout,
    /// Linear radiance.
    pub radiance: RadianceImage,
}

/// Radiance from weighted directions: what `unwrap_ball` and the maps give and `project_sh` sums.
/// Both lists have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RadianceSamples {
    /// Unit direction in the world frame (x, y, z) and solid angle in steradians (w).
    pub directions: Vec<[f32; 4]>,
    /// Radiance (r, g, b) and image flags (`LOWER_BOUND` ..) as a number (a).
    pub radiance: Vec<[f32; 4]>,
}
