//! `sdr-rx experiment aw-dgn`: the figures and tables of the paper on AW-DGN-BT.

use super::experiment::thousandths;
use sdr_rx::experiment::aw_dgn::{self, Effort};
use sdr_rx::experiment::claim::{claim_csv, claim_table};
use sdr_rx::report::{OutputDir, write_atomically};
use std::path::PathBuf;
use std::process::ExitCode;

/// Figures 2, 3, 5, 6 and tables 2, 3 of the paper on AW-DGN-BT (NAVIGATION 73, 2026), and where it fails
///
/// Example: sdr-rx experiment aw-dgn --quick --out aw-dgn
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct AwDgn {
    /// Write each figure as CSV and SVG, the tables and the verdicts as CSV, into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// An epoch every 20 minutes instead of every minute, 100 draws a cell of the failure maps
    #[arg(long)]
    quick: bool,
}

/// Prints the verdicts, and writes files where asked.
pub fn run(args: &AwDgn) -> anyhow::Result<ExitCode> {
    let bar = thousandths()?;
    let effort = if args.quick { Effort::QUICK } else { Effort::FULL };
    let outcome = aw_dgn::run(effort, &|share| bar.set_position((1000.0 * share) as u64));
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        OutputDir::create(folder)?;
        let write = |name: &str, text: &str| write_atomically(&folder.join(name), text.as_bytes());
        for map in &outcome.maps {
            write(&format!("{}.csv", map.name), &map.csv())?;
            write(&format!("{}.svg", map.name), &map.svg()?)?;
        }
        for (name, csv) in &outcome.tables {
            write(&format!("{name}.csv"), csv)?;
        }
        write("claims.csv", &claim_csv(&outcome.claims))?;
    }
    print!("{}", claim_table(&outcome.claims));
    Ok(ExitCode::SUCCESS)
}
