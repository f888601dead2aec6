//! Packs the addresses that the loader mends (DT_RELR): half a megabyte less of the program. Loaders know it since glibc 2.36.

fn main() {
    println!("cargo:rerun-if-changed=src/halflight/build.rs");
    if std::env::var("CARGO_CFG_TARGET_ENV").is_ok_and(|env| env == "gnu") {
        println!("cargo:rustc-link-arg-bins=-Wl,-z,pack-relative-relocs");
    }
}
