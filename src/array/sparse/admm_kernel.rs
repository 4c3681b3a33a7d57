//! The iteration of the splitting of [`l1_admm`](super::l1_admm) on a block of sixteen snapshots.

use super::lanes::{Block, Entry, LANES, Packed, fold, kept, unfold};
use super::register::{Register, Sweep, dispatch};

/// The dictionary as U S V^H; where `folded`, as Q U S V^H, Q being [`unfold`].
pub struct Decomposition<E> {
    /// U.
    pub u: Packed<E>,
    /// U^H.
    pub u_adjoint: Packed<E>,
    /// V.
    pub v: Packed<E>,
    /// V^H.
    pub v_adjoint: Packed<E>,
    /// The singular values, each repeated for all lanes.
    pub s: Vec<f32>,
    /// Whether the rows are folded.
    pub folded: bool,
}

/// Parameters of the iteration.
#[derive(Clone, Copy)]
pub struct Parameters {
    /// gamma rho: shrinkage of X.
    pub shrink_x: f32,
    /// rho: shrinkage of the residual.
    pub shrink_r: f32,
    /// Relaxation.
    pub relax: f32,
}

/// The state of sixteen snapshots, and work space.
pub(super) struct State {
    y: Block,
    /// W, whose shrinkage is X.
    pub w: Block,
    /// V, whose shrinkage is the residual.
    pub v: Block,
    a: Block,
    d: Block,
    p: Block,
    q: Block,
    product: Block,
    left: Vec<f32>,
}

impl State {
    /// Starts from zero: L rows of X, rank r of the dictionary.
    pub fn new(y: Block, l: usize, rank: usize) -> Self {
        let zeros = Block::zeros;
        let (m, rows) = (y.rows(), l.max(y.rows()));
        let (w, v, a, d) = (zeros(l), zeros(m), zeros(l), zeros(m));
        let (p, q, product) = (zeros(rank), zeros(rank), zeros(rows));
        Self { y, w, v, a, d, p, q, product, left: vec![0.0; rows * LANES] }
    }
}

/// So many iterations. With `rows`, the fractions that remain of each row of W (repeated for all lanes)
/// replace the shrinkage of each of its entries: they are valid for one iteration.
pub fn iterate<E: Entry>(
    dictionary: &Decomposition<E>,
    parameters: Parameters,
    state: &mut State,
    count: usize,
    rows: Option<&[f32]>,
) {
    dispatch(Iterations { dictionary, parameters, state, count, rows });
}

struct Iterations<'a, E> {
    dictionary: &'a Decomposition<E>,
    parameters: Parameters,
    state: &'a mut State,
    count: usize,
    rows: Option<&'a [f32]>,
}

impl<E: Entry> Sweep for Iterations<'_, E> {
    #[inline(always)]
    fn run<R: Register>(self) {
        let Decomposition { u, u_adjoint, v: right, v_adjoint, s, folded } = self.dictionary;
        let Parameters { shrink_x, shrink_r, relax } = self.parameters;
        let State { y, w, v, a, d, p, q, product, left } = self.state;
        for _ in 0..self.count {
            // a = 2 X - W,  d = Y - 2 R + V
            if let Some(rows) = self.rows {
                left[..rows.len()].copy_from_slice(rows);
            } else {
                kept(w.part(0), w.part(1), shrink_x, 0.0, left);
            }
            (0..2).for_each(|part| reflect(w.part(part), left, a.part_mut(part)));
            kept(v.part(0), v.part(1), shrink_r, 0.0, left);
            (0..2).for_each(|i| reflect_from(v.part(i), left, y.part(i), d.part_mut(i)));
            // With p = V^H a and q = U^H d: u = a + V alpha, A u = U beta.
            v_adjoint.product::<R>(a, p);
            if *folded {
                fold::<R>(d, product);
                u_adjoint.product::<R>(product, q);
            } else {
                u_adjoint.product::<R>(d, q);
            }
            (0..2).for_each(|part| project(p.part_mut(part), q.part_mut(part), s));
            // W += relax (u - X),  X = (a + W) / 2
            right.product::<R>(p, product);
            (0..2).for_each(|i| advance(w.part_mut(i), a.part(i), product.part(i), relax));
            // V += relax (Y - A u - R),  R = (Y + V - d) / 2
            u.product::<R>(q, product);
            if *folded {
                unfold::<R>(product, d.rows());
            }
            for i in 0..2 {
                advance_from(v.part_mut(i), y.part(i), d.part(i), product.part(i), relax);
            }
        }
    }
}

/// a = 2 `left` w - w.
#[inline(always)]
fn reflect(w: &[f32], left: &[f32], a: &mut [f32]) {
    for ((a, w), left) in a.iter_mut().zip(w).zip(left) {
        *a = (2.0 * left - 1.0) * w;
    }
}

/// d = y - (2 `left` v - v).
#[inline(always)]
fn reflect_from(v: &[f32], left: &[f32], y: &[f32], d: &mut [f32]) {
    for (((d, v), left), y) in d.iter_mut().zip(v).zip(left).zip(y) {
        *d = y - (2.0 * left - 1.0) * v;
    }
}

/// alpha = (s q - s^2 p) / (1 + s^2) in place of p, beta = s (p + s q) / (1 + s^2) in place of q.
#[inline(always)]
fn project(p: &mut [f32], q: &mut [f32], s: &[f32]) {
    for ((p, q), s) in p.iter_mut().zip(q).zip(s) {
        let c = s / (1.0 + s * s);
        (*p, *q) = (c * (*q - s * *p), c * (*p + s * *q));
    }
}

/// w += relax (a/2 - w/2 + z).
#[inline(always)]
fn advance(w: &mut [f32], a: &[f32], z: &[f32], relax: f32) {
    for ((w, a), z) in w.iter_mut().zip(a).zip(z) {
        *w += relax * (0.5 * (a - *w) + z);
    }
}

/// v += relax (y/2 + d/2 - v/2 - z).
#[inline(always)]
fn advance_from(v: &mut [f32], y: &[f32], d: &[f32], z: &[f32], relax: f32) {
    for (((v, y), d), z) in v.iter_mut().zip(y).zip(d).zip(z) {
        *v += relax * (0.5 * (y + d - *v) - z);
    }
}
