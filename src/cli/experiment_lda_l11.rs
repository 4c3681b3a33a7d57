//! `sdr-rx experiment lda-l11`: the figures of the paper on JANE.

use indicatif::{ProgressBar, ProgressStyle};
use sdr_rx::experiment::claim::{claim_csv, claim_table};
use sdr_rx::experiment::lda_l11::{Effort, run as run_experiment};
use sdr_rx::report::{OutputDir, write_atomically};
use std::io::{IsTerminal, stderr};
use std::path::PathBuf;
use std::process::ExitCode;

/// Figures 2 to 5 of the paper on JANE (IEEE TVT 72(5), 2023), with a verdict for each claim
///
/// Example: sdr-rx experiment lda-l11 --quick --out lda-l11
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct LdaL11 {
    /// Write each figure as CSV and SVG, and the verdicts as CSV, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// One scene of 16 snapshots in the sweeps instead of four of 64
    #[arg(long)]
    quick: bool,
}

/// Prints the verdicts, and writes files where asked.
pub fn run(args: &LdaL11) -> anyhow::Result<ExitCode> {
    let bar = if stderr().is_terminal() {
        ProgressBar::new(1000)
            .with_style(ProgressStyle::with_template("{bar:40} {percent} %, {eta} left")?)
    } else {
        ProgressBar::hidden()
    };
    let effort = if args.quick { Effort::QUICK } else { Effort::FULL };
    let outcome = run_experiment(effort, &|share| bar.set_position((1000.0 * share) as u64))?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        OutputDir::create(folder)?;
        for plot in &outcome.plots {
            let path = |suffix: &str| folder.join(format!("{}.{suffix}", plot.name));
            write_atomically(&path("csv"), plot.csv().as_bytes())?;
            write_atomically(&path("svg"), plot.svg()?.as_bytes())?;
        }
        write_atomically(&folder.join("claims.csv"), claim_csv(&outcome.claims).as_bytes())?;
    }
    print!("{}", claim_table(&outcome.claims));
    Ok(ExitCode::SUCCESS)
}
