//! What `--help` shows: of each verb what it does and examples, its own options, and the shared ones that mean something to it.

use super::{
    CommandLine, calibrate, check, devices, explain, figures, hdr, record, render, replay, rig, stress,
    synth, tradeoff,
};
use crate::config::{Settings, keys::KEYS};
use clap::{Arg, Command, CommandFactory};

/// One verb.
struct VerbHelp {
    name: &'static str,
    /// What it does; the first paragraph stands in the list of verbs.
    about: &'static str,
    /// Shared options that mean something to it, besides `ALWAYS`.
    shared: &'static [&'static str],
}

/// Shared options of every verb.
const ALWAYS: [&str; 3] = ["json", "verbose", "quiet"];
/// Those of verbs that open an engine.
const COMPUTES: &[&str] = &["engine", "backend", "cpu", "threads", "digest", "set"];

const VERBS: [VerbHelp; 19] = [
    VerbHelp { name: "replay", about: replay::LONG_ABOUT, shared: COMPUTES },
    VerbHelp { name: "render", about: render::LONG_ABOUT, shared: COMPUTES },
    VerbHelp {
        name: "explain",
        about: explain::LONG_ABOUT,
        shared: &["engine", "backend", "cpu", "threads", "set"],
    },
    VerbHelp {
        name: "trace",
        about: "Trace a still: ground truth with and without the objects, and its noise.",
        shared: COMPUTES,
    },
    VerbHelp {
        name: "figures",
        about: figures::LONG_ABOUT,
        shared: &["engine", "backend", "cpu", "threads", "set"],
    },
    VerbHelp {
        name: "light",
        about: "Measure the light in a picture of a mirror ball or in an environment picture.",
        shared: COMPUTES,
    },
    VerbHelp { name: "hdr", about: hdr::LONG_ABOUT, shared: COMPUTES },
    VerbHelp { name: "tags", about: "Find AprilTags and their poses.", shared: &["digest"] },
    VerbHelp { name: "record", about: record::LONG_ABOUT, shared: &["digest"] },
    VerbHelp { name: "calibrate", about: calibrate::LONG_ABOUT, shared: &["set"] },
    VerbHelp { name: "spheres", about: "Fit spheres to a model, for its soft shadow.", shared: &["digest"] },
    VerbHelp { name: "rig", about: rig::LONG_ABOUT, shared: &[] },
    VerbHelp {
        name: "room",
        about: "Show a known room: what its surfaces send out and reflect, and what a probe saw of it.",
        shared: &["digest"],
    },
    VerbHelp { name: "synth", about: synth::LONG_ABOUT, shared: &["threads", "digest"] },
    VerbHelp {
        name: "reproduce",
        about: "Do an experiment of the papers again: table and plot.",
        shared: &[],
    },
    VerbHelp {
        name: "tradeoff",
        about: tradeoff::LONG_ABOUT,
        shared: &["engine", "backend", "cpu", "threads", "set"],
    },
    VerbHelp { name: "stress", about: stress::LONG_ABOUT, shared: &["engine", "backend", "cpu", "threads"] },
    VerbHelp { name: "check", about: check::LONG_ABOUT, shared: &[] },
    VerbHelp { name: "devices", about: devices::LONG_ABOUT, shared: &["threads", "set"] },
];

/// Keys of settings that have a flag.
const FLAGS: [(&str, &str); 25] = [
    ("preset", "quality.preset"),
    ("front", "quality.front"),
    ("sh_order", "light.order"),
    ("split", "light.split"),
    ("lights", "light.lights"),
    ("dering", "light.dering"),
    ("rung", "quality.rung"),
    ("spheres", "quality.spheres"),
    ("directions", "quality.directions"),
    ("soft_at", "quality.soft_at"),
    ("soft_step_px", "quality.soft_step_px"),
    ("self_shadow", "quality.self_shadow"),
    ("phong_norm", "quality.phong_norm"),
    ("shadow_maps", "quality.shadow_maps"),
    ("near_width_deg", "quality.near_width_deg"),
    ("shadow_map_texels", "quality.shadow_map_texels"),
    ("pcf_taps", "quality.pcf_taps"),
    ("effects", "quality.effects"),
    ("brackets", "quality.brackets"),
    ("light_every", "quality.light_every"),
    ("coverage_samples", "quality.coverage_samples"),
    ("near_form", "quality.near_form"),
    ("budget_ms", "quality.budget_ms"),
    ("target_fps", "quality.target_fps"),
    ("max_error", "quality.max_error"),
];

/// The command line with all that its help shows.
pub fn command() -> Command {
    let command = CommandLine::command();
    let shared: Vec<Arg> = command.get_arguments().filter(|arg| arg.is_global_set()).cloned().collect();
    VERBS
        .iter()
        .fold(command, |command, verb| command.mut_subcommand(verb.name, |sub| dressed(sub, verb, &shared)))
}

fn dressed(mut sub: Command, verb: &VerbHelp, shared: &[Arg]) -> Command {
    let short = verb.about.split("\n\n").next().unwrap_or_default().trim_end_matches('.').to_owned();
    sub = sub.about(short).long_about(verb.about);
    for arg in shared {
        let name = arg.get_id().as_str();
        if !ALWAYS.contains(&name) && !verb.shared.contains(&name) {
            // It stays known, so that scripts may give one list of options to every verb.
            sub = sub.arg(arg.clone().hide(true));
        }
    }
    let own: Vec<String> = sub.get_arguments().map(|arg| arg.get_id().to_string()).collect();
    for (flag, key) in FLAGS {
        let is_flag = ["replay", "render", "explain"].contains(&verb.name) && own.iter().any(|id| id == flag);
        if is_flag {
            sub = sub.mut_arg(flag, |arg| ranged(arg, key));
        }
    }
    sub
}

/// A flag's help with what its key may hold and holds by default.
fn ranged(arg: Arg, name: &str) -> Arg {
    let Some(key) = KEYS.iter().find(|key| key.name == name) else { return arg };
    let said = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let default = (key.read)(&Settings::default());
    let said = said.trim_end_matches('.');
    arg.help(format!("{said}. {name}: {} [default: {default}]", key.range.describe())).long_help(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The long help of a verb.
    fn help_of(verb: &str) -> String {
        let mut command = command();
        command.build();
        command.find_subcommand_mut(verb).unwrap().render_long_help().to_string()
    }

    #[test]
    fn every_verb_tells_what_it_does_and_shows_an_example() {
        let names: Vec<String> = command().get_subcommands().map(|c| c.get_name().to_owned()).collect();
        for name in names.iter().filter(|name| *name != "help") {
            let help = help_of(name);
            assert!(VERBS.iter().any(|verb| verb.name == name), "{name} has no row");
            assert!(!help.starts_with("Arguments of"), "{name}: {help}");
            assert!(help.contains("Example"), "{name}: no example");
        }
    }

    #[test]
    fn own_options_come_first_and_shared_ones_where_they_mean_something() {
        for verb in &VERBS {
            let help = help_of(verb.name);
            let shared = help.find("Shared options:").unwrap();
            let last_own = help.find("\nOptions:").unwrap_or(0);
            assert!(last_own < shared, "{}", verb.name);
            for name in ["engine", "backend", "threads", "digest", "set"] {
                let is_shown = help[shared..].contains(&format!("--{name} "))
                    || help[shared..].contains(&format!("--{name}\n"));
                assert_eq!(is_shown, verb.shared.contains(&name), "{}: --{name}", verb.name);
            }
        }
    }

    #[test]
    fn ranges_come_from_the_table_of_keys() {
        for verb in ["replay", "render", "explain"] {
            let help = help_of(verb).split_whitespace().collect::<Vec<_>>().join(" ");
            let governed = ["quality.budget_ms", "quality.target_fps", "quality.max_error"];
            for (_, key) in FLAGS.iter().filter(|(_, key)| verb == "replay" || !governed.contains(key)) {
                let range = KEYS.iter().find(|k| k.name == *key).unwrap().range.describe();
                assert!(help.contains(&format!("{key}: {range}")), "{verb}: {key}");
            }
        }
        // Every key of accuracy has a flag.
        for key in KEYS.iter().filter(|key| key.name.starts_with("quality.")) {
            assert!(FLAGS.iter().any(|(_, name)| *name == key.name), "{}", key.name);
        }
    }

    #[test]
    fn a_hidden_option_is_still_understood() {
        use clap::FromArgMatches;
        let matches =
            command().try_get_matches_from(["halflight", "check", "a.toml", "--digest", "--json"]).unwrap();
        let line = CommandLine::from_arg_matches(&matches).unwrap();
        assert!(line.global.digest && line.global.json);
    }
}
