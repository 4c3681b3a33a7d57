//! The rows of a position problem: what was observed of which satellites, with which deviation.

use super::model::{Clock, Doppler, LineOfSight, ObservationModel, Pseudorange, Satellite};
use nalgebra::Vector3;
use std::marker::PhantomData;

/// Standard deviation of observations, m or m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sigma<'a> {
    /// Not known: rows weigh the same, and no residual test can be made.
    Unknown,
    /// The same for all.
    Same(f64),
    /// One for each.
    Each(&'a [f64]),
}

/// Observations of one kind: `values[i]` (m or m/s) is of `satellites[i]`.
#[derive(Clone, Copy, Debug)]
pub struct Observed<'a, M> {
    satellites: &'a [Satellite],
    values: &'a [f64],
    sigma: Sigma<'a>,
    model: PhantomData<M>,
}

/// Pseudoranges and Dopplers together, each with its clock term; they need not be of the same
/// satellites or instants. Their deviations must be known, as metres and metres per second are summed.
#[derive(Clone, Copy, Debug)]
pub struct Both<'a> {
    /// The pseudoranges.
    pub pseudoranges: Observed<'a, Pseudorange>,
    /// The Dopplers.
    pub dopplers: Observed<'a, Doppler>,
}

/// A prediction at a place, with what its derivatives share with it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Line of sight to the satellite.
    pub sight: LineOfSight,
    /// Predicted value without clock, m or m/s.
    pub value: f64,
}

/// Rows `0..rows()[0] + rows()[1]` of a position problem, those with a clock bias before those with a
/// clock drift. Implemented by [`Observed`] and [`Both`].
pub trait Observations {
    /// Numbers of rows that contain the clock's bias and its drift.
    fn rows(&self) -> [usize; 2];
    /// Satellite of a row.
    fn satellite(&self, row: usize) -> &Satellite;
    /// Observation of a row, m or m/s.
    fn observed(&self, row: usize) -> f64;
    /// Its standard deviation; 1 if unknown.
    fn sigma(&self, row: usize) -> f64;
    /// Whether the deviations of all rows are known.
    fn sigma_known(&self) -> bool;
    /// Prediction for a receiver at rest at `receiver_m` (ECEF).
    fn see(&self, row: usize, receiver_m: &Vector3<f64>) -> Seen;
    /// Gradient of the prediction by the receiver's position.
    fn gradient(&self, row: usize, seen: &Seen) -> Vector3<f64>;
    /// Second derivative along `along` (m), from `slope`, the gradient along it.
    fn curvature(&self, row: usize, seen: &Seen, slope: f64, along: &Vector3<f64>) -> f64;
}

impl<'a, M: ObservationModel> Observed<'a, M> {
    /// Observations of unknown deviation. Surplus satellites or values, when one list is longer, are
    /// not used.
    pub fn new(satellites: &'a [Satellite], values: &'a [f64]) -> Self {
        let n = satellites.len().min(values.len());
        let (satellites, values) = (&satellites[..n], &values[..n]);
        Self { satellites, values, sigma: Sigma::Unknown, model: PhantomData }
    }

    /// The same with deviations.
    ///
    /// # Panics
    /// If the deviations given one by one are fewer than the observations.
    #[must_use]
    pub fn with_sigma(self, sigma: Sigma<'a>) -> Self {
        if let Sigma::Each(each) = sigma {
            assert!(each.len() >= self.values.len(), "fewer deviations than observations");
        }
        Self { sigma, ..self }
    }
}

impl<M: ObservationModel> Observations for Observed<'_, M> {
    #[inline]
    fn rows(&self) -> [usize; 2] {
        match M::CLOCK {
            Clock::Bias => [self.values.len(), 0],
            Clock::Drift => [0, self.values.len()],
        }
    }

    #[inline]
    fn satellite(&self, row: usize) -> &Satellite {
        &self.satellites[row]
    }

    #[inline]
    fn observed(&self, row: usize) -> f64 {
        self.values[row]
    }

    #[inline]
    fn sigma(&self, row: usize) -> f64 {
        match self.sigma {
            Sigma::Unknown => 1.0,
            Sigma::Same(sigma) => sigma,
            Sigma::Each(each) => each[row],
        }
    }

    fn sigma_known(&self) -> bool {
        self.sigma != Sigma::Unknown
    }

    #[inline]
    fn see(&self, row: usize, receiver_m: &Vector3<f64>) -> Seen {
        let satellite = &self.satellites[row];
        let sight = LineOfSight::new(satellite, receiver_m);
        Seen { sight, value: M::value(satellite, &sight) }
    }

    #[inline]
    fn gradient(&self, row: usize, seen: &Seen) -> Vector3<f64> {
        M::gradient(&self.satellites[row], &seen.sight, seen.value)
    }

    #[inline]
    fn curvature(&self, _: usize, seen: &Seen, slope: f64, along: &Vector3<f64>) -> f64 {
        M::curvature(&seen.sight, seen.value, slope, along)
    }
}

impl Both<'_> {
    /// The row among the Dopplers, if it is one.
    #[inline]
    fn doppler(&self, row: usize) -> Option<usize> {
        row.checked_sub(self.pseudoranges.values.len())
    }
}

impl Observations for Both<'_> {
    #[inline]
    fn rows(&self) -> [usize; 2] {
        [self.pseudoranges.values.len(), self.dopplers.values.len()]
    }

    #[inline]
    fn satellite(&self, row: usize) -> &Satellite {
        match self.doppler(row) {
            Some(row) => self.dopplers.satellite(row),
            None => self.pseudoranges.satellite(row),
        }
    }

    #[inline]
    fn observed(&self, row: usize) -> f64 {
        match self.doppler(row) {
            Some(row) => self.dopplers.observed(row),
            None => self.pseudoranges.observed(row),
        }
    }

    #[inline]
    fn sigma(&self, row: usize) -> f64 {
        match self.doppler(row) {
            Some(row) => self.dopplers.sigma(row),
            None => self.pseudoranges.sigma(row),
        }
    }

    fn sigma_known(&self) -> bool {
        self.pseudoranges.sigma_known() && self.dopplers.sigma_known()
    }

    #[inline]
    fn see(&self, row: usize, receiver_m: &Vector3<f64>) -> Seen {
        match self.doppler(row) {
            Some(row) => self.dopplers.see(row, receiver_m),
            None => self.pseudoranges.see(row, receiver_m),
        }
    }

    #[inline]
    fn gradient(&self, row: usize, seen: &Seen) -> Vector3<f64> {
        match self.doppler(row) {
            Some(row) => self.dopplers.gradient(row, seen),
            None => self.pseudoranges.gradient(row, seen),
        }
    }

    #[inline]
    fn curvature(&self, row: usize, seen: &Seen, slope: f64, along: &Vector3<f64>) -> f64 {
        match self.doppler(row) {
            Some(row) => self.dopplers.curvature(row, seen, slope, along),
            None => self.pseudoranges.curvature(row, seen, slope, along),
        }
    }
}
