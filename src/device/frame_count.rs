//! A driver's count of frames, of 32 bits and with gaps, in 64 bits.

/// Numbers frames on, and counts those that are missing.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameCount {
    last: Option<u64>,
    /// Frames that never came.
    pub gaps: u64,
}

impl FrameCount {
    /// The number of a frame in 64 bits; counts those that are missing before it. A count that goes back begins anew.
    pub fn next(&mut self, sequence: u32) -> u64 {
        let next = match self.last {
            None => u64::from(sequence),
            Some(last) => {
                let step = sequence.wrapping_sub(last as u32);
                let is_forward = step != 0 && step < u32::MAX / 2;
                self.gaps += if is_forward { u64::from(step) - 1 } else { 0 };
                last + if is_forward { u64::from(step) } else { 1 }
            }
        };
        self.last = Some(next);
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_count_the_end_of_32_bits_does_not_and_a_step_back_begins_anew() {
        let mut count = FrameCount::default();
        let numbers: Vec<u64> = [u32::MAX - 1, u32::MAX, 0, 3, 3, 1].iter().map(|s| count.next(*s)).collect();
        let end = u64::from(u32::MAX);
        assert_eq!(numbers, [end - 1, end, end + 1, end + 4, end + 5, end + 6]);
        assert_eq!(count.gaps, 2);
    }
}
