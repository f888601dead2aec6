//! Which part of a light a receiver sees, and how much of the light each of its places stands for there.

/// Which part of a light a receiver sees: middle and half lengths along the light's two half axes, in their lengths. In 24
/// bits each axis, which a 32-bit float holds exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPart(pub [f32; 2]);

impl SeenPart {
    /// All of it, evenly.
    pub const WHOLE: Self = Self([8_390_656.0; 2]);

    /// Middles within -2 to 2 and half lengths of 0 to 2, cut to that; wrong by at most a 2048th.
    pub fn of(middle: [f32; 2], half: [f32; 2]) -> Self {
        Self([0, 1].map(|k: usize| {
            let middle = (middle[k] * 1024.0 + 2048.0).round().clamp(0.0, 4095.0);
            middle * 4096.0 + (half[k] * 2048.0).round().clamp(0.0, 4095.0)
        }))
    }

    /// Middle and half lengths.
    #[inline(always)]
    pub fn middle_half(self) -> ([f32; 2], [f32; 2]) {
        let codes = self.0.map(|code| code as u32);
        let middle = codes.map(|code| ((code >> 12) as f32 - 2048.0) / 1024.0);
        (middle, codes.map(|code| (code & 4095) as f32 / 2048.0))
    }
}

/// Middle and half lengths of a light that is seen as a whole.
pub const WHOLE: ([f32; 2], [f32; 2]) = ([0.0; 2], [1.0; 2]);

/// A part is at least this long to each side, in half axes: so that it lies in some cell.
const LEAST_HALF: f32 = 1e-3;

/// The share of a part of a light, along one half axis, that lies in one of `side` equal cells of it; the outermost cells
/// reach on for ever, so the shares' sum is 1.
#[inline(always)]
pub fn share(cell: u32, side: u32, middle: f32, half: f32) -> f32 {
    let half = if half > LEAST_HALF { half } else { LEAST_HALF };
    let (low, high) = (middle - half, middle + half);
    let edge = |cell: u32| 2.0 * cell as f32 / side as f32 - 1.0;
    let (first, last) = (edge(cell), edge(cell + 1));
    let from = if cell > 0 && first > low { first } else { low };
    let to = if cell + 1 < side && last < high { last } else { high };
    let length = (to - from) / (2.0 * half);
    if length > 0.0 { length } else { 0.0 }
}
