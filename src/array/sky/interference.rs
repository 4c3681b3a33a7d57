//! Jammers: detected in the covariance, located, and removed before impulses are.
//!
//! The order matters. Under a jammer every sample is strong, so that no map can distinguish impulses from it;
//! once the jammer is removed, it can. A projection spreads each impulse of one element over all; here the
//! jammer's wave is estimated by least squares that weight each element with E[1/variance | residual] of its
//! own mixture (module `front_end::mixture`), on which an impulse has little effect.

use super::Beam;
use crate::array::CMat;
use crate::array::geometry::{Manifold, Point};
use crate::front_end::mixture::{BINS, Mixture, PowerHistogram, bin, middle};
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use sdr_rx_linalg::{hermitian_eigen, orthonormal_basis};

/// An eigenvalue is interference when it is this much over the median one (satellites of 50 dB-Hz on 50
/// elements reach 6 dB).
const MIN_POWER_DB: f64 = 10.0;
/// Samples by which the mixtures are fitted, and the number of fits.
const FIT_SAMPLES: usize = 1 << 15;
const FITS: usize = 3;
/// Reweightings of one sample.
const REWEIGHTINGS: usize = 3;
/// Maximum number of jammers.
const MAX_JAMMERS: usize = 8;
/// Samples of one task.
const TASK: usize = 4096;

/// The subspace that jammers span.
#[derive(Clone, Debug)]
pub struct Interference {
    /// Orthonormal basis, M x J: for beams with nulls on it.
    pub subspace: CMat,
    /// Power of each component over the noise of one element's samples, all elements together, dB.
    pub powers_db: Vec<f64>,
    rows: Vec<[Complex32; MAX_JAMMERS]>,
}

impl Interference {
    /// The eigenvectors whose eigenvalues exceed the median by 10 dB; none in a covariance that is not
    /// finite, and never as many as half of the elements.
    pub fn find(covariance: &CMat) -> Self {
        let elements = covariance.nrows();
        let (values, vectors) =
            hermitian_eigen(covariance).unwrap_or_else(|| (Vec::new(), CMat::zeros(elements, 0)));
        let median = values.get(elements / 2).copied().unwrap_or(0.0);
        let power = |l: &f64| 10.0 * (l / median).log10();
        let all = values.iter().map(power);
        let powers_db: Vec<f64> =
            all.take_while(|db| *db > MIN_POWER_DB).take((elements / 2).min(MAX_JAMMERS)).collect();
        let subspace = CMat::from_fn(elements, powers_db.len(), |m, j| vectors[(m, j)]);
        let single = |z: Complex64| Complex32::new(z.re as f32, z.im as f32);
        let entry =
            |m, j| if j < powers_db.len() { single(subspace[(m, j)]) } else { Complex32::ZERO };
        let rows = (0..elements).map(|m| std::array::from_fn(|j| entry(m, j))).collect();
        Self { subspace, powers_db, rows }
    }

    /// M - J orthonormal beams orthogonal to the jammers: white noise stays white and independent between
    /// them, which does not hold for elements from which jammers were removed.
    pub fn free_beams(&self) -> Vec<Beam> {
        let (elements, count) = self.subspace.shape();
        let all = CMat::from_fn(elements, elements, |m, k| match k.checked_sub(count) {
            None => self.subspace[(m, k)],
            Some(k) => Complex64::from(f64::from(u8::from(m == k))),
        });
        let basis = orthonormal_basis(&all);
        let column = |k: usize| (0..elements).map(|m| basis[(m, k)]).collect::<Vec<_>>();
        (count..elements).map(|k| Beam::new(&column(k))).collect()
    }

    /// Number of components, J.
    pub fn count(&self) -> usize {
        self.powers_db.len()
    }

    /// Whether there is no jammer.
    pub fn is_empty(&self) -> bool {
        self.powers_db.is_empty()
    }

    /// The part of a response orthogonal to the subspace.
    pub fn project(&self, response: &[Complex64]) -> Vec<Complex64> {
        project(&self.subspace, response)
    }

    /// Directions of the jammers, strongest component first: the points whose responses lie in the subspace
    /// best. One after the other, with the responses already found projected away from both (Mosher and
    /// Leahy, IEEE Trans. Signal Processing 47, 1999: RAP-MUSIC). Each comes with the fraction of its
    /// response's power that lies in the subspace: near 1 for a point source.
    pub fn directions(&self, manifold: &Manifold) -> Vec<(Point, f64)> {
        let elements = self.subspace.nrows();
        if manifold.elements() != elements || manifold.dimensions() == 0 {
            return Vec::new();
        }
        let mut found: Vec<(Point, f64)> = Vec::new();
        let mut known = CMat::zeros(elements, 0);
        for _ in 0..self.count() {
            let held = |point: Point| {
                let a = project(&known, &manifold.response(point));
                let norm = power(&a);
                // At a known direction nothing remains of the response.
                if norm < 1e-3 * elements as f64 {
                    return 0.0;
                }
                1.0 - power(&project(&self.subspace, &a)) / norm
            };
            let across =
                8 * if manifold.dimensions() == 1 { elements } else { 8.max(elements / 2) };
            let grid = manifold.grid(across).into_iter().map(|p| (p, held(p)));
            let Some(best) = grid.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            let best = climb(best, 2.0 / across as f64, manifold.dimensions(), held);
            found.push(best);
            let response = project(&known, &manifold.response(best.0));
            let norm = power(&response).sqrt();
            let columns = known.ncols();
            known = CMat::from_fn(elements, columns + 1, |m, k| match k < columns {
                true => known[(m, k)],
                false => response[m] / norm,
            });
        }
        found
    }

    /// Removes the jammers from the samples of all elements in place, and returns the remaining noise of each
    /// element. Does nothing without jammers.
    ///
    /// Cost for each sample: some 4 M J (J + 2) multiply-adds and 4 M table look-ups.
    ///
    /// # Panics
    /// When the channels are not as many as the elements, or differ in length.
    pub fn remove(&self, channels: &mut [&mut [Complex32]]) -> Vec<Mixture> {
        let samples = channels.first().map_or(0, |c| c.len());
        assert!(channels.len() == self.rows.len(), "remove: one channel for each element");
        assert!(channels.iter().all(|c| c.len() == samples), "remove: channels differ in length");
        if self.is_empty() || samples == 0 {
            return Vec::new();
        }
        let step = samples.div_ceil(FIT_SAMPLES);
        let mut noise: Vec<ElementNoise> = Vec::new();
        let mut snapshot = vec![Complex32::ZERO; channels.len()];
        for _ in 0..FITS {
            let mut powers = vec![PowerHistogram::default(); channels.len()];
            for n in (0..samples).step_by(step) {
                snapshot.iter_mut().zip(channels.iter()).for_each(|(x, c)| *x = c[n]);
                self.clean(&mut snapshot, &noise);
                powers.iter_mut().zip(&snapshot).for_each(|(p, x)| p.add(x.norm_sqr()));
            }
            let fits: Option<Vec<Mixture>> =
                powers.iter().map(|p| Mixture::fit(p, false)).collect();
            let Some(fits) = fits else { return Vec::new() };
            noise = fits.into_iter().map(ElementNoise::new).collect();
        }
        let mut pieces: Vec<_> = channels.iter_mut().map(|c| c.chunks_mut(TASK)).collect();
        let tasks: Vec<Vec<&mut [Complex32]>> = (0..samples.div_ceil(TASK))
            .map(|_| pieces.iter_mut().filter_map(Iterator::next).collect())
            .collect();
        tasks.into_par_iter().for_each(|mut piece| {
            let mut snapshot = vec![Complex32::ZERO; piece.len()];
            for n in 0..piece[0].len() {
                snapshot.iter_mut().zip(&piece).for_each(|(x, c)| *x = c[n]);
                self.clean(&mut snapshot, &noise);
                piece.iter_mut().zip(&snapshot).for_each(|(c, x)| c[n] = *x);
            }
        });
        noise.into_iter().map(|element| element.mixture).collect()
    }

    /// Removes the jammers from one snapshot: by projection without `noise`, else reweighted by it.
    fn clean(&self, snapshot: &mut [Complex32], noise: &[ElementNoise]) {
        let count = self.count();
        let remove = |snapshot: &mut [Complex32], wave: &[Complex32; MAX_JAMMERS]| {
            for (x, row) in snapshot.iter_mut().zip(&self.rows) {
                for j in 0..count {
                    *x -= row[j] * wave[j];
                }
            }
        };
        let mut wave = [Complex32::ZERO; MAX_JAMMERS];
        for (x, row) in snapshot.iter().zip(&self.rows) {
            for j in 0..count {
                wave[j] += row[j].conj() * x;
            }
        }
        remove(snapshot, &wave);
        // From here on by what the residual still contains of the jammers under changing weights.
        for _ in 0..if noise.is_empty() { 0 } else { REWEIGHTINGS } {
            let mut normal = [[Complex32::ZERO; MAX_JAMMERS]; MAX_JAMMERS];
            let mut right = [Complex32::ZERO; MAX_JAMMERS];
            for ((x, row), element) in snapshot.iter().zip(&self.rows).zip(noise) {
                let weight = element.weight(x.norm_sqr());
                for j in 0..count {
                    let weighted = row[j].conj() * weight;
                    right[j] += weighted * x;
                    for i in 0..=j {
                        normal[j][i] += weighted * row[i];
                    }
                }
            }
            let Some(wave) = solve(normal, right, count) else { return };
            remove(snapshot, &wave);
        }
    }
}

/// Solves the Hermitian system whose lower triangle is given, by Cholesky's L D L^H.
fn solve(
    mut a: [[Complex32; MAX_JAMMERS]; MAX_JAMMERS],
    mut b: [Complex32; MAX_JAMMERS],
    count: usize,
) -> Option<[Complex32; MAX_JAMMERS]> {
    for j in 0..count {
        let known: f32 = (0..j).map(|k| a[j][k].norm_sqr() * a[k][k].re).sum();
        let pivot = a[j][j].re - known;
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        a[j][j] = Complex32::from(pivot);
        for i in j + 1..count {
            let known: Complex32 = (0..j).map(|k| a[i][k] * a[j][k].conj() * a[k][k].re).sum();
            a[i][j] = (a[i][j] - known) / pivot;
        }
    }
    for j in 0..count {
        let known: Complex32 = (0..j).map(|k| a[j][k] * b[k]).sum();
        b[j] -= known;
    }
    for j in (0..count).rev() {
        let known: Complex32 = (j + 1..count).map(|k| a[k][j].conj() * b[k]).sum();
        b[j] = b[j] / a[j][j].re - known;
    }
    Some(b)
}

/// The noise of one element, and its weights by power.
struct ElementNoise {
    mixture: Mixture,
    weights: Box<[f32]>,
}

impl ElementNoise {
    fn new(mixture: Mixture) -> Self {
        // In units of the background, so that the sums of weights stay near the number of elements.
        let weight = |power: f64| mixture.inverse_variance(power) * mixture.background;
        let weights = (0..BINS)
            .map(|b| Some(middle(b)).filter(|p| p.is_finite()).map_or(0.0, weight) as f32)
            .collect();
        Self { mixture, weights }
    }

    fn weight(&self, power: f32) -> f32 {
        self.weights[bin(power)]
    }
}

/// x without its component in the span of orthonormal columns.
fn project(basis: &CMat, x: &[Complex64]) -> Vec<Complex64> {
    let mut left = x.to_vec();
    for j in 0..basis.ncols() {
        let part: Complex64 = x.iter().enumerate().map(|(m, x)| basis[(m, j)].conj() * x).sum();
        left.iter_mut().enumerate().for_each(|(m, x)| *x -= basis[(m, j)] * part);
    }
    left
}

fn power(x: &[Complex64]) -> f64 {
    x.iter().map(Complex64::norm_sqr).sum()
}

/// Refines a maximum from a grid point of spacing `step` by steps along the axes, halved when none helps.
fn climb(
    start: (Point, f64),
    mut step: f64,
    dimensions: usize,
    value_at: impl Fn(Point) -> f64,
) -> (Point, f64) {
    let mut best = start;
    while step > 1e-7 {
        let mut moved = false;
        for axis in 0..dimensions {
            for sign in [-1.0, 1.0] {
                let mut point = best.0;
                point[axis] += sign * step;
                let value = value_at(point);
                if point[0].hypot(point[1]) <= 1.0 && value > best.1 {
                    best = (point, value);
                    moved = true;
                }
            }
        }
        if !moved {
            step /= 2.0;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::covariance::covariance;
    use crate::gnss::antenna::AntennaArray;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// Noise of the mixture (probability, 1, ratio) and jammers (direction cosine, amplitude) on a linear
    /// array.
    fn jammed(
        elements: usize,
        samples: usize,
        (probability, ratio): (f64, f32),
        jammers: &[(f64, f32)],
    ) -> (Vec<Vec<Complex32>>, Vec<Vec<Complex32>>) {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        let mut normal = |variance: f32| {
            let mut part = || rng.sample::<f32, _>(StandardNormal) * (variance / 2.0).sqrt();
            Complex32::new(part(), part())
        };
        let waves: Vec<Vec<Complex32>> = jammers
            .iter()
            .map(|&(_, amplitude)| (0..samples).map(|_| normal(1.0) * amplitude).collect())
            .collect();
        let mut chance = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        let noise: Vec<Vec<Complex32>> = (0..elements)
            .map(|_| {
                let mut impulse =
                    |_| if chance.random::<f64>() < probability { ratio } else { 1.0 };
                (0..samples).map(|n| normal(impulse(n))).collect()
            })
            .collect();
        let manifold = Manifold::new(AntennaArray::half_wavelength(elements));
        let mut both = noise.clone();
        for (&(s, _), wave) in jammers.iter().zip(&waves) {
            for (channel, a) in both.iter_mut().zip(manifold.response([s, 0.0])) {
                let a = Complex32::new(a.re as f32, a.im as f32);
                channel.iter_mut().zip(wave).for_each(|(x, w)| *x += a * w);
            }
        }
        (noise, both)
    }

    fn slices(channels: &[Vec<Complex32>]) -> Vec<&[Complex32]> {
        channels.iter().map(Vec::as_slice).collect()
    }

    #[test]
    fn jammers_are_counted_measured_and_located() {
        let samples = 40_000;
        let (_, both) = jammed(8, samples, (0.0, 1.0), &[(0.29, 31.6), (-0.5, 100.0)]);
        let found = Interference::find(&covariance(&slices(&both)));
        assert_eq!(found.count(), 2);
        // The two responses correlate to 0.17: the larger eigenvalue is 8 x 10^4 (1 + 0.003) of the noise.
        assert!((found.powers_db[0] - 49.03).abs() < 0.1, "{:?}", found.powers_db);
        let directions = found.directions(&Manifold::new(AntennaArray::half_wavelength(8)));
        let mut cosines: Vec<f64> = directions.iter().map(|d| d.0[0]).collect();
        cosines.sort_by(f64::total_cmp);
        // Stochastic bound: sigma(pi s)^2 = 6 / (T snr M^3): below 2e-5 at 30 dB; five of them.
        assert!((cosines[0] + 0.5).abs() < 1e-4 && (cosines[1] - 0.29).abs() < 1e-4, "{cosines:?}");
        assert!(directions.iter().all(|d| d.1 > 0.999));
        let (_, quiet) = jammed(8, samples, (0.1, 50.0), &[]);
        assert!(Interference::find(&covariance(&slices(&quiet))).is_empty());
    }

    #[test]
    fn under_impulses_the_residual_is_nearer_to_the_noise_than_after_a_projection() {
        let (elements, samples) = (8, 20_000);
        let (noise, both) = jammed(elements, samples, (0.1, 50.0), &[(0.29, 316.0)]);
        let found = Interference::find(&covariance(&slices(&both)));
        let mut cleaned = both.clone();
        let mut channels: Vec<&mut [Complex32]> =
            cleaned.iter_mut().map(Vec::as_mut_slice).collect();
        let left = found.remove(&mut channels);
        // 1/8 of the background is removed along with the jammer, and less where its sample is impulsive.
        for element in left {
            assert!(
                (element.background - 0.87).abs() < 0.06
                    && (element.probability - 0.1).abs() < 0.01,
                "{element:?}"
            );
            assert!((element.impulse / 50.0 - 1.0).abs() < 0.15, "{element:?}");
        }
        let error = |got: &[Vec<Complex32>]| {
            let pairs = got.iter().zip(&noise).flat_map(|(a, b)| a.iter().zip(b));
            pairs.map(|(a, b)| f64::from((a - b).norm_sqr())).sum::<f64>() / samples as f64
        };
        // The error is along the jammer: under known variances v_m of power M / sum(1/v_m), a little over 1
        // (for eight elements without impulses 1, for six 1.3); a projection leaves the mean variance, 5.9.
        // Estimated weights and the error of the subspace (7 x 5.9 / 20000) cost less than half again.
        let mut plain = both.clone();
        for n in 0..samples {
            let mut snapshot: Vec<Complex32> = plain.iter().map(|c| c[n]).collect();
            found.clean(&mut snapshot, &[]);
            plain.iter_mut().zip(snapshot).for_each(|(c, x)| c[n] = x);
        }
        assert!((error(&plain) - 5.9).abs() < 0.3, "{}", error(&plain));
        assert!(error(&cleaned) < 1.7, "{}", error(&cleaned));
    }

    #[test]
    fn the_small_solver_is_accurate_to_rounding() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut entry = || Complex32::new(rng.random::<f32>() - 0.5, rng.random::<f32>() - 0.5);
        let factor: [[Complex32; MAX_JAMMERS]; MAX_JAMMERS] =
            std::array::from_fn(|_| std::array::from_fn(|_| entry()));
        let truth: [Complex32; MAX_JAMMERS] = std::array::from_fn(|_| entry());
        for count in 1..=MAX_JAMMERS {
            let a = |i: usize, k: usize| -> Complex32 {
                let dot: Complex32 =
                    (0..MAX_JAMMERS).map(|l| factor[i][l] * factor[k][l].conj()).sum();
                dot + if i == k { 1.0 } else { 0.0 }
            };
            let matrix = std::array::from_fn(|i| {
                std::array::from_fn(|k| if k <= i { a(i, k) } else { Complex32::ZERO })
            });
            let right = std::array::from_fn(|i| (0..count).map(|k| a(i, k) * truth[k]).sum());
            let x = solve(matrix, right, count).unwrap();
            // The condition number is below 10, a rounding 6e-8.
            assert!((0..count).all(|k| (x[k] - truth[k]).norm() < 1e-5), "{count}");
        }
    }
}
