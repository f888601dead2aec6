//! Cameras behind libcamera, as `halflight devices` shows them.

use crate::device::libcamera::{
    self,
    list::{self, LibcameraSensor},
};
use crate::device::v4l2::format::{self, FormatWish};
use serde_json::{Value, json};

/// What libcamera lists, or why it cannot be asked.
pub struct LibraryCameras(Result<Vec<LibcameraSensor>, String>);

impl LibraryCameras {
    /// Asks the library, which takes a tenth of a second.
    pub fn look() -> Self {
        Self(list::sensors().map_err(|e| e.to_string()))
    }

    /// The camera that `device.camera = "auto"` prefers to those of V4L2, and why.
    pub fn best() -> Option<(String, String)> {
        let id = libcamera::best()?;
        let why = "device.camera = auto takes it: V4L2 has no camera on USB".to_owned();
        Some((format!("libcamera:{id}"), why))
    }

    /// For programs.
    pub fn json(&self) -> Vec<Value> {
        self.0.iter().flatten().map(json_of).collect()
    }

    /// For people.
    pub fn print(&self) {
        match &self.0 {
            Err(why) => println!("  not usable: {why}"),
            Ok(cameras) if cameras.is_empty() => {
                println!("  none: it lists what a running udevd has seen and this user may open");
            }
            Ok(cameras) => cameras.iter().for_each(print),
        }
    }
}

fn json_of(camera: &LibcameraSensor) -> Value {
    let offers: Vec<Value> = (camera.formats().iter())
        .map(|offer| {
            json!({
                "format": format::shown(offer.fourcc), "width_px": offer.width, "height_px": offer.height,
                "score": format::score(offer, &FormatWish::default()),
            })
        })
        .collect();
    json!({
        "name": camera.name(), "model": camera.model, "usable": camera.chosen().is_some(), "offers": offers,
    })
}

fn print(camera: &LibcameraSensor) {
    println!("  {}  {}", camera.name(), camera.model);
    for offer in camera.formats() {
        let score = format::score(&offer, &FormatWish::default());
        let of = score.map_or("not read".to_owned(), |points| format!("score {points:6.1}"));
        println!("    {} {:>4}x{:<4} {of}", format::shown(offer.fourcc), offer.width, offer.height);
    }
    if camera.chosen().is_none() {
        println!("    it has no format that is read here");
    }
}
