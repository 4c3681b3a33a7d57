//! Figures 2 to 5 of the paper on JANE (IEEE TVT 72(5), 2023), reproduced on its scene.
//!
//! NMSE of LDA-l1,1 against gamma, eta and mu, and the comparison with the other methods; every curve is a mean
//! over seeds. The paper gives its curves as plots: the figures taken from it are the ends of the range in
//! which the error stays below 5e-3, and the position and height of the minimum.

mod comparison;
mod sweeps;

use crate::{Findings, Scene};
use sdr_rx::array::sparse::SparseError;
use sdr_rx::array::{CMat, paper_dictionary};

/// Amount of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LdaL11Effort {
    /// Scenes that are averaged, seeds 1 on.
    pub seeds: u64,
    /// Snapshots of each in the sweeps of figures 2 to 4 (figure 5 has the paper's 100).
    pub snapshots: usize,
    /// Iterations of LDA-l1,1 in the sweeps.
    pub iterations: usize,
}

impl LdaL11Effort {
    /// Some minutes on two cores.
    pub const FULL: Self = Self { seeds: 4, snapshots: 64, iterations: 20_000 };
    /// Half a minute.
    pub const QUICK: Self = Self { seeds: 1, snapshots: 16, iterations: 10_000 };
}

/// Makes the paper's figures; `progress` is given the fraction that is done, 0 to 1.
///
/// # Errors
/// When a solver fails.
pub fn run(effort: LdaL11Effort, progress: &(dyn Fn(f64) + Sync)) -> Result<Findings, SparseError> {
    let mut findings = sweeps::run(effort, &|done| progress(0.6 * done))?;
    findings.extend(comparison::run(effort, &|done| progress(0.6 + 0.4 * done))?);
    Ok(findings)
}

/// A scene of the paper with its truth on the paper's grid, 25 to 55 degrees.
struct Problem {
    a: CMat,
    y: CMat,
    truth: CMat,
}

impl Problem {
    fn new(scene: &Scene, seed: u64) -> Self {
        let drawn = scene.draw(seed);
        let a = paper_dictionary(scene.elements);
        let truth = scene.truth_on_degrees(&drawn, 25, a.ncols());
        Self { a, y: drawn.y, truth }
    }
}

/// Mean of some numbers.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
