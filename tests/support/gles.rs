//! A test once more in a process of its own, where Mesa offers OpenGL ES of a version.
#![allow(dead_code)]

/// Set in such a process: the version of OpenGL ES that it is to have.
pub const CHILD: &str = "HALFLIGHT_TEST_GLES";

/// Runs a test of this program; Mesa reads the variables when its driver is loaded. What it printed. Panics where the
/// test fails.
pub fn child(test: &str, gles_version: &str) -> String {
    let program = std::env::current_exe().expect("the test's own program");
    let output = std::process::Command::new(program)
        .args([test, "--exact", "--nocapture"])
        .env("MESA_GL_VERSION_OVERRIDE", "3.0")
        .env("MESA_GLES_VERSION_OVERRIDE", gles_version)
        .env(CHILD, gles_version)
        .output()
        .expect("the child runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    print!("{text}");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    text
}

/// That a child had OpenGL ES 3.1; other drivers know nothing of the variables and are tested as they are.
pub fn assert_gles_3_1(text: &str) {
    assert!(text.contains("SKIPPED") || !text.contains("Mesa") || text.contains("OpenGL ES 3.1"), "{text}");
}
