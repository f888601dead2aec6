//! From settings as typed to settings as meant: all mistakes at once, bad never replaces good.

use super::{
    file::{self, TypedKey, TypedSettings},
    keys::{KEYS, Key},
    presets,
    settings::Settings,
};
use crate::assets::near_word::nearest;

/// Every mistake in one file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct ConfigErrors(pub Vec<String>);

/// Applies what was typed to `base`. `name` is the file's name in messages, which point to the line and column. On any
/// mistake nothing is applied.
pub fn resolve(name: &str, typed: &TypedSettings, base: &Settings) -> Result<Settings, ConfigErrors> {
    let mut settings = base.clone();
    let mut errors = Vec::new();
    // A preset is the ground that single keys are typed over.
    let of = |name: &str| typed.keys.iter().find(|key| key.name == name);
    let word_of = |name: &str| of(name).and_then(|key| key.value.as_str());
    if let (Some(key), Some(preset)) = (of("quality.preset"), word_of("quality.preset"))
        && presets::PRESET_NAMES.contains(&preset)
    {
        let front = word_of("quality.front").unwrap_or(&base.front);
        if let Err(error) = presets::apply(preset, front, &mut settings) {
            errors.push(format!("{}: quality.preset = \"{preset}\": {error}", placed(name, key)));
        }
    }
    for key in &typed.keys {
        match KEYS.iter().find(|known| known.name == key.name) {
            Some(known) if known.range.admits(&key.value) => (known.write)(&mut settings, &key.value),
            Some(known) => errors.push(out_of_range(name, known, key)),
            None => errors.push(unknown(name, key)),
        }
    }
    if errors.is_empty() { Ok(settings) } else { Err(ConfigErrors(errors)) }
}

/// One line `KEY=VALUE` over other settings, as `--set` has it. A value that is no TOML is taken as a text:
/// `quality.rung=hybrid`.
///
/// # Errors
/// Every mistake in it.
pub fn over(line: &str, base: &Settings) -> Result<Settings, String> {
    let typed = file::parse(line).or_else(|first| {
        let (key, value) = line.split_once('=').ok_or_else(|| first.clone())?;
        file::parse(&format!("{key} = {}", toml::Value::String(value.trim().to_owned()))).or(Err(first))
    });
    let typed = typed.map_err(|e| format!("--set {line}: {e}"))?;
    if typed.keys.is_empty() {
        return Err(format!("--set {line}: must be KEY=VALUE, e.g. quality.rung=hybrid"));
    }
    resolve("--set", &typed, base).map_err(|e| e.to_string())
}

/// `file:line:column`, as compilers say it.
fn placed(name: &str, key: &TypedKey) -> String {
    match key.place {
        Some([line, column]) => format!("{name}:{line}:{column}"),
        None => name.to_owned(),
    }
}

fn out_of_range(name: &str, known: &Key, key: &TypedKey) -> String {
    let unit = if known.unit.is_empty() { String::new() } else { format!(" {}", known.unit) };
    let (place, value) = (placed(name, key), &key.value);
    format!("{place}: {} = {value}: must be {}{unit}", known.name, known.range.describe())
}

fn unknown(name: &str, key: &TypedKey) -> String {
    let names: Vec<&str> = KEYS.iter().map(|k| k.name).collect();
    let said = format!("{}: {} = {}: no such key", placed(name, key), key.name, key.value);
    match nearest(&key.name, &names) {
        Some(found) => format!("{said}; did you mean {found}?"),
        None => format!("{said}; config/default.toml lists all"),
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
        assert!(
            all.contains("test.toml:2:11: quality.pcf_tap = 4: no such key; did you mean quality.pcf_taps?"),
            "{all}"
        );
        assert!(
            all.contains(
                "test.toml:3:21: quality.shadow_map_texels = 9999: must be an integer within 64..=4096 texels"
            ),
            "{all}"
        );
        assert!(
            all.contains("test.toml:5:9: light.order = \"four\": must be an integer within 2..=6"),
            "{all}"
        );
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
        let typed = file::parse(&super::super::manual::manual()).unwrap();
        assert_eq!(typed.keys.len(), KEYS.len());
        assert_eq!(resolve("manual", &typed, &defaults).unwrap(), defaults);
    }

    #[test]
    fn one_line_wins_over_settings_and_words_need_no_quotes() {
        let base = Settings::default();
        for line in ["quality.rung=hybrid", "quality.rung = \"hybrid\"", "quality.rung= hybrid "] {
            assert_eq!(over(line, &base).unwrap().quality.rung.name(), "hybrid", "{line}");
        }
        assert_eq!(over("device.camera=replay:a,b=1.mcap", &base).unwrap().camera, "replay:a,b=1.mcap");
        for (line, word) in [
            ("quality.rung=ladder", "must be one of"),
            ("quality.pcf_taps=two", "must be an integer within 1..=8"),
            ("quality", "--set quality: not valid TOML"),
            ("", "must be KEY=VALUE"),
        ] {
            let error = over(line, &base).unwrap_err();
            assert!(error.contains(word), "{line}: {error}");
        }
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
