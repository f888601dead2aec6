//! Tells the programs which commit they are built from, where there is git, and packs the addresses that the loader mends
//! (DT_RELR): half a megabyte less of the daemon. Loaders know it since glibc 2.36.

use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=daemon/build.rs");
    if std::env::var("CARGO_CFG_TARGET_ENV").is_ok_and(|env| env == "gnu") {
        println!("cargo:rustc-link-arg-bins=-Wl,-z,pack-relative-relocs");
    }
    println!("cargo:rerun-if-env-changed=HALFLIGHT_COMMIT");
    // While a program is worked on, a commit changes nothing that must be built again.
    let is_release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    if is_release {
        for name in ["HEAD", "logs/HEAD"] {
            // One that is missing would be a reason to build again every time.
            if let Some(path) =
                git(&["rev-parse", "--git-path", name]).filter(|p| std::fs::exists(p).is_ok_and(|is| is))
            {
                println!("cargo:rerun-if-changed={path}");
            }
        }
    }
    let given = std::env::var("HALFLIGHT_COMMIT").ok().filter(|commit| !commit.is_empty());
    // A tree that lies in some other repository is not built from that one.
    let own = || {
        git(&["ls-files", "--error-unmatch", "daemon/build.rs"])
            .and_then(|_| git(&["rev-parse", "--short=12", "HEAD"]))
    };
    let commit = match given.or_else(own) {
        Some(commit) if is_release => format!("commit {commit}"),
        Some(commit) => format!("commit {commit} or later, debug"),
        None => "commit unknown: not built from git".to_owned(),
    };
    println!("cargo:rustc-env=HALFLIGHT_BUILT_FROM={commit}");
}

/// What git says, if it is there and says something.
fn git(arguments: &[&str]) -> Option<String> {
    let said = Command::new("git").args(arguments).output().ok().filter(|said| said.status.success())?;
    let text = String::from_utf8(said.stdout).ok()?.trim().to_owned();
    (!text.is_empty()).then_some(text)
}
