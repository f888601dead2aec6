//! Rods that are bent, closed or tapered, as chains of boxes along their axis.
//!
//! Distances along the surface from one end order a rod's surface (of a ring, from any place, both ways round). Sections at even
//! distances give the axis and how thick the rod is; the axis is halved where it bends or tapers most until the boxes are spent.

use super::{
    FittedBox,
    pieces::{Piece, across},
};
use glam::Vec3;
use std::{
    cmp::Reverse,
    collections::{BinaryHeap, HashMap},
};

/// How much longer than its radius a rod is at least. Shorter ones are covered by spheres as well: the ring of the pawn, 52 radii
/// long, takes 1.08 of what it should by 32 spheres and 1.13 by boxes, a knot 1.01 and 1.08.
const SLENDER: f32 = 80.0;
/// How much wider than its radius all of it is at least: what is wound up closely (a knot, 19 radii wide) is no thin thing.
const WIDE: f32 = 24.0;
/// Sections along a rod.
const SECTIONS: usize = 128;
/// A section's farthest point, over the radius of a disc of its area; more where it is cut askew, or where it is of two parts.
const WIDEST: f32 = 4.0;
/// Sections at either end, or where both ways round a ring meet: they may be cut by a cap, or askew.
const END: usize = 4;
/// What the sections add up to, over the volume.
const WHOLE: (f32, f32) = (0.8, 1.15);
/// Side of a box's section over the root of the rod's: 0.89 of a disc, 1 of a square, more of what is flat.
const SIDE: (f32, f32) = (0.75, 1.15);
/// Boxes are halved until the axis leaves them by less than this share of the rod's radius, or its radius varies by less.
const LEAST_OFF: f32 = 0.1;
/// Vertices nearer than this share of the extent are one.
const SAME_PLACE: f32 = 1e-5;

/// A section of a rod.
#[derive(Clone, Copy)]
struct RodSection {
    middle: Vec3,
    /// The root of its area straight to the axis.
    root: f32,
}

/// Boxes along a rod, `most` at most; `None` where the piece is none, or too thick.
pub fn of_rod(piece: &Piece, most: usize) -> Option<Vec<FittedBox>> {
    let (area, volume) = (piece.area(), piece.volume());
    let radius = 2.0 * volume / area;
    let is_slender = area / (2.0 * std::f32::consts::PI * radius) >= SLENDER * radius;
    if !(piece.is_closed() && most > 1 && is_slender && width(piece) >= WIDE * radius) {
        return None;
    }
    let surface = Surface::of(piece);
    let order = surface.order(area * area / (4.0 * std::f32::consts::PI * volume))?;
    let sections = surface.sections(&order)?;
    let axis = Axis::of(sections, &order, &surface)?;
    if !(WHOLE.0..WHOLE.1).contains(&(axis.volume() / volume)) {
        return None;
    }
    let parts = axis.parts(most);
    let plain = parts.iter().map(|part| 4.0 * part.root * part.length).sum::<f32>();
    // Together they have the rod's surface: a convex body's silhouette is a quarter of its surface in the mean.
    let side = area / plain;
    if !(SIDE.0..SIDE.1).contains(&side) {
        return None;
    }
    Some(parts.iter().map(|part| part.boxed(side)).collect())
}

/// Twice the way from the middle of the corners to the farthest one.
fn width(piece: &Piece) -> f32 {
    let corners = || piece.triangles.iter().flatten();
    let middle = corners().sum::<Vec3>() / (3 * piece.triangles.len()).max(1) as f32;
    2.0 * corners().map(|p| p.distance(middle)).fold(0.0, f32::max)
}

/// A rod's surface with its vertices welded.
struct Surface {
    points: Vec<Vec3>,
    triangles: Vec<[usize; 3]>,
    neighbours: Vec<Vec<usize>>,
}

/// Where the points of a surface lie along its rod.
struct Order {
    along: Vec<f32>,
    /// Length of what is ordered.
    length: f32,
    is_ring: bool,
    /// The point where it begins, and of a rod the one where it ends.
    ends: [usize; 2],
}

impl Surface {
    fn of(piece: &Piece) -> Self {
        let corners = || piece.triangles.iter().flatten();
        let low = corners().fold(Vec3::INFINITY, |a, b| a.min(*b));
        let high = corners().fold(Vec3::NEG_INFINITY, |a, b| a.max(*b));
        let step = f64::from(SAME_PLACE * (high - low).max_element()).max(1e-30);
        let mut places: HashMap<[i64; 3], usize> = HashMap::new();
        let mut points = Vec::new();
        let mut triangles = Vec::new();
        for triangle in &piece.triangles {
            triangles.push(triangle.map(|p| {
                let key = (p - low).as_dvec3().to_array().map(|v| (v / step).round() as i64);
                *places.entry(key).or_insert_with(|| {
                    points.push(p);
                    points.len() - 1
                })
            }));
        }
        let mut neighbours = vec![Vec::new(); points.len()];
        for [a, b, c] in &triangles {
            for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
                neighbours[from].push(to);
                neighbours[to].push(from);
            }
        }
        Self { points, triangles, neighbours }
    }

    /// Distances along edges from a point.
    fn distances(&self, from: usize) -> Vec<f32> {
        let mut found = vec![f32::INFINITY; self.points.len()];
        // Distances are not negative: their bits are in their order.
        let mut next = BinaryHeap::from([Reverse((0u32, from))]);
        found[from] = 0.0;
        while let Some(Reverse((bits, at))) = next.pop() {
            let here = f32::from_bits(bits);
            if here > found[at] {
                continue;
            }
            for &to in &self.neighbours[at] {
                let there = here + self.points[at].distance(self.points[to]);
                if there < found[to] {
                    found[to] = there;
                    next.push(Reverse((there.to_bits(), to)));
                }
            }
        }
        found
    }

    /// Orders the points along a rod that is about this long.
    fn order(&self, length: f32) -> Option<Order> {
        let farthest = |along: &[f32]| (0..along.len()).max_by(|a, b| along[*a].total_cmp(&along[*b]));
        let begin = farthest(&self.distances(0))?;
        let along = self.distances(begin);
        let end = farthest(&along)?;
        let reach = along[end];
        if !reach.is_finite() {
            return None;
        }
        if reach > 0.75 * length {
            return Some(Order { along, length: reach, is_ring: false, ends: [begin, end] });
        }
        // A ring: what is near to a place half way is on one arm, the rest on the other.
        let half = (0..along.len())
            .min_by(|a, b| (along[*a] - 0.5 * reach).abs().total_cmp(&(along[*b] - 0.5 * reach).abs()))?;
        let from_half = self.distances(half);
        let far = from_half.iter().fold(0.0f32, |m, d| m.max(*d));
        let ordered = along.iter().zip(&from_half);
        let along = ordered.map(|(d, h)| if *h < 0.5 * far { *d } else { 2.0 * reach - d }).collect();
        Some(Order { along, length: 2.0 * reach, is_ring: true, ends: [begin, begin] })
    }

    /// Sections at even distances.
    fn sections(&self, order: &Order) -> Option<Vec<RodSection>> {
        let step = order.length / SECTIONS as f32;
        let mut outlines: Vec<Vec<[Vec3; 2]>> = vec![Vec::new(); SECTIONS];
        for triangle in &self.triangles {
            let mut along = triangle.map(|i| order.along[i]);
            let (mut low, mut high) = (
                along.iter().fold(f32::INFINITY, |m, d| m.min(*d)),
                along.iter().fold(0.0f32, |m, d| m.max(*d)),
            );
            if order.is_ring && high - low > 0.5 * order.length {
                // Across the place where the ring begins.
                along = along.map(|d| if d > 0.5 * order.length { d - order.length } else { d });
                low = along.iter().fold(f32::INFINITY, |m, d| m.min(*d));
                high = along.iter().fold(f32::NEG_INFINITY, |m, d| m.max(*d));
            }
            let corners = triangle.map(|i| self.points[i]);
            let normal = across(&corners);
            for k in (low / step - 0.5).ceil() as i64..=(high / step - 0.5).floor() as i64 {
                let level = (k as f32 + 0.5) * step;
                if let Some(ends) = cut(&corners, &along, level, normal)
                    && let Ok(index) = usize::try_from(k.rem_euclid(SECTIONS as i64))
                {
                    outlines[index].push(ends);
                }
            }
        }
        // Of a rod those at its ends are left out, of a ring those that are badly cut where both ways round it meet.
        let half = SECTIONS / 2;
        let is_end = |k: usize| k.min(SECTIONS - 1 - k) < END || order.is_ring && k.abs_diff(half) <= END;
        let kept = (0..SECTIONS).filter(|k| order.is_ring || !is_end(*k));
        let found: Vec<(usize, Outline)> =
            kept.map(|k| measured(&outlines[k]).map(|outline| (k, outline))).collect::<Option<_>>()?;
        let count = found.len();
        let mut sections = Vec::new();
        for (n, (k, outline)) in found.iter().enumerate() {
            let (before, after) = if order.is_ring {
                ((n + count - 1) % count, (n + 1) % count)
            } else {
                (n.saturating_sub(1), (n + 1).min(count - 1))
            };
            let direction = (found[after].1.middle - found[before].1.middle).try_normalize()?;
            let root = outline.area.dot(direction).abs().sqrt();
            if outline.farthest < WIDEST * root / std::f32::consts::PI.sqrt() {
                sections.push(RodSection { middle: outline.middle, root });
            } else if !is_end(*k) {
                return None;
            }
        }
        Some(sections)
    }
}

/// What is known of an outline.
struct Outline {
    middle: Vec3,
    /// As a vector, straight to it.
    area: Vec3,
    /// How far its farthest point lies from the middle.
    farthest: f32,
}

/// Where a triangle is cut at a level, in a fixed sense of turning.
fn cut(corners: &[Vec3; 3], along: &[f32; 3], level: f32, normal: Vec3) -> Option<[Vec3; 2]> {
    let mut ends = [Vec3::ZERO; 2];
    let mut count = 0;
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        if (along[a] < level) != (along[b] < level) && count < 2 {
            ends[count] = corners[a].lerp(corners[b], (level - along[a]) / (along[b] - along[a]));
            count += 1;
        }
    }
    if count < 2 {
        return None;
    }
    // Upwards along the rod, whose surface faces outwards.
    let mean = (0..3).map(|k| along[k]).sum::<f32>() / 3.0;
    let rise: Vec3 = (0..3).map(|k| (corners[k] - corners[0]) * (along[k] - mean)).sum();
    if normal.cross(ends[1] - ends[0]).dot(rise) < 0.0 {
        ends.swap(0, 1);
    }
    Some(ends)
}

fn measured(outline: &[[Vec3; 2]]) -> Option<Outline> {
    let length: f32 = outline.iter().map(|[a, b]| a.distance(*b)).sum();
    if !(length > 0.0) {
        return None;
    }
    let middle = outline.iter().map(|[a, b]| (*a + *b) * (0.5 * a.distance(*b))).sum::<Vec3>() / length;
    let area = outline.iter().map(|[a, b]| 0.5 * (*a - middle).cross(*b - middle)).sum();
    let farthest = outline.iter().flatten().map(|p| p.distance(middle)).fold(0.0, f32::max);
    Some(Outline { middle, area, farthest })
}

/// A rod's axis: its sections, of a ring the first once more at the end.
struct Axis {
    sections: Vec<RodSection>,
    /// Length up to each.
    up_to: Vec<f32>,
}

impl Axis {
    fn of(mut sections: Vec<RodSection>, order: &Order, surface: &Surface) -> Option<Self> {
        if order.is_ring {
            sections.push(*sections.first()?);
        } else {
            // Up to the ends themselves, as the sections next to them tell.
            let count = sections.len();
            if count < 4 {
                return None;
            }
            let (first, last) = (sections[0], sections[count - 1]);
            let tip = |section: RodSection, inner: RodSection, end: usize| {
                let out = (section.middle - inner.middle).normalize_or_zero();
                let far = (surface.points[end] - section.middle).dot(out).max(0.0);
                RodSection { middle: section.middle + out * far, ..section }
            };
            sections.insert(0, tip(first, sections[1], order.ends[0]));
            let inner = sections[sections.len() - 2];
            sections.push(tip(last, inner, order.ends[1]));
        }
        let mut up_to = vec![0.0];
        for ends in sections.windows(2) {
            up_to.push(up_to[up_to.len() - 1] + ends[0].middle.distance(ends[1].middle));
        }
        Some(Self { sections, up_to })
    }

    fn volume(&self) -> f32 {
        let steps = self.up_to.windows(2).zip(self.sections.windows(2));
        steps.map(|(at, ends)| (at[1] - at[0]) * 0.5 * (ends[0].root.powi(2) + ends[1].root.powi(2))).sum()
    }

    /// Parts, the one that is farthest off halved first.
    fn parts(&self, most: usize) -> Vec<Part> {
        let last = self.sections.len() - 1;
        let mut parts = vec![self.part(0, last)];
        while parts.len() < most {
            let Some(worst) = (0..parts.len())
                .filter(|k| parts[*k].off > LEAST_OFF && parts[*k].to - parts[*k].from > 1)
                .max_by(|a, b| parts[*a].off.total_cmp(&parts[*b].off))
            else {
                break;
            };
            let Part { from, to, .. } = parts[worst];
            let half = 0.5 * (self.up_to[from] + self.up_to[to]);
            let middle = self.up_to.partition_point(|l| *l < half).clamp(from + 1, to - 1);
            parts[worst] = self.part(from, middle);
            parts.insert(worst + 1, self.part(middle, to));
        }
        parts
    }

    fn part(&self, from: usize, to: usize) -> Part {
        let (mut middle, mut root) = (Vec3::ZERO, 0.0);
        let length = self.up_to[to] - self.up_to[from];
        for k in from..to {
            let weight = (self.up_to[k + 1] - self.up_to[k]) / length.max(f32::MIN_POSITIVE);
            middle += (self.sections[k].middle + self.sections[k + 1].middle) * (0.5 * weight);
            root += (self.sections[k].root + self.sections[k + 1].root) * (0.5 * weight);
        }
        let chord = self.sections[to].middle - self.sections[from].middle;
        let axis = chord.normalize_or(Vec3::X);
        let off = self.sections[from..=to].iter().map(|section| {
            let aside = section.middle - middle;
            let aside = (aside - axis * aside.dot(axis)).length();
            aside.max((section.root - root).abs()) / root.max(f32::MIN_POSITIVE)
        });
        let off = off.fold(0.0, f32::max);
        Part { from, to, middle, axis, length, root, off }
    }
}

/// A part of an axis, straight.
struct Part {
    from: usize,
    to: usize,
    middle: Vec3,
    axis: Vec3,
    length: f32,
    /// Mean root of the sections.
    root: f32,
    /// How far the axis leaves it, or how much the rod tapers, over `root`.
    off: f32,
}

impl Part {
    fn boxed(&self, side: f32) -> FittedBox {
        let across = self.axis.any_orthonormal_vector();
        let half = 0.5 * side * self.root;
        FittedBox {
            centre: self.middle,
            axes: [self.axis, across, self.axis.cross(across)],
            half: Vec3::new(0.5 * self.length, half, half),
        }
    }
}
