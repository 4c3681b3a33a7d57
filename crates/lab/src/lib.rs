//! Figures and tables of the papers behind sdr-rx, reproduced from the same assumptions, with a verdict for each
//! claim; and the methods that only the papers use.

pub mod aw_dgn;
pub mod baselines;
pub mod claim;
pub mod detection;
pub mod distributed_ls;
pub mod lda_l11;
pub mod scene;

pub use scene::{Scene, Snapshots};

use claim::{Claim, claim_csv};
use sdr_rx::report::{HeatMap, LinePlot, OutputDir, ReportError};

/// Results of an experiment.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// Figures over two variables.
    pub maps: Vec<HeatMap>,
    /// Figures over one.
    pub plots: Vec<LinePlot>,
    /// The tables: name of the file without suffix, and its comma-separated values.
    pub tables: Vec<(String, String)>,
    /// The verdicts.
    pub claims: Vec<Claim>,
}

impl Findings {
    /// Adds another's.
    pub fn extend(&mut self, other: Self) {
        self.maps.extend(other.maps);
        self.plots.extend(other.plots);
        self.tables.extend(other.tables);
        self.claims.extend(other.claims);
    }

    /// Writes each figure as CSV and SVG, the tables and the verdicts as CSV.
    ///
    /// # Errors
    /// When a file cannot be written or a figure drawn.
    pub fn write(&self, folder: &OutputDir) -> Result<(), ReportError> {
        for map in &self.maps {
            folder.write(&format!("{}.csv", map.name), map.csv())?;
            folder.write(&format!("{}.svg", map.name), map.svg()?)?;
        }
        for plot in &self.plots {
            folder.write(&format!("{}.csv", plot.name), plot.csv())?;
            folder.write(&format!("{}.svg", plot.name), plot.svg()?)?;
        }
        for (name, csv) in &self.tables {
            folder.write(&format!("{name}.csv"), csv)?;
        }
        folder.write("claims.csv", claim_csv(&self.claims)).map(|_| ())
    }
}
