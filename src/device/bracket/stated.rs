//! What metadata is worth: it is believed after it has agreed with the pictures for long, and no more once it has not.

/// Agreements in a row before metadata is believed for the first time.
const PROOF: u64 = 100;
/// What metadata that is believed adds to the margin of an exposure that it states.
pub(super) const SUPPORT: f64 = 14.0;
/// The margin from which a picture confirms or contradicts what is stated of it.
pub(super) const CONTRADICTED: f64 = 8.0;
/// Contradictions after which metadata counts as lying.
const LIES: u64 = 3;

/// Whether stated exposures are believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Belief {
    /// Nothing was stated, or not for long enough.
    Unproven,
    /// It has agreed with the pictures for 100 frames and more: it counts as evidence beside them.
    Believed,
    /// Pictures have contradicted it three times and more: it is not looked at until it has agreed for ever longer.
    Lies,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Stated {
    agreements: u64,
    contradictions: u64,
}

impl Stated {
    pub fn agreed(&mut self) {
        self.agreements = self.agreements.saturating_add(1);
    }

    pub fn contradicted(&mut self) {
        self.agreements = 0;
        self.contradictions = self.contradictions.saturating_add(1);
    }

    /// Each contradiction doubles how long it must agree.
    pub fn is_believed(&self) -> bool {
        self.agreements >= PROOF.saturating_mul(1 << self.contradictions.min(20))
    }

    pub fn belief(&self) -> Belief {
        if self.is_believed() {
            Belief::Believed
        } else if self.contradictions >= LIES {
            Belief::Lies
        } else {
            Belief::Unproven
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn belief_is_earned_and_lost() {
        let mut stated = Stated::default();
        (0..99).for_each(|_| stated.agreed());
        assert_eq!(stated.belief(), Belief::Unproven);
        stated.agreed();
        assert_eq!(stated.belief(), Belief::Believed);
        stated.contradicted();
        (0..199).for_each(|_| stated.agreed());
        assert_eq!(stated.belief(), Belief::Unproven);
        stated.agreed();
        assert_eq!(stated.belief(), Belief::Believed);
        (0..3).for_each(|_| stated.contradicted());
        assert_eq!(stated.belief(), Belief::Lies);
    }
}
