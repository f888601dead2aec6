//! What `shaders/shared/blockers.wgsl` reads: everything that does not depend on the receiver, as one uniform.

use super::{Blockers, Plane};
use crate::{
    math::sh::{
        log_exp::{LOG_STEPS, tables},
        product::gamma,
    },
    model::blocker::Rung,
};
use bytemuck::{Pod, Zeroable};

/// Spheres that the shader takes.
pub const SHADER_SPHERES: usize = 64;

/// Largest SH order of the shader's functions; `plane_weights` hold for any order.
pub const SHADER_ORDER: usize = 4;

/// The shader's struct of the same name, member by member; below the 16 KiB that every uniform may have.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BlockerTerms {
    /// Centre (world frame, metres) and radius.
    pub spheres: [[f32; 4]; SHADER_SPHERES],
    /// Body of sphere 4 i + k at `[i][k]`.
    pub bodies: [[u32; 4]; SHADER_SPHERES / 4],
    /// Spheres, rung (its place in [`Rung::ALL`]), order, directions.
    pub counts: [u32; 4],
    /// h, sin(h/2), entries of `gamma`.
    pub softness: [f32; 4],
    /// (a, b) at nodes 2 i and 2 i + 1.
    pub response: [[f32; 4]; 21],
    /// Every fourth row of the table of logarithms.
    pub logarithms: [[f32; 4]; 129],
    /// i + 16 j + 256 k as bits of a float, and the integral: two entries each.
    pub gamma: [[f32; 4]; 39],
    /// w_j.
    pub directions: [[f32; 4]; 256],
    /// W_j of a plane, r, g, b.
    pub plane_weights: [[f32; 4]; 256],
    /// Mean of each y_i over the directions, without i = 0.
    pub means: [[f32; 4]; 4],
}

impl Blockers {
    /// Fills the shader's uniform: the first 64 spheres, the order at most 4, and the weights of a plane where one is
    /// given (zero elsewhere). Tells how many spheres had no place.
    pub fn shader_terms(&self, plane: Option<&Plane>, out: &mut BlockerTerms) -> usize {
        *out = BlockerTerms::zeroed();
        let order = self.order.min(SHADER_ORDER);
        let tables = tables(order);
        let count = self.spheres.len().min(SHADER_SPHERES);
        for (i, sphere) in self.spheres.iter().take(count).enumerate() {
            out.spheres[i] = sphere.centre_world.extend(sphere.radius_m).to_array();
            out.bodies[i / 4][i % 4] = sphere.body;
        }
        let entries = gamma(order);
        let rung = Rung::ALL.iter().position(|rung| *rung == self.rung).unwrap_or(0);
        let directions = self.directions.list();
        out.counts = [count as u32, rung as u32, order as u32, directions.len() as u32];
        let [softness, least_sine] = self.directions.softness();
        out.softness = [softness, least_sine, entries.len() as f32, 0.0];
        for (node, (a, b)) in tables.response.nodes.iter().enumerate() {
            out.response[node / 2][node % 2 * 2..][..2].copy_from_slice(&[*a, *b]);
        }
        let rows = tables.log.rows.iter().step_by(LOG_STEPS / 128);
        for (out, row) in out.logarithms.iter_mut().zip(rows) {
            out.copy_from_slice(&row[..4]);
        }
        for (entry, g) in entries.iter().enumerate() {
            let packed = f32::from_bits((g.i | g.j << 4 | g.k << 8) as u32);
            out.gamma[entry / 2][entry % 2 * 2..][..2].copy_from_slice(&[packed, g.integral as f32]);
        }
        for (out, [x, y, z]) in out.directions.iter_mut().zip(directions) {
            *out = [*x, *y, *z, 0.0];
        }
        for (out, [r, g, b]) in
            out.plane_weights.iter_mut().zip(plane.map_or(&[][..], |plane| &plane.weights))
        {
            *out = [*r, *g, *b, 0.0];
        }
        for (i, mean) in self.directions.means().iter().take(16).enumerate() {
            out.means[i / 4][i % 4] = *mean;
        }
        self.spheres.len() - count
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
        blockers.prepare(&spheres, Rung::Directions, 4, 256);
        let (mut plane, mut terms) = (Plane::default(), BlockerTerms::zeroed());
        blockers.plane(Vec3::Z, None, &[[1.0; 3]; 36], &mut plane);
        assert_eq!(blockers.shader_terms(Some(&plane), &mut terms), 6);
        assert_eq!(terms.counts, [64, 5, 4, 256]);
        assert_eq!((terms.spheres[63], terms.bodies[15]), ([63.0, 0.0, 1.0, 0.25], [60, 61, 62, 63]));
        assert_eq!(terms.softness[2], 77.0);
        assert_eq!(terms.response[0][..2], [1.0, 1.0]);
        assert_eq!(terms.response[20][2..], [0.0, 0.0], "41 nodes");
        assert!(terms.response[20][0] > terms.response[19][2]);
        assert_eq!(terms.logarithms[128][0], tables(4).log.rows[LOG_STEPS][0]);
        let packed = terms.gamma[38][0].to_bits();
        let last = gamma(4)[76];
        assert_eq!(
            [packed & 15, packed >> 4 & 15, packed >> 8],
            [last.i as u32, last.j as u32, last.k as u32]
        );
        assert!(terms.directions[255][2] < -0.99 && terms.plane_weights[255][0] != 0.0);
    }
}
