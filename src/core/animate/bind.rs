//! Which node each sphere of a figure moves with.

use super::clip::figure_from_nodes_at_rest;
use crate::model::{
    animation::{Attachment, BoundSphere, Figure},
    scene::VirtualObject,
};
use glam::{Affine3A, Vec3};

/// Vertices within this many radii of a sphere's centre speak for their joints.
const NEAR: f32 = 1.25;

/// Binds spheres, given as centre and radius in the figure's frame at rest, to the figure's nodes: each to the one that
/// has the largest sum of skin weights, times the area around the vertex, over the vertices near it (1.25 radii; where
/// there are none, the nearest vertex). `objects` are the scene's, as the figure's parts count them. In the order given;
/// spheres of a figure without nodes or vertices are left out.
pub fn bind(spheres: &[(Vec3, f32)], figure: &Figure, objects: &[VirtualObject]) -> Vec<BoundSphere> {
    let figure_from_node = figure_from_nodes_at_rest(&figure.skeleton);
    let vertices = weighed(figure, objects);
    let mut votes = vec![0.0f64; figure_from_node.len()];
    spheres
        .iter()
        .filter_map(|&(centre, radius)| {
            votes.fill(0.0);
            let near = (NEAR * radius).powi(2);
            for vertex in vertices.iter().filter(|v| v.position.distance_squared(centre) <= near) {
                vertex.vote(&mut votes);
            }
            if votes.iter().all(|&v| v == 0.0) {
                let distance = |v: &&Weighed| v.position.distance_squared(centre);
                vertices.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?.vote(&mut votes);
            }
            // The first of equals.
            let node = (0..votes.len()).rev().max_by(|&a, &b| votes[a].total_cmp(&votes[b]))?;
            let node_from_figure = inverse(figure_from_node.get(node)?)?;
            let scale = node_from_figure.matrix3.determinant().abs().cbrt();
            Some(BoundSphere {
                node: node as u32,
                centre_node: node_from_figure.transform_point3(centre),
                radius_node: radius * scale,
            })
        })
        .collect()
}

struct Weighed {
    position: Vec3,
    area: f64,
    nodes: [(u32, f32); 4],
}

impl Weighed {
    fn vote(&self, votes: &mut [f64]) {
        for &(node, weight) in &self.nodes {
            if let Some(vote) = votes.get_mut(node as usize) {
                // Even a vertex of no area counts, where it is alone.
                *vote += f64::from(weight) * self.area.max(1e-30);
            }
        }
    }
}

/// Every vertex of the figure at rest with a third of its triangles' areas.
fn weighed(figure: &Figure, objects: &[VirtualObject]) -> Vec<Weighed> {
    let node_of = |joint: u16| figure.skeleton.joints.get(joint as usize).map_or(u32::MAX, |j| j.node);
    let mut all = Vec::new();
    for part in &figure.parts {
        let Some(mesh) = objects.get(part.object).map(|object| &object.mesh) else { continue };
        let first = all.len();
        for (vertex, &position) in mesh.positions.iter().enumerate() {
            let nodes = match &part.attachment {
                Attachment::Rigid { joint } => [(node_of(*joint), 1.0), (0, 0.0), (0, 0.0), (0, 0.0)],
                Attachment::Skinned { joints, weights, .. } => {
                    let (Some(joints), Some(weights)) = (joints.get(vertex), weights.get(vertex)) else {
                        continue;
                    };
                    std::array::from_fn(|k| (node_of(joints[k]), weights[k]))
                }
            };
            all.push(Weighed { position, area: 0.0, nodes });
        }
        for triangle in &mesh.triangles {
            let corner = |i: u32| mesh.positions.get(i as usize).map(|p| p.as_dvec3());
            let [Some(a), Some(b), Some(c)] = triangle.map(corner) else { continue };
            let area = (b - a).cross(c - a).length() / 6.0;
            for &i in triangle {
                if let Some(vertex) = all.get_mut(first + i as usize) {
                    vertex.area += area;
                }
            }
        }
    }
    all
}

fn inverse(matrix: &Affine3A) -> Option<Affine3A> {
    let inverse = matrix.inverse();
    inverse.is_finite().then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{
        animation::{FigurePart, Joint, Skeleton, SkeletonNode, Transform},
        scene::{Material, Mesh},
    };

    /// Two nodes, the second 4 m above the first and twice as large; a ladder of triangles whose lower half hangs on
    /// the first.
    fn figure() -> (Figure, Vec<VirtualObject>) {
        let up = Transform { translation: Vec3::Z * 4.0, scale: Vec3::splat(2.0), ..Transform::IDENTITY };
        let node = |parent, rest| SkeletonNode { name: String::new(), parent, rest };
        let mut mesh = Mesh::default();
        let mut joints = Vec::new();
        for step in 0..9 {
            let z = step as f32;
            mesh.positions.extend([Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)]);
            mesh.triangles.push([3 * step, 3 * step + 1, 3 * step + 2]);
            joints.extend([[u16::from(step >= 4), 0, 0, 0]; 3]);
        }
        mesh.normals = vec![Vec3::Z; 27];
        let attachment = Attachment::Skinned {
            bind_positions: mesh.positions.clone(),
            bind_normals: mesh.normals.clone(),
            joints,
            weights: vec![[1.0, 0.0, 0.0, 0.0]; 27],
        };
        let object = VirtualObject {
            name: "ladder".into(),
            openness: vec![1.0; 27],
            mesh,
            material: Material::Lambert { albedo_rgb: [0.5; 3] },
            world_from_object: Affine3A::IDENTITY,
        };
        let figure = Figure {
            name: "ladder".into(),
            skeleton: Skeleton {
                nodes: vec![node(None, Transform::IDENTITY), node(Some(0), up)],
                joints: [0, 1].map(|node| Joint { node, node_from_bind: Affine3A::IDENTITY }).to_vec(),
                figure_from_root: Affine3A::IDENTITY,
            },
            clips: Vec::new(),
            parts: vec![FigurePart { object: 0, attachment }],
            world_from_figure: Affine3A::IDENTITY,
            playing: None,
            walk: None,
            sphere_count: 4,
            spheres: Vec::new(),
            boxes: Vec::new(),
        };
        (figure, vec![object])
    }

    #[test]
    fn spheres_go_with_the_vertices_around_them() {
        let (figure, objects) = figure();
        let spheres =
            [(Vec3::new(0.2, 0.2, 1.0), 1.0), (Vec3::new(0.2, 0.2, 6.0), 1.0), (Vec3::Z * 90.0, 0.5)];
        let bound = bind(&spheres, &figure, &objects);
        assert_eq!(bound.iter().map(|s| s.node).collect::<Vec<_>>(), [0, 1, 1]);
        assert_eq!((bound[0].centre_node, bound[0].radius_node), (Vec3::new(0.2, 0.2, 1.0), 1.0));
        assert!(bound[1].centre_node.abs_diff_eq(Vec3::new(0.1, 0.1, 1.0), 1e-6), "{}", bound[1].centre_node);
        assert!((bound[1].radius_node - 0.5).abs() < 1e-6);
        // At the border the larger share of the surface within reach decides: steps 2, 3 against 4, 5, 6.
        let border = bind(&[(Vec3::new(0.2, 0.2, 4.2), 1.8)], &figure, &objects);
        assert_eq!(border[0].node, 1);
        assert!(bind(&spheres, &figure, &[]).is_empty());
    }
}
