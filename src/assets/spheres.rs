//! Spheres of figures, and boxes for their thin parts: fitted, bound to nodes, kept in a folder from run to run, and as JSON.

use super::kept::Cache;
use crate::animate::{bind::bind, posed::Posed};
use crate::model::{
    animation::{Attachment, BoundBox, BoundSphere, Figure},
    keep::{Keeper, KeptInput},
    scene::{Scene, VirtualObject},
};
use crate::visibility::{
    fit_boxes,
    fit_spheres::{self, FittedSphere, SphereFit},
};
use glam::{Affine3A, Vec3};
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

/// Boxes for the thin parts of a figure's rigid pieces, bound to its nodes: at most as many as it has spheres, and
/// [`fit_boxes::MAX_BOXES`]. What is skinned has none: it bends.
pub fn boxes(figure: &Figure, objects: &[VirtualObject], count: usize) -> Vec<BoundBox> {
    let mut found = Vec::new();
    for part in &figure.parts {
        let Attachment::Rigid { joint } = part.attachment else { continue };
        let (Some(object), Some(joint)) =
            (objects.get(part.object), figure.skeleton.joints.get(joint as usize))
        else {
            continue;
        };
        let most = count.min(fit_boxes::MAX_BOXES) - found.len();
        let fitted = fit_boxes::fit(&object.mesh.positions, &object.mesh.triangles, most);
        let matrix = joint.node_from_bind;
        found.extend(fitted.iter().map(|fitted| {
            let axes = fitted.axes.map(|axis| matrix.transform_vector3(axis));
            BoundBox {
                node: joint.node,
                centre_node: matrix.transform_point3(fitted.centre),
                axes_node: axes.map(Vec3::normalize_or_zero),
                half_node: fitted.half * Vec3::from(axes.map(Vec3::length)),
            }
        }));
    }
    found
}

/// Gives every figure of a scene the number of spheres that it asks for, and boxes for its thin parts (figures that have
/// spheres already keep what they have); one whose geometry has no area stays without. Everything else as `fit`.
pub fn fit_scene(scene: &mut Scene, cache: Option<&Path>, progress: &mut dyn FnMut(f32)) {
    let total = scene.figures.len().max(1) as f32;
    let Scene { objects, figures, .. } = scene;
    for (index, figure) in figures.iter_mut().enumerate().filter(|(_, figure)| figure.spheres.is_empty()) {
        let mut within = |share: f32| progress((index as f32 + share) / total);
        if let Some(fit) = fit(figure, objects, figure.sphere_count, cache, &mut within) {
            figure.spheres = bound(&fit, figure, objects);
            figure.boxes = boxes(figure, objects, figure.sphere_count);
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

/// What blocks soft light of a figure at rest, and what it leaves uncovered.
#[derive(Clone, Debug)]
pub struct Blocking {
    /// For its thin parts.
    pub boxes: Vec<BoundBox>,
    /// Spheres in place of which no box stands.
    pub spheres: usize,
    /// Volume of the mesh in none of both, over the mesh's volume.
    pub uncovered_share: f32,
}

impl Blocking {
    /// Above this share a note is due: soft shadows are too weak by about so much.
    const MUCH: f32 = 0.3;

    /// Finds boxes for a figure that has been given spheres.
    pub fn of(figure: &Figure, objects: &[VirtualObject], spheres: &[BoundSphere], count: usize) -> Self {
        let boxes = boxes(figure, objects, count);
        let mut at_rest = figure.clone();
        (at_rest.spheres, at_rest.boxes) = (spheres.to_vec(), boxes.clone());
        (at_rest.playing, at_rest.walk) = (None, None);
        at_rest.world_from_figure = Affine3A::IDENTITY;
        let scene = Scene { objects: objects.to_vec(), figures: vec![at_rest], ..Scene::default() };
        let posed = Posed::new(&scene);
        let (positions, triangles) = geometry(figure, objects);
        let covers = |point: Vec3| {
            posed.boxes().iter().any(|b| b.holds(point, 0.0))
                || posed.blocking().iter().any(|s| s.centre_world.distance(point) <= s.radius_m)
        };
        let uncovered_share = fit_spheres::uncovered_share(&positions, &triangles, covers).unwrap_or(0.0);
        Self { boxes, spheres: posed.blocking().len(), uncovered_share }
    }

    /// Puts it beside what `to_json` gives.
    pub fn add_to_json(&self, figure: &Figure, json: &mut serde_json::Value) {
        let nodes = &figure.skeleton.nodes;
        let row = |b: &BoundBox| {
            serde_json::json!({
                "node": b.node,
                "node_name": nodes.get(b.node as usize).map_or("", |node| node.name.as_str()),
                "centre_node": b.centre_node.to_array(),
                "axes_node": b.axes_node.map(|axis| axis.to_array()),
                "half_node": b.half_node.to_array(),
            })
        };
        json["boxes"] = self.boxes.iter().map(row).collect();
        json["blocking_spheres"] = self.spheres.into();
        json["uncovered_share_with_boxes"] = self.uncovered_share.into();
    }

    /// In words; nothing where spheres alone do and cover enough.
    pub fn said(&self) -> String {
        let uncovered = 100.0 * self.uncovered_share;
        let mut said = String::new();
        if !self.boxes.is_empty() {
            let (boxes, spheres) = (self.boxes.len(), self.spheres);
            said += &format!(
                "\n{boxes} boxes for thin parts, {spheres} spheres for the rest: {uncovered:.1} % uncovered"
            );
        }
        if self.uncovered_share > Self::MUCH {
            said += &format!("\nnote: {uncovered:.1} % of the model has nothing that throws its soft shadow");
        }
        said
    }
}
