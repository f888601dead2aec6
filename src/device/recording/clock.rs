//! A recording's clock that is set back (by NTP, or by hand): what comes after the step counts as later, after a gap.

/// A channel whose time falls by more than this was not merely written in another order, nanoseconds.
pub(crate) const LARGEST_DISORDER_NS: i64 = 1_000_000_000;
/// How long after the last moment before a step the first one after it counts, nanoseconds: long enough for all that follows the
/// light and the pose to begin anew.
pub(crate) const GAP_NS: i64 = 2_000_000_000;

/// One stretch of time without a step.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    /// What is added to the file's time.
    shift_ns: i64,
    /// The file's last time in it.
    last_ns: i64,
    /// That which no other of it exceeds.
    latest_ns: i64,
}

/// Puts the times of all channels of a file on one line. A channel steps by itself: files may hold one channel after another.
#[derive(Debug, Default)]
pub(super) struct TimeLine {
    stretches: Vec<Stretch>,
    /// For each channel the stretch that it is in, and its last time.
    channels: std::collections::BTreeMap<u16, (usize, i64)>,
}

impl TimeLine {
    /// Steps so far.
    pub(super) fn steps(&self) -> u64 {
        self.stretches.len().saturating_sub(1) as u64
    }

    /// What to add to the time of a channel's next message.
    pub(super) fn shift(&mut self, channel: u16, t_ns: i64) -> i64 {
        let at = match self.channels.get(&channel) {
            Some((at, last)) if last.saturating_sub(t_ns) > LARGEST_DISORDER_NS => at + 1,
            Some((at, _)) => *at,
            None => self.nearest(t_ns),
        };
        if at == self.stretches.len() {
            let before = self.stretches.last();
            let shift_ns = before.map_or(0, |b| {
                b.latest_ns.saturating_add(b.shift_ns).saturating_add(GAP_NS).saturating_sub(t_ns)
            });
            self.stretches.push(Stretch { shift_ns, last_ns: t_ns, latest_ns: t_ns });
        }
        let stretch = &mut self.stretches[at];
        stretch.last_ns = t_ns;
        stretch.latest_ns = stretch.latest_ns.max(t_ns);
        self.channels.insert(channel, (at, t_ns));
        stretch.shift_ns
    }

    /// The stretch of a channel that was not seen before: the one whose time is nearest, the later of two.
    fn nearest(&self, t_ns: i64) -> usize {
        let away = |k: &usize| self.stretches[*k].last_ns.abs_diff(t_ns);
        (0..self.stretches.len()).rev().min_by_key(away).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn a_step_back_counts_as_a_gap_for_all_channels() {
        let mut line = TimeLine::default();
        let times = [(1, 7200), (2, 7200), (1, 7201), (2, 7201), (1, 3602), (2, 3602), (3, 3602), (1, 3603)];
        let got: Vec<i64> = times.iter().map(|(c, t)| (line.shift(*c, t * S) + t * S) / S).collect();
        assert_eq!(got, [7200, 7200, 7201, 7201, 7203, 7203, 7203, 7204]);
        assert_eq!(line.steps(), 1);
    }

    #[test]
    fn channels_written_one_after_another_are_no_step() {
        let mut line = TimeLine::default();
        for channel in [1, 2] {
            for t in [5, 6, 7, 8, 9] {
                assert_eq!(line.shift(channel, t * S), 0);
            }
        }
        assert_eq!((line.shift(1, 8 * S), line.steps()), (0, 0));
    }
}
