use super::*;
use proptest::prelude::*;

/// Leaves on a row at distance 1, as seen from the origin.
fn row(count: usize, width: f32) -> Vec<Vec3> {
    (0..count).map(|i| Vec3::new((i as f32 + 0.5) / count as f32 * width - 0.5 * width, 0.0, 1.0)).collect()
}

fn ordered<T: Copy>(tree: &SourceTree, list: &[T]) -> Vec<T> {
    tree.order().iter().map(|&i| list[i as usize]).collect()
}

struct Lit {
    tree: SourceTree,
    light: Vec<f32>,
    towards: Vec<Vec3>,
}

impl Lit {
    fn new(places: &[Vec3], light: &[f32]) -> Self {
        let tree = SourceTree::build(places, &vec![1.0; places.len()]);
        let towards: Vec<Vec3> = places.iter().map(|p| p.normalize()).collect();
        let (light, towards) = (ordered(&tree, light), ordered(&tree, &towards));
        Self { tree, light, towards }
    }

    fn marked(&self) -> Marked<'_> {
        Marked { tree: &self.tree, light: &self.light, towards: &self.towards, lasting: true }
    }
}

/// Marked leaves below each chosen node.
fn below(lit: &Lit, chosen: &Chosen) -> Vec<u32> {
    let node = lit.tree.nodes()[chosen.node as usize];
    (node.begin..node.end).filter(|&l| lit.light[l as usize] > 0.0).collect()
}

#[test]
fn an_even_row_is_cut_evenly_and_drawn_from_the_middles() {
    let lit = Lit::new(&row(64, 1.0), &[1.0; 64]);
    let mut expander = Expander::default();
    for by in [Priority::ErrorRemoved, Priority::Transfer] {
        for count in [1, 2, 4, 8, 16, 32, 64, 100] {
            let chosen = expander.expand(&[lit.marked()], WantedNodes::exactly(count), by);
            assert_eq!(chosen.len(), count.min(64));
            for c in chosen {
                let leaves = below(&lit, c);
                assert_eq!(leaves.len(), 64 / count.min(64));
                let middle = leaves[0] as f32 + 0.5 * (leaves.len() - 1) as f32;
                assert!(
                    (c.centre as f32 - middle).abs() <= 0.02 * leaves.len() as f32 + 0.5,
                    "{c:?} {leaves:?}"
                );
            }
        }
    }
}

#[test]
fn unmarked_leaves_cost_nothing() {
    // Two marked leaves far apart in the tree: two nodes are enough, and both are leaves.
    let mut light = [0.0; 64];
    (light[3], light[60]) = (1.0, 2.0);
    let lit = Lit::new(&row(64, 1.0), &light);
    let mut expander = Expander::default();
    let chosen = expander.expand(&[lit.marked()], WantedNodes::exactly(2), Priority::ErrorRemoved);
    assert_eq!(chosen.len(), 2);
    for c in chosen {
        assert!(lit.tree.nodes()[c.node as usize].is_leaf() && c.extent_rad == 0.0);
        assert_eq!(lit.light[c.centre as usize], c.light);
    }
    let one = expander.expand(&[lit.marked()], WantedNodes::exactly(1), Priority::ErrorRemoved)[0];
    assert_eq!((one.light, lit.light[one.centre as usize] > 0.0), (3.0, true));
    assert!(expander.expand(&[lit.marked()], WantedNodes::exactly(0), Priority::ErrorRemoved).is_empty());
    let dark = Lit::new(&row(8, 1.0), &[0.0; 8]);
    assert!(expander.expand(&[dark.marked()], WantedNodes::exactly(5), Priority::ErrorRemoved).is_empty());
    assert!(expander.expand(&[], WantedNodes::exactly(5), Priority::ErrorRemoved).is_empty());
}

#[test]
fn far_and_near_share_one_count_by_what_it_gains() {
    // A narrow sun and a wide window of the same light: the window gets the maps. A faint ceiling gets one.
    let sun = Lit::new(&row(32, 0.01), &[1.0; 32]);
    let window = Lit::new(&row(32, 1.0), &[1.0; 32]);
    let ceiling = Lit::new(&row(32, 2.0), &[0.05; 32]);
    let mut expander = Expander::default();
    let trees = [sun.marked(), window.marked(), ceiling.marked()];
    let chosen = expander.expand(&trees, WantedNodes::exactly(16), Priority::ErrorRemoved).to_vec();
    let of = |tree| chosen.iter().filter(|c| c.tree == tree).count();
    assert!(of(0) <= 2 && of(1) >= 12 && of(2) >= 1, "{chosen:?}");
    // With too few for all trees, the strongest stay.
    let two: Vec<u32> = expander
        .expand(&trees, WantedNodes::exactly(2), Priority::ErrorRemoved)
        .iter()
        .map(|c| c.tree)
        .collect();
    assert_eq!(two, [0, 1]);
}

#[test]
fn a_tie_that_trembles_does_not_flicker() {
    // Two equal groups of leaves, one more split for both; their light trembles by 5 %.
    let places: Vec<Vec3> = (0..16)
        .map(|i| Vec3::new(if i < 8 { -2.0 } else { 2.0 } + 0.05 * (i % 8) as f32, 0.0, 1.0))
        .collect();
    let mut expander = Expander::default();
    let mut seen = Vec::new();
    for frame in 0..20 {
        let light: Vec<f32> = (0..16).map(|i| if (i < 8) == (frame % 2 == 0) { 1.05 } else { 1.0 }).collect();
        let lit = Lit::new(&places, &light);
        let nodes: Vec<(u32, u32)> = expander
            .expand(&[lit.marked()], WantedNodes::exactly(3), Priority::ErrorRemoved)
            .iter()
            .map(|c| (c.node, c.centre))
            .collect();
        seen.push(nodes);
    }
    assert!(seen.windows(2).all(|w| w[0] == w[1]), "{seen:?}");
    // A lasting difference is followed.
    let light: Vec<f32> = (0..16).map(|i| if i < 8 { 1.0 } else { 3.0 }).collect();
    let other = Lit::new(&places, &light);
    let first: Vec<u32> = expander
        .expand(&[other.marked()], WantedNodes::exactly(3), Priority::ErrorRemoved)
        .iter()
        .map(|c| c.node)
        .collect();
    let light: Vec<f32> = (0..16).map(|i| if i < 8 { 3.0 } else { 1.0 }).collect();
    let other = Lit::new(&places, &light);
    let second: Vec<u32> = expander
        .expand(&[other.marked()], WantedNodes::exactly(3), Priority::ErrorRemoved)
        .iter()
        .map(|c| c.node)
        .collect();
    assert_ne!(first, second);
}

#[test]
fn one_light_for_two_trees_stays_where_it_is() {
    let (a, b) = (row(8, 0.5), row(16, 0.2));
    let mut expander = Expander::default();
    let of = |expander: &mut Expander, lights: [f32; 2]| {
        let trees = [Lit::new(&a, &[lights[0] / 8.0; 8]), Lit::new(&b, &[lights[1] / 16.0; 16])];
        let chosen = expander.expand(
            &[trees[0].marked(), trees[1].marked()],
            WantedNodes::exactly(1),
            Priority::ErrorRemoved,
        );
        assert_eq!(chosen.len(), 1);
        chosen[0].tree
    };
    for first in 0..2u32 {
        // Whichever was there first stays while both tremble by a tenth, and what lasts is followed.
        let strong = |which: u32, ratio: f32| if which == 0 { [ratio, 1.0] } else { [1.0, ratio] };
        assert_eq!(of(&mut expander, strong(first, 2.0)), first);
        for frame in 0..10 {
            assert_eq!(of(&mut expander, strong(frame % 2, 1.1)), first, "{frame}");
        }
        assert_eq!(of(&mut expander, strong(1 - first, 1.3)), 1 - first);
    }
}

proptest! {
    #[test]
    fn every_marked_leaf_is_represented_once(
        leaves in prop::collection::vec((prop::array::uniform3(-1.0f32..1.0), 0.0f32..1.0, any::<bool>()), 1..80),
        count in 1usize..90,
    ) {
        let places: Vec<Vec3> = leaves.iter().map(|l| Vec3::from(l.0) + Vec3::Z * 3.0).collect();
        let light: Vec<f32> = leaves.iter().map(|l| if l.2 { l.1 } else { 0.0 }).collect();
        let lit = Lit::new(&places, &light);
        let marked = light.iter().filter(|l| **l > 0.0).count();
        for by in [Priority::ErrorRemoved, Priority::Transfer] {
            let mut expander = Expander::default();
            let chosen = expander.expand(&[lit.marked()], WantedNodes::exactly(count), by);
            prop_assert_eq!(chosen.len(), count.min(marked));
            let mut all: Vec<u32> = chosen.iter().flat_map(|c| below(&lit, c)).collect();
            all.sort_unstable();
            all.dedup();
            prop_assert_eq!(all.len(), marked);
            for c in chosen {
                let sum: f64 = below(&lit, c).iter().map(|&l| f64::from(lit.light[l as usize])).sum();
                prop_assert!((f64::from(c.light) - sum).abs() <= 1e-6 * sum);
                prop_assert!(below(&lit, c).contains(&c.centre));
                prop_assert!(c.extent_rad.is_finite() && (below(&lit, c).len() > 1 || c.extent_rad == 0.0));
            }
        }
    }
}

proptest! {
    /// Between least and most the number follows from what is left, and stays while that hardly changes.
    #[test]
    fn as_many_as_the_error_asks_for(count in 2usize..40, least in 1usize..6, more in 0usize..20, left_deg in 0.0f32..40.0) {
        let lit = Lit::new(&row(count, 1.5), &vec![1.0; count]);
        let wanted = WantedNodes { least, most: least + more, left_rad: left_deg.to_radians() };
        let mut expander = Expander::default();
        let chosen = expander.expand(&[lit.marked()], wanted, Priority::ErrorRemoved).len();
        prop_assert!(chosen <= wanted.most && chosen >= least.min(count));
        let left = expander.left_rad();
        prop_assert!(left <= wanted.left_rad || chosen == wanted.most.min(count));
        if chosen > least {
            let mut fewer = Expander::default();
            fewer.expand(&[lit.marked()], WantedNodes::exactly(chosen - 1), Priority::ErrorRemoved);
            prop_assert!(fewer.left_rad() > wanted.left_rad);
        }
        // Nearly the same light once more: the number stays.
        let dimmer: Vec<f32> = (0..count).map(|i| 1.0 + 0.01 * (i % 2) as f32).collect();
        let lit = Lit { light: dimmer, ..lit };
        prop_assert_eq!(expander.expand(&[lit.marked()], wanted, Priority::ErrorRemoved).len(), chosen);
    }
}
