//! From settings as typed to settings as meant: all mistakes at once, bad never replaces good.

use super::{
    file,
    keys::{KEYS, Key},
    presets,
    settings::Settings,
};
use crate::assets::near_word::nearest;
use toml::Table;

/// Every mistake in one file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct ConfigErrors(pub Vec<String>);

/// Applies what was typed to `base`. `name` is the file's name in messages. On any mistake nothing is applied.
pub fn resolve(name: &str, typed: &Table, base: &Settings) -> Result<Settings, ConfigErrors> {
    let mut settings = base.clone();
    let mut errors = Vec::new();
    // A preset is the ground that single keys are typed over.
    let of = |key: &str| {
        file::flatten(typed).into_iter().find(|(name, _)| name == key).and_then(|(_, v)| v.as_str())
    };
    if let Some(preset) = of("quality.preset").filter(|p| presets::PRESET_NAMES.contains(p)) {
        let front = of("quality.front").unwrap_or(&base.front);
        if let Err(error) = presets::apply(preset, front, &mut settings) {
            errors.push(format!("{name}: quality.preset = \"{preset}\": {error}"));
        }
    }
    for (key_name, value) in file::flatten(typed) {
        match KEYS.iter().find(|key| key.name == key_name) {
            Some(key) if key.range.admits(value) => (key.write)(&mut settings, value),
            Some(key) => errors.push(out_of_range(name, key, value)),
            None => errors.push(unknown(name, &key_name, value)),
        }
    }
    if errors.is_empty() { Ok(settings) } else { Err(ConfigErrors(errors)) }
}

fn out_of_range(name: &str, key: &Key, value: &toml::Value) -> String {
    let unit = if key.unit.is_empty() { String::new() } else { format!(" {}", key.unit) };
    format!("{name}: {} = {value}: must be {}{unit}", key.name, key.range.describe())
}

fn unknown(name: &str, key: &str, value: &toml::Value) -> String {
    let names: Vec<&str> = KEYS.iter().map(|k| k.name).collect();
    match nearest(key, &names) {
        Some(found) => format!("{name}: {key} = {value}: no such key; did you mean {found}?"),
        None => format!("{name}: {key} = {value}: no such key; config/default.toml lists all"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolve_text(text: &str) -> Result<Settings, ConfigErrors> {
        resolve("test.toml", &file::parse(text).unwrap(), &Settings::default())
    }

    #[test]
    fn three_mistakes_are_told_at_once() {
        let errors =
            resolve_text("[quality]\npcf_tap = 4\nshadow_map_texels = 9999\n[light]\norder = \"four\"")
                .unwrap_err();
        assert_eq!(errors.0.len(), 3);
        let all = errors.to_string();
        assert!(all.contains("quality.pcf_tap = 4: no such key; did you mean quality.pcf_taps?"), "{all}");
        assert!(
            all.contains("quality.shadow_map_texels = 9999: must be an integer within 64..=4096 texels"),
            "{all}"
        );
        assert!(all.contains("light.order = \"four\": must be an integer within 2..=6"), "{all}");
    }

    #[test]
    fn every_key_reads_back_what_was_written() {
        let defaults = Settings::default();
        for key in KEYS {
            let value = (key.read)(&defaults);
            assert!(key.range.admits(&value), "{} = {value}", key.name);
            let mut copy = defaults.clone();
            (key.write)(&mut copy, &value);
            assert_eq!(copy, defaults, "{}", key.name);
        }
        let table = file::parse(&super::super::manual::manual()).unwrap();
        assert_eq!(file::flatten(&table).len(), KEYS.len());
        assert_eq!(resolve("manual", &table, &defaults).unwrap(), defaults);
    }

    #[test]
    fn changed_values_arrive() {
        let settings = resolve_text(
            "[quality]\npcf_taps = 8\n[camera]\nexposures_s = [0.01, 1]\n[light]\nball_on_surface = false",
        )
        .unwrap();
        assert_eq!(settings.quality.pcf_taps, 8);
        assert_eq!(settings.exposures_s, [0.01, 1.0]);
        assert!(!settings.ball_on_surface);
    }

    #[test]
    fn nan_and_infinity_are_out_of_range() {
        for bad in ["nan", "inf", "-inf"] {
            let errors = resolve_text(&format!("[light]\nfilter_tau_s = {bad}")).unwrap_err();
            assert!(errors.to_string().contains("light.filter_tau_s"), "{errors}");
        }
    }
}
