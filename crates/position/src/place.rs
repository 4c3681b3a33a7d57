//! A position with the clock terms that were solved beside it.

use crate::point::Terms;
use nalgebra::Vector3;

/// A place and the clock terms that belong to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// By the index of a row's term.
    pub(crate) terms: Terms<Option<f64>>,
}

impl Place {
    /// A place, ECEF, m, with no clock term known.
    pub fn at(position_m: Vector3<f64>) -> Self {
        Self { position_m, terms: Terms::new() }
    }

    /// The Earth's centre, with no clock term known.
    pub fn centre() -> Self {
        Self::at(Vector3::zeros())
    }

    /// Bias `c dt` of a clock, m, if ranges by it were observed.
    pub fn bias_m(&self, clock: usize) -> Option<f64> {
        self.terms.get(2 * clock).copied().flatten()
    }

    /// Drift of a clock, m/s, if range rates by it were observed.
    pub fn drift_mps(&self, clock: usize) -> Option<f64> {
        self.terms.get(2 * clock + 1).copied().flatten()
    }

    /// The first clock term that was observed, bias (m) before drift (m/s); 0 if none was.
    pub fn clock(&self) -> f64 {
        self.terms.iter().flatten().next().copied().unwrap_or(0.0)
    }
}
