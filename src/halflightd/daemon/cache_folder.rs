//! Where results of long computations are kept from run to run.

use crate::assets::kept;
use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of a MiB.
const MIB: u64 = 1 << 20;

/// Most MiB of the folder, as `cache.max_mib` says; there is one cache for a process.
static MOST_MIB: AtomicU64 = AtomicU64::new(DEFAULT_MAX_MIB);

/// What `cache.max_mib` is by default.
pub const DEFAULT_MAX_MIB: u64 = 2048;

/// The first folder of `$CACHE_DIRECTORY` (systemd), else `$XDG_CACHE_HOME/halflight`, else `$HOME/.cache/halflight`; `None`
/// where none is set to an absolute path.
pub fn cache_folder() -> Option<PathBuf> {
    let absolute = |path: PathBuf| Some(path).filter(|path| path.is_absolute());
    let of = |name: &str| std::env::var_os(name).map(PathBuf::from).and_then(absolute);
    let of_unit = std::env::var_os("CACHE_DIRECTORY")
        .and_then(|list| list.as_encoded_bytes().split(|b| *b == b':').next().map(<[u8]>::to_vec))
        .and_then(|first| absolute(PathBuf::from(OsString::from_vec(first))));
    if of_unit.is_some() {
        return of_unit;
    }
    let base = of("XDG_CACHE_HOME").or_else(|| of("HOME").map(|home| home.join(".cache")))?;
    Some(base.join("halflight"))
}

/// Holds the folder to so many MiB from now on.
pub fn bound_to(most_mib: u64) {
    MOST_MIB.store(most_mib, Ordering::Relaxed);
}

/// Sweeps the folder and holds it to its size. Called where something may have been added.
pub fn tidy() {
    if let Some(folder) = cache_folder() {
        kept::make_room(&folder, MOST_MIB.load(Ordering::Relaxed).saturating_mul(MIB));
    }
}
