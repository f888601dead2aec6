//! Light of real environment pictures against published coefficients, and `halflight light` as a program.

mod support;

use glam::{DMat3, DVec3};
use halflight::{
    assets::{dds, pictures},
    light::{
        maps::{self, MapAxes, samples_of_map},
        project_sh::project_sh,
        split::{SplitOptions, dominant, split},
    },
    model::{
        image::RadianceImage,
        light::{EnvironmentMap, MapLayout, RadianceSamples, RadianceSh},
    },
};
use proptest::prelude::*;
use std::path::Path;

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

#[test]
fn search() {
    let Some(shared) = support::shared("search") else { return };
    for (name, table) in [("beach", BEACH), ("grace", GRACE)] {
        let samples = if name == "beach" {
            samples_of(
                MapLayout::Angular,
                pictures::load_raw(&shared.join("data/hdr/debevec_beach_probe_angular.hdr")).unwrap(),
            )
        } else {
            let map = dds::load_cube(&shared.join("data/hdr/debevec_grace_cross.dds")).unwrap();
            samples_of(map.layout, map.radiance)
        };
        let mut all = Vec::new();
        for perm in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            for signs in 0..8 {
                let mut rows = [[0.0; 3]; 3];
                for k in 0..3 {
                    rows[k][perm[k]] = if signs >> k & 1 == 1 { -1.0 } else { 1.0 };
                }
                let m = DMat3::from_cols_array_2d(&rows).transpose();
                let (scale, worst) = compare(&published_convention(&samples, m), &table);
                all.push((worst, scale, rows));
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        println!("{name} {:?}", &all[..3]);
    }
}
