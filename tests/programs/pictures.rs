//! Stills, views and tables of error. One program for several files: linking costs more than most of them take to run.
#![allow(clippy::duplicate_mod, reason = "each file says itself what it shares")]

#[path = "../explain.rs"]
mod explain;
#[path = "../f1_table.rs"]
mod f1_table;
#[path = "../figures_verb.rs"]
mod figures_verb;
#[path = "../reference_truth.rs"]
mod reference_truth;
#[path = "../render.rs"]
mod render;
#[path = "../render_mirror.rs"]
mod render_mirror;
#[path = "../scene.rs"]
mod scene;
#[path = "../scene_still.rs"]
mod scene_still;
#[path = "../shadow_fit.rs"]
mod shadow_fit;
#[path = "../split_dial.rs"]
mod split_dial;
#[path = "../trace_verb.rs"]
mod trace_verb;
#[path = "../tradeoff.rs"]
mod tradeoff;
#[path = "../views.rs"]
mod views;
