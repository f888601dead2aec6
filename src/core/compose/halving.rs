//! Cuts triangles until no edge is too long, without gaps.

use glam::Vec3;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// A vertex that can be halved with another.
pub trait Halve: Copy {
    /// Where it is, metres.
    fn position(&self) -> Vec3;
    /// The one in the middle.
    fn between(&self, other: &Self) -> Self;
}

/// Working memory of cutting, kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Halving {
    middles: HashMap<u64, u32, BuildHasherDefault<EdgeHasher>>,
    open: Vec<[u32; 3]>,
}

impl Halving {
    /// Halves every edge that is longer than `limit_m` of its two ends, the longest of a triangle (in shares of its limit)
    /// first, and leaves out triangles that `may_see` does not want. Whether an edge is cut, and where, depends on the edge
    /// alone, so that neighbours stay without gaps. Pieces keep the order of their triangles, and their tags; new vertices
    /// come after the old ones. At `most` triangles cutting ends.
    pub fn cut<V: Halve, T: Copy>(
        &mut self,
        vertices: &mut Vec<V>,
        triangles: impl Iterator<Item = ([u32; 3], T)>,
        limit_m: impl Fn(Vec3, Vec3) -> f32,
        may_see: impl Fn([Vec3; 3]) -> bool,
        most: usize,
        out: &mut Vec<([u32; 3], T)>,
    ) {
        let Self { middles, open } = self;
        middles.clear();
        open.clear();
        out.clear();
        for (corners, tag) in triangles {
            open.push(corners);
            while let Some(corners) = open.pop() {
                if !may_see(corners.map(|i| vertices[i as usize].position())) {
                    continue;
                }
                let ends = |k: usize| (corners[k], corners[(k + 1) % 3]);
                // How many times too long an edge is.
                let excess = [0, 1, 2].map(|k| {
                    let (a, b) = ends(k);
                    let of = |i: u32| vertices[i as usize].position();
                    let (a, b) = (of(a.min(b)), of(a.max(b)));
                    a.distance(b) / limit_m(a, b)
                });
                let longest = (0..3).fold(0, |best, k| if excess[k] > excess[best] { k } else { best });
                if excess[longest] <= 1.0 || out.len() + open.len() >= most {
                    out.push((corners, tag));
                    continue;
                }
                let (a, b) = ends(longest);
                let apex = corners[(longest + 2) % 3];
                let edge = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
                let middle = *middles.entry(edge).or_insert_with(|| {
                    let between = vertices[a.min(b) as usize].between(&vertices[a.max(b) as usize]);
                    vertices.push(between);
                    vertices.len() as u32 - 1
                });
                open.push([middle, b, apex]);
                open.push([a, middle, apex]);
            }
        }
    }
}

/// Spreads the two indices of an edge; cutting is done for every frame of a moving camera.
#[derive(Clone, Debug, Default)]
struct EdgeHasher(u64);

impl Hasher for EdgeHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u64(u64::from(byte));
        }
    }

    fn write_u64(&mut self, edge: u64) {
        // The golden ratio's digits; the upper half holds the best mixed bits, the map looks at both.
        let mixed = (self.0 ^ edge).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ mixed >> 32;
    }
}

/// How near the segment from a to b comes to a point.
pub fn distance_to_segment(p: Vec3, a: Vec3, b: Vec3) -> f32 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    p.distance(a + t * along)
}
