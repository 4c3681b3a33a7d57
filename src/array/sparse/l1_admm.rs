//! The same convex problems as LDA-l1,1, solved to their optimum: Douglas-Rachford splitting on the graph of A.
//!
//! ```text
//! min  gamma pen(X) + sum |R|    subject to    A X + R = Y
//! ```
//!
//! alternates the proximal map of the sum (shrinkage of X by gamma rho and of R by rho) with the projection on
//! the constraint, over-relaxed (Eckstein and Bertsekas 1992; this is ADMM with the splitting of Parikh and
//! Boyd, "Block splitting for distributed optimization", 2014):
//!
//! ```text
//! X = shrink(W, gamma rho);  R = shrink(V, rho)
//! u = (I + A^H A)^-1 (2 X - W + A^H (Y - 2 R + V))
//! W <- W + relax (u - X);    V <- V + relax (Y - A u - R)
//! ```
//!
//! With A = U S V^H, truncated where singular values fall below single precision, the projection costs
//! 2 r (M + L) products per snapshot (r = 18 on the paper's grid of 50 x 31); for arrays with mirror symmetry they
//! are products with real numbers (module `mirrored`). rho = c median|Y| makes the solver independent of
//! scale.
//!
//! A bound on the duality gap ends the iteration: Lam = (V - R) / rho, scaled until |A^H Lam| <= gamma, is
//! feasible in the dual problem, max Re <Lam, Y>, so that the optimum lies between that value and the
//! objective.

use super::admm_kernel::{Decomposition, Parameters, State, iterate};
use super::lanes::{Block, Entry, LANES, Packed, matrix};
use super::mirrored::real_form;
use super::problem::{Penalty, SparseError, SparseEstimate, check, objective, positive, scale};
use crate::array::CMat;
use faer::prelude::*;
use num_complex::Complex64;
use sdr_rx_linalg::{Cholesky, thin_svd};

/// Singular values below this fraction of the largest are omitted: their effect is that of single precision.
const RANK_TOLERANCE: f64 = 2e-5;

/// Settings of the splitting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdmmSettings {
    /// Weight of the cost of X against the residual.
    pub gamma: f64,
    /// What X costs.
    pub penalty: Penalty,
    /// rho in units of the median of |Y|.
    pub c: f64,
    /// Relaxation, 0 to 2.
    pub relax: f64,
    /// Maximum number of iterations.
    pub iterations: usize,
    /// Relative duality gap at which the iteration ends (0: never). The objective is typically ten times
    /// closer to the optimum; single precision ends at some 3e-5.
    pub gap: f64,
    /// Iterations between two computations of the gap.
    pub stretch: usize,
}

impl Default for AdmmSettings {
    fn default() -> Self {
        Self {
            gamma: 5.0,
            penalty: Penalty::L11,
            c: 0.02,
            relax: 1.8,
            iterations: 2000,
            gap: 5e-4,
            stretch: 50,
        }
    }
}

impl AdmmSettings {
    fn check(&self) -> Result<(), SparseError> {
        positive("gamma", self.gamma)?;
        positive("c", self.c)?;
        positive("stretch", self.stretch as f64)?;
        match self.relax > 0.0 && self.relax < 2.0 {
            true => Ok(()),
            false => Err(SparseError::Parameter {
                name: "relax",
                value: self.relax,
                range: "between 0 and 2",
            }),
        }
    }
}

/// A decomposed dictionary.
pub struct AdmmPlan<'a> {
    a: &'a CMat,
    rank: usize,
    form: Form,
}

/// The operands of the iteration.
enum Form {
    Complex(Decomposition<[f32; 2]>),
    /// In real numbers, and the phases by which X is multiplied there.
    Mirrored(Decomposition<f32>, Vec<Complex64>),
}

impl<'a> AdmmPlan<'a> {
    /// Decomposes the dictionary.
    ///
    /// # Errors
    /// When it is empty or not finite, or the decomposition fails.
    pub fn new(a: &'a CMat) -> Result<Self, SparseError> {
        check(a, &CMat::zeros(a.nrows(), 0))?;
        let failed =
            SparseError::NoConvergence { doing: "singular value decomposition of the dictionary" };
        if let Some((real, phases)) = real_form(a) {
            let svd = real.svd(true, true);
            let (Some(u), Some(v)) = (svd.u, svd.v_t) else { return Err(failed) };
            let s = svd.singular_values.as_slice();
            let v = |r: usize, c: usize| v[(c, r)].into();
            let of = decomposition(a, s, |r, c| u[(r, c)].into(), v, true);
            return Ok(Self { a, rank: of.u_adjoint.rows(), form: Form::Mirrored(of, phases) });
        }
        let (u, s, v) = thin_svd(a).ok_or(failed)?;
        let of = decomposition(a, &s, |r, c| u[(r, c)], |r, c| v[(r, c)], false);
        Ok(Self { a, rank: of.u_adjoint.rows(), form: Form::Complex(of) })
    }

    /// Solves for snapshots Y (M x N) in single precision, sixteen at a time.
    ///
    /// # Errors
    /// When Y does not fit or is not finite, or a setting is out of range.
    pub fn solve(&self, y: &CMat, settings: &AdmmSettings) -> Result<SparseEstimate, SparseError> {
        check(self.a, y)?;
        settings.check()?;
        let (l, n) = (self.a.ncols(), y.ncols());
        let Some(unit) = scale(y) else { return Ok(SparseEstimate::nothing(l, n)) };
        let shrink_x = settings.gamma * settings.c;
        let parameters = Parameters {
            shrink_x: shrink_x as f32,
            shrink_r: settings.c as f32,
            relax: settings.relax as f32,
        };
        let start =
            |first: usize| State::new(Block::of(y.as_ref(), first, 1.0 / unit), l, self.rank);
        let mut state: Vec<State> = (0..n).step_by(LANES).map(start).collect();
        let go = |state: &mut [State], count: usize, rows: Option<&[f32]>| {
            for block in state {
                match &self.form {
                    Form::Complex(of) => iterate(of, parameters, block, count, rows),
                    Form::Mirrored(of, _) => iterate(of, parameters, block, count, rows),
                }
            }
        };
        let mut done = 0;
        loop {
            let count = settings.stretch.min(settings.iterations - done);
            match settings.penalty {
                Penalty::L11 => go(&mut state, count, None),
                Penalty::Rows => {
                    for _ in 0..count {
                        let left = left_of_rows(&state, l, shrink_x);
                        go(&mut state, 1, Some(&left));
                    }
                }
            }
            done += count;
            let mut w = matrix(l, n, |b| &state[b].w);
            if let Form::Mirrored(_, phases) = &self.form {
                w = CMat::from_fn(l, n, |l, n| phases[l].conj() * w[(l, n)]);
            }
            let v = matrix(y.nrows(), n, |b| &state[b].v);
            let estimate = self::estimate(self.a, y, &w, &v, unit, settings, done);
            if estimate.gap <= settings.gap || done >= settings.iterations {
                return Ok(estimate);
            }
        }
    }
}

/// U S V^H of the dictionary, from the entries of U and V, without what is negligible.
fn decomposition<E: Entry>(
    a: &CMat,
    s: &[f64],
    u: impl Fn(usize, usize) -> Complex64,
    v: impl Fn(usize, usize) -> Complex64,
    folded: bool,
) -> Decomposition<E> {
    let rank = s.iter().filter(|v| **v > RANK_TOLERANCE * s[0]).count();
    let (m, l) = (a.nrows(), a.ncols());
    Decomposition {
        u: Packed::new(m, rank, &u),
        u_adjoint: Packed::new(rank, m, |r, c| u(c, r).conj()),
        v: Packed::new(l, rank, &v),
        v_adjoint: Packed::new(rank, l, |r, c| v(c, r).conj()),
        s: s[..rank].iter().flat_map(|s| [*s as f32; LANES]).collect(),
        folded,
    }
}

/// The same iteration in double precision, as in the equations above: the reference, and for more than four
/// digits of the objective. Some 20 times slower.
///
/// # Errors
/// As [`AdmmPlan::solve`].
pub fn solve_exactly(
    a: &CMat,
    y: &CMat,
    settings: &AdmmSettings,
) -> Result<SparseEstimate, SparseError> {
    check(a, y)?;
    settings.check()?;
    let (l, n) = (a.ncols(), y.ncols());
    let Some(unit) = scale(y) else { return Ok(SparseEstimate::nothing(l, n)) };
    let identity = CMat::identity(l, l);
    let gram = Cholesky::new(&(identity + a.adjoint() * a))
        .ok_or(SparseError::NoConvergence { doing: "Cholesky factor of I + A^H A" })?;
    let scaled = y * Scale(Complex64::from(1.0 / unit));
    let (mut w, mut v) = (CMat::zeros(l, n), CMat::zeros(y.nrows(), n));
    let relax = Scale(Complex64::from(settings.relax));
    let two = Scale(Complex64::from(2.0));
    for done in 1.. {
        let x = shrunk_x(&w, settings);
        let r = shrunk(&v, settings.c);
        let u = gram.solve(&(two * &x - &w + a.adjoint() * (&scaled - two * &r + &v)));
        w += relax * (&u - &x);
        v += relax * (&scaled - a * &u - &r);
        if done % settings.stretch == 0 || done >= settings.iterations {
            let estimate = estimate(a, y, &w, &v, unit, settings, done);
            if estimate.gap <= settings.gap || done >= settings.iterations {
                return Ok(estimate);
            }
        }
    }
    unreachable!("the loop ends at the last iteration")
}

/// X and the residual of W and V (of Y / `unit`), and a bound on their distance from the optimum.
fn estimate(
    a: &CMat,
    y: &CMat,
    w: &CMat,
    v: &CMat,
    unit: f64,
    settings: &AdmmSettings,
    iterations: usize,
) -> SparseEstimate {
    let AdmmSettings { gamma, penalty, c, .. } = *settings;
    let x = shrunk_x(w, settings) * Scale(Complex64::from(unit));
    let objective = objective(a, y, &x, penalty, gamma);
    let multiplier = (v - shrunk(v, c)) * Scale(Complex64::from(1.0 / c));
    let correlation = a.adjoint() * &multiplier;
    let feasible = |largest: f64| (gamma / largest.max(f64::MIN_POSITIVE)).min(1.0);
    let column_value = |n: usize| -> f64 {
        let pairs = multiplier.col(n).iter().zip(y.col(n).iter());
        pairs.map(|(z, y)| (z.conj() * y).re).sum()
    };
    let columns = 0..y.ncols();
    let dual: f64 = match penalty {
        Penalty::L11 => columns
            .map(|n| {
                let powers = correlation.col(n).iter().map(|z| z.norm_sqr());
                feasible(powers.fold(0.0, f64::max).sqrt()) * column_value(n)
            })
            .sum(),
        Penalty::Rows => {
            let largest = correlation.row_iter().map(|r| r.norm_l2()).fold(0.0, f64::max);
            feasible(largest) * columns.map(column_value).sum::<f64>()
        }
    };
    let gap = ((objective - dual) / objective).max(0.0);
    SparseEstimate { x, objective, gap, iterations }
}

/// X of W.
fn shrunk_x(w: &CMat, settings: &AdmmSettings) -> CMat {
    let by = settings.gamma * settings.c;
    match settings.penalty {
        Penalty::L11 => shrunk(w, by),
        Penalty::Rows => {
            let kept: Vec<f64> = w.row_iter().map(|row| kept_of(row.norm_l2(), by)).collect();
            CMat::from_fn(w.nrows(), w.ncols(), |l, n| w[(l, n)] * kept[l])
        }
    }
}

/// Every entry moved towards zero.
fn shrunk(matrix: &CMat, by: f64) -> CMat {
    CMat::from_fn(matrix.nrows(), matrix.ncols(), |row, column| {
        let z = matrix[(row, column)];
        z * kept_of(z.norm_sqr().sqrt(), by)
    })
}

/// Fraction that remains of a number of this norm.
fn kept_of(norm: f64, by: f64) -> f64 {
    if norm > by { 1.0 - by / norm } else { 0.0 }
}

/// Fraction that remains of each row of W over all blocks, repeated for all lanes.
fn left_of_rows(state: &[State], rows: usize, by: f64) -> Vec<f32> {
    let mut powers = vec![0f64; rows];
    for part in state.iter().flat_map(|s| [s.w.part(0), s.w.part(1)]) {
        for (power, row) in powers.iter_mut().zip(part.as_chunks::<LANES>().0) {
            *power += f64::from(row.iter().map(|v| v * v).sum::<f32>());
        }
    }
    powers.into_iter().flat_map(|p| [kept_of(p.sqrt(), by) as f32; LANES]).collect()
}
