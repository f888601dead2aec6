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

/// Directions that a ball is read in, about.
const BALL_SAMPLES: f32 = 50_000.0;

impl Amounts {
    /// Work of a pass, in units.
    pub fn of(&self, pass: Pass) -> f32 {
        let n = |x: usize| x as f32;
        let pixels = n(self.pixels);
        match pass {
            Pass::MergeBracket => 4.0 * pixels * n(self.brackets),
            Pass::UnwrapBall => 30.0 * BALL_SAMPLES,
            Pass::ProjectSh => 0.5 * BALL_SAMPLES * n(self.coefficients),
            Pass::ShadowMaps => n(self.maps) * (0.2 * n(self.map_texels).powi(2) + 10.0 * n(self.vertices)),
            Pass::SoftShadow => 5.0 * pixels / n(self.soft_step_px.max(1)).powi(2) * n(self.spheres),
            Pass::PointMaps => {
                n(self.near_lights) * (0.2 * n(self.near_texels).powi(2) + 2.0 * n(self.vertices))
            }
            Pass::Subtract | Pass::SubtractDisplayed => 4.0 * pixels * n(self.near_lights),
            Pass::ShadeObject => 3.0 * pixels + self.vertex_light(),
            Pass::ShadeSurface => 6.0 * pixels + 2.0 * pixels * n(self.maps),
            Pass::Composite => pixels,
            Pass::Tonemap => 3.0 * pixels,
        }
    }

    /// Work of the soft light at the vertices of objects.
    pub fn vertex_light(&self) -> f32 {
        self.vertices as f32 * (3.0 * self.coefficients as f32 + 4.0 * self.spheres as f32)
    }
}
