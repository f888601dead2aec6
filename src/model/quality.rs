//! All settings that trade accuracy for time, in one value that travels with the frame.

/// Accuracy settings of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// SH order of the light, 2 to 6.
    pub sh_order: usize,
    /// Shadow map texels a side, 64 to 4096.
    pub shadow_map_texels: u32,
    /// Taps a side of the percentage-closer filter, 1 to 8.
    pub pcf_taps: u32,
    /// Coverage samples a pixel at object edges: 1 or 4.
    pub coverage_samples: u32,
    /// Frames merged into one HDR picture, 1 to 9.
    pub brackets: usize,
    /// The light is measured on every n-th frame, 1 or more.
    pub light_every: u32,
}

impl Default for Quality {
    fn default() -> Self {
        Self {
            sh_order: 4,
            shadow_map_texels: 1024,
            pcf_taps: 4,
            coverage_samples: 4,
            brackets: 3,
            light_every: 1,
        }
    }
}
