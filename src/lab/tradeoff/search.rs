//! The joint front: settings that no others beat in both error and time, found step by step.

use super::axes::{AXES, AccuracyAxis, TriedPoint};
use crate::plan::front::undominated;

/// A point may cost so much more, or err so much more, than the front and still be looked around: times are noisy.
const NEAR: f64 = 1.08;

/// All points that were measured, and which of them have been looked around.
#[derive(Default)]
pub struct FrontSearch {
    points: Vec<(TriedPoint, [f64; 2])>,
    expanded: Vec<bool>,
}

impl FrontSearch {
    /// Whether a point was measured.
    pub fn knows(&self, point: &TriedPoint) -> bool {
        self.points.iter().any(|(p, _)| p == point)
    }

    /// A point was measured: milliseconds and error.
    pub fn add(&mut self, point: TriedPoint, place: [f64; 2]) {
        if !self.knows(&point) {
            self.points.push((point, place));
            self.expanded.push(false);
        }
    }

    /// The neighbours, one notch along each axis, of the point of the front that stands in its widest gap and was not looked
    /// around yet; empty where all were.
    pub fn next(&mut self, called_for: &dyn Fn(&AccuracyAxis) -> bool) -> Vec<TriedPoint> {
        loop {
            let Some(at) = self.widest_gap() else { return Vec::new() };
            self.expanded[at] = true;
            let around = neighbours(&self.points[at].0, called_for);
            let fresh: Vec<TriedPoint> = around.into_iter().filter(|p| !self.knows(p)).collect();
            if !fresh.is_empty() {
                return fresh;
            }
        }
    }

    fn widest_gap(&self) -> Option<usize> {
        let front = self.front();
        let log = |i: usize| self.points[i].1.map(|x| x.max(1e-9).ln());
        let gap = |k: usize| {
            let here = log(front[k]);
            let to = |other: Option<&usize>| {
                other.map_or(0.5, |&o| {
                    let there = log(o);
                    (here[0] - there[0]).abs() + (here[1] - there[1]).abs()
                })
            };
            to(k.checked_sub(1).and_then(|k| front.get(k))) + to(front.get(k + 1))
        };
        let open = (0..front.len()).filter(|&k| !self.expanded[front[k]]);
        let best = open.max_by(|&a, &b| gap(a).total_cmp(&gap(b)));
        best.map(|k| front[k])
    }

    /// Indices of the front by rising time.
    fn front(&self) -> Vec<usize> {
        let places: Vec<[f64; 2]> = self.points.iter().map(|(_, place)| *place).collect();
        undominated(&places)
    }

    /// Points that are on the front, or so near that another measurement might put them there.
    pub fn near_front(&self) -> Vec<TriedPoint> {
        let beaten = |place: &[f64; 2]| {
            self.points.iter().any(|(_, p)| p[0] * NEAR < place[0] && p[1] * NEAR < place[1])
                || self.points.iter().any(|(_, p)| p[0] * NEAR * NEAR < place[0] && p[1] <= place[1])
        };
        self.points.iter().filter(|(_, place)| !beaten(place)).map(|(p, _)| p.clone()).collect()
    }
}

/// One notch along each axis that the front is searched along.
fn neighbours(point: &TriedPoint, called_for: &dyn Fn(&AccuracyAxis) -> bool) -> Vec<TriedPoint> {
    let mut out = Vec::new();
    for axis in AXES.iter().filter(|a| a.joint && called_for(a)) {
        let values = axis.values(false);
        let at = values.iter().position(|v| Some(v) == point.value(axis).as_ref()).unwrap_or(0);
        for to in [at.checked_sub(1), Some(at + 1)].into_iter().flatten() {
            if let Some(value) = values.get(to) {
                out.push(point.with(axis, value.clone()));
            }
        }
    }
    out
}

/// The ends to start from: everything cheap, and everything accurate.
pub fn corners(called_for: &dyn Fn(&AccuracyAxis) -> bool) -> [TriedPoint; 2] {
    let mut ends = [TriedPoint::default(), TriedPoint::default()];
    for axis in AXES.iter().filter(|a| a.joint && called_for(a)) {
        let values = axis.values(false);
        if let [first, .., last] = values.as_slice() {
            ends[0] = ends[0].with(axis, first.clone());
            ends[1] = ends[1].with(axis, last.clone());
        }
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A world where time is a sum over the axes and error falls along each: the front is found without trying all.
    fn world(point: &TriedPoint) -> [f64; 2] {
        let (mut ms, mut error) = (1.0, 0.02);
        for axis in AXES.iter().filter(|a| a.joint) {
            let values = axis.values(false);
            let at = values.iter().position(|v| Some(v) == point.value(axis).as_ref()).unwrap_or(0) as f64;
            ms += 0.3 * 1.7f64.powf(at);
            error += 0.2 * 0.5f64.powf(at);
        }
        [ms, error]
    }

    #[test]
    fn the_search_walks_the_front_from_end_to_end() {
        let all = |_: &AccuracyAxis| true;
        let mut search = FrontSearch::default();
        for start in corners(&all).into_iter().chain([TriedPoint::default()]) {
            let place = world(&start);
            search.add(start, place);
        }
        let mut tried = 0;
        while tried < 400 {
            let next = search.next(&all);
            if next.is_empty() {
                break;
            }
            for point in next {
                let place = world(&point);
                search.add(point, place);
                tried += 1;
            }
        }
        let front = search.front();
        assert!(front.len() > 20, "{}", front.len());
        // The ends are the world's own.
        let ends = [front[0], front[front.len() - 1]].map(|i| search.points[i].0.clone());
        assert_eq!(ends, corners(&all));
        let near = search.near_front();
        assert!(front.iter().all(|&i| near.contains(&search.points[i].0)));
        // 254 of 408 were measured: in this world there are no bad settings.
        assert!(near.len() < search.points.len() * 2 / 3, "{} of {}", near.len(), search.points.len());
    }
}
