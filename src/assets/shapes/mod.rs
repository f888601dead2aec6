//! Meshes by rule: no file needed. All are in metres, z up, triangles counter-clockwise seen from outside, unit
//! normals, white tints. Sizes are taken as they are: a negative or zero one gives a degenerate mesh, never a panic.

mod lathe;
mod tube;

pub use lathe::{ProfilePoint, lathe, pawn, vase};
pub use tube::{torus, torus_knot};

use crate::model::scene::Mesh;
use glam::{Affine3A, DQuat, DVec3, Mat3A, Vec3};
use std::{collections::HashMap, f64::consts::TAU};

/// Adds a vertex and returns its index.
fn push(mesh: &mut Mesh, position: DVec3, normal: DVec3) -> u32 {
    mesh.positions.push(position.as_vec3());
    mesh.normals.push(normal.normalize_or(DVec3::Z).as_vec3());
    mesh.tints_rgb.push([1.0; 3]);
    (mesh.positions.len() - 1) as u32
}

/// A parallelogram from its corners in order; the front is the side that sees them counter-clockwise, normal
/// (v1 - v0) x (v3 - v0).
pub fn quad(corners: [DVec3; 4]) -> Mesh {
    let mut mesh = Mesh::default();
    let normal = (corners[1] - corners[0]).cross(corners[3] - corners[0]);
    for corner in corners {
        push(&mut mesh, corner, normal);
    }
    mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
    mesh
}

/// The square |x|, |y| <= half_extent in z = 0, front up.
pub fn plane_z0(half_extent: f64) -> Mesh {
    let e = half_extent;
    quad([[-e, -e], [e, -e], [e, e], [-e, e]].map(|[x, y]| DVec3::new(x, y, 0.0)))
}

/// A box about the origin, with sharp edges: 24 vertices, 12 triangles.
pub fn cuboid(half_size: DVec3) -> Mesh {
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut normal = DVec3::ZERO;
            normal[axis] = sign;
            let mut side = DVec3::ZERO;
            side[(axis + 1) % 3] = 1.0;
            let up = normal.cross(side);
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(s, u)| push(&mut mesh, (normal + side * s + up * u) * half_size, normal));
            mesh.triangles.push([corners[0], corners[1], corners[2]]);
            mesh.triangles.push([corners[0], corners[2], corners[3]]);
        }
    }
    mesh
}

/// A sphere about the origin by subdividing an icosahedron: 20 * 4^subdivisions triangles of about equal size (at
/// most 7 subdivisions are made), vertices on the sphere, exact normals. Edges of the silhouette lie inside the
/// sphere by radius * 0.22 / 4^subdivisions at most.
pub fn icosphere(radius: f64, subdivisions: u32) -> Mesh {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut points: Vec<DVec3> = Vec::new();
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        points.extend([DVec3::new(a, b, 0.0), DVec3::new(0.0, a, b), DVec3::new(b, 0.0, a)]);
    }
    points.iter_mut().for_each(|p| *p = p.normalize());
    // Faces: the triples of mutually nearest points, turned outwards.
    let near = |a: usize, b: usize| points[a].dot(points[b]) > 0.4;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let outward = points[a].dot(points[b].cross(points[c])) > 0.0;
                    triangles.push(if outward { [a, b, c] } else { [a, c, b] }.map(|i| i as u32));
                }
            }
        }
    }
    for _ in 0..subdivisions.min(7) {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                (points.len() - 1) as u32
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let mut mesh = Mesh { triangles, ..Mesh::default() };
    points.iter().for_each(|&p| {
        push(&mut mesh, p * radius, p);
    });
    mesh
}

/// A sphere about the origin by meridians and parallels, exact normals. At least 3 meridians and 2 bands.
pub fn uv_sphere(radius: f64, meridians: u32, bands: u32) -> Mesh {
    let bands = bands.max(2);
    let profile: Vec<(f64, f64, f64, f64)> = (0..=bands)
        .map(|k| {
            let (sine, cosine) = (TAU / 2.0 * f64::from(k) / f64::from(bands)).sin_cos();
            let sine = if k == 0 || k == bands { 0.0 } else { sine };
            (radius * sine, -radius * cosine, sine, -cosine)
        })
        .collect();
    revolve(&[profile], meridians)
}

/// A cylinder about the z axis with its base in z = 0, closed, sharp rims.
pub fn cylinder(radius: f64, height: f64, segments: u32) -> Mesh {
    revolve(
        &[
            vec![(0.0, 0.0, 0.0, -1.0), (radius, 0.0, 0.0, -1.0)],
            vec![(radius, 0.0, 1.0, 0.0), (radius, height, 1.0, 0.0)],
            vec![(radius, height, 0.0, 1.0), (0.0, height, 0.0, 1.0)],
        ],
        segments,
    )
}

/// A cylinder about the z axis with half spheres at both ends; z from 0 to `height` over all (at least 2 radius).
pub fn capsule(radius: f64, height: f64, segments: u32) -> Mesh {
    let steps = segments.clamp(4, 4096) / 2;
    let arc = |from: f64, centre_z: f64| {
        (0..=steps).map(move |k| {
            let (sine, cosine) = (from + TAU / 4.0 * f64::from(k) / f64::from(steps)).sin_cos();
            let cosine = if cosine.abs() < 1e-12 { 0.0 } else { cosine };
            (radius * cosine, centre_z + radius * sine, cosine, sine)
        })
    };
    let top = (height - radius).max(radius);
    revolve(&[arc(-TAU / 4.0, radius).chain(arc(0.0, top)).collect()], segments)
}

/// Turns pieces of a profile about the z axis. A piece is a list of (radius, z, normal's radial part, normal's z)
/// from bottom to top as seen with the outside to the right; between pieces the surface has a crease.
fn revolve(pieces: &[Vec<(f64, f64, f64, f64)>], segments: u32) -> Mesh {
    let segments = segments.clamp(3, 4096);
    let mut mesh = Mesh::default();
    for piece in pieces {
        let mut last: Option<Vec<u32>> = None;
        for (k, &(radius, z, normal_r, normal_z)) in piece.iter().enumerate() {
            let ring: Vec<u32> = (0..segments)
                .map(|s| {
                    // A point on the axis has one vertex a segment, in the middle of it.
                    let shift = if radius == 0.0 { 0.5 } else { 0.0 };
                    let (sine, cosine) = (TAU * (f64::from(s) + shift) / f64::from(segments)).sin_cos();
                    let normal = DVec3::new(normal_r * cosine, normal_r * sine, normal_z);
                    push(&mut mesh, DVec3::new(radius * cosine, radius * sine, z), normal)
                })
                .collect();
            if let Some(below) = &last {
                for s in 0..segments as usize {
                    let next = (s + 1) % segments as usize;
                    if piece[k - 1].0 != 0.0 {
                        let top = if radius == 0.0 { ring[s] } else { ring[next] };
                        mesh.triangles.push([below[s], below[next], top]);
                    }
                    if radius != 0.0 {
                        mesh.triangles.push([below[s], ring[next], ring[s]]);
                    }
                }
            }
            last = Some(ring);
        }
    }
    mesh
}

/// A mesh in another frame: positions by `transform`, normals by its cofactor matrix; mirrored transforms turn the
/// triangles so that fronts stay fronts.
pub fn transformed(mesh: &Mesh, transform: &Affine3A) -> Mesh {
    let m = transform.matrix3;
    let mirrored = m.determinant() < 0.0;
    let sign = if mirrored { -1.0 } else { 1.0 };
    let cofactor = Mat3A::from_cols(
        m.y_axis.cross(m.z_axis) * sign,
        m.z_axis.cross(m.x_axis) * sign,
        m.x_axis.cross(m.y_axis) * sign,
    );
    Mesh {
        positions: mesh.positions.iter().map(|&p| transform.transform_point3(p)).collect(),
        normals: mesh.normals.iter().map(|&n| unit(cofactor * n, n)).collect(),
        tints_rgb: mesh.tints_rgb.clone(),
        triangles: mesh
            .triangles
            .iter()
            .map(|&[a, b, c]| if mirrored { [a, c, b] } else { [a, b, c] })
            .collect(),
    }
}

/// Unit length whatever the scale; `otherwise` where there is no direction.
fn unit(vector: Vec3, otherwise: Vec3) -> Vec3 {
    let v = vector.as_dvec3();
    let length = v.length();
    if length > 0.0 && length.is_finite() { (v / length).as_vec3() } else { otherwise }
}

/// Several meshes as one.
pub fn merged(meshes: &[Mesh]) -> Mesh {
    let mut out = Mesh::default();
    for mesh in meshes {
        let base = out.positions.len() as u32;
        out.positions.extend(&mesh.positions);
        out.normals.extend(&mesh.normals);
        out.tints_rgb.extend(&mesh.tints_rgb);
        out.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + base)));
    }
    out
}

/// The demonstration's still life in one mesh, standing on z = 0: a pawn of the given height with a ring that
/// leans against it. Its shadow has a straight part, a round one and a hole.
pub fn pawn_with_ring(height: f64) -> Mesh {
    let (ring_radius, wire_radius) = (0.31 * height, 0.045 * height);
    let lean = 0.25f64;
    // The ring stands on the table and leans on the rim of the pawn's collar, 0.195 wide at 0.65 of the height.
    let ring = torus(ring_radius, wire_radius, 72, 24);
    let rotation = DQuat::from_rotation_y(TAU / 4.0 - lean);
    let top_x = 0.202 * height + wire_radius;
    let foot = DVec3::new(top_x + ring_radius * lean.sin(), 0.0, ring_radius * lean.cos() + wire_radius);
    let place = Affine3A::from_rotation_translation(rotation.as_quat(), foot.as_vec3());
    merged(&[pawn(height, 64), transformed(&ring, &place)])
}

/// Lowest and highest corner of a mesh; `None` where it has no vertices.
pub fn bounds(mesh: &Mesh) -> Option<(Vec3, Vec3)> {
    let first = *mesh.positions.first()?;
    Some(mesh.positions.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p))))
}

#[cfg(test)]
mod tests;
