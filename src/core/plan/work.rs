//! How much work the parts of a frame are, roughly: to weigh savings against each other, not to tell time.
//!
//! The unit is the composing of one pixel. The factors say how many times that much the CPU twins take, to an order of magnitude;
//! devices differ.

use super::Pass;

/// What the work of a frame depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Amounts {
    /// Pixels of the picture.
    pub pixels: usize,
    /// Vertices of all virtual objects.
    pub vertices: usize,
    /// Shadow maps.
    pub maps: usize,
    /// Texels a side of each.
    pub map_texels: usize,
    /// Spheres that block soft light.
    pub spheres: usize,
    /// Step between the pixels that soft shadows are evaluated at.
    pub soft_step_px: usize,
    /// Lights of a known room.
    pub near_lights: usize,
    /// Texels a side of each of their maps.
    pub near_texels: usize,
    /// Numbers of a spherical harmonic series: order squared.
    pub coefficients: usize,
    /// Pictures of a bracket.
    pub brackets: usize,
}

impl Amounts {
    /// Directions that a ball is read in, about.
    pub const BALL_SAMPLES: f32 = 50_000.0;

    /// Work of a pass, in units.
    pub fn of(&self, pass: Pass) -> f32 {
        (pass.facts().work)(self)
    }

    /// Work of something that is done once a pixel.
    pub fn pixels(&self) -> f32 {
        self.pixels as f32
    }

    /// Work of what objects take of a known room's light.
    pub fn near_light(&self) -> f32 {
        4.0 * self.pixels() * self.near_lights as f32
    }

    /// Work of the soft light at the vertices of objects.
    pub fn vertex_light(&self) -> f32 {
        self.vertices as f32 * (3.0 * self.coefficients as f32 + 4.0 * self.spheres as f32)
    }
}
