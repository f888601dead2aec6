//! One number for all pixels of a result.

use sha2::{Digest, Sha256};

/// SHA-256 over output pixels, in the order in which they are added.
#[derive(Default)]
pub struct PixelDigest(Sha256);

impl PixelDigest {
    /// Adds 8-bit pixels.
    pub fn add_bytes(&mut self, pixels: &[[u8; 3]]) {
        self.0.update(bytemuck::cast_slice(pixels));
    }

    /// Adds linear pixels (little-endian f32; the two zeros count as one).
    pub fn add_floats(&mut self, pixels: &[[f32; 3]]) {
        for c in pixels.iter().flatten() {
            self.0.update((c + 0.0).to_le_bytes());
        }
    }

    /// The digest so far, in hexadecimal.
    pub fn hex(self) -> String {
        self.0.finalize().iter().map(|b| format!("{b:02x}")).collect()
    }
}
