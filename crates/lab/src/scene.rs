//! The scene of the paper on JANE: a few sources on a linear array, in impulsive noise.
//!
//! Li, Huang, Liu, Feng and Chen, "Acquisition of visible satellites based on antenna arrays via joint
//! l1,1-norms minimization", IEEE TVT 72(5), 2023, section V. Every source has constant modulus and, at each
//! snapshot, a random phase. The paper's SNR is the power p of a source over the variance of the whole
//! mixture, and its eq. (3) makes the modulus sqrt(2 p): 34.35 at its 20 dB.

use faer::Mat;
use num_complex::Complex64;
use sdr_rx::array::CMat;
use sdr_rx::front_end::mixture::Mixture;
use sdr_rx::gnss::random::SplitMix64;
use std::f64::consts::{PI, TAU};

/// Sources, array and noise; the default is the paper's.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Elements, half a wavelength apart.
    pub elements: usize,
    /// Snapshots, columns of Y.
    pub snapshots: usize,
    /// Directions of the sources, deg from broadside.
    pub angles_deg: Vec<f64>,
    /// Modulus of each source at every element.
    pub amplitude: f64,
    /// The distribution of the noise.
    pub noise: Mixture,
}

/// Samples of a scene.
#[derive(Clone, Debug)]
pub struct Snapshots {
    /// Y, elements x snapshots.
    pub y: CMat,
    /// The sources' signals, sources x snapshots, in the order of [`Scene::angles_deg`].
    pub signals: CMat,
}

impl Default for Scene {
    fn default() -> Self {
        let noise = Mixture { probability: 0.1, background: 1.0, impulse: 50.0, real: false };
        let angles_deg = vec![30.0, 28.0, 52.0, 40.0];
        let scene = Self { elements: 50, snapshots: 100, angles_deg, amplitude: 0.0, noise };
        scene.with_snr(20.0)
    }
}

impl Scene {
    /// The same with sources of this SNR (dB): amplitude^2 / 2 over the variance of the mixture.
    pub fn with_snr(mut self, snr_db: f64) -> Self {
        self.amplitude = (2.0 * 10f64.powf(snr_db / 10.0) * self.noise.variance()).sqrt();
        self
    }

    /// Draws the scene. The order of draws is part of the reference: the phases, source by source; then for
    /// each sample (element by element) whether it is an impulse; then the noise in the same order.
    pub fn draw(&self, seed: u64) -> Snapshots {
        let mut rng = SplitMix64::new(seed);
        let (m, n) = (self.elements, self.snapshots);
        let mut signals = Mat::zeros(self.angles_deg.len(), n);
        for q in 0..signals.nrows() {
            for k in 0..n {
                signals[(q, k)] = Complex64::from_polar(self.amplitude, TAU * rng.uniform());
            }
        }
        let impulses: Vec<bool> =
            (0..m * n).map(|_| rng.uniform() < self.noise.probability).collect();
        let mut y = CMat::zeros(m, n);
        for (at, impulse) in impulses.into_iter().enumerate() {
            let variance = if impulse { self.noise.impulse } else { self.noise.background };
            y[(at / n, at % n)] = variance.sqrt() * rng.complex_normal();
        }
        for (q, angle) in self.angles_deg.iter().enumerate() {
            let step = PI * angle.to_radians().sin();
            for k in 0..n {
                for row in 0..m {
                    y[(row, k)] += Complex64::cis(step * row as f64) * signals[(q, k)];
                }
            }
        }
        Snapshots { y, signals }
    }

    /// The true X of `snapshots` on a grid of whole degrees from `first_deg`, `rows` of them; sources that
    /// lie beside the grid are left out.
    pub fn truth_on_degrees(&self, drawn: &Snapshots, first_deg: i32, rows: usize) -> CMat {
        let mut x = CMat::zeros(rows, drawn.signals.ncols());
        for (q, angle) in self.angles_deg.iter().enumerate() {
            let row = angle - f64::from(first_deg);
            if row >= 0.0 && row.fract() == 0.0 && (row as usize) < rows {
                for k in 0..x.ncols() {
                    x[(row as usize, k)] = drawn.signals[(q, k)];
                }
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_is_that_of_the_reference() {
        // Both numbers are by an independent implementation, with all digits it prints.
        let y = Scene { snapshots: 8, ..Scene::default() }.draw(1).y;
        let first = Complex64::new(-67.39606550, 25.15679205);
        assert!((y[(0, 0)] - first).norm() < 1e-8, "{}", y[(0, 0)]);
        let sum: f64 = y.col_iter().flat_map(|c| c.iter()).map(|z| z.norm()).sum();
        assert!((sum - 24307.141336827597).abs() < 1e-7, "{sum}");
    }
}
