//! Counts of runs of a solver that converge to the least-squares optimum, and their iterations.

use nalgebra::Vector3;
use sdr_rx::position::solver::aw_dgn_bt::{Damping, iterate};
use sdr_rx::position::solver::point_solution::Ambiguity;
use sdr_rx::position::{Place, Row, Solver};
use std::ops::AddAssign;

/// A solution this near the optimum is the optimum, m.
const SAME_M: f64 = 1.0;

/// Outcomes of some runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Runs.
    pub runs: usize,
    /// Runs that ended at the optimum.
    pub right: usize,
    /// Runs that ended elsewhere, with the optimum among their alternatives.
    pub named: usize,
    /// Runs that converged elsewhere without alternatives.
    pub wrong: usize,
    /// Linearisations of the right ones.
    pub iterations: usize,
    /// Most linearisations of a right one.
    pub most_iterations: usize,
}

impl Tally {
    /// Fraction of right runs.
    pub fn fraction(&self) -> f64 {
        self.right as f64 / self.runs as f64
    }

    /// Mean of the iterations of right runs; NaN without any.
    pub fn mean_iterations(&self) -> f64 {
        self.iterations as f64 / self.right as f64
    }

    /// Whether all were right.
    pub fn all_right(&self) -> bool {
        self.right == self.runs
    }
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.runs += other.runs;
        self.right += other.right;
        self.named += other.named;
        self.wrong += other.wrong;
        self.iterations += other.iterations;
        self.most_iterations = self.most_iterations.max(other.most_iterations);
    }
}

/// Each of `solvers` on rows with errors of `sigma` (m or m/s), for a receiver at `truth` (ECEF).
///
/// The optimum is where backtracking Gauss-Newton leads from the truth; without one, no run is right.
pub fn judge(solvers: &[Solver], rows: &[Row], truth: &Vector3<f64>, sigma: f64) -> Vec<Tally> {
    let weighted: Vec<Row> = rows.iter().map(|row| row.with_sigma(sigma)).collect();
    let optimum = iterate(rows, &Damping::ADGN_BT, &Place::at(*truth), |_| ()).ok();
    let is_optimum = |state: &Place| {
        let optimum = optimum.as_ref();
        optimum.is_some_and(|o| (state.position_m - o.state.position_m).norm() < SAME_M)
    };
    let one = |solver: &Solver| {
        // The paper's solvers weight all rows equally, and their thresholds are in m.
        let solved = match solver {
            Solver::Vp | Solver::VpOnce => solver.solve(&weighted, |_| ()),
            _ => solver.solve(rows, |_| ()),
        };
        let mut tally = Tally { runs: 1, ..Tally::default() };
        match solved {
            Ok(found) if is_optimum(&found.state) => {
                tally.right = 1;
                tally.iterations = found.iterations;
                tally.most_iterations = found.iterations;
            }
            Ok(found)
                if found.ambiguity == Ambiguity::Several
                    && found.alternatives.iter().any(is_optimum) =>
            {
                tally.named = 1;
            }
            Ok(_) => tally.wrong = 1,
            Err(_) => (),
        }
        tally
    };
    solvers.iter().map(one).collect()
}
