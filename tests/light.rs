//! Light of real environment pictures against published coefficients, and `halflight light` as a program.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use glam::{DMat3, DVec3};
use halflight::{
    assets::{dds, pictures},
    light::{
        maps::{self, MapAxes, TexelPoint, samples_of_angular_map, samples_of_map},
        project_sh::project_sh,
        split::{GRAY_REC709, SplitOptions, dominant, split},
    },
    model::{
        image::RadianceImage,
        light::{EnvironmentMap, MapLayout, RadianceSamples, RadianceSh},
    },
};
use proptest::prelude::*;
use support::wanted;

const LAYOUTS: [MapLayout; 3] = [MapLayout::Equirect, MapLayout::Angular, MapLayout::Cube];

/// Published coefficients of order 3, rows L00 | L1-1 L10 L11 | L2-2 L2-1 L20 L21 L22 (data/README.md).
type Published = [[f64; 3]; 9];

const BEACH: Published = [
    [0.6841148, 0.6929004, 0.7069543],
    [0.3173355, 0.3694407, 0.4406839],
    [-0.1747193, -0.1737154, -0.1657420],
    [-0.4496467, -0.4155184, -0.3416573],
    [-0.1690202, -0.1703022, -0.1525870],
    [-0.0837808, -0.0940454, -0.1027518],
    [-0.0319670, -0.0214051, -0.0147691],
    [0.1641816, 0.1377558, 0.1010403],
    [0.3697189, 0.3097930, 0.2029923],
];
const GRACE: Published = [
    [0.078908, 0.043710, 0.054161],
    [0.039499, 0.034989, 0.060488],
    [-0.033974, -0.018236, -0.026940],
    [-0.029213, -0.005562, 0.000944],
    [-0.011141, -0.005090, -0.012231],
    [-0.026240, -0.022401, -0.047479],
    [-0.015570, -0.009471, -0.014733],
    [0.056014, 0.021444, 0.013915],
    [0.021205, -0.005432, -0.030374],
];

fn samples_of(layout: MapLayout, radiance: RadianceImage) -> RadianceSamples {
    let mut samples = RadianceSamples::default();
    let flags = samples_of_map(&EnvironmentMap { layout, radiance }, &mut samples);
    assert_eq!(flags.not_finite_texels, 0);
    samples
}

/// Coefficients in the published convention (no Condon-Shortley sign: the odd m change theirs) along its axes.
fn published_convention(samples: &RadianceSamples, published_from_world: DMat3) -> Published {
    let mut turned = samples.clone();
    maps::turn(&mut turned, published_from_world);
    let light = project_sh(&turned, 3);
    let odd_m = [1, 3, 5, 7];
    std::array::from_fn(|i| {
        light.rgb[i].map(|c| if odd_m.contains(&i) { -f64::from(c) } else { f64::from(c) })
    })
}

/// The overall scale, ours over theirs, by least squares, and the worst error in shares of the channel's L00.
fn compare(ours: &Published, theirs: &Published) -> (f64, f64) {
    let pairs = || ours.iter().flatten().zip(theirs.iter().flatten());
    let scale = pairs().map(|(a, b)| a * b).sum::<f64>() / pairs().map(|(_, b)| b * b).sum::<f64>();
    let worst = (0..9)
        .flat_map(|i| (0..3).map(move |c| (ours[i][c] / scale - theirs[i][c]).abs() / theirs[0][c]))
        .fold(0.0, f64::max);
    (scale, worst)
}

/// The beach table's axes: x right, y up, z forward in the probe's picture, ours -y, z, x. Found once by trying all 48;
/// the next best is 44 % of L00 away.
fn beach_axes() -> DMat3 {
    DMat3::from_cols(DVec3::Z, DVec3::NEG_X, DVec3::Y)
}

#[test]
fn the_beach_probe_has_its_published_light() {
    let Some(shared) = support::shared("beach probe") else { return };
    let radiance = pictures::load_raw(&shared.join("data/hdr/debevec_beach_probe_angular.hdr")).unwrap();
    // Read as the published program reads: texel (i, j) at u = i/320 - 1, its corner. Measured: 2.49204 and 0.042 %.
    let mut corners = RadianceSamples::default();
    samples_of_angular_map(&radiance, TexelPoint::Corner, &mut corners);
    let (scale, worst) = compare(&published_convention(&corners, beach_axes()), &BEACH);
    println!("beach, texels read at corners: scale {scale:.5}, worst {:.4} % of L00", 100.0 * worst);
    assert!((scale - 2.492).abs() < 1e-3, "{scale}");
    wanted::hold("light.beach.corner", worst);
    // At their centres, where they are (the disc in the picture is symmetric about 320.0): half a texel, 0.28 degrees,
    // moves the light by 0.326 %.
    let centres = samples_of(MapLayout::Angular, radiance);
    let (scale, worst) = compare(&published_convention(&centres, beach_axes()), &BEACH);
    println!("beach, texels read at centres: scale {scale:.5}, worst {:.4} % of L00", 100.0 * worst);
    assert!((scale - 2.5018).abs() < 1e-3, "{scale}");
    wanted::hold("light.beach.centre", worst);
}

#[test]
fn the_grace_cube_has_its_published_light() {
    let Some(shared) = support::shared("Grace cube") else { return };
    let map = dds::load_cube(&shared.join("data/hdr/debevec_grace_cross.dds")).unwrap();
    // The table's axes are the file's own (y up). Measured: 0.515 % of L00; the next best axes are 78 % away.
    let (scale, worst) =
        compare(&published_convention(&samples_of(map.layout, map.radiance), DMat3::IDENTITY), &GRACE);
    println!("Grace cube: scale {scale:.3}, worst {:.3} % of L00", 100.0 * worst);
    wanted::hold("light.grace", worst);
}

#[test]
fn real_panoramas_lean_as_far_as_stated() {
    let Some(shared) = support::shared("panoramas") else { return };
    // |L1|/L0 of Rec. 709 luminance, two digits (data/README.md; that of studio_small_03 is ours).
    for (name, want) in [
        ("rooitou_park", 1.33),
        ("potsdamer_platz", 0.99),
        ("lebombo", 0.66),
        ("st_fagans_interior", 0.34),
        ("studio_small_03", 0.99),
    ] {
        let radiance = pictures::load_raw(&shared.join(format!("data/hdr/{name}_1k.hdr"))).unwrap();
        let light = project_sh(&samples_of(MapLayout::Equirect, radiance), 2);
        // |d| / (sqrt(4 pi) L0) is |L1| / (sqrt 3 L0).
        let lean = dominant(light.rows(), GRAY_REC709, 1e-3).anisotropy * 3.0f32.sqrt();
        println!("{name}: |L1|/L0 = {lean:.4}");
        assert!((lean - want).abs() < 0.005, "{name}: {lean} instead of {want}");
    }
}

/// A map that is bright only around one axis: which texels, (columns, rows), in layouts of 128 x 64, 64 x 64 and
/// 16 x 96 texels.
fn bright_around(layout: MapLayout, axis: usize) -> RadianceImage {
    let (width, height) = match layout {
        MapLayout::Equirect => (128, 64),
        MapLayout::Angular => (64, 64),
        MapLayout::Cube => (16, 96),
    };
    let is_in = |x: usize, y: usize| match layout {
        MapLayout::Equirect => match axis {
            0 => (62..66).contains(&x) && (30..34).contains(&y),
            1 => !(2..126).contains(&x) && (30..34).contains(&y),
            2 => (94..98).contains(&x) && (30..34).contains(&y),
            3 => (30..34).contains(&x) && (30..34).contains(&y),
            4 => y < 3,
            _ => y >= 61,
        },
        MapLayout::Angular => match axis {
            0 => (30..34).contains(&x) && (30..34).contains(&y),
            1 => (x as f64 - 31.5).hypot(y as f64 - 31.5) > 30.5,
            2 => (15..17).contains(&x) && (31..33).contains(&y),
            3 => (47..49).contains(&x) && (31..33).contains(&y),
            4 => (31..33).contains(&x) && (15..17).contains(&y),
            _ => (31..33).contains(&x) && (47..49).contains(&y),
        },
        MapLayout::Cube => (6..10).contains(&x) && (16 * axis + 6..16 * axis + 10).contains(&y),
    };
    let pixels = (0..width * height)
        .map(|k| if is_in(k % width, k / width) { [5.0, 4.0, 3.0] } else { [0.01; 3] })
        .collect();
    RadianceImage::from_pixels(width, height, pixels).unwrap()
}

const AXES: [DVec3; 6] = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];

fn direction_of(light: &RadianceSh) -> DVec3 {
    DVec3::from(split(light, &SplitOptions::default()).direct.unwrap().to_light_world.map(f64::from))
}

#[test]
fn light_from_one_side_comes_from_there() {
    for layout in LAYOUTS {
        for (axis, want) in AXES.into_iter().enumerate() {
            let got = direction_of(&project_sh(&samples_of(layout, bright_around(layout, axis)), 4));
            // Of an angular map the texels beside the middle are not symmetric about the axis: 0.01.
            assert!(got.distance(want) < 0.02, "{layout:?} {want}: {got}");
        }
    }
}

#[test]
fn what_counts_as_damage_is_said_twice_and_alike() {
    assert_eq!(maps::LARGEST_RADIANCE, pictures::LARGEST_RADIANCE);
    let texels = vec![[f32::NAN, -1.0, 2.0], [f32::INFINITY, 0.0, 9e4], [1e16, -f32::INFINITY, -0.0]];
    let picture = RadianceImage::from_pixels(3, 1, texels).unwrap();
    let loaded = pictures::ingest(picture.clone());
    let mut samples = RadianceSamples::default();
    let flags =
        samples_of_map(&EnvironmentMap { layout: MapLayout::Equirect, radiance: picture }, &mut samples);
    assert_eq!(flags.not_finite_texels, loaded.replaced.not_finite_texels + loaded.replaced.negative_texels);
    for (sample, (texel, bits)) in
        samples.radiance.iter().zip(loaded.hdr.radiance.pixels().iter().zip(loaded.hdr.flags.pixels()))
    {
        assert_eq!(*sample, [texel[0], texel[1], texel[2], f32::from(*bits)]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_map_pushed_sideways_is_light_turned_about_z(
        values in prop::collection::vec(0.0..3.0f32, 32 * 16),
        columns in 0usize..32,
    ) {
        let texel = |k: usize| [values[k], values[k] * values[k], 1.0];
        let still = RadianceImage::from_pixels(32, 16, (0..512).map(texel).collect()).unwrap();
        let pushed = (0..512).map(|k| texel(k / 32 * 32 + (k % 32 + 32 - columns) % 32)).collect();
        let pushed = RadianceImage::from_pixels(32, 16, pushed).unwrap();
        let mut turned = samples_of(MapLayout::Equirect, still);
        let turn_rad = std::f64::consts::TAU * columns as f64 / 32.0;
        maps::turn(&mut turned, MapAxes::World.world_from_map(turn_rad));
        let (a, b) = (project_sh(&turned, 6), project_sh(&samples_of(MapLayout::Equirect, pushed), 6));
        for (a, b) in a.rgb.iter().flatten().zip(b.rgb.iter().flatten()) {
            // Rounding of 512 f32 samples of up to 9.
            prop_assert!((a - b).abs() < 3e-5, "{a} {b}");
        }
    }

    #[test]
    fn light_scales_with_its_map(values in prop::collection::vec(0.0..3.0f32, 6 * 16), layout in 0usize..3) {
        let (layout, width, height) = [(MapLayout::Equirect, 12, 8), (MapLayout::Angular, 9, 9), (MapLayout::Cube, 4, 24)][layout];
        let map = |scale: f32| {
            let pixels = values[..width * height].iter().map(|v| [scale * v, *v, 0.5]).collect();
            RadianceImage::from_pixels(width, height, pixels).unwrap()
        };
        // Powers of two change no digit.
        let (once, twice) =
            (project_sh(&samples_of(layout, map(1.0)), 4), project_sh(&samples_of(layout, map(2.0)), 4));
        for (a, b) in once.rgb.iter().zip(&twice.rgb) {
            prop_assert_eq!([2.0 * a[0], a[1], a[2]], *b);
        }
        // Constant light is constant: L00 = sqrt(4 pi) times it, nothing else.
        prop_assert!((once.rgb[0][2] - 0.5 * (4.0 * std::f32::consts::PI).sqrt()).abs() < 1e-5);
    }
}
