//! The settings of accuracy that are tried, and what they are tried with.

use super::measure::Measured;
use crate::assets::scene::{RoomLightSource, RoomSource};
use crate::config::{keys::KEYS, settings::Settings};
use crate::error::LabError;
use std::collections::BTreeMap;
use toml::Value;

/// What a subject must have for a setting to matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CalledForBy {
    /// Far light: no known room.
    FarLight,
    /// A known room.
    Room,
    /// Any picture.
    Any,
    /// A recording: frames are tracked and merged.
    Recording,
}

/// One setting.
pub struct AccuracyAxis {
    /// Its key in the settings; `room.*` are keys of scene files.
    pub key: &'static str,
    /// What it is tried with, from cheap to accurate where there is such an order.
    values: &'static [TriedValue],
    /// Which subjects it matters for.
    pub called_for_by: CalledForBy,
    /// Whether the front is searched along it. The others take far longer than a frame to change.
    pub joint: bool,
}

#[derive(Clone, Copy)]
enum TriedValue {
    I(i64),
    F(f64),
    W(&'static str),
}

use CalledForBy::{Any, FarLight, Recording, Room};
use TriedValue::{F, I, W};

const fn axis(
    key: &'static str,
    called_for_by: CalledForBy,
    joint: bool,
    values: &'static [TriedValue],
) -> AccuracyAxis {
    AccuracyAxis { key, values, called_for_by, joint }
}

/// All of them.
pub const AXES: [AccuracyAxis; 20] = [
    axis("light.order", FarLight, false, &[I(2), I(3), I(4), I(5), I(6)]),
    axis("light.split", FarLight, false, &[W("sh"), W("paper"), W("bounded"), W("compact")]),
    axis("light.lights", FarLight, false, &[I(1), I(2), I(3), I(4)]),
    axis(
        "quality.rung",
        FarLight,
        true,
        &[W("dc"), W("linear"), W("hybrid"), W("squared"), W("chain"), W("directions")],
    ),
    axis("quality.spheres", FarLight, false, &[I(4), I(8), I(16), I(32), I(64)]),
    axis("quality.directions", FarLight, true, &[I(32), I(64), I(128), I(256)]),
    axis("quality.soft_at", FarLight, true, &[W("vertex"), W("pixel")]),
    axis("quality.soft_step_px", FarLight, true, &[I(4), I(2), I(1)]),
    axis("quality.self_shadow", FarLight, false, &[W("openness"), W("transfer")]),
    axis(
        "quality.shadow_maps",
        Any,
        true,
        &[I(1), I(2), I(3), I(4), I(6), I(8), I(12), I(16), I(24), I(32), I(48), I(64)],
    ),
    axis("quality.near_width_deg", Room, false, &[F(90.0), F(16.0), F(8.0), F(4.0)]),
    axis("quality.shadow_map_texels", Any, true, &[I(128), I(256), I(512), I(1024), I(2048)]),
    axis("quality.pcf_taps", Any, true, &[I(1), I(2), I(3), I(4), I(6), I(8)]),
    axis("quality.coverage_samples", Any, true, &[I(1), I(4)]),
    axis("room.power_share", Room, false, &[F(0.3), F(0.5), F(0.7), F(0.9), F(1.0)]),
    axis("room.patch_m", Room, false, &[F(0.6), F(0.4), F(0.3), F(0.2), F(0.15)]),
    axis("room.probe_rows", Room, false, &[I(16), I(32), I(64), I(128)]),
    axis("quality.brackets", Recording, false, &[I(1), I(2), I(3)]),
    axis("quality.light_every", Recording, false, &[I(8), I(4), I(2), I(1)]),
    axis("track.decimate", Recording, false, &[I(4), I(2), I(1)]),
];

impl AccuracyAxis {
    /// What it is tried with; of many, the quick form takes every other.
    pub fn values(&self, quick: bool) -> Vec<Value> {
        let step = if quick && self.values.len() > 6 { 3 } else { 1 };
        let of = |v: &TriedValue| match *v {
            I(i) => Value::Integer(i),
            F(f) => Value::Float(f),
            W(w) => Value::String(w.into()),
        };
        self.values.iter().step_by(step).map(of).collect()
    }

    /// Whether some value of it changes the error by a thousandth, or the time by a tenth.
    pub fn matters(&self, points: &[Measured], quick: bool) -> bool {
        let own: Vec<&Measured> = self
            .values(quick)
            .into_iter()
            .filter_map(|v| {
                let point = TriedPoint::default().with(self, v);
                points.iter().find(|m| m.point == point)
            })
            .collect();
        let spread = |of: &dyn Fn(&Measured) -> f64| {
            let (low, high) =
                own.iter().map(|m| of(m)).fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(x), h.max(x)));
            high / low.max(1e-12)
        };
        own.len() > 1 && (spread(&|m| m.errors.shadow) > 1.001 || spread(&|m| m.ms) > 1.1)
    }

    /// Whether it changes how a known room is prepared.
    pub fn is_of_room(&self) -> bool {
        self.key.starts_with("room.")
    }
}

/// Settings: what differs from the defaults.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriedPoint(BTreeMap<&'static str, Value>);

impl TriedPoint {
    /// This point with one setting changed. A setting at its default is not kept: equal settings are equal points.
    pub fn with(&self, axis: &AccuracyAxis, value: Value) -> Self {
        let mut point = self.clone();
        if default_of(axis.key).as_ref() == Some(&value) {
            point.0.remove(axis.key);
        } else {
            point.0.insert(axis.key, value);
        }
        point
    }

    /// The value of a setting.
    pub fn value(&self, axis: &AccuracyAxis) -> Option<Value> {
        self.0.get(axis.key).cloned().or_else(|| default_of(axis.key))
    }

    /// What differs from the defaults.
    pub fn differing(&self) -> &BTreeMap<&'static str, Value> {
        &self.0
    }

    /// In one line.
    pub fn label(&self) -> String {
        if self.0.is_empty() {
            return "defaults".into();
        }
        let name = |key: &&str| key.split_once('.').map_or(*key, |(_, name)| name).to_owned();
        let each = self.0.iter().map(|(key, value)| format!("{} {}", name(key), shown_value(value)));
        each.collect::<Vec<_>>().join(", ")
    }

    /// Puts it over settings.
    pub fn put_over(&self, settings: &mut Settings) -> Result<(), LabError> {
        for (name, value) in &self.0 {
            let Some(key) = KEYS.iter().find(|key| key.name == *name) else { continue };
            if !key.range.admits(value) {
                return Err(LabError::Asked(format!("{name} = {value}: must be {}", key.range.describe())));
            }
            (key.write)(settings, value);
        }
        Ok(())
    }

    /// Whether it says anything of how rooms are prepared.
    pub fn is_of_room(&self) -> bool {
        AXES.iter().any(|a| a.is_of_room() && self.0.contains_key(a.key))
    }

    /// Puts what it says of rooms over a scene's room.
    pub fn put_over_room(&self, room: &mut RoomSource) {
        let number = |key| self.0.get(key).and_then(Value::as_float).map(|v| v as f32);
        let (share, patch) = (number("room.power_share"), number("room.patch_m"));
        room.settings.preparation.power_share = share.unwrap_or(room.settings.preparation.power_share);
        room.settings.patch_m = patch.or(room.settings.patch_m);
        if let (Some(asked), RoomLightSource::Probe { rows, .. }) =
            (self.0.get("room.probe_rows").and_then(Value::as_integer), &mut room.light)
        {
            *rows = usize::try_from(asked).ok();
        }
    }

    /// Whether frames go through the pipeline differently: all but the drawing.
    pub fn is_of_recording(&self) -> bool {
        AXES.iter().any(|a| a.called_for_by == Recording && self.0.contains_key(a.key))
    }
}

/// A value without the quotes of TOML.
pub fn shown_value(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// The default of a key of the settings; none for keys of scene files.
fn default_of(key: &str) -> Option<Value> {
    KEYS.iter().find(|k| k.name == key).map(|k| (k.read)(&Settings::default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_one_that_the_settings_take() {
        for axis in &AXES {
            if axis.is_of_room() {
                continue;
            }
            let key = KEYS.iter().find(|k| k.name == axis.key).unwrap_or_else(|| panic!("{}", axis.key));
            for value in axis.values(false) {
                assert!(key.range.admits(&value), "{} = {value}", axis.key);
            }
            let default = (key.read)(&Settings::default());
            // 0 spheres are as many as the scene asks for.
            assert!(
                axis.key == "quality.spheres" || axis.values(false).contains(&default),
                "{}: the default {default} is tried",
                axis.key
            );
        }
    }

    #[test]
    fn equal_settings_are_equal_points() {
        let taps = AXES.iter().find(|a| a.key == "quality.pcf_taps").unwrap();
        let point = TriedPoint::default().with(taps, Value::Integer(8));
        assert_eq!(point.label(), "pcf_taps 8");
        assert_ne!(point, TriedPoint::default());
        assert_eq!(point.with(taps, Value::Integer(4)), TriedPoint::default());
        let mut settings = Settings::default();
        point.put_over(&mut settings).unwrap();
        assert_eq!(settings.quality.pcf_taps, 8);
    }
}
