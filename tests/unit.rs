//! The systemd unit: how much of the system it can reach, as systemd itself judges it.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

mod support;

use std::process::Command;

fn unit() -> String {
    std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/systemd/halflightd.service")).unwrap()
}

#[test]
fn the_unit_exposes_little() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/systemd/halflightd.service");
    let Ok(said) = Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--no-pager", "--threshold=15", path])
        .output()
    else {
        return support::skipped("the unit's exposure: systemd-analyze is not installed");
    };
    let text = String::from_utf8_lossy(&said.stdout);
    let Some(level) = text.lines().find(|line| line.contains("Overall exposure level")) else {
        let why = String::from_utf8_lossy(&said.stderr);
        return support::skipped(&format!("the unit's exposure: systemd-analyze cannot look offline: {why}"));
    };
    let number: f64 =
        level.split(": ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap().parse().unwrap();
    println!("exposure {number}");
    assert!(number <= 1.5, "{text}");
}

#[test]
fn the_unit_says_what_the_daemon_keeps() {
    let unit = unit();
    for line in [
        "CapabilityBoundingSet=",
        "SystemCallFilter=@system-service",
        "ProtectProc=invisible",
        "UMask=0077",
        "CacheDirectory=halflight",
        "SupplementaryGroups=video render dialout plugdev",
        "DeviceAllow=char-hidraw rw",
        "DeviceAllow=char-iio rw",
        "RestartPreventExitStatus=2",
        "ExecReload=/bin/kill -HUP $MAINPID",
    ] {
        assert!(unit.lines().any(|l| l == line), "{line} is missing");
    }
    assert!(unit.contains("\nDeviceAllow=") && unit.contains("\nMemoryMax="));
}

#[test]
fn every_headset_that_is_built_in_has_a_rule() {
    let rules =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/systemd/70-halflight.rules")).unwrap();
    for (vendor, product) in halflight::device::imu::hid::known_ids() {
        let ids = format!("ATTRS{{idVendor}}==\"{vendor:04x}\", ATTRS{{idProduct}}==\"{product:04x}\"");
        let rule = rules.lines().find(|line| line.starts_with("KERNEL==\"hidraw*\"") && line.contains(&ids));
        assert!(rule.is_some_and(|rule| rule.contains("GROUP=\"plugdev\"")), "{vendor:04x}:{product:04x}");
    }
    assert!(rules.lines().any(|line| line.starts_with("SUBSYSTEM==\"iio\"")));
}
