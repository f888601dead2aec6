//! What a command link may ask of the running daemon. Answered on the link's own thread: the frame's path never waits.

use super::settings_thread::Wishes;
use crate::config::{
    file,
    keys::{KEYS, Key},
    resolve,
    settings::Settings,
};
use crate::device::{
    CommandLink, DeviceError,
    supervise::{Delivery, Supervision, Supervisor, supervise},
};
use crate::model::time::Timestamp;
use crate::pipeline::event::{Command, DeviceRole};
use crate::pipeline::inbox::Inbox;
use std::sync::Arc;

const HELP: &str = "help | status | get [KEY or SECTION] | set KEY VALUE (as in the settings file) | stop";

/// Answers requests of one line by one line.
#[derive(Clone)]
pub struct Commands {
    inbox: Arc<Inbox>,
    wishes: Arc<Wishes>,
}

impl Commands {
    /// Takes the way to the pipeline and to its settings.
    pub fn new(inbox: Arc<Inbox>, wishes: Arc<Wishes>) -> Self {
        Self { inbox, wishes }
    }

    /// Starts the thread of a link. `open` opens it, and opens it anew when it was lost.
    ///
    /// # Errors
    /// `Refused` where no thread can be made.
    pub fn serve(
        self,
        supervision: Supervision,
        open: impl FnMut(Timestamp) -> Result<Box<dyn CommandLink>, DeviceError> + Send + 'static,
    ) -> Result<Supervisor, DeviceError> {
        let inbox = Arc::clone(&self.inbox);
        let next = move |link: &mut Box<dyn CommandLink>, deadline| {
            let request = link.next(deadline)?;
            link.reply(request.id, &self.answer(&request.text))
        };
        let deliver = move |delivery| {
            match delivery {
                Delivery::Item(()) | Delivery::Ended => {}
                Delivery::Lost(error) | Delivery::Refused(error) => inbox.put_lost(DeviceRole::Link, error),
                Delivery::Back => inbox.put_back(DeviceRole::Link),
            }
            true
        };
        // Nobody need say anything for days.
        supervise(Supervision { silence_s: None, ..supervision }, open, next, deliver)
    }

    /// The answer to one line. What is not understood, or not allowed, begins with `error:` and says what is.
    pub fn answer(&self, line: &str) -> String {
        let (verb, rest) = line.trim().split_once(char::is_whitespace).unwrap_or((line.trim(), ""));
        let answered = match (verb, rest.trim()) {
            ("help", "") => Ok(HELP.to_owned()),
            ("status", "") => Ok(self.status()),
            ("get", key) => self.get(key),
            ("set", rest) => match rest.split_once(char::is_whitespace) {
                Some((key, value)) => self.set(key, value.trim()),
                None => Err("set needs a key and a value".to_owned()),
            },
            // A stop is never refused.
            ("stop", "") => self
                .inbox
                .put_command(Command::Stop)
                .map_or_else(|full| Err(full.to_string()), |()| Ok("the daemon ends".to_owned())),
            _ => Err(format!("\"{verb}\" with \"{rest}\" is no command. Known: {HELP}")),
        };
        answered.unwrap_or_else(|why| format!("error: {}", why.replace('\n', "; ")))
    }

    fn status(&self) -> String {
        let counts = self.inbox.counts();
        format!(
            "turns {} frames_passed_over {} imu_dropped {} commands_refused {}",
            self.inbox.turns(),
            counts.frames_passed_over,
            counts.imu_dropped,
            counts.commands_refused
        )
    }

    /// One key, or all of a section, as `KEY = VALUE`, with `; ` between.
    fn get(&self, name: &str) -> Result<String, String> {
        let settings = self.wishes.settings();
        let is_meant =
            |key: &&Key| name.is_empty() || key.name == name || key.name.split('.').next() == Some(name);
        let found: Vec<String> = KEYS
            .iter()
            .filter(is_meant)
            .map(|key| format!("{} = {}", key.name, (key.read)(&settings)))
            .collect();
        if found.is_empty() { Err(unknown_key(name)) } else { Ok(found.join("; ")) }
    }

    /// Another value for a live key, written as in the settings file; a word needs no quotes.
    fn set(&self, name: &str, value: &str) -> Result<String, String> {
        let key = KEYS.iter().find(|key| key.name == name).ok_or_else(|| unknown_key(name))?;
        if !key.is_live() {
            return Err(format!("{name} takes effect at the next start only: change the settings file"));
        }
        let settings = self.wishes.settings();
        let typed = typed(name, value, &settings)?;
        let value = (key.read)(&typed);
        self.wishes.wish(typed);
        Ok(format!("{name} = {value}"))
    }
}

fn typed(name: &str, value: &str, base: &Settings) -> Result<Settings, String> {
    let read = |text: &str| {
        let table = file::parse(text).map_err(|e| e.to_string())?;
        resolve("set", &table, base).map_err(|e| e.to_string())
    };
    let as_it_is = read(&format!("{name} = {value}"));
    let is_word = value.chars().all(|c| c.is_alphanumeric() || "_-".contains(c));
    match as_it_is {
        Err(_) if is_word && !matches!(value, "true" | "false") && value.parse::<f64>().is_err() => {
            read(&format!("{name} = \"{value}\""))
        }
        as_it_is => as_it_is,
    }
}

fn unknown_key(name: &str) -> String {
    let names: Vec<&str> = KEYS.iter().map(|key| key.name).collect();
    let near = crate::device::parameters::nearest(name, &names);
    format!("unknown key \"{name}\"{}", near.map(|key| format!(": did you mean {key}?")).unwrap_or_default())
}
