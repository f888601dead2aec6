//! What shading reads at a fragment.

use crate::compose::{
    geometry::{ObjectGeometry, SurfaceGeometry},
    raster::Fragment,
    shade_object::ObjectPoint,
    transferred::Transferred,
};
use glam::Vec3;

/// Interpolates what shading needs at a fragment, and its facet's normal on the seen side. Backs of open meshes are
/// shaded like fronts.
pub fn object_point(
    objects: &ObjectGeometry,
    transferred: &Transferred,
    fragment: &Fragment,
) -> (ObjectPoint, Vec3) {
    let corners = objects.triangles[fragment.triangle].map(|i| i as usize);
    let weights = fragment.barycentric;
    let mut normal = Vec3::ZERO;
    let mut tint_openness = [0.0f32; 4];
    let (mut soft, mut gloss) = ([0.0f32; 4], [0.0f32; 3]);
    for (&i, w) in corners.iter().zip(weights) {
        normal += w * objects.normals[i];
        for (slot, c) in tint_openness.iter_mut().zip(objects.tint_openness[i]) {
            *slot += w * c;
        }
        for (slot, c) in soft.iter_mut().zip(transferred.soft()[i]) {
            *slot += w * c;
        }
        for (slot, c) in gloss.iter_mut().zip(transferred.gloss()[i]) {
            *slot += w * c;
        }
    }
    let facet = objects.facet_normals[fragment.triangle];
    let side = if facet.dot(fragment.to_eye) < 0.0 { -1.0 } else { 1.0 };
    let facet = side * facet;
    let normal = side * normal.normalize_or(side * facet);
    let point = ObjectPoint {
        position_world: fragment.point_world,
        normal,
        to_eye: fragment.to_eye,
        tint_openness,
        soft,
        gloss,
    };
    (point, facet)
}

/// Shading and facet normal of a real surface at a fragment, on the seen side.
pub fn surface_normals(surfaces: &SurfaceGeometry, fragment: &Fragment) -> (Vec3, Vec3) {
    let facet = surfaces.facet_normals[fragment.triangle];
    let side = if facet.dot(fragment.to_eye) < 0.0 { -1.0 } else { 1.0 };
    let corners = surfaces.triangles[fragment.triangle];
    let weighted = corners.iter().zip(fragment.barycentric);
    let normal: Vec3 = weighted.map(|(&i, w)| w * surfaces.normals[i as usize]).sum();
    (side * normal.normalize_or(facet), side * facet)
}
