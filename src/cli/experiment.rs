//! `sdr-rx experiment front-end`: the effect of each property of a front end.
//! The program `sdr-rx-lab` makes the papers' figures.

use super::protect::protect;
use sdr_rx::experiment;
use sdr_rx::report::{OutputDir, write_atomically};
use sdr_rx::scenario::Scenario;
use std::path::PathBuf;
use std::process::ExitCode;

/// The files of a sweep.
const FILES: [&str; 2] = ["front_end.csv", "front_end.svg"];

/// Experiments: tables, CSV and plots, with theory beside them (the papers' figures: sdr-rx-lab)
#[derive(clap::Args)]
pub struct Experiment {
    #[command(subcommand)]
    name: Name,
}

#[derive(clap::Subcommand)]
enum Name {
    FrontEnd(FrontEndSweep),
}

/// Bits, bandwidth, IF, oscillator, noise figure, elements, impulses: effect of each on acquisition and fix
///
/// Example: sdr-rx experiment front-end signals/static_8sv.toml --quick
#[derive(clap::Args)]
pub struct FrontEndSweep {
    /// The scenario whose satellites, position and rate are used
    scenario: PathBuf,
    /// Write front_end.csv and front_end.svg into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Two runs for each setting instead of eight
    #[arg(long)]
    quick: bool,
}

/// Runs the experiment.
pub fn run(args: &Experiment) -> anyhow::Result<ExitCode> {
    match &args.name {
        Name::FrontEnd(args) => front_end(args),
    }
}

/// Prints the table, and writes files where asked.
fn front_end(args: &FrontEndSweep) -> anyhow::Result<ExitCode> {
    let scenario = Scenario::read(&args.scenario)?;
    let files = |folder: &PathBuf| FILES.map(|name| folder.join(name));
    for outputs in args.out.iter().map(files) {
        let outputs = outputs.iter().map(PathBuf::as_path);
        // They have no room for a name by which another run's would be told.
        protect(outputs, std::slice::from_ref(&args.scenario), true)?;
    }
    let rows = experiment::sweep(&scenario, if args.quick { 2 } else { 8 })?;
    if let Some(folder) = &args.out {
        OutputDir::create(folder)?;
        let [csv, svg] = files(folder);
        write_atomically(&csv, experiment::csv(&rows).as_bytes())?;
        write_atomically(&svg, experiment::plot(&rows)?.as_bytes())?;
    }
    print!("{}", experiment::table(&rows));
    Ok(ExitCode::SUCCESS)
}
