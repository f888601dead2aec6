//! Nothing virtual: the camera's picture to the last bit. What was decided is told: by the overlay, and by `halflight explain`.
#![allow(clippy::unwrap_used, reason = "a test's functions fail as the test does")]

use halflight::{
    config::Settings,
    daemon::{host::Host, prepare::prepare},
    model::{quality::Effects, time::Timestamp},
    plan::{Effect, EffectVerdict, LARGEST_ERROR, Pass},
};

/// A camera with one exposure and nothing virtual before it.
fn bare(effects: Effects) -> Settings {
    let mut settings = Settings {
        camera: "synthetic:frames=6,size=160x120,texel_mm=8".into(),
        exposures_s: vec![1.0 / 500.0],
        threads: 1,
        ..Default::default()
    };
    settings.quality.effects = effects;
    settings
}

#[test]
fn nothing_virtual_shows_the_camera_s_picture_to_the_last_bit() {
    for alone in [true, false] {
        let mut called_for = prepare(&bare(Effects::CalledFor), &Host::default()).unwrap();
        if alone {
            called_for.pipeline = called_for.pipeline.for_pictures_alone();
        }
        let mut all = prepare(&bare(Effects::All), &Host::default()).unwrap();
        for _ in 0..6 {
            let frame = called_for.source.next(Timestamp(i64::MAX)).unwrap();
            let outcome = called_for.pipeline.frame(&frame).unwrap();
            assert!(called_for.pipeline.plan().passes_through);
            assert!(called_for.pipeline.picture().display == *frame.pixels);
            let why = called_for.pipeline.plan().decision(Effect::Composition).unwrap();
            assert_eq!((why.verdict, why.error_bound), (EffectVerdict::Off, 0.0));
            // Nobody asks for the light: it is not even looked for.
            assert!(!alone || (outcome.light.is_none() && outcome.pose.is_none()));
            all.pipeline.frame(&frame).unwrap();
            assert!(!all.pipeline.plan().passes_through);
            // There and back through linear light is the same picture.
            assert!(all.pipeline.picture().display == *frame.pixels);
        }
    }
}

#[test]
fn pictures_of_several_exposures_are_still_merged() {
    let settings = Settings { exposures_s: vec![0.002, 0.008], ..bare(Effects::CalledFor) };
    let mut prepared = prepare(&settings, &Host::default()).unwrap();
    prepared.pipeline = prepared.pipeline.for_pictures_alone();
    for _ in 0..4 {
        let frame = prepared.source.next(Timestamp(i64::MAX)).unwrap();
        prepared.pipeline.frame(&frame).unwrap();
    }
    assert!(!prepared.pipeline.plan().passes_through);
    assert!(
        prepared.pipeline.plan().has(Pass::MergeBracket) && prepared.pipeline.plan().has(Pass::Composite)
    );
}

#[test]
fn the_overlay_is_laid_over_the_picture_and_takes_lines() {
    let mut settings = bare(Effects::CalledFor);
    settings.hud = true;
    let mut prepared = prepare(&settings, &Host::default()).unwrap();
    let frame = prepared.source.next(Timestamp(i64::MAX)).unwrap();
    prepared.pipeline.note(format_args!("LINE {}", 1));
    prepared.pipeline.frame(&frame).unwrap();
    let first = prepared.pipeline.picture().display.clone();
    assert!(first != *frame.pixels);
    prepared.pipeline.frame(&frame).unwrap();
    let second = &prepared.pipeline.picture().display;
    // Without the line that was handed in, the table begins higher up.
    assert!(first != *second);
    let changed = first.pixels().iter().zip(frame.pixels.pixels()).filter(|(a, b)| a != b).count();
    assert!(changed > 2000, "{changed}");
}

#[test]
fn explain_prints_every_decision() {
    let run = |arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"));
        let output = command.arg("explain").args(arguments).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.success(), text(&output.stdout), text(&output.stderr))
    };
    let camera = "synthetic:frames=4,size=320x240,texel_mm=8";
    let desk = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/desk.toml");
    let (is_sound, table, _) = run(&[camera, "--scene", desk, "--frame", "3"]);
    assert!(is_sound && table.contains("frame 3: drawn with virtual objects"), "{table}");
    assert!(Effect::ALL.iter().all(|effect| table.contains(effect.name())), "{table}");
    let (is_sound, json, _) = run(&[camera, "--scene", desk, "--frame", "3", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let decisions = report["decisions"].as_array().unwrap();
    assert!(is_sound && decisions.len() == Effect::ALL.len());
    for decision in decisions {
        assert!(["on", "kept", "off"].contains(&decision["verdict"].as_str().unwrap()), "{decision}");
        assert!(
            decision["saving"].as_f64().unwrap() >= 0.0 && decision["reason"].as_str().unwrap().len() > 3
        );
        let bound = &decision["error_bound"];
        assert!(
            decision["verdict"] == "on" || bound.as_f64().unwrap() <= f64::from(LARGEST_ERROR),
            "{decision}"
        );
    }
    let of = |effect: &str| decisions.iter().find(|d| d["effect"] == effect).unwrap();
    assert_eq!((&of("near maps")["verdict"], &of("objects")["verdict"]), (&"off".into(), &"on".into()));
    let (is_sound, _, error) = run(&[camera, "--frame", "9"]);
    assert!(!is_sound && error.contains("--frame = 9") && error.contains("0 to 3"), "{error}");
    let (is_sound, _, error) = run(&[desk, "--frame", "2"]);
    assert!(!is_sound && error.contains("belong to recordings"), "{error}");
}
