//! The linearised problem with its clock terms eliminated.
//!
//! Rows are weighted by `1/sigma`. The clock column of each observable is the vector of its weights;
//! taking its part out of the other columns and of the residuals ("centring") eliminates the clock
//! exactly, and is the first stage of modified Gram-Schmidt on `[clock | J | e]`, which is as stable
//! as Householder's QR (Björck 1967). Scales of the columns do not matter. Nothing is allocated: a
//! system of up to `N` rows lives on the stack.

use super::model::LineOfSight;
use super::observations::{Observations, Seen};
use super::outcome::{Failure, State};
use nalgebra::{Matrix3, Matrix3x2, Vector3};
use std::cmp::Ordering;
use std::ops::Range;

/// Largest number of rows that the position solvers take.
pub const MAX_ROWS: usize = 1024;

/// Below this distance, m, a satellite's direction is not defined: no two things in space are as near.
const COINCIDENT_M: f64 = 1.0;
/// A column whose part orthogonal to the columns before it is shorter than this share of its length
/// depends on them: rounding alone leaves about 1e-15.
const RANK_TOLERANCE: f64 = 1e-12;
/// Smallest allowance of the descent tests for rounding, m^2 or (m/s)^2.
const FLOOR: f64 = 1e-13;

/// Clock terms: bias in m, drift in m/s; 0 where not observed.
pub(super) type Clocks = [f64; 2];

/// Predictions of all rows at one place.
pub(super) type Rows<const N: usize> = [Seen; N];

/// Predictions before any place was looked at.
pub(super) const fn unseen<const N: usize>() -> Rows<N> {
    let zero = Vector3::new(0.0, 0.0, 0.0);
    [Seen { sight: LineOfSight { unit: zero, range: 0.0, inverse_range: 0.0 }, value: 0.0 }; N]
}

pub(super) struct System<'a, O, const N: usize> {
    pub observations: &'a O,
    /// Rows of each clock term.
    groups: [Range<usize>; 2],
    rows: usize,
    observed: [f64; N],
    weights: [f64; N],
    /// Squared length of each clock column.
    clock_squares: [f64; 2],
    /// Rows of `[J | e]`; once solved, the orthogonal columns of the centred Jacobian.
    augmented: [[f64; 4]; N],
    /// Unit upper triangular factor of the centred `[J | e]`, and the squared lengths of its columns.
    upper: [[f64; 4]; 3],
    squares: [f64; 3],
    /// What the cost may grow by rounding.
    pub floor: f64,
}

impl<'a, O: Observations, const N: usize> System<'a, O, N> {
    pub fn new(observations: &'a O) -> Result<Self, Failure> {
        let [biased, drifting] = observations.rows();
        let rows = biased + drifting;
        let groups = [0..biased, biased..rows];
        let needed = unknowns(observations);
        if !(needed..=MAX_ROWS.min(N)).contains(&rows) {
            return Err(Failure::Observations { rows, needed });
        }
        if biased > 0 && drifting > 0 && !observations.sigma_known() {
            return Err(Failure::NoDeviation);
        }
        let mut system = Self {
            observations,
            groups: groups.clone(),
            rows,
            observed: [0.0; N],
            weights: [0.0; N],
            clock_squares: [0.0; 2],
            augmented: [[0.0; 4]; N],
            upper: [[0.0; 4]; 3],
            squares: [0.0; 3],
            floor: 0.0,
        };
        for (group, square) in groups.into_iter().zip(&mut system.clock_squares) {
            let (mut largest, mut heaviest) = (0.0f64, 0.0f64);
            for row in group.clone() {
                let (y, weight) = (observations.observed(row), 1.0 / observations.sigma(row));
                if !(weight > 0.0 && weight.is_finite()) {
                    return Err(Failure::NotFinite { row, what: "deviation" });
                }
                (system.observed[row], system.weights[row]) = (y, weight);
                *square += weight * weight;
                (largest, heaviest) = (largest.max(y.abs()), heaviest.max(weight));
            }
            let rounding = group.len() as f64 * (8.0 * f64::EPSILON * largest).powi(2);
            system.floor += rounding.max(FLOOR) * heaviest * heaviest;
        }
        Ok(system)
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Observations beyond those that the unknowns take up.
    pub fn redundancy(&self) -> usize {
        self.rows - unknowns(self.observations)
    }

    /// A place with the clock terms that are observed.
    pub fn state(&self, position_m: Vector3<f64>, clocks: Clocks) -> State {
        let term = |k: usize| (!self.groups[k].is_empty()).then_some(clocks[k]);
        State { position_m, bias_m: term(0), drift_mps: term(1) }
    }

    /// Predicts all rows for a receiver at `position_m`.
    #[inline]
    pub fn see(&self, position_m: &Vector3<f64>, seen: &mut Rows<N>) {
        for (row, seen) in seen[..self.rows].iter_mut().enumerate() {
            *seen = self.observations.see(row, position_m);
        }
    }

    /// Weighted residuals at clock terms, and the sum of their squares.
    #[inline]
    pub fn residuals(&self, seen: &Rows<N>, clocks: &Clocks, right: &mut [f64; N]) -> f64 {
        let mut cost = 0.0;
        for (group, clock) in self.groups.iter().zip(clocks) {
            for row in group.clone() {
                let e = self.weights[row] * (self.observed[row] - seen[row].value - clock);
                right[row] = e;
                cost += e * e;
            }
        }
        cost
    }

    /// Weighted residuals with the best clock terms, these terms, and the sum of the squares.
    #[inline]
    pub fn centred_residuals(&self, seen: &Rows<N>, right: &mut [f64; N]) -> (Clocks, f64) {
        self.residuals(seen, &[0.0; 2], right);
        let clocks = self.centre(right);
        (clocks, right[..self.rows].iter().map(|e| e * e).sum())
    }

    /// Takes the clocks' part out of a right-hand side, and gives it.
    #[inline]
    fn centre(&self, right: &mut [f64; N]) -> Clocks {
        std::array::from_fn(|k| {
            let group = self.groups[k].clone();
            if group.is_empty() {
                return 0.0;
            }
            let (right, weights) = (&mut right[group.clone()], &self.weights[group]);
            let pairs = right.iter().zip(weights);
            let mean = pairs.map(|(e, w)| e * w).sum::<f64>() / self.clock_squares[k];
            right.iter_mut().zip(weights).for_each(|(e, w)| *e -= mean * w);
            mean
        })
    }

    /// Minimiser of `|J dx - right|` for the rows `seen`, with free clock terms: the step in position
    /// and in the clocks. `None` if the columns depend on each other or a number is not finite.
    pub fn step(&mut self, seen: &Rows<N>, right: &[f64; N]) -> Option<(Vector3<f64>, Clocks)> {
        let mut lengths = [0.0; 3];
        for (row, augmented) in self.augmented[..self.rows].iter_mut().enumerate() {
            let gradient = self.observations.gradient(row, &seen[row]) * self.weights[row];
            for (length, g) in lengths.iter_mut().zip(&gradient) {
                *length += g * g;
            }
            *augmented = [gradient.x, gradient.y, gradient.z, right[row]];
        }
        let mut means = [[0.0; 4]; 2];
        for (k, group) in self.groups.iter().enumerate().filter(|(_, group)| !group.is_empty()) {
            let weights = &self.weights[group.clone()];
            let rows = &mut self.augmented[group.clone()];
            let sums = weighted_sum(rows, weights.iter().copied());
            means[k] = sums.map(|s| s / self.clock_squares[k]);
            for (row, weight) in rows.iter_mut().zip(weights) {
                (0..4).for_each(|j| row[j] -= weight * means[k][j]);
            }
        }
        let rows = &mut self.augmented[..self.rows];
        for k in 0..3 {
            let sums = weighted_sum(rows, rows.iter().map(|row| row[k]));
            let square = sums[k];
            if !(square > RANK_TOLERANCE * RANK_TOLERANCE * lengths[k] && square.is_finite()) {
                return None;
            }
            let upper = sums.map(|s| s / square);
            for row in rows.iter_mut() {
                let q = row[k];
                (k + 1..4).for_each(|j| row[j] -= q * upper[j]);
            }
            (self.upper[k], self.squares[k]) = (upper, square);
        }
        let step = self.back_substitute(self.upper.map(|upper| upper[3]));
        let clock =
            |mean: &[f64; 4]| mean[3] - mean[0] * step.x - mean[1] * step.y - mean[2] * step.z;
        let clocks = [clock(&means[0]), clock(&means[1])];
        step.iter().chain(&clocks).all(|v| v.is_finite()).then_some((step, clocks))
    }

    fn back_substitute(&self, [x, y, z]: [f64; 3]) -> Vector3<f64> {
        let [u, v, _] = &self.upper;
        let y = y - v[2] * z;
        Vector3::new(x - u[1] * y - u[2] * z, y, z)
    }

    /// The step in position for another right-hand side of the same rows, centred.
    #[inline]
    pub fn step_again(&self, right: &mut [f64; N]) -> Vector3<f64> {
        self.back_substitute(std::array::from_fn(|k| {
            let pairs = || self.augmented[..self.rows].iter().zip(&*right);
            let part = pairs().map(|(row, e)| row[k] * e).sum::<f64>() / self.squares[k];
            let rows = self.augmented[..self.rows].iter().zip(&mut *right);
            rows.for_each(|(row, e)| *e -= part * row[k]);
            part
        }))
    }

    /// The last step confined to the plane of two orthonormal columns, by the normal equations of two
    /// unknowns: right to what a start needs.
    pub fn step_within(&self, plane: &Matrix3x2<f64>) -> Vector3<f64> {
        let root = self.triangle();
        let projection = Vector3::from_fn(|k, _| self.squares[k].sqrt() * self.upper[k][3]);
        let inner = root * plane;
        let normal = (inner.transpose() * inner).try_inverse().unwrap_or_default();
        plane * (normal * (inner.transpose() * projection))
    }

    /// Triangular factor of the centred Jacobian.
    fn triangle(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|k, j| match k.cmp(&j) {
            Ordering::Less => self.squares[k].sqrt() * self.upper[k][j],
            Ordering::Equal => self.squares[k].sqrt(),
            Ordering::Greater => 0.0,
        })
    }

    /// Second derivatives of the weighted rows along `along`, centred.
    pub fn curvatures(&self, seen: &Rows<N>, along: &Vector3<f64>, right: &mut [f64; N]) {
        for row in 0..self.rows {
            let slope = self.observations.gradient(row, &seen[row]).dot(along);
            right[row] =
                self.weights[row] * self.observations.curvature(row, &seen[row], slope, along);
        }
        self.centre(right);
    }

    /// Covariance of the position from the last factor, m^2.
    pub fn covariance(&self) -> Matrix3<f64> {
        let [[_, a, b, _], [_, _, c, _], _] = self.upper;
        let inverse = Matrix3::new(1.0, -a, a * c - b, 0.0, 1.0, -c, 0.0, 0.0, 1.0);
        let scaled = inverse * Matrix3::from_diagonal(&Vector3::from(self.squares.map(f64::recip)));
        scaled * inverse.transpose()
    }

    /// Why a factor or a step at `state` failed.
    #[cold]
    pub fn diagnose(&self, seen: &Rows<N>, state: State, iterations: usize) -> Failure {
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        for row in 0..self.rows {
            let satellite = self.observations.satellite(row);
            let what = if !self.observed[row].is_finite() {
                "value"
            } else if !finite(&satellite.position_m) {
                "satellite position"
            } else if !finite(&satellite.velocity_mps) && row >= self.groups[1].start {
                "satellite velocity"
            } else {
                continue;
            };
            return Failure::NotFinite { row, what };
        }
        if let Some(row) = self.coincident(seen) {
            return Failure::Coincident { row };
        }
        if self.coplanar(&state.position_m) {
            return Failure::Coplanar;
        }
        Failure::Singular { state, iterations }
    }

    /// A row whose satellite is at the receiver.
    pub fn coincident(&self, seen: &Rows<N>) -> Option<usize> {
        seen[..self.rows].iter().position(|s| s.sight.range < COINCIDENT_M)
    }

    /// Whether all satellites and the place lie in one plane, to a millionth of their distances.
    fn coplanar(&self, place_m: &Vector3<f64>) -> bool {
        let scatter: Matrix3<f64> = (0..self.rows)
            .map(|row| self.observations.satellite(row).position_m - place_m)
            .map(|d| d * d.transpose())
            .sum();
        let spread = scatter.symmetric_eigenvalues();
        spread.min() <= 1e-12 * spread.max()
    }
}

/// Unknowns of a problem: three of position and one for each clock.
pub(super) fn unknowns(observations: &impl Observations) -> usize {
    3 + observations.rows().into_iter().filter(|&rows| rows > 0).count()
}

/// `sum(weight * row)`, column by column.
#[inline]
fn weighted_sum(rows: &[[f64; 4]], weights: impl Iterator<Item = f64>) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for (row, weight) in rows.iter().zip(weights) {
        (0..4).for_each(|j| sum[j] += weight * row[j]);
    }
    sum
}
