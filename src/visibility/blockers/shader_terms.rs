//! What `shaders/shared/blockers.wgsl` reads: everything that does not depend on the receiver, as one uniform.

use super::Blockers;
use crate::{
    math::sh::{
        log_exp::{LOG_STEPS, tables},
        product::gamma,
    },
    model::blocker::{Rung, SHADER_ORDER, SHADER_SPHERES},
};
use bytemuck::{Pod, Zeroable};

/// The shader's struct of the same name, member by member; below the 16 KiB that every uniform may have.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BlockerTerms {
    /// Centre (world frame, metres) and radius.
    pub spheres: [[f32; 4]; SHADER_SPHERES],
    /// Body of sphere 4 i + k at `[i][k]`.
    pub bodies: [[u32; 4]; SHADER_SPHERES / 4],
    /// Spheres, rung (its place in [`Rung::ALL`]), order, entries of `gamma`.
    pub counts: [u32; 4],
    /// (a, b) at nodes 2 i and 2 i + 1.
    pub response: [[f32; 4]; 21],
    /// The table of logarithms, bands 0 to 3.
    pub logarithms: [[f32; 4]; LOG_STEPS + 1],
    /// i + 16 j + 256 k, and the bits of the integral: two entries each.
    pub gamma: [[u32; 4]; 39],
}

impl Blockers {
    /// Whether shaders can do what these do: at most 64 spheres, and for the rungs other than `directions` at most order 4.
    pub fn fit_shader(&self) -> bool {
        self.rung.has_shader(self.order) && self.spheres.len() <= SHADER_SPHERES
    }

    /// Fills the shader's uniform, of any rung but `directions`, with what fits.
    pub fn shader_terms(&self, out: &mut BlockerTerms) {
        let order = self.order.min(SHADER_ORDER);
        let tables = tables(order);
        let count = self.spheres.len().min(SHADER_SPHERES);
        for (i, sphere) in self.spheres.iter().take(count).enumerate() {
            out.spheres[i] = sphere.centre_world.extend(sphere.radius_m).to_array();
            out.bodies[i / 4][i % 4] = sphere.body;
        }
        let entries = gamma(order);
        let rung = Rung::ALL.iter().position(|rung| *rung == self.rung).unwrap_or(0);
        out.counts = [count as u32, rung as u32, order as u32, entries.len() as u32];
        for (node, (a, b)) in tables.response.nodes.iter().enumerate() {
            out.response[node / 2][node % 2 * 2..][..2].copy_from_slice(&[*a, *b]);
        }
        for (out, row) in out.logarithms.iter_mut().zip(&tables.log.rows) {
            out.copy_from_slice(&row[..4]);
        }
        for (entry, g) in entries.iter().enumerate() {
            let packed = (g.i | g.j << 4 | g.k << 8) as u32;
            let integral = (g.integral as f32).to_bits();
            out.gamma[entry / 2][entry % 2 * 2..][..2].copy_from_slice(&[packed, integral]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::blocker::BlockerSphere;
    use glam::Vec3;

    #[test]
    fn the_uniform_is_small_and_full() {
        assert!(size_of::<BlockerTerms>() <= 16 * 1024, "{}", size_of::<BlockerTerms>());
        let sphere = |i: usize| BlockerSphere {
            centre_world: Vec3::new(i as f32, 0.0, 1.0),
            radius_m: 0.25,
            body: i as u32,
        };
        let spheres: Vec<_> = (0..70).map(sphere).collect();
        let mut blockers = Blockers::new();
        blockers.prepare(&spheres, Rung::Chain, 4, 256);
        assert!(!blockers.fit_shader(), "70 spheres");
        let mut terms = BlockerTerms::zeroed();
        blockers.shader_terms(&mut terms);
        assert_eq!(terms.counts, [64, 4, 4, 77]);
        assert_eq!((terms.spheres[63], terms.bodies[15]), ([63.0, 0.0, 1.0, 0.25], [60, 61, 62, 63]));
        assert_eq!(terms.response[0][..2], [1.0, 1.0]);
        assert_eq!(terms.response[20][2..], [0.0, 0.0], "41 nodes");
        assert!(terms.response[20][0] > terms.response[19][2]);
        assert_eq!(terms.logarithms[LOG_STEPS][0], tables(4).log.rows[LOG_STEPS][0]);
        let last = gamma(4)[76];
        let packed = terms.gamma[38][0];
        assert_eq!(
            [packed & 15, packed >> 4 & 15, packed >> 8],
            [last.i as u32, last.j as u32, last.k as u32]
        );
        assert_eq!(f32::from_bits(terms.gamma[38][1]), last.integral as f32);
    }

    #[test]
    fn what_the_shader_cannot_do_is_left_to_the_twin() {
        let sphere = BlockerSphere { centre_world: Vec3::Z, radius_m: 0.25, body: 0 };
        let mut blockers = Blockers::new();
        for rung in Rung::ALL {
            for order in 2..=6 {
                blockers.prepare(&[sphere], rung, order, 64);
                assert_eq!(blockers.fit_shader(), rung == Rung::Directions || order <= 4);
            }
        }
    }
}
