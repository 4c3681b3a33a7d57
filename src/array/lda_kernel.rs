//! The iteration of LDA-l1,1 on a block of sixteen snapshots.

use super::CMat;
use super::lanes::{LANES, Lane, Packed, inverse_root};
use multiversion::multiversion;

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
        iterate(self, block, steps);
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq+avx2+fma",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
fn iterate(kernel: &Kernel, block: &mut Block, steps: &[f32]) {
    use multiversion::target::target_cfg_f;
    if target_cfg_f!(any(target_feature = "fma", target_arch = "aarch64")) {
        sweep::<true>(kernel, block, steps);
    } else {
        sweep::<false>(kernel, block, steps);
    }
}

#[inline(always)]
fn sweep<const FUSED: bool>(kernel: &Kernel, block: &mut Block, steps: &[f32]) {
    let Kernel { forward, adjoint, gamma, mu } = kernel;
    let Block { y, x, e, lambda } = block;
    for &s in steps {
        adjoint.product::<FUSED>(lambda, |l, g| x[l] = descended(&x[l], g, 1.0, s));
        for (e, lambda) in e.iter_mut().zip(lambda.iter()) {
            *e = descended(e, lambda, *gamma, s);
        }
        forward.product::<FUSED>(x, |m, ax| {
            let (lambda, e, y) = (&mut lambda[m], &e[m], &y[m]);
            for k in 0..LANES {
                lambda.re[k] += mu * (ax.re[k] + gamma * e.re[k] - y.re[k]);
                lambda.im[k] += mu * (ax.im[k] + gamma * e.im[k] - y.im[k]);
            }
        });
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
