//! Times of arrival, put straight by the sensor's own rate: a USB-serial chip hands bytes on in lumps, up to 16 ms late.
//!
//! The arrivals of the last samples are regressed against the sensor's count or clock; a sample's time is the line's. What is
//! left is a constant: the mean delay, which is estimated elsewhere together with the camera's.

use super::gates::mask;
use super::sample::SampleStamp;
use crate::model::time::Timestamp;

/// Samples of a regression.
const KEPT: usize = 256;
/// Before so many the line is not used.
const ENOUGH: usize = 16;
/// Samples whose earliest arrival tells that some were lost.
const RECENT: usize = 24;
/// An arrival so far from the line begins afresh, seconds.
const LOST_S: f64 = 0.25;

/// The regression of one sensor.
#[derive(Clone, Debug)]
pub struct Arrivals {
    period_s: f64,
    /// Samples since the beginning and arrival in seconds since the first one, as a ring.
    kept: [(f64, f64); KEPT],
    count: usize,
    begin: Timestamp,
    at: f64,
    /// How far `at` went with the last sample; 0 at a beginning.
    step: f64,
    stamp: SampleStamp,
    line: Option<(f64, f64)>,
    late_s: [f64; RECENT],
    last: Option<Timestamp>,
    dropped: u64,
}

impl Arrivals {
    /// Takes the time between samples as the protocol's makers state it, seconds.
    pub fn new(period_s: f64) -> Self {
        Self {
            period_s,
            kept: [(0.0, 0.0); KEPT],
            count: 0,
            begin: Timestamp(0),
            at: 0.0,
            step: 0.0,
            stamp: SampleStamp::Unstated,
            line: None,
            late_s: [0.0; RECENT],
            last: None,
            dropped: 0,
        }
    }

    /// The time of a sample, later than that of the one before. A line that was fitted anew may put it a little earlier: it
    /// comes a tenth of a period later then, until the line has caught up. `None` where it is far too early (counted).
    pub fn time(&mut self, arrival: Timestamp, stamp: SampleStamp) -> Option<Timestamp> {
        let mut straight = self.straighten(arrival, stamp);
        if let Some(last) = self.last.filter(|last| straight <= *last) {
            if last.seconds_since(straight) > LOST_S {
                self.dropped += 1;
                return None;
            }
            straight = last.plus_seconds(0.1 * self.period_s());
        }
        self.last = Some(straight);
        Some(straight)
    }

    /// Samples that were left out for their time.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Seconds between two samples: as measured, else as stated.
    pub fn period_s(&self) -> f64 {
        self.line.map_or(self.period_s, |(_, slope)| slope)
    }

    /// Seconds from the sample before to the last one, by the sensor's own count or clock; 0 where that is not known.
    pub fn since_last_s(&self) -> f64 {
        self.step * self.period_s()
    }

    /// Whether the sensor's rate has been measured.
    pub fn is_settled(&self) -> bool {
        self.line.is_some()
    }

    fn straighten(&mut self, arrival: Timestamp, stamp: SampleStamp) -> Timestamp {
        let since = arrival.seconds_since(self.begin);
        let step = self.step(stamp);
        self.stamp = stamp;
        if self.count == 0 || !(since - self.expected(self.at + step)).abs().le(&LOST_S) {
            return self.begin_at(arrival);
        }
        self.at += step;
        self.step = step;
        let line = self.line;
        if let Some((offset, slope)) = line {
            self.late_s[self.count % RECENT] = since - (offset + slope * self.at);
            let earliest = self.late_s.iter().copied().fold(f64::INFINITY, f64::min);
            // Delays only add: where even the earliest is late by most of a period, samples were lost.
            if stamp == SampleStamp::Unstated && earliest > 0.75 * slope {
                let lost = (earliest / slope).round().max(1.0);
                self.at += lost;
                self.step += lost;
                self.late_s.iter_mut().for_each(|late| *late -= lost * slope);
            }
        }
        self.kept[self.count % KEPT] = (self.at, since);
        self.count += 1;
        self.line = self.fit();
        let t = match self.line {
            Some((offset, slope)) => offset + slope * self.at,
            // Samples of one read share their arrival; they are told apart until the rate is known.
            None => since
                .max(self.last.map_or(since, |last| last.seconds_since(self.begin)) + 0.01 * self.period_s),
        };
        self.begin.plus_seconds(t)
    }

    fn begin_at(&mut self, arrival: Timestamp) -> Timestamp {
        self.begin = arrival;
        self.at = 0.0;
        self.step = 0.0;
        self.kept[0] = (0.0, 0.0);
        self.count = 1;
        self.line = None;
        self.late_s = [0.0; RECENT];
        arrival
    }

    /// When a sample should come, seconds since the beginning.
    fn expected(&self, at: f64) -> f64 {
        match self.line {
            Some((offset, slope)) => offset + slope * at,
            None => self.kept[(self.count.max(1) - 1) % KEPT].1 + (at - self.at) * self.period_s,
        }
    }

    /// Samples from the one before to this one, by the sensor.
    fn step(&self, stamp: SampleStamp) -> f64 {
        match (self.stamp, stamp) {
            (SampleStamp::Count { value: a, modulus }, SampleStamp::Count { value: b, .. }) => {
                let step = (b + modulus - a % modulus) % modulus;
                if step == 0 { f64::from(modulus) } else { f64::from(step) }
            }
            (SampleStamp::Ticks { value: a, bits, tick_s }, SampleStamp::Ticks { value: b, .. }) => {
                (b.wrapping_sub(a) & mask(bits)) as f64 * tick_s / self.period_s
            }
            _ => 1.0,
        }
    }

    /// Least squares over what is kept: offset and slope.
    fn fit(&self) -> Option<(f64, f64)> {
        let n = self.count.min(KEPT);
        if n < ENOUGH {
            return None;
        }
        let kept = &self.kept[..n];
        let mean = |of: fn(&(f64, f64)) -> f64| kept.iter().map(of).sum::<f64>() / n as f64;
        let (x, y) = (mean(|p| p.0), mean(|p| p.1));
        let (xx, xy) =
            kept.iter().fold((0.0, 0.0), |(xx, xy), p| (xx + (p.0 - x).powi(2), xy + (p.0 - x) * (p.1 - y)));
        let slope = xy / xx;
        (slope > 0.0 && slope.is_finite()).then_some((y - slope * x, slope))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dice::Dice;

    /// Times of a sensor with 300 ppm of drift behind a chip that hands on every 16 ms; returns the spread of the
    /// regressed times and of the arrivals, seconds rms, after the first 256 samples.
    fn spreads(stamp: impl Fn(u32) -> SampleStamp, lost: impl Fn(u32) -> bool) -> (f64, f64) {
        let mut arrivals = Arrivals::new(0.01);
        let mut dice = Dice::new(7);
        let (mut straight, mut raw) = (Vec::new(), Vec::new());
        for k in 0..3000u32 {
            let true_s = f64::from(k) * 0.010_003;
            if lost(k) {
                continue;
            }
            let arrival = ((true_s + 0.002 + 0.001 * dice.unit()) / 0.016).ceil() * 0.016;
            let t = arrivals.time(Timestamp::from_seconds(1.0 + arrival), stamp(k));
            if let (Some(t), true) = (t, k > 400) {
                straight.push(t.seconds() - 1.0 - true_s);
                raw.push(arrival - true_s);
            }
        }
        assert!(straight.len() > 2400, "{}", straight.len());
        let spread = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
        };
        (spread(&straight), spread(&raw))
    }

    #[test]
    fn the_jitter_of_a_chip_is_taken_out() {
        for (name, (straight, raw)) in [
            ("count", spreads(|k| SampleStamp::Count { value: k % 256, modulus: 256 }, |_| false)),
            ("none", spreads(|_| SampleStamp::Unstated, |_| false)),
            (
                "count, some lost",
                spreads(|k| SampleStamp::Count { value: k % 256, modulus: 256 }, |k| k % 97 == 5),
            ),
        ] {
            println!("{name}: {:.3} ms, arrivals {:.3} ms", 1e3 * straight, 1e3 * raw);
            assert!(raw > 0.004 && straight < 0.0007, "{name}: {straight} of {raw}");
        }
    }

    #[test]
    fn samples_that_are_lost_without_an_index_are_noticed() {
        let (straight, _) = spreads(|_| SampleStamp::Unstated, |k| (1500..1503).contains(&k));
        println!("three lost without an index: {:.3} ms", 1e3 * straight);
        assert!(straight < 0.004, "{straight}");
    }

    #[test]
    fn no_sample_is_dropped_where_a_slow_machine_hands_them_on_in_lumps() {
        for seed in 0..20 {
            let mut dice = Dice::new(seed);
            let mut arrivals = Arrivals::new(0.01);
            let (mut last, mut next_s) = (None, 0.0f64);
            for k in 0..2000u32 {
                let true_s = f64::from(k) * 0.0101;
                while next_s < true_s {
                    next_s += dice.between(0.001, 0.2);
                }
                let stamp = SampleStamp::Count { value: k % 256, modulus: 256 };
                let t = arrivals.time(Timestamp::from_seconds(next_s), stamp);
                assert!(t.is_some() && t > last, "seed {seed}, sample {k}");
                last = t;
            }
            // The clock of the samples is that of the sensor again.
            let behind_s = last.unwrap().seconds() - 2000.0 * 0.0101;
            assert!(behind_s.abs() < 0.2, "seed {seed}: {behind_s}");
        }
    }

    #[test]
    fn times_rise_whatever_comes() {
        let mut arrivals = Arrivals::new(0.01);
        let mut dice = Dice::new(3);
        let mut last = None;
        for _ in 0..5000 {
            let stamp = SampleStamp::Count { value: (dice.unit() * 256.0) as u32, modulus: 256 };
            let t = arrivals.time(Timestamp((dice.unit() * 1e10) as i64), stamp);
            if let Some(t) = t {
                assert!(last.is_none_or(|last| t > last));
                last = Some(t);
            }
        }
    }
}
