//! A position problem: rows of what was observed, and their predictions with first and second derivatives.
//!
//! With `u = (s - r)/rho` the unit vector from receiver `r` to satellite `s`, `rho` the range, `v` the
//! satellite's velocity, all in the Earth-fixed frame, where the receiver stands still:
//!
//! | row | `h(r)` | gradient by `r` | second derivative along `D` |
//! | --- | --- | --- | --- |
//! | range, m | `rho + b` | `-u` | `(q - p^2)/rho` |
//! | range rate `-lambda D`, m/s | `u.v + d` | `(u (u.v) - v)/rho` | `2 h1 p/rho - (u.v)(q - p^2)/rho^2` |
//!
//! `p = u.D`, `q = |D|^2`, `h1` the gradient along `D`. Bias `b` and drift `d` of the row's clock enter
//! linearly: a problem has three unknowns of position and one for each clock term that its rows contain.

use crate::least_squares::{Buffer, LeastSquares, LinearRow};
use crate::place::Place;
use crate::point::Point;
use crate::point::Terms;
use crate::solver::failure::Failure;
use nalgebra::{Matrix3, Vector3};

/// A satellite, as the geometry needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Satellite {
    /// Position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Velocity, m/s, ECEF; not used by ranges.
    pub velocity_mps: Vector3<f64>,
}

/// What is observed of a satellite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RowKind {
    /// Pseudorange, m: range and clock bias `c dt`.
    Range,
    /// Doppler as range rate `-lambda D`, m/s: range rate and clock drift `c d(dt)/dt`.
    RangeRate,
}

/// One observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The satellite, at the time of transmission.
    pub satellite: Satellite,
    /// What was observed of it.
    pub kind: RowKind,
    /// The observation, m or m/s.
    pub value: f64,
    /// Its standard deviation, m or m/s; without, rows weigh the same and no residual test can be made.
    pub sigma: Option<f64>,
    /// Which of the problem's clocks it contains, from 0: satellite systems that keep different times need
    /// a clock each. Its bias belongs to ranges, its drift to range rates.
    pub clock: usize,
}

impl Row {
    /// An observation, m or m/s, of unknown standard deviation, by the only clock.
    pub fn new(kind: RowKind, satellite: Satellite, value: f64) -> Self {
        Self { satellite, kind, value, sigma: None, clock: 0 }
    }

    /// A pseudorange, m.
    pub fn range(satellite: Satellite, value: f64) -> Self {
        Self::new(RowKind::Range, satellite, value)
    }

    /// A range rate, m/s.
    pub fn range_rate(satellite: Satellite, value: f64) -> Self {
        Self::new(RowKind::RangeRate, satellite, value)
    }

    /// The same with its standard deviation, m or m/s.
    #[must_use]
    pub fn with_sigma(self, sigma: f64) -> Self {
        Self { sigma: Some(sigma), ..self }
    }

    /// Index of its clock term among those of all clocks: the bias of each comes before its drift.
    pub(crate) fn term(&self) -> usize {
        2 * self.clock + usize::from(self.kind == RowKind::RangeRate)
    }
}

/// A satellite seen from a receiver: a prediction, with what its derivatives share with it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Unit vector from receiver to satellite, ECEF.
    unit: Vector3<f64>,
    /// Inverse of their distance, 1/m.
    inverse_range: f64,
    /// Predicted observation but for the receiver's clock, m or m/s.
    pub value: f64,
}

impl Seen {
    /// Rate of the range rate for a receiver at rest, m/s^2, from the satellite's acceleration and velocity, of
    /// a prediction of the range rate.
    pub(crate) fn acceleration(&self, acceleration: &Vector3<f64>, velocity: &Vector3<f64>) -> f64 {
        let across = velocity.norm_squared() - self.value * self.value;
        self.unit.dot(acceleration) + across * self.inverse_range
    }
}

impl RowKind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Range, Self::RangeRate];

    /// Predicts for a receiver at rest at `receiver_m` (ECEF); not finite where satellite and receiver
    /// coincide.
    #[inline]
    pub fn see(self, satellite: &Satellite, receiver_m: &Vector3<f64>) -> Seen {
        let los = satellite.position_m - receiver_m;
        let range = los.norm();
        let inverse_range = 1.0 / range;
        let unit = los * inverse_range;
        let value = match self {
            Self::Range => range,
            Self::RangeRate => unit.dot(&satellite.velocity_mps),
        };
        Seen { unit, inverse_range, value }
    }

    /// Gradient of the prediction by the receiver's position.
    #[inline]
    pub fn gradient(self, satellite: &Satellite, seen: &Seen) -> Vector3<f64> {
        match self {
            Self::Range => -seen.unit,
            Self::RangeRate => {
                (seen.unit * seen.value - satellite.velocity_mps) * seen.inverse_range
            }
        }
    }

    /// Second derivative of the prediction along `along` (m), from `slope`, the gradient along it.
    #[inline]
    pub fn curvature(self, seen: &Seen, slope: f64, along: &Vector3<f64>) -> f64 {
        match self {
            Self::Range => (along.norm_squared() - slope * slope) * seen.inverse_range,
            Self::RangeRate => {
                let p = seen.unit.dot(along);
                let turned = (along.norm_squared() - p * p) * seen.inverse_range;
                (2.0 * slope * p - seen.value * turned) * seen.inverse_range
            }
        }
    }
}

/// Below this distance, m, a satellite is taken for the receiver: no two things in space are as near.
const COINCIDENT_M: f64 = 1e3;
/// Smallest allowance of the descent tests for rounding, m^2 or (m/s)^2.
const FLOOR: f64 = 1e-13;

/// Rows that were checked, weighted by `1/sigma`.
pub(crate) struct Problem<'a> {
    pub rows: &'a [Row],
    pub weights: Buffer<f64>,
    /// First observation of each clock term: taken from all of its rows, so that a large clock term does
    /// not cost digits of the residuals. None where no row has the term.
    offsets: Terms<Option<f64>>,
    /// Observations without the offsets.
    observed: Buffer<f64>,
    pub sigma_known: bool,
    /// What the cost may grow by rounding.
    pub floor: f64,
    /// Rounding of the cost itself.
    pub rounding: f64,
}

impl<'a> Problem<'a> {
    pub fn new(rows: &'a [Row]) -> Result<Self, Failure> {
        if let Some(row) = rows.iter().position(|row| row.clock >= rows.len()) {
            return Err(Failure::Clock { row });
        }
        let terms = rows.iter().map(|row| row.term() + 1).max().unwrap_or(0);
        let mut problem = Self {
            rows,
            weights: rows.iter().map(|row| 1.0 / row.sigma.unwrap_or(1.0)).collect(),
            offsets: Terms::from_elem(None, terms.max(2)),
            observed: Buffer::new(),
            sigma_known: rows.iter().all(|row| row.sigma.is_some()),
            floor: 0.0,
            rounding: 0.0,
        };
        for row in rows {
            problem.offsets[row.term()].get_or_insert(row.value);
        }
        let needed = problem.unknowns();
        if rows.len() < needed {
            return Err(Failure::Observations { rows: rows.len(), needed });
        }
        let mixed = rows.iter().any(|row| row.kind != rows[0].kind);
        if mixed && !problem.sigma_known {
            return Err(Failure::NoDeviation);
        }
        if let Some(row) = problem.weights.iter().position(|w| !(*w > 0.0 && w.is_finite())) {
            return Err(Failure::NotFinite { row, what: "deviation" });
        }
        problem.observed = rows.iter().map(|row| row.value - problem.offset(row.term())).collect();
        let mut largest: Terms<_> = Terms::from_elem((0.0, 0.0f64, 0.0f64), problem.offsets.len());
        for (row, weight) in rows.iter().zip(&problem.weights) {
            let (count, value, heaviest) = &mut largest[row.term()];
            *count += 1.0;
            (*value, *heaviest) = (value.max(row.value.abs()), heaviest.max(*weight));
        }
        for (count, value, heaviest) in largest {
            let rounding = count * (8.0 * f64::EPSILON * value).powi(2);
            problem.floor += rounding.max(FLOOR) * heaviest * heaviest;
            problem.rounding += rounding * heaviest * heaviest;
        }
        Ok(problem)
    }

    fn offset(&self, term: usize) -> f64 {
        self.offsets[term].unwrap_or(0.0)
    }

    /// Three of position and one for each clock term.
    fn unknowns(&self) -> usize {
        3 + self.offsets.iter().flatten().count()
    }

    /// Observations beyond those that the unknowns take up.
    pub fn redundancy(&self) -> usize {
        self.rows.len() - self.unknowns()
    }

    /// A state as a point of an iteration, its clock terms without the offsets; those that it does not give
    /// are 0.
    pub fn point(&self, state: &Place) -> Point<3> {
        let given = |term: usize| state.terms.get(term).copied().flatten().unwrap_or(0.0);
        let clocks = (0..self.offsets.len()).map(|term| given(term) - self.offset(term));
        Point { x: state.position_m, clocks: clocks.collect() }
    }

    /// A place with this value of every clock term, as a point of an iteration.
    pub fn point_by(&self, position_m: Vector3<f64>, clock: f64) -> Point<3> {
        let clocks = (0..self.offsets.len()).map(|term| clock - self.offset(term));
        Point { x: position_m, clocks: clocks.collect() }
    }

    /// The point 0.
    pub fn zero(&self) -> Point<3> {
        Point { x: Vector3::zeros(), clocks: Terms::from_elem(0.0, self.offsets.len()) }
    }

    /// The state at a point.
    pub fn state(&self, at: &Point<3>) -> Place {
        let terms = at.clocks.iter().zip(&self.offsets).map(|(c, offset)| offset.map(|o| c + o));
        Place { position_m: at.x, terms: terms.collect() }
    }

    /// The rows at a point, linearised and weighted; `keep` takes their predictions.
    #[inline]
    pub fn look(&self, at: &Point<3>, system: &mut LeastSquares<3, 4>, mut keep: impl FnMut(Seen)) {
        let rows = self.rows.iter().zip(&self.observed).zip(&self.weights);
        let clocks = at.clocks.as_slice();
        system.set(rows.map(|((row, observed), &weight)| {
            let seen = row.kind.see(&row.satellite, &at.x);
            let g = row.kind.gradient(&row.satellite, &seen) * weight;
            let e = weight * (observed - seen.value - clocks[row.term()]);
            keep(seen);
            LinearRow { row: [g.x, g.y, g.z, e], weight, term: Some(row.term()) }
        }));
    }

    /// The same at the place of a point, whose clock terms become the best there; gives the cost.
    #[inline]
    pub fn look_centred(
        &self,
        at: &mut Point<3>,
        (seen, system): &mut (Buffer<Seen>, LeastSquares<3, 4>),
    ) -> f64 {
        seen.clear();
        at.clocks.fill(0.0);
        self.look(at, system, |s| seen.push(s));
        system.fit_clocks(&mut at.clocks)
    }

    /// Second derivatives of the weighted rows along `along`, m.
    #[inline]
    pub fn curvatures(&self, seen: &[Seen], along: &Vector3<f64>) -> Buffer<f64> {
        let rows = self.rows.iter().zip(&self.weights).zip(seen);
        rows.map(|((row, weight), seen)| {
            let slope = row.kind.gradient(&row.satellite, seen).dot(along);
            weight * row.kind.curvature(seen, slope, along)
        })
        .collect()
    }

    /// Why a step at `at` failed after so many iterations.
    #[cold]
    pub fn diagnose(&self, at: &Point<3>, iterations: usize) -> Failure {
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        for (row, Row { satellite, kind, value, .. }) in self.rows.iter().enumerate() {
            let what = if !value.is_finite() {
                "value"
            } else if !finite(&satellite.position_m) {
                "satellite position"
            } else if !finite(&satellite.velocity_mps) && *kind == RowKind::RangeRate {
                "satellite velocity"
            } else {
                continue;
            };
            return Failure::NotFinite { row, what };
        }
        if let Some(row) = self.coincident(&at.x) {
            return Failure::Coincident { row };
        }
        // All satellites and the place in one plane, to a millionth of their distances.
        if self.scatter(&at.x).symmetric_eigenvalues().min() <= self.flat(&at.x) {
            return Failure::Coplanar;
        }
        Failure::Singular { state: self.state(at), iterations }
    }

    /// A row whose satellite is at the receiver.
    pub fn coincident(&self, place_m: &Vector3<f64>) -> Option<usize> {
        let near = |row: &Row| (row.satellite.position_m - place_m).norm() < COINCIDENT_M;
        self.rows.iter().position(near)
    }

    /// The mirror image of a place in the plane of the satellites, if they lie in one: ranges from there
    /// are the same.
    pub fn mirrored(&self, place_m: &Vector3<f64>) -> Option<Vector3<f64>> {
        let places = self.rows.iter().map(|row| row.satellite.position_m);
        let centre = places.sum::<Vector3<f64>>() / self.rows.len() as f64;
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
        let outer = |d: Vector3<f64>| d * d.transpose();
        self.rows.iter().map(|row| outer(row.satellite.position_m - from_m)).sum()
    }

    /// Sum of squared distances from a plane, m^2, below which satellites lie in it.
    fn flat(&self, from_m: &Vector3<f64>) -> f64 {
        1e-12 * self.scatter(from_m).trace()
    }
}
