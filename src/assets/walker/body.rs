//! The walker's surface: smooth tubes along drawn stations, and how they hang on the bones.

use super::{Bone, rounded};
use crate::model::scene::Mesh;
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;

/// The surface and its weights.
pub struct Body {
    /// Positions, normals and colours; z up, metres.
    pub mesh: Mesh,
    /// For each vertex, indices of bones.
    pub joints: Vec<[u16; 4]>,
    /// Multiples of 1/255 that sum to 1.
    pub weights: Vec<[f32; 4]>,
}

/// Rings between two stations.
const STEPS: usize = 3;

type PaintRgb = [f32; 3];
const WOOD: PaintRgb = [0.72, 0.48, 0.28];
const SHIRT: PaintRgb = [0.06, 0.36, 0.40];
const BAND: PaintRgb = [0.85, 0.72, 0.42];
const TROUSERS: PaintRgb = [0.10, 0.12, 0.24];
const SHOES: PaintRgb = [0.42, 0.07, 0.04];
const HAIR: PaintRgb = [0.10, 0.045, 0.02];
const EYES: PaintRgb = [0.01, 0.01, 0.012];

/// A drawn cross-section: middle, half widths along x (or what is across the tube there) and along the other way, its
/// colour, and where it stands on the chain of bones (1.25: a smooth quarter from bone 1 to bone 2 of the list).
type Station = ([f64; 3], [f64; 2], PaintRgb, f64);

struct Tube<'a> {
    stations: &'a [Station],
    bones: &'a [Bone],
    sides: usize,
    /// Nothing is lower than this.
    floor: f64,
}

/// Tubes for trunk, limbs and head, joined.
pub fn body() -> Body {
    let mut body = Body { mesh: Mesh::default(), joints: Vec::new(), weights: Vec::new() };
    let no_floor = f64::NEG_INFINITY;
    let trunk = [Bone::Hips, Bone::Spine, Bone::Chest, Bone::Neck, Bone::Head];
    body.add(&Tube { stations: &TRUNK, bones: &trunk, sides: 28, floor: no_floor });
    body.add(&Tube { stations: &HEAD, bones: &[Bone::Head], sides: 28, floor: no_floor });
    let nose = ball([0.0, -0.0205, 0.1772], 0.0030, WOOD);
    body.add(&Tube { stations: &nose, bones: &[Bone::Head], sides: 10, floor: no_floor });
    for side in [1.0, -1.0] {
        let eye = ball([side * 0.0070, -0.0178, 0.1825], 0.0026, EYES);
        body.add(&Tube { stations: &eye, bones: &[Bone::Head], sides: 10, floor: no_floor });
        let left = side > 0.0;
        let arm = if left {
            [Bone::Chest, Bone::UpperArmL, Bone::ForearmL, Bone::HandL]
        } else {
            [Bone::Chest, Bone::UpperArmR, Bone::ForearmR, Bone::HandR]
        };
        let leg = if left {
            [Bone::Hips, Bone::ThighL, Bone::ShinL, Bone::FootL]
        } else {
            [Bone::Hips, Bone::ThighR, Bone::ShinR, Bone::FootR]
        };
        let shoe = if left { [Bone::FootL, Bone::ToeL] } else { [Bone::FootR, Bone::ToeR] };
        body.add(&Tube { stations: &on_side(&ARM, side), bones: &arm, sides: 16, floor: no_floor });
        body.add(&Tube { stations: &on_side(&LEG, side), bones: &leg, sides: 18, floor: no_floor });
        body.add(&Tube { stations: &on_side(&SHOE, side), bones: &shoe, sides: 18, floor: 0.0 });
    }
    body.mesh.positions.iter_mut().for_each(|p| *p = p.to_array().map(|x| rounded(f64::from(x))).into());
    body.mesh.normals.iter_mut().for_each(|n| {
        // Three digits are a twentieth of a degree.
        *n = (*n * 1024.0).round() / 1024.0;
    });
    body
}

const TRUNK: [Station; 16] = [
    ([0.0, 0.0, 0.0810], [0.0, 0.0], TROUSERS, 0.0),
    ([0.0, 0.0, 0.0822], [0.0110, 0.0090], TROUSERS, 0.0),
    ([0.0, 0.0, 0.0865], [0.0205, 0.0150], TROUSERS, 0.0),
    ([0.0, 0.0, 0.0950], [0.0245, 0.0175], TROUSERS, 0.0),
    ([0.0, 0.0, 0.1030], [0.0232, 0.0168], TROUSERS, 0.4),
    ([0.0, 0.0, 0.1036], [0.0238, 0.0174], BAND, 0.4),
    ([0.0, 0.0, 0.1066], [0.0236, 0.0172], BAND, 0.6),
    ([0.0, 0.0, 0.1072], [0.0228, 0.0164], SHIRT, 0.6),
    ([0.0, 0.0, 0.1180], [0.0232, 0.0165], SHIRT, 1.3),
    ([0.0, 0.0, 0.1320], [0.0270, 0.0176], SHIRT, 2.0),
    ([0.0, 0.0, 0.1430], [0.0272, 0.0162], SHIRT, 2.0),
    ([0.0, 0.0005, 0.1495], [0.0190, 0.0128], SHIRT, 2.2),
    ([0.0, 0.001, 0.1530], [0.0100, 0.0096], SHIRT, 2.6),
    ([0.0, 0.001, 0.1534], [0.0082, 0.0082], WOOD, 2.7),
    ([0.0, 0.001, 0.1610], [0.0074, 0.0076], WOOD, 3.6),
    ([0.0, 0.001, 0.1680], [0.0, 0.0], WOOD, 4.0),
];

/// Along an axis that leans back, so that the hair ends in a slant.
const HEAD: [Station; 12] = [
    ([0.0, -0.0110, 0.1598], [0.0, 0.0], WOOD, 0.0),
    ([0.0, -0.0107, 0.1604], [0.0060, 0.0058], WOOD, 0.0),
    ([0.0, -0.0092, 0.1632], [0.0118, 0.0118], WOOD, 0.0),
    ([0.0, -0.0062, 0.1690], [0.0166, 0.0170], WOOD, 0.0),
    ([0.0, -0.0022, 0.1766], [0.0188, 0.0196], WOOD, 0.0),
    ([0.0, 0.0004, 0.1816], [0.0190, 0.0198], WOOD, 0.0),
    ([0.0, 0.0006, 0.1820], [0.0197, 0.0205], HAIR, 0.0),
    ([0.0, 0.0032, 0.1870], [0.0182, 0.0192], HAIR, 0.0),
    ([0.0, 0.0058, 0.1920], [0.0148, 0.0156], HAIR, 0.0),
    ([0.0, 0.0079, 0.1960], [0.0098, 0.0104], HAIR, 0.0),
    ([0.0, 0.0090, 0.1982], [0.0050, 0.0053], HAIR, 0.0),
    ([0.0, 0.0094, 0.1990], [0.0, 0.0], HAIR, 0.0),
];

const ARM: [Station; 15] = [
    ([0.0170, 0.0, 0.1440], [0.0, 0.0], SHIRT, 0.0),
    ([0.0185, 0.0, 0.1438], [0.0070, 0.0080], SHIRT, 0.1),
    ([0.0235, 0.0, 0.1425], [0.0094, 0.0098], SHIRT, 0.4),
    ([0.0290, 0.0, 0.1370], [0.0092, 0.0096], SHIRT, 0.8),
    ([0.0335, 0.0005, 0.1285], [0.0082, 0.0086], SHIRT, 1.0),
    ([0.0375, 0.001, 0.1210], [0.0075, 0.0078], SHIRT, 1.25),
    ([0.0395, 0.001, 0.1160], [0.0074, 0.0077], SHIRT, 1.5),
    ([0.0410, 0.0007, 0.1105], [0.0075, 0.0078], SHIRT, 1.75),
    ([0.0430, 0.0, 0.1020], [0.0073, 0.0075], SHIRT, 2.0),
    ([0.0450, -0.0013, 0.0920], [0.0064, 0.0066], SHIRT, 2.3),
    ([0.0452, -0.0014, 0.0914], [0.0050, 0.0052], WOOD, 2.35),
    ([0.0458, -0.0022, 0.0870], [0.0052, 0.0060], WOOD, 2.7),
    ([0.0464, -0.0030, 0.0815], [0.0052, 0.0076], WOOD, 3.0),
    ([0.0468, -0.0038, 0.0755], [0.0040, 0.0058], WOOD, 3.0),
    ([0.0470, -0.0042, 0.0725], [0.0, 0.0], WOOD, 3.0),
];

const LEG: [Station; 13] = [
    ([0.0110, 0.0, 0.1010], [0.0, 0.0], TROUSERS, 0.0),
    ([0.0112, 0.0, 0.0995], [0.0080, 0.0090], TROUSERS, 0.0),
    ([0.0122, 0.0, 0.0945], [0.0118, 0.0135], TROUSERS, 0.3),
    ([0.0130, 0.0, 0.0860], [0.0125, 0.0140], TROUSERS, 0.75),
    ([0.0135, 0.0, 0.0760], [0.0116, 0.0126], TROUSERS, 1.0),
    ([0.0135, 0.0, 0.0640], [0.0100, 0.0106], TROUSERS, 1.1),
    ([0.0135, -0.0003, 0.0565], [0.0093, 0.0097], TROUSERS, 1.3),
    ([0.0135, -0.0004, 0.0520], [0.0091, 0.0095], TROUSERS, 1.5),
    ([0.0135, -0.0002, 0.0475], [0.0090, 0.0094], TROUSERS, 1.7),
    ([0.0135, 0.0006, 0.0390], [0.0088, 0.0094], TROUSERS, 1.95),
    ([0.0135, 0.0004, 0.0260], [0.0080, 0.0086], TROUSERS, 2.0),
    ([0.0135, 0.0002, 0.0165], [0.0078, 0.0084], TROUSERS, 2.2),
    ([0.0135, 0.0, 0.0090], [0.0, 0.0], TROUSERS, 3.0),
];

const SHOE: [Station; 11] = [
    ([0.0135, 0.0118, 0.0070], [0.0, 0.0], SHOES, 0.0),
    ([0.0135, 0.0112, 0.0070], [0.0040, 0.0042], SHOES, 0.0),
    ([0.0135, 0.0085, 0.0070], [0.0072, 0.0080], SHOES, 0.0),
    ([0.0135, 0.0030, 0.0072], [0.0084, 0.0105], SHOES, 0.0),
    ([0.0135, -0.0030, 0.0068], [0.0086, 0.0100], SHOES, 0.0),
    ([0.0137, -0.0090, 0.0058], [0.0090, 0.0086], SHOES, 0.1),
    ([0.0140, -0.0150, 0.0052], [0.0098, 0.0076], SHOES, 0.5),
    ([0.0142, -0.0205, 0.0050], [0.0098, 0.0072], SHOES, 0.9),
    ([0.0142, -0.0250, 0.0048], [0.0082, 0.0062], SHOES, 1.0),
    ([0.0140, -0.0278, 0.0046], [0.0050, 0.0042], SHOES, 1.0),
    ([0.0139, -0.0288, 0.0045], [0.0, 0.0], SHOES, 1.0),
];

fn on_side(stations: &[Station], side: f64) -> Vec<Station> {
    stations.iter().map(|&([x, y, z], half, rgb, chain)| ([side * x, y, z], half, rgb, chain)).collect()
}

fn ball([x, y, z]: [f64; 3], radius: f64, rgb: PaintRgb) -> Vec<Station> {
    [-1.0f64, -0.9, -0.5, 0.0, 0.5, 0.9, 1.0]
        .map(|t| {
            let half = radius * (1.0 - t * t).sqrt();
            ([x, y, z + radius * t], [half, half], rgb, 0.0)
        })
        .to_vec()
}

impl Body {
    fn add(&mut self, tube: &Tube) {
        let rings = rings(tube.stations);
        let first = self.mesh.positions.len() as u32;
        let last = rings.len() - 1;
        // A closed end is one vertex.
        let start_of =
            |ring: usize| if ring == 0 { first } else { first + 1 + ((ring - 1) * tube.sides) as u32 };
        for (k, ring) in rings.iter().enumerate() {
            let along = rings[(k + 1).min(last)].middle - rings[k.saturating_sub(1)].middle;
            let along = along.normalize_or(DVec3::Z);
            let across = (DVec3::X - along * along.x).normalize_or(DVec3::X);
            let other = along.cross(across);
            let sides = if k == 0 || k == last { 1 } else { tube.sides };
            for side in 0..sides {
                let (sine, cosine) = (TAU * side as f64 / tube.sides as f64).sin_cos();
                let mut p = ring.middle + across * (ring.half[0] * cosine) + other * (ring.half[1] * sine);
                p.z = p.z.max(tube.floor);
                self.mesh.positions.push(p.as_vec3());
                self.mesh.normals.push(Vec3::ZERO);
                self.mesh.tints_rgb.push(ring.rgb);
                let (joints, weights) = hang(tube.bones, ring.chain);
                self.joints.push(joints);
                self.weights.push(weights);
            }
        }
        let at = |ring: usize, side: usize| {
            start_of(ring) + if ring == 0 || ring == last { 0 } else { (side % tube.sides) as u32 }
        };
        for ring in 0..last {
            for side in 0..tube.sides {
                let [a, b] = [at(ring, side), at(ring, side + 1)];
                let [c, d] = [at(ring + 1, side + 1), at(ring + 1, side)];
                if ring > 0 {
                    self.triangle([a, b, c]);
                }
                if ring + 1 < last {
                    self.triangle([a, c, d]);
                } else if ring == 0 {
                    self.triangle([a, b, c]);
                }
            }
        }
        for normal in &mut self.mesh.normals[first as usize..] {
            *normal = normal.normalize_or(Vec3::Z);
        }
    }

    /// Adds a triangle, and its area to its corners' normals.
    fn triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners.map(|i| self.mesh.positions[i as usize].as_dvec3());
        let area = ((b - a).cross(c - a) * 1e6).as_vec3();
        corners.iter().for_each(|&i| self.mesh.normals[i as usize] += area);
        if area != Vec3::ZERO {
            self.mesh.triangles.push(corners);
        }
    }
}

struct TubeRing {
    middle: DVec3,
    half: [f64; 2],
    rgb: PaintRgb,
    chain: f64,
}

/// Stations with rings between them on a curve through them (Catmull-Rom); colours stay with the station before.
fn rings(stations: &[Station]) -> Vec<TubeRing> {
    let last = stations.len() - 1;
    let mut out = Vec::new();
    for k in 0..last {
        let near = |offset: isize| &stations[(k as isize + offset).clamp(0, last as isize) as usize];
        let four = [-1, 0, 1, 2].map(near);
        // Two stations close to each other are an edge: nothing is put between.
        let gap = DVec3::from(four[1].0).distance(DVec3::from(four[2].0));
        let steps = if gap < 1.3e-3 { 1 } else { STEPS };
        for step in 0..steps {
            let t = step as f64 / steps as f64;
            let mix = |of: &dyn Fn(&Station) -> f64| {
                let [a, b, c, d] = four.map(of);
                let (m0, m1) = (0.5 * (c - a), 0.5 * (d - b));
                b + t * (m0 + t * (3.0 * (c - b) - 2.0 * m0 - m1 + t * (2.0 * (b - c) + m0 + m1)))
            };
            let (b, c) = (four[1], four[2]);
            out.push(TubeRing {
                middle: DVec3::new(mix(&|s| s.0[0]), mix(&|s| s.0[1]), mix(&|s| s.0[2])),
                half: [mix(&|s| s.1[0]).max(0.0), mix(&|s| s.1[1]).max(0.0)],
                rgb: b.2,
                chain: b.3 + t * (c.3 - b.3),
            });
        }
    }
    let end = &stations[last];
    out.push(TubeRing { middle: end.0.into(), half: [0.0; 2], rgb: end.2, chain: end.3 });
    out
}

/// Smoothly from one bone to the next, in whole 255ths.
fn hang(bones: &[Bone], chain: f64) -> ([u16; 4], [f32; 4]) {
    let chain = chain.clamp(0.0, (bones.len() - 1) as f64);
    let from = (chain.floor() as usize).min(bones.len() - 1);
    let to = (from + 1).min(bones.len() - 1);
    let t = chain - from as f64;
    let share = (255.0 * t * t * (3.0 - 2.0 * t)).round();
    let weight = |count: f64| (count / 255.0) as f32;
    let second = if share > 0.0 { bones[to] as u16 } else { 0 };
    ([bones[from] as u16, second, 0, 0], [weight(255.0 - share), weight(share), 0.0, 0.0])
}
