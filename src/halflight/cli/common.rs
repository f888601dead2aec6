//! What every verb shares: options, errors, the digest.

use crate::config::{
    self, Settings,
    settings::{BackendKind, EngineKind},
};
use crate::daemon::engines;
use crate::engine::{Engine, Timings};
use sha2::{Digest, Sha256};

/// Options of every verb.
#[derive(clap::Args, Clone, Debug)]
pub struct Common {
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
    /// Vulkan.
    Vulkan,
    /// OpenGL (ES) 3.1 or later.
    Gl,
}

/// An error for people: what was tried, on what, with which value, and what is allowed. Exit status 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct CliError(pub String);

impl CliError {
    /// Joins what was tried and why it failed.
    pub fn on(what: impl std::fmt::Display, why: impl std::fmt::Display) -> Self {
        Self(format!("{what}: {why}"))
    }
}

/// SHA-256 over output pixels, in the order in which they are added.
#[derive(Default)]
pub struct PixelDigest(Sha256);

impl PixelDigest {
    /// Adds 8-bit pixels.
    pub fn add_bytes(&mut self, pixels: &[[u8; 3]]) {
        self.0.update(bytemuck::cast_slice(pixels));
    }

    /// Adds linear pixels (little-endian f32; the two zeros count as one).
    pub fn add_floats(&mut self, pixels: &[[f32; 3]]) {
        for c in pixels.iter().flatten() {
            self.0.update((c + 0.0).to_le_bytes());
        }
    }

    /// The digest so far, in hexadecimal.
    pub fn hex(self) -> String {
        self.0.finalize().iter().map(|b| format!("{b:02x}")).collect()
    }
}

impl Common {
    /// A settings file over the defaults.
    pub fn settings_from(&self, path: &std::path::Path) -> Result<Settings, CliError> {
        let typed = config::file::read(path).map_err(CliError)?;
        config::resolve(&path.display().to_string(), &typed, &Settings::default())
            .map_err(|e| CliError(e.to_string()))
    }

    /// What was given on the command line, over `settings`.
    pub fn apply(&self, settings: &mut Settings) {
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
    pub fn open_engine(&self) -> Result<Box<dyn Engine>, CliError> {
        let mut settings = Settings::default();
        self.apply(&mut settings);
        engines::open(
            settings.engine,
            settings.backend,
            settings.threads,
            &settings.cpu_kernels,
            Timings::Fenced,
        )
        .map_err(|e| CliError(e.to_string()))
    }
}
