//! Layer 4: the hard cases, as a list. Each gives one number twice: as the textbook's formula has it in f32 (`naive`),
//! and as this program has it, on whichever engine is at hand; and the bound that the number must keep.
//! `halflight stress` prints the list, `tests/stability` holds every engine to it.

pub mod cases;
pub mod naive;
pub mod stage;

use crate::engine::{Engine, EngineError};
use crate::plan::Pass;

/// What a number must keep: at least `least` and at most `most`. Nothing that is not a number is within.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaseBound {
    /// Smallest that is allowed.
    pub least: f64,
    /// Largest that is allowed.
    pub most: f64,
}

impl CaseBound {
    /// From `least` to `most`, both included.
    pub const fn new(least: f64, most: f64) -> Self {
        Self { least, most }
    }

    /// Within `apart` of a number.
    pub const fn about(number: f64, apart: f64) -> Self {
        Self::new(number - apart, number + apart)
    }

    /// This number alone.
    pub const fn exactly(number: f64) -> Self {
        Self::new(number, number)
    }

    /// A share: 0 to 1.
    pub const SHARE: Self = Self::new(0.0, 1.0);

    /// Whether a number is within; never where it is not one.
    pub fn holds(&self, number: f64) -> bool {
        (self.least..=self.most).contains(&number)
    }
}

/// What the number of a case comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Where {
    /// This kernel of the engine, with what it needs of others.
    Kernel(Pass),
    /// Code that has no shader: the processor, with any engine.
    Processor,
}

/// One hard case.
#[derive(Clone, Copy)]
pub struct HardCase {
    /// What is hard, in a few words; unique.
    pub name: &'static str,
    /// What the number is, with its unit.
    pub measures: &'static str,
    /// The textbook's formula, and what becomes of it.
    pub formula: &'static str,
    /// What computes ours.
    pub runs: Where,
    /// The number by the textbook's formula, in f32.
    pub textbook: fn() -> f64,
    /// The number by this program.
    pub ours: fn(&mut dyn Engine) -> Result<f64, EngineError>,
    /// What ours must keep.
    pub bound: CaseBound,
}

/// What a case gave.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The textbook's number.
    pub textbook: f64,
    /// Ours, or what the engine said.
    pub ours: Result<f64, String>,
    /// Whether the textbook's number keeps the bound.
    pub textbook_holds: bool,
    /// Whether ours does.
    pub holds: bool,
}

impl HardCase {
    /// Runs it on an engine, whose scene is then this case's.
    pub fn run(&self, engine: &mut dyn Engine) -> Outcome {
        let textbook = (self.textbook)();
        let ours = (self.ours)(engine).map_err(|e| e.to_string());
        let holds = ours.as_ref().is_ok_and(|number| self.bound.holds(*number));
        Outcome { textbook, ours, textbook_holds: self.bound.holds(textbook), holds }
    }
}

/// Cases that belong together.
#[derive(Clone, Copy)]
pub struct CaseGroup {
    /// What they are about.
    pub title: &'static str,
    /// In order.
    pub cases: &'static [HardCase],
}

/// All cases, by what they are about.
pub const GROUPS: [CaseGroup; 8] = [
    CaseGroup { title: "Exposures", cases: cases::exposures::CASES },
    CaseGroup { title: "Light and its two halves", cases: cases::light::CASES },
    CaseGroup { title: "Spheres before soft light", cases: cases::spheres::CASES },
    CaseGroup { title: "Gloss", cases: cases::gloss::CASES },
    CaseGroup { title: "Hard shadows", cases: cases::shadows::CASES },
    CaseGroup { title: "Near light", cases: cases::near::CASES },
    CaseGroup { title: "Poses and time", cases: cases::poses::CASES },
    CaseGroup { title: "Pictures and numbers", cases: cases::pictures::CASES },
];

/// All cases in one row.
pub fn all() -> impl Iterator<Item = &'static HardCase> {
    GROUPS.iter().flat_map(|group| group.cases)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_is_within_no_bound() {
        let bound = CaseBound::SHARE;
        assert!(bound.holds(0.0) && bound.holds(1.0));
        assert!(!bound.holds(f64::NAN) && !bound.holds(1.0 + 1e-9) && !bound.holds(-1e-9));
        let any = CaseBound::new(f64::NEG_INFINITY, f64::INFINITY);
        assert!(!any.holds(f64::NAN));
        assert!(CaseBound::exactly(2.0).holds(2.0) && CaseBound::about(2.0, 0.5).holds(1.5));
    }

    #[test]
    fn every_case_has_a_name_of_its_own() {
        let mut names: Vec<_> = all().map(|case| case.name).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        for case in all() {
            assert!(case.bound.least <= case.bound.most, "{}", case.name);
            assert!(!case.measures.is_empty() && !case.formula.is_empty(), "{}", case.name);
        }
    }
}
