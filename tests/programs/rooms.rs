//! Known rooms. One program for several files: linking costs more than most of them take to run.
#![allow(clippy::duplicate_mod, reason = "each file says itself what it shares")]

#[path = "../f3.rs"]
mod f3;
#[path = "../f3_maps.rs"]
mod f3_maps;
#[path = "../near_forms.rs"]
mod near_forms;
#[path = "../room_input.rs"]
mod room_input;
#[path = "../room_objects.rs"]
mod room_objects;
#[path = "../room_scene.rs"]
mod room_scene;
#[path = "../room_suns.rs"]
mod room_suns;
