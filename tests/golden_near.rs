//! The shared golden numbers for near light in a known room.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

#[path = "support/golden.rs"]
mod golden;
mod support;

use glam::{DVec3, Vec3};
use golden::{Entry, Precision, numbers};
use halflight::{
    model::room::RoomPatch,
    nearfield::{
        form_factor::form_factor,
        intensity::intensity_transfers,
        sets::{budget_threshold, source_set},
        shaft::{Aabb, shaft_interval},
        two_sets::{self, Division, Experiment, Off, Strengths},
    },
    sources::{
        expand::{Expander, Marked, Priority, WantedNodes},
        tree::SourceTree,
    },
};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

fn ff<T: Precision>(entry: &Entry) {
    let point = DVec3::from_slice(&entry.list::<f64>("point"));
    let normal = DVec3::from_slice(&entry.list::<f64>("normal"));
    let corners: Vec<DVec3> = entry.list::<f64>("polygon").chunks(3).map(DVec3::from_slice).collect();
    entry.check_key("F_exact", Some(&[T::of(form_factor(point, normal, &corners))]));
}

/// The displayed value of light of 0 to 1.
fn tone<T: Precision>(light: T) -> T {
    T::of(255.0) * light.max(T::zero()).min(T::one()).powf(T::of(1.0 / 2.2))
}

fn transfer<T: Precision>(entry: &Entry) {
    let light = entry.list::<T>("L_ij_sorted");
    let second: Vec<bool> = entry.list::<f64>("set").iter().map(|s| *s == 1.0).collect();
    let total = entry.number::<T>("L_i");
    entry.require("T", "255*clamp(x,0,1)^(1/2.2)");
    let mut values = Vec::new();
    intensity_transfers(&light, &second, total, &tone::<T>, &mut values);
    entry.check_key("S", Some(&values));
    let occluded: Vec<usize> = entry.list::<f64>("occluded").iter().map(|i| *i as usize).collect();
    let (mut shown, mut left) = (tone(total), total);
    for i in occluded {
        shown = shown - values[i];
        left = left - light[i];
    }
    entry.check_key("I_ldr", Some(&[shown]));
    entry.check_key("I_exact", Some(&[tone(left)]));
}

/// The file's eight datasets are one draw, and with a tail as heavy as theirs draws differ: seven of ten are within the
/// file's tolerance. The median of 15 draws is.
fn fig3<T: Precision>(entry: &Entry) {
    let hidden: Vec<usize> = entry.list::<f64>("P").iter().map(|p| *p as usize).collect();
    entry.require("T", "255*clamp(x)^(1/2.2)");
    let strengths = match entry.text("sources") {
        "pareto(1.5)+0.05" => Strengths::Pareto,
        s if s.starts_with("uniform") => Strengths::Uniform,
        other => entry.unknown(&format!("its sources are {other}")),
    };
    let draw = |seed: u64| {
        let about = Experiment {
            sources: entry.count("N"),
            strengths,
            division: Division::Chance((100.0 * entry.number::<f64>("split")) as usize),
            datasets: entry.count("datasets"),
            trials: 100,
            seed,
        };
        two_sets::run(&about, &hidden, &tone::<T>)
    };
    let draws: Vec<Vec<Off>> = (1..=15).map(draw).collect();
    let median = |of: fn(&Off) -> f64| -> Vec<T> {
        let middle = |k: usize| {
            let mut values: Vec<f64> = draws.iter().map(|d| of(&d[k])).collect();
            values.sort_by(f64::total_cmp);
            T::of(values[values.len() / 2])
        };
        (0..hidden.len()).map(middle).collect()
    };
    entry.check_key("mean", Some(&median(|off| off.mean)));
    entry.check_key("std", Some(&median(|off| off.std)));
    entry.check_key("rms", Some(&median(|off| off.rms)));
}

fn shaft(entry: &Entry) {
    let boxed = |key: &str| {
        let v = entry.list::<f64>(key);
        Aabb {
            low: Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32),
            high: Vec3::new(v[3] as f32, v[4] as f32, v[5] as f32),
        }
    };
    let met = shaft_interval(&boxed("source_box"), &boxed("receiver_box"), &boxed("object_box"));
    assert_eq!(met.is_some(), entry.expected["intersects"] == true, "{}", entry.id);
    entry.check_key::<f32>("t_interval", met.as_ref().map(|t| &t[..]));
}

fn names(value: &Value) -> Vec<String> {
    value.as_array().unwrap().iter().map(|v| v.as_str().unwrap().to_owned()).collect()
}

/// A leaf of the file's tree.
struct FileLeaf {
    id: String,
    transfer: f32,
    /// Halved at each level, so that both halves of every node weigh the same.
    weight: f32,
}

/// Leaves of the file's tree from left to right; the leaves below each of its nodes.
fn leaves(
    node: &Value,
    weight: f32,
    all: &mut Vec<FileLeaf>,
    below: &mut BTreeMap<BTreeSet<String>, String>,
) -> BTreeSet<String> {
    let id = node["id"].as_str().unwrap().to_owned();
    let own = match node["ch"].as_array() {
        Some(children) => children.iter().flat_map(|c| leaves(c, 0.5 * weight, all, below)).collect(),
        None => {
            all.push(FileLeaf { id: id.clone(), transfer: node["t"].as_f64().unwrap() as f32, weight });
            BTreeSet::from([id.clone()])
        }
    };
    below.insert(own.clone(), id);
    own
}

fn representatives(entry: &Entry) {
    let (mut all, mut below) = (Vec::new(), BTreeMap::new());
    leaves(&entry.inputs["tree"], 1.0, &mut all, &mut below);
    // In a row, where the tree cuts at the median of weight: between the halves of each node of the file's.
    let places: Vec<Vec3> = (0..all.len()).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
    let weights: Vec<f32> = all.iter().map(|leaf| leaf.weight).collect();
    let tree = SourceTree::build(&places, &weights);
    let name = |node: u32| {
        let node = tree.nodes()[node as usize];
        let own: BTreeSet<String> = (node.begin..node.end).map(|l| all[l as usize].id.clone()).collect();
        below.get(&own).cloned().unwrap_or_else(|| entry.unknown("its tree has other than two children"))
    };
    let marked = names(&entry.inputs["marked_leaves"]);
    let light: Vec<f32> =
        all.iter().map(|leaf| if marked.contains(&leaf.id) { leaf.transfer } else { 0.0 }).collect();
    let towards: Vec<Vec3> = places.iter().map(|p| (*p + Vec3::Z * 3.0).normalize()).collect();
    let mut expander = Expander::default();
    let trees = [Marked { tree: &tree, light: &light, towards: &towards, lasting: true }];
    let chosen = expander.expand(&trees, WantedNodes::exactly(entry.count("n")), Priority::Transfer);
    let got: BTreeSet<String> = chosen.iter().map(|c| name(c.node)).collect();
    let want = names(&entry.expected["fixed_key_marked_only_collapsed"]);
    assert_eq!(got, want.into_iter().collect(), "{}", entry.id);
}

fn sources_by_radiance(entry: &Entry) {
    let listed = entry.inputs["patches"].as_array().unwrap();
    let number = |patch: &Value, key: &str| patch[key].as_f64().unwrap() as f32;
    let patches: Vec<RoomPatch> = listed
        .iter()
        .map(|p| RoomPatch {
            corners: [0, 1, 2, 2],
            centre_world: Vec3::ZERO,
            normal_world: Vec3::Z,
            area_m2: number(p, "A"),
            radiance_rgb: [number(p, "L"); 3],
            reflectance_rgb: [0.0; 3],
            seen: true,
            surface: 0,
        })
        .collect();
    let set = source_set(&patches, entry.number::<f64>("fraction"));
    let got: Vec<&str> = set.patches.iter().map(|&i| listed[i as usize]["id"].as_str().unwrap()).collect();
    assert_eq!(got, names(&entry.expected["by_radiance"]), "{}", entry.id);
    assert_eq!(set.left_out, listed.len() - got.len());
    let power = |p: &Value| f64::from(number(p, "A") * number(p, "L"));
    let share = set.patches.iter().map(|&i| power(&listed[i as usize])).sum::<f64>()
        / listed.iter().map(power).sum::<f64>();
    assert!((f64::from(set.power_share) - share).abs() < 1e-6, "{}: {}", entry.id, set.power_share);
}

fn dropped_by_a_budget(entry: &Entry) {
    let mut values = vec![1.0f32; entry.count("N_equal_sources")];
    let threshold = budget_threshold(&mut values, entry.number::<f64>("threshold"));
    let dropped = values.iter().filter(|v| **v < threshold).count() as f64 / values.len() as f64;
    let most = numbers(&entry.expected["budgeted_dropped_max"])[0];
    assert!(dropped <= most, "{}: {dropped}", entry.id);
    // The rule as printed drops each share below the threshold, which is all of them or none.
    let naive = (1.0 / values.len() as f64) < entry.number::<f64>("threshold");
    let naive_dropped = numbers(&entry.expected["naive_dropped_energy"])[0];
    assert_eq!(f64::from(u8::from(naive)), naive_dropped, "{}", entry.id);
}

fn rule(entry: &Entry) {
    match ["tree", "patches", "N_equal_sources"].map(|key| entry.has(key)) {
        [_, _, true] => dropped_by_a_budget(entry),
        [true, ..] => representatives(entry),
        [_, true, _] => sources_by_radiance(entry),
        _ => entry.unknown("neither a tree, patches nor equal sources"),
    }
}

#[test]
fn golden_near() {
    let Some(shared) = support::shared("golden_near") else { return };
    golden::run(
        &shared,
        &[
            ("ff", ff::<f64>, ff::<f32>),
            ("transfer", transfer::<f64>, transfer::<f32>),
            ("fig3", fig3::<f64>, fig3::<f32>),
        ],
    );
    golden::run_f32(&shared, &[("shaft", shaft), ("rule", rule)]);
}
