//! `sdr-rx experiment front-end`: what each property of a front end does.

use sdr_rx::experiment::front_end;
use sdr_rx::report::{OutputDir, write_atomically};
use sdr_rx::scenario::Scenario;
use std::path::PathBuf;
use std::process::ExitCode;

/// Bits, bandwidth, IF, oscillator, noise figure, elements, impulses: what each does to acquisition and fix
///
/// Example: sdr-rx experiment front-end signals/static_8sv.toml --quick
#[derive(clap::Args)]
pub struct FrontEnd {
    /// The scenario whose sky, place and rate are used
    scenario: PathBuf,
    /// Write front_end.csv and front_end.svg into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Two runs for each setting instead of eight
    #[arg(long)]
    quick: bool,
}

/// Prints the table, and writes files where asked.
pub fn run(args: &FrontEnd) -> anyhow::Result<ExitCode> {
    let scenario = Scenario::read(&args.scenario)?;
    let rows = front_end::sweep(&scenario, if args.quick { 2 } else { 8 })?;
    if let Some(folder) = &args.out {
        OutputDir::create(folder)?;
        write_atomically(&folder.join("front_end.csv"), front_end::csv(&rows).as_bytes())?;
        write_atomically(&folder.join("front_end.svg"), front_end::plot(&rows)?.as_bytes())?;
    }
    print!("{}", front_end::table(&rows));
    Ok(ExitCode::SUCCESS)
}
