//! Spheres that stand for virtual objects where these block soft light (Section 6.2 of [Now11]).

use glam::Vec3;

/// One such sphere, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockerSphere {
    /// Centre, metres.
    pub centre_world: Vec3,
    /// Radius, metres, above 0.
    pub radius_m: f32,
    /// Which body it belongs to: a body's own surface does not count its own spheres.
    pub body: u32,
}

/// Spheres that shaders take.
pub const SHADER_SPHERES: usize = 256;

/// How the visibility of many spheres is put together from that of each: the accuracy ladder, cheapest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Rung {
    /// The product of the mean visibilities: no direction at all.
    Dc,
    /// One optimal-linear exponential of the summed logarithms (Eq. 24 of [Now11]).
    Linear,
    /// The same of a 2^p-th part of the sum, then p squarings.
    Hybrid,
    /// Scaling and squaring with a Taylor polynomial of degree 2.
    Squared,
    /// One product for each sphere.
    Chain,
    /// Soft tests of fixed directions: the only one that overlaps cannot harm.
    Directions,
}

impl Rung {
    /// All rungs, from the cheapest.
    pub const ALL: [Self; 6] =
        [Self::Dc, Self::Linear, Self::Hybrid, Self::Squared, Self::Chain, Self::Directions];

    /// Its name in settings and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dc => "dc",
            Self::Linear => "linear",
            Self::Hybrid => "hybrid",
            Self::Squared => "squared",
            Self::Chain => "chain",
            Self::Directions => "directions",
        }
    }

    /// The rung of a name; `None` where there is none: see [`Rung::ALL`] for what is allowed.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|rung| rung.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back() {
        for rung in Rung::ALL {
            assert_eq!(Rung::parse(rung.name()), Some(rung));
        }
        assert_eq!(Rung::parse("Linear"), None);
        assert_eq!(Rung::parse(""), None);
    }
}
