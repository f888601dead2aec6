//! Cuts sources into n representatives: the one dial of both papers (section 4b of the project's formulas; the
//! priority expansion of Section 6 of [Gib03]).
//!
//! Each root (a compact light, a room) starts as one node. A node is represented by one hard light at the median of
//! its flux, and the node whose splitting removes most error is split in two, until there are n.
//!
//! The error of a node is that of its penumbra: along an axis across an edge the true shadow is F(x), the share of the
//! flux up to x, and the hard one is a step H at the median, so that the squared error is W^2 times the integral of
//! (F - H)^2 dx, with W the node's flux. It grows with the square of the flux and once with the width: a wide, faint
//! rim around a bright sun is not split before it matters.

use crate::math::{color, solve::symmetric_eigen};
use glam::{DVec3, Vec3};

/// Bins in which a node's flux is counted along an axis.
const BINS: usize = 32;

/// A leaf: light from one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaf {
    /// Far: unit vector towards it, world frame. Near: its place, metres.
    pub at: Vec3,
    /// Far: integral of its radiance over its solid angle. Near: any measure of its power.
    pub flux_rgb: [f32; 3],
    /// The light or room that it belongs to: leaves of different roots are never represented together.
    pub root: u32,
}

/// A representative of the leaves below one node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FarRepresentative {
    /// Median of the leaves' places by luminous flux: along the node's two main axes, and from there towards the place of
    /// least mean distance. Not normalised.
    pub at: Vec3,
    /// Mean of the leaves' places by luminous flux. Not normalised: shorter than a unit vector where far leaves spread.
    pub mean: Vec3,
    /// Sum over the leaves.
    pub flux_rgb: [f32; 3],
    /// As the leaves'.
    pub root: u32,
    /// How many leaves.
    pub leaves: u32,
}

/// A node: a range of the list of leaves, and what splitting it would gain.
#[derive(Clone, Copy, Debug)]
struct CutNode {
    start: usize,
    end: usize,
    gain: f64,
    axis: DVec3,
    threshold: f64,
    made: FarRepresentative,
}

/// Cuts; keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct Cutter {
    leaves: Vec<Leaf>,
    nodes: Vec<CutNode>,
    made: Vec<FarRepresentative>,
}

impl Cutter {
    /// What the last cut gave.
    pub fn representatives(&self) -> &[FarRepresentative] {
        &self.made
    }

    /// Cuts `leaves` (any order) into at most `count` representatives; at least one of each root is made while
    /// `count` lasts, roots of more flux first, and the leaves of roots left out are not represented. Fewer come where
    /// nothing is left to split. Order: by root, then by where they lie in the tree. Leaves without positive,
    /// finite luminous flux or with a place that is not finite are passed over.
    pub fn cut(&mut self, leaves: &[Leaf], count: usize) -> &[FarRepresentative] {
        self.leaves.clear();
        self.leaves
            .extend(leaves.iter().filter(|l| l.at.is_finite() && weight(l) > 0.0 && weight(l).is_finite()));
        // Unstable sorts allocate nothing, and equal input still gives equal order.
        self.leaves.sort_unstable_by_key(|l| l.root);
        self.nodes.clear();
        let mut start = 0;
        while start < self.leaves.len() {
            let root = self.leaves[start].root;
            let end = start + self.leaves[start..].iter().take_while(|l| l.root == root).count();
            self.nodes.push(examine(&self.leaves, start, end));
            start = end;
        }
        if self.nodes.len() > count {
            self.nodes.sort_unstable_by(|a, b| {
                luminous(&b.made).total_cmp(&luminous(&a.made)).then(a.start.cmp(&b.start))
            });
            self.nodes.truncate(count);
        }
        while self.nodes.len() < count {
            let best = self.nodes.iter().enumerate().max_by(|(i, a), (j, b)| {
                // Of equals the earlier one.
                a.gain.total_cmp(&b.gain).then(j.cmp(i))
            });
            let Some((index, node)) = best.filter(|(_, n)| n.gain > 0.0) else { break };
            let node = *node;
            let middle = partition(&mut self.leaves[node.start..node.end], node.axis, node.threshold);
            let middle = node.start + middle;
            if middle == node.start || middle == node.end {
                self.nodes[index].gain = 0.0;
                continue;
            }
            self.nodes[index] = examine(&self.leaves, node.start, middle);
            self.nodes.push(examine(&self.leaves, middle, node.end));
        }
        self.nodes.sort_unstable_by_key(|n| n.start);
        self.made.clear();
        self.made.extend(self.nodes.iter().map(|n| n.made));
        &self.made
    }
}

fn weight(leaf: &Leaf) -> f64 {
    f64::from(color::luminance(leaf.flux_rgb))
}

fn luminous(made: &FarRepresentative) -> f64 {
    f64::from(color::luminance(made.flux_rgb))
}

/// Moves leaves on or below the threshold to the front, keeping their order within a swap's reach; how many.
fn partition(leaves: &mut [Leaf], axis: DVec3, threshold: f64) -> usize {
    let mut front = 0;
    for i in 0..leaves.len() {
        if axis.dot(leaves[i].at.as_dvec3()) <= threshold {
            leaves.swap(front, i);
            front += 1;
        }
    }
    front
}

/// Sums, main axes, and the best split of a range.
fn examine(leaves: &[Leaf], start: usize, end: usize) -> CutNode {
    let range = &leaves[start..end];
    let mut flux = [0.0f64; 3];
    let (mut total, mut mean) = (0.0, DVec3::ZERO);
    for leaf in range {
        let w = weight(leaf);
        total += w;
        mean += w * leaf.at.as_dvec3();
        for (sum, c) in flux.iter_mut().zip(leaf.flux_rgb) {
            *sum += f64::from(c);
        }
    }
    mean /= total;
    let mut scatter = [[0.0f64; 3]; 3];
    for leaf in range {
        let d = (leaf.at.as_dvec3() - mean).to_array();
        let w = weight(leaf) / total;
        for (i, row) in scatter.iter_mut().enumerate() {
            for (j, s) in row.iter_mut().enumerate() {
                *s += w * d[i] * d[j];
            }
        }
    }
    let (values, vectors) = symmetric_eigen(&scatter).unwrap_or(([0.0; 3], [[0.0; 3]; 3]));
    // Two main axes: on a small cap, as on a flat patch, the third says nothing.
    let mut by_size = [0, 1, 2];
    by_size.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let axes = [by_size[0], by_size[1]].map(|k| DVec3::from(vectors[k]));
    let profiles = axes.map(|axis| FluxProfile::of(range, axis, total));
    let mut at = mean;
    for (axis, profile) in axes.iter().zip(&profiles) {
        at += *axis * (profile.median() - axis.dot(mean));
    }
    at = towards_geometric_median(range, at, total);
    let squared = total * total;
    let mut node = CutNode {
        start,
        end,
        gain: 0.0,
        axis: axes[0],
        threshold: 0.0,
        made: FarRepresentative {
            at: at.as_vec3(),
            mean: mean.as_vec3(),
            flux_rgb: flux.map(|c| c as f32),
            root: range.first().map_or(0, |l| l.root),
            leaves: (end - start) as u32,
        },
    };
    let errors = [profiles[0].error(0, BINS), profiles[1].error(0, BINS)];
    let whole = errors[0] + errors[1];
    for (k, profile) in profiles.iter().enumerate() {
        if profile.width <= 0.0 {
            continue;
        }
        for split in 1..BINS {
            let share = profile.cumulative[split];
            if share <= 0.0 || share >= 1.0 {
                continue;
            }
            // Across the other axis both parts are taken to have the whole's profile.
            let across = errors[1 - k] * (share * share + (1.0 - share) * (1.0 - share));
            let gain = squared * (whole - profile.error(0, split) - profile.error(split, BINS) - across);
            if gain > node.gain {
                node.gain = gain;
                node.axis = axes[k];
                node.threshold = profile.low + profile.width * split as f64 / BINS as f64;
            }
        }
    }
    node
}

/// The flux of a node along an axis.
struct FluxProfile {
    low: f64,
    width: f64,
    /// Share of the flux below each bin's lower end; the last is 1.
    cumulative: [f64; BINS + 1],
}

impl FluxProfile {
    fn of(leaves: &[Leaf], axis: DVec3, total: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for leaf in leaves {
            let x = axis.dot(leaf.at.as_dvec3());
            (low, high) = (low.min(x), high.max(x));
        }
        let width = if high > low { high - low } else { 0.0 };
        let mut cumulative = [0.0; BINS + 1];
        let scale = if width > 0.0 { BINS as f64 / width } else { 0.0 };
        for leaf in leaves {
            // A leaf on a threshold belongs to the lower part, as in `partition`.
            let bin = ((axis.dot(leaf.at.as_dvec3()) - low) * scale).ceil() as usize;
            cumulative[bin.clamp(1, BINS)] += weight(leaf) / total;
        }
        for bin in 1..=BINS {
            cumulative[bin] += cumulative[bin - 1];
        }
        cumulative[BINS] = 1.0;
        Self { low, width, cumulative }
    }

    /// Where half of the flux lies on either side, linear inside of a bin.
    fn median(&self) -> f64 {
        let bin = self.cumulative[1..].iter().position(|&f| f >= 0.5).unwrap_or(BINS - 1);
        let (below, above) = (self.cumulative[bin], self.cumulative[bin + 1]);
        let within = if above > below { (0.5 - below) / (above - below) } else { 0.5 };
        self.low + self.width * (bin as f64 + within) / BINS as f64
    }

    /// Integral of (F - H)^2 dx over bins `from..to`, F the share of the whole flux from the first of them on and H a
    /// step of the same height where F reaches its half.
    fn error(&self, from: usize, to: usize) -> f64 {
        let (start, height) = (self.cumulative[from], self.cumulative[to] - self.cumulative[from]);
        let mut sum = 0.0;
        for bin in from..to {
            // Linear inside of a bin: Simpson's rule is exact for its square; the bin with the step is the mean of both.
            let (a, b) = (self.cumulative[bin] - start, self.cumulative[bin + 1] - start);
            let square = |a: f64, b: f64| (a * a + a * b + b * b) / 3.0;
            let half = 0.5 * height;
            sum += if b <= half {
                square(a, b)
            } else if a >= half {
                square(height - a, height - b)
            } else {
                let within = (half - a) / (b - a);
                within * square(a, half) + (1.0 - within) * square(half, height - b)
            };
        }
        sum * self.width / BINS as f64
    }
}

/// A few steps of Weiszfeld's from `start` towards the place of least mean distance to the leaves' flux: like a median
/// it stays with a bright core in a wide faint rim, and it does not hang on the choice of axes.
fn towards_geometric_median(range: &[Leaf], start: DVec3, total: f64) -> DVec3 {
    const STEPS: usize = 4;
    let spread: f64 = range.iter().map(|l| weight(l) * l.at.as_dvec3().distance(start)).sum::<f64>() / total;
    // Nearer leaves pull no harder: one bright texel must not take all, and a smooth light keeps its middle. Of 0.05 and 0.3
    // of the mean distance the second gives the smaller errors (tests/split_dial.rs).
    let least = 0.3 * spread;
    let mut at = start;
    if !(least > 0.0) {
        return at;
    }
    for _ in 0..STEPS {
        let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
        for leaf in range {
            let place = leaf.at.as_dvec3();
            let pull = weight(leaf) / place.distance(at).max(least);
            sum += place * pull;
            whole += pull;
        }
        at = sum / whole;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_of_endless_flux_are_passed_over() {
        let leaf = |flux: f32, root| Leaf { at: Vec3::X, flux_rgb: [flux; 3], root };
        let leaves = [leaf(f32::INFINITY, 0), leaf(2.0, 0), leaf(f32::NAN, 1), leaf(-1.0, 1)];
        let mut cutter = Cutter::default();
        let made = cutter.cut(&leaves, 4);
        assert_eq!(made.len(), 1);
        assert_eq!((made[0].at, made[0].flux_rgb, made[0].leaves), (Vec3::X, [2.0; 3], 1));
    }
    use proptest::prelude::*;

    fn leaf(x: f32, y: f32, flux: f32, root: u32) -> Leaf {
        Leaf { at: Vec3::new(x, y, 1.0).normalize(), flux_rgb: [flux, 2.0 * flux, 0.5 * flux], root }
    }

    #[test]
    fn a_sun_in_a_wide_faint_rim_is_met_by_the_first_representative() {
        let mut leaves = vec![leaf(0.2, 0.0, 100.0, 0)];
        for i in -10..=10 {
            for j in -10..=10 {
                leaves.push(leaf(0.04 * i as f32, 0.04 * j as f32, 0.02, 0));
            }
        }
        let mut cutter = Cutter::default();
        let one = cutter.cut(&leaves, 1)[0];
        let off = one.at.normalize().angle_between(leaves[0].at).to_degrees();
        assert!(off < 1.0, "median {off} degrees off");
        // The second takes the rim off the sun, and the sun stays alone.
        let many = cutter.cut(&leaves, 8).to_vec();
        let sun = many.iter().max_by(|a, b| a.flux_rgb[0].total_cmp(&b.flux_rgb[0])).unwrap();
        let off = sun.at.normalize().angle_between(leaves[0].at).to_degrees();
        // Measured 0.34: a quarter of one of the 32 bins in which a median is sought.
        assert!(off < 0.4, "{off}");
    }

    #[test]
    fn a_slanting_bar_is_cut_across_its_length() {
        // A long thin light that lies along no axis of the world: its parts follow one another along it.
        let along = Vec3::new(0.6, 0.7, 0.0).normalize();
        let across = Vec3::new(-along.y, along.x, 0.0);
        let mut leaves = Vec::new();
        for i in -20..=20 {
            for j in -2..=2 {
                let p = 0.02 * i as f32 * along + 0.01 * j as f32 * across;
                leaves.push(leaf(p.x, p.y, 1.0, 0));
            }
        }
        let mut cutter = Cutter::default();
        for part in cutter.cut(&leaves, 4) {
            assert!(part.at.dot(across).abs() < 0.006, "{part:?}");
        }
    }

    #[test]
    fn a_uniform_bar_is_cut_into_equal_parts() {
        let leaves: Vec<Leaf> = (0..64).map(|i| leaf(-0.315 + 0.01 * i as f32, 0.0, 1.0, 0)).collect();
        let mut cutter = Cutter::default();
        for n in [2usize, 4, 8] {
            let parts = cutter.cut(&leaves, n);
            assert_eq!(parts.len(), n);
            for part in parts {
                let share = part.leaves as f32 * n as f32 / 64.0;
                assert!((0.8..=1.25).contains(&share), "{n}: {parts:?}");
            }
        }
    }

    #[test]
    fn maps_go_where_they_remove_most() {
        // Two lights of equal flux, one wide: it gets more. A third without maps left is not represented.
        let mut leaves = Vec::new();
        for i in 0..40 {
            leaves.push(leaf(-0.4 + 0.02 * i as f32, 0.5, 1.0, 7));
            leaves.push(leaf(1.5 + 0.001 * i as f32, 0.0, 1.0, 3));
        }
        leaves.push(leaf(-2.0, -1.0, 0.5, 1));
        let mut cutter = Cutter::default();
        let eight = cutter.cut(&leaves, 8).to_vec();
        let of = |root| eight.iter().filter(|r| r.root == root).count();
        assert!(of(7) >= 4 && of(3) >= 1 && of(1) == 1, "{eight:?}");
        let two: Vec<u32> = cutter.cut(&leaves, 2).iter().map(|r| r.root).collect();
        assert_eq!(two, [3, 7]);
    }

    proptest! {
        #[test]
        fn flux_is_kept_and_nothing_breaks(
            places in prop::collection::vec((-1.0f32..1.0, -1.0f32..1.0, 0.0f32..1e4, 0u32..4), 0..300),
            count in 0usize..70,
        ) {
            let leaves: Vec<Leaf> = places.iter().map(|&(x, y, f, root)| leaf(x, y, f, root)).collect();
            let mut cutter = Cutter::default();
            let parts = cutter.cut(&leaves, count);
            prop_assert!(parts.len() <= count);
            prop_assert!(parts.iter().all(|p| p.at.is_finite() && p.flux_rgb.iter().all(|c| c.is_finite())));
            let roots: std::collections::BTreeSet<u32> =
                leaves.iter().filter(|l| weight(l) > 0.0).map(|l| l.root).collect();
            if count >= roots.len() {
                let total: f64 = leaves.iter().map(weight).sum();
                let kept: f64 = parts.iter().map(luminous).sum();
                prop_assert!((total - kept).abs() <= 1e-6 * total, "{} {}", total, kept);
            }
        }
    }
}
