//! Few spheres that stand for a mesh where it blocks soft light (Section 6.2 of [Now11], after Wang et al., "Variational
//! Sphere Set Approximation for Solid Objects", 2006).
//!
//! The mesh's volume is cut into about 16,000 cubes (`voxels`). With V its volume, the spheres S are chosen so that
//! `COVERED |S within V| - |S outside V| - OVERLAP (sum of |S_i| - |S|)` is as large as can be found, where the
//! cubes of thin parts and those beside them count more (`thickness`): first by
//! clustering the inner cubes (farthest points, then Lloyd's iteration), then by moving one sphere at a time to a better
//! place and size, then by taking the sphere that serves least and putting it where most is uncovered, for as long as
//! that helps. All in a fixed order: equal meshes give equal spheres.

mod refine;
mod thickness;
mod voxels;

use glam::Vec3;
use refine::{FoundSphere, refine, relocate};
use serde::{Deserialize, Serialize};
use voxels::Voxels;

/// Fewest spheres that are fitted to an object by default rules.
pub const MIN_COUNT: usize = 4;
/// Most spheres.
pub const MAX_COUNT: usize = 64;
/// Changes with the result, so that older results are not taken for this one's.
pub const VERSION: u32 = 2;

/// A sphere in the frame of its mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FittedSphere {
    /// In the units of the mesh.
    pub centre: Vec3,
    /// Above 0.
    pub radius: f32,
}

/// What `fit` found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SphereFit {
    /// As many as were asked for (fewer only where the mesh is smaller than so many cubes).
    pub spheres: Vec<FittedSphere>,
    /// Volume of the spheres' union that lies outside the mesh, over the mesh's volume.
    pub outside_share: f32,
    /// Volume of the mesh in no sphere, over the mesh's volume.
    pub uncovered_share: f32,
    /// The mesh's volume; of a mesh that encloses none, that of the cubes that its surface passes.
    pub volume: f64,
}

/// Fits `count` spheres (1 to 64; more are taken as 64) to a mesh. It need not be closed everywhere: a point is inside
/// where most of the three axes' lines through it say so; pieces may overlap. A mesh without volume (a sheet) is taken
/// as thick as one cube. `progress` is told the share done, 0 to 1.
///
/// `None` where no triangle has an area.
pub fn fit(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    count: usize,
    progress: &mut dyn FnMut(f32),
) -> Option<SphereFit> {
    let count = count.clamp(1, MAX_COUNT);
    progress(0.0);
    let mut voxels = Voxels::of_mesh(positions, triangles)?;
    progress(0.2);
    let mut found: Vec<FoundSphere> = clusters(&voxels, count);
    found.iter().for_each(|sphere| voxels.add(sphere, 1));
    progress(0.3);
    refine(&mut voxels, &mut found);
    relocate(&mut voxels, &mut found, &mut |share| progress(0.3 + 0.7 * share));
    let (outside, uncovered, inside) = voxels.shares(&found);
    let spheres = found
        .iter()
        .map(|sphere| FittedSphere {
            centre: (voxels.origin + sphere.centre * voxels.cell).as_vec3(),
            radius: (sphere.radius * voxels.cell) as f32,
        })
        .collect();
    progress(1.0);
    Some(SphereFit {
        spheres,
        outside_share: (outside / inside) as f32,
        uncovered_share: (uncovered / inside) as f32,
        volume: inside * voxels.cell.powi(3),
    })
}

/// The share of a mesh's volume, as `fit` sees it, of which `covers` says no. `None` where no triangle has an area.
pub fn uncovered_share(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    covers: impl Fn(Vec3) -> bool,
) -> Option<f32> {
    let voxels = Voxels::of_mesh(positions, triangles)?;
    let inner = voxels.inner_points();
    let missed = inner.iter().filter(|p| !covers((voxels.origin + **p * voxels.cell).as_vec3())).count();
    Some(missed as f32 / inner.len().max(1) as f32)
}

/// Lloyd's iteration on the inner cubes from farthest points; each cluster gives the ball of its volume.
fn clusters(voxels: &Voxels, count: usize) -> Vec<FoundSphere> {
    let points = voxels.inner_points();
    let middle = points.iter().sum::<glam::DVec3>() / points.len().max(1) as f64;
    let mut nearest2 = vec![f64::INFINITY; points.len()];
    let mut centres: Vec<glam::DVec3> = Vec::new();
    let mut next = middle;
    // The point farthest from all centres so far; the first one is the one farthest from the middle.
    for step in 0..=count.min(points.len()) {
        let mut farthest = (0.0, middle);
        for (point, near2) in points.iter().zip(&mut nearest2) {
            *near2 = near2.min(point.distance_squared(next));
            if *near2 > farthest.0 {
                farthest = (*near2, *point);
            }
        }
        if step == 0 {
            nearest2.fill(f64::INFINITY);
        } else {
            centres.push(next);
        }
        next = farthest.1;
    }
    let mut sizes = vec![0usize; centres.len()];
    for _ in 0..LLOYD_ROUNDS {
        let mut sums = vec![glam::DVec3::ZERO; centres.len()];
        sizes.fill(0);
        for point in &points {
            let mut best = (f64::INFINITY, 0);
            for (k, centre) in centres.iter().enumerate() {
                let d2 = centre.distance_squared(*point);
                if d2 < best.0 {
                    best = (d2, k);
                }
            }
            sums[best.1] += *point;
            sizes[best.1] += 1;
        }
        for (centre, (sum, &size)) in centres.iter_mut().zip(sums.iter().zip(&sizes)) {
            if size > 0 {
                *centre = *sum / size as f64;
            }
        }
    }
    let ball = |size: usize| (3.0 * size.max(1) as f64 / (4.0 * std::f64::consts::PI)).cbrt();
    centres.iter().zip(&sizes).map(|(&centre, &size)| FoundSphere { centre, radius: ball(size) }).collect()
}

/// After so many rounds clusters hardly change.
const LLOYD_ROUNDS: usize = 12;

#[cfg(test)]
mod tests;
