//! Progress bars, and what the tool lends to the wiring of the pipeline.

use crate::daemon::host::{Host, Progress, Task};
use indicatif::{ProgressBar, ProgressStyle};

/// Draws a bar on standard error where that is a terminal.
struct Bars;

struct Bar(ProgressBar);

impl Progress for Bars {
    fn begin(&self, what: &'static str) -> Box<dyn Task> {
        let bar = ProgressBar::new(100);
        let template = format!("{{bar:40}} {{percent}} % of {what}, {{eta}} left");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style);
        }
        Box::new(Bar(bar))
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

/// Every format that the tool reads, and bars.
pub fn host() -> Host<'static> {
    Host { readers: halflight_lab::READERS, progress: &Bars }
}
