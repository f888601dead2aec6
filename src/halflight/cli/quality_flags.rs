//! Flags for every accuracy setting; what each may be stands in the table of keys.

use super::{CliError, global_options::put};
use crate::config::{presets, settings::Settings};
use crate::model::path_text;
use std::path::PathBuf;
use toml::Value;

/// Accuracy against time. Each flag is a key of the settings file and wins over it; `halflight check --manual` says more.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Accuracy against time")]
pub struct QualityFlags {
    /// A point of the measured front of error against time: draft, balanced, fine or reference. The other flags win over
    /// it.
    #[arg(long, value_name = "NAME")]
    pub preset: Option<String>,
    /// The measured front: bundled, or a file front.json that `halflight tradeoff` wrote.
    #[arg(long, value_name = "FILE")]
    pub front: Option<PathBuf>,
    /// SH order of the light.
    #[arg(long, value_name = "N")]
    pub sh_order: Option<i64>,
    /// How light is split into hard and soft: compact (lights with their extent), paper or bounded (one light by net flux), or
    /// sh (all of it soft).
    #[arg(long, value_name = "KIND")]
    pub split: Option<String>,
    /// How many compact lights are looked for, the brightest first.
    #[arg(long, value_name = "N")]
    pub lights: Option<i64>,
    /// Damp the soft half of the light until it shines negatively on no surface, and no more; `render` says what that
    /// costs.
    #[arg(long)]
    pub dering: bool,
    /// How the visibility of many spheres is computed: dc, linear, hybrid, squared, chain or directions.
    #[arg(long, value_name = "RUNG")]
    pub rung: Option<String>,
    /// Spheres that stand for each body where it blocks soft light.
    #[arg(long, value_name = "N")]
    pub spheres: Option<i64>,
    /// Directions that the rung `directions` tests.
    #[arg(long, value_name = "N")]
    pub directions: Option<i64>,
    /// Where soft shadows on real surfaces are evaluated: pixel or vertex.
    #[arg(long, value_name = "WHERE")]
    pub soft_at: Option<String>,
    /// Soft shadows on real surfaces at every n-th pixel of every n-th row.
    #[arg(long, value_name = "N")]
    pub soft_step_px: Option<i64>,
    /// The shadow of what never moves on itself in soft light, matt and glossy: openness, or transfer (precomputed with
    /// rays and kept in the cache folder).
    #[arg(long, value_name = "KIND")]
    pub self_shadow: Option<String>,
    /// How glossy lobes are scaled: energy-safe or paper.
    #[arg(long, value_name = "NORM")]
    pub phong_norm: Option<String>,
    /// Shadow maps that compact lights share.
    #[arg(long, value_name = "N")]
    pub shadow_maps: Option<i64>,
    /// How wide near lights of a known room may be on average; while they are wider, more are drawn.
    #[arg(long, value_name = "DEG")]
    pub near_width_deg: Option<f64>,
    /// Shadow map texels a side.
    #[arg(long, value_name = "N")]
    pub shadow_map_texels: Option<i64>,
    /// Taps a side of the shadow filter.
    #[arg(long, value_name = "N")]
    pub pcf_taps: Option<i64>,
    /// Which effects a frame has: called_for (by scene, light and view; what has not changed is kept) or all.
    #[arg(long, value_name = "WHICH")]
    pub effects: Option<String>,
    /// Newest frames of different exposure that are merged.
    #[arg(long, value_name = "N")]
    pub brackets: Option<i64>,
    /// Measure the light on every n-th frame.
    #[arg(long, value_name = "N")]
    pub light_every: Option<i64>,
    /// Coverage samples for each pixel at the edges of objects.
    #[arg(long, value_name = "N")]
    pub coverage_samples: Option<i64>,
    /// How the picture loses the light of a known room that objects hide: ratio (exact), or ldr (from 8-bit values, light by
    /// light, as [Gib03] did).
    #[arg(long, value_name = "FORM")]
    pub near_form: Option<String>,
}

impl QualityFlags {
    /// Puts what was given over the settings. Errors: the flag, its value and what is allowed.
    pub fn apply(&self, settings: &mut Settings) -> Result<(), CliError> {
        let whole = |value: Option<i64>| value.map(Value::Integer);
        let word = |value: &Option<String>| value.clone().map(Value::String);
        let given = [
            (
                "--front",
                "quality.front",
                self.front.as_ref().map(|file| Value::String(path_text::to_text(file))),
            ),
            ("--preset", "quality.preset", word(&self.preset)),
            ("--sh-order", "light.order", whole(self.sh_order)),
            ("--split", "light.split", word(&self.split)),
            ("--lights", "light.lights", whole(self.lights)),
            ("--dering", "light.dering", self.dering.then_some(Value::Boolean(true))),
            ("--rung", "quality.rung", word(&self.rung)),
            ("--spheres", "quality.spheres", whole(self.spheres)),
            ("--directions", "quality.directions", whole(self.directions)),
            ("--soft-at", "quality.soft_at", word(&self.soft_at)),
            ("--soft-step-px", "quality.soft_step_px", whole(self.soft_step_px)),
            ("--self-shadow", "quality.self_shadow", word(&self.self_shadow)),
            ("--phong-norm", "quality.phong_norm", word(&self.phong_norm)),
            ("--shadow-maps", "quality.shadow_maps", whole(self.shadow_maps)),
            ("--near-width-deg", "quality.near_width_deg", self.near_width_deg.map(Value::Float)),
            ("--shadow-map-texels", "quality.shadow_map_texels", whole(self.shadow_map_texels)),
            ("--pcf-taps", "quality.pcf_taps", whole(self.pcf_taps)),
            ("--effects", "quality.effects", word(&self.effects)),
            ("--brackets", "quality.brackets", whole(self.brackets)),
            ("--light-every", "quality.light_every", whole(self.light_every)),
            ("--coverage-samples", "quality.coverage_samples", whole(self.coverage_samples)),
            ("--near-form", "quality.near_form", word(&self.near_form)),
        ];
        for (flag, name, value) in given {
            let Some(value) = value else { continue };
            put(flag, name, &value, settings)?;
            if let ("--preset", Some(preset)) = (flag, &self.preset) {
                let front = settings.front.clone();
                presets::apply(preset, &front, settings)
                    .map_err(|e| CliError(format!("--preset = {preset}: {e}")))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flag_reaches_its_setting() {
        let flags = QualityFlags {
            preset: Some("none".into()),
            front: Some("here.json".into()),
            sh_order: Some(6),
            split: Some("paper".into()),
            lights: Some(2),
            dering: true,
            rung: Some("hybrid".into()),
            spheres: Some(12),
            directions: Some(256),
            soft_at: Some("vertex".into()),
            soft_step_px: Some(2),
            self_shadow: Some("openness".into()),
            phong_norm: Some("paper".into()),
            shadow_maps: Some(3),
            near_width_deg: Some(20.0),
            shadow_map_texels: Some(512),
            pcf_taps: Some(8),
            effects: Some("all".into()),
            near_form: Some("ldr".into()),
            brackets: Some(2),
            light_every: Some(5),
            coverage_samples: Some(1),
        };
        let mut settings = Settings::default();
        flags.apply(&mut settings).unwrap();
        let before = Settings::default().quality;
        let quality = settings.quality;
        assert_eq!(settings.front, "here.json");
        assert_eq!((quality.sh_order, quality.shadow_maps, quality.pcf_taps), (6, 3, 8));
        assert_eq!(quality.near_width_deg, 20.0);
        assert_eq!((quality.directions, quality.soft_step_px, quality.shadow_map_texels), (256, 2, 512));
        assert_eq!((quality.lights, quality.spheres), (2, 12));
        assert!(quality.dering && !before.dering);
        assert!(quality.soft_at != before.soft_at && quality.effects != before.effects);
        assert!(quality.near_form != before.near_form);
        assert_eq!((quality.brackets, quality.light_every, quality.coverage_samples), (2, 5, 1));
        assert!(quality.split != before.split && quality.rung != before.rung);
        assert!(quality.self_shadow != before.self_shadow && quality.phong_norm != before.phong_norm);
    }

    #[test]
    fn what_is_not_allowed_is_named() {
        let refused = |flags: QualityFlags| flags.apply(&mut Settings::default()).unwrap_err().to_string();
        let rung = refused(QualityFlags { rung: Some("ladder".into()), ..QualityFlags::default() });
        assert!(rung.contains("--rung = ladder") && rung.contains("\"hybrid\""), "{rung}");
        let order = refused(QualityFlags { sh_order: Some(7), ..QualityFlags::default() });
        assert!(order.contains("--sh-order = 7") && order.contains("2..=6"), "{order}");
        let preset = refused(QualityFlags { preset: Some("best".into()), ..QualityFlags::default() });
        assert!(preset.contains("--preset = best") && preset.contains("\"balanced\""), "{preset}");
    }
}
