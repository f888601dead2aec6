//! The response's nearest value to an exposure, without a search.

/// Bits of an f32 below those that choose a cell. Cells are a 256th of an octave wide or less: two values are hardly ever in one.
const BITS_BELOW: u32 = 15;

/// For each channel: the values of exposures.
#[derive(Clone, Debug)]
pub struct NearestValues {
    /// For each value the exposure from which the next one is given; rising, the last without end.
    thresholds: [[f32; 256]; 3],
    /// Number of the first cell of each channel.
    first: [u32; 3],
    /// For each cell from the first on: the value at its lower end.
    cells: [Vec<u8>; 3],
}

impl NearestValues {
    /// Of the thresholds between values.
    pub fn new(thresholds: &[[f32; 256]; 3]) -> Self {
        let cell = |exposure: f32| exposure.max(f32::MIN_POSITIVE).to_bits() >> BITS_BELOW;
        let first: [u32; 3] = std::array::from_fn(|c| cell(thresholds[c][0]));
        let cells = std::array::from_fn(|c| {
            (first[c]..=cell(thresholds[c][254]))
                .map(|k| value_of(&thresholds[c], f32::from_bits(k << BITS_BELOW)))
                .collect()
        });
        Self { thresholds: *thresholds, first, cells }
    }

    /// The values of an exposure that is at least 0: what a search among the thresholds gives.
    #[inline(always)]
    pub fn of(&self, exposure: [f32; 3]) -> [u8; 3] {
        std::array::from_fn(|c| {
            let (thresholds, cells) = (&self.thresholds[c], &self.cells[c]);
            let cell = (exposure[c].to_bits() >> BITS_BELOW).saturating_sub(self.first[c]) as usize;
            let mut value = usize::from(cells[cell.min(cells.len() - 1)]);
            // The first step is no branch.
            value += usize::from(thresholds[value] <= exposure[c]);
            while value < 255 && thresholds[value] <= exposure[c] {
                value += 1;
            }
            value as u8
        })
    }
}

fn value_of(thresholds: &[f32; 256], exposure: f32) -> u8 {
    thresholds.partition_point(|edge| *edge <= exposure).min(255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dice::Dice;
    use crate::model::response::Response;

    #[test]
    fn it_is_what_a_search_gives() {
        let steep = Response::new([std::array::from_fn(|z| (z as f32 - 250.0) * 0.3); 3]).unwrap();
        for response in [Response::srgb(), steep] {
            let thresholds = response.thresholds();
            let nearest = NearestValues::new(&thresholds);
            let mut dice = Dice::new(7);
            let edges = thresholds[0][..255].iter().flat_map(|e| [e.next_down(), *e, e.next_up()]);
            let others = (0..20_000).map(|_| (60.0 * dice.unit_f32() - 50.0).exp());
            for exposure in edges.chain(others).chain([0.0, f32::MIN_POSITIVE, 1e-40, f32::MAX]) {
                let searched = std::array::from_fn(|c| value_of(&thresholds[c], exposure));
                assert_eq!(nearest.of([exposure; 3]), searched, "{exposure}");
            }
        }
    }
}
