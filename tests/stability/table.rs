//! The list of hard cases on each engine: ours keeps every bound, and the textbook's formula none.

use crate::engines;
use halflight::{
    engine::{Engine, gpu::Backend},
    stress,
};

fn every_bound(engine: &mut dyn Engine) {
    let mut broken = Vec::new();
    for case in stress::all() {
        let outcome = case.run(engine);
        if !outcome.holds {
            broken.push(format!("{}: {:?}, allowed {:?}", case.name, outcome.ours, case.bound));
        }
        assert!(!outcome.textbook_holds, "{}: the textbook's {} is no failure", case.name, outcome.textbook);
    }
    assert!(broken.is_empty(), "{}:\n  {}", engine.description(), broken.join("\n  "));
}

#[test]
fn cpu_keeps_every_bound() {
    every_bound(&mut engines::cpu());
}

#[test]
fn vulkan_keeps_every_bound() {
    engines::on(Backend::Vulkan, "hard cases", every_bound);
}

#[test]
fn gl_keeps_every_bound() {
    engines::on(Backend::Gl, "hard cases", every_bound);
}

#[test]
fn gles_3_1_keeps_every_bound() {
    engines::on_gles_3_1("table::gl_keeps_every_bound");
}

/// The same twice: nothing that a case leaves in an engine reaches the next.
#[test]
fn every_number_comes_again() {
    let (mut engine, mut fresh) = (engines::cpu(), engines::cpu());
    for case in stress::all().filter(|case| !case.name.contains("8192")) {
        let (first, again) = (case.run(&mut engine), case.run(&mut fresh));
        assert_eq!(first.ours.map(f64::to_bits), again.ours.map(f64::to_bits), "{}", case.name);
    }
    let mut back: Vec<_> = stress::all().filter(|case| !case.name.contains("8192")).collect();
    back.reverse();
    for case in back {
        let (first, again) = (case.run(&mut engine), case.run(&mut fresh));
        assert_eq!(first.ours.map(f64::to_bits), again.ours.map(f64::to_bits), "{}", case.name);
    }
}
