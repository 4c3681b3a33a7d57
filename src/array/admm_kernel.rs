//! The iteration of the splitting of [`l1_admm`](super::l1_admm) on a block of sixteen snapshots.

use super::lanes::{LANES, Lane, Packed};
use multiversion::multiversion;

/// What all blocks share: the dictionary as U S V^H, and the parameters.
pub struct Kernel<'a> {
    /// V^H, V, U^H and U.
    pub v_adjoint: &'a Packed,
    /// V.
    pub v: &'a Packed,
    /// U^H.
    pub u_adjoint: &'a Packed,
    /// U.
    pub u: &'a Packed,
    /// The singular values.
    pub s: &'a [f32],
    /// gamma rho and rho: by how much X and the residual are shrunk.
    pub shrink_x: f32,
    /// rho.
    pub shrink_r: f32,
    /// Relaxation.
    pub relax: f32,
}

/// The state of sixteen snapshots, and room to work in.
#[derive(Clone)]
pub struct Block {
    /// Y.
    pub y: Vec<Lane>,
    /// W, whose shrinkage is X.
    pub w: Vec<Lane>,
    /// V, whose shrinkage is the residual.
    pub v: Vec<Lane>,
    a: Vec<Lane>,
    d: Vec<Lane>,
    p: Vec<Lane>,
    q: Vec<Lane>,
}

impl Block {
    /// A block that starts from zero: L rows of X, rank r.
    pub fn new(y: Vec<Lane>, l: usize, rank: usize) -> Self {
        let zero = |rows: usize| vec![Lane::ZERO; rows];
        let m = y.len();
        Self { y, w: zero(l), v: zero(m), a: zero(l), d: zero(m), p: zero(rank), q: zero(rank) }
    }
}

impl Kernel<'_> {
    /// So many iterations. With `kept`, the factor that each row of W is given in place of the shrinkage of
    /// each of its entries: then one iteration at a time.
    pub fn iterate(&self, block: &mut Block, count: usize, kept: Option<&[f32]>) {
        iterate(self, block, count, kept);
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq+avx2+fma",
    "x86_64+avx2+fma",
    "aarch64+neon"
))]
fn iterate(kernel: &Kernel, block: &mut Block, count: usize, kept: Option<&[f32]>) {
    use multiversion::target::target_cfg_f;
    if target_cfg_f!(any(target_feature = "fma", target_arch = "aarch64")) {
        sweep::<true>(kernel, block, count, kept);
    } else {
        sweep::<false>(kernel, block, count, kept);
    }
}

#[inline(always)]
fn sweep<const FUSED: bool>(
    kernel: &Kernel,
    block: &mut Block,
    count: usize,
    kept: Option<&[f32]>,
) {
    let Kernel { v_adjoint, v: right, u_adjoint, u: left, s, shrink_x, shrink_r, relax } = kernel;
    let Block { y, w, v, a, d, p, q } = block;
    for _ in 0..count {
        // a = 2 X - W,  d = Y - 2 R + V
        for (row, (a, w)) in a.iter_mut().zip(w.iter()).enumerate() {
            *a = match kept {
                Some(kept) => w.mix(2.0 * kept[row] - 1.0, w, 0.0),
                None => w.shrunk(*shrink_x).mix(2.0, w, -1.0),
            };
        }
        for ((d, v), y) in d.iter_mut().zip(v.iter()).zip(y.iter()) {
            let r = v.shrunk(*shrink_r);
            for k in 0..LANES {
                d.re[k] = y.re[k] + v.re[k] - 2.0 * r.re[k];
                d.im[k] = y.im[k] + v.im[k] - 2.0 * r.im[k];
            }
        }
        v_adjoint.product::<FUSED>(a, |i, z| p[i] = *z);
        u_adjoint.product::<FUSED>(d, |i, z| q[i] = *z);
        for ((p, q), s) in p.iter_mut().zip(q.iter_mut()).zip(*s) {
            let c = s / (1.0 + s * s);
            let (alpha, beta) = (p.mix(-s * c, q, c), p.mix(c, q, c * s));
            (*p, *q) = (alpha, beta);
        }
        // W += relax (u - X) with u = a + V alpha, X = (a + W) / 2
        right.product::<FUSED>(p, |i, z| {
            for k in 0..LANES {
                w[i].re[k] += relax * (0.5 * (a[i].re[k] - w[i].re[k]) + z.re[k]);
                w[i].im[k] += relax * (0.5 * (a[i].im[k] - w[i].im[k]) + z.im[k]);
            }
        });
        // V += relax (Y - A u - R) with A u = U beta, R = (Y + V - d) / 2
        left.product::<FUSED>(q, |i, z| {
            for k in 0..LANES {
                v[i].re[k] += relax * (0.5 * (y[i].re[k] + d[i].re[k] - v[i].re[k]) - z.re[k]);
                v[i].im[k] += relax * (0.5 * (y[i].im[k] + d[i].im[k] - v[i].im[k]) - z.im[k]);
            }
        });
    }
}
