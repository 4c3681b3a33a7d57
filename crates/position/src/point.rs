//! The unknowns of a least-squares problem: shared ones, and a term for each clock.

use nalgebra::SVector;
use smallvec::SmallVec;

/// One value for each clock term.
pub(crate) type Terms<T> = SmallVec<[T; 2]>;

/// Shared unknowns and clock terms.
#[derive(Clone, Debug)]
pub(crate) struct Point<const P: usize> {
    pub x: SVector<f64, P>,
    pub clocks: Terms<f64>,
}

impl<const P: usize> Point<P> {
    /// `self + factor * step`.
    #[inline]
    pub fn plus(&self, factor: f64, step: &Self) -> Self {
        let mut sum = self.clone();
        sum.set_plus(self, factor, step);
        sum
    }

    /// Becomes `from + factor * step`, of as many clock terms.
    #[inline]
    pub fn set_plus(&mut self, from: &Self, factor: f64, step: &Self) {
        self.x = from.x + factor * step.x;
        for ((sum, c), dc) in self.clocks.iter_mut().zip(&from.clocks).zip(&step.clocks) {
            *sum = c + factor * dc;
        }
    }

    /// Scalar product.
    pub fn dot(&self, other: &Self) -> f64 {
        let clocks = self.clocks.iter().zip(&other.clocks);
        clocks.fold(self.x.dot(&other.x), |sum, (a, b)| sum + a * b)
    }

    /// Euclidean norm; units of the unknowns are mixed.
    #[inline]
    pub fn norm(&self) -> f64 {
        self.clocks.iter().fold(self.x.norm_squared(), |sum, c| sum + c * c).sqrt()
    }
}
