//! Times of work that is run several times.

use std::time::Instant;

/// Median and best time of some runs after one that warms up, milliseconds.
pub fn time_ms(runs: usize, mut work: impl FnMut()) -> (f64, f64) {
    work();
    let mut all: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    (median(&mut all), all[0])
}

/// The middle one; sorts them.
pub fn median(all: &mut [f64]) -> f64 {
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}
