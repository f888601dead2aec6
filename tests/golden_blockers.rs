//! The shared golden numbers for the visibility of many spheres: logarithms, tables, exponentials, soft directions
//! and the guard, in f64 and f32 through the kernels that frames run through.

#[path = "support/golden.rs"]
mod golden;
mod support;

use golden::{Entry, Precision, numbers};
use halflight::math::sh::{
    MAX_COEFFICIENTS, basis,
    cap::{self, Cap},
    lanes::{Lane, LaneSh, add_zonal, guard, nothing, product},
    log_exp, soft_directions,
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

/// Spheres of an entry as caps seen from the origin.
fn caps<T: Precision>(entry: &Entry) -> Vec<Cap<T>> {
    let list = entry.inputs["spheres"].as_array().unwrap();
    list.iter()
        .map(|sphere| {
            let c = numbers(&sphere["centre"]);
            let radius = T::of(sphere["radius"].as_f64().unwrap());
            let up = [T::zero(), T::zero(), T::one()];
            Cap::of_sphere([c[0], c[1], c[2]].map(T::of), radius, up).unwrap()
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
    all.unwrap()
}

fn logzh<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let sine = T::of(entry.inputs["angular_radius_deg"].as_f64().unwrap().to_radians().sin());
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
        .map(|cap| soft_directions::Ramp::of_cap(cap, T::of(h), T::of((0.5 * h).sin())))
        .collect();
    let mut v = vec![T::zero(); order * order];
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    for j in 0..count {
        let direction = soft_directions::direction(j, count).map(T::of);
        let open = ramps.iter().fold(T::one(), |open, ramp| open * ramp.at(direction));
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
    let order = entry.count("order");
    let sine = T::of(entry.inputs["angular_radius_deg"].as_f64().unwrap().to_radians().sin());
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
    let expected = entry.expected["chain_unguarded_mean"].as_f64().unwrap();
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
        &[],
    );
}
