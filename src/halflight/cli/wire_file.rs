//! The wire log of `halflight record --wire-log`: whole or not at all, and a sensor without a camera.

use super::output::shown;
use super::record::{RecordArguments, stop_of_signals};
use super::run_folder::{need_folder_of, refuse_existing};
use super::{CliError, GlobalOptions};
use crate::assets::whole::WholeFile;
use crate::daemon::{exit, prepare::open_named_imu};
use crate::device::clock::MonotonicClock;
use crate::device::imu::{alone, names::ImuName, wire_log::WireLogWriter};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The file, shared with the sensor that writes it.
#[derive(Clone)]
pub struct WireFile {
    path: PathBuf,
    state: Arc<Mutex<WireState>>,
}

struct WireState {
    file: Option<WholeFile>,
    bytes: u64,
    failure: Option<io::Error>,
}

impl WireFile {
    /// Begins a log of the sensor with this name.
    ///
    /// # Errors
    /// The sensor has no wire, or the file is there already or cannot be made.
    pub fn create(path: &Path, sensor: &str, force: bool) -> Result<Self, CliError> {
        let has_wire = |name: &ImuName| name.scheme != "iio";
        if !ImuName::parse(sensor)?.as_ref().is_some_and(has_wire) {
            let why = format!(
                "\"{sensor}\" has no wire: name a sensor with --imu serial:.. or --imu hid:.. (halflight devices)"
            );
            return Err(CliError::on(format!("--wire-log {}", path.display()), why));
        }
        need_folder_of(path)?;
        refuse_existing(path, force)?;
        let file = WholeFile::create(path)
            .map_err(|e| CliError::on(path.display(), format!("cannot be written: {e}")))?;
        let state = WireState { file: Some(file), bytes: 0, failure: None };
        Ok(Self { path: path.to_owned(), state: Arc::new(Mutex::new(state)) })
    }

    /// What the sensor writes to.
    ///
    /// # Errors
    /// The first line cannot be written.
    pub fn writer(&self, sensor: &str) -> Result<WireLogWriter, CliError> {
        let out = Box::new(self.clone());
        WireLogWriter::new(out, sensor)
            .map_err(|e| CliError::on(self.path.display(), format!("cannot be written: {e}")))
    }

    /// Puts the log in its place; returns its bytes.
    ///
    /// # Errors
    /// A part of it could not be written.
    pub fn finish(&self) -> Result<u64, CliError> {
        let mut state = self.state();
        let failed = |e: io::Error| CliError::on(self.path.display(), format!("cannot be written: {e}"));
        if let Some(failure) = state.failure.take() {
            return Err(failed(failure));
        }
        if let Some(file) = state.file.take() {
            file.commit().map_err(failed)?;
        }
        Ok(state.bytes)
    }

    fn state(&self) -> MutexGuard<'_, WireState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for WireFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.state();
        let Some(file) = &mut state.file else { return Err(io::Error::other("the log is closed")) };
        match file.write(bytes) {
            Ok(count) => {
                state.bytes += count as u64;
                Ok(count)
            }
            Err(error) => {
                state.failure = Some(io::Error::new(error.kind(), error.to_string()));
                Err(error)
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.state().file.as_mut().map_or(Ok(()), Write::flush)
    }
}

/// Logs a sensor without a camera.
///
/// # Errors
/// No sensor is named, it gives nothing, or the log cannot be written.
pub fn record_alone(a: &RecordArguments, log: &Path, global: &GlobalOptions) -> Result<(), CliError> {
    let stop = stop_of_signals()?;
    let mut settings = global.settings(None)?;
    if let Some(name) = &a.imu {
        settings.imu.clone_from(name);
    }
    let file = WireFile::create(log, &settings.imu, a.force)?;
    let clock = Arc::new(MonotonicClock::new());
    let mut imu = open_named_imu(&settings, clock.clone(), Some(file.writer(&settings.imu)?))?;
    let seen = alone::run(imu.as_mut(), clock.as_ref(), &stop, a.seconds)?;
    drop(imu);
    let bytes = file.finish()?;
    if global.json {
        let report = serde_json::json!({
            "format": super::JSON_FORMAT, "file": null, "bytes": 0, "frames": 0, "imu_samples": seen.samples,
            "chunks": 0, "width_px": 0, "height_px": 0, "exposures_s": [], "span_s": seen.span_s, "coding": null,
            "to_light_world": null, "digest": null, "wire_log": shown(log), "wire_log_bytes": bytes,
        });
        println!("{report}");
    } else {
        println!(
            "{}: {:.1} kB, {} inertial samples over {:.2} s",
            log.display(),
            bytes as f64 * 1e-3,
            seen.samples,
            seen.span_s
        );
    }
    if seen.samples == 0 {
        let why = format!("{} gave no sample: another protocol, or another baud rate?", settings.imu);
        return Err(CliError(why).with_status(exit::DEVICE));
    }
    Ok(())
}
