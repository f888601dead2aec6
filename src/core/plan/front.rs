//! Accuracy against time, as measured: the settings that no others beat.

use crate::model::quality::Quality;

/// Settings with what they cost and what they give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontStep {
    /// The settings.
    pub quality: Quality,
    /// Relative RMSE in shadows against ray tracing, as measured.
    pub error: f32,
    /// Time of drawing a picture, milliseconds, as measured where the front was made.
    pub ms: f32,
}

/// Steps from the cheapest to the most accurate: each costs more than the one before and errs less.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Front {
    steps: Vec<FrontStep>,
}

impl Front {
    /// Those of `steps` that no other beats. Steps whose error or time is not a number above 0 are left out (an error
    /// of 0 is one that was not measured).
    pub fn of(steps: &[FrontStep]) -> Self {
        let real = |s: &&FrontStep| s.error.is_finite() && s.error > 0.0 && s.ms.is_finite() && s.ms > 0.0;
        let steps: Vec<FrontStep> = steps.iter().filter(real).copied().collect();
        let points: Vec<[f64; 2]> = steps.iter().map(|s| [f64::from(s.ms), f64::from(s.error)]).collect();
        Self { steps: undominated(&points).into_iter().map(|i| steps[i]).collect() }
    }

    /// From the cheapest to the most accurate.
    pub fn steps(&self) -> &[FrontStep] {
        &self.steps
    }

    /// The cheapest step that errs by at most this; where none does, the most accurate.
    pub fn cheapest_within(&self, max_error: f32) -> usize {
        let found = self.steps.iter().position(|s| s.error <= max_error);
        found.unwrap_or(self.steps.len().saturating_sub(1))
    }
}

/// Indices of the points (milliseconds, error) that no other beats in one without losing in the other, by rising
/// time. Of equal points the first is taken; points that are not finite are left out.
pub fn undominated(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| points[i].iter().all(|x| x.is_finite())).collect();
    order.sort_by(|&a, &b| {
        let ([ta, ea], [tb, eb]) = (points[a], points[b]);
        ta.total_cmp(&tb).then(ea.total_cmp(&eb)).then(a.cmp(&b))
    });
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i][1] < least;
        least = least.min(points[i][1]);
        better
    });
    order
}

/// How many of the front's points have a name.
pub const PRESETS: [&str; 4] = ["draft", "balanced", "fine", "reference"];

/// The points of a front (milliseconds, error; by rising time) that `PRESETS` name: its ends, and between them the
/// cheapest that take away a half and nine tenths of what lies between the errors of the ends. `None` where the front is empty. On a short front two
/// names may stand for one point.
pub fn presets(front: &[[f64; 2]]) -> Option<[usize; 4]> {
    let (first, last) = (front.first()?, front.last()?);
    let at = |share: f64| {
        let bound = first[1] + share * (last[1] - first[1]);
        // Rounding must not ask for more than the last point has.
        front.iter().position(|p| p[1] <= bound).unwrap_or(front.len() - 1)
    };
    Some([0, at(0.5), at(0.9), front.len() - 1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_others_beat_is_left_out() {
        let points = [
            [3.0, 0.5],
            [1.0, 0.9],
            [2.0, 0.9],
            [4.0, 0.5],
            [5.0, 0.1],
            [0.5, f64::NAN],
            [1.0, 0.9],
            [6.0, 0.2],
        ];
        assert_eq!(undominated(&points), [1, 0, 4]);
        assert_eq!(undominated(&[]), [0; 0]);
    }

    #[test]
    fn the_names_stand_in_order() {
        let front = [[1.0, 1.0], [2.0, 0.6], [3.0, 0.5], [4.0, 0.3], [8.0, 0.15], [20.0, 0.1], [40.0, 0.09]];
        // Half of the way from 1 to 0.09 is 0.545, nine tenths of it are 0.181.
        assert_eq!(presets(&front), Some([0, 2, 4, 6]));
        assert_eq!(presets(&front[..1]), Some([0; 4]));
        assert_eq!(presets(&[]), None);
    }

    #[test]
    fn an_error_asks_for_its_cheapest_step() {
        let step = |ms, error| FrontStep { quality: Quality::default(), error, ms };
        let front =
            Front::of(&[step(9.0, 0.05), step(1.0, 0.4), step(3.0, 0.1), step(5.0, 0.2), step(2.0, 0.0)]);
        let errors: Vec<f32> = front.steps().iter().map(|s| s.error).collect();
        assert_eq!(errors, [0.4, 0.1, 0.05]);
        let asked = [0.5, 0.4, 0.3, 0.05, 0.01].map(|e| front.cheapest_within(e));
        assert_eq!(asked, [0, 0, 1, 2, 2]);
        assert_eq!(Front::default().cheapest_within(0.1), 0);
    }

    proptest! {
        #[test]
        fn every_point_is_on_the_front_or_beaten(
            points in prop::collection::vec([0.1f64..10.0, 0.01f64..1.0], 1..40),
        ) {
            let front = undominated(&points);
            prop_assert!(!front.is_empty());
            for pair in front.windows(2) {
                let (a, b) = (points[pair[0]], points[pair[1]]);
                prop_assert!(a[0] < b[0] && a[1] > b[1]);
            }
            for (i, p) in points.iter().enumerate() {
                let beaten = front.iter().any(|&f| points[f][0] <= p[0] && points[f][1] <= p[1]);
                prop_assert!(beaten, "{i}");
            }
            let places: Vec<[f64; 2]> = front.iter().map(|&i| points[i]).collect();
            let named = presets(&places).unwrap();
            prop_assert!(named.is_sorted());
        }
    }
}
