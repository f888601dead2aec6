//! Camera lenses: pinhole, radial-tangential (Brown-Conrady) and equidistant fisheye (Kannala-Brandt).

use glam::{DVec2, DVec3};

/// How rays bend between the pinhole's plane and the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// None: a pinhole.
    None,
    /// OpenCV's `plumb_bob` and `rational_polynomial`: k1 k2 p1 p2 k3 k4 k5 k6.
    RadialTangential([f64; 8]),
    /// Equidistant fisheye (OpenCV's `fisheye`): k1 k2 k3 k4 over the angle theta.
    Equidistant([f64; 4]),
}

/// A calibrated lens. Pixels are continuous: pixel (i, j) covers [i, i+1) x [j, j+1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point, x, in continuous pixels.
    pub cx: f64,
    /// Principal point, y, in continuous pixels.
    pub cy: f64,
    /// Distortion model and coefficients.
    pub distortion: Distortion,
}

impl Lens {
    /// A pinhole.
    pub const fn pinhole(width: u32, height: u32, fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { width, height, fx, fy, cx, cy, distortion: Distortion::None }
    }

    /// Where a point in the camera's frame appears, in continuous pixels; `None` behind the camera or
    /// outside the model's domain.
    pub fn project(&self, point_camera: DVec3) -> Option<DVec2> {
        let _ = point_camera;
        None
    }

    /// The unit direction, in the camera's frame, of the ray through a pixel; `None` where the model
    /// cannot be inverted.
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let _ = pixel;
        None
    }
}
