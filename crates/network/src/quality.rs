//! Quality control without a centre: the test of the whole model, and a test of each observation.
//!
//! Both are exact at a node that has the network's solution x with its covariance Q (solver `info` or `tree`),
//! because the covariance of all observations is block diagonal, a block a receiver (Baarda 1968; Teunissen,
//! Testing theory, 2006). Of receiver i, with A, P, l its [`LinearModel`]:
//! ```text
//! v = P (l - A x),   D = P - P A Q A' P  (the covariance of v),   w_j = v_j / sqrt(D_jj)
//! T = sum over receivers of l'Pl - r'x
//! ```
//! Where the model holds, T is chi-square of the network's degrees of freedom and each w_j is standard normal. A
//! bias of size b in observation j shifts w_j by b sqrt(D_jj): the smallest that is found with a given power is
//! its *minimal detectable bias* (MDB). T needs one more averaged number, which [`info`](super::info) has.

use super::{LinearModel, NetworkSolution};
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// False-alarm probabilities, and the power of the minimal detectable bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Levels {
    /// Probability that the test of the whole model rejects a network without faults.
    pub model: f64,
    /// Probability that the test of an observation rejects one without fault.
    pub observation: f64,
    /// Probability that a bias of the minimal detectable size is found.
    pub power: f64,
}

impl Default for Levels {
    /// 1 %, 0.1 %, 80 %: Baarda's.
    fn default() -> Self {
        Self { model: 0.01, observation: 0.001, power: 0.8 }
    }
}

impl Levels {
    /// Critical value of |w| of one observation.
    pub fn observation_limit(&self) -> f64 {
        two_sided(self.observation)
    }

    /// Critical value of the largest |w| of a whole network, at the level of the test of the model: for as many
    /// independent ones as there are degrees of freedom (Sidak).
    pub fn largest_limit(&self, freedom: f64) -> f64 {
        two_sided(-((-self.model).ln_1p() / freedom.max(1.0)).exp_m1())
    }

    /// Shift of w by a minimal detectable bias: 4.13 with the default levels. (The other side of the test is
    /// left out: 1e-13 there.)
    pub fn shift(&self) -> f64 {
        self.observation_limit() + Normal::standard().inverse_cdf(self.power)
    }
}

/// The absolute value that a standard normal variable exceeds with this probability.
fn two_sided(probability: f64) -> f64 {
    -Normal::standard().inverse_cdf(0.5 * probability)
}

/// The test of the whole model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelTest {
    /// T, the weighted sum of squared residuals of all receivers.
    pub statistic: f64,
    /// Degrees of freedom.
    pub freedom: f64,
    /// Critical value of T, exceeded with the probability of a false alarm; infinite without degrees of freedom.
    pub limit: f64,
}

impl ModelTest {
    /// The test of a solution, at a level.
    pub fn new(solution: &NetworkSolution, level: f64) -> Self {
        let NetworkSolution { misfit: statistic, freedom, .. } = *solution;
        let distribution = ChiSquared::new(freedom).ok().filter(|_| freedom > 0.5);
        let limit = distribution.map_or(f64::INFINITY, |d| d.inverse_cdf(1.0 - level));
        Self { statistic, freedom, limit }
    }

    /// Whether the model is rejected.
    pub fn rejects(&self) -> bool {
        self.statistic > self.limit
    }
}

/// The tests of the observations of one receiver.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalTests {
    /// v = P (l - A x).
    pub residuals: DVector<f64>,
    /// D, the covariance of v.
    pub covariance: DMatrix<f64>,
    /// Below this part of P_jj, D_jj is rounding: the observation is not checked by any other.
    checked: Vec<bool>,
}

/// See [`LocalTests::checked`]: far above rounding, far below any redundancy that is of use.
const UNCHECKED: f64 = 1e-9;
/// Distance from 1 of the correlation of two statistics that no test distinguishes.
const INDISTINGUISHABLE: f64 = 1.0 - 1e-9;

impl LocalTests {
    /// The tests of a receiver's model with the network's solution.
    pub fn new(model: &LinearModel, solution: &NetworkSolution) -> Self {
        let misfit = &model.observations - &model.design * &solution.x;
        let gain = &model.weight * &model.design;
        let covariance = &model.weight - &gain * &solution.covariance * gain.transpose();
        let enough = |j: usize| covariance[(j, j)] > UNCHECKED * model.weight[(j, j)];
        let checked = (0..model.observations.len()).map(enough).collect();
        Self { residuals: &model.weight * misfit, covariance, checked }
    }

    /// w_j of each observation; 0 for one that nothing checks.
    pub fn statistics(&self) -> Vec<f64> {
        let w = |j: usize| self.residuals[j] / self.covariance[(j, j)].sqrt();
        (0..self.checked.len()).map(|j| if self.checked[j] { w(j) } else { 0.0 }).collect()
    }

    /// The minimal detectable bias of each observation, in its unit; infinite for one that nothing checks.
    pub fn minimal_detectable(&self, levels: &Levels) -> Vec<f64> {
        let shift = levels.shift();
        let bias = |j: usize| shift / self.covariance[(j, j)].sqrt();
        (0..self.checked.len())
            .map(|j| if self.checked[j] { bias(j) } else { f64::INFINITY })
            .collect()
    }

    /// The observation of the largest |w| (the first of equal ones) with it; `None` when nothing is checked.
    pub fn worst(&self) -> Option<(usize, f64)> {
        let w = self.statistics();
        let largest = w.iter().map(|w| w.abs()).fold(0.0, f64::max);
        let worst = w.iter().position(|w| w.abs() >= INDISTINGUISHABLE * largest);
        worst.filter(|_| largest > 0.0).map(|worst| (worst, largest))
    }

    /// The observations that no test distinguishes from this one, itself included: both satellites of a receiver
    /// with two in view have the same |w|.
    pub fn indistinguishable(&self, of: usize) -> Vec<usize> {
        let d = &self.covariance;
        let same = |&j: &usize| {
            let product = d[(j, j)] * d[(of, of)];
            j == of || (self.checked[j] && d[(j, of)].powi(2) >= INDISTINGUISHABLE * product)
        };
        (0..self.checked.len()).filter(same).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Datum, Normals};

    #[test]
    fn limits_are_those_of_the_closed_forms() {
        let levels = Levels::default();
        // Tables of the normal distribution: 3.29053 at 0.1 % two-sided, 0.84162 at 80 %.
        assert!((levels.observation_limit() - 3.290_53).abs() < 1e-5);
        assert!((levels.shift() - 4.132_15).abs() < 1e-5);
        assert!((levels.largest_limit(1.0) - 2.575_83).abs() < 1e-5);
        // The tail of chi-square of two degrees of freedom is exp(-T/2).
        let none = DMatrix::zeros(1, 1);
        let solution = |freedom| NetworkSolution {
            x: DVector::zeros(1),
            covariance: none.clone(),
            misfit: 9.3,
            freedom,
        };
        let test = ModelTest::new(&solution(2.0), 0.01);
        assert!((test.limit + 2.0 * 0.01f64.ln()).abs() < 1e-8 && test.rejects());
        assert!(!ModelTest::new(&solution(0.0), 0.01).rejects());
    }

    #[test]
    fn observations_of_one_number_are_tested_by_their_distance_from_the_mean() {
        let l = DVector::from_row_slice(&[1.0, 2.0, 0.5, 7.0]);
        let sigma: f64 = 0.5;
        let design = DMatrix::from_element(4, 1, 1.0);
        let model = LinearModel::independent(design, l.clone(), &[1.0 / sigma.powi(2); 4]);
        let solution = model.normals().solve(Datum::Observed).unwrap();
        let tests = LocalTests::new(&model, &solution);
        let spread = sigma * (1.0 - 0.25f64).sqrt();
        for (w, l_j) in tests.statistics().iter().zip(&l) {
            assert!((w - (l_j - l.mean()) / spread).abs() < 1e-12);
        }
        // A bias b moves the residual by 3/4 b, whose standard deviation is sigma sqrt(3/4).
        let bias = tests.minimal_detectable(&Levels::default())[0];
        assert!((bias - Levels::default().shift() * sigma / 0.75f64.sqrt()).abs() < 1e-12);
        assert_eq!((tests.worst().map(|w| w.0), tests.indistinguishable(3)), (Some(3), vec![3]));
    }

    #[test]
    fn two_satellites_of_a_receiver_are_indistinguishable_and_one_alone_is_not_checked() {
        let see = |satellites: &[usize], l: &[f64]| {
            let row = |k: usize, j: usize| if satellites[k] == j { 1.0 } else { 0.0 };
            let design = DMatrix::from_fn(satellites.len(), 3, row);
            let l = DVector::from_row_slice(l);
            LinearModel::with_receiver_bias(design, l, &vec![2.0; satellites.len()])
        };
        let models =
            [see(&[0, 1], &[0.0, 1.0]), see(&[0, 1], &[5.0, 8.0]), see(&[1, 2], &[0.0, 0.0])];
        let mut sum = Normals::none(3);
        models.iter().for_each(|model| sum.add(&model.normals()));
        let solution = sum.solve(Datum::ZeroMean).unwrap();
        let first = LocalTests::new(&models[0], &solution);
        assert_eq!((first.worst().map(|w| w.0), first.indistinguishable(0)), (Some(0), vec![0, 1]));
        // Satellite 2 is tied to the others by the third receiver alone.
        let third = LocalTests::new(&models[2], &solution);
        assert_eq!((third.statistics(), third.worst()), (vec![0.0, 0.0], None));
        assert!(third.minimal_detectable(&Levels::default())[0].is_infinite());
    }
}
