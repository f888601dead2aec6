//! Spheres of figures: fitted, bound to nodes, kept in a folder from run to run, and as JSON.

use super::kept::Cache;
use crate::animate::bind::bind;
use crate::model::{
    animation::{BoundSphere, Figure},
    keep::{Keeper, KeptInput},
    scene::{Scene, VirtualObject},
};
use crate::visibility::fit_spheres::{self, FittedSphere, SphereFit};
use glam::Vec3;
use serde::Serialize;
use std::{convert::Infallible, path::Path};

/// What spheres are fitted to.
struct FitInput<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    count: usize,
}

impl KeptInput for FitInput<'_> {
    const KIND: &'static str = "spheres";
    const VERSION: u32 = fit_spheres::VERSION;
    type Output = Option<SphereFit>;

    fn hashed(&self) -> impl Serialize {
        (self.positions, self.triangles, self.count)
    }

    fn accepts(&self, fit: &Option<SphereFit>) -> bool {
        let is_sound = |s: &FittedSphere| s.centre.is_finite() && s.radius.is_finite() && s.radius > 0.0;
        fit.as_ref().is_none_or(|fit| fit.spheres.iter().all(is_sound))
    }
}

/// A figure's mesh at rest in its own frame: positions and triangles of all its parts.
pub fn geometry(figure: &Figure, objects: &[VirtualObject]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for mesh in figure.parts.iter().filter_map(|part| objects.get(part.object)).map(|object| &object.mesh) {
        let base = positions.len() as u32;
        positions.extend(&mesh.positions);
        triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + base)));
    }
    (positions, triangles)
}

/// Fits `count` spheres to a figure at rest, in its own frame, or takes them from the folder `cache` where an earlier
/// run left them for the same geometry (`kept`).
///
/// `progress` is told the share done, 0 to 1. `None` where no triangle has an area.
pub fn fit(
    figure: &Figure,
    objects: &[VirtualObject],
    count: usize,
    cache: Option<&Path>,
    progress: &mut dyn FnMut(f32),
) -> Option<SphereFit> {
    let (positions, triangles) = geometry(figure, objects);
    let input = FitInput { positions: &positions, triangles: &triangles, count };
    let Ok(fit) = Cache::new(cache)
        .keep(&input, || Ok::<_, Infallible>(fit_spheres::fit(&positions, &triangles, count, progress)));
    progress(1.0);
    fit
}

/// Spheres in a figure's own frame, bound to its nodes.
pub fn bound(fit: &SphereFit, figure: &Figure, objects: &[VirtualObject]) -> Vec<BoundSphere> {
    let spheres: Vec<(Vec3, f32)> = fit.spheres.iter().map(|s| (s.centre, s.radius)).collect();
    bind(&spheres, figure, objects)
}

/// Gives every figure of a scene the number of spheres that it asks for (figures that have some already keep them);
/// one whose geometry has no area stays without. Everything else as `fit`.
pub fn fit_scene(scene: &mut Scene, cache: Option<&Path>, progress: &mut dyn FnMut(f32)) {
    let total = scene.figures.len().max(1) as f32;
    let Scene { objects, figures, .. } = scene;
    for (index, figure) in figures.iter_mut().enumerate().filter(|(_, figure)| figure.spheres.is_empty()) {
        let mut within = |share: f32| progress((index as f32 + share) / total);
        if let Some(fit) = fit(figure, objects, figure.sphere_count, cache, &mut within) {
            figure.spheres = bound(&fit, figure, objects);
        }
    }
    progress(1.0);
}

/// Spheres of a figure for other programs: for each its node's index and name, centre and radius in that node's frame,
/// and centre and radius in the figure's frame (z up) at rest; with the shares of `SphereFit`.
pub fn to_json(figure: &Figure, fit: &SphereFit, spheres: &[BoundSphere]) -> serde_json::Value {
    let nodes = &figure.skeleton.nodes;
    let row = |(fitted, bound): (&FittedSphere, &BoundSphere)| {
        serde_json::json!({
            "node": bound.node,
            "node_name": nodes.get(bound.node as usize).map_or("", |node| node.name.as_str()),
            "centre_node": bound.centre_node.to_array(),
            "radius_node": bound.radius_node,
            "centre_rest": fitted.centre.to_array(),
            "radius_rest": fitted.radius,
        })
    };
    serde_json::json!({
        "figure": figure.name,
        "count": spheres.len(),
        "outside_share": fit.outside_share,
        "uncovered_share": fit.uncovered_share,
        "mesh_volume": fit.volume,
        "spheres": fit.spheres.iter().zip(spheres).map(row).collect::<Vec<_>>(),
    })
}
