//! `sdr-rx experiment distributed-ls`: the figures of the paper on distributed least squares in GNSS networks.

use super::experiment::thousandths;
use sdr_rx::experiment::claim::{claim_csv, claim_table};
use sdr_rx::experiment::distributed_ls::{self, Effort};
use sdr_rx::report::{OutputDir, write_atomically};
use std::path::PathBuf;
use std::process::ExitCode;

/// Figures 8 to 11 of the paper on distributed least squares in networks of receivers (Meas. Sci. Technol. 30,
/// 2019), on a made network of 110 stations; what is faster; which claims hold
///
/// Example: sdr-rx experiment distributed-ls --quick --out distributed-ls
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct DistributedLs {
    /// Write each figure as CSV and SVG, the tables and the verdicts as CSV, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// 2 networks instead of 10, 30 epochs instead of 300, at most 1200 iterations instead of 4000
    #[arg(long)]
    quick: bool,
    /// The network and its noise are drawn from this
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Prints the verdicts, and writes files where asked.
pub fn run(args: &DistributedLs) -> anyhow::Result<ExitCode> {
    let bar = thousandths()?;
    let effort = if args.quick { Effort::QUICK } else { Effort::FULL };
    let progress = |share| bar.set_position((1000.0 * share) as u64);
    let outcome = distributed_ls::run(args.seed, effort, &progress)?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        OutputDir::create(folder)?;
        let write = |name: &str, text: &str| write_atomically(&folder.join(name), text.as_bytes());
        for plot in &outcome.plots {
            write(&format!("{}.csv", plot.name), &plot.csv())?;
            write(&format!("{}.svg", plot.name), &plot.svg()?)?;
        }
        for (name, csv) in &outcome.tables {
            write(&format!("{name}.csv"), csv)?;
        }
        write("claims.csv", &claim_csv(&outcome.claims))?;
    }
    print!("{}", claim_table(&outcome.claims));
    Ok(ExitCode::SUCCESS)
}
