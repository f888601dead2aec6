//! What effects cost or save in milliseconds of this machine: a part of `halflight explain`.
//!
//! The engine times passes. Several effects may be drawn by one pass: its time goes to them by their work. What did not run costs
//! what its work would at the rate of its pass, or at that of the whole frame where that did not run either.

use crate::plan::{Decision, EffectVerdict, Pass, PassTiming};

/// Times of passes over some frames.
#[derive(Default)]
pub struct PassTimes(Vec<(Pass, Vec<f32>)>);

impl PassTimes {
    /// Adds a frame's.
    pub fn add(&mut self, passes: &[PassTiming]) {
        for timing in passes.iter().filter(|timing| timing.ms.is_finite()) {
            match self.0.iter_mut().find(|(pass, _)| *pass == timing.pass) {
                Some((_, all)) => all.push(timing.ms),
                None => self.0.push((timing.pass, vec![timing.ms])),
            }
        }
    }

    fn median_ms(&self, pass: Pass) -> Option<f64> {
        let mut all = self.0.iter().find(|(of, _)| *of == pass)?.1.clone();
        all.sort_by(f32::total_cmp);
        all.get(all.len() / 2).map(|ms| f64::from(*ms))
    }

    /// For each decision the milliseconds that it costs or saves; `None` where nothing was timed.
    pub fn of(&self, decisions: &[Decision]) -> Vec<Option<f64>> {
        let pass_of = |d: &Decision| d.effect.pass().or(d.effect.part_of());
        let work_on = |pass: Option<Pass>| -> f64 {
            let on = decisions.iter().filter(|d| d.verdict == EffectVerdict::On);
            on.filter(|d| pass.is_none() || pass_of(d) == pass).map(|d| f64::from(d.saving)).sum()
        };
        let rate = |pass: Pass| Some(self.median_ms(pass)? / work_on(Some(pass))).filter(|r| r.is_finite());
        let timed = self.0.iter().filter(|(pass, _)| rate(*pass).is_some());
        let (ms, work) = timed.fold((0.0, 0.0), |(ms, work), (pass, _)| {
            (ms + self.median_ms(*pass).unwrap_or(0.0), work + work_on(Some(*pass)))
        });
        let whole = Some(ms / work).filter(|rate: &f64| rate.is_finite());
        let of = |d: &Decision| Some(f64::from(d.saving) * pass_of(d).and_then(rate).or(whole)?);
        decisions.iter().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Effect;

    fn decision(effect: Effect, verdict: EffectVerdict, saving: f32) -> Decision {
        Decision { effect, verdict, reason: "", saving, error_bound: 0.0 }
    }

    #[test]
    fn a_pass_s_time_goes_to_its_effects_by_work_and_rates_to_what_did_not_run() {
        let mut times = PassTimes::default();
        for ms in [9.0, 3.0, 6.0] {
            let shade = PassTiming { pass: Pass::ShadeObject, ms };
            times.add(&[shade, PassTiming { pass: Pass::Tonemap, ms: 1.0 }]);
        }
        let decisions = [
            decision(Effect::Objects, EffectVerdict::On, 2.0),
            decision(Effect::VertexLight, EffectVerdict::On, 1.0),
            decision(Effect::MirrorPicture, EffectVerdict::Off, 3.0),
            decision(Effect::ToneMapping, EffectVerdict::On, 0.5),
            decision(Effect::NearMaps, EffectVerdict::Off, 7.0),
        ];
        let ms: Vec<f64> = times.of(&decisions).into_iter().map(Option::unwrap).collect();
        assert_eq!(ms, [4.0, 2.0, 6.0, 1.0, 14.0]);
        assert_eq!(PassTimes::default().of(&decisions), vec![None; 5]);
    }
}
