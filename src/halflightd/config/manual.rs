//! The table of keys as a settings file that explains itself.

use super::{keys::KEYS, settings::Settings};

/// The manual: every key with unit, range, effect and default, as `config/default.toml` holds it.
pub fn manual() -> String {
    let defaults = Settings::default();
    let mut out = String::from(
        "# Every key of half-light with its unit, range, effect and default: the manual.\n# Made from the table in \
         src/config/keys.rs; a test keeps both equal.\n# Live keys take effect on the next frame when the file that \
         `halflightd --config` names is changed; the others at the\n# next start.\n",
    );
    let mut section = "";
    for key in KEYS {
        let (head, name) = key.name.split_once('.').unwrap_or(("", key.name));
        if head != section {
            section = head;
            out.push_str(&format!("\n[{head}]\n"));
        }
        let unit = if key.unit.is_empty() { String::new() } else { format!(" ({})", key.unit) };
        out.push_str(&format!(
            "# {}\n# Must be {}{unit}.{}\n{name} = {}\n",
            key.effect,
            key.range.describe(),
            if key.is_live() { " Live." } else { "" },
            (key.read)(&defaults)
        ));
    }
    out
}
