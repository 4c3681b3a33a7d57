//! LDA-l1,1: Lagrangian dual ascent for joint l1,1-norm minimisation, Algorithm 1 of
//!
//! Li, Huang, Liu, Feng and Chen, "Acquisition of visible satellites based on antenna arrays via joint
//! l1,1-norms minimization", IEEE Transactions on Vehicular Technology 72(5), 2023.
//!
//! The snapshots are Y = A X + N with A (M x L) the steering matrix of a grid of directions, not normalised,
//! and N impulsive. With E = N / gamma, B = \[A  gamma I\] and Z = \[X; E\], problem (8) is
//!
//! ```text
//! min |Z|_1,1   subject to   B Z = Y
//! ```
//!
//! and Algorithm 1 alternates a subgradient step in Z, eq. (27), and one of ascent in the multiplier:
//!
//! ```text
//! Z0, Lam0 given;  for k = 1 .. K:
//!     Z   <-  Z - s_k ( Z / (2 |Z|) + B^H Lam )
//!     Lam <-  Lam + mu ( B Z - Y )                 (of the new Z)
//! X = the first L rows of Z
//! ```
//!
//! Decisions where the paper is not specific or inconsistent:
//!
//! * s_k = eta ([`StepLength::Constant`]). The step as printed, eta / (k + 1) ([`StepLength::Decreasing`]),
//!   has a total length of eta/2 ln K and stays at an NMSE of 0.6 after 10^4 iterations; the constant one gives
//!   the published minima and the published upper limit of mu.
//! * Z / |Z| is 0 where Z is 0. The trace in (17) is twice its real part: only so does (27) follow.
//! * Z0 is complex normal of unit variance and Lam0 one in every entry. At the optimum |Lam| is at most
//!   1/(2 gamma): Lam0 only costs a transient; the scale of Z0 does not matter if far below the signals'.
//! * K = 10^4 (2 10^4 near the smallest published NMSE).
//! * The iteration is bounded where eta mu (lambda_max(A A^H) + gamma^2) < 4; on the paper's grid lambda_max is
//!   183.6, thus mu < 0.064 at eta = 0.3, gamma = 5.
//! * The steps are absolute numbers: the snapshots must have the paper's scale, a median |Y| of about 60
//!   ([`sparse::solve`](super::solve) sees to that).
//!
//! Columns never meet: (8) is one problem per snapshot.

use super::lanes::{Block, LANES, matrix};
use super::lda_kernel::{Kernel, State};
use super::problem::{SparseError, SparseEstimate, check, positive};
use crate::array::CMat;
use crate::gnss::random::SplitMix64;
use faer::linalg::matmul::matmul;
use faer::{Accum, MatRef, Par};
use num_complex::Complex64;
use rayon::prelude::*;
use sdr_rx_linalg::thin_svd;

/// Dependence of the step s_k on the iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StepLength {
    /// s_k = eta: reproduces the paper's figures.
    #[default]
    Constant,
    /// s_k = eta / (k + 1): as printed.
    Decreasing,
}

/// Initial values of Z or Lam.
#[derive(Clone, Debug)]
pub enum Start {
    /// Complex normals, row by row, of this seed and standard deviation.
    Drawn {
        /// Seed of the draws.
        seed: u64,
        /// Standard deviation, sqrt(E|z|^2).
        scale: f64,
    },
    /// All entries equal.
    Constant(Complex64),
    /// These entries: (L + M) x N of Z, M x N of Lam.
    Given(CMat),
}

impl Start {
    fn matrix(&self, what: &'static str, rows: usize, columns: usize) -> Result<CMat, SparseError> {
        match self {
            Self::Drawn { seed, scale } => {
                let mut rng = SplitMix64::new(*seed);
                let mut out = CMat::zeros(rows, columns);
                for at in 0..rows * columns {
                    out[(at / columns, at % columns)] = *scale * rng.complex_normal();
                }
                Ok(out)
            }
            Self::Constant(value) => Ok(CMat::full(rows, columns, *value)),
            Self::Given(given) if given.nrows() == rows && given.ncols() == columns => {
                Ok(given.clone())
            }
            Self::Given(given) => Err(SparseError::Shape {
                what,
                rows: given.nrows(),
                columns: given.ncols(),
                expected: format!("{rows} x {columns}"),
            }),
        }
    }
}

/// The parameters of Algorithm 1.
#[derive(Clone, Debug)]
pub struct LdaSettings {
    /// gamma: weight of X against the residual.
    pub gamma: f64,
    /// eta: step in Z.
    pub eta: f64,
    /// mu: step in Lam.
    pub mu: f64,
    /// K.
    pub iterations: usize,
    /// Dependence of the step in Z on the iteration.
    pub step: StepLength,
    /// Z0.
    pub z0: Start,
    /// Lam0.
    pub lambda0: Start,
}

impl Default for LdaSettings {
    fn default() -> Self {
        Self {
            gamma: 5.0,
            eta: 0.3,
            mu: 0.01,
            iterations: 10_000,
            step: StepLength::Constant,
            z0: Start::Drawn { seed: 7, scale: 1.0 },
            lambda0: Start::Constant(Complex64::ONE),
        }
    }
}

impl LdaSettings {
    fn check(&self) -> Result<(), SparseError> {
        positive("gamma", self.gamma)?;
        positive("eta", self.eta)?;
        positive("mu", self.mu)
    }
}

/// Upper limit of eta mu for stability: 4 / (lambda_max(A A^H) + gamma^2).
///
/// # Errors
/// When the decomposition of A fails.
pub fn stability_bound(dictionary: &CMat, gamma: f64) -> Result<f64, SparseError> {
    let (_, values, _) = thin_svd(dictionary)
        .ok_or(SparseError::NoConvergence { doing: "largest singular value of the dictionary" })?;
    let largest = values.into_iter().fold(0.0, f64::max);
    Ok(4.0 / (largest * largest + gamma * gamma))
}

/// Stages of [`solve_in_stages`] with smaller and smaller steps, the iterations of each, and those of the last average
/// at most; iterations between two samples of an average.
const STAGES: usize = 5;
const STAGE: usize = 1000;
const LONGEST: usize = 32_000;
const SAMPLE: usize = 5;

/// Algorithm 1 in stages, in single precision: in each the step in Z is halved and that in Lam doubled, which keeps the
/// bound of stability. With the steps of the last, Z and Lam are averaged over stretches twice as long each time, until
/// the duality gap is below `gap`. A constant step ends some per cent above the optimum. Lam0 is 0; of the settings
/// gamma, Z0, and the first eta and mu are used.
///
/// Returns X, the multiplier -2 gamma Lam of the dual problem ([`SparseEstimate::certified`]), and the number of
/// iterations.
///
/// # Errors
/// As [`solve`].
pub fn solve_in_stages(
    a: &CMat,
    y: &CMat,
    settings: &LdaSettings,
    gap: f64,
) -> Result<(CMat, CMat, usize), SparseError> {
    check(a, y)?;
    settings.check()?;
    let (m, l, n) = (a.nrows(), a.ncols(), y.ncols());
    let z0 = settings.z0.matrix("Z0", l + m, n)?;
    let start = |first: usize| {
        let block = |matrix: MatRef<_>| Block::of(matrix, first, 1.0);
        let (x, e) = (z0.subrows(0, l), z0.subrows(l, m));
        State::new(block(y.as_ref()), block(x), block(e), Block::zeros(m))
    };
    let mut state: Vec<State> = (0..n).step_by(LANES).map(start).collect();
    let largest = reach(y);
    let (mut eta, mut mu) = (settings.eta, settings.mu);
    let (mut done, mut length) = (0, STAGE);
    for stage in 1.. {
        let kernel = Kernel::new(a, settings.gamma as f32, mu as f32);
        let steps = [eta as f32; SAMPLE];
        let is_last = stage >= STAGES;
        let (mut x, mut multiplier) = (CMat::zeros(l, n), CMat::zeros(m, n));
        for _ in (0..length).step_by(SAMPLE) {
            state.par_iter_mut().for_each(|block| kernel.iterate(block, &steps));
            if is_last {
                x += matrix(l, n, |b| &state[b].x);
                multiplier += matrix(m, n, |b| &state[b].lambda);
            }
        }
        done += length;
        diverged(reach(&matrix(l, n, |b| &state[b].x)), largest, done, a, settings)?;
        if is_last {
            let gamma = settings.gamma;
            let mean = |sum: CMat, scale: f64| {
                sum * faer::Scale(Complex64::from(scale * SAMPLE as f64 / length as f64))
            };
            let (x, multiplier) = (mean(x, 1.0), mean(multiplier, -2.0 * gamma));
            let certified = SparseEstimate::certified(a, y, x, &multiplier, gamma, done);
            if certified.gap < gap || length >= LONGEST {
                return Ok((certified.x, multiplier, done));
            }
            length *= 2;
        } else {
            (eta, mu) = (0.5 * eta, 2.0 * mu);
        }
    }
    unreachable!("the loop ends at the longest stage")
}

/// Returns an error when the iteration has diverged.
fn diverged(
    reach: f64,
    largest: f64,
    iteration: usize,
    a: &CMat,
    settings: &LdaSettings,
) -> Result<(), SparseError> {
    // |X| stays below |Y| for any sensible scale; an unstable mode grows by some per cent per iteration.
    if reach <= 1e4 * (1.0 + largest) {
        return Ok(());
    }
    let product = 4.0 * settings.eta * settings.mu / stability_bound(a, settings.gamma)?;
    Err(SparseError::Diverged { iteration, product })
}

/// Maximum modulus; infinite where an entry is not a number.
fn reach(matrix: &CMat) -> f64 {
    let entries = matrix.col_iter().flat_map(|c| c.iter());
    entries.fold(0.0, |m, z| if z.is_finite() { z.norm().max(m) } else { f64::INFINITY })
}

/// Algorithm 1 in double precision, one iteration after the other: the reference.
#[derive(Clone, Debug)]
pub struct LdaL11<'a> {
    a: &'a CMat,
    y: &'a CMat,
    settings: &'a LdaSettings,
    /// X and E, the parts of Z.
    x: CMat,
    e: CMat,
    lambda: CMat,
    k: usize,
}

impl<'a> LdaL11<'a> {
    /// Before the first iteration.
    ///
    /// # Errors
    /// When shapes do not fit, an entry is not finite, or a parameter is not above 0.
    pub fn new(a: &'a CMat, y: &'a CMat, settings: &'a LdaSettings) -> Result<Self, SparseError> {
        check(a, y)?;
        settings.check()?;
        let (m, l, n) = (a.nrows(), a.ncols(), y.ncols());
        let z = settings.z0.matrix("Z0", l + m, n)?;
        let lambda = settings.lambda0.matrix("Lambda0", m, n)?;
        let (x, e) = (z.subrows(0, l).to_owned(), z.subrows(l, m).to_owned());
        Ok(Self { a, y, settings, x, e, lambda, k: 0 })
    }

    /// One iteration.
    pub fn step(&mut self) {
        let LdaSettings { gamma, eta, mu, step, .. } = *self.settings;
        self.k += 1;
        let s = match step {
            StepLength::Constant => eta,
            StepLength::Decreasing => eta / (self.k + 1) as f64,
        };
        let one = Complex64::ONE;
        // Z <- Z - s (Z / (2 |Z|) + B^H Lam)
        let towards_zero = |z: &mut Complex64| {
            let modulus = z.norm();
            if modulus > 0.0 {
                *z -= *z * (0.5 * s / modulus);
            }
        };
        for part in [&mut self.x, &mut self.e] {
            part.col_iter_mut().flat_map(|c| c.iter_mut()).for_each(towards_zero);
        }
        let minus_s = -s * one;
        matmul(&mut self.x, Accum::Add, self.a.adjoint(), &self.lambda, minus_s, Par::Seq);
        self.e -= faer::Scale(one * (s * gamma)) * &self.lambda;
        // Lam <- Lam + mu (B Z - Y)
        matmul(&mut self.lambda, Accum::Add, self.a, &self.x, one * mu, Par::Seq);
        self.lambda += faer::Scale(one * (mu * gamma)) * &self.e;
        self.lambda -= faer::Scale(one * mu) * self.y;
    }

    /// The estimate X (L x N) after the iterations made so far.
    pub fn x(&self) -> &CMat {
        &self.x
    }
}

/// LDA-l1,1 in single precision, sixteen snapshots at a time: X (L x N) after all iterations. It is the same
/// iteration; since the sign of Z is chaotic, X agrees with [`LdaL11`]'s in its statistics, not digit by digit.
/// Cost: 2 M L complex multiplications per iteration and snapshot; the state of a block stays in the cache.
///
/// # Errors
/// As [`LdaL11::new`], and when the iteration diverges.
pub fn solve(a: &CMat, y: &CMat, settings: &LdaSettings) -> Result<CMat, SparseError> {
    check(a, y)?;
    settings.check()?;
    let (m, l, n) = (a.nrows(), a.ncols(), y.ncols());
    let kernel = Kernel::new(a, settings.gamma as f32, settings.mu as f32);
    let z0 = settings.z0.matrix("Z0", l + m, n)?;
    let lambda0 = settings.lambda0.matrix("Lambda0", m, n)?;
    let largest = reach(y);
    let start = |first: usize| {
        let block = |matrix: MatRef<_>| Block::of(matrix, first, 1.0);
        let (x, e) = (z0.subrows(0, l), z0.subrows(l, m));
        State::new(block(y.as_ref()), block(x), block(e), block(lambda0.as_ref()))
    };
    let mut state: Vec<State> = (0..n).step_by(LANES).map(start).collect();
    // In stretches, so that divergence is detected early.
    const STRETCH: usize = 500;
    let estimate = |state: &[State]| matrix(l, n, |b| &state[b].x);
    for first in (1..=settings.iterations).step_by(STRETCH) {
        let last = (first + STRETCH - 1).min(settings.iterations);
        let steps: Vec<f32> = (first..=last)
            .map(|k| match settings.step {
                StepLength::Constant => settings.eta as f32,
                StepLength::Decreasing => (settings.eta / (k + 1) as f64) as f32,
            })
            .collect();
        state.iter_mut().for_each(|block| kernel.iterate(block, &steps));
        diverged(reach(&estimate(&state)), largest, last, a, settings)?;
    }
    Ok(estimate(&state))
}
