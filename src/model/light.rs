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
