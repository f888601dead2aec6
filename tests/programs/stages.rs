//! Stages on real input and on ray-traced truth. One program for several files: linking costs more than most of them take to run.
#![allow(clippy::duplicate_mod, reason = "each file says itself what it shares")]

#[path = "../assets.rs"]
mod assets;
#[path = "../ball.rs"]
mod ball;
#[path = "../ball_held_out.rs"]
mod ball_held_out;
#[path = "../calibrate.rs"]
mod calibrate;
#[path = "../calibration.rs"]
mod calibration;
#[path = "../figures.rs"]
mod figures;
#[path = "../fuse.rs"]
mod fuse;
#[path = "../hdr.rs"]
mod hdr;
#[path = "../hdr_faults.rs"]
mod hdr_faults;
#[path = "../hdr_truth.rs"]
mod hdr_truth;
#[path = "../imu_fusion.rs"]
mod imu_fusion;
#[path = "../light.rs"]
mod light;
#[path = "../light_export.rs"]
mod light_export;
#[path = "../light_verb.rs"]
mod light_verb;
#[path = "../real_ball.rs"]
mod real_ball;
#[path = "../real_shadow.rs"]
mod real_shadow;
#[path = "../spheres.rs"]
mod spheres;
#[path = "../tags.rs"]
mod tags;
#[path = "../tags_blurred.rs"]
mod tags_blurred;
#[path = "../thin_parts.rs"]
mod thin_parts;
#[path = "../walker.rs"]
mod walker;
