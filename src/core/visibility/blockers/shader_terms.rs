//! What `shaders/shared/blockers.wgsl` reads: everything that does not depend on the receiver, as two uniforms.

use super::Blockers;
use crate::{
    math::sh::{
        log_exp::{LOG_STEPS, tables},
        rings::Rings,
    },
    model::blocker::{Rung, SHADER_BOXES, SHADER_SPHERES},
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
    /// Spheres, rung (its place in [`Rung::ALL`]), boxes, 0.
    pub counts: [u32; 4],
    /// Of each box: centre (world frame, metres) and half the first extent; first axis and half the second extent; second
    /// axis and half the third extent. The third axis is at right angles to both.
    pub boxes: [[[f32; 4]; 3]; SHADER_BOXES],
    /// Body of box 4 i + k at `[i][k]`.
    pub box_bodies: [[u32; 4]; SHADER_BOXES / 4],
}

/// What depends on the order alone; likewise.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BlockerTables {
    /// Pairs of rings, 0, 0, 0.
    pub counts: [u32; 4],
    /// (a, b) at nodes 2 i and 2 i + 1.
    pub response: [[f32; 4]; 21],
    /// The table of logarithms, bands 0 to 3.
    pub logarithms: [[f32; 4]; LOG_STEPS + 1],
    /// Bands 4 and 5, in steps 2 i and 2 i + 1.
    pub logarithms_high: [[f32; 4]; LOG_STEPS / 2 + 1],
    /// Values and weighted values of each pair of rings, P_lm at l (l + 1) / 2 + m.
    pub rings: [[[f32; 24]; 2]; 4],
}

/// Samples of a ring that shaders take at an order: above 3(n - 1), and such that the sums over them are short.
const fn shader_samples(order: usize) -> usize {
    if order > 4 { 16 } else { 12 }
}

impl Blockers {
    /// Whether shaders can do what these do: at most [`SHADER_SPHERES`] spheres and [`SHADER_BOXES`] boxes.
    pub fn fit_shader(&self) -> bool {
        self.spheres.len() <= SHADER_SPHERES && self.boxes.len() <= SHADER_BOXES
    }

    /// Fills the shader's uniform with what fits.
    pub fn shader_terms(&self, out: &mut BlockerTerms) {
        let count = self.spheres.len().min(SHADER_SPHERES);
        for (i, sphere) in self.spheres.iter().take(count).enumerate() {
            out.spheres[i] = sphere.centre_world.extend(sphere.radius_m).to_array();
            out.bodies[i / 4][i % 4] = sphere.body;
        }
        let rung = Rung::ALL.iter().position(|rung| *rung == self.rung).unwrap_or(0);
        let boxes = self.boxes.len().min(SHADER_BOXES);
        for (i, of) in self.boxes.iter().take(boxes).enumerate() {
            let [x, y, _] = of.axes_world;
            out.boxes[i] = [
                of.centre_world.extend(of.half_m.x).to_array(),
                x.extend(of.half_m.y).to_array(),
                y.extend(of.half_m.z).to_array(),
            ];
            out.box_bodies[i / 4][i % 4] = of.body;
        }
        out.counts = [count as u32, rung as u32, boxes as u32, 0];
    }

    /// Fills the shader's tables, of any rung but `directions`; they depend on the order alone.
    pub fn shader_tables(&self, out: &mut BlockerTables) {
        let tables = tables(self.order);
        for (node, (a, b)) in tables.response.nodes.iter().enumerate() {
            out.response[node / 2][node % 2 * 2..][..2].copy_from_slice(&[*a, *b]);
        }
        for (step, row) in tables.log.rows.iter().enumerate() {
            out.logarithms[step].copy_from_slice(&row[..4]);
            out.logarithms_high[step / 2][step % 2 * 2..][..2].copy_from_slice(&row[4..6]);
        }
        let mut pairs = 0;
        for (out, pair) in out.rings.iter_mut().zip(Rings::pairs_of(self.order, shader_samples(self.order))) {
            for (out, values) in out.iter_mut().zip(pair) {
                for (out, value) in out.iter_mut().zip(values) {
                    *out = value as f32;
                }
            }
            pairs += 1;
        }
        out.counts = [pairs, 0, 0, 0];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::blocker::BlockerSphere;
    use glam::Vec3;

    #[test]
    fn the_uniforms_are_small_and_full() {
        for size in [size_of::<BlockerTerms>(), size_of::<BlockerTables>()] {
            assert!(size <= 16 * 1024, "{size}");
        }
        let sphere = |i: usize| BlockerSphere {
            centre_world: Vec3::new(i as f32, 0.0, 1.0),
            radius_m: 0.25,
            body: i as u32,
        };
        let spheres: Vec<_> = (0..270).map(sphere).collect();
        let mut blockers = Blockers::new();
        blockers.prepare(&spheres[..256], Rung::Chain, 6, 256);
        assert!(blockers.fit_shader());
        blockers.prepare(&spheres, Rung::Chain, 6, 256);
        assert!(!blockers.fit_shader(), "270 spheres");
        let mut terms = BlockerTerms::zeroed();
        blockers.shader_terms(&mut terms);
        assert_eq!(terms.counts, [256, 4, 0, 0]);
        assert_eq!((terms.spheres[255], terms.bodies[63]), ([255.0, 0.0, 1.0, 0.25], [252, 253, 254, 255]));
        let mut out = BlockerTables::zeroed();
        blockers.shader_tables(&mut out);
        assert_eq!(out.response[0][..2], [1.0, 1.0]);
        assert_eq!(out.response[20][2..], [0.0, 0.0], "41 nodes");
        assert!(out.response[20][0] > out.response[19][2]);
        let last = tables(6).log.rows[LOG_STEPS];
        assert_eq!(
            (&out.logarithms[LOG_STEPS][..], &out.logarithms_high[256][..2]),
            (&last[..4], &last[4..6])
        );
        assert_eq!(out.logarithms_high[0][2..], tables(6).log.rows[1][4..6]);
    }

    #[test]
    fn rings_weigh_the_whole_sphere() {
        for order in 2..=6 {
            let mut blockers = Blockers::new();
            blockers.prepare(&[], Rung::Chain, order, 64);
            let mut out = BlockerTables::zeroed();
            blockers.shader_tables(&mut out);
            // The square of y_00 = 1/sqrt(4 pi), on both rings of each pair, at each sample: 1 in all.
            let rings = &out.rings[..out.counts[0] as usize];
            let sum: f32 = rings.iter().map(|[values, weighted]| values[0] * weighted[0]).sum();
            let sum = 2.0 * shader_samples(order) as f32 * sum;
            assert!((sum - 1.0).abs() < 1e-6, "order {order}: {sum}");
            assert_eq!(out.counts[0] as usize, (3 * (order - 1) / 2 + 2) / 2);
        }
    }
}
