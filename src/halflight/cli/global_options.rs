//! Options that verbs share, and what they mean.

use super::CliError;
use crate::config::{
    self, Settings,
    keys::KEYS,
    settings::{BackendKind, EngineKind},
};
use crate::daemon::{engines, log::Loudness};
use crate::engine::{Engine, Timings};
use std::path::Path;
use toml::Value;

/// Options that verbs share. `super::help` says which verbs have which.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Shared options")]
pub struct GlobalOptions {
    /// Which engine computes: the CPU twins (default), or the GPU.
    #[arg(long, global = true, value_enum, display_order = 901)]
    pub engine: Option<EngineChoice>,
    /// Which GPU interface (default: Vulkan, else GL).
    #[arg(long, global = true, value_enum, display_order = 902)]
    pub backend: Option<BackendChoice>,
    /// Run this kernel on its CPU twin although the engine is the GPU, e.g. light/project_sh (repeatable).
    #[arg(long, global = true, value_name = "KERNEL", display_order = 903)]
    pub cpu: Vec<String>,
    /// Threads of the CPU engine: 0 to 256, 0 = one for each core [default: 0].
    #[arg(long, global = true, value_name = "N", display_order = 904)]
    pub threads: Option<i64>,
    /// One setting over a settings file, such as quality.rung=hybrid; flags of its own win (repeatable).
    /// `halflight check --manual` lists all.
    #[arg(long, global = true, value_name = "KEY=VALUE", display_order = 905)]
    pub set: Vec<String>,
    /// Print machine-readable JSON on standard output (docs/json).
    #[arg(long, global = true, display_order = 906)]
    pub json: bool,
    /// Print the SHA-256 of all output pixels.
    #[arg(long, global = true, display_order = 907)]
    pub digest: bool,
    /// How much is told.
    #[command(flatten)]
    pub loudness: Loudness,
}

/// Which engine computes.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineChoice {
    /// The CPU twins in order.
    Cpu,
    /// wgpu.
    Gpu,
}

/// Which GPU interface.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum BackendChoice {
    /// The first choice where there is a driver.
    Vulkan,
    /// OpenGL (ES) 3.1 or later.
    Gl,
}

impl GlobalOptions {
    /// The defaults, a settings file over them where one is named, and what was given on the command line over both.
    ///
    /// # Errors
    /// The file cannot be read or is not sound; a value is out of its key's range.
    pub fn settings(&self, file: Option<&Path>) -> Result<Settings, CliError> {
        let mut settings = match file {
            Some(path) => Self::settings_from(path)?,
            None => Settings::default(),
        };
        for line in &self.set {
            settings = config::over(line, &settings).map_err(CliError)?;
        }
        self.apply(&mut settings)?;
        config::rig::over_settings(settings).map_err(CliError)
    }

    fn settings_from(path: &Path) -> Result<Settings, CliError> {
        let name = path.display().to_string();
        let typed = config::file::read(path).map_err(|text| CliError::in_file(&name, text))?;
        config::resolve(&name, &typed, &Settings::default())
            .map_err(|mistakes| CliError::in_file(&name, mistakes.to_string()))
    }

    fn apply(&self, settings: &mut Settings) -> Result<(), CliError> {
        match self.engine {
            Some(EngineChoice::Cpu) => settings.engine = EngineKind::Cpu,
            Some(EngineChoice::Gpu) => settings.engine = EngineKind::Gpu,
            None => {}
        }
        match self.backend {
            Some(BackendChoice::Vulkan) => settings.backend = BackendKind::Vulkan,
            Some(BackendChoice::Gl) => settings.backend = BackendKind::Gl,
            None => {}
        }
        if let Some(threads) = self.threads {
            put("--threads", "engine.threads", &Value::Integer(threads), settings)?;
        }
        settings.cpu_kernels.extend(self.cpu.iter().cloned());
        Ok(())
    }

    /// Threads that computing may take; `None`: one for each core.
    ///
    /// # Errors
    /// More than the key allows.
    pub fn threads(&self) -> Result<Option<usize>, CliError> {
        let threads = self.settings(None)?.threads;
        Ok((threads > 0).then_some(threads))
    }

    /// The engine that the command line asks for (the CPU where it does not say).
    ///
    /// # Errors
    /// There is no such engine here; a kernel that does not exist.
    pub fn open_engine(&self) -> Result<Box<dyn Engine>, CliError> {
        let settings = self.settings(None)?;
        let (engine, backend, kernels) = (settings.engine, settings.backend, &settings.cpu_kernels);
        Ok(engines::open(engine, backend, settings.threads, kernels, Timings::Fenced)?)
    }
}

/// Puts a flag's value into the key that it stands for, where the key admits it.
///
/// # Errors
/// It does not: the flag, its value and what is allowed.
pub fn put(flag: &str, name: &str, value: &Value, settings: &mut Settings) -> Result<(), CliError> {
    let Some(key) = KEYS.iter().find(|key| key.name == name) else { return Ok(()) };
    if !key.range.admits(value) {
        let shown = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let unit = if key.unit.is_empty() { String::new() } else { format!(" {}", key.unit) };
        return Err(CliError(format!("{flag} = {shown}: must be {}{unit}", key.range.describe())));
    }
    (key.write)(settings, value);
    Ok(())
}
