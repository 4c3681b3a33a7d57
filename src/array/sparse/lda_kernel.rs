//! The iteration of LDA-l1,1 on a block of sixteen snapshots.

use super::lanes::{Block, LANES, Packed, kept};
use super::register::{Register, Sweep, dispatch};
use crate::array::CMat;

/// The constants common to all blocks.
pub struct Kernel {
    forward: Packed<[f32; 2]>,
    adjoint: Packed<[f32; 2]>,
    gamma: f32,
    mu: f32,
}

/// The state of sixteen snapshots, and work space.
pub(super) struct State {
    y: Block,
    /// X, the upper part of Z.
    pub x: Block,
    e: Block,
    /// Lam.
    pub lambda: Block,
    product: Block,
    left: Vec<f32>,
}

impl State {
    /// The state of Y, Z = \[X; E\] and Lam.
    pub fn new(y: Block, x: Block, e: Block, lambda: Block) -> Self {
        let rows = x.rows().max(e.rows());
        Self { y, x, e, lambda, product: Block::zeros(rows), left: vec![0.0; rows * LANES] }
    }
}

impl Kernel {
    /// For a dictionary A, gamma and mu.
    pub fn new(a: &CMat, gamma: f32, mu: f32) -> Self {
        let (m, l) = (a.nrows(), a.ncols());
        let forward = Packed::new(m, l, |r, c| a[(r, c)]);
        let adjoint = Packed::new(l, m, |r, c| a[(c, r)].conj());
        Self { forward, adjoint, gamma, mu }
    }

    /// One iteration for each of these steps s_k.
    pub fn iterate(&self, state: &mut State, steps: &[f32]) {
        dispatch(Iterations { kernel: self, state, steps });
    }
}

struct Iterations<'a> {
    kernel: &'a Kernel,
    state: &'a mut State,
    steps: &'a [f32],
}

impl Sweep for Iterations<'_> {
    #[inline(always)]
    fn run<R: Register>(self) {
        let &Kernel { ref forward, ref adjoint, gamma, mu } = self.kernel;
        let State { y, x, e, lambda, product, left } = self.state;
        for &s in self.steps {
            adjoint.product::<R>(lambda, product);
            descend(x, product, 1.0, s, left);
            descend(e, lambda, gamma, s, left);
            forward.product::<R>(x, product);
            for part in 0..2 {
                ascend(
                    lambda.part_mut(part),
                    product.part(part),
                    e.part(part),
                    y.part(part),
                    gamma,
                    mu,
                );
            }
        }
    }
}

/// z <- z - s (z / (2 |z|) + `weight` g).
#[inline(always)]
fn descend(z: &mut Block, g: &Block, weight: f32, s: f32, left: &mut [f32]) {
    kept(z.part(0), z.part(1), 0.5 * s, f32::NEG_INFINITY, left);
    for part in 0..2 {
        move_down(z.part_mut(part), g.part(part), left, s * weight);
    }
}

#[inline(always)]
fn move_down(z: &mut [f32], g: &[f32], left: &[f32], step: f32) {
    for ((z, g), left) in z.iter_mut().zip(g).zip(left) {
        *z = left * *z - step * g;
    }
}

/// lambda <- lambda + mu (A x + gamma e - y).
#[inline(always)]
fn ascend(lambda: &mut [f32], ax: &[f32], e: &[f32], y: &[f32], gamma: f32, mu: f32) {
    for (((lambda, ax), e), y) in lambda.iter_mut().zip(ax).zip(e).zip(y) {
        *lambda += mu * (ax + gamma * e - y);
    }
}
