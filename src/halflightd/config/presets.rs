//! The measured front of error against time, as `halflight tradeoff` writes it, and the presets that are points of it.

use super::{file::regular_text, keys::KEYS, settings::Settings};
use crate::model::{path_text, quality::Quality};
use crate::plan::front::{Front, FrontStep};
use serde::{Deserialize, Serialize};
use std::{borrow::Cow, collections::BTreeMap};

/// What `quality.preset` may be.
pub const PRESET_NAMES: [&str; 5] = ["none", "draft", "balanced", "fine", "reference"];

/// The name of the front that comes with the program.
pub const BUNDLED: &str = "bundled";

/// Larger files are no fronts, bytes.
const LARGEST_FRONT: u64 = 16 << 20;

const BUNDLED_FRONT: &str = include_str!("front.json");

/// The form of the file.
const FORM: u32 = 1;

/// The front as a file holds it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrontFile {
    /// Form of this file.
    pub form: u32,
    /// What measured it: the program and its engine.
    pub engine: String,
    /// What was drawn.
    pub subjects: Vec<String>,
    /// By rising time.
    pub points: Vec<FrontPoint>,
}

/// One point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrontPoint {
    /// Presets that it is.
    pub presets: Vec<String>,
    /// Relative RMSE in shadows, in the mean over the subjects.
    pub error: f64,
    /// FLIP, in the mean.
    pub flip_mean: f64,
    /// Its 95th percentile, in the mean over the subjects.
    pub flip_p95: f64,
    /// Light taken away over the true, less 1: the mean of its absolute value.
    pub energy: f64,
    /// Milliseconds of drawing a picture, in the mean.
    pub ms: f64,
    /// Keys of the settings with their values.
    pub settings: BTreeMap<String, serde_json::Value>,
}

impl FrontFile {
    /// From its text. Errors: what is wrong with it, and what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let file: Self = serde_json::from_str(text)
            .map_err(|e| format!("not a front as `halflight tradeoff` writes it: {e}"))?;
        if file.form != FORM {
            return Err(format!("form = {}: must be {FORM}", file.form));
        }
        for (i, point) in file.points.iter().enumerate() {
            let sound = |x: f64| x.is_finite() && x > 0.0;
            if !sound(point.error) || !sound(point.ms) {
                return Err(format!(
                    "points[{i}]: error = {}, ms = {}: must be above 0",
                    point.error, point.ms
                ));
            }
            for (name, value) in &point.settings {
                setting(name, value).map_err(|e| format!("points[{i}].settings: {e}"))?;
            }
        }
        Ok(file)
    }

    /// For the file.
    pub fn text(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// A new one.
    pub fn new(engine: String, subjects: Vec<String>, points: Vec<FrontPoint>) -> Self {
        Self { form: FORM, engine, subjects, points }
    }

    /// What a governor walks along: each point's settings over `base`. What would make the scene's bodies carry other
    /// things with them (spheres, transfer, the order of the light) stays as in `base`: changing it takes far longer
    /// than a frame.
    pub fn over(&self, base: &Quality) -> Front {
        let mut settings = Settings { quality: *base, ..Settings::default() };
        let steps: Vec<FrontStep> = self
            .points
            .iter()
            .map(|point| {
                settings.quality = *base;
                point.put_over(&mut settings);
                let quality = Quality {
                    sh_order: base.sh_order,
                    spheres: base.spheres,
                    self_shadow: base.self_shadow,
                    ..settings.quality
                };
                FrontStep { quality, error: point.error as f32, ms: point.ms as f32 }
            })
            .collect();
        Front::of(&steps)
    }
}

impl FrontPoint {
    /// Puts the point's settings over others.
    pub fn put_over(&self, settings: &mut Settings) {
        for (name, value) in &self.settings {
            if let Ok((key, value)) = setting(name, value) {
                (key.write)(settings, &value);
            }
        }
    }
}

/// A key of accuracy with an admitted value.
fn setting(
    name: &str,
    value: &serde_json::Value,
) -> Result<(&'static super::keys::Key, toml::Value), String> {
    let is_accuracy = |key: &&super::keys::Key| {
        key.name.starts_with("quality.") && !GOVERNING.contains(&key.name)
            || ["light.order", "light.split", "light.lights", "light.dering", "track.decimate"]
                .contains(&key.name)
    };
    let key = KEYS
        .iter()
        .filter(is_accuracy)
        .find(|key| key.name == name)
        .ok_or_else(|| format!("{name}: must be a key of accuracy, as quality.pcf_taps"))?;
    let value = toml::Value::try_from(value).map_err(|e| format!("{name} = {value}: {e}"))?;
    if !key.range.admits(&value) {
        return Err(format!("{name} = {value}: must be {}", key.range.describe()));
    }
    Ok((key, value))
}

/// Keys that say which settings are chosen and are none themselves.
const GOVERNING: [&str; 5] =
    ["quality.preset", "quality.front", "quality.budget_ms", "quality.target_fps", "quality.max_error"];

/// The front of a name: `bundled`, or a file.
pub fn front(name: &str) -> Result<FrontFile, String> {
    let text = match name {
        BUNDLED => Cow::Borrowed(BUNDLED_FRONT),
        file => Cow::Owned(regular_text(&path_text::to_path(file), LARGEST_FRONT)?),
    };
    FrontFile::parse(&text).map_err(|e| format!("{name}: {e}"))
}

/// Puts the settings of a preset over `settings`. `none` changes nothing.
pub fn apply(preset: &str, front_name: &str, settings: &mut Settings) -> Result<(), String> {
    if preset == PRESET_NAMES[0] {
        return Ok(());
    }
    let front = front(front_name)?;
    let point = front.points.iter().find(|p| p.presets.iter().any(|name| name == preset));
    let point = point.ok_or_else(|| {
        format!("quality.front = \"{front_name}\" has no such point; must have one with this name among its presets")
    })?;
    point.put_over(settings);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{file, resolve};
    use proptest::prelude::*;

    #[test]
    fn presets_are_points_of_the_bundled_front_from_cheap_to_accurate() {
        let front = front(BUNDLED).unwrap();
        let points: Vec<&FrontPoint> = PRESET_NAMES[1..]
            .iter()
            .map(|name| front.points.iter().find(|p| p.presets.iter().any(|n| n == name)).unwrap())
            .collect();
        assert!(points.windows(2).all(|w| w[0].ms <= w[1].ms && w[0].error >= w[1].error));
        assert!(points[0].ms < points[3].ms);
        let places: Vec<[f64; 2]> = front.points.iter().map(|p| [p.ms, p.error]).collect();
        let all: Vec<usize> = (0..places.len()).collect();
        assert_eq!(crate::plan::front::undominated(&places), all, "every point is on the front");
        let named = crate::plan::front::presets(&places).unwrap();
        for (name, index) in PRESET_NAMES[1..].iter().zip(named) {
            assert!(
                front.points[index].presets.iter().any(|n| n == name),
                "{name} is where the rule puts it"
            );
        }
        assert!(front.over(&Quality::default()).steps().len() >= 4);
    }

    #[test]
    fn keys_win_over_the_preset_wherever_they_stand() {
        let with = |text: &str| resolve("t.toml", &file::parse(text).unwrap(), &Settings::default());
        let draft = with("[quality]\npreset = \"draft\"").unwrap().quality;
        assert_ne!(draft, Settings::default().quality);
        let typed = with("[quality]\npcf_taps = 7\npreset = \"draft\"").unwrap().quality;
        assert_eq!(typed, Quality { pcf_taps: 7, ..draft });
        let unknown = with("[quality]\npreset = \"best\"").unwrap_err().to_string();
        assert!(
            unknown.contains("quality.preset = \"best\": must be one of \"none\", \"draft\""),
            "{unknown}"
        );
        let no_time = with("[quality]\nbudget_ms = 0").unwrap_err().to_string();
        assert!(
            no_time.contains("quality.budget_ms = 0: must be false (none), or a number within 0.1..="),
            "{no_time}"
        );
        let gone = with("[quality]\npreset = \"fine\"\nfront = \"/nowhere.json\"").unwrap_err().to_string();
        assert!(gone.contains("/nowhere.json: cannot be read"), "{gone}");
    }

    #[test]
    fn a_front_that_is_wrong_is_told_where() {
        let text = BUNDLED_FRONT;
        let parse = |text: String| FrontFile::parse(&text).unwrap_err();
        assert!(parse(text.replacen("\"form\": 1", "\"form\": 9", 1)).contains("form = 9: must be 1"));
        let wrong = parse(text.replacen("\"settings\": {", "\"settings\": { \"device.camera\": \"x\",", 1));
        assert!(wrong.contains("points[0].settings: device.camera: must be a key of accuracy"), "{wrong}");
        let wrong = parse(text.replacen("\"settings\": {", "\"settings\": { \"light.lights\": 99,", 1));
        assert!(wrong.contains("light.lights = 99: must be an integer within 1..=4"), "{wrong}");
        assert_eq!(FrontFile::parse(&front(BUNDLED).unwrap().text()).unwrap(), front(BUNDLED).unwrap());
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(cut in 0usize..4000, at in 0usize..4000, with in "\\PC{0,6}") {
            let mut text: String = BUNDLED_FRONT.chars().take(cut).collect();
            let place = text.char_indices().nth(at).map_or(text.len(), |(i, _)| i);
            text.insert_str(place, &with);
            let _ = FrontFile::parse(&text);
        }
    }
}
