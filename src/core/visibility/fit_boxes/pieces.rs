//! The connected pieces of a mesh: their surface, their flat sides, and the frame in which a piece lies straight.

use super::FittedBox;
use glam::Vec3;
use std::collections::HashMap;

/// Vertices nearer than this share of the mesh's extent are one.
const SAME_PLACE: f32 = 1e-5;
/// Cosine of the angle up to which normals are those of one side.
const SAME_NORMAL: f32 = 0.9995;
/// Sides of a piece that are told apart.
const MOST_SIDES: usize = 64;
/// Edges lie in a plane where at least so much of their length does.
const LYING: f32 = 0.1;
/// Edges that a piece may be turned to.
const MOST_EDGES: usize = 48;
/// Larger pieces are no plates.
const MOST_TRIANGLES: usize = 20_000;

/// Triangles that hang together.
pub struct Piece {
    /// Corners, in the units of the mesh.
    pub triangles: Vec<[Vec3; 3]>,
    /// Whether every edge has as many triangles on one side as on the other.
    is_closed: bool,
}

/// Parallel parts of a surface, whichever way they face.
pub struct PieceSide {
    /// Unit.
    pub normal: Vec3,
    /// Of all of them.
    pub area: f32,
}

/// Where a piece lies straight.
pub struct PieceFrame {
    /// Unit, right-handed; the last is straight to its largest side.
    pub axes: [Vec3; 3],
    /// Least coordinates along the axes.
    pub low: Vec3,
    /// Largest.
    pub high: Vec3,
}

impl PieceFrame {
    /// A point's coordinates.
    pub fn of(&self, point: Vec3) -> Vec3 {
        Vec3::from(self.axes.map(|axis| axis.dot(point)))
    }

    /// A box of this frame in the mesh's.
    pub fn placed(&self, centre: Vec3, half: Vec3) -> FittedBox {
        let [x, y, z] = self.axes;
        FittedBox { centre: x * centre.x + y * centre.y + z * centre.z, axes: self.axes, half }
    }
}

/// The pieces of a mesh, the one of the largest surface first.
pub fn pieces(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Piece> {
    let finite = || positions.iter().filter(|p| p.is_finite());
    let low = finite().fold(Vec3::INFINITY, |a, b| a.min(*b));
    let high = finite().fold(Vec3::NEG_INFINITY, |a, b| a.max(*b));
    let step = f64::from(SAME_PLACE * (high - low).max_element()).max(1e-30);
    let mut places: HashMap<[i64; 3], usize> = HashMap::new();
    let mut corners: Vec<[usize; 3]> = Vec::new();
    let mut kept: Vec<[Vec3; 3]> = Vec::new();
    for triangle in triangles {
        let corner = |i: &u32| positions.get(*i as usize).copied().filter(|p| p.is_finite());
        let [Some(a), Some(b), Some(c)] = triangle.each_ref().map(corner) else { continue };
        if !((b - a).cross(c - a).length_squared() > 0.0) {
            continue;
        }
        corners.push([a, b, c].map(|p| {
            let key = (p - low).as_dvec3().to_array().map(|v| (v / step).round() as i64);
            let next = places.len();
            *places.entry(key).or_insert(next)
        }));
        kept.push([a, b, c]);
    }
    let mut parents: Vec<usize> = (0..places.len()).collect();
    for [a, b, c] in &corners {
        for other in [b, c] {
            let (first, second) = (root(&mut parents, *a), root(&mut parents, *other));
            parents[first.max(second)] = first.min(second);
        }
    }
    let mut numbers: HashMap<usize, usize> = HashMap::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (t, [a, ..]) in corners.iter().enumerate() {
        let next = numbers.len();
        let number = *numbers.entry(root(&mut parents, *a)).or_insert(next);
        if number == groups.len() {
            groups.push(Vec::new());
        }
        groups[number].push(t);
    }
    let mut pieces: Vec<Piece> = (groups.iter())
        .filter(|group| group.len() <= MOST_TRIANGLES)
        .map(|group| Piece {
            triangles: group.iter().map(|&t| kept[t]).collect(),
            is_closed: is_closed(group.iter().map(|&t| corners[t])),
        })
        .collect();
    pieces.sort_by(|a, b| b.area().total_cmp(&a.area()));
    pieces
}

fn root(parents: &mut [usize], mut at: usize) -> usize {
    while parents[at] != at {
        parents[at] = parents[parents[at]];
        at = parents[at];
    }
    at
}

fn is_closed(triangles: impl Iterator<Item = [usize; 3]>) -> bool {
    let mut edges: HashMap<(usize, usize), i32> = HashMap::new();
    for [a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            if from != to {
                *edges.entry((from.min(to), from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
            }
        }
    }
    edges.values().all(|&sum| sum == 0)
}

impl Piece {
    /// Of its surface.
    pub fn area(&self) -> f32 {
        self.triangles.iter().map(|t| 0.5 * across(t).length()).sum()
    }

    /// What it encloses; of an open one, about.
    pub fn volume(&self) -> f32 {
        let Some([middle, ..]) = self.triangles.first() else { return 0.0 };
        let of = |t: &[Vec3; 3]| {
            let [a, b, c] = t.map(|p| (p - *middle).as_dvec3());
            a.dot(b.cross(c)) / 6.0
        };
        self.triangles.iter().map(of).sum::<f64>().abs() as f32
    }

    /// Whether it encloses anything.
    pub fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// Its parallel parts, the largest first.
    pub fn sides(&self) -> Vec<PieceSide> {
        let mut sides: Vec<PieceSide> = Vec::new();
        for triangle in &self.triangles {
            let normal = across(triangle);
            let area = 0.5 * normal.length();
            let normal = normal.normalize_or_zero();
            match sides.iter().position(|side| side.normal.dot(normal).abs() > SAME_NORMAL) {
                Some(side) => sides[side].area += area,
                None if sides.len() < MOST_SIDES => sides.push(PieceSide { normal, area }),
                None => {}
            }
        }
        sides.sort_by(|a, b| b.area.total_cmp(&a.area));
        sides
    }

    /// The frame about a normal in which the rectangle around it, along one of its longest edges, is least.
    pub fn frame(&self, normal: Vec3) -> PieceFrame {
        let edges = self.triangles.iter().flat_map(|[a, b, c]| [*b - *a, *c - *b, *a - *c]);
        // What is left of an edge along the normal is rounding.
        let lies = |(edge, within): &(Vec3, Vec3)| within.length() > LYING * edge.length();
        let within = |edge: Vec3| (edge, edge - normal * edge.dot(normal));
        let mut along: Vec<Vec3> = edges.map(within).filter(lies).map(|(_, within)| within).collect();
        along.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
        let mut tried: Vec<Vec3> = Vec::new();
        for edge in along {
            let Some(edge) = edge.try_normalize() else { continue };
            let edge = (edge - normal * edge.dot(normal)).normalize_or(normal.any_orthonormal_vector());
            if tried.len() < MOST_EDGES && tried.iter().all(|t| t.dot(edge).abs() < SAME_NORMAL) {
                tried.push(edge);
            }
        }
        tried.push(normal.any_orthonormal_vector());
        let frame = |x: Vec3| {
            let axes = [x, normal.cross(x), normal];
            let mut frame = PieceFrame { axes, low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
            for point in self.triangles.iter().flatten() {
                let at = frame.of(*point);
                (frame.low, frame.high) = (frame.low.min(at), frame.high.max(at));
            }
            frame
        };
        let size = |frame: &PieceFrame| (frame.high - frame.low).truncate().element_product();
        let first = frame(tried[0]);
        tried[1..].iter().map(|x| frame(*x)).fold(first, |best, next| {
            // Of equals the first.
            if size(&next) < 0.9999 * size(&best) { next } else { best }
        })
    }
}

/// Twice a triangle's area along its normal.
pub fn across([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (*b - *a).cross(*c - *a)
}
