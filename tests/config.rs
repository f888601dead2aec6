//! The settings manual is true, and no settings file makes the program panic.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::config::{Settings, file, keys, manual, resolve};
use proptest::prelude::*;

#[test]
fn default_toml_is_the_manual() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/config/default.toml");
    let manual = manual::manual();
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(path, &manual).unwrap();
    }
    let on_disk = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        on_disk == manual,
        "config/default.toml differs from the key table; bless with: UPDATE_EXPECT=1 cargo test --test config"
    );
}

#[test]
fn the_page_of_scene_files_is_their_manual() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/scenes.md");
    let manual = halflight::assets::scene::keys::manual();
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(path, &manual).unwrap();
    }
    let on_disk = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        on_disk == manual,
        "docs/scenes.md differs from the key table; bless with: UPDATE_EXPECT=1 cargo test --test config"
    );
}

#[test]
fn the_example_of_a_rig_is_its_manual() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/config/rig-example.toml");
    let manual = halflight::assets::rig::manual();
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(path, &manual).unwrap();
    }
    let on_disk = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        on_disk == manual,
        "config/rig-example.toml differs from the key table; bless with: UPDATE_EXPECT=1 cargo test --test config"
    );
    // The other reader of the file takes it, too.
    let imu = halflight::device::imu::description::ImuDescription::from_toml(&manual).unwrap().unwrap();
    assert_eq!((imu.name.as_deref(), imu.rate_hz), (Some("iio:name=gyro_3d"), Some(100.0)));
    // What the settings leave open the rig fills in; what they say stays.
    let named = |camera: &str| Settings { rig: path.into(), camera: camera.into(), ..Settings::default() };
    let over = |settings| halflight::config::rig::over_settings(settings).unwrap();
    let filled = over(named("auto"));
    assert_eq!((filled.camera.as_str(), filled.imu.as_str()), ("v4l2:card=HD Webcam", "iio:name=gyro_3d"));
    assert!(
        filled.response.ends_with("config/response.json") && filled.calibration.ends_with("config/lens.yml")
    );
    assert_eq!(filled.imu_file, path);
    assert_eq!(over(named("synthetic:")).camera, "synthetic:");
    let missing = Settings { rig: "no/such.toml".into(), ..Settings::default() };
    assert!(halflight::config::rig::over_settings(missing).unwrap_err().contains("no/such.toml"));
}

#[test]
fn kernel_names_are_the_plan_s() {
    let words = keys::KEYS.iter().find(|k| k.name == "engine.cpu_kernels").unwrap();
    let names: Vec<&str> = halflight::plan::Pass::ALL.iter().map(|p| p.name()).collect();
    assert_eq!(words.range, keys::Range::Words(Box::leak(names.into_boxed_slice())));
}

proptest! {
    #[test]
    fn any_text_gives_settings_or_errors(text in "\\PC{0,200}") {
        if let Ok(table) = file::parse(&text) {
            let _ = resolve("any.toml", &table, &Settings::default());
        }
    }

    #[test]
    fn any_value_of_a_known_key_is_judged(index in 0..keys::KEYS.len(), number in any::<f64>(), whole in any::<i64>(), word in "[a-z]{0,8}") {
        let (section, name) = keys::KEYS[index].name.split_once('.').unwrap();
        for value in [toml::Value::Float(number), toml::Value::Integer(whole), toml::Value::String(word), toml::Value::Array(vec![])] {
            let mut inner = toml::Table::new();
            inner.insert(name.into(), value.clone());
            let mut table = toml::Table::new();
            table.insert(section.into(), toml::Value::Table(inner));
            match resolve("any.toml", &(&table).into(), &Settings::default()) {
                Ok(settings) => prop_assert!(keys::KEYS[index].range.admits(&(keys::KEYS[index].read)(&settings))),
                Err(errors) => prop_assert!(errors.to_string().contains(keys::KEYS[index].name)),
            }
        }
    }
}
