//! Which right is missing for a device, and the command that mends it.

use super::PluggedMachine;
use rustix::fs::{Access, access};
use std::path::{Path, PathBuf};

/// The file of udev rules that comes with the program.
pub const RULES: &str = "70-halflight.rules";
/// Where udev looks for rules.
const RULE_FOLDERS: [&str; 3] = ["/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d"];

/// What gives the right to a kind of device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RightOf {
    /// Cameras: the group `video`.
    Video,
    /// Serial ports: the group `dialout`.
    Serial,
    /// hidraw and IIO: our udev rules, which give them to the group `plugdev`.
    Rules,
}

impl RightOf {
    /// The group that has it.
    pub fn group(self) -> &'static str {
        match self {
            Self::Video => "video",
            Self::Serial => "dialout",
            Self::Rules => "plugdev",
        }
    }
}

/// A right that is missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingRight {
    /// What may not be read and written.
    pub path: PathBuf,
    /// The group that may, or will.
    pub group: &'static str,
    /// The command that mends it.
    pub mend: String,
}

/// Whether this process may read and write a path.
pub fn may_read_and_write(path: &Path) -> bool {
    access(path, Access::READ_OK | Access::WRITE_OK).is_ok()
}

impl PluggedMachine {
    /// What is missing to use a path; `None` where nothing is, or where there is no such path.
    pub fn missing(&self, path: impl AsRef<Path>, right: RightOf) -> Option<MissingRight> {
        let path = path.as_ref();
        if !self.has(path) || self.may_use(path) {
            return None;
        }
        let group = right.group();
        let join = format!("sudo usermod -aG {group} \"$USER\"   # then log in again");
        let has_rules = || RULE_FOLDERS.iter().any(|folder| self.has(Path::new(folder).join(RULES)));
        let mend = match right {
            RightOf::Rules if !has_rules() => format!(
                "sudo cp systemd/{RULES} {}/ && sudo udevadm control --reload && sudo udevadm trigger && {join}",
                RULE_FOLDERS[0]
            ),
            _ => join,
        };
        Some(MissingRight { path: path.to_owned(), group, mend })
    }
}
