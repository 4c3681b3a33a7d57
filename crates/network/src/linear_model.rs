//! Observations of one receiver: a linear(ised) model of the common parameters, and its normal equations.

use super::NetworkError;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A receiver's observations l = A x + e of the p common parameters x.
///
/// Parameters of the receiver alone (its clock, its bias) are eliminated by the weight matrix, which is then
/// singular: it weights the remainder of l after their projection. See [`LinearModel::with_receiver_bias`].
#[derive(Clone, Debug, PartialEq)]
pub struct LinearModel {
    /// Design matrix A, m x p.
    pub design: DMatrix<f64>,
    /// Observations l, m.
    pub observations: DVector<f64>,
    /// Weight matrix P, m x m, positive semidefinite: the inverse of the observations' covariance where no
    /// parameter was eliminated.
    pub weight: DMatrix<f64>,
    /// Parameters of the receiver alone that the weight matrix has eliminated.
    pub eliminated: usize,
}

impl LinearModel {
    /// Uncorrelated observations of these weights and of no parameter but the common ones.
    pub fn independent(design: DMatrix<f64>, observations: DVector<f64>, weights: &[f64]) -> Self {
        let weight = DMatrix::from_diagonal(&DVector::from_row_slice(weights));
        Self { design, observations, weight, eliminated: 0 }
    }

    /// Uncorrelated observations of these weights with one common unknown of the receiver alone:
    /// P = diag(w) - w w' / sum(w), which equals the weights of differences between satellites whatever the
    /// difference operator D (equation (26) of Khodabandeh & Teunissen 2019, without D and without inverse).
    pub fn with_receiver_bias(
        design: DMatrix<f64>,
        observations: DVector<f64>,
        weights: &[f64],
    ) -> Self {
        let w = DVector::from_row_slice(weights);
        let sum = w.sum();
        let mut weight = DMatrix::from_diagonal(&w);
        if sum > 0.0 {
            weight -= &w * w.transpose() / sum;
        }
        Self { design, observations, weight, eliminated: 1 }
    }

    /// The normal equations.
    pub fn normals(&self) -> Normals {
        let weighted = &self.weight * &self.observations;
        let observed = self.observations.len();
        Normals {
            matrix: self.design.transpose() * &self.weight * &self.design,
            right: self.design.transpose() * &weighted,
            squares: self.observations.dot(&weighted),
            freedom: observed.saturating_sub(self.eliminated) as f64,
        }
    }

    /// The model without its k-th observation, which stays with weight zero, so that indices do not change.
    ///
    /// The weights of the others grow together by the elimination of the receiver's own parameters:
    /// P - P e e' P / (e' P e), the weight matrix given that nothing is known of the k-th observation.
    pub fn without(&self, k: usize) -> Self {
        let mut model = self.clone();
        let (column, own) = (self.weight.column(k).into_owned(), self.weight[(k, k)]);
        if own > 0.0 {
            model.weight -= &column * column.transpose() / own;
            model.eliminated += 1;
        }
        model.weight.row_mut(k).fill(0.0);
        model.weight.column_mut(k).fill(0.0);
        model
    }
}

/// Normal equations N x = r of one receiver, of several, or of all: they add.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// N = A' P A, p x p.
    pub matrix: DMatrix<f64>,
    /// r = A' P l, p.
    pub right: DVector<f64>,
    /// l' P l, for the test of the model.
    pub squares: f64,
    /// Observations less the receiver's own parameters, for the test of the model.
    pub freedom: f64,
}

impl Normals {
    /// Those without observations.
    pub fn none(parameters: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(parameters, parameters),
            right: DVector::zeros(parameters),
            squares: 0.0,
            freedom: 0.0,
        }
    }

    /// Number of parameters, p.
    pub fn parameters(&self) -> usize {
        self.right.len()
    }

    /// Adds another receiver's.
    pub fn add(&mut self, other: &Self) {
        self.matrix += &other.matrix;
        self.right += &other.right;
        self.squares += other.squares;
        self.freedom += other.freedom;
    }

    /// The same, all multiplied by a factor.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            matrix: &self.matrix * factor,
            right: &self.right * factor,
            squares: self.squares * factor,
            freedom: self.freedom * factor,
        }
    }

    /// The least-squares solution of these normal equations, with its covariance.
    ///
    /// # Errors
    /// [`NetworkError::Singular`].
    pub fn solve(&self, datum: Datum) -> Result<NetworkSolution, NetworkError> {
        let p = self.parameters();
        let singular = || NetworkError::Singular(p);
        let factor = datum.factor(&self.matrix).ok_or_else(singular)?;
        let x = factor.solve(&self.right);
        let mut covariance = factor.inverse();
        if datum == Datum::ZeroMean {
            // The inverse of N + s 1 1' is the pseudo-inverse of N plus 1 1' / (s p^2).
            let spread = 1.0 / (datum.stiffness(&self.matrix) * (p * p) as f64);
            covariance.add_scalar_mut(-spread);
        }
        let solution = NetworkSolution {
            misfit: self.squares - self.right.dot(&x),
            freedom: self.freedom - (p - datum.defect()) as f64,
            x,
            covariance,
        };
        solution.x.iter().all(|x| x.is_finite()).then_some(solution).ok_or_else(singular)
    }
}

/// Condition on the parameters where the observations do not determine a common constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Datum {
    /// None: the observations determine all parameters.
    #[default]
    Observed,
    /// The parameters' mean is zero: the free datum, where all receivers have eliminated a bias of their own.
    ZeroMean,
}

impl Datum {
    /// Number of parameters that the observations do not determine.
    pub fn defect(self) -> usize {
        usize::from(self == Self::ZeroMean)
    }

    /// The weight of the condition that the mean be zero: of the order of the others.
    fn stiffness(self, matrix: &DMatrix<f64>) -> f64 {
        let p = matrix.nrows() as f64;
        matrix.trace() / (p * p)
    }

    /// The Cholesky factor of N with the datum's condition added; `None` where it is singular: a diagonal
    /// element of the factor lost 13 of its digits.
    fn factor(self, matrix: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
        let mut fixed = matrix.clone();
        if self == Self::ZeroMean {
            fixed.add_scalar_mut(self.stiffness(matrix));
        }
        let factor = fixed.clone().cholesky()?;
        let kept = |k: usize| factor.l_dirty()[(k, k)].powi(2) > 1e-13 * fixed[(k, k)];
        (0..matrix.nrows()).all(kept).then_some(factor)
    }
}

/// A least-squares solution.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkSolution {
    /// The parameters.
    pub x: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// The weighted sum of squared residuals: chi-square of `freedom` degrees where the model holds.
    pub misfit: f64,
    /// Degrees of freedom.
    pub freedom: f64,
}

impl NetworkSolution {
    /// The standard deviation of each parameter.
    pub fn sigma(&self) -> DVector<f64> {
        self.covariance.diagonal().map(|variance| variance.max(0.0).sqrt())
    }
}
