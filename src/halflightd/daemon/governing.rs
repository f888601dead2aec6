//! The governor that the settings ask for.

use crate::config::{presets, settings::Settings};
use crate::pipeline::PipelineError;
use crate::plan::governor::{Goal, Governor};

/// What the settings ask for; `None` where they ask for nothing.
pub fn goal_of(settings: &Settings) -> Option<Goal> {
    let times = [settings.budget_ms, settings.target_fps.map(|fps| 1e3 / fps)];
    let budget_ms = times.into_iter().flatten().reduce(f64::min).map(|ms| ms as f32);
    let max_error = settings.max_error.map(|e| e as f32);
    (budget_ms.is_some() || max_error.is_some()).then_some(Goal { budget_ms, max_error })
}

/// The governor for settings: along their front, over their own accuracy.
///
/// # Errors
/// A front that cannot be read or has no points.
pub fn governor_of(settings: &Settings) -> Result<Option<Governor>, PipelineError> {
    let Some(goal) = goal_of(settings) else { return Ok(None) };
    let named = |why: String| PipelineError::Setup(format!("quality.front = \"{}\": {why}", settings.front));
    let front = presets::front(&settings.front).map_err(named)?.over(&settings.quality);
    let governor = Governor::new(front, goal);
    governor.map(Some).ok_or_else(|| named("must have at least one point".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shorter_time_counts() {
        let with = |budget_ms, target_fps, max_error| {
            goal_of(&Settings { budget_ms, target_fps, max_error, ..Settings::default() })
        };
        assert_eq!(with(None, None, None), None);
        assert_eq!(
            with(Some(20.0), Some(100.0), None),
            Some(Goal { budget_ms: Some(10.0), max_error: None })
        );
        assert_eq!(
            with(Some(5.0), Some(100.0), Some(0.25)),
            Some(Goal { budget_ms: Some(5.0), max_error: Some(0.25) })
        );
        let governor =
            governor_of(&Settings { max_error: Some(1e-4), ..Settings::default() }).unwrap().unwrap();
        assert_eq!(governor.choice().step + 1, governor.choice().of);
        let gone =
            governor_of(&Settings { budget_ms: Some(9.0), front: "/no.json".into(), ..Settings::default() });
        assert!(
            gone.unwrap_err().to_string().contains("quality.front = \"/no.json\": /no.json: cannot be read")
        );
    }
}
