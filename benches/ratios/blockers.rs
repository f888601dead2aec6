//! `visibility::blockers`: the SH kernels batched over receivers against the plain scalar form, and every rung over a
//! picture of receivers on a plane.

use glam::Vec3;
use halflight::math::dice::Dice;
use halflight::{
    math::sh::{
        lanes::{self, Lane, LaneSh},
        log_exp, product,
    },
    model::blocker::{BlockerSphere, Rung},
    visibility::blockers::{BlockedPlane, Blockers, LANES},
};
use rayon::prelude::*;
use std::{hint::black_box, time::Instant};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;

/// Least time of some runs, in seconds: what disturbs only adds.
fn least_s(runs: usize, mut work: impl FnMut()) -> f64 {
    work();
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

/// A body of spheres that stands on the plane z = 0.
fn figure(count: usize) -> Vec<BlockerSphere> {
    let mut dice = Dice::new(7);
    (0..count)
        .map(|i| {
            let height = 0.1 + 0.9 * (i as f32 + 0.5) / count as f32;
            let centre = Vec3::new(0.4 * dice.unit_f32() - 0.2, 0.4 * dice.unit_f32() - 0.2, height);
            BlockerSphere { centre_world: centre, radius_m: 0.07 + 0.08 * dice.unit_f32(), body: 0 }
        })
        .collect()
}

/// A square of 3 m with the figure in its middle: where each pixel's ray meets the plane, seen from above.
fn receivers() -> Vec<Vec3> {
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let (x, y) = ((i % WIDTH) as f32 / WIDTH as f32, (i / WIDTH) as f32 / HEIGHT as f32);
            Vec3::new(3.0 * x - 1.5, 3.0 * y - 1.5, 0.0)
        })
        .collect()
}

fn transfer() -> [[f32; 3]; 36] {
    std::array::from_fn(|i| [0.6_f32.powi(i.isqrt() as i32); 3])
}

/// Nanoseconds of a product: plain, and a lane's share in batches of [`LANES`] and of 16.
fn product_ns<const N: usize>() -> [f64; 3] {
    const ROUNDS: usize = 20_000;
    let mut dice = Dice::new(3);
    let mut f: [f32; 36] = std::array::from_fn(|_| dice.unit_f32() - 0.5);
    let g: [f32; 36] = std::array::from_fn(|_| dice.unit_f32() - 0.5);
    let mut out = [0.0; 36];
    let plain = least_s(9, || {
        for _ in 0..ROUNDS / 4 {
            product::product(N, black_box(&f), black_box(&g), &mut out);
            f[1] = black_box(out[2]);
        }
    });
    [plain * 4e9 / ROUNDS as f64, batch_ns::<N, LANES>(&f, &g), batch_ns::<N, 16>(&f, &g)]
}

fn batch_ns<const N: usize, const L: usize>(f: &[f32; 36], g: &[f32; 36]) -> f64 {
    const ROUNDS: usize = 20_000;
    let mut f: LaneSh<f32, L> = f.map(Lane::splat);
    let g: LaneSh<f32, L> = g.map(Lane::splat);
    let mut out = lanes::nothing();
    let batched = least_s(9, || {
        for _ in 0..ROUNDS {
            lanes::product::<f32, N, L>(black_box(&f), black_box(&g), &mut out);
            f[1] = black_box(out[2]);
        }
    });
    batched * 1e9 / (ROUNDS * L) as f64
}

/// One receiver as one would write it down: logarithms from the definition's table, turned by `zonal::rotate`, summed,
/// and Eq. 24; no batch.
fn scalar(spheres: &[BlockerSphere], point: Vec3, order: usize) -> [f32; 36] {
    let tables = log_exp::tables(order);
    let mut g: LaneSh<f32, 1> = lanes::nothing();
    for sphere in spheres {
        let to = sphere.centre_world - point;
        let Some(cap) =
            halflight::math::sh::cap::Cap::of_sphere(to.to_array(), sphere.radius_m, [0.0, 0.0, 1.0])
        else {
            continue;
        };
        let q = halflight::math::sh::zonal::one_minus_cosine(cap.sine_squared);
        let scaled = tables.log.at(q);
        let mut y = [0.0; 36];
        halflight::math::sh::basis::evaluate(order, cap.axis, &mut y);
        for (i, (g, y)) in g.iter_mut().zip(y).enumerate().take(order * order) {
            g.0[0] += scaled[i.isqrt()] * y;
        }
    }
    let mut v = lanes::nothing();
    log_exp::linear::<f32, 4, 1>(&g, &tables.response, &mut v);
    lanes::guard::<f32, 4, 1>(&mut v);
    v.map(|v| v.0[0])
}

fn kernels() {
    for (order, [plain, eight, sixteen]) in
        [(3, product_ns::<3>()), (4, product_ns::<4>()), (5, product_ns::<5>()), (6, product_ns::<6>())]
    {
        println!(
            "blockers, product, order {order}: {eight:.1} ns in batches of {LANES}, {sixteen:.1} ns of 16, {plain:.0} ns \
             plain, ratios {:.1} and {:.1}",
            plain / eight,
            plain / sixteen
        );
    }
    let spheres = figure(64);
    let points: Vec<Vec3> = receivers().into_iter().step_by(307).collect();
    let normals = vec![Vec3::Z; points.len()];
    let mut blockers = Blockers::new();
    blockers.prepare(&spheres, Rung::Linear, 4, 64);
    let per_us = |seconds: f64| seconds * 1e6 / points.len() as f64;
    let batched = per_us(least_s(9, || {
        blockers.visibility_many(&points, &normals, None, |_, v| {
            black_box(v[1]);
        });
    }));
    let plain = per_us(least_s(9, || {
        for point in &points {
            black_box(scalar(&spheres, *point, 4)[1]);
        }
    }));
    println!(
        "blockers, log-exp of 64 spheres, order 4: {batched:.2} us in batches of {LANES} (caps in caps left out), \
         {plain:.2} us plain (all caps), ratio {:.1}",
        plain / batched
    );
}

/// The plane's receivers shaded once, rows on the pool's threads.
fn plane_ms(
    pool: &rayon::ThreadPool,
    blockers: &Blockers,
    points: &[Vec3],
    out: &mut [[f32; 3]],
    runs: usize,
) -> f64 {
    let mut plane = BlockedPlane::default();
    blockers.plane(Vec3::Z, None, &transfer(), &mut plane);
    let ms = 1e3
        * least_s(runs, || {
            pool.install(|| {
                points
                    .par_chunks(WIDTH)
                    .zip(out.par_chunks_mut(WIDTH))
                    .for_each(|(points, out)| blockers.shade_plane(&plane, points, out));
            });
        });
    black_box(out[0]);
    ms
}

pub fn run() {
    kernels();
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(2).build() else { return };
    let points = receivers();
    let mut out = vec![[0.0; 3]; points.len()];
    let mut blockers = Blockers::new();
    println!("blockers, {WIDTH} x {HEIGHT} receivers on a plane, 2 threads: ms for 1, 5, 10, 20 spheres");
    for rung in Rung::ALL {
        for order in [2, 3, 4, 5, 6] {
            let counts = if rung == Rung::Directions { &[64, 128][..] } else { &[64] };
            for &directions in counts {
                let ms = [1, 5, 10, 20].map(|spheres| {
                    blockers.prepare(&figure(spheres), rung, order, directions);
                    plane_ms(&pool, &blockers, &points, &mut out, 2)
                });
                let of = if rung == Rung::Directions { format!(" N {directions}") } else { String::new() };
                println!(
                    "  {}{of}, order {order}: {:.1} {:.1} {:.1} {:.1}; {:.3} a sphere more",
                    rung.name(),
                    ms[0],
                    ms[1],
                    ms[2],
                    ms[3],
                    (ms[3] - ms[1]) / 15.0
                );
            }
        }
    }
    // Receiver by receiver instead of by eights.
    for rung in [Rung::Linear, Rung::Hybrid] {
        blockers.prepare(&figure(20), rung, 4, 64);
        let batched = plane_ms(&pool, &blockers, &points, &mut out, 3);
        let transfer = transfer();
        let single = 1e3
            * least_s(3, || {
                pool.install(|| {
                    points.par_chunks(WIDTH).zip(out.par_chunks_mut(WIDTH)).for_each(|(points, out)| {
                        for (point, out) in points.iter().zip(out) {
                            *out = blockers.shade(*point, Vec3::Z, None, &transfer).0;
                        }
                    });
                });
            });
        println!(
            "  {}, order 4, 20 spheres: {batched:.1} ms by eights, {single:.1} ms one by one, ratio {:.1}",
            rung.name(),
            single / batched
        );
    }
}
