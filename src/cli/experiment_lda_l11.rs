//! `sdr-rx experiment lda-l11`: the figures of the paper on JANE.

use super::experiment::thousandths;
use sdr_rx::experiment::claim::{claim_csv, claim_table};
use sdr_rx::experiment::detection::{DetectionOptions, detection};
use sdr_rx::experiment::lda_l11::{self, Effort};
use sdr_rx::report::{OutputDir, write_atomically};
use std::path::PathBuf;
use std::process::ExitCode;

/// Figures 2 to 5 of the paper on JANE (IEEE TVT 72(5), 2023) and curves of detection, with verdicts
///
/// Example: sdr-rx experiment lda-l11 --quick --out lda-l11
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct LdaL11 {
    /// Write each figure as CSV and SVG, and the verdicts as CSV, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// One scene of 16 snapshots in the sweeps instead of four of 64, two trials a point of detection
    #[arg(long)]
    quick: bool,
}

/// Prints the verdicts, and writes files where asked.
pub fn run(args: &LdaL11) -> anyhow::Result<ExitCode> {
    let bar = thousandths()?;
    let effort = if args.quick { Effort::QUICK } else { Effort::FULL };
    let mut outcome = lda_l11::run(effort, &|share| bar.set_position((800.0 * share) as u64))?;
    let (trials, noise_runs) = if args.quick { (2, 20) } else { (30, 3000) };
    let jane = detection(&DetectionOptions { trials, noise_runs, seed: 1 })?;
    outcome.plots.extend(jane.plots);
    outcome.claims.extend(jane.claims);
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
