//! Near light in a known room: how preparing it grows with the patches, and what a frame costs, beside [Gib03]'s figures.

use crate::timing::median;
use glam::Vec3;
use halflight::{
    model::room::{Face, Room, RoomSun, RoomSurface},
    nearfield::{
        field::{NearField, Preparation},
        marks::Marks,
        patches::{Subdivision, subdivide},
        representatives::Representatives,
        shaft::Aabb,
        sun_shadows::SunShadows,
        sun_sources::SunMarks,
    },
    sources::expand::{Priority, WantedNodes},
};
use std::time::Instant;

const FRAMES: usize = 200;
/// Sides of a box whose corners are numbered by their signs, x first; they look outwards.
const SIDES: [[u32; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

fn cuboid(name: &str, low: Vec3, high: Vec3, inwards: bool) -> RoomSurface {
    let corner = |i: u32| {
        let pick = |bit: u32, low: f32, high: f32| if i >> bit & 1 == 0 { low } else { high };
        Vec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
    };
    let side = |s: [u32; 4]| Face::Quad(if inwards { [s[3], s[2], s[1], s[0]] } else { s });
    RoomSurface {
        name: name.to_owned(),
        corners_world: (0..8).map(corner).collect(),
        faces: SIDES.map(side).to_vec(),
        reflectance_rgb: [0.6; 3],
        emitted_rgb: [0.0; 3],
    }
}

/// 4 x 3 x 2.5 m with a table on four legs; a window, and light from all walls.
pub fn room() -> Room {
    let mut surfaces = vec![
        cuboid("walls", Vec3::new(-2.0, -1.5, -0.75), Vec3::new(2.0, 1.5, 1.75), true),
        cuboid("table", Vec3::new(-0.6, -0.4, -0.04), Vec3::new(0.6, 0.4, 0.0), false),
    ];
    for (x, y) in [(-0.55, -0.35), (0.55, -0.35), (0.55, 0.35), (-0.55, 0.35)] {
        let (low, high) = (Vec3::new(x - 0.025, y - 0.025, -0.75), Vec3::new(x + 0.025, y + 0.025, -0.04));
        surfaces.push(cuboid("leg", low, high, false));
    }
    Room { surfaces }
}

/// A window of 1.2 x 1.1 m in one wall, a ceiling that it lights, walls and floor that reflect the rest.
pub fn radiance(at: &halflight::nearfield::patches::SurfacePoint) -> Option<[f32; 3]> {
    let p = at.point_world;
    let window = p.x < -1.99 && (-0.7..0.5).contains(&p.y) && (0.15..1.25).contains(&p.z);
    let level = if window { 8.0 } else { 0.3 / (1.0 + 0.4 * (p.x + 2.0).powi(2)) };
    Some([level, 0.95 * level, 0.85 * level])
}

/// Two suns that shine in through the wall at x = -2: all of it is their window.
fn suns(room: &Room, field: &NearField) -> SunShadows {
    let sun = |towards: Vec3| RoomSun {
        to_light_world: towards.normalize().to_array(),
        irradiance_rgb: [4.0, 3.6, 3.0],
        extent_rad: 0.005,
        apertures: vec![0],
    };
    let mut suns = SunShadows::default();
    let both = [sun(Vec3::new(-0.9, 0.1, 0.45)), sun(Vec3::new(-0.9, -0.35, 0.6))];
    suns.load(room, &both, field, 1024);
    suns
}

/// Median milliseconds of marking, of choosing `count` lights, suns among them, and of their rows, over an object carried across
/// the table.
fn frames(field: &NearField, suns: &SunShadows, count: usize) -> [f64; 3] {
    let (mut marks, mut lights, mut rows) = (Marks::default(), Representatives::default(), Vec::new());
    let mut of_suns = SunMarks::default();
    let mut times = [const { Vec::new() }; 3];
    for frame in 0..FRAMES {
        let centre = Vec3::new(-0.5 + frame as f32 / FRAMES as f32, 0.0, 0.16);
        let objects = [Aabb { low: centre - 0.12, high: centre + 0.12 }];
        let begin = Instant::now();
        marks.mark(field, &objects, None);
        of_suns.mark(field, suns, &marks, &objects, None);
        let marked = Instant::now();
        lights.choose(
            field,
            &marks,
            &objects,
            of_suns.marked(suns),
            WantedNodes::exactly(count),
            Priority::ErrorRemoved,
        );
        of_suns.share(suns, lights.far());
        let chosen = Instant::now();
        lights.light_rows(field, &marks, &mut rows);
        let steps = [marked - begin, chosen - marked, chosen.elapsed()];
        times.iter_mut().zip(steps).for_each(|(list, time)| list.push(time.as_secs_f64() * 1e3));
    }
    times.each_mut().map(|list| median(list))
}

/// Prints the figures.
pub fn run() {
    println!(
        "near light in a known room ([Gib03]: 1000 to 2000 patches in 15 to 30 s, 47,000 to 102,000 leaf shafts, 9 MB; 10 to 40 ms a frame)"
    );
    let room = room();
    for power_share in [0.7, 1.0] {
        println!(
            "  {:.0} % of the power; s: divide, prepare (exponent); leaf shafts; MiB of shafts, transfers, all (exponent); ms a frame: mark + choose 10 = both (exponent), rows",
            100.0 * power_share
        );
        let mut before: Option<(f64, [f64; 3])> = None;
        for patches in [250, 500, 1000, 2000, 4000] {
            let begin = Instant::now();
            let how = Subdivision { patches, ..Subdivision::default() };
            let divided = subdivide(&room, &how, &radiance).expect("a sound room");
            let divide_s = begin.elapsed().as_secs_f64();
            let begin = Instant::now();
            let preparation = Preparation { power_share, ..Preparation::default() };
            let field = NearField::build(&room, divided, &preparation, &|_| ()).expect("a lit room");
            let prepare_s = begin.elapsed().as_secs_f64();
            let report = field.report();
            let mib = |bytes: usize| bytes as f64 / f64::from(1 << 20);
            let [mark, choose, rows] = frames(&field, &SunShadows::default(), 10);
            let begin = Instant::now();
            let two = suns(&room, &field);
            let suns_s = begin.elapsed().as_secs_f64();
            let [mark_suns, choose_suns, _] = frames(&field, &two, 10);
            let costs = [prepare_s, mib(report.bytes), mark + choose];
            // Exponents of the growth since the row above.
            let exponent = |i: usize, (n, old): (f64, [f64; 3])| {
                format!("{:.2}", (costs[i] / old[i]).ln() / (report.patches as f64 / n).ln())
            };
            let growth: [String; 3] =
                std::array::from_fn(|i| before.map_or_else(|| "-".into(), |row| exponent(i, row)));
            before = Some((report.patches as f64, costs));
            println!(
                "    {:5} patches, {:4} sources: {divide_s:.3} {prepare_s:.3} ({}); {:7}; {:.2} {:.2} {:.2} ({}); {mark:.3} + {choose:.3} = {:.3} ({}), with two suns {:.3} (ready in {suns_s:.3} s), {rows:.3}",
                report.patches,
                report.sources,
                growth[0],
                report.leaf_shafts,
                mib(report.shaft_bytes),
                mib(report.transfer_bytes),
                mib(report.bytes),
                growth[1],
                mark + choose,
                growth[2],
                mark_suns + choose_suns,
            );
        }
    }
}
