//! Sparse reconstruction over a dictionary: snapshots Y as a few of the responses A, in impulsive noise.
//!
//! All engines solve, for Y (M x N, a column a snapshot) and A (M x L, a column a direction),
//!
//! ```text
//! min over X   gamma pen(X) + sum |Y - A X|
//! ```
//!
//! with pen(X) the sum of all moduli ([`Penalty::L11`]: eq. (8) of the paper on JANE times gamma, columns
//! apart) or of the Euclidean norms of the rows ([`Penalty::Rows`]: directions are shared by all snapshots).
//! The absolute loss limits the effect of impulses.

mod admm_kernel;
pub mod l1_admm;
mod lanes;
mod lda_kernel;
pub mod lda_l11;
mod mirrored;
mod problem;
mod register;

pub use problem::{Penalty, SparseError, SparseEstimate, check, nmse, objective, positive};

use super::CMat;
use l1_admm::{AdmmPlan, AdmmSettings};
use lda_l11::LdaSettings;
use problem::scale;

/// The algorithm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Engine {
    /// Douglas-Rachford splitting ([`l1_admm`]): reaches the optimum, 25 to 40 times faster.
    #[default]
    Admm,
    /// LDA-l1,1 ([`lda_l11`]), the algorithm of the paper, with steps in stages.
    Lda,
}

/// Duality gap at which LDA-l1,1 ends.
const LDA_GAP: f64 = 8e-3;

/// Options of the reconstruction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SparseOptions {
    /// The algorithm.
    pub engine: Engine,
    /// Penalty of X.
    pub penalty: Penalty,
    /// Weight of the penalty against the residual; `None`: [`default_gamma`].
    pub gamma: Option<f64>,
}

/// The gamma at which noise alone hardly affects a row: for l1,1 1.2 sqrt(M) (|a^H sign(noise)| is sqrt(M) in
/// the mean square; the paper's 5 at M = 50 is 0.7 sqrt(M), which overfits where L > M), for rows sqrt(M N).
pub fn default_gamma(penalty: Penalty, elements: usize, snapshots: usize) -> f64 {
    match penalty {
        Penalty::L11 => 1.2 * (elements as f64).sqrt(),
        Penalty::Rows => ((elements * snapshots) as f64).sqrt(),
    }
}

/// Reconstructs X (L x N) from a dictionary A (M x L) and snapshots Y (M x N), each engine with its default
/// settings. Cost: 2 r (M + L) complex multiplications per iteration and snapshot (r the rank of A) and about
/// 200 iterations; LDA-l1,1 2 M L and 5000 to 70000, until its duality gap is below a hundredth.
///
/// Y may have any scale: LDA-l1,1, which is not equivariant, is given each column with a median modulus of
/// 60 (that of the paper's scene) and the eta of its settings, or half the stability bound if that is less.
///
/// # Errors
/// When shapes do not fit, an entry is not finite, gamma is not above 0, or LDA is asked for rows.
pub fn solve(
    dictionary: &CMat,
    snapshots: &CMat,
    options: &SparseOptions,
) -> Result<CMat, SparseError> {
    Ok(reconstruct(dictionary, snapshots, options)?.x)
}

/// [`solve`], with the distance from the optimum.
///
/// # Errors
/// As [`solve`].
pub fn reconstruct(
    dictionary: &CMat,
    snapshots: &CMat,
    options: &SparseOptions,
) -> Result<SparseEstimate, SparseError> {
    check(dictionary, snapshots)?;
    let standard = default_gamma(options.penalty, dictionary.nrows(), snapshots.ncols());
    let gamma = options.gamma.unwrap_or(standard);
    match options.engine {
        Engine::Admm => {
            let settings = AdmmSettings { gamma, penalty: options.penalty, ..Default::default() };
            AdmmPlan::new(dictionary)?.solve(snapshots, &settings)
        }
        Engine::Lda if options.penalty == Penalty::Rows => Err(SparseError::NoRows),
        Engine::Lda => {
            if snapshots.norm_max() == 0.0 {
                return Ok(SparseEstimate::nothing(dictionary.ncols(), snapshots.ncols()));
            }
            let mut settings = LdaSettings { gamma, ..Default::default() };
            let bound = lda_l11::stability_bound(dictionary, gamma)?;
            settings.eta = settings.eta.min(bound / 2.0 / settings.mu);
            // Columns never meet: each has its own scale.
            let unit = |n: usize| 60.0 / scale(&snapshots.subcols(n, 1).to_owned()).unwrap_or(60.0);
            let units: Vec<f64> = (0..snapshots.ncols()).map(unit).collect();
            let scaled =
                CMat::from_fn(snapshots.nrows(), units.len(), |m, n| snapshots[(m, n)] * units[n]);
            let (x, multiplier, iterations) =
                lda_l11::solve_in_stages(dictionary, &scaled, &settings, LDA_GAP)?;
            let x = CMat::from_fn(x.nrows(), x.ncols(), |l, n| x[(l, n)] / units[n]);
            Ok(SparseEstimate::certified(dictionary, snapshots, x, &multiplier, gamma, iterations))
        }
    }
}
