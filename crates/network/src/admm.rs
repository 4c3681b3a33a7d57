//! The paper's solver: each node minimises its own sum of squares, consensus is on x itself.
//!
//! Khodabandeh & Teunissen 2019, figure 6. With l the mean of z_s - u_is over the c_i constraint nodes of node i,
//! x_i = (N_i + c_i W)^-1 (r_i + c_i W l). Equations (20) and (23) and the figure print N_i + W, which is wrong
//! wherever c_i > 1: by (19) it is N_i + c_i W. As printed the nodes agree, but on the least-squares solution of
//! normal equations weighted by c_i (see [`PrintedForm`]).

use super::consensus::Proximal;
use super::{NetworkError, Normals};
use nalgebra::{Cholesky, DMatrix, DVector, DVectorView, Dyn};

/// The weight matrix W of the condition that nodes agree.
#[derive(Clone, Debug, PartialEq)]
pub enum Weight {
    /// rho times the identity, rho in the unit of the normal matrix.
    Scalar(f64),
    /// Any symmetric positive matrix, the same at all nodes: a multiple of the mean normal matrix is best.
    Matrix(DMatrix<f64>),
}

impl Weight {
    /// W in p parameters.
    pub(super) fn matrix(&self, p: usize) -> DMatrix<f64> {
        match self {
            Self::Scalar(rho) => DMatrix::identity(p, p) * *rho,
            Self::Matrix(w) => w.clone(),
        }
    }
}

/// A node's own least squares, f_i(x) = 1/2 x' N_i x - r_i' x, by the Cholesky form of equation (21): one
/// factorisation for each change of N_i, two triangular solutions a move.
#[derive(Clone, Debug)]
pub struct NodeLeastSquares {
    normals: Normals,
    /// Of N_i + c_i W.
    factor: Cholesky<f64, Dyn>,
}

impl NodeLeastSquares {
    /// The problem of a node with `constraints` constraint nodes (c_i).
    ///
    /// # Errors
    /// [`NetworkError`] when W has another size, or N_i + c_i W is not positive definite.
    pub fn new(
        normals: Normals,
        weight: &Weight,
        constraints: usize,
    ) -> Result<Self, NetworkError> {
        let factor = factorise(&normals, weight, constraints as f64)?;
        Ok(Self { normals, factor })
    }
}

fn factorise(
    normals: &Normals,
    weight: &Weight,
    c: f64,
) -> Result<Cholesky<f64, Dyn>, NetworkError> {
    let p = normals.parameters();
    let w = weight.matrix(p);
    if w.shape() != (p, p) {
        let what = "the weight matrix".into();
        return Err(NetworkError::WrongSize { what, found: w.nrows(), expected: p });
    }
    (&normals.matrix + w * c).cholesky().ok_or(NetworkError::Singular(p))
}

/// x = l + G (r - N l), the form of (20) that needs neither W nor c once G = (N + c W)^-1 is factored.
fn correct(normals: &Normals, factor: &Cholesky<f64, Dyn>, pull: &[f64], x: &mut [f64]) {
    let l = DVectorView::from_slice(pull, pull.len());
    let mut step: DVector<f64> = &normals.right - &normals.matrix * l;
    factor.solve_mut(&mut step);
    x.iter_mut().zip(pull).zip(&step).for_each(|((x, l), step)| *x = l + step);
}

impl Proximal for NodeLeastSquares {
    fn dimension(&self) -> usize {
        self.normals.parameters()
    }

    fn minimise(&mut self, pull: &[f64], _: usize, x: &mut [f64]) {
        correct(&self.normals, &self.factor, pull, x);
    }
}

/// The update as figure 6 prints it, with N_i + W. It converges to a wrong value; kept to demonstrate that.
#[derive(Clone, Debug)]
pub struct PrintedForm(NodeLeastSquares);

impl PrintedForm {
    /// The problem of a node.
    ///
    /// # Errors
    /// As [`NodeLeastSquares::new`].
    pub fn new(normals: Normals, weight: &Weight) -> Result<Self, NetworkError> {
        NodeLeastSquares::new(normals, weight, 1).map(Self)
    }
}

impl Proximal for PrintedForm {
    fn dimension(&self) -> usize {
        self.0.dimension()
    }

    fn minimise(&mut self, pull: &[f64], constraints: usize, x: &mut [f64]) {
        self.0.minimise(pull, constraints, x);
    }
}

/// The gain G_i of equation (20) of a model A, P in its two forms, (N + c W)^-1 A' P and
/// (c W)^-1 A' (P^-1 + A (c W)^-1 A')^-1: the second inverts a matrix of the observations' size, which is less
/// work where a node has fewer observations than there are parameters.
///
/// # Errors
/// [`NetworkError::Singular`] when W or P has no inverse.
pub fn gain_forms(
    design: &DMatrix<f64>,
    weights: &DMatrix<f64>,
    weight: &Weight,
    constraints: usize,
) -> Result<[DMatrix<f64>; 2], NetworkError> {
    let p = design.ncols();
    let singular = || NetworkError::Singular(p);
    let w = weight.matrix(p) * constraints as f64;
    let normal = design.transpose() * weights * design + &w;
    let first = normal.cholesky().ok_or_else(singular)?.solve(&(design.transpose() * weights));
    let spread = w.cholesky().ok_or_else(singular)?.solve(&design.transpose());
    let covariance = weights.clone().cholesky().ok_or_else(singular)?.inverse();
    let innovation = (covariance + design * &spread).cholesky().ok_or_else(singular)?;
    let second = innovation.solve(&spread.transpose()).transpose();
    Ok([first, second])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_of_the_gain_and_the_cholesky_form_agree() {
        let design = DMatrix::from_fn(5, 3, |i, j| ((3 * i + 7 * j) as f64).sin());
        let weights = [2.0, 0.5, 1.0, 4.0, 0.25];
        let l = DVector::from_fn(5, |i, _| 1.0 + (i as f64).cos());
        let model = crate::LinearModel::independent(design.clone(), l.clone(), &weights);
        let weight = Weight::Matrix(DMatrix::from_fn(3, 3, |i, j| if i == j { 2.0 } else { 0.3 }));
        let [first, second] = gain_forms(&design, &model.weight, &weight, 2).unwrap();
        assert!((&first - &second).amax() < 1e-12);
        let pull = DVector::from_row_slice(&[0.3, -2.0, 5.0]);
        let mut x = [0.0; 3];
        let mut problem = NodeLeastSquares::new(model.normals(), &weight, 2).unwrap();
        problem.minimise(pull.as_slice(), 2, &mut x);
        let expected = &pull + first * (l - design * &pull);
        assert!((DVector::from_row_slice(&x) - expected).amax() < 1e-12);
    }
}
