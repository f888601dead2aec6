//! Spheres that stand for virtual objects where these block soft light (Section 6.2 of [Now11]), and boxes for their thin
//! parts.

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

/// A box that stands for a thin part of a body, in the world frame. One half extent may be 0: a sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockerBox {
    /// Centre, metres.
    pub centre_world: Vec3,
    /// Unit vectors at right angles to each other.
    pub axes_world: [Vec3; 3],
    /// Half its extent along each axis, metres, not below 0.
    pub half_m: Vec3,
    /// Which body it belongs to, as in [`BlockerSphere`].
    pub body: u32,
}

impl BlockerBox {
    /// Whether it can hide anything: all of it finite, and an area from some side.
    pub fn is_sound(&self) -> bool {
        let half = self.half_m;
        let finite = self.centre_world.is_finite()
            && half.is_finite()
            && self.axes_world.iter().all(|axis| axis.is_finite());
        finite && half.min_element() >= 0.0 && half.element_sum() - half.max_element() > 0.0
    }

    /// The sphere around it.
    pub fn around(&self) -> BlockerSphere {
        let radius_m = self.half_m.length();
        BlockerSphere { centre_world: self.centre_world, radius_m, body: self.body }
    }

    /// Whether a point (world frame) is in it or at most `margin_m` off each of its sides.
    pub fn holds(&self, point_world: Vec3, margin_m: f32) -> bool {
        let to = point_world - self.centre_world;
        let sides = self.axes_world.iter().zip(self.half_m.to_array());
        sides.into_iter().all(|(axis, half)| to.dot(*axis).abs() <= half + margin_m)
    }
}

/// Spheres that shaders take.
pub const SHADER_SPHERES: usize = 256;

/// Boxes that shaders take.
pub const SHADER_BOXES: usize = 128;

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
