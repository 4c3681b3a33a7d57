//! `sdr-rx experiment`: figures and tables made again.

use super::experiment_aw_dgn;
use super::experiment_distributed_ls;
use super::experiment_front_end;
use super::experiment_lda_l11;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::process::ExitCode;

/// Experiments: tables, CSV and plots, with theory beside them
#[derive(clap::Args)]
pub struct Experiment {
    #[command(subcommand)]
    name: Name,
}

#[derive(clap::Subcommand)]
enum Name {
    AwDgn(experiment_aw_dgn::AwDgn),
    DistributedLs(experiment_distributed_ls::DistributedLs),
    LdaL11(experiment_lda_l11::LdaL11),
    FrontEnd(experiment_front_end::FrontEnd),
}

/// Runs the experiment.
pub fn run(args: &Experiment) -> anyhow::Result<ExitCode> {
    match &args.name {
        Name::AwDgn(args) => experiment_aw_dgn::run(args),
        Name::DistributedLs(args) => experiment_distributed_ls::run(args),
        Name::LdaL11(args) => experiment_lda_l11::run(args),
        Name::FrontEnd(args) => experiment_front_end::run(args),
    }
}

/// A progress bar of a thousand steps on a terminal, nothing elsewhere.
pub(super) fn thousandths() -> anyhow::Result<ProgressBar> {
    if !stderr().is_terminal() {
        return Ok(ProgressBar::hidden());
    }
    let style = ProgressStyle::with_template("{bar:40} {percent} %, {eta} left")?;
    Ok(ProgressBar::new(1000).with_style(style))
}
