//! Environment pictures to weighted directions, and back to a picture.
//!
//! Where a map's texels look, in the world frame (z up):
//! * `Equirect`: theta = pi v from +z, phi = 2 pi u - pi from +x towards +y. The middle is +x, the top +z, and what
//!   is right of the middle lies towards +y. Seen from inside that is left-right reversed: pictures from programs
//!   that show the place as a visitor sees it want [`MapAxes::Mirrored`].
//! * `Angular` (Debevec's): the middle is +x, the top +z, the right -y; not mirrored. The rim is -x.
//! * `Cube`: each face is where its name says, laid out as in `sphere::cube_direction`. Files of programs that
//!   take y for up want [`MapAxes::YUp`].

use crate::math::{charts, sphere};
use crate::model::{
    estimate::LightFlags,
    image::{NOT_FINITE, RadianceImage},
    light::{EnvironmentMap, MapLayout, RadianceSamples},
};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// What infinite radiance is replaced by: safely inside half floats (spec 10).
pub const LARGEST_RADIANCE: f32 = 64_000.0;
/// Finite radiance above this is damage: its square would leave f32 in later sums.
const ABSURD_RADIANCE: f32 = 1e15;

/// Which axes a map was made for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MapAxes {
    /// Ours: right-handed, z up.
    #[default]
    World,
    /// y up and left-handed, as cube maps are in D3D and GL: y and z change places, which also sets the handedness
    /// right, so that the scenery is not mirrored.
    YUp,
    /// y up and right-handed: (x, y, z) becomes (x, -z, y).
    YUpRightHanded,
    /// z up, but left-right reversed: y changes its sign.
    Mirrored,
}

impl MapAxes {
    /// What "y is up" means for a layout: cube maps are left-handed as D3D and GL have them, other pictures right-handed.
    pub fn of_up(y_up: bool, layout: MapLayout) -> Self {
        match (y_up, layout) {
            (false, _) => Self::World,
            (true, MapLayout::Cube) => Self::YUp,
            (true, MapLayout::Equirect | MapLayout::Angular) => Self::YUpRightHanded,
        }
    }

    /// Map to world, the result turned by `turn_rad` about z (from +x towards +y).
    pub fn world_from_map(self, turn_rad: f64) -> DMat3 {
        let axes = match self {
            Self::World => DMat3::IDENTITY,
            Self::YUp => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::Y),
            Self::YUpRightHanded => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            Self::Mirrored => DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::Z),
        };
        DMat3::from_rotation_z(turn_rad) * axes
    }
}

/// Which point of an angular map's texel stands for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TexelPoint {
    /// Its centre: right for probes whose disc is centred in the picture, as the real ones' is.
    #[default]
    Centre,
    /// Its upper left corner, as the program behind the published coefficients of Debevec's probes reads them: half a
    /// texel off, 0.3 % of L_00 at 640 texels.
    Corner,
}

/// Whether a picture has the shape that its layout asks for: any for `Equirect`, square for `Angular`, six squares
/// one under the other for `Cube`; never empty.
pub fn fits(map: &EnvironmentMap) -> bool {
    let (width, height) = (map.radiance.width(), map.radiance.height());
    let shaped = match map.layout {
        MapLayout::Equirect => true,
        MapLayout::Angular => width == height,
        MapLayout::Cube => height == 6 * width,
    };
    shaped && width > 0 && height > 0
}

/// Every texel of a map as a sample: direction of its centre (world frame, as the module says), solid angle and
/// radiance. `out` keeps its memory.
///
/// Solid angles: exact for `Equirect` (a zone's share) and `Cube` (the face's corner formula); for `Angular`
/// (2 pi / w)^2 sinc(pi r) where the texel's centre lies in the disc (Eq. 6 of [Now11], corrected), scaled so that
/// their sum is 4 pi (a change of 5e-4 at w = 16 and 2e-6 at 64). In each layout they sum to 4 pi.
///
/// Robust texels: NaN and negative channels become 0, infinite ones (and those above 1e15) [`LARGEST_RADIANCE`];
/// finite ones stay, however bright. Such a sample carries `NOT_FINITE` and is counted. A map that does not
/// [`fits`] its layout gives no samples.
pub fn samples_of_map(map: &EnvironmentMap, out: &mut RadianceSamples) -> LightFlags {
    out.directions.clear();
    out.radiance.clear();
    if !fits(map) {
        return LightFlags::default();
    }
    let (width, height) = (map.radiance.width(), map.radiance.height());
    match map.layout {
        MapLayout::Equirect => fill(&map.radiance, out, |column, row| {
            let (u, v) = ((column as f64 + 0.5) / width as f64, (row as f64 + 0.5) / height as f64);
            (sphere::equirect_direction(u, v), sphere::equirect_row_solid_angle(width, height, row))
        }),
        MapLayout::Cube => fill(&map.radiance, out, |column, row| {
            let (face, row) = (row / width, row % width);
            let direction = sphere::cube_direction(face, centre(column, width), centre(row, width));
            (direction, sphere::cube_texel_solid_angle(width, column, row))
        }),
        MapLayout::Angular => return samples_of_angular_map(&map.radiance, TexelPoint::Centre, out),
    }
    flags_of(out)
}

/// [`samples_of_map`] for an angular map (square) whose texels are read at the point given.
pub fn samples_of_angular_map(
    radiance: &RadianceImage,
    point: TexelPoint,
    out: &mut RadianceSamples,
) -> LightFlags {
    out.directions.clear();
    out.radiance.clear();
    let width = radiance.width();
    if width == 0 || radiance.height() != width {
        return LightFlags::default();
    }
    let place = |k: usize| match point {
        TexelPoint::Centre => centre(k, width),
        TexelPoint::Corner => (2 * k) as f64 / width as f64 - 1.0,
    };
    let omega =
        |column, row| charts::angular_jacobian(place(column), place(row)) * (2.0 / width as f64).powi(2);
    let sum: f64 = (0..width * width).map(|t| omega(t % width, t / width)).sum();
    let scale = 4.0 * PI / sum;
    fill(radiance, out, |column, row| {
        // v of the formula points up in the picture; its axes (right, up, forward) become ours.
        let outside = (DVec3::ZERO, 0.0);
        sphere::angular_direction(place(column), -place(row))
            .map_or(outside, |d| (DVec3::new(d.z, -d.x, d.y), scale * omega(column, row)))
    });
    keep_inside(out);
    flags_of(out)
}

fn flags_of(samples: &RadianceSamples) -> LightFlags {
    let bad = |sample: &&[f32; 4]| sample[3] != 0.0;
    LightFlags {
        not_finite_texels: samples.radiance.iter().filter(bad).count() as u32,
        texels: samples.radiance.len() as u32,
        ..LightFlags::default()
    }
}

/// Turns samples from one frame to another: `to_from_from` is orthogonal, a mirror image allowed.
pub fn turn(samples: &mut RadianceSamples, to_from_from: DMat3) {
    for d in &mut samples.directions {
        let turned = to_from_from * DVec3::new(f64::from(d[0]), f64::from(d[1]), f64::from(d[2]));
        *d = [turned.x as f32, turned.y as f32, turned.z as f32, d[3]];
    }
}

/// Centre of texel k of `width`, in [-1, 1].
fn centre(k: usize, width: usize) -> f64 {
    (2 * k + 1) as f64 / width as f64 - 1.0
}

fn fill(
    picture: &RadianceImage,
    out: &mut RadianceSamples,
    look: impl Fn(usize, usize) -> (DVec3, f64) + Send + Sync,
) {
    let width = picture.width();
    let texels = picture.pixels();
    out.directions.resize(texels.len(), [0.0; 4]);
    out.radiance.resize(texels.len(), [0.0; 4]);
    let rows = out.directions.par_chunks_mut(width).zip(out.radiance.par_chunks_mut(width));
    rows.zip(texels.par_chunks(width)).enumerate().for_each(|(row, ((directions, radiance), texels))| {
        for (column, ((slot, light), texel)) in directions.iter_mut().zip(radiance).zip(texels).enumerate() {
            let (d, omega) = look(column, row);
            *slot = [d.x as f32, d.y as f32, d.z as f32, omega as f32];
            *light = robust(*texel);
        }
    });
}

/// Radiance with its flag: nothing that is not finite or negative gets past.
fn robust(texel: [f32; 3]) -> [f32; 4] {
    let sound = |c: f32| (0.0..=ABSURD_RADIANCE).contains(&c);
    let [r, g, b] = texel.map(|c| match sound(c) {
        true => c,
        false if c > 0.0 => LARGEST_RADIANCE,
        false => 0.0,
    });
    let flag = if texel.into_iter().all(sound) { 0 } else { NOT_FINITE };
    [r, g, b, f32::from(flag)]
}

/// Leaves out samples without solid angle, in place and in order.
fn keep_inside(samples: &mut RadianceSamples) {
    let mut kept = 0;
    for k in 0..samples.directions.len() {
        if samples.directions[k][3] > 0.0 {
            samples.directions[kept] = samples.directions[k];
            samples.radiance[kept] = samples.radiance[k];
            kept += 1;
        }
    }
    samples.directions.truncate(kept);
    samples.radiance.truncate(kept);
}

/// A picture of samples: an equirectangular map of 2 `height` x `height` texels in their frame. Each texel is the mean
/// of the samples in it, weighed by solid angle; texels without one take the mean of the coarser map around them.
/// `None` where there are no samples with solid angle, or `height` is 0.
pub fn equirect_of_samples(samples: &RadianceSamples, height: usize) -> Option<RadianceImage> {
    // Radiance times solid angle, and solid angle: fine to coarse.
    let mut levels = vec![vec![[0.0f64; 4]; 2 * height * height]];
    let mut sizes = vec![(2 * height, height)];
    for (d, c) in samples.directions.iter().zip(&samples.radiance) {
        let (u, v) = sphere::equirect_uv(DVec3::new(f64::from(d[0]), f64::from(d[1]), f64::from(d[2])));
        let column = ((u * 2.0 * height as f64) as usize).min((2 * height).checked_sub(1)?);
        let row = ((v * height as f64) as usize).min(height - 1);
        let slot = &mut levels[0][row * 2 * height + column];
        for channel in 0..3 {
            slot[channel] += f64::from(c[channel]) * f64::from(d[3]);
        }
        slot[3] += f64::from(d[3]);
    }
    while let (Some(&(width, height)), Some(fine)) = (sizes.last(), levels.last())
        && width * height > 1
    {
        let (coarse_width, coarse_height) = (width.div_ceil(2), height.div_ceil(2));
        let mut coarse = vec![[0.0f64; 4]; coarse_width * coarse_height];
        for (k, texel) in fine.iter().enumerate() {
            let slot = &mut coarse[(k / width / 2) * coarse_width + k % width / 2];
            for channel in 0..4 {
                slot[channel] += texel[channel];
            }
        }
        levels.push(coarse);
        sizes.push((coarse_width, coarse_height));
    }
    if !levels.last().is_some_and(|top| top.iter().any(|texel| texel[3] > 0.0)) {
        return None;
    }
    for level in (0..levels.len().saturating_sub(1)).rev() {
        let (fine, coarse) = levels.split_at_mut(level + 1);
        let ((width, _), (coarse_width, _)) = (sizes[level], sizes[level + 1]);
        for (k, texel) in fine[level].iter_mut().enumerate() {
            if texel[3] <= 0.0 {
                // Its mean, with a weight that no true sample has to yield to.
                let around = coarse[0][(k / width / 2) * coarse_width + k % width / 2];
                *texel = around.map(|c| c / around[3]);
            }
        }
    }
    let pixels = levels[0].iter().map(|t| [t[0], t[1], t[2]].map(|c| (c / t[3]) as f32)).collect();
    RadianceImage::from_pixels(2 * height, height, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::image::Image;
    use proptest::prelude::*;

    fn map(layout: MapLayout, size: usize) -> EnvironmentMap {
        let (width, height) = match layout {
            MapLayout::Equirect => (2 * size, size),
            MapLayout::Angular => (size, size),
            MapLayout::Cube => (size, 6 * size),
        };
        EnvironmentMap { layout, radiance: Image::filled(width, height, [1.0; 3]) }
    }

    const LAYOUTS: [MapLayout; 3] = [MapLayout::Equirect, MapLayout::Angular, MapLayout::Cube];

    #[test]
    fn solid_angles_sum_to_the_sphere_and_the_mean_direction_is_nil() {
        for layout in LAYOUTS {
            for size in [1, 2, 7, 16, 64] {
                let mut samples = RadianceSamples::default();
                let flags = samples_of_map(&map(layout, size), &mut samples);
                assert_eq!(flags.texels as usize, samples.directions.len());
                assert_eq!(samples.radiance.len(), samples.directions.len());
                let sum: f64 = samples.directions.iter().map(|d| f64::from(d[3])).sum();
                // Each is rounded to f32.
                assert!((sum / (4.0 * PI) - 1.0).abs() < 1e-7, "{layout:?} {size}: {sum}");
                if size >= 16 {
                    for axis in 0..3 {
                        let mean: f64 =
                            samples.directions.iter().map(|d| f64::from(d[axis]) * f64::from(d[3])).sum();
                        // The angular map's disc is counted in whole texels: 6.6e-3 at 16; the others are symmetric.
                        assert!(mean.abs() < 8e-3, "{layout:?} {size}: {mean}");
                    }
                }
            }
        }
    }

    #[test]
    fn where_the_middle_and_the_top_of_an_angular_map_look() {
        let mut one = map(MapLayout::Angular, 65);
        let bright = |one: &mut EnvironmentMap, x: usize, y: usize| {
            one.radiance.pixels_mut().fill([0.0; 3]);
            *one.radiance.at_mut(x, y) = [1.0; 3];
            let mut samples = RadianceSamples::default();
            samples_of_map(one, &mut samples);
            let k = samples.radiance.iter().position(|c| c[0] > 0.0).unwrap();
            let d = samples.directions[k];
            DVec3::new(f64::from(d[0]), f64::from(d[1]), f64::from(d[2]))
        };
        assert!(bright(&mut one, 32, 32).distance(DVec3::X) < 1e-7);
        // Half way up is 90 degrees; 16 of 32.5 texels are 88.6.
        assert!(bright(&mut one, 32, 16).distance(DVec3::Z) < 0.03);
        assert!(bright(&mut one, 48, 32).distance(DVec3::NEG_Y) < 0.03);
        assert!(bright(&mut one, 64, 32).distance(DVec3::NEG_X) < 0.06);
    }

    #[test]
    fn damaged_texels_are_replaced_flagged_and_counted() {
        let mut broken = map(MapLayout::Equirect, 2);
        let texels = [
            [f32::NAN, 1.0, 2.0],
            [1.0, f32::INFINITY, 0.0],
            [-3.0, 1.0, 1.0],
            [1e30, f32::NEG_INFINITY, 1e6],
        ];
        broken.radiance.pixels_mut()[..4].copy_from_slice(&texels);
        let mut samples = RadianceSamples::default();
        let flags = samples_of_map(&broken, &mut samples);
        assert_eq!((flags.not_finite_texels, flags.texels), (4, 8));
        let bad = f32::from(NOT_FINITE);
        let want = [[0.0, 1.0, 2.0, bad], [1.0, 64e3, 0.0, bad], [0.0, 1.0, 1.0, bad], [64e3, 0.0, 1e6, bad]];
        assert_eq!(samples.radiance[..4], want);
        assert!(samples.radiance[4..].iter().all(|c| *c == [1.0, 1.0, 1.0, 0.0]));
    }

    #[test]
    fn a_shape_that_does_not_fit_gives_nothing() {
        let mut samples = RadianceSamples::default();
        for (layout, width, height) in
            [(MapLayout::Cube, 4, 20), (MapLayout::Angular, 4, 5), (MapLayout::Equirect, 0, 0)]
        {
            samples.directions.push([1.0; 4]);
            let wrong = EnvironmentMap { layout, radiance: Image::filled(width, height, [1.0; 3]) };
            assert!(!fits(&wrong));
            assert_eq!(samples_of_map(&wrong, &mut samples), LightFlags::default());
            assert!(samples.directions.is_empty());
        }
    }

    #[test]
    fn axes_are_what_their_names_say() {
        let of = |axes: MapAxes, d: DVec3| axes.world_from_map(0.0) * d;
        assert_eq!(of(MapAxes::YUp, DVec3::Y), DVec3::Z);
        assert_eq!(of(MapAxes::YUp, DVec3::Z), DVec3::Y);
        assert_eq!(of(MapAxes::YUpRightHanded, DVec3::Y), DVec3::Z);
        assert_eq!(of(MapAxes::YUpRightHanded, DVec3::Z), DVec3::NEG_Y);
        assert_eq!(of(MapAxes::Mirrored, DVec3::Y), DVec3::NEG_Y);
        assert_eq!(MapAxes::YUp.world_from_map(0.3).determinant().round(), -1.0);
        assert_eq!(MapAxes::YUpRightHanded.world_from_map(0.3).determinant().round(), 1.0);
        let turned = MapAxes::World.world_from_map(0.5 * PI) * DVec3::X;
        assert!(turned.distance(DVec3::Y) < 1e-15);
    }

    proptest! {
        #[test]
        fn a_map_comes_back_as_a_picture(values in prop::collection::vec(0.0..9.0f32, 8 * 4)) {
            // Finer maps cover every texel of the coarse picture; here both have the same texels.
            let mut light = map(MapLayout::Equirect, 4);
            for (texel, value) in light.radiance.pixels_mut().iter_mut().zip(&values) {
                *texel = [*value, 2.0 * value, 1.0];
            }
            let mut samples = RadianceSamples::default();
            samples_of_map(&light, &mut samples);
            let picture = equirect_of_samples(&samples, 4).unwrap();
            for (got, want) in picture.pixels().iter().zip(light.radiance.pixels()) {
                for c in 0..3 {
                    prop_assert!((got[c] - want[c]).abs() <= 1e-6 * want[c]);
                }
            }
        }

        #[test]
        fn gaps_are_filled_with_what_is_around(height in 1usize..40, value in 0.1..5.0f32, lon in -3.0..3.0f64) {
            let d = sphere::equirect_direction(lon / (2.0 * PI) + 0.5, 0.4);
            let mut one = RadianceSamples::default();
            one.directions.push([d.x as f32, d.y as f32, d.z as f32, 0.1]);
            one.radiance.push([value; 4]);
            let picture = equirect_of_samples(&one, height).unwrap();
            prop_assert!(picture.pixels().iter().flatten().all(|c| (c - value).abs() <= 1e-6 * value));
        }

        #[test]
        fn no_texel_brings_more_than_it_may(bits in prop::collection::vec(any::<u32>(), 12)) {
            let texels = bits.chunks(3).map(|b| [0, 1, 2].map(|c| f32::from_bits(b[c]))).collect();
            let light = EnvironmentMap {
                layout: MapLayout::Equirect,
                radiance: Image::from_pixels(4, 1, texels).unwrap(),
            };
            let mut samples = RadianceSamples::default();
            samples_of_map(&light, &mut samples);
            prop_assert!(samples.radiance.iter().flatten().all(|c| (0.0..=1e15).contains(c)));
        }
    }

    #[test]
    fn no_samples_no_picture() {
        assert!(equirect_of_samples(&RadianceSamples::default(), 8).is_none());
        assert!(equirect_of_samples(&RadianceSamples::default(), 0).is_none());
    }
}
