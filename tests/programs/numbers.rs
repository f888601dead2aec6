//! The golden numbers. One program for several files: linking costs more than most of them take to run.
#![allow(clippy::duplicate_mod, reason = "each file says itself what it shares")]
#![allow(clippy::module_inception, reason = "a file of tests may share what is called like it")]

#[path = "../golden.rs"]
mod golden;
#[path = "../golden_blockers.rs"]
mod golden_blockers;
#[path = "../golden_near.rs"]
mod golden_near;
#[path = "../golden_stages.rs"]
mod golden_stages;
