//! `make test-vm`: the programs of the release build in a guest with real kernel drivers, whose camera and serial device this
//! program is. Run it from the project's top folder; arguments are the beginnings of the names of steps, for some of them alone. Its
//! last line is `N passed, M failed, K skipped`.

mod camera;
mod control;
mod guest;
mod host;
mod results;
mod serial;
mod usbredir;

use camera::{Buffer, Camera, locked};
use control::Control;
use guest::{Door, Given, Guest};
use host::Host;
use results::Results;
use std::fs;
use std::io::{BufRead, BufReader, Result};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// The whole run is given up after this; on a machine under load it takes ten times as long as on a quiet one.
const MOST_TIME: Duration = Duration::from_secs(20 * 60);

fn main() -> ExitCode {
    let is_required = std::env::var_os("REQUIRE_VM").is_some_and(|value| value == "1");
    let mut results = Results::default();
    if let Err(why) = can_run() {
        results.skip("vm", &why);
    } else if let Err(error) = run(&mut results) {
        results.fail("harness", &error.to_string());
    }
    println!("{results}");
    let is_good = results.failed == 0 && (results.skipped == 0 || !is_required);
    if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Whether there are QEMU, the guest, and the release build.
fn can_run() -> std::result::Result<(), String> {
    if Command::new(guest::QEMU).arg("--version").output().is_err() {
        return Err(format!("{} is not installed: apt-get install qemu-system-x86", guest::QEMU));
    }
    for (file, how) in [
        ("target/vm/kernel", "bash tests/vm/make-guest.sh"),
        ("target/release/halflight", "make release"),
        ("target/release/halflightd", "make release"),
    ] {
        if !Path::new(file).is_file() {
            return Err(format!("there is no {file}: {how}"));
        }
    }
    Ok(())
}

fn run(results: &mut Results) -> Result<()> {
    let top = std::env::current_dir()?;
    let vm = top.join("target/vm");
    let share = vm.join("share");
    let scripts = top.join("tests/vm/guest");
    let release = top.join("target/release");
    let agent = std::env::current_exe()?.with_file_name("halflight-vm-agent");
    let programs = [release.join("halflight"), release.join("halflightd"), agent];
    let recordings: Vec<PathBuf> =
        ["desk"].map(|name| top.join(format!("tests/recordings/{name}.mcap"))).into();
    let steps = steps(&scripts)?;
    guest::fill(
        &share,
        &Given { scripts: &scripts, steps: &steps, programs: &programs, recordings: &recordings },
    )?;
    results.expect(steps);

    let (guest, console) = Guest::boot(&vm, &share)?;
    let camera = Arc::new(Mutex::new(Camera::default()));
    follow_buffers(&guest, &camera)?;
    let host = Host { share, tool: release.join("halflight") };
    let mut control = Control::new(Arc::clone(&camera), &guest, host);
    let questions = guest.connect(Door::Control)?;
    std::thread::spawn(move || {
        // The end of the guest ends it.
        let _ = control.serve(questions);
    });
    give_up_after(MOST_TIME, guest.process());
    for line in guest::lines(console) {
        println!("{line}");
        results.note(&line);
    }
    results.finish();
    fs::write(vm.join("camera.log"), log(&locked(&camera)))?;
    println!("Processor time of the guest: {}", results::processor_time(guest.process()));
    Ok(())
}

/// Names of the steps, in the order in which the guest runs them.
fn steps(scripts: &Path) -> Result<Vec<String>> {
    let chosen: Vec<String> = std::env::args().skip(1).collect();
    let entries = fs::read_dir(scripts.join("steps"))?.flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().trim_end_matches(".sh").to_owned());
    let mut steps: Vec<String> = names
        .filter(|name| chosen.is_empty() || chosen.iter().any(|begin| name.starts_with(begin.as_str())))
        .collect();
    steps.sort();
    Ok(steps)
}

/// Tells the camera what the guest's programs do with their buffers.
fn follow_buffers(guest: &Guest, camera: &Arc<Mutex<Camera>>) -> Result<()> {
    let stream = guest.connect(Door::Pacing)?;
    let camera = Arc::clone(camera);
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(std::result::Result::ok) {
            if let Some(buffer) = Buffer::of_line(&line) {
                locked(&camera).buffer(buffer);
            }
        }
    });
    Ok(())
}

/// Ends a guest that hangs; its steps that said nothing have failed then.
fn give_up_after(time: Duration, process: u32) {
    std::thread::spawn(move || {
        std::thread::sleep(time);
        eprintln!("The guest is given up after {} minutes", time.as_secs() / 60);
        // It may have ended this moment.
        let _ = Command::new("kill").arg(process.to_string()).status();
    });
}

/// What the camera did, for whoever looks into a failure.
fn log(camera: &Camera) -> String {
    let writes =
        camera.writes().iter().map(|(frames, name, value)| format!("{frames} write {name} {value}\n"));
    let made = camera.made().iter().map(|made| {
        let (settings, fate) = (made.settings, made.fate);
        format!(
            "{} frame exposure {} gain {} {fate:?} {:016x}\n",
            made.number, settings.exposure, settings.gain, made.digest
        )
    });
    let mut lines: Vec<String> = writes.chain(made).collect();
    // What was written before a frame stands before it.
    lines.sort_by_key(|line| {
        line.split(' ').next().and_then(|n| n.parse::<u64>().ok()).map(|n| (n, line.contains(" frame ")))
    });
    lines.concat()
}
