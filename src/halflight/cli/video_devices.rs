//! Cameras of the kernel, as `halflight devices` shows them.

use crate::device::v4l2::{
    control,
    find::{self, FoundNode},
    format::{self, FormatWish},
    node::{ControlFacts, Offer, VideoNode},
    sys::KernelNode,
};
use serde_json::{Value, json};

/// A camera with all that is shown of it.
pub struct ListedCamera {
    node: FoundNode,
    offers: Vec<Offer>,
    controls: Vec<(ControlFacts, Option<i32>)>,
}

/// What was found: cameras, and nodes that could not be looked at with the reason.
#[derive(Default)]
pub struct ListedCameras {
    cameras: Vec<ListedCamera>,
    refused: Vec<(String, String)>,
}

impl ListedCameras {
    /// Looks at every video node.
    pub fn look() -> Self {
        let found = find::nodes();
        let mut listed = Self::default();
        for node in found.cameras {
            match KernelNode::open(&node.path).and_then(|open| Ok((open.offers()?, control::listed(&open)))) {
                Ok((offers, controls)) => listed.cameras.push(ListedCamera { node, offers, controls }),
                Err(error) => listed.refused.push((node.path.display().to_string(), error.to_string())),
            }
        }
        for (path, error) in found.refused {
            let why = find::refusal("v4l2", &path, error);
            listed.refused.push((path.display().to_string(), why.action));
        }
        listed
    }

    /// For programs.
    pub fn json(&self) -> Vec<Value> {
        let refused =
            self.refused.iter().map(|(path, why)| json!({ "path": path, "usable": false, "why": why }));
        self.cameras.iter().map(ListedCamera::json).chain(refused).collect()
    }

    /// For people.
    pub fn print(&self) {
        if self.cameras.is_empty() && self.refused.is_empty() {
            println!("  none: there is no /dev/video* that gives pictures");
        }
        for camera in &self.cameras {
            camera.print();
        }
        for (path, why) in &self.refused {
            println!("  {path}  not usable: {why}");
        }
    }
}

impl ListedCamera {
    fn chosen(&self) -> Option<&Offer> {
        format::best(&self.offers, &FormatWish::default()).map(|(offer, _)| offer)
    }

    fn json(&self) -> Value {
        let chosen = self.chosen();
        let offers: Vec<Value> = (self.offers.iter())
            .map(|offer| {
                json!({
                    "format": format::shown(offer.fourcc), "width_px": offer.width, "height_px": offer.height,
                    "frames_per_s": offer.rates.highest(), "score": format::score(offer, &FormatWish::default()),
                    "chosen": chosen.is_some_and(|chosen| std::ptr::eq(chosen, offer)),
                })
            })
            .collect();
        let controls: Vec<Value> = (self.controls.iter())
            .map(|(c, value)| {
                json!({
                    "name": c.name, "value": value, "least": c.least, "most": c.most, "step": c.step,
                    "default": c.default,
                })
            })
            .collect();
        let facts = &self.node.facts;
        json!({
            "path": self.node.path.display().to_string(), "usable": chosen.is_some(), "card": facts.card,
            "driver": facts.driver, "bus": facts.bus, "offers": offers, "controls": controls,
        })
    }

    fn print(&self) {
        let facts = &self.node.facts;
        println!("  v4l2:{}  {} ({}, {})", self.node.path.display(), facts.card, facts.driver, facts.bus);
        let chosen = self.chosen();
        for offer in &self.offers {
            let points = format::score(offer, &FormatWish::default());
            let rates: Vec<String> = offer.rates.as_slice().iter().map(|r| format!("{r:.0}")).collect();
            let of = match points {
                Some(points) => format!("score {points:6.1}"),
                None => "not read".to_owned(),
            };
            let mark =
                if chosen.is_some_and(|c| std::ptr::eq(c, offer)) { "  <- taken by default" } else { "" };
            println!(
                "    {} {:>4}x{:<4} {of}  {} frames/s{mark}",
                format::shown(offer.fourcc),
                offer.width,
                offer.height,
                rates.join(", ")
            );
        }
        for (c, value) in &self.controls {
            let now = value.map_or("?".to_owned(), |value| control::shown_value(c, value));
            println!(
                "    {:<28} {now}, {}..={} in steps of {}, default {}",
                c.name, c.least, c.most, c.step, c.default
            );
        }
        if !self.controls.iter().any(|(c, _)| c.id == control::id::EXPOSURE) {
            println!("    its exposure cannot be set: no brackets");
        }
    }
}
