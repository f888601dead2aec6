//! What a step of the front will cost here and now: what was measured where it was made, corrected by what frames
//! take.

/// Times of the newest frames kept for a median.
const KEPT: usize = 9;

/// The share of a surprise that is taken for the load of the machine; the rest belongs to the step alone.
const SHARED: f32 = 0.85;

/// How much of a step's own surprise is believed at once.
const OWN: f32 = 0.5;

/// The time of a frame as a function of the step: `other + scale x own x measured`, where `other` is what does not
/// depend on the step (tracking, merging), `scale` the machine and its load, `own` what this scene makes of this step.
#[derive(Clone, Debug)]
pub struct CostModel {
    /// As the front has them, milliseconds.
    measured_ms: Vec<f32>,
    /// Natural logarithm, for each step.
    own: Vec<f32>,
    /// Natural logarithm.
    scale: f32,
    other_ms: f32,
    newest_drawing_ms: Newest,
    newest_other_ms: Newest,
    started: bool,
}

/// The newest numbers, and their median.
#[derive(Clone, Copy, Debug, Default)]
struct Newest {
    numbers: [f32; KEPT],
    count: usize,
    next: usize,
}

impl Newest {
    fn push(&mut self, number: f32) {
        self.numbers[self.next] = number;
        self.next = (self.next + 1) % KEPT;
        self.count = (self.count + 1).min(KEPT);
    }

    /// The median of the newest `n`.
    fn median(&self, n: usize) -> Option<f32> {
        let n = n.min(self.count);
        if n == 0 {
            return None;
        }
        let mut sorted = [0.0; KEPT];
        for (k, slot) in sorted[..n].iter_mut().enumerate() {
            *slot = self.numbers[(self.next + KEPT - 1 - k) % KEPT];
        }
        sorted[..n].sort_by(f32::total_cmp);
        Some(sorted[n / 2])
    }
}

impl CostModel {
    /// For steps that took these times where the front was made, each above 0 ms.
    pub fn new(measured_ms: &[f32]) -> Self {
        Self {
            measured_ms: measured_ms.iter().map(|ms| ms.max(1e-3)).collect(),
            own: vec![0.0; measured_ms.len()],
            scale: 0.0,
            other_ms: 0.0,
            newest_drawing_ms: Newest::default(),
            newest_other_ms: Newest::default(),
            started: false,
        }
    }

    /// What a frame will take, milliseconds.
    pub fn frame_ms(&self, step: usize) -> f32 {
        self.other_ms + self.drawing_ms(step)
    }

    fn drawing_ms(&self, step: usize) -> f32 {
        let Some(&ms) = self.measured_ms.get(step) else { return f32::INFINITY };
        ms * (self.scale + self.own[step]).clamp(-12.0, 12.0).exp()
    }

    /// A frame at a step took so long to draw and so long otherwise, milliseconds. Numbers that are not finite or
    /// below 0 are ignored.
    pub fn see(&mut self, drawing_ms: f32, other_ms: f32) {
        if [drawing_ms, other_ms].iter().all(|ms| ms.is_finite() && *ms >= 0.0) {
            self.newest_drawing_ms.push(drawing_ms);
            self.newest_other_ms.push(other_ms);
        }
    }

    /// Believes the median of the newest `frames` frames, all of this step. After a change of step (`fresh`) a surprise
    /// belongs to the step as well as to the load.
    pub fn believe(&mut self, step: usize, frames: usize, fresh: bool) {
        let (Some(drawing), Some(other)) =
            (self.newest_drawing_ms.median(frames), self.newest_other_ms.median(frames))
        else {
            return;
        };
        if step >= self.own.len() {
            return;
        }
        self.other_ms = other;
        let surprise = (drawing.max(1e-3) / self.drawing_ms(step)).ln();
        if fresh && self.started {
            let own = OWN * surprise;
            self.own[step] += own;
            self.scale += surprise - own;
        } else {
            // What is not the load's is what this step costs in this scene.
            let shared = if self.started { SHARED * surprise } else { surprise };
            self.scale += shared;
            self.own[step] += surprise - shared;
        }
        self.started = true;
    }

    /// Forgets the newest frames: they were of another step.
    pub fn forget(&mut self) {
        self.newest_drawing_ms = Newest::default();
        self.newest_other_ms = Newest::default();
    }

    /// Frames seen since they were last forgotten, up to nine.
    pub fn seen(&self) -> usize {
        self.newest_drawing_ms.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_is_learnt_from_a_few_frames() {
        let mut model = CostModel::new(&[2.0, 8.0, 32.0]);
        for _ in 0..3 {
            model.see(16.0, 5.0);
        }
        model.believe(1, 3, true);
        assert!((model.frame_ms(1) - 21.0).abs() < 1e-3, "{}", model.frame_ms(1));
        assert!((model.frame_ms(0) - 9.0).abs() < 1e-3 && (model.frame_ms(2) - 69.0).abs() < 1e-2);
    }

    #[test]
    fn a_step_that_costs_more_here_than_elsewhere_is_remembered() {
        let mut model = CostModel::new(&[2.0, 8.0]);
        model.see(2.0, 0.0);
        model.believe(0, 1, true);
        // Step 1 takes twice what the front says; step 0 does not.
        for _ in 0..6 {
            for (step, ms) in [(1, 16.0), (0, 2.0)] {
                model.forget();
                model.see(ms, 0.0);
                model.believe(step, 1, true);
            }
        }
        assert!((model.frame_ms(1) / 16.0 - 1.0).abs() < 0.1, "{}", model.frame_ms(1));
        assert!((model.frame_ms(0) / 2.0 - 1.0).abs() < 0.1, "{}", model.frame_ms(0));
    }

    #[test]
    fn one_late_frame_does_not_count_and_nonsense_is_ignored() {
        let mut model = CostModel::new(&[4.0]);
        for ms in [4.0, 90.0, 4.0, f32::NAN, -1.0] {
            model.see(ms, 1.0);
        }
        assert_eq!(model.seen(), 3);
        model.believe(0, 3, false);
        assert!((model.frame_ms(0) - 5.0).abs() < 1e-4);
        model.believe(7, 3, false);
        assert!(model.frame_ms(7).is_infinite());
    }
}
