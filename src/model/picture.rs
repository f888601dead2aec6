//! What is shown.

use super::{
    image::{RadianceImage, Rgb8Image},
    time::Timestamp,
};

/// A finished picture. `display` is always filled; `radiance` where linear output was asked for.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Time of the camera frame under it.
    pub t: Timestamp,
    /// 8-bit RGB, back through the camera's response.
    pub display: Rgb8Image,
    /// Linear radiance before the response; same size.
    pub radiance: RadianceImage,
}
