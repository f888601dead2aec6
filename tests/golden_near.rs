//! The shared golden numbers for near light in a known room.

#[path = "support/golden.rs"]
mod golden;
mod support;

use glam::DVec3;
use golden::{Entry, Precision};
use halflight::nearfield::form_factor::form_factor;

fn ff<T: Precision>(entry: &Entry) {
    let point = DVec3::from_slice(&entry.list::<f64>("point"));
    let normal = DVec3::from_slice(&entry.list::<f64>("normal"));
    let corners: Vec<DVec3> = entry.list::<f64>("polygon").chunks(3).map(DVec3::from_slice).collect();
    entry.check_key("F_exact", Some(&[T::of(form_factor(point, normal, &corners))]));
}

#[test]
fn golden_near() {
    let Some(shared) = support::shared("golden_near") else { return };
    golden::run(&shared, &[("ff", ff::<f64>, ff::<f32>)], &[]);
}
