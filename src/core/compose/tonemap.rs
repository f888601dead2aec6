//! Back through the camera's response to 8 bits. Twin: `shaders/compose/tonemap.wgsl`.

use crate::model::response::Response;

/// Cells an octave of the start table: 2^CELL_BITS.
const CELL_BITS: u32 = 8;
/// Bits of a f32 below its cell.
pub const CELL_SHIFT: u32 = 23 - CELL_BITS;
/// Cells of the start table: 64 octaves, far more than 8 bits span in any response. So fine that few hold two steps.
pub const CELLS: usize = 64 << CELL_BITS;

/// A response turned round: for each channel the exposures at which the rounded value steps up.
#[derive(Clone, Debug, PartialEq)]
pub struct ToneTable {
    response: Response,
    /// `thresholds[c][z]`: exposure at which `Response::value_of` passes z + 1/2; never decreasing. The last is infinite.
    pub thresholds: [[f32; 256]; 3],
    /// For each cell of exposures (those of equal bits above [`CELL_SHIFT`]), the value at its lower end in each channel; 0.
    pub starts: Vec<[u8; 4]>,
    /// The bits of the first cell.
    pub first_cell: u32,
}

impl ToneTable {
    /// The way back through a camera's curve.
    pub fn of(response: &Response) -> Self {
        let mut table = Self {
            response: response.clone(),
            thresholds: [[f32::INFINITY; 256]; 3],
            starts: vec![[0; 4]; CELLS],
            first_cell: 0,
        };
        table.fill();
        table
    }

    /// Takes another response; free where it is the same one. Says whether it was another.
    pub fn update(&mut self, response: &Response) -> bool {
        let is_another = self.response != *response;
        if is_another {
            self.response.clone_from(response);
            self.fill();
        }
        is_another
    }

    fn fill(&mut self) {
        self.thresholds = self.response.thresholds();
        // The table starts at the cell of the smallest threshold that is a normal number.
        let lowest = self.thresholds.iter().map(|t| t[0]).fold(f32::INFINITY, f32::min);
        self.first_cell = lowest.clamp(f32::MIN_POSITIVE, 1e30).to_bits() >> CELL_SHIFT;
        for (k, starts) in self.starts.iter_mut().enumerate() {
            let bits = (self.first_cell + k as u32) << CELL_SHIFT;
            let low = f32::from_bits(bits.min(f32::MAX.to_bits()));
            for (start, thresholds) in starts.iter_mut().zip(&self.thresholds) {
                *start = thresholds.partition_point(|&t| t <= low).min(255) as u8;
            }
        }
    }

    /// The 8-bit value of an exposure in a channel: `Response::value_of` rounded (half up), but for exposures
    /// within rounding of a step. Never decreases; not a number or negative gives 0.
    /// The GPU finds the same count of thresholds at or below the exposure, from the same starts.
    #[inline]
    pub fn value(&self, channel: usize, exposure: f32) -> u8 {
        let thresholds = &self.thresholds[channel];
        // The last threshold is infinite: never reached.
        let known = if exposure < f32::MAX { exposure } else { f32::MAX };
        let cell = (known.to_bits() >> CELL_SHIFT).saturating_sub(self.first_cell);
        let mut z = self.starts.get((cell as usize).min(CELLS - 1)).map_or(0, |starts| starts[channel]);
        // Hardly ever is there more than one step in a cell: this one without a branch.
        z += u8::from(thresholds[usize::from(z)] <= known);
        while thresholds[usize::from(z)] <= known {
            z += 1;
        }
        if exposure > 0.0 { z } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn curve(gamma: f64, range_ln: f64, flat: bool) -> Response {
        let g = std::array::from_fn(|z| {
            let v = if flat { (z / 16 * 16).max(1) } else { z.max(1) } as f64 / 255.0;
            (range_ln + gamma * v.ln()) as f32
        });
        Response::new([g; 3]).unwrap()
    }

    fn check(response: &Response, exposure: f32) -> Result<(), TestCaseError> {
        let table = ToneTable::of(response);
        for c in 0..3 {
            let exact = response.value_of(c, exposure);
            let value = f32::from(table.value(c, exposure));
            // Half a step of rounding, and the rounding of the exponential in f32.
            prop_assert!((value - exact).abs() <= 0.501, "{exposure}: {value} for {exact}");
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn rounds_the_response(log in -30.0f32..30.0, gamma in 0.3f64..4.0, range in -20.0f64..20.0, shape in 0..3) {
            let response = match shape { 0 => Response::srgb(), s => curve(gamma, range, s == 2) };
            check(&response, log.exp())?;
            check(&response, ((log / 5.0) as f64 + range - gamma).exp() as f32)?;
        }
    }

    #[test]
    fn rises_over_the_whole_range_and_reaches_both_ends() {
        let mut table = ToneTable::of(&curve(0.5, 3.0, false));
        table.update(&Response::srgb());
        let mut last = 0;
        for bits in (0..f32::MAX.to_bits()).step_by(9_973) {
            let value = table.value(1, f32::from_bits(bits));
            assert!(value >= last);
            last = value;
        }
        assert_eq!(last, 255);
        for nothing in [0.0, -1.0, f32::NAN, f32::NEG_INFINITY, f32::MIN_POSITIVE] {
            assert_eq!(table.value(0, nothing), 0);
        }
        assert_eq!(table.value(0, f32::INFINITY), 255);
    }
}
