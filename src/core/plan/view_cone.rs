//! Roughly what a camera may see.

use crate::math::{lens::Lens, pose::Pose};
use crate::model::scene::VirtualObject;
use glam::{DVec2, DVec3, Vec3};

/// A cone around the camera's axis that holds the whole picture.
pub struct ViewCone {
    eye: DVec3,
    axis: DVec3,
    half_angle_rad: f64,
}

impl ViewCone {
    /// What a camera with this lens and pose sees.
    pub fn new(lens: &Lens, world_from_camera: &Pose) -> Self {
        let (w, h) = (f64::from(lens.width), f64::from(lens.height));
        // The widest rays of a picture lie on its border.
        let mut half_angle_rad = 0.0f64;
        for k in 0..=8 {
            let t = f64::from(k) / 8.0;
            for p in [(t * w, 0.0), (t * w, h), (0.0, t * h), (w, t * h)] {
                let angle = lens
                    .unproject(DVec2::new(p.0, p.1))
                    .map_or(std::f64::consts::PI, |d| d.z.clamp(-1.0, 1.0).acos());
                half_angle_rad = half_angle_rad.max(angle);
            }
        }
        Self {
            eye: world_from_camera.translation,
            axis: world_from_camera.rotate(DVec3::Z),
            half_angle_rad: half_angle_rad + 0.01,
        }
    }

    /// Whether the bounding sphere of an object reaches into the cone.
    pub fn may_see(&self, object: &VirtualObject) -> bool {
        let mut low = Vec3::INFINITY;
        let mut high = Vec3::NEG_INFINITY;
        for &p in &object.mesh.positions {
            low = low.min(p);
            high = high.max(p);
        }
        if !(low.is_finite() && high.is_finite()) {
            return false;
        }
        let to_world = object.world_from_object;
        let centre = to_world.transform_point3(0.5 * (low + high));
        let half = 0.5 * (high - low);
        let m = to_world.matrix3;
        let reach = Vec3::from(m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z);
        let radius_m = f64::from(reach.length());
        let to_centre = centre.as_dvec3() - self.eye;
        let distance_m = to_centre.length();
        if distance_m <= radius_m {
            return true;
        }
        let off_axis = self.axis.dot(to_centre / distance_m).clamp(-1.0, 1.0).acos();
        off_axis <= self.half_angle_rad + (radius_m / distance_m).asin()
    }
}
