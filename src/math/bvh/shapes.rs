//! Four triangles, or four spheres, against one ray.

use super::{HitRange, NONE, PreparedRay, ShapeBlock, ShapeHit};
use glam::{BVec4A, Vec3, Vec4};

/// Four triangles: for each corner the x, y and z of all four.
#[derive(Clone, Copy, Debug)]
pub struct TriangleBlock {
    corners: [[Vec4; 3]; 3],
    shapes: [u32; 4],
}

/// The lane of the nearest shape within reach of those in the mask, of several at one distance that of the lowest index.
#[inline]
fn nearest_lane(t: Vec4, mask: BVec4A, shapes: &[u32; 4], reach: &HitRange) -> Option<usize> {
    let within = t.cmpgt(Vec4::splat(reach.t_min)) & t.cmplt(Vec4::splat(reach.t_max));
    let bits = (mask & within & t.cmple(Vec4::splat(reach.nearest))).bitmask();
    let lanes = (0..4usize).filter(|lane| bits >> lane & 1 == 1);
    lanes.reduce(|best, lane| if (t[lane], shapes[lane]) < (t[best], shapes[best]) { lane } else { best })
}

impl ShapeBlock for TriangleBlock {
    type Shape = [Vec3; 3];

    fn bounds(&[a, b, c]: &[Vec3; 3]) -> Option<(Vec3, Vec3)> {
        let (p, q, r) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
        let area = (q - p).cross(r - p).length_squared();
        (area > 0.0 && area.is_finite()).then(|| (a.min(b).min(c), a.max(b).max(c)))
    }

    fn pack(shapes: &[([Vec3; 3], u32)]) -> Self {
        let mut block = Self { corners: [[Vec4::ZERO; 3]; 3], shapes: [NONE; 4] };
        for (lane, (corners, index)) in shapes.iter().take(4).enumerate() {
            block.shapes[lane] = *index;
            for (k, corner) in corners.iter().enumerate() {
                for axis in 0..3 {
                    block.corners[k][axis][lane] = corner[axis];
                }
            }
        }
        block
    }

    /// The test of Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (2013), both sides.
    #[inline]
    fn meet(&self, ray: &PreparedRay, reach: &HitRange) -> Option<ShapeHit> {
        let [x, y, z] = ray.axes;
        let origin = [x, y, z].map(|axis| Vec4::splat(ray.origin[axis]));
        let [shear_x, shear_y, shear_z] = [ray.shear.x, ray.shear.y, ray.shear.z].map(Vec4::splat);
        let sheared = self.corners.each_ref().map(|corner| {
            let depth = corner[z] - origin[2];
            let across = [corner[x] - origin[0] - shear_x * depth, corner[y] - origin[1] - shear_y * depth];
            [across[0], across[1], shear_z * depth]
        });
        let [a, b, c] = &sheared;
        let mut u = c[0] * b[1] - c[1] * b[0];
        let mut v = a[0] * c[1] - a[1] * c[0];
        let mut w = b[0] * a[1] - b[1] * a[0];
        let zero = (u.cmpeq(Vec4::ZERO) | v.cmpeq(Vec4::ZERO) | w.cmpeq(Vec4::ZERO)).bitmask();
        for lane in (0..4usize).filter(|lane| zero >> lane & 1 == 1 && self.shapes[*lane] != NONE) {
            let edge = |p: &[Vec4; 3], q: &[Vec4; 3]| {
                let [p, q] = [p, q].map(|p| [f64::from(p[0][lane]), f64::from(p[1][lane])]);
                (p[0] * q[1] - p[1] * q[0]) as f32
            };
            (u[lane], v[lane], w[lane]) = (edge(c, b), edge(a, c), edge(b, a));
        }
        let least = u.min(v).min(w);
        let most = u.max(v).max(w);
        let determinant = u + v + w;
        let inside = (least.cmpge(Vec4::ZERO) | most.cmple(Vec4::ZERO)) & determinant.cmpne(Vec4::ZERO);
        if !inside.any() {
            return None;
        }
        let weights = [u / determinant, v / determinant, w / determinant];
        let t = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
        let lane = nearest_lane(t, inside, &self.shapes, reach)?;
        Some(ShapeHit { t: t[lane], shape: self.shapes[lane], weights: weights.map(|weight| weight[lane]) })
    }
}

/// Four spheres: centres and squared radii of all four.
#[derive(Clone, Copy, Debug)]
pub struct SphereBlock {
    centre: [Vec4; 3],
    radius: Vec4,
    shapes: [u32; 4],
}

impl ShapeBlock for SphereBlock {
    type Shape = (Vec3, f32);

    fn bounds(&(centre, radius): &(Vec3, f32)) -> Option<(Vec3, Vec3)> {
        let sound = centre.is_finite() && radius.is_finite() && radius > 0.0;
        sound.then(|| (centre - Vec3::splat(radius), centre + Vec3::splat(radius)))
    }

    fn pack(shapes: &[((Vec3, f32), u32)]) -> Self {
        let mut block = Self { centre: [Vec4::ZERO; 3], radius: Vec4::splat(-1.0), shapes: [NONE; 4] };
        for (lane, ((centre, radius), index)) in shapes.iter().take(4).enumerate() {
            block.shapes[lane] = *index;
            block.radius[lane] = *radius;
            for axis in 0..3 {
                block.centre[axis][lane] = centre[axis];
            }
        }
        block
    }

    /// By the vector from the centre to the ray's nearest point, which keeps its digits where the sphere is far.
    #[inline]
    fn meet(&self, ray: &PreparedRay, reach: &HitRange) -> Option<ShapeHit> {
        let d = ray.direction.to_array().map(Vec4::splat);
        let o = ray.origin.to_array().map(Vec4::splat);
        let to = [self.centre[0] - o[0], self.centre[1] - o[1], self.centre[2] - o[2]];
        let square = Vec4::splat(ray.direction.length_squared());
        let middle = (to[0] * d[0] + to[1] * d[1] + to[2] * d[2]) / square;
        let across = [to[0] - middle * d[0], to[1] - middle * d[1], to[2] - middle * d[2]];
        let distance = across[0] * across[0] + across[1] * across[1] + across[2] * across[2];
        let room = self.radius * self.radius - distance;
        let met = room.cmpgt(Vec4::ZERO) & self.radius.cmpgt(Vec4::ZERO);
        if !met.any() {
            return None;
        }
        let half = (room.max(Vec4::ZERO) / square).sqrt();
        let (near, far) = (middle - half, middle + half);
        let t = Vec4::select(near.cmpgt(Vec4::splat(reach.t_min)), near, far);
        let lane = nearest_lane(t, met, &self.shapes, reach)?;
        Some(ShapeHit { t: t[lane], shape: self.shapes[lane], weights: [0.0; 3] })
    }
}
