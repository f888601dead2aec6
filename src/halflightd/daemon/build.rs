//! Tells the programs which commit they are built from, where there is git, and packs the addresses that the loader mends
//! (DT_RELR): half a megabyte less of the daemon. Loaders know it since glibc 2.36. Functions of the same instructions are kept
//! once where the linker can do that: half a megabyte again.

use std::process::{Command, Stdio};

/// Functions of the same instructions become one (lld, gold and mold; GNU ld does not know it): the program tells no two functions
/// apart by their address.
const FOLDED: &str = "-Wl,--icf=all";

fn main() {
    println!("cargo:rerun-if-changed=daemon/build.rs");
    if std::env::var("CARGO_CFG_TARGET_ENV").is_ok_and(|env| env == "gnu") {
        println!("cargo:rustc-link-arg-bins=-Wl,-z,pack-relative-relocs");
    }
    println!("cargo:rerun-if-env-changed=HALFLIGHT_COMMIT");
    let is_release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    if is_release && links_with(FOLDED) {
        println!("cargo:rustc-link-arg-bins={FOLDED}");
    }
    // While a program is worked on, a commit changes nothing that must be built again.
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

/// Returns whether an empty program links with an argument, as the daemon will be linked.
fn links_with(argument: &str) -> bool {
    let var = |name: &str| std::env::var(name).unwrap_or_default();
    let (source, program) = (format!("{}/empty.rs", var("OUT_DIR")), format!("{}/empty", var("OUT_DIR")));
    if std::fs::write(&source, "fn main() {}").is_err() {
        return false;
    }
    let mut rustc = Command::new(var("RUSTC"));
    rustc.args([&source, "-o", &program, "--target", &var("TARGET"), "-C", &format!("link-arg={argument}")]);
    let linker = var("RUSTC_LINKER");
    if !linker.is_empty() {
        rustc.args(["-C", &format!("linker={linker}")]);
    }
    rustc.args(var("CARGO_ENCODED_RUSTFLAGS").split('\u{1f}').filter(|flag| !flag.is_empty()));
    // What cannot be tried is left out.
    rustc.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// What git says, if it is there and says something.
fn git(arguments: &[&str]) -> Option<String> {
    let said = Command::new("git").args(arguments).output().ok().filter(|said| said.status.success())?;
    let text = String::from_utf8(said.stdout).ok()?.trim().to_owned();
    (!text.is_empty()).then_some(text)
}
