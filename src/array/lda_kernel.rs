//! The iteration of LDA-l1,1 on a block of sixteen snapshots.

use super::CMat;
use super::lanes::{LANES, Lane, Packed, Sweep, dispatch, inverse_root};

/// What all blocks share.
pub struct Kernel {
    /// A, and its adjoint.
    forward: Packed,
    adjoint: Packed,
    gamma: f32,
    mu: f32,
}

/// The state of sixteen snapshots.
#[derive(Clone)]
pub struct Block {
    /// Y.
    pub y: Vec<Lane>,
    /// X, the upper part of Z.
    pub x: Vec<Lane>,
    /// E, the lower.
    pub e: Vec<Lane>,
    /// Lam.
    pub lambda: Vec<Lane>,
}

impl Kernel {
    /// For a dictionary, gamma and mu.
    pub fn new(a: &CMat, gamma: f32, mu: f32) -> Self {
        let (m, l) = (a.nrows(), a.ncols());
        let forward = Packed::new(m, l, |r, c| a[(r, c)]);
        let adjoint = Packed::new(l, m, |r, c| a[(c, r)].conj());
        Self { forward, adjoint, gamma, mu }
    }

    /// One iteration for each of these steps s_k.
    pub fn iterate(&self, block: &mut Block, steps: &[f32]) {
        dispatch(Iterations { kernel: self, block, steps });
    }
}

struct Iterations<'a> {
    kernel: &'a Kernel,
    block: &'a mut Block,
    steps: &'a [f32],
}

impl Sweep for Iterations<'_> {
    #[inline(always)]
    fn run<const FUSED: bool, const WIDTH: usize>(self) {
        let Kernel { forward, adjoint, gamma, mu } = self.kernel;
        let Block { y, x, e, lambda } = self.block;
        for &s in self.steps {
            adjoint.product::<FUSED, WIDTH>(lambda, |l, g| x[l] = descended(&x[l], g, 1.0, s));
            for (e, lambda) in e.iter_mut().zip(lambda.iter()) {
                *e = descended(e, lambda, *gamma, s);
            }
            forward.product::<FUSED, WIDTH>(x, |m, ax| {
                let (lambda, e, y) = (&mut lambda[m], &e[m], &y[m]);
                for k in 0..LANES {
                    lambda.re[k] += mu * (ax.re[k] + gamma * e.re[k] - y.re[k]);
                    lambda.im[k] += mu * (ax.im[k] + gamma * e.im[k] - y.im[k]);
                }
            });
        }
    }
}

/// z - s (z / (2 |z|) + `weight` g).
#[inline(always)]
fn descended(z: &Lane, g: &Lane, weight: f32, s: f32) -> Lane {
    let power = z.power();
    let mut out = Lane::ZERO;
    for k in 0..LANES {
        let keep = 1.0 - 0.5 * s * inverse_root(power[k]);
        out.re[k] = keep * z.re[k] - s * weight * g.re[k];
        out.im[k] = keep * z.im[k] - s * weight * g.im[k];
    }
    out
}
