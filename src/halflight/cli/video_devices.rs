//! Cameras of the kernel, as `halflight devices` shows them.

use super::sensor_devices::{missing_json, print_missing};
use crate::device::at_hand::{
    PluggedMachine,
    rights::{MissingRight, RightOf},
};
use crate::device::v4l2::{
    control,
    find::{self, FoundNode},
    format::{self, FormatWish},
    node::{ControlFacts, Offer, VideoNode},
    sys::KernelNode,
};
use serde_json::{Value, json};
use std::path::Path;

/// A camera with all that is shown of it.
pub struct ListedCamera {
    node: FoundNode,
    offers: Vec<Offer>,
    controls: Vec<(ControlFacts, Option<i32>)>,
    /// The name of the sensor that a media controller has behind it.
    sensor: Option<String>,
}

/// What was found: cameras, and nodes that could not be looked at with the reason.
#[derive(Default)]
pub struct ListedCameras {
    cameras: Vec<ListedCamera>,
    refused: Vec<RefusedNode>,
}

/// A node that could not be looked at.
struct RefusedNode {
    path: String,
    why: String,
    missing: Option<MissingRight>,
}

/// What a rig file says of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFacts {
    /// As `device.camera` names it: by the card where it is the only one of its name.
    pub name: String,
    /// What the camera calls itself.
    pub card: String,
    /// Columns of the best offer.
    pub width: u32,
    /// Its rows.
    pub height: u32,
    /// Its highest rate.
    pub frames_per_s: Option<f64>,
    /// Least, most and step of the exposure control, seconds.
    pub exposure_s: Option<[f64; 3]>,
    /// Least and most gain, 1 at the driver's own choice.
    pub gain: Option<[f64; 2]>,
}

impl ListedCameras {
    /// Looks at every video node.
    pub fn look(machine: &PluggedMachine) -> Self {
        let found = find::nodes();
        let mut listed = Self::default();
        let refused = |path: &Path, why: String| RefusedNode {
            path: path.display().to_string(),
            why,
            missing: machine.missing(path, RightOf::Video),
        };
        for node in found.cameras {
            match KernelNode::open(&node.path).and_then(|open| Ok((open.offers()?, open))) {
                Ok((offers, open)) => {
                    let mut controls = control::listed(&open);
                    let sensor = open.sensor().map(|sensor| {
                        controls.extend(control::listed(sensor.controls.as_ref()));
                        sensor.name
                    });
                    listed.cameras.push(ListedCamera { node, offers, controls, sensor });
                }
                Err(error) => listed.refused.push(refused(&node.path, error.to_string())),
            }
        }
        for (path, error) in found.refused {
            let why = find::refusal("v4l2", &path, error);
            listed.refused.push(refused(&path, why.action));
        }
        listed
    }

    /// The camera with the best offer, the first of equals: its name, the offer in words and its points.
    pub fn best(&self) -> Option<(String, String, f64)> {
        let mut best: Option<(String, String, f64)> = None;
        for camera in &self.cameras {
            let Some((offer, points)) = format::best(&camera.offers, &FormatWish::default()) else {
                continue;
            };
            if best.as_ref().is_none_or(|(_, _, most)| points > *most) {
                let name = format!("v4l2:{}", camera.node.path.display());
                let what = format!("{} {}x{}", format::shown(offer.fourcc), offer.width, offer.height);
                best = Some((name, what, points));
            }
        }
        best
    }

    /// What is known of the camera with the best offer.
    pub fn best_facts(&self) -> Option<CameraFacts> {
        let (name, ..) = self.best()?;
        let camera = self.cameras.iter().find(|c| name.ends_with(&*c.node.path.to_string_lossy()))?;
        let offer = camera.chosen()?;
        let card = &camera.node.facts.card;
        let is_one =
            self.cameras.iter().filter(|other| other.node.facts.card.contains(card.as_str())).count() == 1;
        let is_plain = !card.is_empty() && !card.contains([',', '=']);
        let control = |id| camera.controls.iter().map(|(facts, _)| facts).find(|facts| facts.id == id);
        let gain = control(control::id::ANALOGUE_GAIN).or_else(|| control(control::id::GAIN));
        Some(CameraFacts {
            name: if is_one && is_plain { format!("v4l2:card={card}") } else { name },
            card: card.clone(),
            width: offer.width,
            height: offer.height,
            frames_per_s: offer.rates.highest(),
            exposure_s: control(control::id::EXPOSURE).map(control::exposure_range_s),
            gain: gain
                .filter(|c| c.default > 0 && c.least > 0)
                .map(|c| [c.least, c.most].map(|value| f64::from(value) / f64::from(c.default))),
        })
    }

    /// For programs.
    pub fn json(&self) -> Vec<Value> {
        let refused = self.refused.iter().map(|node| {
            json!({
                "path": node.path, "usable": false, "why": node.why, "missing": missing_json(node.missing.as_ref()),
            })
        });
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
        for node in &self.refused {
            println!("  {}  not usable: {}", node.path, node.why);
            print_missing(node.missing.as_ref());
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
            "driver": facts.driver, "bus": facts.bus, "sensor": self.sensor, "offers": offers, "controls": controls,
        })
    }

    fn print(&self) {
        let facts = &self.node.facts;
        println!("  v4l2:{}  {} ({}, {})", self.node.path.display(), facts.card, facts.driver, facts.bus);
        if let Some(sensor) = &self.sensor {
            println!("    sensor behind it: {sensor}");
        }
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
        let is_exposure = |id: u32| matches!(id, control::id::EXPOSURE | control::id::LINES);
        if !self.controls.iter().any(|(c, _)| is_exposure(c.id)) {
            println!("    its exposure cannot be set: no brackets");
        }
    }
}
