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
    /// Orthonormal columns of the centred Jacobian, and its triangular factor.
    q: [[f64; N]; 3],
    r: Matrix3<f64>,
    /// Mean of each column of the Jacobian, by clock term.
    means: [Vector3<f64>; 2],
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
            q: [[0.0; N]; 3],
            r: Matrix3::zeros(),
            means: [Vector3::zeros(); 2],
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
        (clocks, dot(&right[..self.rows], &right[..self.rows]))
    }

    /// Takes the clocks' part out of a right-hand side, and gives it.
    #[inline]
    fn centre(&self, right: &mut [f64; N]) -> Clocks {
        std::array::from_fn(|k| {
            let group = self.groups[k].clone();
            take_out(&mut right[group.clone()], &self.weights[group], self.clock_squares[k])
        })
    }

    /// Factors the Jacobian of the rows `seen`; `None` if its columns depend on each other or a number
    /// is not finite.
    pub fn factor(&mut self, seen: &Rows<N>) -> Option<()> {
        let n = self.rows;
        for row in 0..n {
            let gradient = self.observations.gradient(row, &seen[row]) * self.weights[row];
            for (column, value) in self.q.iter_mut().zip(&gradient) {
                column[row] = *value;
            }
        }
        for k in 0..3 {
            let length = dot(&self.q[k][..n], &self.q[k][..n]).sqrt();
            for (g, group) in self.groups.iter().enumerate() {
                let column = &mut self.q[k][group.clone()];
                self.means[g][k] =
                    take_out(column, &self.weights[group.clone()], self.clock_squares[g]);
            }
            let (before, rest) = self.q.split_at_mut(k);
            let column = &mut rest[0][..n];
            for (j, q) in before.iter().enumerate() {
                self.r[(j, k)] = take_out(column, &q[..n], 1.0);
            }
            let left = dot(column, column).sqrt();
            if !(left > RANK_TOLERANCE * length && left.is_finite()) {
                return None;
            }
            self.r[(k, k)] = left;
            let inverse = 1.0 / left;
            column.iter_mut().for_each(|v| *v *= inverse);
        }
        Some(())
    }

    /// Minimiser of `|J dx - right|` with free clock terms: the step in position and in the clocks.
    #[inline]
    pub fn step(&self, right: &mut [f64; N]) -> (Vector3<f64>, Clocks) {
        let mut clocks = self.centre(right);
        let step = self.position_step(right);
        for (clock, mean) in clocks.iter_mut().zip(&self.means) {
            *clock -= mean.dot(&step);
        }
        (step, clocks)
    }

    /// The same for a right-hand side that is centred, and the position only.
    #[inline]
    pub fn position_step(&self, right: &mut [f64; N]) -> Vector3<f64> {
        let n = self.rows;
        let [x, y, z] = std::array::from_fn(|k| take_out(&mut right[..n], &self.q[k][..n], 1.0));
        let r = &self.r;
        let z = z / r[(2, 2)];
        let y = (y - r[(1, 2)] * z) / r[(1, 1)];
        Vector3::new((x - r[(0, 1)] * y - r[(0, 2)] * z) / r[(0, 0)], y, z)
    }

    /// The same for a step within the plane of two orthonormal columns, by the normal equations of two
    /// unknowns: right to what a start needs.
    pub fn step_within(&self, plane: &Matrix3x2<f64>, right: &mut [f64; N]) -> Vector3<f64> {
        let n = self.rows;
        let projection = Vector3::from_fn(|k, _| take_out(&mut right[..n], &self.q[k][..n], 1.0));
        let inner = self.r * plane;
        let normal = (inner.transpose() * inner).try_inverse().unwrap_or_default();
        plane * (normal * (inner.transpose() * projection))
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
        let inverse = self.r.try_inverse().unwrap_or(Matrix3::repeat(f64::NAN));
        inverse * inverse.transpose()
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

/// Sum of products, in four lanes.
#[inline]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (a4, a1) = a.as_chunks::<4>();
    let (b4, b1) = b.as_chunks::<4>();
    for (a, b) in a4.iter().zip(b4) {
        for k in 0..4 {
            lanes[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a1.iter().zip(b1).map(|(a, b)| a * b).sum();
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]) + rest
}

/// Takes from `v` its part along `q`, of squared length `square`, and gives the factor of `q`.
#[inline]
fn take_out(v: &mut [f64], q: &[f64], square: f64) -> f64 {
    if v.is_empty() {
        return 0.0;
    }
    let part = dot(v, q) / square;
    v.iter_mut().zip(q).for_each(|(v, q)| *v -= part * q);
    part
}
