//! A scene made flat for drawing: one list of world-space vertices and triangles for all virtual objects,
//! one for all real surfaces, and what each material needs.

use crate::math::sh::{MAX_ORDER, zonal};
use crate::model::{
    room::RoomPatches,
    scene::{Material, Mesh, RealSurface, Scene},
};
use crate::visibility::shadow_maps::{Receivers, ShadowedBody};
use glam::{Mat3, Vec3};
use std::ops::Range;

/// What of a material the shading reads. One row of a table on the GPU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialTerms {
    /// Diffuse albedo, linear RGB (zero for a mirror).
    pub albedo_rgb: [f32; 3],
    /// Reflectance of the glossy lobe or of the mirror (zero for Lambert).
    pub specular_rgb: [f32; 3],
    /// Exponent s of the lobe; `MIRROR_EXPONENT` for a mirror.
    pub exponent: f32,
    /// For each band l: sqrt(4 pi / (2 l + 1)) z_l of the lobe (Eq. 3 of [Now11]), so that the lobe around
    /// r reflects sum L_lm lobe_l y_lm(r). Energy-safe Phong norm (s+1)/(2 pi); 1 for a mirror.
    pub lobe: [f32; MAX_ORDER],
    /// The body that it belongs to, as in `BlockerSphere::body`.
    pub body: u32,
}

/// Stands for a perfect mirror.
pub const MIRROR_EXPONENT: f32 = -1.0;

impl MaterialTerms {
    /// Of a material. A negative or non-finite exponent counts as 0.
    pub fn of(material: &Material) -> Self {
        let none = [0.0; MAX_ORDER];
        match *material {
            Material::Lambert { albedo_rgb } => {
                Self { albedo_rgb, specular_rgb: [0.0; 3], exponent: 0.0, lobe: none, body: 0 }
            }
            Material::Phong { albedo_rgb, specular_rgb, exponent } => {
                let exponent = if exponent.is_finite() { exponent.max(0.0) } else { 0.0 };
                let mut lobe = [0.0f64; MAX_ORDER];
                zonal::phong(MAX_ORDER, f64::from(exponent), zonal::PhongNorm::EnergySafe, &mut lobe);
                for (l, z) in lobe.iter_mut().enumerate() {
                    *z *= (4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt();
                }
                Self { albedo_rgb, specular_rgb, exponent, lobe: lobe.map(|z| z as f32), body: 0 }
            }
            Material::Mirror { reflectance_rgb } => Self {
                albedo_rgb: [0.0; 3],
                specular_rgb: reflectance_rgb,
                exponent: MIRROR_EXPONENT,
                lobe: [1.0; MAX_ORDER],
                body: 0,
            },
        }
    }
}

/// All virtual objects in the world frame. The per-vertex lists have one length, the per-triangle lists another.
#[derive(Clone, Debug, Default)]
pub struct ObjectGeometry {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Tint of the albedo (r, g, b) and openness (a).
    pub tint_openness: Vec<[f32; 4]>,
    /// Indices of vertices, counter-clockwise from outside (also under mirroring transforms).
    pub triangles: Vec<[u32; 3]>,
    /// Unit facet normals, towards the outside.
    pub facet_normals: Vec<Vec3>,
    /// Index into `materials`.
    pub material_of_triangle: Vec<u32>,
    /// One an object.
    pub materials: Vec<MaterialTerms>,
    /// For each object what it reflects of white light in the mean over its vertices, at most 1.
    pub mean_rgb: Vec<[f32; 3]>,
    /// For each object its vertices and its triangles, as ranges of the lists above.
    pub ranges: Vec<(Range<usize>, Range<usize>)>,
}

impl ObjectGeometry {
    /// Takes all objects of a scene, in its order; memory is reused. Triangles that name a missing vertex or
    /// have a non-finite corner or no area are left out; missing normals become the facet's, missing tints
    /// white, missing openness 1.
    pub fn load(&mut self, scene: &Scene) {
        self.positions.clear();
        self.normals.clear();
        self.tint_openness.clear();
        self.triangles.clear();
        self.facet_normals.clear();
        self.material_of_triangle.clear();
        self.materials.clear();
        self.mean_rgb.clear();
        self.ranges.clear();
        for (index, object) in scene.objects.iter().enumerate() {
            let base = self.positions.len() as u32;
            let mesh = &object.mesh;
            let to_world = object.world_from_object;
            let linear = Mat3::from(to_world.matrix3);
            // Cofactors turn normals right under any scale, mirroring included (up to the sign of the determinant).
            let mirrored = linear.determinant() < 0.0;
            let cofactors = Mat3::from_cols(
                linear.y_axis.cross(linear.z_axis),
                linear.z_axis.cross(linear.x_axis),
                linear.x_axis.cross(linear.y_axis),
            ) * if mirrored { -1.0 } else { 1.0 };
            self.positions.extend(mesh.positions.iter().map(|&p| to_world.transform_point3(p)));
            for i in 0..mesh.positions.len() {
                let normal = mesh.normals.get(i).map_or(Vec3::ZERO, |&n| (cofactors * n).normalize_or_zero());
                self.normals.push(normal);
                let tint = mesh.tints_rgb.get(i).copied().unwrap_or([1.0; 3]);
                let openness = object.openness.get(i).copied().unwrap_or(1.0).clamp(0.0, 1.0);
                self.tint_openness.push([tint[0], tint[1], tint[2], openness]);
            }
            let material = self.materials.len() as u32;
            // A body's number is the index of its figure's first object (as in `animate::posed`).
            let figure = scene.figures.iter().find(|f| f.parts.iter().any(|part| part.object == index));
            let body = figure.and_then(|f| f.parts.first()).map_or(index, |part| part.object) as u32;
            let terms = MaterialTerms { body, ..MaterialTerms::of(&object.material) };
            self.mean_rgb.push(mean_rgb(&terms, &self.tint_openness[base as usize..]));
            self.materials.push(terms);
            let first = self.triangles.len();
            push_triangles(
                mesh,
                base,
                mirrored,
                &self.positions,
                &mut self.triangles,
                &mut self.facet_normals,
            );
            self.material_of_triangle.resize(self.triangles.len(), material);
            fill_normals(&self.triangles[first..], &self.facet_normals[first..], &mut self.normals);
            self.ranges.push((base as usize..self.positions.len(), first..self.triangles.len()));
        }
    }

    /// Low and high corner of a box around all vertices that triangles use; low above high where there are none.
    pub fn bounds(&self) -> [Vec3; 2] {
        let vertices = self.triangles.iter().flatten().map(|&i| self.positions[i as usize]);
        vertices.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |b, p| [b[0].min(p), b[1].max(p)])
    }

    /// Each object that has triangles, as hard shadows fall on it.
    pub fn bodies(&self) -> impl Iterator<Item = ShadowedBody> {
        let sound =
            self.ranges.iter().zip(&self.materials).filter(|((_, triangles), _)| !triangles.is_empty());
        sound.map(|((vertices, _), material)| {
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for p in self.positions[vertices.clone()].iter().filter(|p| p.is_finite()) {
                (low, high) = (low.min(*p), high.max(*p));
            }
            ShadowedBody { low, high, is_mirror: material.exponent == MIRROR_EXPONENT }
        })
    }

    /// Moves the vertices of object `index` (world frame; lists of the object's own length, else nothing happens).
    pub fn pose(&mut self, index: usize, positions_world: &[Vec3], normals_world: &[Vec3]) {
        let Some((vertices, triangles)) = self.ranges.get(index).cloned() else { return };
        if positions_world.len() != vertices.len() {
            return;
        }
        self.positions[vertices.clone()].copy_from_slice(positions_world);
        let sound = |n: &Vec3| n.is_finite() && n.length_squared() > 0.25;
        if normals_world.len() == vertices.len() {
            for (slot, normal) in self.normals[vertices].iter_mut().zip(normals_world) {
                // A normal that has collapsed stays as it was.
                if sound(normal) {
                    *slot = *normal;
                }
            }
        }
        for (triangle, facet) in
            self.triangles[triangles.clone()].iter().zip(&mut self.facet_normals[triangles])
        {
            let [p, q, r] = triangle.map(|i| self.positions[i as usize]);
            let normal = (q - p).cross(r - p).normalize_or_zero();
            if sound(&normal) {
                *facet = normal;
            }
        }
    }
}

/// All real surfaces in the world frame.
#[derive(Clone, Debug, Default)]
pub struct SurfaceGeometry {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Indices of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Unit facet normals.
    pub facet_normals: Vec<Vec3>,
    /// Whether virtual shadows fall on the triangle.
    pub receives: Vec<bool>,
    /// The triangle's albedo, where it is known.
    pub albedo_rgb: Vec<Option<[f32; 3]>>,
}

impl SurfaceGeometry {
    /// Takes all real surfaces of a scene, in its order; memory is reused. Bad triangles are left out.
    pub fn load(&mut self, surfaces: &[RealSurface]) {
        self.positions.clear();
        self.normals.clear();
        self.triangles.clear();
        self.facet_normals.clear();
        self.receives.clear();
        self.albedo_rgb.clear();
        for surface in surfaces {
            let base = self.positions.len() as u32;
            let mesh = &surface.mesh;
            self.positions.extend_from_slice(&mesh.positions);
            self.normals.extend(
                (0..mesh.positions.len())
                    .map(|i| mesh.normals.get(i).map_or(Vec3::ZERO, |n| n.normalize_or_zero())),
            );
            let first = self.triangles.len();
            push_triangles(mesh, base, false, &self.positions, &mut self.triangles, &mut self.facet_normals);
            self.receives.resize(self.triangles.len(), surface.receives_shadow);
            self.albedo_rgb.resize(self.triangles.len(), surface.albedo_rgb);
            fill_normals(&self.triangles[first..], &self.facet_normals[first..], &mut self.normals);
        }
    }

    /// Hands those over that virtual shadows fall on.
    pub fn receivers(&self, out: &mut Receivers) {
        out.load(&self.positions, &self.triangles, &self.receives);
    }
}

impl SurfaceGeometry {
    /// Adds the patches of a known room, which receive shadows, after what there is: vertex `i` of the room becomes the
    /// `i`-th of those added. Gives the number of its first triangle; its triangles are those of [`RoomPatch::triangles`] in
    /// order.
    ///
    /// [`RoomPatch::triangles`]: crate::model::room::RoomPatch::triangles
    pub fn add_room(&mut self, patches: &RoomPatches) -> usize {
        let base = self.positions.len() as u32;
        let first = self.triangles.len();
        self.positions.extend(patches.vertices.iter().map(|v| v.position_world));
        self.normals.extend(patches.vertices.iter().map(|v| v.normal_world));
        for patch in &patches.patches {
            for triangle in patch.triangles() {
                self.triangles.push(triangle.map(|i| base + i));
                self.facet_normals.push(patch.normal_world);
                self.receives.push(true);
                self.albedo_rgb.push(Some(patch.reflectance_rgb));
            }
        }
        first
    }
}

/// What a material reflects of white light in the mean over vertices with these tints.
fn mean_rgb(terms: &MaterialTerms, tints: &[[f32; 4]]) -> [f32; 3] {
    let count = tints.len().max(1) as f32;
    std::array::from_fn(|c| {
        let tint = tints.iter().map(|t| t[c]).sum::<f32>() / count;
        (terms.albedo_rgb[c] * tint + terms.specular_rgb[c]).clamp(0.0, 1.0)
    })
}

/// Appends the sound triangles of a mesh, and their facet normals.
fn push_triangles(
    mesh: &Mesh,
    base: u32,
    mirrored: bool,
    positions: &[Vec3],
    triangles: &mut Vec<[u32; 3]>,
    facet_normals: &mut Vec<Vec3>,
) {
    let count = mesh.positions.len() as u32;
    for &[a, b, c] in &mesh.triangles {
        if a >= count || b >= count || c >= count {
            continue;
        }
        let triangle = if mirrored { [base + a, base + c, base + b] } else { [base + a, base + b, base + c] };
        let [p, q, r] = triangle.map(|i| positions[i as usize].as_dvec3());
        let normal = (q - p).cross(r - p).normalize_or_zero();
        if normal.is_finite() && normal.length_squared() > 0.5 {
            triangles.push(triangle);
            facet_normals.push(normal.as_vec3());
        }
    }
}

/// Gives vertices without a normal that of a facet that uses them.
fn fill_normals(triangles: &[[u32; 3]], facet_normals: &[Vec3], normals: &mut [Vec3]) {
    for (triangle, &facet) in triangles.iter().zip(facet_normals) {
        for &i in triangle {
            let normal = &mut normals[i as usize];
            if !(normal.is_finite() && normal.length_squared() > 0.25) {
                *normal = facet;
            }
        }
    }
}
