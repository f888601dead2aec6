//! The scene as light up to one factor: what a frame's blocks are compared with.
//!
//! A frame gives one number, the median over blocks of ln X - ln reference. Exposure and light that changes everywhere move
//! that number; what moves within the scene makes blocks disagree. The reference is a shape without a scale, so that it can
//! learn from frames whose exposure nobody knows yet.

use super::thumbnail::{BLOCKS, Thumbnail};

/// Fewest blocks that frame and reference must both see well.
const FEWEST_SHARED: usize = 6;
/// Blocks agree that lie so near the median, ln.
const AGREES: f64 = 0.15;
/// Least share of blocks that must agree: a hand may cover the others.
const LEAST_AGREEING: f64 = 0.6;
/// How much of a block's newest value goes into the reference: a few frames forget what has left the scene.
const LEARNING: f64 = 0.4;
/// The least error of a level, ln: rounding of 8-bit values, and a response that is not quite the camera's.
const LEAST_ERROR: f64 = 0.01;

/// ln light of each block up to one constant; not a number where it is not known.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    log: [f64; BLOCKS],
    /// Frames of one epoch are measured against one shape; levels of different epochs cannot be compared.
    epoch: u64,
}

/// A frame's level against a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    /// ln X over the shape.
    pub log: f64,
    /// Standard deviation of that.
    pub error: f64,
    /// The shape's number.
    pub epoch: u64,
    /// The frame began this epoch: the scene had changed.
    pub begins: bool,
}

enum Compared {
    Level(f64, f64),
    Disagree,
    TooFew,
}

impl Shape {
    fn anchored(thumbnail: &Thumbnail, epoch: u64) -> Self {
        let log = std::array::from_fn(|block| thumbnail.well_exposed(block).unwrap_or(f64::NAN));
        Self { log, epoch }
    }

    fn compare(&self, thumbnail: &Thumbnail) -> Compared {
        let mut ratios = [0.0; BLOCKS];
        let mut count = 0;
        for (block, log) in self.log.iter().enumerate() {
            if let Some(seen) = thumbnail.well_exposed(block).filter(|_| log.is_finite()) {
                ratios[count] = seen - log;
                count += 1;
            }
        }
        if count < FEWEST_SHARED {
            return Compared::TooFew;
        }
        let ratios = &mut ratios[..count];
        let (_, &mut median, _) = ratios.select_nth_unstable_by(count / 2, f64::total_cmp);
        let agreeing = ratios.iter().filter(|ratio| (**ratio - median).abs() <= AGREES).count();
        if (agreeing as f64) < LEAST_AGREEING * count as f64 {
            return Compared::Disagree;
        }
        ratios.iter_mut().for_each(|ratio| *ratio = (*ratio - median).abs());
        let (_, &mut spread, _) = ratios.select_nth_unstable_by(count / 2, f64::total_cmp);
        // A normal distribution: sigma = 1.48 of the median deviation; a median's error = 1.25 sigma / sqrt(n).
        let error = 1.25 * 1.48 * spread / (count as f64).sqrt();
        Compared::Level(median, error.max(LEAST_ERROR))
    }

    fn learn(&mut self, thumbnail: &Thumbnail, level: f64) {
        for (block, log) in self.log.iter_mut().enumerate() {
            if let Some(seen) = thumbnail.well_exposed(block) {
                let new = seen - level;
                *log = if log.is_finite() { *log + LEARNING * (new - *log) } else { new };
            }
        }
    }
}

/// The shape in use, and the one before: one frame in which everything differs does not cost what was learned.
#[derive(Clone, Debug, Default)]
pub(super) struct Shapes {
    current: Option<Shape>,
    before: Option<Shape>,
    epochs: u64,
    /// Frames in a row that shared too few blocks.
    strangers: u32,
}

/// So many frames in a row that share too few blocks mean that the shape is of another scene.
const MOST_STRANGERS: u32 = 6;

impl Shapes {
    /// Measures a frame and learns from it. `None` where too little of it is well exposed, or too little of that is known.
    pub fn measure(&mut self, thumbnail: &Thumbnail) -> Option<Level> {
        let mut too_few = false;
        for _ in 0..2 {
            if let Some(shape) = &mut self.current {
                match shape.compare(thumbnail) {
                    Compared::Level(log, error) => {
                        shape.learn(thumbnail, log);
                        self.strangers = 0;
                        return Some(Level { log, error, epoch: shape.epoch, begins: false });
                    }
                    Compared::Disagree => {}
                    Compared::TooFew => too_few = true,
                }
            }
            std::mem::swap(&mut self.current, &mut self.before);
        }
        let usable = (0..BLOCKS).filter(|block| thumbnail.well_exposed(*block).is_some()).count();
        if usable < FEWEST_SHARED {
            return None;
        }
        if too_few {
            self.strangers += 1;
            if self.strangers < MOST_STRANGERS {
                return None;
            }
        }
        self.strangers = 0;
        self.epochs += 1;
        self.before = self.current.replace(Shape::anchored(thumbnail, self.epochs));
        Some(Level { log: 0.0, error: LEAST_ERROR, epoch: self.epochs, begins: true })
    }

    /// Forgets the scene.
    pub fn clear(&mut self) {
        self.current = None;
        self.before = None;
        self.strangers = 0;
    }

    /// How often the scene was learned anew.
    pub fn epochs(&self) -> u64 {
        self.epochs
    }
}
