//! Where results of long computations are kept from run to run.

use std::path::PathBuf;

/// `$XDG_CACHE_HOME/halflight`, else `$HOME/.cache/halflight`; `None` where neither is set to an absolute path.
pub fn cache_folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")))?;
    Some(base.join("halflight"))
}
