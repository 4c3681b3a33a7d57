//! Recursive estimation of constant parameters over epochs, with or without forgetting.
//!
//! With the forgetting factor lambda, old observations count lambda times less from one epoch to the next:
//! ```text
//! information form   N <- lambda N + A' P A,   r <- lambda r + A' P l,   x = N^-1 r
//! gain form          Q <- Q / lambda;   K = Q A' (P^-1 + A Q A')^-1;   x <- x + K (l - A x);   Q <- (I - K A) Q
//! ```
//! Both are the same Kalman filter. The second needs all observations at a centre; the first is a sum over
//! nodes, and forgetting commutes with the sum, so that every node runs [`InformationFilter`] on its own
//! observations and the network has only to keep up with its mean ([`InformationFilter::renew_average`]) or
//! with its solution ([`InformationFilter::renew_least_squares`]) by a few iterations an epoch.

use super::admm::{NodeLeastSquares, Weight};
use super::consensus::Node;
use super::info::{Average, pack};
use super::{LinearModel, NetworkError, NetworkSolution, Normals};
use nalgebra::{DMatrix, DVector};

/// All observations so far, in information form: of a node, or of the whole network.
#[derive(Clone, Debug, PartialEq)]
pub struct InformationFilter {
    normals: Normals,
    forgetting: f64,
    length: f64,
}

impl InformationFilter {
    /// A filter without observations.
    ///
    /// # Errors
    /// [`NetworkError::BadSetting`] for a forgetting factor outside (0, 1].
    pub fn new(parameters: usize, forgetting: f64) -> Result<Self, NetworkError> {
        check(forgetting)?;
        Ok(Self { normals: Normals::none(parameters), forgetting, length: 0.0 })
    }

    /// Takes an epoch's normal equations, after having forgotten some of the earlier ones.
    pub fn update(&mut self, epoch: &Normals) {
        self.normals = self.normals.scaled(self.forgetting);
        self.normals.add(epoch);
        self.length = self.forgetting * self.length + 1.0;
    }

    /// The normal equations of all epochs.
    pub fn normals(&self) -> &Normals {
        &self.normals
    }

    /// Effective number of epochs: their number, or with forgetting the sum of lambda^k.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Gives a node of the [`info`](super::info) solver the present state of its own filter. The links' states
    /// stay, so that it goes on from the last solution.
    pub fn renew_average(&self, node: &mut Node<Average>) {
        node.problem.own = pack(&self.normals);
    }

    /// The same for a node of the [`admm`](super::admm) solver with `constraints` constraint nodes (c_i).
    ///
    /// W must grow with the normal equations: it is `rho` times [`length`](Self::length), and the duals u,
    /// which are gradients of f_i over W, shrink by lambda W_before / W_now = 1 - 1 / length.
    ///
    /// # Errors
    /// [`NetworkError::Singular`] when rho is not positive.
    pub fn renew_least_squares(
        &self,
        node: &mut Node<NodeLeastSquares>,
        rho: f64,
        constraints: usize,
    ) -> Result<(), NetworkError> {
        let weight = Weight::Scalar(rho * self.length);
        node.problem = NodeLeastSquares::new(self.normals.clone(), &weight, constraints)?;
        node.rescale_duals(1.0 - 1.0 / self.length);
        Ok(())
    }
}

/// The same filter in gain form, for a centre.
#[derive(Clone, Debug, PartialEq)]
pub struct GainFilter {
    x: DVector<f64>,
    covariance: DMatrix<f64>,
    forgetting: f64,
}

impl GainFilter {
    /// Starts from a prior, or from the solution of the first epoch.
    ///
    /// # Errors
    /// [`NetworkError::BadSetting`] for a forgetting factor outside (0, 1].
    pub fn new(start: &NetworkSolution, forgetting: f64) -> Result<Self, NetworkError> {
        check(forgetting)?;
        Ok(Self { x: start.x.clone(), covariance: start.covariance.clone(), forgetting })
    }

    /// Takes the observations of an epoch, one receiver after the other, after having forgotten some of the
    /// earlier ones.
    ///
    /// # Errors
    /// [`NetworkError::WrongSize`] for a model of other parameters, [`NetworkError::Singular`] for invalid
    /// weights.
    pub fn update(&mut self, epoch: &[LinearModel]) -> Result<(), NetworkError> {
        let p = self.x.len();
        self.covariance /= self.forgetting;
        for model in epoch {
            let (a, weight) = (&model.design, &model.weight);
            if a.ncols() != p {
                let what = "a receiver's model".into();
                return Err(NetworkError::WrongSize { what, found: a.ncols(), expected: p });
            }
            // K' = (I + P A Q A')^-1 P A Q, which does without the inverse of P: none exists where a
            // parameter of the receiver was eliminated.
            let gained = weight * a * &self.covariance;
            let m = a.nrows();
            let innovation = DMatrix::identity(m, m) + &gained * a.transpose();
            let gain = innovation.lu().solve(&gained).ok_or(NetworkError::Singular(p))?.transpose();
            self.x += &gain * (&model.observations - a * &self.x);
            self.covariance -= &gain * a * &self.covariance;
            // Rounding must not make it asymmetric.
            self.covariance = (&self.covariance + self.covariance.transpose()) * 0.5;
        }
        Ok(())
    }

    /// The estimate.
    pub fn estimate(&self) -> &DVector<f64> {
        &self.x
    }

    /// Its covariance.
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }
}

fn check(forgetting: f64) -> Result<(), NetworkError> {
    if forgetting > 0.0 && forgetting <= 1.0 {
        return Ok(());
    }
    let range = "above 0 and at most 1";
    Err(NetworkError::BadSetting { name: "forgetting factor", value: forgetting, range })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_effective_number_of_epochs_is_a_geometric_sum() {
        let one = Normals { freedom: 1.0, ..Normals::none(2) };
        let mut filter = InformationFilter::new(2, 0.9).unwrap();
        (0..5).for_each(|_| filter.update(&one));
        let sum: f64 = (0..5).map(|k| 0.9f64.powi(k)).sum();
        assert!((filter.length() - sum).abs() < 1e-14);
        assert!((filter.normals().freedom - sum).abs() < 1e-14);
        for wrong in [0.0, 1.1, f64::NAN] {
            assert!(InformationFilter::new(2, wrong).is_err());
        }
    }
}
