//! Normals for meshes that come without.

use crate::model::scene::Mesh;
use glam::Vec3;
use std::collections::HashMap;

/// Gives a mesh normals that are smooth across edges flatter than `crease_deg` and sharp across the others:
/// each triangle corner takes the mean of the faces around its position, weighted by area, whose normals are
/// within that angle of its own face. Vertices are split where their normals differ and shared where position,
/// tint and normal agree bit for bit. 0 degrees gives flat faces (the rule of glTF 2.0).
///
/// Triangles without area or with an index out of range are dropped; `tints_rgb` that does not match the positions
/// becomes white. Old normals are ignored.
pub fn creased(mesh: &Mesh, crease_deg: f32) -> Mesh {
    creased_from(mesh, crease_deg, &[]).0
}

/// `creased`, and for each vertex of the result the vertex that it came from. Vertices of different `kinds` (one for each
/// vertex, or empty: all of one kind) are never shared.
pub fn creased_from(mesh: &Mesh, crease_deg: f32, kinds: &[u32]) -> (Mesh, Vec<u32>) {
    let limit = crease_deg.to_radians().cos() - 1e-6;
    let sound: Vec<([u32; 3], Vec3)> = mesh
        .triangles
        .iter()
        .filter_map(|&corners| {
            let at = |i: u32| mesh.positions.get(i as usize).map(|p| p.as_dvec3());
            let (a, b, c) = (at(corners[0])?, at(corners[1])?, at(corners[2])?);
            // Twice the area times the normal, in f64 so that slivers keep their direction.
            let normal = (b - a).cross(c - a);
            (normal.is_finite() && normal.length_squared() > 0.0).then(|| (corners, normal.as_vec3()))
        })
        .filter(|(_, normal)| normal.length_squared() > 0.0)
        .collect();
    let mut around: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
    for (face, (corners, _)) in sound.iter().enumerate() {
        for &corner in corners {
            around.entry(bits(mesh.positions[corner as usize])).or_default().push(face as u32);
        }
    }
    let tinted = mesh.tints_rgb.len() == mesh.positions.len();
    let mut out = Mesh::default();
    let mut sources = Vec::new();
    let mut known: HashMap<[u32; 10], u32> = HashMap::new();
    for (corners, face_normal) in &sound {
        let own = face_normal.normalize();
        let triangle = corners.map(|corner| {
            let position = mesh.positions[corner as usize];
            let tint = if tinted { mesh.tints_rgb[corner as usize] } else { [1.0; 3] };
            let normal = if crease_deg <= 0.0 {
                own
            } else {
                let faces = around.get(&bits(position)).map_or(&[][..], Vec::as_slice);
                let near = faces.iter().map(|&face| sound[face as usize].1);
                let sum: Vec3 = near.filter(|n| n.normalize().dot(own) >= limit).sum();
                sum.try_normalize().unwrap_or(own)
            };
            let (p, n, t) = (bits(position), bits(normal), tint.map(f32::to_bits));
            let kind = kinds.get(corner as usize).copied().unwrap_or(0);
            let key = [p[0], p[1], p[2], n[0], n[1], n[2], t[0], t[1], t[2], kind];
            *known.entry(key).or_insert_with(|| {
                sources.push(corner);
                out.positions.push(position);
                out.normals.push(normal);
                out.tints_rgb.push(tint);
                (out.positions.len() - 1) as u32
            })
        });
        out.triangles.push(triangle);
    }
    (out, sources)
}

/// Bits of a point, with -0 taken as 0, so that equal points have equal bits.
fn bits(point: Vec3) -> [u32; 3] {
    (point + Vec3::ZERO).to_array().map(f32::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use glam::DVec3;

    #[test]
    fn a_box_keeps_its_edges_and_a_sphere_loses_them() {
        let cube = shapes::cuboid(DVec3::splat(0.5));
        let again = creased(&cube, 40.0);
        assert_eq!((again.positions.len(), again.triangles.len()), (24, 12));
        let smooth = creased(&cube, 180.0);
        assert_eq!(smooth.positions.len(), 8, "beyond its 90 degrees all edges are smooth");
        let ball = shapes::icosphere(1.0, 3);
        let computed = creased(&Mesh { normals: Vec::new(), ..ball.clone() }, 60.0);
        assert_eq!(computed.positions.len(), ball.positions.len());
        for (p, n) in computed.positions.iter().zip(&computed.normals) {
            // Faces around a vertex of the sphere are not quite symmetric: 0.9997 measured.
            assert!(p.normalize().dot(*n) > 0.999, "{p} {n}");
        }
    }

    #[test]
    fn hopeless_triangles_are_dropped() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NAN, Vec3::X * 2.0],
            triangles: vec![[0, 1, 2], [0, 1, 4], [0, 0, 1], [0, 1, 3], [0, 1, 77]],
            ..Mesh::default()
        };
        let out = creased(&mesh, 0.0);
        assert_eq!((out.triangles.len(), out.normals[0]), (1, Vec3::Z));
        assert!(creased(&Mesh::default(), 30.0).triangles.is_empty());
    }
}
