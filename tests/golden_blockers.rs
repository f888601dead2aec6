//! The shared golden numbers for the visibility of many spheres: logarithms, tables, exponentials, soft directions
//! and the guard, in f64 and f32 through the kernels that frames run through.

#[path = "support/golden.rs"]
mod golden;
mod support;

use glam::Vec3;
use golden::{Entry, Precision, numbers};
use halflight::math::sh::{
    MAX_COEFFICIENTS, basis,
    cap::{self, Cap},
    lanes::{Lane, LaneSh, add_zonal, guard, nothing, product},
    log_exp, soft_directions,
};
use halflight::math::{dice::Dice, spiral};
use halflight::{
    model::blocker::{BlockerSphere, Rung},
    visibility::blockers::Blockers,
};

/// Runs a function with the order as a constant.
macro_rules! with_order {
    ($order:expr, $f:ident::<$t:ty, N>($($argument:expr),* $(,)?)) => {
        match $order {
            2 => $f::<$t, 2, 1>($($argument),*),
            3 => $f::<$t, 3, 1>($($argument),*),
            4 => $f::<$t, 4, 1>($($argument),*),
            5 => $f::<$t, 5, 1>($($argument),*),
            6 => $f::<$t, 6, 1>($($argument),*),
            order => panic!("no order {order}"),
        }
    };
}

fn flat<T: Precision>(order: usize, lanes: &LaneSh<T, 1>) -> Vec<T> {
    lanes[..order * order].iter().map(|lane| lane.0[0]).collect()
}

/// Fails where logarithms are cut elsewhere than at 0.02, which is the only place that the product knows.
fn require_eps(entry: &Entry) {
    if entry.has("eps") && entry.number::<f64>("eps") != 0.02 {
        entry.unknown("its eps is not 0.02");
    }
}

/// Spheres of an entry as caps seen from its point.
fn caps<T: Precision>(entry: &Entry) -> Vec<Cap<T>> {
    let list = entry.inputs["spheres"].as_array().expect("as the file has it");
    let point = if entry.has("shade_point") { numbers(&entry.inputs["shade_point"]) } else { vec![0.0; 3] };
    list.iter()
        .map(|sphere| {
            let c = numbers(&sphere["centre"]);
            let from_point = std::array::from_fn(|i| T::of(c[i] - point[i]));
            let radius = T::of(sphere["radius"].as_f64().expect("as the file has it"));
            let up = [T::zero(), T::zero(), T::one()];
            Cap::of_sphere(from_point, radius, up).expect("as the file has it")
        })
        .collect()
}

/// Adds a zonal function that is turned to an axis.
fn add<T: Precision>(order: usize, zonal: &[T], axis: [T; 3], out: &mut LaneSh<T, 1>) {
    let mut scaled = [Lane::zero(); 6];
    for (l, (scaled, z)) in scaled.iter_mut().zip(zonal).enumerate() {
        *scaled = Lane::splat(*z * T::of((4.0 * std::f64::consts::PI / (2 * l + 1) as f64).sqrt()));
    }
    let axis = axis.map(Lane::splat);
    with_order!(order, add_zonal::<T, N>(axis, &scaled, out));
}

fn log_sum<T: Precision>(order: usize, caps: &[Cap<T>]) -> LaneSh<T, 1> {
    let mut sum = nothing();
    for cap in caps {
        let mut zonal = vec![T::zero(); order];
        log_exp::log_cap(order, cap.sine_squared, &mut zonal);
        add(order, &zonal, cap.axis, &mut sum);
    }
    sum
}

/// The product of all caps in order; guarded after each or not.
fn chain<T: Precision>(order: usize, caps: &[Cap<T>], guarded: bool) -> LaneSh<T, 1> {
    let mut all: Option<LaneSh<T, 1>> = None;
    for cap in caps {
        let mut zonal = vec![T::zero(); order];
        cap::visible(order, cap.sine_squared, &mut zonal);
        let mut next = nothing();
        add(order, &zonal, cap.axis, &mut next);
        let mut both = next;
        if let Some(before) = &all {
            with_order!(order, product::<T, N>(before, &next, &mut both));
        }
        if guarded {
            with_order!(order, guard::<T, N>(&mut both));
        }
        all = Some(both);
    }
    all.expect("as the file has it")
}

fn logzh<T: Precision>(entry: &Entry) {
    require_eps(entry);
    let order = entry.count("order");
    let sine =
        T::of(entry.inputs["angular_radius_deg"].as_f64().expect("as the file has it").to_radians().sin());
    let mut g = vec![T::zero(); order];
    log_exp::log_cap(order, sine * sine, &mut g);
    entry.check_key("eigenclip", Some(&g[..]));
}

fn ab<T: Precision>(entry: &Entry) {
    let table = log_exp::ResponseTable::<T>::new(entry.count("order"));
    let x = entry.list::<T>("x");
    let nodes: Vec<T> =
        (0..log_exp::RESPONSE_NODES).map(|node| T::of(log_exp::response_node(node))).collect();
    assert_eq!(x, nodes, "{}: the same nodes", entry.id);
    let (a, b): (Vec<T>, Vec<T>) = x.iter().map(|x| table.at(*x)).unzip();
    entry.check_key("a", Some(&a[..]));
    entry.check_key("b", Some(&b[..]));
}

fn exp<T: Precision>(entry: &Entry) {
    require_eps(entry);
    let order = entry.count("order");
    let caps = caps::<T>(entry);
    entry.check_key("dc_product", Some(&[cap::mean_product(caps.iter().map(|cap| cap.sine_squared))]));
    entry.check_key("chain_in_order", Some(&flat(order, &chain(order, &caps, false))[..]));
    let sum = log_sum(order, &caps);
    entry.check_key("log_sum", Some(&flat(order, &sum)[..]));
    let norm = with_order!(order, norm_above_mean::<T, N>(&sum)).0[0];
    entry.check_key("ghat_norm", Some(&[norm]));
    let table = log_exp::ResponseTable::<T>::new(order);
    let (a, b) = table.at(norm);
    entry.check_key("ab_at_norm", Some(&[a, b]));
    let mut v = nothing();
    with_order!(order, linear::<T, N>(&sum, &table, &mut v));
    entry.check_key("optimal_linear", Some(&flat(order, &v)[..]));
    let squarings = with_order!(order, hybrid::<T, N>(&sum, &table, false, &mut v))[0];
    entry.check_key("hybrid", Some(&flat(order, &v)[..]));
    entry.check_key("hybrid_squarings", Some(&[T::of(f64::from(squarings))]));
    let (a, b) = table.at(norm * T::of(0.5).powi(squarings as i32));
    entry.check_key("ab_at_hybrid_norm", Some(&[a, b]));
    let mut limit = vec![T::zero(); order * order];
    log_exp::exact(order, &flat(order, &sum), &mut limit);
    entry.check_key("expm", Some(&limit[..]));
    // `squared` has no numbers of its own: it is within Taylor's remainder, (1/2)^3/6 relative before squaring, of the
    // limit; 0.007 measured.
    with_order!(order, squared::<T, N>(&sum, false, &mut v));
    let off = flat(order, &v).iter().zip(&limit).map(|(a, b)| (a.wide() - b.wide()).powi(2)).sum::<f64>();
    assert!(off.sqrt() < 0.02, "{}: squared is {} off the limit", entry.id, off.sqrt());
}
use log_exp::{hybrid, linear, norm_above_mean, squared};

fn dirs<T: Precision>(entry: &Entry) {
    let (order, count) = (entry.count("order"), entry.count("N"));
    let h = soft_directions::softness(count);
    let ramps: Vec<_> = caps::<T>(entry)
        .iter()
        .map(|cap| {
            let (r, c) = (Lane::splat(cap.sine_squared), Lane::splat(cap.cosine()));
            let axis = cap.axis.map(Lane::splat);
            soft_directions::Ramp::<T, 1>::of_cap(axis, r, c, T::of(h), T::of((0.5 * h).sin()))
        })
        .collect();
    let mut v = vec![T::zero(); order * order];
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    for j in 0..count {
        let direction = spiral::direction(j, count).to_array().map(T::of);
        let open = ramps.iter().fold(T::one(), |open, ramp| open * ramp.at(direction).0[0]);
        basis::evaluate(order, direction, &mut y);
        for (v, y) in v.iter_mut().zip(y) {
            *v += open * y * T::of(4.0 * std::f64::consts::PI / count as f64);
        }
    }
    entry.check_key("V", Some(&v[..]));
}

fn guarded<T: Precision>(entry: &Entry) {
    let list = entry.list::<T>("V");
    let order = list.len().isqrt();
    let mut v = nothing();
    for (v, given) in v.iter_mut().zip(&list) {
        *v = Lane::splat(*given);
    }
    with_order!(order, guard::<T, N>(&mut v));
    entry.check("guard", entry.expected, Some(&flat(order, &v)[..]));
}

fn overlap<T: Precision>(entry: &Entry) {
    require_eps(entry);
    let order = entry.count("order");
    let sine =
        T::of(entry.inputs["angular_radius_deg"].as_f64().expect("as the file has it").to_radians().sin());
    let cap = Cap { axis: entry.direction("axis"), sine_squared: sine * sine };
    let caps = vec![cap; entry.count("k_coincident")];
    let sum = log_sum(order, &caps);
    entry.check_key("ghat_norm", Some(&[with_order!(order, norm_above_mean::<T, N>(&sum)).0[0]]));
    let table = log_exp::ResponseTable::<T>::new(order);
    let mut v = nothing();
    let squarings = with_order!(order, hybrid::<T, N>(&sum, &table, true, &mut v))[0];
    entry.check_key("squarings", Some(&[T::of(f64::from(squarings))]));
    entry.check_key("hybrid_guarded", Some(&flat(order, &v)[..]));
    entry.check_key("chain_guarded", Some(&flat(order, &chain(order, &caps, true))[..]));
    let mean = chain(order, &caps, false)[0].0[0].wide() / log_exp::whole::<f64>();
    let expected = entry.expected["chain_unguarded_mean"].as_f64().expect("as the file has it");
    assert!((mean / expected - 1.0).abs() < 1e-3, "{}: {mean} instead of {expected}", entry.id);
}

#[test]
fn blockers_match_the_golden_numbers() {
    let Some(shared) = support::shared("blockers_match_the_golden_numbers") else { return };
    golden::run(
        &shared,
        &[
            ("logzh", logzh::<f64>, logzh::<f32>),
            ("ab", ab::<f64>, ab::<f32>),
            ("exp", exp::<f64>, exp::<f32>),
            ("dirs", dirs::<f64>, dirs::<f32>),
            ("guard", guarded::<f64>, guarded::<f32>),
            ("overlap", overlap::<f64>, overlap::<f32>),
        ],
    );
}

/// A direction by chance, evenly on the upper half of the sphere.
fn upper(dice: &mut Dice) -> [f64; 3] {
    let (z, phi) = (dice.unit(), std::f64::consts::TAU * dice.unit());
    let sine = (1.0 - z * z).sqrt();
    [sine * phi.cos(), sine * phi.sin(), z]
}

/// The file's scenes: spheres at a distance of 1 m. `spread`: uniform on the upper hemisphere, 5 to 30 degrees;
/// `clustered`: about a random axis, 5 to 25 degrees.
fn scene(dice: &mut Dice, clustered: bool, count: usize) -> Vec<BlockerSphere> {
    let axis = upper(dice);
    (0..count)
        .map(|_| {
            let mut centre = upper(dice);
            let mut most = 30.0;
            if clustered {
                most = 25.0;
                centre = axis.map(|v| v + 0.45 * dice.normal());
                centre[2] = centre[2].abs();
            }
            let centre = glam::DVec3::from_array(centre).normalize().as_vec3();
            let half_angle = (5.0 + (most - 5.0) * dice.unit()).to_radians();
            BlockerSphere { centre_world: centre, radius_m: half_angle.sin() as f32, body: 0 }
        })
        .collect()
}

const TRUTH_DIRECTIONS: usize = 20_000;
const SCENES: usize = 60;
const COUNTS: [usize; 5] = [1, 2, 5, 10, 20];

/// The rows of the ladder: a rung with its number of directions.
const ROWS: [(Rung, usize); 8] = [
    (Rung::Dc, 0),
    (Rung::Linear, 0),
    (Rung::Hybrid, 0),
    (Rung::Squared, 0),
    (Rung::Chain, 0),
    (Rung::Directions, 64),
    (Rung::Directions, 128),
    (Rung::Directions, 256),
];

/// Mean relative L2 error of V of each row for each count of spheres, against a hard test of many directions.
fn ladder(order: usize, clustered: bool) -> [[f64; 5]; 8] {
    let mut y = [0.0; MAX_COEFFICIENTS];
    let nodes: Vec<(Vec3, [f64; MAX_COEFFICIENTS])> = (0..TRUTH_DIRECTIONS)
        .map(|j| {
            let direction = spiral::direction(j, TRUTH_DIRECTIONS).to_array();
            basis::evaluate(order, direction, &mut y);
            (glam::DVec3::from_array(direction).as_vec3(), y)
        })
        .collect();
    let mut errors = [[0.0; 5]; 8];
    let mut dice = Dice::new(11);
    let mut blockers = Blockers::new();
    for (k, count) in COUNTS.into_iter().enumerate() {
        for _ in 0..SCENES {
            let spheres = scene(&mut dice, clustered, count);
            let caps: Vec<(Vec3, f32)> =
                spheres.iter().map(|s| (s.centre_world, (1.0 - s.radius_m * s.radius_m).sqrt())).collect();
            // 1 - B, so that the constant has no error.
            let mut truth = [0.0; MAX_COEFFICIENTS];
            truth[0] = (4.0 * std::f64::consts::PI).sqrt();
            for (direction, y) in &nodes {
                if caps.iter().any(|(axis, cosine)| axis.dot(*direction) > *cosine) {
                    for (truth, y) in truth.iter_mut().zip(y).take(order * order) {
                        *truth -= y * 4.0 * std::f64::consts::PI / TRUTH_DIRECTIONS as f64;
                    }
                }
            }
            let norm = truth.iter().map(|t| t * t).sum::<f64>().sqrt();
            for (errors, (rung, directions)) in errors.iter_mut().zip(ROWS) {
                blockers.prepare(&spheres, rung, order, directions);
                let mut v = [0.0; MAX_COEFFICIENTS];
                blockers.visibility(Vec3::ZERO, Vec3::Z, None, &mut v);
                let off: f64 = v.iter().zip(truth).map(|(v, t)| (f64::from(*v) - t).powi(2)).sum();
                errors[k] += off.sqrt() / norm / SCENES as f64;
            }
        }
    }
    errors
}

#[test]
fn the_ladder_is_as_accurate_as_the_spec_says() {
    let Some(shared) = support::shared("the_ladder_is_as_accurate_as_the_spec_says") else { return };
    golden::run_f32(&shared, &[("ladder", ladder_entry)]);
}

/// The scenes of an entry: whether they are clustered.
fn is_clustered(entry: &Entry) -> bool {
    require_eps(entry);
    match entry.text("scene") {
        s if s.starts_with("k centres uniform on upper hemisphere, angular radius U(5,30)") => false,
        s if s.contains("unit(axis+0.45*N(0,1)^3)") && s.contains("U(5,25)") => true,
        other => entry.unknown(&format!("its scene is {other}")),
    }
}

fn ladder_entry(entry: &Entry) {
    let (id, order, clustered) = (entry.id, entry.count("order"), is_clustered(entry));
    let errors = ladder(order, clustered);
    println!("{id}: mean relative L2 error of V for 1, 2, 5, 10, 20 spheres, {SCENES} scenes");
    for ((rung, directions), row) in ROWS.iter().zip(errors) {
        println!("  {} {directions}: {row:.4?}", rung.name());
    }
    let names = ["dc_product", "optimal_linear", "hybrid", "scaling_squaring_taylor2", "chain"];
    for (row, name) in errors.iter().zip(names) {
        for ((got, want), count) in row.iter().zip(numbers(&entry.expected[name])).zip(COUNTS) {
            // Other random numbers than the 60 scenes of the file, and a truth of 20000 directions (0.0005): the means
            // scatter by a fifth. Dropping caps in caps makes ours a little better.
            let most = 0.001 + 0.2 * want;
            assert!((got - want).abs() < most, "{id} {name}, {count}: {got} instead of {want}");
        }
    }
    // Soft directions, spec 7 at order 4; their error grows with the order and shrinks with N.
    if order == 4 && !clustered {
        let spec = [
            [0.018, 0.023, 0.034, 0.047, 0.060],
            [0.008, 0.011, 0.017, 0.022, 0.030],
            [0.004, 0.005, 0.008, 0.012, 0.016],
        ];
        for (row, spec) in errors[5..].iter().zip(spec) {
            for (got, want) in row.iter().zip(spec) {
                // Without the error of the constant ours is up to a third better at one sphere.
                let fair = 0.6 * want..1.1 * want;
                assert!(fair.contains(got), "{id}: {row:?} instead of {spec:?}");
            }
        }
    }
    for k in 0..5 {
        assert!(errors[6][k] < errors[5][k] && errors[7][k] < errors[6][k], "{id}: more directions help");
    }
    assert!(errors[7][4] < errors[4][4], "{id}: with 20 spheres 256 directions beat the chain");
}
