//! Options of every verb, and what they mean.

use super::CliError;
use crate::config::{
    self, Settings,
    settings::{BackendKind, EngineKind},
};
use crate::daemon::engines;
use crate::engine::{Engine, Timings};
use std::path::Path;

/// Options of every verb.
#[derive(clap::Args, Clone, Debug)]
pub struct GlobalOptions {
    /// Which engine computes: the CPU twins (default), or the GPU.
    #[arg(long, global = true, value_enum)]
    pub engine: Option<EngineChoice>,
    /// Which GPU interface (default: Vulkan, else GL).
    #[arg(long, global = true, value_enum)]
    pub backend: Option<BackendChoice>,
    /// Run this kernel on its CPU twin although the engine is the GPU, e.g. light/project_sh (repeatable).
    #[arg(long, global = true, value_name = "KERNEL")]
    pub cpu: Vec<String>,
    /// Print machine-readable JSON on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// Print the SHA-256 of all output pixels.
    #[arg(long, global = true)]
    pub digest: bool,
    /// Threads of the CPU engine (default: one for each core).
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<usize>,
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
    /// The file cannot be read or is not sound.
    pub fn settings(&self, file: Option<&Path>) -> Result<Settings, CliError> {
        let mut settings = match file {
            Some(path) => Self::settings_from(path)?,
            None => Settings::default(),
        };
        self.apply(&mut settings);
        Ok(settings)
    }

    fn settings_from(path: &Path) -> Result<Settings, CliError> {
        let typed = config::file::read(path).map_err(CliError)?;
        Ok(config::resolve(&path.display().to_string(), &typed, &Settings::default())?)
    }

    fn apply(&self, settings: &mut Settings) {
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
            settings.threads = threads;
        }
        settings.cpu_kernels.extend(self.cpu.iter().cloned());
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
