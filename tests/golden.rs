//! The shared golden numbers for the rooms of `math`, each in f64 and in f32 with the tolerances of the file:
//! pass if |got - expected| <= abs + rel |expected|; `null` must be reported as failure.

#[path = "support/golden.rs"]
mod golden;
mod support;

use golden::{Check, Entry, Precision, numbers};
use halflight::math::rigid::{self, Quaternion, Rigid};
use halflight::math::sh::{MAX_COEFFICIENTS, basis, product, project, zonal};
use halflight::math::{charts, mirror_ball, quadrature, sphere, vector::Vector};
use halflight::track::align::{self, MapView};
use serde_json::Value;
use support::wanted;

fn sh<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let mut y = [T::zero(); MAX_COEFFICIENTS];
    basis::evaluate(order, entry.direction("direction_unnormalised"), &mut y);
    entry.check("basis", entry.expected, Some(&y[..order * order]));
}

fn zh<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let mut z = vec![T::zero(); order];
    let definition = entry.text("definition");
    match (entry.has("s"), definition) {
        (true, d) if d.starts_with("(s+2)") => {
            zonal::phong(order, entry.number("s"), zonal::PhongNorm::Paper, &mut z);
        }
        (true, d) if d.starts_with("(s+1)") => {
            zonal::phong(order, entry.number("s"), zonal::PhongNorm::EnergySafe, &mut z);
        }
        (false, d) if d.contains("delta") || d.contains("mirror") || d.starts_with("sqrt") => {
            zonal::mirror(order, &mut z);
        }
        (false, d) if d.contains("cos") => zonal::lambert(order, &mut z),
        _ => entry.unknown(&format!("its definition is {}", entry.inputs["definition"])),
    }
    entry.check("lobe", entry.expected, Some(&z[..]));
}

fn zhrot<T: Precision>(entry: &Entry) {
    let zh = entry.list::<T>("zh");
    let mut out = vec![T::zero(); zh.len() * zh.len()];
    zonal::rotate(&zh, entry.direction("axis_unnormalised"), &mut out);
    entry.check("rotated", entry.expected, Some(&out[..]));
}

fn gamma<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let table = product::gamma(order);
    let times = |g: &product::Gamma| match (g.i == g.j, g.j == g.k) {
        (true, true) => 1,
        (true, false) | (false, true) => 3,
        (false, false) => 6,
    };
    let nonzero: usize = table.iter().map(times).sum();
    let expected = |key: &str| entry.expected.get(key).is_some();
    match (entry.has("f"), expected("sum_abs"), expected("unique")) {
        (false, true, _) => {
            let sum = |of: fn(f64) -> f64| {
                T::of(table.iter().map(|g| times(g) as f64 * of(T::of(g.integral).wide())).sum())
            };
            entry.check_key("nnz", Some(&[T::of(nonzero as f64)]));
            entry.check_key("unique", Some(&[T::of(table.len() as f64)]));
            entry.check_key("sum_abs", Some(&[sum(f64::abs)]));
            entry.check_key("sum_sq", Some(&[sum(|v| v * v)]));
        }
        (false, false, true) => {
            entry.check_key("nnz", Some(&[T::of(nonzero as f64)]));
            let mut sorted = table.to_vec();
            sorted.sort_by_key(|g| (g.i, g.j, g.k));
            let rows: Vec<T> = sorted
                .iter()
                .flat_map(|g| [g.i as f64, g.j as f64, g.k as f64, g.integral].map(T::of))
                .collect();
            entry.check_key("unique", Some(&rows[..]));
        }
        (true, ..) => {
            let (f, g) = (entry.list::<T>("f"), entry.list::<T>("g"));
            let count = order * order;
            let mut h = vec![T::zero(); count];
            product::product(order, &f, &g, &mut h);
            entry.check("product", entry.expected, Some(&h[..]));
            let mut matrix = vec![T::zero(); count * count];
            product::product_matrix(order, &f, &mut matrix);
            for (row, h) in matrix.chunks(count).zip(&mut h) {
                *h = row.iter().zip(&g).fold(T::zero(), |sum, (m, g)| sum + *m * *g);
            }
            entry.check("product matrix", entry.expected, Some(&h[..]));
        }
        _ => entry.unknown("neither a product nor counts of triple products"),
    }
}

fn alpha<T: Precision>(entry: &Entry) {
    entry.check("alpha", entry.expected, Some(&[zonal::alpha::<T>(entry.count("order"))]));
}

fn map<T: Precision>(entry: &Entry) {
    match ["rho_over_D", "ray", "u"].map(|key| entry.has(key)) {
        [true, ..] => {
            let (q, r) = (entry.number::<T>("rho_over_D"), entry.number::<T>("r_silhouette_normalised"));
            let theta = charts::ball_polar_angle(q, r).map(|v| [v]);
            entry.check_key("theta_from_camera_axis", theta.as_ref().map(|v| &v[..]));
            let jacobian = charts::ball_jacobian(q, r).map(|v| [v]);
            entry.check_key("jacobian", jacobian.as_ref().map(|v| &v[..]));
            entry.check_key("blind_cone_half_angle", Some(&[charts::ball_blind_half_angle(q)]));
            entry.check_key("blind_fraction", Some(&[charts::ball_blind_fraction(q)]));
        }
        [_, true, _] => {
            let vector = |key| Vector::from_slice(&entry.list::<T>(key));
            let radius = entry.number::<T>("radius");
            let hit = mirror_ball::mirrored(vector("camera"), vector("ray"), vector("centre"), radius);
            assert_eq!(hit.is_some(), entry.expected["hit"] == true, "{}", entry.id);
            entry.check_key("point", hit.as_ref().map(|hit| &hit.point.0[..]));
            entry.check_key("reflected", hit.as_ref().map(|hit| &hit.reflected.0[..]));
        }
        [_, _, true] => {
            let (u, v) = (entry.number::<T>("u"), entry.number::<T>("v"));
            let ball = charts::ball_orthographic_direction(u, v);
            entry.check_key("mirror_ortho_dir", ball.as_ref().map(|v| &v[..]));
            let angular = charts::angular_direction(u, v);
            entry.check_key("angularmap_dir", angular.as_ref().map(|v| &v[..]));
            // Outside of the disc there is no direction, and a density means nothing.
            if ball.is_some() {
                entry.check_key("mirror_ortho_jacobian", Some(&[charts::ball_orthographic_jacobian::<T>()]));
            }
            if angular.is_some() {
                entry.check_key("angularmap_jacobian", Some(&[charts::angular_jacobian(u, v)]));
            }
        }
        _ => entry.unknown("neither a ball, a ray nor a place of a map"),
    }
}

fn omega<T: Precision>(entry: &Entry) {
    let width = entry.count("width");
    let sum = |of: fn(usize, usize, usize) -> T| {
        let mut tree = project::TreeSum::<T, 1>::default();
        for texel in 0..width * width {
            tree.push([of(width, texel % width, texel / width)]);
        }
        T::of(6.0) * tree.sum()[0]
    };
    let (eq7, exact) = (charts::cube_texel_solid_angle_midpoint::<T>, charts::cube_texel_solid_angle::<T>);
    entry.check_key("eq7_sum6", Some(&[sum(eq7)]));
    entry.check_key("exact_sum6", Some(&[sum(exact)]));
    entry.check_key("corner_eq7", Some(&[eq7(width, 0, 0)]));
    entry.check_key("corner_exact", Some(&[exact(width, 0, 0)]));
    entry.check_key("centre_exact", Some(&[exact(width, width / 2, width / 2)]));
}

fn project_<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let kappa = entry.number::<T>("kappa");
    let axis = entry.direction::<T>("axis");
    let lobe = |d: [T; 3], axis: [T; 3]| {
        (kappa * (d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2] - T::one())).exp()
    };
    entry.require("env", "exp(kappa*(w.a-1))");
    // Its bands fall as exp(-l^2 / (2 kappa)): this degree has converged long before rounding.
    let nodes = quadrature::sphere(60.max((60.0 * kappa.wide()).sqrt() as usize + 12));
    let samples = |axis: [T; 3]| {
        nodes.iter().map(move |(direction, weight)| {
            let direction = direction.map(T::of);
            project::Sample { direction, solid_angle: T::of(*weight), radiance: [lobe(direction, axis)] }
        })
    };
    let got = project::project(order, samples(axis)).map(|[v]| v);
    entry.check_key("sh", Some(&got[..order * order]));
    let up = project::project(order, samples([T::zero(), T::zero(), T::one()])).map(|[v]| v);
    let zh: Vec<T> = (0..order).map(|l| up[l * (l + 1)]).collect();
    entry.check_key("zh", Some(&zh[..]));
    let mut turned = vec![T::zero(); order * order];
    zonal::rotate(&zh, axis, &mut turned);
    entry.check_key("sh", Some(&turned[..]));
    // The entry's note on a cube of 64, as shares of the largest coefficient; a lobe that is finer asks for finer texels.
    let width = 64.max((64.0 * (0.5 * kappa.wide()).sqrt()).ceil() as usize);
    let want = numbers(&entry.expected["sh"]);
    let largest = want.iter().fold(0.0, |most: f64, w| w.abs().max(most));
    let (eq7, exact) = (charts::cube_texel_solid_angle_midpoint::<T>, charts::cube_texel_solid_angle::<T>);
    for (weight, low, high) in
        [(eq7 as fn(usize, usize, usize) -> T, "midpoint", "midpoint"), (exact, "low", "high")]
    {
        let texels = (0..6 * width * width).map(|texel| {
            let (face, j, i) = (texel / (width * width), texel / width % width, texel % width);
            let centre = |k: usize| 2.0 * (k as f64 + 0.5) / width as f64 - 1.0;
            let direction = sphere::cube_direction(face, centre(i), centre(j)).to_array().map(T::of);
            project::Sample { direction, solid_angle: weight(width, i, j), radiance: [lobe(direction, axis)] }
        });
        for (i, ([got], want)) in project::project(order, texels).iter().zip(&want).enumerate() {
            let figure = if i < 16 { low } else { high };
            wanted::hold(&format!("golden.cube.{figure}"), (got.wide() - want).abs() / largest);
        }
    }
}

fn single<T: Precision>(entry: &Entry) {
    let got = match (entry.has("r_over_d"), entry.has("cos") && entry.has("s")) {
        (true, _) => {
            entry.require("quantity", "1-sqrt(1-R)");
            let ratio = entry.number::<T>("r_over_d");
            zonal::one_minus_cosine(ratio * ratio)
        }
        (_, true) => zonal::phong_lobe(entry.number::<T>("cos"), entry.number("s")),
        _ => entry.unknown("neither a small cap nor a power of a cosine"),
    };
    entry.check("stable form", entry.expected, Some(&[got]));
}

fn vs<T: Precision>(entry: &Entry) {
    let order = entry.count("order");
    let ratio = entry.number::<T>("r_over_d");
    let mut blocked = vec![T::zero(); order];
    zonal::cap(order, ratio * ratio, &mut blocked);
    let mut visible: Vec<T> = blocked.iter().map(|b| -*b).collect();
    visible[0] += (T::of(4.0) * T::PI()).sqrt();
    let keys = entry.expected.as_object().into_iter().flat_map(|keys| keys.keys());
    for key in keys {
        match key.as_str() {
            // From inside of a sphere the hemisphere about its centre is blocked.
            "V" | "V_clampR1" => entry.check_key(key, Some(&visible[..])),
            "blocked_B" => entry.check_key(key, Some(&blocked[..])),
            "nan_forbidden" => assert!(visible.iter().all(|v| v.is_finite()), "{}", entry.id),
            _ => entry.unknown(&format!("it expects {key}")),
        }
    }
}

/// Self-shadow by the mean of visibility alone (Section 6.2 of [Now11]): V of a hemisphere has V_0 / sqrt(4 pi) = 1/2,
/// which would halve the light on an open convex body. The product uses the cosine-weighted share, which is 1 there
/// (`visibility::openness` tests that on meshes); here what the mean alone does is held.
fn dcshadow<T: Precision>(entry: &Entry) {
    let whole = (T::of(4.0) * T::PI()).sqrt();
    let mean = match ["V", "V0", "angular_radius_deg"].map(|key| entry.has(key)) {
        [true, ..] => numbers(&entry.inputs["V"])[0],
        [_, true, _] => entry.number::<f64>("V0"),
        [_, _, true] => {
            let sine = entry.number::<f64>("angular_radius_deg").to_radians().sin();
            let mut blocked = [0.0];
            zonal::cap(1, sine * sine, &mut blocked);
            (4.0 * std::f64::consts::PI).sqrt() - blocked[0]
        }
        _ => entry.unknown("no visibility among its inputs"),
    };
    let scale = T::of(mean) / whole;
    // The product with a function whose constant alone is not zero scales by it.
    let scaled = |key: &str| {
        let f = entry.list::<T>(key);
        let order = f.len().isqrt();
        let (mut constant, mut out) = (vec![T::zero(); f.len()], vec![T::zero(); f.len()]);
        constant[0] = T::of(mean);
        product::product(order, &constant, &f, &mut out);
        out
    };
    let function = ["L", "f"].into_iter().find(|key| entry.has(key));
    match (entry.expected, function) {
        (Value::Number(_), _) => entry.check("scale", entry.expected, Some(&[scale])),
        (Value::Array(_), Some(key)) => entry.check("scaled", entry.expected, Some(&scaled(key)[..])),
        (Value::Object(keys), _) => {
            for key in keys.keys() {
                match (key.as_str(), function) {
                    ("scale" | "factor" | "V0_over_sqrt4pi", _) => entry.check_key(key, Some(&[scale])),
                    ("scaled" | "product", Some(of)) => entry.check_key(key, Some(&scaled(of)[..])),
                    _ => entry.unknown(&format!("it expects {key}")),
                }
            }
        }
        _ => entry.unknown("what it expects is neither a scale nor a scaled function"),
    }
}

fn align_<T: Precision>(entry: &Entry) {
    // Row by row in the file.
    let columns = |key| {
        let rows = entry.list::<T>(key);
        std::array::from_fn(|c| Vector(std::array::from_fn(|r| rows[3 * r + c])))
    };
    match ["t", "R1_world_to_cam", "p_marker"].map(|key| entry.has(key)) {
        [true, ..] => {
            let quaternion = |key| {
                let q = entry.list::<T>(key);
                Quaternion([q[1], q[2], q[3], q[0]])
            };
            let [x, y, z, w] = quaternion("q0").slerp(quaternion("q1"), entry.number("t")).0;
            entry.check("slerp", entry.expected, Some(&[w, x, y, z]));
        }
        [_, true, _] => {
            let pose = |key| Rigid::from_columns(&columns(key), Vector::zero());
            let camera_from_slam = pose("R1_world_to_cam");
            let camera_from_marker = pose("Rhat1_world_to_cam");
            // The file's R = Rhat^-1 R.
            let got = camera_from_marker.inverse().then(&camera_from_slam).rotation;
            let rows = |q: Quaternion<T>| std::array::from_fn::<T, 9, _>(|i| q.columns()[i % 3].0[i / 3]);
            entry.check_key("R_marker_to_slam", Some(&rows(got)));
            let mean = rigid::nearest_rotation(&got.columns().map(|c| c * T::of(3.0))).map(rows);
            entry.check_key("R_marker_to_slam", mean.as_ref().map(|v| &v[..]));
        }
        [_, _, true] => {
            let (known, map) = (entry.list::<T>("p_marker"), entry.list::<T>("p_slam"));
            let pairs = known.chunks_exact(3).zip(map.chunks_exact(3));
            let views: Vec<MapView<T>> = pairs
                .map(|(p, q)| MapView { known_m: Vector::from_slice(p), map: Vector::from_slice(q) })
                .collect();
            let turn = Rigid::from_columns(&columns("R"), Vector::zero()).rotation;
            let pair = (views.len() > 1).then(|| [views[0], views[1]]);
            let placement = align::place(turn, &views);
            let check =
                |key: &str, got: Option<T>| entry.check_key(key, got.as_ref().map(std::slice::from_ref));
            for key in entry.expected.as_object().into_iter().flat_map(|keys| keys.keys()) {
                match key.as_str() {
                    "t_2d_paper" => check(key, pair.and_then(|pair| align::scale_of_two_flat(turn, &pair))),
                    "t_3d" => check(key, pair.and_then(|pair| align::scale_of_two(turn, &pair))),
                    "scale_lsq" => check(key, placement.map(|p| p.scale)),
                    "origin_lsq" => entry.check_key(key, placement.as_ref().map(|p| &p.origin.0[..])),
                    _ => entry.unknown(&format!("it expects {key}")),
                }
            }
        }
        _ => entry.unknown("neither turns to go between, two poses nor views"),
    }
}

/// The groups tested here, with the test in each precision.
const GROUPS: [(&str, Check, Check); 12] = [
    ("sh", sh::<f64>, sh::<f32>),
    ("zh", zh::<f64>, zh::<f32>),
    ("zhrot", zhrot::<f64>, zhrot::<f32>),
    ("gamma", gamma::<f64>, gamma::<f32>),
    ("alpha", alpha::<f64>, alpha::<f32>),
    ("map", map::<f64>, map::<f32>),
    ("omega", omega::<f64>, omega::<f32>),
    ("project", project_::<f64>, project_::<f32>),
    ("f32", single::<f64>, single::<f32>),
    ("vs", vs::<f64>, vs::<f32>),
    ("align", align_::<f64>, align_::<f32>),
    ("dcshadow", dcshadow::<f64>, dcshadow::<f32>),
];

#[test]
fn golden_numbers() {
    let Some(shared) = support::shared("golden_numbers") else { return };
    golden::run(&shared, &GROUPS);
}

/// Entries of our own: those of known kinds run whatever their ids and numbers, others fail with group and id.
#[test]
fn any_entry_of_a_known_kind_runs_and_others_are_named() {
    let tolerance = serde_json::json!({"abs": 1e-12, "rel": 1e-10, "f32_abs": 2e-6, "f32_rel": 1e-5});
    let run = |group: &str, inputs: Value, expected: Value| {
        let entry = serde_json::json!({
            "id": "of.our.own", "eq": "none", "group": group, "inputs": inputs, "expected": expected, "tolerance": tolerance
        });
        let file = serde_json::json!({ "entries": [entry] });
        let outcome = std::panic::catch_unwind(|| golden::run_entries(&file, &GROUPS, "f64 and f32"));
        outcome.err().map(|why| why.downcast_ref::<String>().cloned().unwrap_or_default())
    };
    let third = (5.0 / (4.0 * std::f64::consts::PI)).sqrt();
    let hemisphere = std::f64::consts::PI.sqrt();
    for (group, inputs, expected) in [
        (
            "zh",
            serde_json::json!({"order": 3, "definition": "delta"}),
            serde_json::json!([
                0.5 * (1.0 / std::f64::consts::PI).sqrt(),
                (0.75 / std::f64::consts::PI).sqrt(),
                third
            ]),
        ),
        ("f32", serde_json::json!({"s": 3, "cos": 0.5}), serde_json::json!(0.125)),
        ("f32", serde_json::json!({"s": 3, "cos": -0.5}), serde_json::json!(0.0)),
        ("dcshadow", serde_json::json!({"V0": hemisphere}), serde_json::json!(0.5)),
        (
            "dcshadow",
            serde_json::json!({"V": [hemisphere, 0.3, 0.2, 0.1]}),
            serde_json::json!({"scale": 0.5}),
        ),
        (
            "dcshadow",
            serde_json::json!({"angular_radius_deg": 90, "f": [1.0, -2.0, 3.0, 0.5]}),
            serde_json::json!([0.5, -1.0, 1.5, 0.25]),
        ),
    ] {
        assert_eq!(run(group, inputs, expected), None, "{group}");
    }
    for (group, inputs, expected, words) in [
        ("f32", serde_json::json!({"s": 3, "cos": 0.5}), serde_json::json!(0.126), "instead of 0.126"),
        (
            "zh",
            serde_json::json!({"order": 3, "definition": "a square"}),
            serde_json::json!([1.0]),
            "a square",
        ),
        (
            "vs",
            serde_json::json!({"order": 2, "r_over_d": 0.5}),
            serde_json::json!({"colour": 1.0}),
            "colour",
        ),
        ("dcshadow", serde_json::json!({"depth": 1}), serde_json::json!(0.5), "no visibility"),
    ] {
        let why = run(group, inputs, expected).expect(words);
        assert!(why.contains("of.our.own") && why.contains(words), "{why}");
    }
    let why = run("zh", serde_json::json!({"order": 3, "definition": "a square"}), serde_json::json!([1.0]));
    assert!(why.is_some_and(|why| why.contains("group zh")));
}

/// Every group of the file, and the test file that runs it.
const WHERE: [(&str, &str); 29] = [
    ("sh", "tests/golden.rs"),
    ("zh", "tests/golden.rs"),
    ("zhrot", "tests/golden.rs"),
    ("gamma", "tests/golden.rs"),
    ("alpha", "tests/golden.rs"),
    ("map", "tests/golden.rs"),
    ("omega", "tests/golden.rs"),
    ("project", "tests/golden.rs"),
    ("f32", "tests/golden.rs"),
    ("vs", "tests/golden.rs"),
    ("align", "tests/golden.rs"),
    ("factor", "tests/golden_stages.rs"),
    ("shade", "tests/golden_stages.rs"),
    ("hdr", "tests/golden_stages.rs"),
    ("tagpose", "tests/tags.rs"),
    ("bias", "tests/engine_cpu.rs"),
    ("ab", "tests/golden_blockers.rs"),
    ("dirs", "tests/golden_blockers.rs"),
    ("exp", "tests/golden_blockers.rs"),
    ("ff", "tests/golden_near.rs"),
    ("dcshadow", "tests/golden.rs"),
    ("fig3", "tests/golden_near.rs"),
    ("guard", "tests/golden_blockers.rs"),
    ("ladder", "tests/golden_blockers.rs"),
    ("logzh", "tests/golden_blockers.rs"),
    ("overlap", "tests/golden_blockers.rs"),
    ("rule", "tests/golden_near.rs"),
    ("shaft", "tests/golden_near.rs"),
    ("transfer", "tests/golden_near.rs"),
];

#[test]
fn every_group_has_its_place() {
    let Some(shared) = support::shared("every_group_has_its_place") else { return };
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    for entry in golden::file(&shared)["entries"].as_array().into_iter().flatten().map(Entry::of) {
        let group = entry.group;
        let Some((_, place)) = WHERE.iter().find(|(name, _)| *name == group) else {
            entry.unknown("its group is not in the list of tests/golden.rs");
        };
        let text = std::fs::read_to_string(root.join(place)).unwrap_or_default();
        assert!(text.contains(&format!("\"{group}\"")), "golden group {group} has no test in {place}");
    }
}
