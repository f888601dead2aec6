//! Intensity transfers (Section 7.1 of [Gib03], Eq. 4 and Fig. 4): how much of a *displayed* value each source is worth,
//! for displays that can only subtract from what is shown. With pictures in linear light the ratio form needs none of
//! this and is exact; this stands for comparison.

use crate::math::sh::Real;

/// For each source, strongest first, the displayed value S to subtract where it is hidden: sources are taken for
/// hidden in two sets (`second` says which) of which one is visible while the other is not, and each set is removed in
/// order from the light `total` that all sources give. `tone` maps light to displayed values; light is not let below 0.
/// The lists' common length counts.
pub fn intensity_transfers<T: Real>(
    light: &[T],
    second: &[bool],
    total: T,
    tone: &dyn Fn(T) -> T,
    out: &mut Vec<T>,
) {
    out.clear();
    let mut left = [total; 2];
    let mut shown = [tone(total); 2];
    for (&light, &second) in light.iter().zip(second) {
        let set = usize::from(second);
        left[set] = (left[set] - light).max(T::zero());
        let now = tone(left[set]);
        out.push(shown[set] - now);
        shown[set] = now;
    }
}

/// Sets by turns along the list: a little better than by chance.
pub fn by_turns(count: usize) -> impl Iterator<Item = bool> {
    (0..count).map(|i| i % 2 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_display_gives_the_light_itself() {
        let light = [0.5f64, 0.25, 0.125];
        let sets: Vec<bool> = by_turns(3).collect();
        assert_eq!(sets, [false, true, false]);
        let mut out = Vec::new();
        intensity_transfers(&light, &sets, 1.0, &|l| 255.0 * l, &mut out);
        assert_eq!(out, light.map(|l| 255.0 * l));
        // More light than there is: nothing below black.
        intensity_transfers(&[0.7, 0.7], &[false, false], 1.0, &|l| l, &mut out);
        assert!((out[0] + out[1] - 1.0).abs() < 1e-15 && out[1] >= 0.0, "{out:?}");
    }
}
