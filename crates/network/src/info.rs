//! Consensus on the mean normal equations, which each node then solves itself; faster than consensus on x.
//!
//! The network averages the numbers of (N_i, r_i, l'Pl, degrees of freedom) by the same ADMM, with
//! f_i(a) = 1/2 |a - a_i|^2, W = rho I. The rate of convergence depends on the graph alone, neither on the
//! observations nor on the datum: the best rho and alpha are known beforehand ([`plan`](super::plan)). Every node
//! then has all results of a centre: solution, covariance, and the test of the model. A message holds
//! p (p + 3) / 2 + 2 numbers instead of p, and 15 to 60 times fewer of them are needed.

use super::consensus::Proximal;
use super::{NetworkError, Normals};
use nalgebra::{DMatrix, DVector};

/// Number of numbers in the normal equations of p parameters.
pub fn length(p: usize) -> usize {
    p * (p + 3) / 2 + 2
}

/// The normal equations as numbers to average: the upper triangle of N by columns, r, l'Pl, degrees of freedom.
pub fn pack(normals: &Normals) -> Vec<f64> {
    let p = normals.parameters();
    let columns = (0..p).flat_map(|j| (0..=j).map(move |i| (i, j)));
    let mut numbers: Vec<f64> = columns.map(|index| normals.matrix[index]).collect();
    numbers.extend(normals.right.iter().chain([&normals.squares, &normals.freedom]));
    numbers
}

/// The normal equations of p parameters from these numbers.
///
/// # Errors
/// [`NetworkError::WrongSize`].
pub fn unpack(numbers: &[f64], p: usize) -> Result<Normals, NetworkError> {
    let expected = length(p);
    if numbers.len() != expected {
        let what = "a packet of normal equations".into();
        return Err(NetworkError::WrongSize { what, found: numbers.len(), expected });
    }
    let (triangle, rest) = numbers.split_at(p * (p + 1) / 2);
    let at = |i: usize, j: usize| triangle[j * (j + 1) / 2 + i];
    Ok(Normals {
        matrix: DMatrix::from_fn(p, p, |i, j| at(i.min(j), i.max(j))),
        right: DVector::from_row_slice(&rest[..p]),
        squares: rest[p],
        freedom: rest[p + 1],
    })
}

/// f(a) = 1/2 |a - own|^2: a network of such nodes agrees on the mean of their numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Average {
    /// The node's own numbers; they may change while the network runs.
    pub own: Vec<f64>,
    /// rho, the weight of agreement against the node's own numbers.
    pub rho: f64,
}

impl Proximal for Average {
    fn dimension(&self) -> usize {
        self.own.len()
    }

    fn minimise(&mut self, pull: &[f64], constraints: usize, x: &mut [f64]) {
        let gain = 1.0 / (1.0 + constraints as f64 * self.rho);
        let values = x.iter_mut().zip(pull).zip(&self.own);
        values.for_each(|((x, pull), own)| *x = pull + gain * (own - pull));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unpacking_inverts_packing() {
        let normals = Normals {
            matrix: DMatrix::from_fn(4, 4, |i, j| (i + j) as f64 + (i * j) as f64),
            right: DVector::from_row_slice(&[1.0, -2.0, 3.0, 4.0]),
            squares: 7.0,
            freedom: 9.0,
        };
        let numbers = pack(&normals);
        assert_eq!(numbers.len(), length(4));
        assert_eq!(unpack(&numbers, 4).unwrap(), normals);
        assert!(matches!(unpack(&numbers, 5), Err(NetworkError::WrongSize { .. })));
    }
}
