//! Whole code periods of a snapshot as a lattice search, and how likely wrong ones pass by chance.
//!
//! The Dopplers predict place and time with covariance `P`; each code phase is known but for a common bias
//! and a whole number of periods `L` = c x 1 ms. Differences against one satellite remove the bias: with the
//! gradients `G` of the ranges' differences by place and time and the noise `S` of the code phases,
//!
//! ```text
//! z = observed - predicted difference + L N,   cov z = M = G P G' + S,   Q(N) = z' M^-1 z
//! ```
//!
//! `Q(N)` is what the integers `N` add to the cost of the Dopplers. All `N` with `Q <= R^2` are found depth
//! first along a pivoted `M = L D L'` (Fincke and Pohst 1985; the smallest conditional variance first, so
//! that the tree is narrow at its root).
//!
//! **Chance.** Where place or time are wrong, the n = m - 1 differences modulo L are uniform on the torus
//! `[0, L)^n`. Those which some `N` lets pass fill at most the volume of the ellipsoid `Q <= R^2`, so that
//!
//! ```text
//! P(passes by chance) <= V_n R^n sqrt(det M) / L^n,   V_n = pi^(n/2) / Gamma(n/2 + 1)
//! ```
//!
//! whatever the number of integers tried: ellipsoids about different lattice points can only overlap. A
//! search over hypotheses adds these numbers up (union bound).
//!
//! An alias is nearer: half a sidereal day later, with the longitude turned by 180 degrees, the ranges are
//! the same but for what the orbits do not repeat, which is some `s` per satellite. With differences drawn
//! from N(0, M + s^2 (I + 1 1')), whose density is nowhere above that at 0,
//!
//! ```text
//! P(alias passes) <= V_n R^n sqrt(det M) / sqrt((2 pi)^n det(M + s^2 (I + 1 1')))
//! ```

use super::coarse_time::{CODE_PERIOD_M, CoarseFix};
use crate::epoch::sighting::Sighting;
use nalgebra::{DMatrix, Vector3};

/// Nodes of the tree that are looked at, and integers that are given, at most.
const MOST_NODES: usize = 200_000;
const MOST_INTEGERS: usize = 400;

/// What the Dopplers predict of the code phases.
pub(super) struct Prediction {
    /// The satellite that the others are counted against: the highest.
    reference: usize,
    /// The others, as indices of the set.
    others: Vec<usize>,
    /// Observed minus predicted differences, m.
    z: Vec<f64>,
    /// Covariance of these by region and noise, m^2.
    covariance: DMatrix<f64>,
    /// Greatest second-order term of a range's prediction at one deviation, m.
    curvature_m: f64,
    /// Bias that fits the reference, m.
    pub bias_m: f64,
}

impl Prediction {
    /// From the region that the Dopplers of `set` leave.
    pub fn new(set: &[Sighting], region: &CoarseFix) -> Self {
        let elevation = |k: &usize| region.predictions[*k].elevation;
        let reference =
            (0..set.len()).max_by(|a, b| elevation(a).total_cmp(&elevation(b))).unwrap_or(0);
        let others: Vec<usize> = (0..set.len()).filter(|&k| k != reference).collect();
        let observed = super::code_phases(set);
        let offset = |k: usize| observed[k] - region.predictions[k].range_m;
        let variance = |k: usize| {
            set[k].observation.range_sigma_m.powi(2) + region.predictions[k].range_sigma_m.powi(2)
        };
        let gradient = |k: usize| {
            let predicted = &region.predictions[k];
            let g = -predicted.direction;
            [g.x, g.y, g.z, predicted.range_rate(&Vector3::zeros(), 0.0)]
        };
        let p = region.covariance;
        let base = gradient(reference);
        let g = DMatrix::from_fn(others.len(), 4, |i, j| gradient(others[i])[j] - base[j]);
        let mut covariance = &g * p * g.transpose();
        covariance.add_scalar_mut(variance(reference));
        for (i, &k) in others.iter().enumerate() {
            covariance[(i, i)] += variance(k);
        }
        // A range bends by d^2/2 rho, the ground by d^2/2 R_E, a range over time by half its acceleration.
        let place_variance = p.trace() - p[(3, 3)];
        let curvature_m = place_variance / 1e7 + 0.1 * p[(3, 3)];
        let bias_m = offset(reference);
        let z = others.iter().map(|&k| offset(k) - bias_m).collect();
        Self { reference, others, z, covariance, curvature_m, bias_m }
    }

    /// Bound on the probability that code phases of nothing add no more than `cost`.
    pub fn chance(&self, cost: f64) -> f64 {
        self.volume(cost, self.others.len() as f64 * CODE_PERIOD_M.ln()).min(1.0)
    }

    /// Bound on the probability that those of another place and time do, from where the ranges differ by
    /// `spread_m` for each satellite.
    pub fn chance_of_alias(&self, cost: f64, spread_m: f64) -> f64 {
        let mut covariance = self.covariance.clone();
        covariance.add_scalar_mut(spread_m * spread_m);
        for k in 0..self.others.len() {
            covariance[(k, k)] += spread_m * spread_m;
        }
        let log_circle = self.others.len() as f64 * std::f64::consts::TAU.ln() / 2.0;
        self.volume(cost, log_circle + half_log_det(covariance)).min(1.0)
    }

    /// Volume of the ellipsoid `Q <= cost` in units of one given by its logarithm.
    fn volume(&self, cost: f64, log_volume: f64) -> f64 {
        let n = self.others.len();
        let radius = n as f64 / 2.0 * cost.max(0.0).ln();
        (log_ball(n) + radius + half_log_det(self.covariance.clone()) - log_volume).exp()
    }

    /// Whole periods of each satellite of the set (0 for the reference) that add at most `cost`, the
    /// likeliest first. Where the region is wide, what linearisation may be off is added to the noise.
    pub fn integers(&self, cost: f64) -> Vec<Vec<i32>> {
        let mut covariance = self.covariance.clone();
        let bend = cost * self.curvature_m;
        for k in 0..self.others.len() {
            covariance[(k, k)] += bend * bend;
        }
        let (order, factor, pivots) = factor(covariance);
        let mut search = Search {
            z: order.iter().map(|&k| self.z[k]).collect(),
            factor,
            pivots,
            limit: cost,
            innovations: vec![0.0; order.len()],
            integers: vec![0; order.len()],
            nodes: 0,
            found: Vec::new(),
        };
        search.descend(0, 0.0);
        search.found.sort_by(|a, b| a.0.total_cmp(&b.0));
        search.found.truncate(MOST_INTEGERS);
        let whole = |(_, integers): (f64, Vec<i32>)| {
            let mut whole = vec![0; self.others.len() + 1];
            for (&k, n) in order.iter().zip(integers) {
                whole[self.others[k]] = n;
            }
            debug_assert_eq!(whole[self.reference], 0);
            whole
        };
        search.found.into_iter().map(whole).collect()
    }
}

/// `ln V_n`: volume of the unit ball in n dimensions, by `V_n = 2 pi / n V_(n-2)`.
fn log_ball(n: usize) -> f64 {
    match n {
        0 => 0.0,
        1 => 2f64.ln(),
        _ => log_ball(n - 2) + (std::f64::consts::TAU / n as f64).ln(),
    }
}

/// `ln sqrt(det M)`.
fn half_log_det(m: DMatrix<f64>) -> f64 {
    factor(m).2.iter().map(|d| d.ln()).sum::<f64>() / 2.0
}

/// `M = L D L'` with the smallest pivot first: order of the rows, unit lower `L`, diagonal of `D`.
fn factor(mut m: DMatrix<f64>) -> (Vec<usize>, DMatrix<f64>, Vec<f64>) {
    let n = m.nrows();
    let mut order: Vec<usize> = (0..n).collect();
    let mut pivots = Vec::with_capacity(n);
    for k in 0..n {
        let pivot = (k..n).min_by(|&a, &b| m[(a, a)].total_cmp(&m[(b, b)])).unwrap_or(k);
        m.swap_rows(k, pivot);
        m.swap_columns(k, pivot);
        order.swap(k, pivot);
        let d = m[(k, k)].max(f64::MIN_POSITIVE);
        pivots.push(d);
        for i in k + 1..n {
            let share = m[(i, k)] / d;
            for j in k + 1..=i {
                let reduced = m[(i, j)] - share * m[(k, j)];
                m[(i, j)] = reduced;
                m[(j, i)] = reduced;
            }
            m[(i, k)] = share;
        }
    }
    (order, m, pivots)
}

/// The search tree: level k chooses the periods of the k-th satellite in the order of the pivots.
struct Search {
    z: Vec<f64>,
    factor: DMatrix<f64>,
    pivots: Vec<f64>,
    limit: f64,
    innovations: Vec<f64>,
    integers: Vec<i32>,
    nodes: usize,
    found: Vec<(f64, Vec<i32>)>,
}

impl Search {
    fn descend(&mut self, level: usize, cost: f64) {
        if level == self.z.len() {
            self.found.push((cost, self.integers.clone()));
            return;
        }
        let known: f64 = (0..level).map(|k| self.factor[(level, k)] * self.innovations[k]).sum();
        let centre = self.z[level] - known;
        let reach = ((self.limit - cost) * self.pivots[level]).max(0.0).sqrt();
        let (first, last) = ((-reach - centre) / CODE_PERIOD_M, (reach - centre) / CODE_PERIOD_M);
        for whole in first.ceil() as i32..=last.floor() as i32 {
            self.nodes += 1;
            if self.nodes > MOST_NODES {
                return;
            }
            let innovation = centre + f64::from(whole) * CODE_PERIOD_M;
            self.innovations[level] = innovation;
            self.integers[level] = whole;
            self.descend(level + 1, cost + innovation * innovation / self.pivots[level]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Seven satellites, a region of tens of kilometres in four dimensions, code noise of `noise_m`.
    fn prediction(noise_m: f64, rng: &mut ChaCha8Rng) -> Prediction {
        let mut normal = || -> f64 { StandardNormal.sample(&mut *rng) };
        let g = DMatrix::from_fn(6, 4, |_, axis| [3e4, 2e4, 4e3, 1e4][axis] * normal());
        let mut covariance = &g * g.transpose();
        covariance.add_scalar_mut(noise_m * noise_m);
        for k in 0..6 {
            covariance[(k, k)] += noise_m * noise_m;
        }
        Prediction {
            reference: 0,
            others: (1..7).collect(),
            z: vec![0.0; 6],
            covariance,
            curvature_m: 0.0,
            bias_m: 0.0,
        }
    }

    /// The mean number of lattice points in an ellipsoid thrown at random is its volume in cells of the
    /// lattice, whatever its shape: the search must find them all, and the bound is that number.
    #[test]
    fn random_code_phases_pass_as_often_as_the_bound_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (mut passed, mut expected, mut squares) = (0.0, 0.0, 0.0);
        for _ in 0..40 {
            let mut prediction = prediction(8e3, &mut rng);
            for _ in 0..2000 {
                prediction.z.fill_with(|| rng.random_range(0.0..CODE_PERIOD_M));
                let sets = prediction.integers(25.0);
                assert!(sets.iter().all(|n| n[0] == 0 && n.len() == 7));
                passed += sets.len() as f64;
                squares += (sets.len() as f64).powi(2);
                expected += prediction.volume(25.0, 6.0 * CODE_PERIOD_M.ln());
            }
        }
        println!("{passed} passed, {expected} expected");
        // Counts of several points in one ellipsoid are not independent: their own squares say how much
        // the sum varies. Four deviations.
        assert!((passed - expected).abs() < 4.0 * squares.sqrt(), "{passed} {expected}");
        assert!(expected > 100.0, "a test of nothing");
    }

    /// Pseudoranges off by 500 m for each satellite, noise of 15 m: the bound holds.
    #[test]
    fn aliases_pass_no_more_often_than_their_bound() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let (spread_m, cost) = (500.0, 12.0);
        let (mut passed, mut bound) = (0.0, 0.0);
        for _ in 0..40 {
            let mut prediction = prediction(15.0, &mut rng);
            let mut covariance = prediction.covariance.clone();
            covariance.add_scalar_mut(spread_m * spread_m);
            (0..6).for_each(|k| covariance[(k, k)] += spread_m * spread_m);
            let root = covariance.cholesky().unwrap().unpack();
            for _ in 0..500 {
                let normal = nalgebra::DVector::from_fn(6, |_, _| StandardNormal.sample(&mut rng));
                prediction.z = (&root * normal).as_slice().to_vec();
                passed += prediction.integers(cost).len() as f64;
                bound += prediction.chance_of_alias(cost, spread_m);
            }
        }
        println!("{passed} passed, {bound} at most");
        assert!(passed > 50.0, "a test of nothing");
        // Four deviations of a count.
        assert!(passed < bound + 4.0 * passed.sqrt(), "{passed} {bound}");
    }
}
