//! What drivers find around them.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

/// The variable that drivers complain about where it is missing, on standard error, although nothing here needs it.
const RUNTIME_FOLDER: &str = "XDG_RUNTIME_DIR";
/// A folder that is never there: nothing is looked for in it.
const NO_FOLDER: &str = "/nonexistent";

/// Begins the program anew with the variable set where it is missing or names no absolute path. It is called before
/// anything else: nothing is lost. Where that fails the program goes on as it is.
pub fn without_needless_lines() {
    let given = std::env::var_os(RUNTIME_FOLDER);
    if given.is_some_and(|folder| Path::new(&folder).is_absolute()) {
        return;
    }
    let Ok(program) = std::env::current_exe() else { return };
    let mut arguments = std::env::args_os();
    let mut command = Command::new(program);
    if let Some(name) = arguments.next() {
        command.arg0(name);
    }
    // `exec` returns only where it fails; then a driver's line more is the lesser evil.
    let _ = command.args(arguments).env(RUNTIME_FOLDER, NO_FOLDER).exec();
}
