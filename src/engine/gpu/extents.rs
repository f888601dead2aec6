//! Boxes around what is drawn: where the depth range may begin, and where in the picture the objects are.

use crate::{
    compose::{
        geometry::{ObjectGeometry, SurfaceGeometry},
        raster::View,
    },
    math::lens::{Distortion, Lens},
};
use glam::{DVec2, Vec3};

/// What is drawn into a part of the picture has as many columns and rows as this times a whole number, where the picture has.
const STEP_PX: u32 = 64;
/// Memory for a part of the picture is kept while it has at most so many times the pixels that are needed.
const MOST_SPARE: u64 = 4;
/// Objects may reach so far beyond the corners of their boxes: rounding, and the samples of a pixel.
const MARGIN_PX: f64 = 2.0;
/// Pieces of an edge of a box through a lens that bends it.
const PIECES: u32 = 16;

/// Low and high corner, world frame, metres.
type Box3 = (Vec3, Vec3);

/// A part of the picture, pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PicturePart {
    /// First column and first row.
    pub origin: [u32; 2],
    /// Columns and rows.
    pub size: [u32; 2],
}

impl PicturePart {
    /// All of a picture.
    pub const fn whole(width: u32, height: u32) -> Self {
        Self { origin: [0, 0], size: [width, height] }
    }

    /// A part of a picture of `whole` columns and rows that holds this one: as large as what an earlier frame had, where that
    /// is neither too small nor far too large, so that its memory can be kept.
    pub fn kept_from(self, earlier: [u32; 2], whole: [u32; 2]) -> Self {
        let pixels = |[w, h]: [u32; 2]| u64::from(w) * u64::from(h);
        let stepped = |k: usize| self.size[k].max(1).next_multiple_of(STEP_PX).min(whole[k]);
        let needed = [stepped(0), stepped(1)];
        let fits = |k: usize| (needed[k]..=whole[k]).contains(&earlier[k]);
        let keeps = fits(0) && fits(1) && pixels(earlier) <= MOST_SPARE * pixels(needed);
        let size = if keeps { earlier } else { needed };
        let origin = [0, 1].map(|k| self.origin[k].min(whole[k].saturating_sub(size[k])));
        Self { origin, size }
    }
}

/// The boxes.
#[derive(Default)]
pub struct Extents {
    /// Of each object.
    objects: Vec<Box3>,
    /// Of all real surfaces.
    surfaces: Option<Box3>,
}

impl Extents {
    /// Takes the objects where they are now.
    pub fn take_objects(&mut self, objects: &ObjectGeometry) {
        let boxes = objects
            .ranges
            .iter()
            .filter_map(|(vertices, _)| objects.positions.get(vertices.clone()).and_then(box_around));
        self.objects.clear();
        self.objects.extend(boxes);
    }

    /// Takes the real surfaces.
    pub fn take_surfaces(&mut self, surfaces: &SurfaceGeometry) {
        self.surfaces = box_around(&surfaces.positions);
    }

    /// A distance from the eye that nothing in the scene comes nearer than, at most 1 m: where the depth range
    /// may begin.
    pub fn near_m(&self, eye: Vec3) -> f32 {
        let boxes = self.objects.iter().chain(&self.surfaces);
        let nearest = boxes.map(|&(low, high)| (eye - eye.clamp(low, high)).length()).fold(2.0, f32::min);
        // Half of it: the depth is measured along the axis, not along the ray.
        (0.5 * nearest).clamp(1e-3, 1.0)
    }

    /// A part of the picture that holds all of the objects that it shows; the whole of it where that cannot be told.
    pub fn objects_seen(&self, lens: &Lens, view: &View) -> PicturePart {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for of_object in &self.objects {
            let Some((from, to)) = seen(*of_object, lens, view) else {
                return PicturePart::whole(lens.width, lens.height);
            };
            (low, high) = (low.min(from), high.max(to));
        }
        let picture = DVec2::new(f64::from(lens.width), f64::from(lens.height));
        let low = (low - MARGIN_PX).floor().clamp(DVec2::ZERO, picture);
        let high = (high + MARGIN_PX).ceil().clamp(low, picture);
        let size = high - low;
        PicturePart { origin: [low.x as u32, low.y as u32], size: [size.x as u32, size.y as u32] }
    }
}

/// Lowest and highest pixel of what a box holds. The outline of its picture is made of pictures of its edges, which are
/// straight where the lens has no distortion. `None`: it reaches to where the lens does not see.
fn seen((low, high): Box3, lens: &Lens, view: &View) -> Option<(DVec2, DVec2)> {
    let camera_from_world = view.world_from_camera.transpose();
    let corner = |k: u32| {
        let side = |bit: u32, low: f32, high: f32| if k & bit == 0 { low } else { high };
        let corner = Vec3::new(side(1, low.x, high.x), side(2, low.y, high.y), side(4, low.z, high.z));
        (camera_from_world * (corner - view.eye)).as_dvec3()
    };
    let pieces = if lens.distortion == Distortion::None { 1 } else { PIECES };
    let (mut least, mut most, mut bow) = (DVec2::INFINITY, DVec2::NEG_INFINITY, 0.0f64);
    for from in 0..8 {
        for to in [1, 2, 4].map(|bit| from | bit).into_iter().filter(|to| *to != from) {
            let (a, b) = (corner(from), corner(to));
            let mut last: [Option<DVec2>; 2] = [None; 2];
            for k in 0..=pieces {
                let at = a.lerp(b, f64::from(k) / f64::from(pieces));
                // What is beside the eye has no picture that its neighbours' would bound.
                let pixel = lens.project(at).filter(|_| at.z > 1e-3)?;
                (least, most) = (least.min(pixel), most.max(pixel));
                if let [Some(before), Some(middle)] = last {
                    bow = bow.max((before - 2.0 * middle + pixel).length());
                }
                last = [last[1], Some(pixel)];
            }
        }
    }
    // Between neighbours a curve leaves the straight line by an eighth of its second difference.
    Some((least - bow, most + bow))
}

fn box_around(positions: &[Vec3]) -> Option<Box3> {
    let mut finite = positions.iter().copied().filter(|p| p.is_finite());
    let first = finite.next()?;
    Some(finite.fold((first, first), |(low, high), p| (low.min(p), high.max(p))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use glam::DVec3;
    use proptest::prelude::*;

    #[test]
    fn the_depth_range_begins_before_everything() {
        let mut extents = Extents::default();
        assert_eq!(extents.near_m(Vec3::ZERO), 1.0);
        extents.objects = vec![(Vec3::new(0.3, -1.0, -1.0), Vec3::ONE)];
        assert!((extents.near_m(Vec3::ZERO) - 0.15).abs() < 1e-7);
        assert_eq!(extents.near_m(Vec3::splat(0.5)), 1e-3);
    }

    #[test]
    fn memory_is_kept_while_it_fits() {
        let whole = [640, 480];
        let part = PicturePart { origin: [600, 10], size: [40, 100] };
        let fresh = part.kept_from([0, 0], whole);
        assert_eq!(fresh, PicturePart { origin: [576, 10], size: [64, 128] });
        assert_eq!(part.kept_from([128, 256], whole).size, [128, 256]);
        assert_eq!(part.kept_from([192, 256], whole).size, [64, 128], "six times the pixels");
        assert_eq!(part.kept_from([64, 64], whole).size, [64, 128], "too few rows");
        let all = PicturePart::whole(640, 480);
        assert_eq!(all.kept_from([64, 64], whole), all);
        assert_eq!(PicturePart::default().kept_from([0, 0], [30, 20]), PicturePart::whole(30, 20));
    }

    proptest! {
        #[test]
        fn all_that_a_box_holds_is_in_its_part(
            centre in prop::array::uniform3(-1.0f32..1.0),
            half in prop::array::uniform3(0.01f32..0.4),
            inside in prop::array::uniform3(0.0f32..1.0),
            bent in 0..3,
        ) {
            let distortion = [
                Distortion::None,
                Distortion::RadialTangential([-0.2, 0.03, 1e-3, -1e-3, 0.0, 0.0, 0.0, 0.0]),
                Distortion::Equidistant([0.02, -0.003, 0.0, 0.0]),
            ][bent as usize];
            let lens = Lens { distortion, ..Lens::pinhole(640, 480, 500.0, 510.0, 322.0, 238.0) };
            let pose = Pose::look_at(DVec3::new(0.3, -2.5, 0.8), DVec3::ZERO, DVec3::Z);
            let view = View::of(&pose);
            let (centre, half) = (Vec3::from(centre), Vec3::from(half));
            let extents = Extents { objects: vec![(centre - half, centre + half)], surfaces: None };
            let part = extents.objects_seen(&lens, &view);
            let point = centre - half + 2.0 * half * Vec3::from(inside);
            let in_camera = view.world_from_camera.transpose() * (point - view.eye);
            if let Some(pixel) = lens.project(in_camera.as_dvec3()) {
                let shown = pixel.x >= 0.0 && pixel.x < 640.0 && pixel.y >= 0.0 && pixel.y < 480.0;
                let [x, y] = part.origin.map(f64::from);
                let [width, height] = part.size.map(f64::from);
                let is_in = pixel.x >= x && pixel.x < x + width && pixel.y >= y && pixel.y < y + height;
                prop_assert!(!shown || is_in, "{pixel} of {part:?}");
            }
            prop_assert!(part.origin[0] + part.size[0] <= 640 && part.origin[1] + part.size[1] <= 480);
        }
    }
}
