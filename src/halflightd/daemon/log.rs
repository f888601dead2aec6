//! The log of both programs: lines on standard error, filtered by `HALFLIGHT_LOG`.

use tracing_subscriber::{filter::Targets, layer::SubscriberExt, util::SubscriberInitExt};

/// Writes log lines to standard error. `HALFLIGHT_LOG` chooses which: a level (`warn`), or levels by module
/// (`info,halflightd::pipeline=debug`). Without it, or where it says something else, `default` holds.
pub fn to_stderr(default: tracing::Level) {
    let typed = std::env::var("HALFLIGHT_LOG").ok();
    let parsed = typed.as_deref().map(str::parse::<Targets>);
    let filter = match &parsed {
        Some(Ok(targets)) => targets.clone(),
        _ => Targets::new().with_default(default),
    };
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false);
    tracing_subscriber::registry().with(lines).with(filter).init();
    if let (Some(Err(error)), Some(text)) = (&parsed, &typed) {
        tracing::warn!(
            "HALFLIGHT_LOG = \"{text}\": must be a level (error, warn, info, debug, trace), or MODULE=LEVEL, with commas between ({error})"
        );
    }
}
