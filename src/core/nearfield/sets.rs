//! Which patches count as sources (Section 4 of [Gib03]), and what may be neglected at a vertex (the 2 % rule of
//! Section 6, as a budget).

use crate::{math::color, model::room::RoomPatch};

/// The patches whose shadows are drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceSet {
    /// Indices of patches, brightest radiance first.
    pub patches: Vec<u32>,
    /// Share of the power of all patches that they have, 0 to 1.
    pub power_share: f32,
    /// Patches that shine and are not in the set.
    pub left_out: usize,
}

/// The smallest set of the brightest patches (by luminance of their radiance) whose power, radiance times area, is at
/// least `share` (0 to 1) of the power of all. Patches without positive, finite power never belong to it. Among equals
/// the earlier one comes first.
pub fn source_set(patches: &[RoomPatch], share: f64) -> SourceSet {
    let radiance = |i: u32| f64::from(color::luminance(patches[i as usize].radiance_rgb));
    let power = |i: u32| radiance(i) * f64::from(patches[i as usize].area_m2);
    let mut lit: Vec<u32> =
        (0..patches.len() as u32).filter(|&i| power(i) > 0.0 && power(i).is_finite()).collect();
    lit.sort_by(|&a, &b| radiance(b).total_cmp(&radiance(a)).then(a.cmp(&b)));
    let total: f64 = lit.iter().map(|&i| power(i)).sum();
    let (mut sum, mut count) = (0.0, 0);
    // All of them are meant where rounding leaves a rest.
    while count < lit.len() && (share >= 1.0 || sum < share * total) {
        sum += power(lit[count]);
        count += 1;
    }
    let left_out = lit.len() - count;
    lit.truncate(count);
    SourceSet { patches: lit, power_share: if total > 0.0 { (sum / total) as f32 } else { 0.0 }, left_out }
}

/// The value from which on contributions count: those below it sum to at most `share` of all. Smallest first; of equal
/// ones all count or none. `contributions` are sorted by this. 0 where there are none.
pub fn budget_threshold(contributions: &mut [f32], share: f64) -> f32 {
    contributions.sort_unstable_by(f32::total_cmp);
    let total: f64 = contributions.iter().map(|c| f64::from(*c)).sum();
    let (mut dropped, mut threshold) = (0.0, 0.0);
    for &c in contributions.iter() {
        dropped += f64::from(c);
        threshold = c;
        if dropped > share * total {
            break;
        }
    }
    threshold
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_dropped_stays_within_the_budget(
            values in prop::collection::vec(0u16..50, 0..60), share in 0.0f64..0.5,
        ) {
            // Whole numbers, so that there are ties.
            let mut values: Vec<f32> = values.into_iter().map(f32::from).collect();
            let threshold = budget_threshold(&mut values, share);
            let total: f64 = values.iter().map(|v| f64::from(*v)).sum();
            let below: f64 = values.iter().filter(|v| **v < threshold).map(|v| f64::from(*v)).sum();
            prop_assert!(below <= share * total + 1e-9);
            // The next one up would not fit any more.
            let with: f64 = values.iter().filter(|v| **v <= threshold).map(|v| f64::from(*v)).sum();
            prop_assert!(total == 0.0 || with > share * total);
        }
    }
}
