//! The command line of the laboratory.

use clap::{Args, Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use sdr_rx::report::OutputDir;
use sdr_rx_lab::claim::claim_table;
use sdr_rx_lab::detection::{DetectionOptions, detection};
use sdr_rx_lab::{Findings, aw_dgn, distributed_ls, lda_l11};
use std::io::{IsTerminal, stderr};
use std::path::PathBuf;
use std::process::ExitCode;

/// Figures and tables of the papers behind sdr-rx, reproduced, with a verdict for each claim
#[derive(Parser)]
#[command(name = "sdr-rx-lab", version, about)]
struct Cli {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(Subcommand)]
enum Experiment {
    /// Figures 2, 3, 5, 6 and tables 2, 3 of the paper on AW-DGN-BT (NAVIGATION 73, 2026), and where it fails
    ///
    /// Example: sdr-rx-lab aw-dgn --quick --out aw-dgn
    ///
    /// Quick: an epoch every 20 minutes instead of every minute, 100 draws a cell of the failure maps.
    AwDgn(Common),
    /// Figures 8 to 11 of the paper on distributed least squares in networks of receivers (Meas. Sci. Technol. 30,
    /// 2019), on a simulated network of 110 stations; faster variants; which claims hold
    ///
    /// Example: sdr-rx-lab distributed-ls --quick --out distributed-ls
    ///
    /// Quick: 2 networks instead of 10, 30 epochs instead of 300, at most 1200 iterations instead of 4000.
    DistributedLs {
        #[command(flatten)]
        common: Common,
        /// Seed of the network and its noise
        #[arg(long, value_name = "N", default_value_t = 1)]
        seed: u64,
    },
    /// Figures 2 to 5 of the paper on JANE (IEEE TVT 72(5), 2023) and curves of detection, with verdicts
    ///
    /// Example: sdr-rx-lab lda-l11 --quick --out lda-l11
    ///
    /// Quick: one scene of 16 snapshots in the sweeps instead of four of 64, two trials a point of detection.
    LdaL11(Common),
}

#[derive(Args)]
struct Common {
    /// Write each figure as CSV and SVG, the tables and the verdicts as CSV, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// A small part of the work
    #[arg(long)]
    quick: bool,
}

fn main() -> ExitCode {
    match run(&Cli::parse().experiment) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sdr-rx-lab: {error:#}");
            ExitCode::from(2)
        }
    }
}

/// Prints the verdicts, and writes files where asked.
fn run(experiment: &Experiment) -> anyhow::Result<()> {
    let bar = match stderr().is_terminal() {
        true => ProgressBar::new(1000)
            .with_style(ProgressStyle::with_template("{bar:40} {percent} %, {eta} left")?),
        false => ProgressBar::hidden(),
    };
    let progress = |fraction: f64| bar.set_position((1000.0 * fraction) as u64);
    let (common, findings) = match experiment {
        Experiment::AwDgn(common) => {
            let effort =
                if common.quick { aw_dgn::AwDgnEffort::QUICK } else { aw_dgn::AwDgnEffort::FULL };
            (common, aw_dgn::run(effort, &progress))
        }
        Experiment::DistributedLs { common, seed } => {
            let effort = match common.quick {
                true => distributed_ls::DistributedLsEffort::QUICK,
                false => distributed_ls::DistributedLsEffort::FULL,
            };
            (common, distributed_ls::run(*seed, effort, &progress)?)
        }
        Experiment::LdaL11(common) => (common, jane(common.quick, &progress)?),
    };
    bar.finish_and_clear();
    if let Some(folder) = &common.out {
        findings.write(&OutputDir::create(folder)?)?;
    }
    print!("{}", claim_table(&findings.claims));
    Ok(())
}

fn jane(quick: bool, progress: &(dyn Fn(f64) + Sync)) -> anyhow::Result<Findings> {
    let effort = if quick { lda_l11::LdaL11Effort::QUICK } else { lda_l11::LdaL11Effort::FULL };
    let mut findings = lda_l11::run(effort, &|fraction| progress(0.8 * fraction))?;
    let (trials, noise_runs) = if quick { (2, 20) } else { (30, 3000) };
    findings.extend(detection(&DetectionOptions { trials, noise_runs, seed: 1 })?);
    Ok(findings)
}
