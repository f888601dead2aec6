//! Simple stand-ins for virtual objects where their shadows are coarse (Section 7.2 of [Gib03]): the same vertices, fewer
//! triangles, so that what moves and bends takes its stand-in along.

use glam::Vec3;
use meshopt::SimplifyOptions;
use std::ops::Range;

/// Triangles of a stand-in at most, where the shape allows it.
pub const MOST_TRIANGLES: usize = 500;
/// A stand-in leaves its object's surface by no more than this share of the object's size.
const MOST_ERROR: f32 = 0.02;

/// Vertices nearer to each other than this share of the way that they are moved are at one place.
const SAME_PLACE: f32 = 1e-3;

/// Stand-ins of all objects of a scene.
#[derive(Clone, Debug, Default)]
pub struct Proxies {
    /// Vertices of the scene's objects that are used, in order.
    used: Vec<u32>,
    /// Indices into `used`.
    triangles: Vec<[u32; 3]>,
    /// Of each object, within `used`.
    ranges: Vec<Range<usize>>,
    /// How far each of `used` is moved out of its stand-in, metres; where it begins and ends in `around`.
    out: Vec<(f32, [u32; 2])>,
    /// The triangles around each of those that are moved.
    around: Vec<u32>,
    /// The largest distance from an object's surface, as a share of its size.
    error: f32,
}

impl Proxies {
    /// Simplifies every object: `positions` are those of all of them, `triangles` theirs, `objects` which of the triangles each
    /// has. An object of at most `most` triangles is kept as it is; others lose triangles down to `most` while their
    /// surface stays within 2 % of their size, and are widened until they enclose as much as the object did: corners on a
    /// rounded surface alone would throw a shadow too small, by 1.4 % of its light for a rabbit of 500 triangles. Triangles with an index that there is not are left out.
    pub fn build(
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        objects: impl Iterator<Item = Range<usize>>,
        most: usize,
    ) -> Self {
        let places: Vec<[f32; 3]> =
            positions.iter().map(|p| if p.is_finite() { p.to_array() } else { [0.0; 3] }).collect();
        let mut proxies = Self::default();
        for object in objects {
            let sound = |t: &&[u32; 3]| t.iter().all(|&i| (i as usize) < positions.len());
            let own: Vec<u32> =
                triangles.get(object).unwrap_or(&[]).iter().filter(sound).flatten().copied().collect();
            let mut lost_m = 0.0;
            let kept = if own.len() > 3 * most {
                let mut error = 0.0;
                let options = SimplifyOptions::None;
                let target = 3 * most;
                let kept =
                    meshopt::simplify_decoder(&own, &places, target, MOST_ERROR, options, Some(&mut error));
                // Of crumbs nothing would be left.
                if kept.is_empty() {
                    own
                } else {
                    proxies.error = proxies.error.max(error);
                    lost_m = lost(positions, &own, &kept);
                    kept
                }
            } else {
                own
            };
            proxies.add(positions, &kept, lost_m);
        }
        proxies
    }

    /// Vertices of one place are moved together, by all that meets there: the slivers between them alone may look inwards.
    fn add(&mut self, positions: &[Vec3], indices: &[u32], out_m: f32) {
        let first = self.used.len();
        let mut sorted = indices.to_vec();
        sorted.sort_unstable();
        sorted.dedup();
        let place = |i: &u32| (first + sorted.binary_search(i).unwrap_or(0)) as u32;
        let begin = self.triangles.len() as u32;
        self.triangles.extend(indices.as_chunks::<3>().0.iter().map(|t| t.each_ref().map(place)));
        let at = |i: u32| positions.get(i as usize).copied().unwrap_or(Vec3::NAN);
        for &vertex in &sorted {
            let from = self.around.len() as u32;
            if out_m > 0.0 {
                let own = (begin..).zip(indices.as_chunks::<3>().0);
                let meets = |i: &u32| *i == vertex || at(*i).distance(at(vertex)) < SAME_PLACE * out_m;
                self.around.extend(own.filter(|(_, t)| t.iter().any(meets)).map(|(k, _)| k));
            }
            self.out.push((out_m, [from, self.around.len() as u32]));
        }
        self.used.extend(sorted);
        self.ranges.push(first..self.used.len());
    }

    /// Where the vertices are now, from those of all objects.
    pub fn gather(&self, positions: &[Vec3], out: &mut Vec<Vec3>) {
        let at = |i: u32| positions.get(i as usize).copied().unwrap_or(Vec3::NAN);
        out.clear();
        out.extend(self.used.iter().zip(&self.out).map(|(&i, (out_m, [begin, end]))| {
            // By area: the mean normal of the triangles around it.
            let normal: Vec3 = (self.around.get(*begin as usize..*end as usize).unwrap_or(&[]).iter())
                .filter_map(|&t| self.triangles.get(t as usize))
                .map(|t| t.map(|corner| self.used.get(corner as usize).map_or(Vec3::NAN, |&i| at(i))))
                .map(|[a, b, c]| (b - a).cross(c - a))
                .sum();
            at(i) + normal.normalize_or_zero() * *out_m
        }));
    }

    /// Indices into what [`Proxies::gather`] gives.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The vertices of each object, within what [`Proxies::gather`] gives.
    pub fn objects(&self) -> &[Range<usize>] {
        &self.ranges
    }

    /// The largest distance of a stand-in from its object's surface, as a share of the object's size.
    pub fn error(&self) -> f32 {
        self.error
    }
}

/// How far the surface of a stand-in lies within the object's in the mean, metres: the volume lost over its area. 0 where it
/// has none, and at most what simplification may do.
fn lost(positions: &[Vec3], own: &[u32], kept: &[u32]) -> f32 {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for &i in own {
        (low, high) = (low.min(positions[i as usize]), high.max(positions[i as usize]));
    }
    let middle = 0.5 * (low + high);
    let volume_area = |indices: &[u32]| {
        let corners = indices.as_chunks::<3>().0.iter().map(|t| t.map(|i| positions[i as usize] - middle));
        corners.fold((0.0f64, 0.0f64), |(volume, area), [a, b, c]| {
            let volume = volume + f64::from(a.dot(b.cross(c))) / 6.0;
            (volume, area + 0.5 * f64::from((b - a).cross(c - a).length()))
        })
    };
    let (whole, _) = volume_area(own);
    let (rest, area) = volume_area(kept);
    let lost_m = ((whole - rest) / area) as f32;
    // Triangles that look inwards enclose less than nothing.
    if lost_m > 0.0 && whole > 0.0 { lost_m.min(MOST_ERROR * (high - low).max_element()) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sphere of rings and segments about the origin, `radius` wide, its vertices from `first` on.
    fn sphere(first: u32, radius: f32, positions: &mut Vec<Vec3>, triangles: &mut Vec<[u32; 3]>) {
        let (rings, segments) = (24u32, 48u32);
        for i in 0..=rings {
            for k in 0..segments {
                let (a, b) = (
                    std::f32::consts::PI * i as f32 / rings as f32,
                    std::f32::consts::TAU * k as f32 / segments as f32,
                );
                positions.push(radius * Vec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()));
            }
        }
        for i in 0..rings {
            for k in 0..segments {
                let at = |i: u32, k: u32| first + i * segments + k % segments;
                triangles.push([at(i, k), at(i + 1, k), at(i + 1, k + 1)]);
                triangles.push([at(i, k), at(i + 1, k + 1), at(i, k + 1)]);
            }
        }
    }

    #[test]
    fn few_triangles_near_the_surface_that_move_with_the_object() {
        let (mut positions, mut triangles) = (vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
        sphere(3, 0.5, &mut positions, &mut triangles);
        let count = triangles.len();
        let proxies = Proxies::build(&positions, &triangles, [0..1, 1..count].into_iter(), 300);
        assert_eq!(proxies.objects()[0], 0..3, "what is simple stays");
        assert!(proxies.triangles().len() <= 301 && proxies.triangles().len() > 100);
        assert!(proxies.error() <= 0.02, "{}", proxies.error());
        let mut out = Vec::new();
        proxies.gather(&positions, &mut out);
        // Widened as a whole: every vertex out of the sphere.
        let wide = |p: &Vec3| (0.501..0.512).contains(&p.length());
        assert!(out[3..].iter().all(wide), "{:?}", out[3..].iter().find(|p| !wide(p)));
        // To the sphere's volume, that of its own 2300 triangles.
        let volume = |at: &[Vec3], triangles: &[[u32; 3]]| -> f32 {
            triangles.iter().map(|t| t.map(|i| at[i as usize])).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
        };
        let both = [volume(&out, &proxies.triangles()[1..]), volume(&positions, &triangles[1..])];
        assert!((both[0] / both[1] - 1.0).abs() < 1e-3, "{both:?}");
        // Each flat piece is near the sphere: within 2 % of its size of 1.
        let middle = |t: &[u32; 3]| t.iter().map(|&i| out[i as usize]).sum::<Vec3>().length() / 3.0;
        let deepest = proxies.triangles()[1..].iter().map(middle).fold(1.0, f32::min);
        // The bound holds for quadrics' root mean square distances; long triangles go a little deeper.
        assert!((0.46..0.5).contains(&deepest), "{deepest}");
        let moved: Vec<Vec3> = positions.iter().map(|p| *p + Vec3::Z).collect();
        let before = out.clone();
        proxies.gather(&moved, &mut out);
        assert!(out.iter().zip(&before).all(|(now, then)| (*now - *then - Vec3::Z).length() < 1e-6));
    }

    #[test]
    fn what_is_wrong_is_left_out() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::NAN];
        let proxies = Proxies::build(&positions, &[[0, 1, 9], [0, 1, 2]], [0..1, 1..2, 5..9].into_iter(), 1);
        assert_eq!(proxies.triangles().len(), 1);
        assert_eq!(proxies.objects().len(), 3);
        let mut many = vec![[0u32, 1, 2]; 20];
        many.push([2, 1, 0]);
        Proxies::build(&positions, &many, std::iter::once(0..21), 4);
    }
}
