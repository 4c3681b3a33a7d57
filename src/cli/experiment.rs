//! `sdr-rx experiment`: figures and tables made again.

use super::experiment_front_end;
use std::process::ExitCode;

/// Experiments: tables, CSV and plots, with theory beside them
#[derive(clap::Args)]
pub struct Experiment {
    #[command(subcommand)]
    name: Name,
}

#[derive(clap::Subcommand)]
enum Name {
    FrontEnd(experiment_front_end::FrontEnd),
}

/// Runs the experiment.
pub fn run(args: &Experiment) -> anyhow::Result<ExitCode> {
    match &args.name {
        Name::FrontEnd(args) => experiment_front_end::run(args),
    }
}
