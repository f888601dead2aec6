//! `halflight stress`: the hard cases, by the textbook and by this program, on the engines at hand.

use super::output::write_file;
use super::progress::Bar;
use super::{CliError, GlobalOptions, global_options::EngineChoice, run_folder::need_folder_of};
use crate::daemon::{engines::gpu, exit};
use crate::engine::{cpu::CpuEngine, gpu::Backend};
use crate::lab::stress_report::{NamedEngine, StressReport, html, json, markdown, terminal};
use crate::stress::{GROUPS, HardCase};
use std::path::PathBuf;
use std::process::ExitCode;

/// The long form of the verb's help.
pub const LONG_ABOUT: &str = "\
Run the hard cases: no light, opposite suns, spheres that touch, lamps in the receiver's plane, false times, \
and others. Of each case the table shows what the textbook's formula gives in f32, what this program gives, \
and the bound that must hold. The exit status is 1 where this program breaks a bound.\n\n\
Examples:\n\
halflight stress\n\
halflight stress --engine gpu --backend gl\n\
halflight stress --all --html stress.html";

/// Arguments of `halflight stress`.
#[derive(clap::Args, Debug)]
pub struct StressArguments {
    /// Every engine at hand side by side: CPU, Vulkan, GL.
    #[arg(long, conflicts_with_all = ["engine", "backend"])]
    all: bool,
    /// Only cases with this in their name or group.
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Write the table as a page for a browser.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Write the table as a page for the repository.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

/// Runs `halflight stress`.
///
/// # Errors
/// A mistake in the arguments; an engine that is not there; a file that cannot be written.
pub fn run(arguments: StressArguments, global: &GlobalOptions) -> Result<ExitCode, CliError> {
    for file in [&arguments.html, &arguments.markdown].into_iter().flatten() {
        need_folder_of(file)?;
    }
    let engines = engines(arguments.all, global)?;
    let is_wanted = |group: &str, case: &HardCase| {
        arguments.only.as_ref().is_none_or(|text| group.contains(text) || case.name.contains(text))
    };
    let wanted =
        GROUPS.iter().flat_map(|group| group.cases.iter().filter(|case| is_wanted(group.title, case)));
    let bar = Bar::of_count(Some(wanted.count() as u64), "hard cases");
    let report = StressReport::of(engines, &is_wanted, &|| bar.add_one());
    drop(bar);
    if report.rows.is_empty() {
        let text = arguments.only.unwrap_or_default();
        let titles = GROUPS.map(|group| group.title).join(", ");
        let why = format!("no such case; the groups are {titles}");
        return Err(CliError::on(format!("--only {text:?}"), why));
    }
    if let Some(file) = &arguments.html {
        write_file(file, html(&report))?;
    }
    if let Some(file) = &arguments.markdown {
        write_file(file, markdown(&report))?;
    }
    if global.json {
        let mut all = json(&report);
        all["format"] = super::JSON_FORMAT.into();
        println!("{all}");
    } else {
        print!("{}", terminal(&report));
    }
    Ok(if report.broken() == 0 { ExitCode::SUCCESS } else { ExitCode::from(exit::FAILED) })
}

fn engines(all: bool, global: &GlobalOptions) -> Result<Vec<NamedEngine>, CliError> {
    if !all {
        let name = if global.engine == Some(EngineChoice::Gpu) { "GPU" } else { "CPU" };
        return Ok(vec![(name, global.open_engine()?)]);
    }
    let mut engines: Vec<NamedEngine> = vec![("CPU", Box::new(CpuEngine::new(global.threads()?)?))];
    for backend in Backend::ALL {
        match gpu(Some(backend)) {
            Ok(engine) => engines.push((backend.name(), Box::new(engine))),
            Err(error) => eprintln!("warning: {} is left out: {error}", backend.name()),
        }
    }
    Ok(engines)
}
