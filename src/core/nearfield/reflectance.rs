//! Diffuse reflectance of a room's patches from a linear picture of it: what leaves over what arrives,
//! rho = pi L / E = L / G, G the light gathered at the place (`NearField::gathered_rgb`, and what the suns give).

use super::{
    error::RoomError,
    faces::Faces,
    prepare::{CameraPicture, KnownRoom},
};
use crate::math::color;
use glam::{DVec2, Vec3};
use rayon::prelude::*;

/// Bounds of what is measured. Below: nothing that people build with is blacker, but a division of noise by little light
/// is, and a patch of none would receive no shadow. Above: whiter than paints are, and light that is gathered again and
/// again has to end.
pub const BOUNDS: (f32, f32) = (0.01, 0.95);
/// Pixels that a patch needs.
const LEAST_PIXELS: usize = 5;
/// Pixels looked at, about; of larger pictures every other one and so on.
const MOST_PIXELS: usize = 640 * 480;
/// Where light at the corners around a place differs by more than this factor, a shadow ends there, and what is interpolated is
/// not what arrives.
const MOST_UNEVEN: f32 = 1.5;
/// A place that gets less light than this share of the mean of all seen places tells nothing.
const LEAST_LIGHT: f32 = 1e-3;

/// What a picture gave.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReflectanceReport {
    /// Pixels that met a patch that may be measured.
    pub pixels: usize,
    /// Patches whose reflectance was measured.
    pub measured: usize,
    /// Of these the ones of which a channel was beyond the bounds.
    pub bounded: usize,
    /// Receivers that were not measured and have the mean of the measured ones of their surface...
    pub like_surface: usize,
    /// ...and those of whose surface nothing was measured, which keep the room's own value.
    pub as_given: usize,
}

/// Measures reflectance where the camera sees it, and marks that: for each patch and channel the median over its pixels of
/// L / G, within [`BOUNDS`]. G is interpolated between the corners, and pixels between corners of very different light are passed
/// over; light that the surface emits is taken off L. Other
/// patches get the mean of the measured ones of their surface (by area), or keep the room's value. Surfaces that reflect
/// nothing by the room are no receivers and stay so.
///
/// Virtual objects must not be in the picture. What the camera's saturation clips is measured too dark.
///
/// # Errors
/// The picture does not have the lens's size.
pub fn measure_reflectance(
    known: &mut KnownRoom,
    camera: &CameraPicture<'_>,
) -> Result<ReflectanceReport, RoomError> {
    let (width, height) = (camera.radiance.width(), camera.radiance.height());
    let lens = &camera.lens;
    if (width, height) != (lens.width as usize, lens.height as usize) {
        let (lens_width, lens_height) = (lens.width, lens.height);
        return Err(RoomError::CameraPicture { width, height, lens_width, lens_height });
    }
    let ratios = ratios(known, camera);
    let mut report = ReflectanceReport { pixels: ratios.len(), ..ReflectanceReport::default() };
    let mut measured: Vec<Option<[f32; 3]>> = vec![None; known.field.patches.patches.len()];
    for group in ratios.chunk_by(|a, b| a.0 == b.0) {
        if group.len() < LEAST_PIXELS {
            continue;
        }
        let median = |c: usize| {
            let mut list: Vec<f32> = group.iter().map(|(_, ratio)| ratio[c]).collect();
            list.sort_unstable_by(f32::total_cmp);
            list[list.len() / 2]
        };
        let found: [f32; 3] = std::array::from_fn(median);
        let bounded = found.map(|c| c.clamp(BOUNDS.0, BOUNDS.1));
        report.measured += 1;
        report.bounded += usize::from(bounded != found);
        measured[group[0].0 as usize] = Some(bounded);
    }
    let mut means = vec![([0.0f64; 3], 0.0f64); known.room.surfaces.len()];
    let patches = &mut known.field.patches.patches;
    for (patch, found) in patches.iter().zip(&measured) {
        if let (Some(rgb), Some((sum, area))) = (found, means.get_mut(patch.surface as usize)) {
            (0..3).for_each(|c| sum[c] += f64::from(rgb[c] * patch.area_m2));
            *area += f64::from(patch.area_m2);
        }
    }
    for (patch, found) in patches.iter_mut().zip(&measured) {
        if patch.reflectance_rgb == [0.0; 3] {
            continue;
        }
        match (found, means.get(patch.surface as usize)) {
            (Some(rgb), _) => patch.reflectance_rgb = *rgb,
            (None, Some((sum, area))) if *area > 0.0 => {
                patch.reflectance_rgb = sum.map(|c| (c / area) as f32);
                report.like_surface += 1;
            }
            _ => report.as_given += 1,
        }
    }
    known.reflectance_measured = measured.iter().map(Option::is_some).collect();
    Ok(report)
}

/// Patch and L / G of every pixel that tells something, by patch.
fn ratios(known: &KnownRoom, camera: &CameraPicture<'_>) -> Vec<(u32, [f32; 3])> {
    let field = &known.field;
    let faces = Faces::of_patches(&field.patches);
    let (width, height) = (camera.radiance.width(), camera.radiance.height());
    let step = (((width * height) as f64 / MOST_PIXELS as f64).sqrt().ceil() as usize).max(1);
    let eye = camera.world_from_camera.transform(glam::DVec3::ZERO).as_vec3();
    let rows: Vec<usize> = (step / 2..height).step_by(step).collect();
    let met: Vec<(u32, [f32; 3], [f32; 3])> = rows
        .par_iter()
        .flat_map_iter(|&y| {
            let faces = &faces;
            (step / 2..width).step_by(step).filter_map(move |x| {
                let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let towards = camera.world_from_camera.rotate(camera.lens.unproject(pixel)?);
                let met = faces.first(eye, towards.as_vec3()).filter(|met| met.is_front)?;
                let patch = field.patches.patches.get(met.index as usize)?;
                if patch.reflectance_rgb == [0.0; 3] {
                    return None;
                }
                let emitted = known.room.surfaces.get(patch.surface as usize)?.emitted_rgb;
                let radiance = camera.radiance.at(x, y);
                let left: [f32; 3] = std::array::from_fn(|c| radiance[c] - emitted[c].max(0.0));
                let mut gathered = [0.0f32; 3];
                let (mut least, mut most) = (f32::INFINITY, 0.0f32);
                for (corner, weight) in faces.corners(met.triangle).into_iter().zip(met.barycentric) {
                    let (near, sun) =
                        (field.gathered_rgb.get(corner as usize)?, known.sun_rgb.get(corner as usize)?);
                    let both: [f32; 3] = std::array::from_fn(|c| near[c] + sun[c]);
                    (0..3).for_each(|c| gathered[c] += weight * both[c]);
                    let luminance = color::luminance(both);
                    (least, most) = (least.min(luminance), most.max(luminance));
                }
                if most > MOST_UNEVEN * least {
                    return None;
                }
                left.iter().all(|c| c.is_finite()).then_some((met.index, left, gathered))
            })
        })
        .collect();
    let mean =
        met.iter().map(|m| f64::from(Vec3::from(m.2).element_sum())).sum::<f64>() / met.len().max(1) as f64;
    let least = LEAST_LIGHT * (mean / 3.0) as f32;
    let mut ratios: Vec<(u32, [f32; 3])> = met
        .into_iter()
        .filter(|(_, _, gathered)| gathered.iter().all(|c| *c > least))
        .map(|(patch, left, gathered)| (patch, std::array::from_fn(|c| left[c] / gathered[c])))
        .collect();
    // Stable: pixels of a patch stay in the picture's order.
    ratios.sort_by_key(|r| r.0);
    ratios
}
