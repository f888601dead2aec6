//! Vertices where their joints take them (linear blend skinning; glTF 2.0, 3.7.3.3).

use glam::{Affine3A, Mat3A, Vec3, Vec3A};

/// Positions and normals of a mesh, by their joints' matrices `out_from_bind` (index = joint). Writes one position and
/// one unit normal for each entry of `positions_out`; all lists must be as long, shorter ones leave the rest as it is.
/// A joint that does not exist counts as none; a position that leaves the range of f32 becomes the origin.
///
/// Normals go by the cofactors of the blended matrix, so they stay across the surface under any scale, and outside
/// where it mirrors; one that has no direction left keeps its bind direction.
pub fn deform(
    bind_positions: &[Vec3],
    bind_normals: &[Vec3],
    joints: &[[u16; 4]],
    weights: &[[f32; 4]],
    out_from_bind: &[Affine3A],
    (positions_out, normals_out): (&mut [Vec3], &mut [Vec3]),
) {
    let bind = bind_positions.iter().zip(bind_normals).zip(joints.iter().zip(weights));
    for ((position_out, normal_out), ((&position, &normal), (joints, weights))) in
        positions_out.iter_mut().zip(normals_out).zip(bind)
    {
        let blended = blend(joints, weights, out_from_bind);
        *position_out = finite(blended.transform_point3(position));
        *normal_out = turned(&blended.matrix3, normal);
    }
}

/// Positions and normals of a mesh by one matrix; else as `deform`.
pub fn move_rigidly(
    positions: &[Vec3],
    normals: &[Vec3],
    out_from_mesh: &Affine3A,
    (positions_out, normals_out): (&mut [Vec3], &mut [Vec3]),
) {
    for (out, &position) in positions_out.iter_mut().zip(positions) {
        *out = finite(out_from_mesh.transform_point3(position));
    }
    for (out, &normal) in normals_out.iter_mut().zip(normals) {
        *out = turned(&out_from_mesh.matrix3, normal);
    }
}

fn finite(position: Vec3) -> Vec3 {
    if position.is_finite() { position } else { Vec3::ZERO }
}

fn blend(joints: &[u16; 4], weights: &[f32; 4], matrices: &[Affine3A]) -> Affine3A {
    let mut sum = Affine3A { matrix3: Mat3A::ZERO, translation: Vec3A::ZERO };
    for (&joint, &weight) in joints.iter().zip(weights) {
        if weight == 1.0 {
            return matrices.get(joint as usize).copied().unwrap_or(sum);
        }
        if weight > 0.0
            && let Some(matrix) = matrices.get(joint as usize)
        {
            sum.matrix3 += matrix.matrix3 * weight;
            sum.translation += matrix.translation * weight;
        }
    }
    sum
}

/// A normal through a matrix's cofactors, unit.
fn turned(m: &Mat3A, normal: Vec3) -> Vec3 {
    let (a, b) = (m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis));
    let n = a * normal.x + b * normal.y + m.x_axis.cross(m.y_axis) * normal.z;
    let n = if m.x_axis.dot(a) < 0.0 { -n } else { n };
    // Brought near 1 first: cofactors are squares, and their squares may leave f32.
    let largest = n.abs().max_element();
    if largest > 0.0 && largest.is_finite() {
        Vec3::from((n / largest).normalize())
    } else {
        normal.normalize_or(Vec3::Z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    fn moved(matrices: &[Affine3A], joints: [u16; 4], weights: [f32; 4], p: Vec3, n: Vec3) -> (Vec3, Vec3) {
        let (mut positions, mut normals) = ([Vec3::NAN], [Vec3::NAN]);
        deform(&[p], &[n], &[joints], &[weights], matrices, (&mut positions, &mut normals));
        (positions[0], normals[0])
    }

    #[test]
    fn weights_mix_and_normals_stay_across() {
        let up = Affine3A::from_translation(Vec3::Z * 4.0);
        let turn = Affine3A::from_quat(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2));
        let all = [Affine3A::IDENTITY, up, turn];
        let (p, n) = moved(&all, [0, 1, 0, 0], [0.25, 0.75, 0.0, 0.0], Vec3::X, Vec3::Y);
        assert_eq!((p, n), (Vec3::new(1.0, 0.0, 3.0), Vec3::Y));
        let (p, n) = moved(&all, [2, 0, 0, 0], [1.0, 0.0, 0.0, 0.0], Vec3::Y, Vec3::Y);
        assert!(p.abs_diff_eq(Vec3::Z, 1e-6) && n.abs_diff_eq(Vec3::Z, 1e-6), "{p} {n}");
        // Halfway between 0 and 90 degrees: the normal at 45.
        let (_, n) = moved(&all, [0, 2, 0, 0], [0.5, 0.5, 0.0, 0.0], Vec3::Y, Vec3::Y);
        assert!(n.abs_diff_eq(Vec3::new(0.0, 0.5f32.sqrt(), 0.5f32.sqrt()), 1e-6), "{n}");
    }

    #[test]
    fn uneven_scale_mirrors_and_collapse_leave_a_unit_normal() {
        // The plane x + y = const squeezed to half in x becomes 2x + y = const.
        let squeeze = Affine3A::from_scale(Vec3::new(0.5, 1.0, 1.0));
        let slant = Vec3::new(1.0, 1.0, 0.0).normalize();
        let one = [1.0, 0.0, 0.0, 0.0];
        let (_, n) = moved(&[squeeze], [0; 4], one, Vec3::ZERO, slant);
        assert!(n.abs_diff_eq(Vec3::new(2.0, 1.0, 0.0).normalize(), 1e-6), "{n}");
        let mirror = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
        assert_eq!(moved(&[mirror], [0; 4], one, Vec3::X, Vec3::X), (-Vec3::X, -Vec3::X));
        for scale in [0.0, 1e-30, 1e18] {
            let (_, n) = moved(&[Affine3A::from_scale(Vec3::splat(scale))], [0; 4], one, Vec3::X, slant);
            assert!((n.length() - 1.0).abs() < 1e-6, "{scale}: {n}");
        }
        let (p, n) = moved(&[], [7; 4], one, Vec3::X, Vec3::X);
        assert_eq!((p, n), (Vec3::ZERO, Vec3::X), "no such joint");
    }
}
