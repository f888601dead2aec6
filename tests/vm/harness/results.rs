//! Results of the steps, as the guest's console tells them.

use std::fmt;

/// Counts, and the steps that are still to be told of.
#[derive(Default)]
pub struct Results {
    expected: Vec<String>,
    pub passed: usize,
    pub failed: usize,
    pub skipped: usize,
    has_ended: bool,
}

impl fmt::Display for Results {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed, {} failed, {} skipped", self.passed, self.failed, self.skipped)
    }
}

impl Results {
    /// Steps that must each be told of once.
    pub fn expect(&mut self, steps: Vec<String>) {
        self.expected = steps;
    }

    pub fn skip(&mut self, name: &str, why: &str) {
        println!("SKIPPED {name}: {why}");
        self.skipped += 1;
    }

    pub fn fail(&mut self, name: &str, why: &str) {
        println!("FAILED {name}: {why}");
        self.failed += 1;
    }

    /// Reads a line of the console: `PASS name`, `FAIL name why`, `SKIP name why`, `TEST-RC=0`.
    pub fn note(&mut self, line: &str) {
        if line.starts_with("TEST-RC=") {
            self.has_ended = true;
        }
        let mut words = line.splitn(3, ' ');
        let (word, name) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        let count = match word {
            "PASS" => &mut self.passed,
            "FAIL" => &mut self.failed,
            "SKIP" => &mut self.skipped,
            _ => return,
        };
        // What is no step may fail as well.
        let before = self.expected.len();
        self.expected.retain(|step| step != name);
        if self.expected.len() < before || word == "FAIL" {
            *count += 1;
        }
    }

    /// The guest has ended: what it said nothing of has failed.
    pub fn finish(&mut self) {
        for name in std::mem::take(&mut self.expected) {
            self.fail(&name, "the guest ended before it");
        }
        if !self.has_ended {
            self.fail("guest", "it ended before it was done: see the console above");
        }
    }
}

/// User and system seconds of a process, also where it has ended and nobody has waited for it.
pub fn processor_time(process: u32) -> String {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    let after_name = text.rsplit(')').next().unwrap_or_default();
    let ticks: Vec<f64> = after_name.split(' ').filter_map(|word| word.parse().ok()).collect();
    // Fields 14 and 15 of the line; the state, field 3, is no number. A tick is 10 ms.
    match ticks.get(10..12) {
        Some([user, system]) => format!("{:.1} s user, {:.1} s system", user / 100.0, system / 100.0),
        _ => "not known".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_say_nothing_have_failed() {
        let mut results = Results::default();
        results.expect(["a", "b", "c", "d"].map(str::to_owned).into());
        for line in ["PASS a", "PASS a", "FAIL b it broke", "SKIP c no device", "PASSING d", "FAIL other"] {
            results.note(line);
        }
        results.finish();
        assert_eq!(results.to_string(), "1 passed, 4 failed, 1 skipped");
    }
}
