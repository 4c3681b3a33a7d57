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

pub use problem::{Penalty, SparseError, check, nmse, objective, positive};

use super::CMat;
use l1_admm::{AdmmPlan, AdmmSettings};
use lda_l11::LdaSettings;
use problem::median_modulus;

/// The algorithm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Engine {
    /// Douglas-Rachford splitting ([`l1_admm`]): reaches the optimum, 25 to 40 times faster.
    #[default]
    Admm,
    /// LDA-l1,1 ([`lda_l11`]) as in the paper: ends a little above the optimum.
    Lda,
}

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
/// 200 iterations; LDA-l1,1 2 M L and 10^4.
///
/// Y may have any scale: LDA-l1,1, which is not equivariant, is given Y with a median modulus of 60 (that of
/// the paper's scene) and the eta of its settings, or half the stability bound if that is less.
///
/// # Errors
/// When shapes do not fit, an entry is not finite, gamma is not above 0, or LDA is asked for rows.
pub fn solve(
    dictionary: &CMat,
    snapshots: &CMat,
    options: &SparseOptions,
) -> Result<CMat, SparseError> {
    check(dictionary, snapshots)?;
    let standard = default_gamma(options.penalty, dictionary.nrows(), snapshots.ncols());
    let gamma = options.gamma.unwrap_or(standard);
    match options.engine {
        Engine::Admm => {
            let settings = AdmmSettings { gamma, penalty: options.penalty, ..Default::default() };
            Ok(AdmmPlan::new(dictionary)?.solve(snapshots, &settings)?.x)
        }
        Engine::Lda if options.penalty == Penalty::Rows => Err(SparseError::NoRows),
        Engine::Lda => {
            let median = median_modulus(snapshots);
            if median == 0.0 {
                return Ok(CMat::zeros(dictionary.ncols(), snapshots.ncols()));
            }
            let mut settings = LdaSettings { gamma, ..Default::default() };
            let bound = lda_l11::stability_bound(dictionary, gamma)?;
            settings.eta = settings.eta.min(bound / 2.0 / settings.mu);
            let unit = 60.0 / median;
            let scaled = CMat::from_fn(snapshots.nrows(), snapshots.ncols(), |m, n| {
                snapshots[(m, n)] * unit
            });
            let x = lda_l11::solve(dictionary, &scaled, &settings)?;
            Ok(CMat::from_fn(x.nrows(), x.ncols(), |l, n| x[(l, n)] / unit))
        }
    }
}
