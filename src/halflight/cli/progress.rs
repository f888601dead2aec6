//! Bars for long work, all of one style, and what the tool lends to the wiring of the pipeline.

use crate::daemon::host::{Host, Progress, Task};
use crate::lab::tradeoff::StudyWatch;
use indicatif::{ProgressBar, ProgressStyle};

/// Every format that the tool reads, and bars.
pub fn host() -> Host<'static> {
    Host { readers: crate::lab::READERS, progress: &Bars }
}

/// One bar on standard error, where that is a terminal. It goes when it is dropped.
pub struct Bar(ProgressBar);

impl Bar {
    /// Of work whose share is known: "of the room".
    pub fn of_share(what: &str) -> Self {
        Self::styled(Some(100), &format!("{{bar:40}} {{percent}} % of {what}, {{eta}} left"))
    }

    /// Of a number of things, if it is known: "frames".
    pub fn of_count(total: Option<u64>, things: &str) -> Self {
        Self::styled(total, &format!("{{bar:40}} {{pos}} of {{len}} {things}, {{eta}} left {{msg}}"))
    }

    fn styled(total: Option<u64>, template: &str) -> Self {
        let bar = match total {
            Some(total) => ProgressBar::new(total),
            None => ProgressBar::new_spinner(),
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Self(bar)
    }

    /// One that nobody sees.
    pub fn hidden() -> Self {
        Self(ProgressBar::hidden())
    }

    /// So many are done.
    pub fn set_count(&self, done: u64) {
        self.0.set_position(done);
    }

    /// One more is done.
    pub fn add_one(&self) {
        self.0.inc(1);
    }

    /// So many more are to come.
    pub fn expect_more(&self, things: u64) {
        self.0.inc_length(things);
    }

    /// Time is judged from now on.
    pub fn begin_here(&self) {
        self.0.reset_eta();
    }

    /// Says something beside the bar.
    pub fn say(&self, message: impl Into<String>) {
        self.0.set_message(message.into());
    }
}

impl Task for Bar {
    fn reach(&self, share: f32) {
        self.0.set_position((share * 100.0) as u64);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Draws bars for the pipeline's wiring.
struct Bars;

impl Progress for Bars {
    fn begin(&self, what: &'static str) -> Box<dyn Task> {
        Box::new(Bar::of_share(what))
    }
}

impl StudyWatch for Bar {
    fn begin(&self, part: &str) {
        self.say(part);
    }

    fn expect(&self, draws: usize) {
        self.expect_more(draws as u64);
    }

    fn done(&self) {
        self.add_one();
    }
}
