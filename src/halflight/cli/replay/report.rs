//! The report of a run: a table for the terminal, JSON for machines, a page with plots for people.

use super::statistics::{FrameNumbers, Spread, WARM_UP_FRAMES, after_warm_up, stage};
use crate::lab::page::{
    html::escaped,
    svg::{Anchor, Scale, Svg},
};
use crate::model::estimate::LightEstimate;
use crate::pipeline::{frame::Stage, turns::RunCounts};
use crate::plan::{FramePlan, PassTiming, PlannedPass};
use serde_json::{Value, json};
use std::fmt::Write;

/// All that a run left.
pub struct ReplayReport {
    /// As the user named the recording.
    pub recording: String,
    /// The engine in one line.
    pub engine: String,
    /// What went through.
    pub counts: RunCounts,
    /// One entry a frame.
    pub frames: Vec<FrameNumbers>,
    /// The last light.
    pub light: Option<LightEstimate>,
    /// Every pass of every frame.
    pub passes: Vec<PassTiming>,
    /// Which passes the last picture had, and why.
    pub last_plan: FramePlan,
    /// SHA-256 of all shown pixels.
    pub digest: String,
}

impl ReplayReport {
    /// Stable JSON; numbers carry units in their names.
    pub fn json(&self) -> Value {
        let mut stages = serde_json::Map::new();
        for (index, s) in Stage::ALL.iter().enumerate() {
            if let Some(spread) = stage(&self.frames, index) {
                stages.insert(s.name().into(), json!({ "median_ms": spread.median, "p95_ms": spread.p95 }));
            }
        }
        for (name, spread) in self.pass_spreads() {
            stages.insert(name.into(), json!({ "median_ms": spread.median, "p95_ms": spread.p95 }));
        }
        let with_unit = |spread: Option<Spread>, unit: &str| spread.map(|s| s.json(unit));
        let irradiance_rgb = [0, 1, 2].map(|c| {
            let channel = after_warm_up(&self.frames, |f| f.irradiance_error_rgb.map(|e| e[c].abs()));
            with_unit(channel, "relative")
        });
        let light = self.light.as_ref().map(|l| {
            json!({
                "order": l.total.order,
                "sh_rgb": l.total.rows(),
                "to_light": l.split.direct.map(|d| d.to_light_world),
                "irradiance_rgb": l.split.direct.map(|d| d.irradiance_rgb),
                "cone95_rad": l.cone95_rad,
                "filled_share": l.flags.filled_share,
                "saturated_texels": l.flags.saturated_texels,
                "not_finite_texels": l.flags.not_finite_texels,
            })
        });
        let reasons = |passes: &[PlannedPass]| -> Vec<Value> {
            passes.iter().map(|p| json!({ "pass": p.pass.name(), "reason": p.reason })).collect()
        };
        json!({
            "format": crate::cli::JSON_FORMAT,
            "recording": self.recording,
            "engine": self.engine,
            "frames": self.counts.frames,
            "dropped": self.counts.lost_by_source + self.counts.passed_over,
            "passed_through": self.counts.passed_through,
            "warm_up_frames": WARM_UP_FRAMES,
            "stages": stages,
            "plan": {
                "passes": reasons(&self.last_plan.passes),
                "kept": reasons(&self.last_plan.kept),
                "left_out": reasons(&self.last_plan.left_out),
            },
            "light": {
                "last": light,
                "direction_error": with_unit(after_warm_up(&self.frames, |f| f.direction_error_deg), "deg"),
                "irradiance_error_rgb": irradiance_rgb,
                "irradiance_error": with_unit(after_warm_up(&self.frames, |f| f.irradiance_error.map(f64::abs)), "relative"),
            },
            "pose": {
                "measured_frames": self.frames.iter().filter(|f| f.pose_measured).count(),
                "position_error": with_unit(after_warm_up(&self.frames, |f| f.position_error_mm), "mm"),
                "rotation_error": with_unit(after_warm_up(&self.frames, |f| f.rotation_error_deg), "deg"),
            },
            "governor": self.governor(),
            "digest": self.digest,
        })
    }

    /// What the governor did; null without one.
    fn governor(&self) -> Option<Value> {
        let last = self.frames.iter().rev().find_map(|f| f.choice)?;
        let steps: Vec<usize> = self.frames.iter().filter_map(|f| f.choice.map(|c| c.step)).collect();
        Some(json!({
            "step": last.step, "of": last.of, "changes": last.changes, "expected_error": last.expected_error,
            "expected_ms": last.expected_ms, "measured_ms": last.measured_ms, "steps": steps,
        }))
    }

    fn pass_spreads(&self) -> Vec<(&'static str, Spread)> {
        let mut names: Vec<&'static str> = self.passes.iter().map(|p| p.pass.name()).collect();
        names.sort_unstable();
        names.dedup();
        let of = |name: &str| {
            Spread::of(self.passes.iter().filter(|p| p.pass.name() == name).map(|p| f64::from(p.ms)))
        };
        names.into_iter().filter_map(|name| of(name).map(|spread| (name, spread))).collect()
    }

    /// The table for the terminal.
    pub fn table(&self) -> String {
        let mut out = String::new();
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{} on {}", self.recording, self.engine);
        let _ = writeln!(
            out,
            "{} frames, {} lost by the source, {} passed over, {} without virtual objects",
            self.counts.frames,
            self.counts.lost_by_source,
            self.counts.passed_over,
            self.counts.passed_through
        );
        let _ = writeln!(out, "\n{:<26}{:>12}{:>12}", "stage", "median ms", "p95 ms");
        for (index, s) in Stage::ALL.iter().enumerate() {
            if let Some(spread) = stage(&self.frames, index) {
                let _ = writeln!(out, "{:<26}{:>12.2}{:>12.2}", s.name(), spread.median, spread.p95);
            }
        }
        for (name, spread) in self.pass_spreads() {
            let _ = writeln!(out, "  {:<24}{:>12.2}{:>12.2}", name, spread.median, spread.p95);
        }
        if let Some(choice) = self.frames.iter().rev().find_map(|f| f.choice) {
            let _ = writeln!(
                out,
                "\ngovernor: step {} of {} after {} changes; expected error {:.3}, expected {:.1} ms, last measured {:.1} ms",
                choice.step + 1,
                choice.of,
                choice.changes,
                choice.expected_error,
                choice.expected_ms,
                choice.measured_ms
            );
        }
        let _ = writeln!(out, "\npasses of the last picture");
        for planned in &self.last_plan.passes {
            let _ = writeln!(out, "  {:<30}{}", planned.pass.name(), planned.reason);
        }
        for planned in &self.last_plan.kept {
            let _ = writeln!(out, "  {:<30}kept: {}", planned.pass.name(), planned.reason);
        }
        for planned in &self.last_plan.left_out {
            let _ = writeln!(out, "  {:<30}left out: {}", planned.pass.name(), planned.reason);
        }
        self.write_errors(&mut out);
        self.write_light(&mut out);
        out
    }

    /// The lines on errors against the truth, where there is one.
    fn write_errors(&self, out: &mut String) {
        let rows = [
            ("light direction error", "deg", after_warm_up(&self.frames, |f| f.direction_error_deg)),
            (
                "light E_d error",
                "%",
                after_warm_up(&self.frames, |f| f.irradiance_error.map(|e| e.abs() * 100.0)),
            ),
            ("camera position error", "mm", after_warm_up(&self.frames, |f| f.position_error_mm)),
            ("camera rotation error", "deg", after_warm_up(&self.frames, |f| f.rotation_error_deg)),
        ];
        if rows.iter().any(|r| r.2.is_some()) {
            let _ =
                writeln!(out, "\n{:<26}{:>10}{:>10}{:>10}", "against the truth", "median", "p95", "largest");
        }
        for (name, unit, spread) in rows {
            if let Some(s) = spread {
                let _ = writeln!(out, "{name:<26}{:>10.3}{:>10.3}{:>10.3} {unit}", s.median, s.p95, s.max);
            }
        }
    }

    /// The lines on the last light, where one was measured.
    fn write_light(&self, out: &mut String) {
        if let Some(light) = &self.light {
            match &light.split.direct {
                Some(d) => {
                    let _ = writeln!(
                        out,
                        "\nlight comes from {:.3?} with E_d {:.3?}, 95 % cone {:.2} deg, {:.1} % of the sphere filled, {} of {} samples saturated",
                        d.to_light_world,
                        d.irradiance_rgb,
                        light.cone95_rad.to_degrees(),
                        light.flags.filled_share * 100.0,
                        light.flags.saturated_texels,
                        light.flags.texels
                    );
                }
                None => {
                    let _ = writeln!(out, "\nno direction dominates the light");
                }
            }
        }
    }

    /// A page with the contact sheet and plots; `has_film`: whether replay.mp4 lies beside it.
    pub fn page(&self, has_film: bool) -> String {
        let film = if has_film {
            "<p><video src=\"replay.mp4\" controls loop width=\"640\"></video></p>"
        } else {
            ""
        };
        type Pick = fn(&FrameNumbers) -> Option<f64>;
        let picks: [(&str, Pick); 4] = [
            ("Light direction error, degrees", |f| f.direction_error_deg),
            ("Camera position error, millimetres", |f| f.position_error_mm),
            ("Camera rotation error, degrees", |f| f.rotation_error_deg),
            ("Time of a frame, milliseconds", |f| f.stage_ms.last().map(|&ms| f64::from(ms))),
        ];
        let mut plots = String::new();
        for (title, pick) in picks {
            let values: Vec<Option<f64>> = self.frames.iter().map(pick).collect();
            if values.iter().any(Option::is_some) {
                plots.push_str(&plot(title, &values));
            }
        }
        format!(
            "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>half-light replay</title>\
             <style>body{{font:15px/1.5 sans-serif;max-width:1320px;margin:2em auto;padding:0 1em;color:#222}}\
             pre{{background:#f4f4f2;padding:1em;overflow:auto}}img{{max-width:100%}}svg{{width:600px;margin:0 1em 1em 0}}</style>\
             <h1>half-light replay</h1><p><img src=\"contact_sheet.png\" alt=\"contact sheet\"></p>{film}{plots}<pre>{}</pre></html>\n",
            escaped(&self.table())
        )
    }
}

/// A line plot over the frame number, from zero.
fn plot(title: &str, values: &[Option<f64>]) -> String {
    const SIZE: [f64; 2] = [600.0, 180.0];
    let known = values.iter().flatten().copied().filter(|v| v.is_finite());
    let top = known.fold(0.0, f64::max).max(1e-9);
    let last = values.len().saturating_sub(1);
    let x = Scale::linear([0.0, last.max(1) as f64], [50.0, SIZE[0] - 10.0]);
    let y = Scale::linear([0.0, top], [SIZE[1] - 25.0, 25.0]);
    let ([left, right], [bottom, ceiling]) = (x.pixels, y.pixels);
    let mut svg = Svg::new(SIZE, 12);
    svg.text([left, 14.0], Anchor::Start, title);
    svg.line([left, ceiling], [left, bottom], "stroke=\"#999\"");
    svg.line([left, bottom], [right, bottom], "stroke=\"#999\"");
    svg.text([left - 5.0, ceiling + 5.0], Anchor::End, &format!("{top:.2}"));
    svg.text([left - 5.0, bottom], Anchor::End, "0");
    svg.text([right, SIZE[1] - 8.0], Anchor::End, &format!("frame {last}"));
    let points = values.iter().enumerate().map(|(i, v)| v.map(|v| [x.at(i as f64), y.at(v)]));
    svg.curve(points, "#0a6", 1.5);
    svg.finish()
}
