//! Light over time: a low pass on the coefficients, and how sure the direction is.

use super::halve::{HalveOptions, Halver};
use super::prefilter::{Prefilter, WantedEnvironment};
use super::split::{SplitOptions, first_moment, split};
use crate::math::sh::MAX_COEFFICIENTS;
use crate::model::{
    environment::EnvironmentPicture,
    estimate::{LightEstimate, LightFlags, Provenance},
    light::{RadianceSamples, RadianceSh},
    time::Timestamp,
};
use glam::{DMat3, DVec3};

/// After a gap longer than this, in seconds, the filter begins anew (spec 10).
pub const LONGEST_GAP_S: f64 = 1.0;
/// The levels for gloss, which are smooth and cost more than all else here, are made anew at most so often, seconds.
pub const GLOSS_EVERY_S: f64 = 0.2;
/// Shortest memory, in seconds, over which the noise of the measurements is estimated: also without a filter.
const LEAST_NOISE_MEMORY_S: f64 = 0.5;
/// 1 - 0.95: the share of cones that may miss.
const MISS: f64 = 0.05;

/// First-order low pass on measured light. It filters the coefficients, which is linear, and never the direction.
///
/// Each update enters with alpha = 1 - exp(-dt / tau), and at the start with at least 1/k, so that the first k
/// updates are their plain mean. Nothing here allocates.
#[derive(Clone, Debug)]
pub struct Follow {
    filter_tau_s: f64,
    halve: HalveOptions,
    halver: Halver,
    filtered: [[f64; 3]; MAX_COEFFICIENTS],
    weights: UpdateWeights,
    noise: MomentNoise,
    last: Option<LightEstimate>,
    wanted: WantedEnvironment,
    prefilter: Prefilter,
    environment: EnvironmentPicture,
    left: RadianceSamples,
    since_levels_s: f64,
}

/// How many updates entered, and the sum of their squared weights: 1 over their effective number.
#[derive(Clone, Copy, Debug, Default)]
struct UpdateWeights {
    updates: u64,
    squared: f64,
}

impl UpdateWeights {
    /// Lets one more in, `dt_s` after the last; gives its weight.
    fn enter(&mut self, dt_s: f64, tau_s: f64) -> f64 {
        self.updates += 1;
        let steady = if tau_s > 0.0 { -(-dt_s / tau_s).exp_m1() } else { 1.0 };
        let alpha = steady.max(1.0 / self.updates as f64);
        self.squared = (1.0 - alpha).powi(2) * self.squared + alpha * alpha;
        alpha
    }
}

/// Running mean and scatter of the gray first moment.
#[derive(Clone, Copy, Debug, Default)]
struct MomentNoise {
    weights: UpdateWeights,
    mean: DVec3,
    scatter: DMat3,
}

impl MomentNoise {
    fn enter(&mut self, moment: DVec3, dt_s: f64, tau_s: f64) {
        let alpha = self.weights.enter(dt_s, tau_s);
        let off = moment - self.mean;
        self.mean += alpha * off;
        let outer = DMat3::from_cols(off * off.x, off * off.y, off * off.z);
        self.scatter = (self.scatter + outer * alpha) * (1.0 - alpha);
    }

    /// Half angle of the cone about `direction` for a filtered moment of length `moment_length` whose updates'
    /// squared weights sum to `filter_squared_weights`.
    fn cone95(&self, direction: DVec3, moment_length: f64, filter_squared_weights: f64) -> f64 {
        let effective = 1.0 / self.weights.squared;
        // Three points show a scatter in two dimensions, and nothing about how far it can be trusted.
        if effective <= 2.0 + 1e-9 {
            return std::f64::consts::PI;
        }
        let one = direction.any_orthonormal_vector();
        let other = direction.cross(one);
        let (a, b, c) =
            (one.dot(self.scatter * one), one.dot(self.scatter * other), other.dot(self.scatter * other));
        let largest = 0.5 * (a + c) + (0.25 * (a - c) * (a - c) + b * b).sqrt();
        let variance = largest / (1.0 - self.weights.squared) * filter_squared_weights;
        // Quantile of Hotelling's T^2 in two dimensions, (n-1)(0.05^(-2/(n-2)) - 1): chi-squared's 5.991 for many
        // updates, wider while the scatter itself is known from few.
        let quantile = (effective - 1.0) * (MISS.powf(-2.0 / (effective - 2.0)) - 1.0);
        let sideways = (quantile * variance).sqrt();
        let angle = sideways.atan2(moment_length);
        // A cone that nearly reaches the plane behind says nothing; a normal error could point anywhere.
        if angle.is_finite() && sideways < 10.0 * moment_length { angle } else { std::f64::consts::PI }
    }
}

impl Follow {
    /// A filter with time constant `filter_tau_s` in seconds: 0, negative or NaN means none, every update counts
    /// alone. `halve` says how the filtered light is halved.
    pub fn new(filter_tau_s: f64, halve: HalveOptions) -> Self {
        Self {
            filter_tau_s: if filter_tau_s > 0.0 { filter_tau_s } else { 0.0 },
            halve,
            halver: Halver::new(halve),
            filtered: [[0.0; 3]; MAX_COEFFICIENTS],
            weights: UpdateWeights::default(),
            noise: MomentNoise::default(),
            last: None,
            wanted: WantedEnvironment::default(),
            prefilter: Prefilter::default(),
            environment: EnvironmentPicture::default(),
            left: RadianceSamples::default(),
            since_levels_s: 0.0,
        }
    }

    /// What of the picture of the environment is to be kept up with the light; nothing where nothing was said.
    pub fn want(&mut self, wanted: WantedEnvironment) {
        self.wanted = wanted;
    }

    /// The picture of the environment, filtered as the light is; `None` where none is wanted or none was seen.
    pub fn environment(&self) -> Option<&EnvironmentPicture> {
        (self.environment.all.side() > 0).then_some(&self.environment)
    }

    /// Goes on with another time constant and another split; what was measured stays.
    pub fn retune(&mut self, filter_tau_s: f64, halve: HalveOptions) {
        self.filter_tau_s = if filter_tau_s > 0.0 { filter_tau_s } else { 0.0 };
        self.halve = halve;
        self.halver.retune(halve);
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        let wanted = self.wanted;
        *self = Self::new(self.filter_tau_s, self.halve);
        self.wanted = wanted;
    }

    /// Takes in light measured at time `t` (world frame) with what it had to do without, and the weighted directions
    /// that it was summed from (the picture in which compact lights are found; may be empty). `true` where it entered:
    /// light that is not finite, and a time that is not later than the last, are refused and change nothing. A gap of
    /// more than [`LONGEST_GAP_S`], or another order, begins anew.
    pub fn update(
        &mut self,
        t: Timestamp,
        total: &RadianceSh,
        flags: &LightFlags,
        samples: &RadianceSamples,
    ) -> bool {
        let order = total.order;
        let sound = order * order <= MAX_COEFFICIENTS && total.rows().iter().flatten().all(|c| c.is_finite());
        let dt_s = self.last.map_or(0.0, |last| t.seconds_since(last.t));
        if !sound || self.last.is_some_and(|last| t <= last.t) {
            return false;
        }
        if dt_s > LONGEST_GAP_S || self.last.is_some_and(|last| last.total.order != order) {
            self.reset();
        }
        let alpha = self.weights.enter(dt_s, self.filter_tau_s);
        let mut filtered = RadianceSh::zero(order);
        let rows = filtered.rgb.iter_mut().zip(&mut self.filtered).zip(total.rows());
        for ((rounded, state), row) in rows {
            for ((rounded, state), c) in rounded.iter_mut().zip(state).zip(row) {
                *state += alpha * (f64::from(*c) - *state);
                *rounded = *state as f32;
            }
        }
        self.halver.see(samples, alpha, dt_s);
        let lights = self.halver.halve(&filtered);
        if self.wanted.picture && !samples.directions.is_empty() {
            self.prefilter.see(samples, alpha as f32, &mut self.environment);
            self.since_levels_s += dt_s;
            if self.wanted.glossy
                && (self.environment.glossy.is_empty() || self.since_levels_s >= GLOSS_EVERY_S)
            {
                self.since_levels_s = 0.0;
                let has_rest = self.halver.left_over(&mut self.left);
                self.prefilter.levels(has_rest.then_some(&self.left), &mut self.environment);
            }
        }
        let halves = split(&filtered, &SplitOptions { bounded: false, ..self.halve.net_flux });
        self.noise.enter(
            self.gray_moment(&total.rgb.map(|row| row.map(f64::from))),
            dt_s,
            self.filter_tau_s.max(LEAST_NOISE_MEMORY_S),
        );
        let cone95_rad = halves.direct.map_or(std::f32::consts::PI, |direct| {
            let direction = DVec3::from(direct.to_light_world.map(f64::from)).normalize_or_zero();
            let length = self.gray_moment(&self.filtered).length();
            self.noise.cone95(direction, length, self.weights.squared) as f32
        });
        self.last = Some(LightEstimate {
            t,
            total: filtered,
            split: halves,
            lights,
            provenance: Provenance::Measured,
            cone95_rad,
            flags: *flags,
        });
        true
    }

    /// The light at time `t`; `None` before the first update. At the time of the last update it is measured, at any
    /// other time held, with its age (0 for times before it). `LightEstimate::t` is the time of the last update.
    ///
    /// The 95 % cone counts noise that is independent from update to update, not what all updates get wrong
    /// together; it is pi without a direction and before there are three updates.
    pub fn estimate(&self, t: Timestamp) -> Option<LightEstimate> {
        let mut estimate = self.last?;
        if t != estimate.t {
            estimate.provenance = Provenance::Held { age_s: t.seconds_since(estimate.t).max(0.0) };
        }
        Some(estimate)
    }

    fn gray_moment(&self, rgb: &[[f64; 3]; MAX_COEFFICIENTS]) -> DVec3 {
        let gray = |row: usize| -> f64 {
            rgb[row].iter().zip(self.halve.net_flux.gray_weights).map(|(c, w)| c * f64::from(w)).sum()
        };
        DVec3::from(first_moment(gray(1), gray(2), gray(3)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sh::basis::evaluate;

    fn halving() -> HalveOptions {
        let net_flux = SplitOptions::default();
        HalveOptions {
            kind: crate::model::quality::SplitKind::Paper,
            lights: 4,
            shadow_maps: 1,
            net_flux,
            above_horizon: false,
            dering: false,
        }
    }

    fn sun(order: usize, direction: DVec3, irradiance: f64) -> RadianceSh {
        let mut y = [0.0; MAX_COEFFICIENTS];
        evaluate(order, direction.normalize().to_array(), &mut y);
        let mut light = RadianceSh::zero(order);
        for (row, y) in light.rgb.iter_mut().zip(y).take(order * order) {
            *row = [(irradiance * y) as f32; 3];
        }
        light
    }

    fn at(milliseconds: i64) -> Timestamp {
        Timestamp(milliseconds * 1_000_000)
    }

    fn level(follow: &Follow, t: Timestamp) -> f32 {
        follow.estimate(t).unwrap().total.rgb[0][0] / sun(2, DVec3::Z, 1.0).rgb[0][0]
    }

    #[test]
    fn nothing_then_measured_then_held() {
        let mut follow = Follow::new(0.3, halving());
        assert!(follow.estimate(at(0)).is_none());
        let flags = LightFlags { texels: 7, ..LightFlags::default() };
        assert!(follow.update(at(5), &sun(4, DVec3::X, 2.0), &flags, &RadianceSamples::default()));
        let now = follow.estimate(at(5)).unwrap();
        assert_eq!(
            (now.provenance, now.flags, now.total),
            (Provenance::Measured, flags, sun(4, DVec3::X, 2.0))
        );
        assert_eq!(now.split.direct.unwrap().to_light_world, [1.0, 0.0, 0.0]);
        assert_eq!(now.cone95_rad, std::f32::consts::PI);
        let later = follow.estimate(at(505)).unwrap();
        assert_eq!((later.t, later.provenance), (at(5), Provenance::Held { age_s: 0.5 }));
        assert_eq!(follow.estimate(at(1)).unwrap().provenance, Provenance::Held { age_s: 0.0 });
    }

    #[test]
    fn a_step_follows_the_exponential_after_the_mean_of_the_start() {
        let mut follow = Follow::new(0.2, halving());
        let flags = LightFlags::default();
        // The first are averaged: 1, 3, 5 -> 3.
        for (k, irradiance) in [1.0, 3.0, 5.0].into_iter().enumerate() {
            assert!(follow.update(
                at(10 * k as i64),
                &sun(2, DVec3::Z, irradiance),
                &flags,
                &RadianceSamples::default()
            ));
        }
        assert!((level(&follow, at(20)) - 3.0).abs() < 1e-6);
        for k in 3..3000 {
            follow.update(at(10 * k), &sun(2, DVec3::Z, 1.0), &flags, &RadianceSamples::default());
        }
        let start = at(10 * 2999);
        assert!((level(&follow, start) - 1.0).abs() < 1e-6);
        // From 1 to 2: after 0.2 s, 1 - exp(-1) of the way, whatever the steps.
        for ms in [50, 60, 130, 200] {
            follow.update(
                start.plus_seconds(f64::from(ms) * 1e-3),
                &sun(2, DVec3::Z, 2.0),
                &flags,
                &RadianceSamples::default(),
            );
        }
        let want = 2.0 - (-1.0f32).exp();
        assert!((level(&follow, start) - want).abs() < 1e-6, "{} {want}", level(&follow, start));
    }

    #[test]
    fn without_a_filter_the_last_update_stands_alone() {
        for tau in [0.0, -1.0, f64::NAN] {
            let mut follow = Follow::new(tau, halving());
            for k in 0..9 {
                follow.update(
                    at(k),
                    &sun(3, DVec3::Z, k as f64),
                    &LightFlags::default(),
                    &RadianceSamples::default(),
                );
            }
            assert_eq!(follow.estimate(at(8)).unwrap().total, sun(3, DVec3::Z, 8.0));
        }
    }

    #[test]
    fn bad_times_and_bad_light_change_nothing() {
        let mut follow = Follow::new(0.5, halving());
        let flags = LightFlags::default();
        follow.update(at(100), &sun(2, DVec3::Z, 1.0), &flags, &RadianceSamples::default());
        let before = follow.estimate(at(100));
        assert!(
            !follow.update(at(100), &sun(2, DVec3::Z, 9.0), &flags, &RadianceSamples::default()),
            "equal time"
        );
        assert!(
            !follow.update(at(99), &sun(2, DVec3::Z, 9.0), &flags, &RadianceSamples::default()),
            "backwards"
        );
        assert!(
            !follow.update(Timestamp(i64::MIN), &sun(2, DVec3::Z, 9.0), &flags, &RadianceSamples::default()),
            "far backwards"
        );
        for bad in [f32::NAN, f32::INFINITY] {
            let mut light = sun(2, DVec3::Z, 9.0);
            light.rgb[3][2] = bad;
            assert!(!follow.update(at(200), &light, &flags, &RadianceSamples::default()));
        }
        let mut empty = sun(2, DVec3::Z, 9.0);
        empty.order = 7;
        assert!(!follow.update(at(200), &empty, &flags, &RadianceSamples::default()));
        assert_eq!(follow.estimate(at(100)), before);
        assert!(follow.update(at(200), &sun(2, DVec3::Z, 1.0), &flags, &RadianceSamples::default()));
    }

    #[test]
    fn a_gap_and_another_order_begin_anew() {
        let mut follow = Follow::new(5.0, halving());
        let flags = LightFlags::default();
        for k in 0..50 {
            follow.update(at(20 * k), &sun(2, DVec3::Z, 1.0), &flags, &RadianceSamples::default());
        }
        follow.update(at(10_980), &sun(2, DVec3::Z, 3.0), &flags, &RadianceSamples::default());
        assert!((level(&follow, at(10_980)) - 3.0).abs() < 1e-6, "10 s gap");
        follow.update(at(11_980), &sun(2, DVec3::Z, 5.0), &flags, &RadianceSamples::default());
        assert!((level(&follow, at(11_980)) - 4.0).abs() < 1e-6, "1 s is no gap yet");
        follow.update(at(12_000), &sun(5, DVec3::Z, 8.0), &flags, &RadianceSamples::default());
        assert_eq!(follow.estimate(at(12_000)).unwrap().total, sun(5, DVec3::Z, 8.0));
    }

    #[test]
    fn still_light_has_a_closed_cone_and_dark_light_an_open_one() {
        let mut follow = Follow::new(0.1, halving());
        for k in 0..20 {
            follow.update(
                at(33 * k),
                &sun(4, DVec3::new(1.0, 2.0, 3.0), 2.0),
                &LightFlags::default(),
                &RadianceSamples::default(),
            );
        }
        assert!(follow.estimate(at(0)).unwrap().cone95_rad < 1e-6);
        let mut dark = Follow::new(0.1, halving());
        for k in 0..20 {
            dark.update(
                at(33 * k),
                &RadianceSh::zero(4),
                &LightFlags::default(),
                &RadianceSamples::default(),
            );
        }
        let estimate = dark.estimate(at(0)).unwrap();
        assert!(estimate.split.direct.is_none() && estimate.cone95_rad == std::f32::consts::PI);
    }

    #[test]
    fn the_cone_holds_the_truth_as_often_as_it_says() {
        // Noise equal in all directions: the cone is nearly the ellipse itself, so about 95 % and not much more.
        let truth = DVec3::new(0.3, -0.5, 0.8).normalize();
        for (tau, updates) in [(0.0, 40), (0.4, 5), (0.4, 12), (0.4, 200)] {
            let (mut inside, trials) = (0, 1500);
            for seed in 0..trials {
                let mut dice = crate::math::dice::Dice::new(seed * 77 + 5);
                let mut follow = Follow::new(tau, halving());
                for k in 0..updates {
                    let mut light = sun(2, truth, 2.0);
                    for row in 1..4 {
                        let noise = 0.03 * dice.normal() as f32;
                        light.rgb[row] = light.rgb[row].map(|c| c + noise);
                    }
                    follow.update(at(33 * k), &light, &LightFlags::default(), &RadianceSamples::default());
                }
                let estimate = follow.estimate(at(0)).unwrap();
                let direction = DVec3::from(estimate.split.direct.unwrap().to_light_world.map(f64::from));
                inside += i32::from(direction.angle_between(truth) <= f64::from(estimate.cone95_rad));
            }
            let share = f64::from(inside) / trials as f64;
            // The circle around the estimated ellipse holds more than the ellipse, much more while few updates make
            // the ellipse long by chance.
            let most = if updates < 40 { 1.0 } else { 0.997 };
            assert!((0.935..=most).contains(&share), "tau {tau}, {updates} updates: {share}");
        }
    }

    #[test]
    fn the_picture_follows_the_light_and_its_levels_every_fifth_of_a_second() {
        let mut samples = RadianceSamples::default();
        for k in 0..6000 {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / 6000.0;
            let (s, c) = (2.4 * k as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            samples.directions.push([r * c, r * s, z, 4.0 * std::f32::consts::PI / 6000.0]);
            samples.radiance.push([1.0, 2.0, 3.0, 0.0]);
        }
        let mut total = RadianceSh::zero(4);
        total.rgb[0] = [1.0; 3];
        let mut follow = Follow::new(0.0, halving());
        let flags = LightFlags::default();
        let update = |follow: &mut Follow, t_s: f64, scale: f32| {
            let mut seen = samples.clone();
            seen.radiance.iter_mut().for_each(|r| *r = r.map(|c| c * scale));
            assert!(follow.update(Timestamp::from_seconds(t_s), &total, &flags, &seen));
        };
        update(&mut follow, 0.0, 1.0);
        assert!(follow.environment().is_none(), "nobody wants it");
        follow.want(WantedEnvironment { picture: true, glossy: true });
        update(&mut follow, 0.1, 1.0);
        let look = |follow: &Follow| {
            let picture = follow.environment().unwrap();
            let up = glam::Vec3::Z;
            (picture.all.look(up)[0], picture.gloss(20.0, up)[0], picture.holds_hard_lights)
        };
        // The paper's split knows no parts of the picture: the levels hold everything.
        let near =
            |a: (f32, f32, bool), b: (f32, f32)| (a.0 - b.0).abs() < 1e-4 && (a.1 - b.1).abs() < 1e-4 && a.2;
        assert!(near(look(&follow), (1.0, 1.0)), "{:?}", look(&follow));
        update(&mut follow, 0.2, 3.0);
        assert!(near(look(&follow), (3.0, 1.0)), "{:?}", look(&follow));
        update(&mut follow, 0.31, 5.0);
        assert!(near(look(&follow), (5.0, 5.0)), "{:?}", look(&follow));
        // After a gap everything begins anew, and is still wanted.
        update(&mut follow, 9.0, 2.0);
        assert!(near(look(&follow), (2.0, 2.0)), "{:?}", look(&follow));
    }
}
