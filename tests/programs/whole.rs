//! The whole pipeline, where nothing is counted or limited for the program as a whole. One program for several files: linking costs more than most of them take to run.
#![allow(clippy::duplicate_mod, reason = "each file says itself what it shares")]

#[path = "../animated.rs"]
mod animated;
#[path = "../foreign_recordings.rs"]
mod foreign_recordings;
#[path = "../governor.rs"]
mod governor;
#[path = "../live_settings.rs"]
mod live_settings;
#[path = "../recording.rs"]
mod recording;
#[path = "../recording_schemas.rs"]
mod recording_schemas;
#[path = "../ros_bags.rs"]
mod ros_bags;
#[path = "../synthetic.rs"]
mod synthetic;
