//! Keeps frames within a time, or an error within a bound, by walking along the measured front.

use super::cost::CostModel;
use super::front::{Front, FrontStep};
use crate::model::time::Timestamp;

/// What the viewer asks for. Both: the cheapest step within the error that fits the time; where none does, the least
/// error within the time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Goal {
    /// A frame may take so long, milliseconds, above 0.
    pub budget_ms: Option<f32>,
    /// The error may be so large, relative RMSE in shadows.
    pub max_error: Option<f32>,
}

/// What the governor has chosen, for the picture's overlay and for reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Its place on the front, from the cheapest.
    pub step: usize,
    /// Steps of the front.
    pub of: usize,
    /// The error to expect, as measured where the front was made.
    pub expected_error: f32,
    /// What a frame should take, milliseconds.
    pub expected_ms: f32,
    /// What the last frame took, milliseconds.
    pub measured_ms: f32,
    /// Changes so far.
    pub changes: u32,
}

/// Frames over the budget, among the newest 32, that ask for a cheaper step: more than a twentieth of them.
const LATE: usize = 3;

/// A step is taken where it should need at most this share of the budget: frames differ.
const FILL_DOWN: f32 = 0.88;

/// A more accurate step is taken where it should need at most this share: so that it is not left again at once.
const FILL_UP: f32 = 0.78;

/// A more accurate step must take away this share of the error.
const WORTH: f32 = 0.03;

/// Between a change and the next one towards more accuracy, seconds; doubled, up to the second number, by every
/// change that had to be taken back.
const WAIT_S: [f64; 2] = [1.0, 32.0];

/// A change towards accuracy has failed where it is taken back within this time, seconds.
const FAILED_WITHIN_S: f64 = 3.0;

/// Chooses a step of the front for every frame. The same times of frames give the same steps.
#[derive(Clone, Debug)]
pub struct Governor {
    front: Front,
    goal: Goal,
    cost: CostModel,
    step: usize,
    /// A bit for each of the newest 32 frames at this step that was over the budget, the newest lowest.
    late: u32,
    fresh: bool,
    changed: Option<Timestamp>,
    went_up: Option<Timestamp>,
    wait_s: f64,
    changes: u32,
    measured_ms: f32,
}

impl Governor {
    /// For a front and a goal; starts with the step that fits the goal if this machine is the one that the front was
    /// made on. `None` where the front is empty.
    pub fn new(front: Front, goal: Goal) -> Option<Self> {
        if front.steps().is_empty() {
            return None;
        }
        let times: Vec<f32> = front.steps().iter().map(|s| s.ms).collect();
        let mut governor = Self {
            cost: CostModel::new(&times),
            front,
            goal,
            step: 0,
            late: 0,
            fresh: true,
            changed: None,
            went_up: None,
            wait_s: WAIT_S[0],
            changes: 0,
            measured_ms: 0.0,
        };
        governor.step = governor.best(FILL_DOWN);
        Some(governor)
    }

    /// The settings for the next frame.
    pub fn step(&self) -> &FrontStep {
        &self.front.steps()[self.step]
    }

    /// What was chosen.
    pub fn choice(&self) -> Choice {
        Choice {
            step: self.step,
            of: self.front.steps().len(),
            expected_error: self.step().error,
            expected_ms: self.cost.frame_ms(self.step),
            measured_ms: self.measured_ms,
            changes: self.changes,
        }
    }

    /// A frame that ended at `t` took so long to draw and so long otherwise, milliseconds. Whether the step changes
    /// with the next frame.
    pub fn frame(&mut self, t: Timestamp, drawing_ms: f32, other_ms: f32) -> bool {
        self.cost.see(drawing_ms, other_ms);
        self.measured_ms = drawing_ms + other_ms;
        let Some(budget_ms) = self.goal.budget_ms else { return false };
        self.late = self.late << 1 | u32::from(self.measured_ms > budget_ms);
        if self.late.count_ones() as usize >= LATE {
            // All at once: another load. Now and then: a step that is at the edge.
            let frames = if self.late & 0b111 == 0b111 { LATE } else { 3 * LATE };
            self.cost.believe(self.step, frames, self.fresh);
            self.fresh = false;
            self.late = 0;
            // Late is late, whatever the model says.
            let to = self.best(FILL_DOWN).min(self.step.saturating_sub(1));
            return self.change(t, to);
        }
        let since_s = self.changed.map_or(f64::INFINITY, |at| t.seconds_since(at));
        // At the start there is no change yet to wait for, but frames must have been seen.
        if self.cost.seen() < 2 * LATE || since_s < self.wait_s {
            return false;
        }
        self.cost.believe(self.step, 2 * LATE, self.fresh);
        self.fresh = false;
        let to = self.best(FILL_UP);
        let worth = self.front.steps()[to].error < (1.0 - WORTH) * self.step().error;
        if to > self.step && worth {
            return self.change(t, to);
        }
        false
    }

    /// The step for the goal, as far as the model knows.
    fn best(&self, fill: f32) -> usize {
        let enough = self.goal.max_error.map(|e| self.front.cheapest_within(e));
        let Some(budget_ms) = self.goal.budget_ms else {
            return enough.unwrap_or(self.front.steps().len() - 1);
        };
        let fits = (0..self.front.steps().len()).rev().find(|&i| self.cost.frame_ms(i) <= fill * budget_ms);
        let fits = fits.unwrap_or(0);
        enough.map_or(fits, |enough| fits.min(enough))
    }

    fn change(&mut self, t: Timestamp, to: usize) -> bool {
        if to == self.step {
            return false;
        }
        let failed = |up: Timestamp| t.seconds_since(up) < FAILED_WITHIN_S;
        if to > self.step {
            // The last one was good, or it would have been taken back.
            if self.went_up.is_some() {
                self.wait_s = (self.wait_s / 2.0).max(WAIT_S[0]);
            }
            self.went_up = Some(t);
        } else if self.went_up.take().is_some_and(failed) {
            self.wait_s = (self.wait_s * 2.0).min(WAIT_S[1]);
        }
        self.step = to;
        self.changed = Some(t);
        self.changes += 1;
        self.fresh = true;
        self.late = 0;
        self.cost.forget();
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dice::Dice;
    use crate::model::quality::Quality;
    use proptest::prelude::*;

    fn front() -> Front {
        let steps: Vec<FrontStep> =
            [(1.0, 0.5), (2.0, 0.3), (4.0, 0.2), (8.0, 0.12), (16.0, 0.08), (32.0, 0.06)]
                .iter()
                .map(|&(ms, error)| FrontStep { quality: Quality::default(), error, ms })
                .collect();
        Front::of(&steps)
    }

    /// A machine with a load that changes: frames a second, what else a frame takes, noise, and how far a step's cost is
    /// off the front's (by its index).
    struct Machine {
        governor: Governor,
        t_s: f64,
        dice: Dice,
    }

    impl Machine {
        fn new(goal: Goal, seed: u64) -> Self {
            Self { governor: Governor::new(front(), goal).unwrap(), t_s: 0.0, dice: Dice::new(seed) }
        }

        /// -1 to 1.
        fn throw(&mut self) -> f32 {
            2.0 * self.dice.unit_f32() - 1.0
        }

        /// One frame: its time, and whether the step changed after it.
        fn frame(&mut self, load: f32, other_ms: f32, noise: f32, off: &dyn Fn(usize) -> f32) -> (f32, bool) {
            let own = off(self.governor.step);
            let drawing = self.governor.step().ms * load * own * (1.0 + noise * self.throw());
            self.t_s += 1.0 / 30.0;
            let t = Timestamp::from_seconds(self.t_s);
            (drawing + other_ms, self.governor.frame(t, drawing, other_ms))
        }
    }

    #[test]
    fn stepped_load_stays_within_the_budget() {
        let goal = Goal { budget_ms: Some(33.3), max_error: None };
        for seed in 1..20u64 {
            let mut machine = Machine::new(goal, seed);
            // Steps cost up to 40 % more or less here than where the front was made.
            let off = move |i: usize| 1.0 + 0.4 * ((i as f32 * 2.4 + seed as f32).sin());
            let (mut within, mut counted) = (0, 0);
            let mut steps = Vec::new();
            for &load in &[1.0, 3.0, 0.5, 6.0, 1.5, 0.25] {
                let mut changes = Vec::new();
                for frame in 0..300 {
                    let (ms, changed) = machine.frame(load, 6.0, 0.08, &off);
                    if frame >= 10 {
                        counted += 1;
                        within += i32::from(ms <= 33.3);
                    }
                    // The first two seconds after a step are no steady state.
                    if changed && frame >= 60 {
                        changes.push(frame);
                    }
                }
                steps.push(machine.governor.step);
                let close = changes.windows(2).filter(|w| w[1] - w[0] < 30).count();
                assert_eq!(close, 0, "seed {seed}, load {load}: changes at {changes:?}");
            }
            assert!(f64::from(within) >= 0.95 * f64::from(counted), "seed {seed}: {within} of {counted}");
            // Where there is time it is used: the light load gets a better step than the heavy one.
            assert!(steps[5] > steps[3] && steps[2] > steps[1], "{steps:?}");
        }
    }

    #[test]
    fn a_steady_machine_is_left_alone() {
        let mut machine = Machine::new(Goal { budget_ms: Some(18.0), max_error: None }, 7);
        let mut late_changes = 0;
        for frame in 0..900 {
            let (_, changed) = machine.frame(1.0, 3.0, 0.05, &|_| 1.0);
            late_changes += u32::from(changed && frame > 150);
        }
        assert_eq!(late_changes, 0);
        // 8 + 3 ms fits 18, 16 + 3 does not.
        assert_eq!(machine.governor.step, 3);
    }

    #[test]
    fn an_error_alone_takes_the_cheapest_step_and_stays() {
        let mut machine = Machine::new(Goal { budget_ms: None, max_error: Some(0.15) }, 3);
        for _ in 0..100 {
            assert!(!machine.frame(9.0, 3.0, 0.5, &|_| 1.0).1);
        }
        assert_eq!(machine.governor.choice().expected_error, 0.12);
        // Both: time is kept, and no more accuracy is bought than was asked for.
        let goal = Goal { budget_ms: Some(30.0), max_error: Some(0.25) };
        let mut machine = Machine::new(goal, 3);
        for _ in 0..200 {
            machine.frame(1.0, 1.0, 0.05, &|_| 1.0);
        }
        assert_eq!(machine.governor.choice().expected_error, 0.2);
        for _ in 0..200 {
            machine.frame(10.0, 1.0, 0.05, &|_| 1.0);
        }
        assert_eq!(machine.governor.choice().expected_error, 0.3);
    }

    #[test]
    fn a_load_that_nothing_fits_ends_at_the_cheapest() {
        let mut machine = Machine::new(Goal { budget_ms: Some(5.0), max_error: None }, 5);
        for _ in 0..60 {
            machine.frame(100.0, 10.0, 0.1, &|_| 1.0);
        }
        assert_eq!(machine.governor.step, 0);
        assert!(Governor::new(Front::default(), Goal::default()).is_none());
    }

    proptest! {
        #[test]
        fn any_times_leave_it_on_the_front(
            times in prop::collection::vec((any::<f32>(), any::<f32>()), 1..200),
            budget_ms in 0.1f32..100.0,
        ) {
            let mut governor =
                Governor::new(front(), Goal { budget_ms: Some(budget_ms), max_error: None }).unwrap();
            for (i, (drawing, other)) in times.into_iter().enumerate() {
                governor.frame(Timestamp(i as i64 * 33_000_000), drawing, other);
                prop_assert!(governor.step < 6);
            }
        }
    }
}
