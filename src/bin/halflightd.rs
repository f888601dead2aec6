//! `halflightd`, the daemon.

fn main() {}
