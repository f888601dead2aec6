//! The bodies made ready for rays: real ones, and virtual ones.

use super::scene::{Emission, TraceBody, TraceShape};
use crate::math::bvh::{PreparedRay, ShapeHit, ShapeTree, SphereBlock, TriangleBlock};
use crate::model::scene::Material;
use glam::Vec3;

/// A ray starts so far off a surface, as a share of the size of the coordinates of its triangle or sphere: about 30
/// roundings of f32; the hit itself is good to a few.
const OFFSET_SHARE: f32 = 2e-6;
/// And at least so far, metres.
const LEAST_OFFSET_M: f32 = 1e-6;

/// One triangle of a body.
#[derive(Clone, Copy, Debug)]
struct Facet {
    body: u32,
    /// Index into the body's triangles.
    triangle: u32,
    /// Unit, away from the front.
    normal: Vec3,
    offset_m: f32,
}

/// Bodies of one kind.
#[derive(Debug, Default)]
pub struct Bodies {
    bodies: Vec<TraceBody>,
    triangles: ShapeTree<TriangleBlock>,
    spheres: ShapeTree<SphereBlock>,
    facets: Vec<Facet>,
    /// Body of each sphere.
    balls: Vec<u32>,
}

/// What a ray met.
#[derive(Clone, Copy, Debug)]
pub enum MetBody {
    /// A triangle.
    Facet(ShapeHit),
    /// A sphere.
    Ball(ShapeHit),
}

impl MetBody {
    /// In lengths of the ray's direction.
    #[inline]
    pub fn t(&self) -> f32 {
        match self {
            Self::Facet(hit) | Self::Ball(hit) => hit.t,
        }
    }
}

/// A point of a surface, seen from one side.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceMeeting {
    /// World frame, metres.
    pub point: Vec3,
    /// Unit, geometric, on the side that is seen.
    pub facing: Vec3,
    /// Unit, interpolated, on the same side where possible.
    pub shading: Vec3,
    /// Rays from here start so far off, metres.
    pub offset_m: f32,
    /// How this side reflects; `None`: not at all.
    pub material: Option<Material>,
    /// What this side sends out.
    pub emission: Emission,
    /// Whether suns shine through.
    pub is_aperture: bool,
}

impl Bodies {
    /// Makes bodies ready.
    pub fn new(bodies: &[TraceBody]) -> Self {
        let (mut corners, mut facets, mut spheres, mut balls) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (index, body) in bodies.iter().enumerate() {
            match &body.shape {
                TraceShape::Sphere { centre, radius_m } => {
                    spheres.push((*centre, *radius_m));
                    balls.push(index as u32);
                }
                TraceShape::Mesh(mesh) => {
                    for (triangle, t) in mesh.triangles.iter().enumerate() {
                        let corner = |i: u32| mesh.positions.get(i as usize).copied();
                        let [Some(a), Some(b), Some(c)] = t.map(corner) else { continue };
                        let cross = (b - a).as_dvec3().cross((c - a).as_dvec3());
                        let size = a.abs().max(b.abs()).max(c.abs()).max_element();
                        corners.push([a, b, c]);
                        facets.push(Facet {
                            body: index as u32,
                            triangle: triangle as u32,
                            normal: cross.normalize_or_zero().as_vec3(),
                            offset_m: OFFSET_SHARE * size + LEAST_OFFSET_M,
                        });
                    }
                }
            }
        }
        Self {
            bodies: bodies.to_vec(),
            triangles: ShapeTree::build(corners.into_iter()),
            spheres: ShapeTree::build(spheres.into_iter()),
            facets,
            balls,
        }
    }

    /// Whether what is behind a body's surface may matter to light that comes along a ray: then the nearest has to be known.
    pub fn has_surroundings(&self) -> bool {
        self.bodies.iter().any(|b| b.emission == Emission::Surroundings)
    }

    /// Whether there are windows.
    pub fn has_apertures(&self) -> bool {
        self.bodies.iter().any(|b| b.is_aperture)
    }

    /// All triangles that shine, with what they send out.
    pub fn shining(&self) -> Vec<([Vec3; 3], [f32; 3])> {
        let mut found = Vec::new();
        for facet in &self.facets {
            let body = &self.bodies[facet.body as usize];
            let (Emission::Own(rgb) | Emission::Measured(rgb)) = body.emission else { continue };
            if let TraceShape::Mesh(mesh) = &body.shape {
                let corners = mesh.triangles[facet.triangle as usize].map(|i| mesh.positions[i as usize]);
                found.push((corners, rgb));
            }
        }
        found
    }

    /// The nearest body on a ray within (0, t_max).
    #[inline]
    pub fn nearest(&self, ray: &PreparedRay, t_max: f32) -> Option<MetBody> {
        let facet = self.triangles.nearest(ray, 0.0, t_max);
        let limit = facet.map_or(t_max, |hit| hit.t);
        match self.spheres.nearest(ray, 0.0, limit) {
            Some(ball) => Some(MetBody::Ball(ball)),
            None => facet.map(MetBody::Facet),
        }
    }

    /// Whether any body lies on a ray within (0, t_max).
    #[inline]
    pub fn occluded(&self, ray: &PreparedRay, t_max: f32) -> bool {
        self.triangles.occluded(ray, 0.0, t_max) || self.spheres.occluded(ray, 0.0, t_max)
    }

    /// What is there where a ray met a body.
    pub fn meeting(&self, ray: &PreparedRay, met: &MetBody) -> SurfaceMeeting {
        match met {
            MetBody::Ball(hit) => {
                let body = &self.bodies[self.balls[hit.shape as usize] as usize];
                let (centre, radius) = match body.shape {
                    TraceShape::Sphere { centre, radius_m } => (centre, radius_m),
                    TraceShape::Mesh(_) => (Vec3::ZERO, 1.0),
                };
                let normal = (ray.origin + hit.t * ray.direction - centre).normalize_or(Vec3::Z);
                let is_front = normal.dot(ray.direction) <= 0.0;
                let facing = if is_front { normal } else { -normal };
                let size = centre.abs().max_element() + radius;
                SurfaceMeeting {
                    point: centre + radius * normal,
                    facing,
                    shading: facing,
                    offset_m: OFFSET_SHARE * size + LEAST_OFFSET_M,
                    material: (is_front || body.two_sided).then_some(body.material),
                    emission: Emission::None,
                    is_aperture: body.is_aperture,
                }
            }
            MetBody::Facet(hit) => {
                let facet = &self.facets[hit.shape as usize];
                let body = &self.bodies[facet.body as usize];
                let is_front = facet.normal.dot(ray.direction) <= 0.0;
                let facing = if is_front { facet.normal } else { -facet.normal };
                let (mut shading, mut material) = (facing, body.material);
                if let TraceShape::Mesh(mesh) = &body.shape {
                    let t = mesh.triangles[facet.triangle as usize].map(|i| i as usize);
                    let weights = hit.weights;
                    if let [Some(a), Some(b), Some(c)] = t.map(|i| mesh.normals.get(i)) {
                        let blend = weights[0] * *a + weights[1] * *b + weights[2] * *c;
                        let blend = blend.normalize_or(facing);
                        shading = if is_front { blend } else { -blend };
                    }
                    if let [Some(a), Some(b), Some(c)] = t.map(|i| mesh.tints_rgb.get(i)) {
                        let tint = std::array::from_fn(|k| {
                            weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]
                        });
                        material = tinted(material, tint);
                    }
                }
                SurfaceMeeting {
                    point: ray.origin + hit.t * ray.direction,
                    facing,
                    shading,
                    offset_m: facet.offset_m,
                    material: (is_front || body.two_sided).then_some(material),
                    emission: if is_front || body.two_sided { body.emission } else { Emission::None },
                    is_aperture: body.is_aperture,
                }
            }
        }
    }
}

/// A material whose diffuse albedo is multiplied.
fn tinted(material: Material, tint: [f32; 3]) -> Material {
    let times = |albedo: [f32; 3]| std::array::from_fn(|c| albedo[c] * tint[c]);
    match material {
        Material::Lambert { albedo_rgb } => Material::Lambert { albedo_rgb: times(albedo_rgb) },
        Material::Phong { albedo_rgb, specular_rgb, exponent } => {
            Material::Phong { albedo_rgb: times(albedo_rgb), specular_rgb, exponent }
        }
        mirror @ Material::Mirror { .. } => mirror,
    }
}
