//! The linearised problem with its clock terms eliminated.
//!
//! Rows are weighted by `1/sigma`. The clock column of each observable is the vector of its weights;
//! taking its part out of the other columns and of the residuals ("centring") eliminates the clock
//! exactly, and is the first stage of modified Gram-Schmidt on `[clock | J | e]`. Nothing is allocated:
//! a system of up to `N` rows lives on the stack.

use super::gram_schmidt::{Triangle, orthogonalise, weighted_sum};
use super::model::LineOfSight;
use super::observations::{Observations, Seen};
use super::outcome::{Failure, State};
use nalgebra::{Matrix3, Matrix3x2, Vector3, Vector5};
use std::ops::Range;

/// Largest number of rows that the position solvers take.
pub const MAX_ROWS: usize = 1024;

/// Below this distance, m, a satellite is taken for the receiver: no two things in space are as near.
const COINCIDENT_M: f64 = 1e3;
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
    /// Observations without the offsets.
    observed: [f64; N],
    weights: [f64; N],
    /// Squared length of each clock column.
    clock_squares: [f64; 2],
    /// Rows of `[J | e]`; once solved, the orthogonal columns of the centred Jacobian.
    augmented: [[f64; 4]; N],
    triangle: Triangle<3, 4>,
    /// First observation of each clock term: taken from all of its rows, so that a large clock term does
    /// not cost digits of the residuals.
    pub offsets: Clocks,
    /// What the cost may grow by rounding.
    pub floor: f64,
    /// Rounding of the cost itself.
    pub rounding: f64,
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
            triangle: Triangle::ZERO,
            offsets: [0.0; 2],
            floor: 0.0,
            rounding: 0.0,
        };
        for (clock, group) in groups.into_iter().enumerate() {
            let offset = group.clone().next().map_or(0.0, |first| observations.observed(first));
            system.offsets[clock] = offset;
            let (mut largest, mut heaviest) = (0.0f64, 0.0f64);
            for row in group.clone() {
                let (y, weight) = (observations.observed(row), 1.0 / observations.sigma(row));
                if !(weight > 0.0 && weight.is_finite()) {
                    return Err(Failure::NotFinite { row, what: "deviation" });
                }
                (system.observed[row], system.weights[row]) = (y - offset, weight);
                system.clock_squares[clock] += weight * weight;
                (largest, heaviest) = (largest.max(y.abs()), heaviest.max(weight));
            }
            let rounding = group.len() as f64 * (8.0 * f64::EPSILON * largest).powi(2);
            system.floor += rounding.max(FLOOR) * heaviest * heaviest;
            system.rounding += rounding * heaviest * heaviest;
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

    /// A place with the clock terms that are observed, from those without the offsets.
    pub fn state(&self, position_m: Vector3<f64>, clocks: Clocks) -> State {
        let term = |k: usize| (!self.groups[k].is_empty()).then(|| clocks[k] + self.offsets[k]);
        State { position_m, bias_m: term(0), drift_mps: term(1) }
    }

    /// Predicts all rows for a receiver at `position_m`.
    #[inline]
    pub fn see(&self, position_m: &Vector3<f64>, seen: &mut Rows<N>) {
        for (row, seen) in seen[..self.rows].iter_mut().enumerate() {
            *seen = self.observations.see(row, position_m);
        }
    }

    /// Clock terms of a state without the offsets; 0 for those that it does not give.
    pub fn clocks(&self, state: &State) -> Clocks {
        let [bias, drift] = self.offsets;
        [state.bias_m.unwrap_or(0.0) - bias, state.drift_mps.unwrap_or(0.0) - drift]
    }

    /// Weighted residuals at clock terms (without the offsets), and the sum of their squares.
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
        self.triangle = orthogonalise(&mut self.augmented[..self.rows], &lengths)?;
        let step = Vector3::from(self.triangle.solve(self.triangle.right(3)));
        let clock =
            |mean: &[f64; 4]| mean[3] - mean[0] * step.x - mean[1] * step.y - mean[2] * step.z;
        let clocks = [clock(&means[0]), clock(&means[1])];
        step.iter().chain(&clocks).all(|v| v.is_finite()).then_some((step, clocks))
    }

    /// By how much the last step would lower the cost if the rows were linear.
    pub fn promise(&self) -> f64 {
        let Triangle { upper, squares } = &self.triangle;
        upper.iter().zip(squares).map(|(row, square)| square * row[3] * row[3]).sum()
    }

    /// The step in position for another right-hand side of the same rows, centred.
    #[inline]
    pub fn step_again(&self, right: &mut [f64; N]) -> Vector3<f64> {
        let parts = std::array::from_fn(|k| {
            let pairs = self.augmented[..self.rows].iter().zip(&*right);
            let part = pairs.map(|(row, e)| row[k] * e).sum::<f64>() / self.triangle.squares[k];
            let rows = self.augmented[..self.rows].iter().zip(&mut *right);
            rows.for_each(|(row, e)| *e -= part * row[k]);
            part
        });
        Vector3::from(self.triangle.solve(parts))
    }

    /// `H^T e` and the diagonal of `H^T H` of the weighted rows, by position and the two clock terms.
    pub fn gradient(&self, seen: &Rows<N>, right: &[f64; N]) -> (Vector5<f64>, Vector5<f64>) {
        let (mut gradient, mut diagonal) = (Vector5::zeros(), Vector5::zeros());
        for (clock, group) in self.groups.iter().enumerate() {
            for row in group.clone() {
                let by_place = self.observations.gradient(row, &seen[row]) * self.weights[row];
                let mut by = Vector5::new(by_place.x, by_place.y, by_place.z, 0.0, 0.0);
                by[3 + clock] = self.weights[row];
                gradient += by * right[row];
                diagonal += by.component_mul(&by);
            }
        }
        (gradient, diagonal)
    }

    /// The last step confined to the plane of two orthonormal columns, by the normal equations of two
    /// unknowns: right to what a start needs.
    pub fn step_within(&self, plane: &Matrix3x2<f64>) -> Vector3<f64> {
        let Triangle { upper, squares } = &self.triangle;
        let unit = Matrix3::from_fn(|k, j| if k <= j { upper[k][j] } else { 0.0 });
        let scale = Matrix3::from_diagonal(&Vector3::from(*squares));
        let inner = unit * plane;
        let normal = (inner.transpose() * scale * inner).try_inverse().unwrap_or_default();
        plane * (normal * (inner.transpose() * scale * Vector3::from(self.triangle.right(3))))
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
        let [[_, a, b, _], [_, _, c, _], _] = self.triangle.upper;
        let weights = Vector3::from(self.triangle.squares.map(f64::recip));
        let inverse = Matrix3::new(1.0, -a, a * c - b, 0.0, 1.0, -c, 0.0, 0.0, 1.0);
        inverse * Matrix3::from_diagonal(&weights) * inverse.transpose()
    }

    /// Why a factor or a step at `state` failed.
    #[cold]
    pub fn diagnose(&self, state: State, iterations: usize) -> Failure {
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        for row in 0..self.rows {
            let satellite = self.observations.satellite(row);
            let what = if !self.observations.observed(row).is_finite() {
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
        if let Some(row) = self.coincident(&state.position_m) {
            return Failure::Coincident { row };
        }
        if self.coplanar(&state.position_m) {
            return Failure::Coplanar;
        }
        Failure::Singular { state, iterations }
    }

    /// A row whose satellite is at the receiver.
    pub fn coincident(&self, place_m: &Vector3<f64>) -> Option<usize> {
        let distance = |row| (self.observations.satellite(row).position_m - place_m).norm();
        (0..self.rows).find(|&row| distance(row) < COINCIDENT_M)
    }

    /// Whether all satellites and the place lie in one plane, to a millionth of their distances.
    fn coplanar(&self, place_m: &Vector3<f64>) -> bool {
        self.scatter(place_m).symmetric_eigenvalues().min() <= self.flat(place_m)
    }

    /// The mirror image of a place in the plane of the satellites, if they lie in one: ranges from there
    /// are the same.
    pub fn mirrored(&self, place_m: &Vector3<f64>) -> Option<Vector3<f64>> {
        let satellite = |row| self.observations.satellite(row).position_m;
        let centre = (0..self.rows).map(satellite).sum::<Vector3<f64>>() / self.rows as f64;
        let scatter = self.scatter(&centre);
        // Far from flat, which is nearly always, the determinant tells it without eigenvalues.
        if scatter.determinant() > 1e-9 * (scatter.trace() / 3.0).powi(3) {
            return None;
        }
        let spread = scatter.symmetric_eigen();
        let least = spread.eigenvalues.imin();
        let normal = spread.eigenvectors.column(least);
        (spread.eigenvalues[least] <= self.flat(&centre))
            .then(|| place_m - normal * (2.0 * normal.dot(&(place_m - centre))))
    }

    /// Sum of the outer products of the satellites' places, seen from one.
    fn scatter(&self, from_m: &Vector3<f64>) -> Matrix3<f64> {
        let satellite = |row| self.observations.satellite(row).position_m - from_m;
        (0..self.rows).map(satellite).map(|d| d * d.transpose()).sum()
    }

    /// Sum of squared distances from a plane, m^2, below which satellites lie in it.
    fn flat(&self, from_m: &Vector3<f64>) -> f64 {
        1e-12 * self.scatter(from_m).trace()
    }
}

/// Unknowns of a problem: three of position and one for each clock.
pub(super) fn unknowns(observations: &impl Observations) -> usize {
    3 + observations.rows().into_iter().filter(|&rows| rows > 0).count()
}
