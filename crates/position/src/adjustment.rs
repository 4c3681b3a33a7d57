//! Weighted Gauss-Newton on one epoch with the receiver's full model.
//!
//! Unknowns are position (ECEF, m), clock bias (m) and clock drift (m/s) of a receiver at rest. Rows per
//! satellite, with the predictions of [`Sight`] at the time of reception corrected by the bias:
//!
//! ```text
//! P          = range(r, t) + b   row (-u, 1, 0)
//! -lambda D  = rate(r, t) + d    row (grad rate, 0, 1)
//! height     = height(r)         row (up, 0, 0), where it is known
//! ```
//!
//! each divided by its standard deviation, and times the square root of the robust law's weight. The clock
//! term that the observable does not contain is held by a row of its own, which touches nothing else.
//!
//! Deviations weigh pseudoranges against Dopplers only as well as they are true, and those of pseudoranges
//! are mostly the model's, common to all and taken up by the clock. So where both are used their weights
//! against each other follow from their own residuals (Helmert's variance components): each kind's deviations
//! are scaled by `sqrt(cost / degrees of freedom)` of that kind, the position taking its three from the
//! pseudoranges; downwards for pseudoranges and upwards for Dopplers only, so that a few lucky residuals
//! never let the weaker observable spoil the stronger. Test and covariance keep the deviations as they were.

use super::error::PositioningError;
use super::least_squares::LeastSquares;
use super::options::{Observable, SolveOptions};
use super::robust::Robust;
use super::sight::{Sight, Sighting};
use super::solution::{Geometry, MAX_RADIUS, MIN_RADIUS};
use super::solver::outcome::{Failure, State};
use super::statistics::chi_square_limit;
use nalgebra::{SMatrix, SVector, Vector3};
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::{GpsTime, NavigationData};

/// Position, clock bias, clock drift: m, m, m/s.
pub(super) type Unknowns = SVector<f64, 5>;
/// Indices of the last two.
pub(super) const BIAS: usize = 3;
pub(super) const DRIFT: usize = 4;

/// Gauss-Newton is quadratic near the ground: from the bare solver's 100 m it takes 3 or 4 steps.
const MAX_REFINEMENTS: usize = 10;
/// Reweighting converges by a factor a step.
const MAX_REWEIGHTED: usize = 60;
/// Refined until the step is shorter than this, m (and m/s).
const REFINED_M: f64 = 1e-4;
/// While it iterates, a place between these distances from the Earth's centre, m, may still become one on
/// the ground.
const ITERATES_M: std::ops::Range<f64> = 5e6..8e6;
/// Largest standard deviation of a position, m, that is worth printing: of one by Dopplers.
const MAX_SIGMA_M: f64 = 100e3;
/// Rounds of variance components: they settle to per cent in two.
const COMPONENT_ROUNDS: usize = 2;
/// Smallest scale of deviations that a few lucky residuals may give.
const MIN_SCALE: f64 = 0.03;

/// The position part of a state.
pub(super) fn position(state: &Unknowns) -> Vector3<f64> {
    state.fixed_rows::<3>(0).into_owned()
}

/// One observation, linearised.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// Index of its satellite.
    pub satellite: usize,
    /// Which clock term it contains.
    pub clock: usize,
    /// Gradient by the position.
    pub gradient: Vector3<f64>,
    /// Observed minus computed, m or m/s.
    pub residual: f64,
    /// Standard deviation by thermal noise.
    pub noise: f64,
    /// Standard deviation of the prediction, which lasts from epoch to epoch.
    pub model: f64,
}

impl Row {
    /// Standard deviation of observed minus computed.
    pub fn sigma(&self) -> f64 {
        self.noise.hypot(self.model)
    }

    /// Derivatives by the unknowns.
    pub fn design(&self) -> Unknowns {
        let g = self.gradient;
        let mut row = Unknowns::new(g.x, g.y, g.z, 0.0, 0.0);
        row[self.clock] = 1.0;
        row
    }
}

/// What an epoch is adjusted with.
#[derive(Clone, Copy)]
pub(super) struct Adjustment<'a> {
    pub receive_time: GpsTime,
    pub nav: &'a NavigationData,
    pub options: &'a SolveOptions,
}

/// A converged solution and what it was made of.
pub(super) struct Adjusted<'a> {
    pub used: Vec<Sighting<'a>>,
    pub sights: Vec<Sight>,
    pub rows: Vec<Row>,
    /// Robust weights of the rows.
    pub weights: Vec<f64>,
    pub state: Unknowns,
    pub time: GpsTime,
    /// Of the unknowns, ECEF; of a clock term that is not observed without meaning.
    pub covariance: SMatrix<f64, 5, 5>,
    pub geometry: Geometry,
    /// Weighted sum of squared residuals.
    pub cost: f64,
    pub iterations: usize,
    /// Rows more than unknowns.
    pub redundancy: usize,
}

impl Adjusted<'_> {
    /// Weighted sum of squared residuals over its limit; above 1 the satellites contradict each other.
    pub fn contradiction(&self) -> f64 {
        match self.redundancy {
            0 => 0.0,
            redundancy => self.cost / chi_square_limit(redundancy),
        }
    }

    /// The complaint about that.
    pub fn inconsistent(&self) -> PositioningError {
        let weighted = |row: &Row| row.residual.abs() / row.sigma();
        let worst = self.rows.iter().max_by(|a, b| weighted(a).total_cmp(&weighted(b)));
        PositioningError::Inconsistent {
            satellites: self.used.len(),
            cost: self.cost,
            threshold: chi_square_limit(self.redundancy.max(1)),
            suspect: worst.map(|row| self.used[row.satellite].observation.sv),
        }
    }
}

impl Observable {
    /// Unknowns that it determines.
    pub(super) fn unknowns(self) -> usize {
        if self == Self::Both { 5 } else { 4 }
    }

    /// Whether rows of this clock term belong to it.
    fn contains(self, clock: usize) -> bool {
        match self {
            Self::Pseudorange => clock == BIAS,
            Self::Doppler => clock == DRIFT,
            Self::Both => true,
        }
    }
}

impl Adjustment<'_> {
    /// GPS time of reception under a state.
    pub fn time(&self, state: &Unknowns) -> GpsTime {
        self.receive_time - state[BIAS] / SPEED_OF_LIGHT
    }

    /// What would be seen of the satellites under a state.
    pub fn sights(&self, used: &[Sighting], state: &Unknowns) -> Vec<Sight> {
        let (place, time) = (position(state), self.time(state));
        let sight =
            |s: &Sighting| Sight::new(s.orbit, &place, time, self.nav, &self.options.positioning);
        used.iter().map(sight).collect()
    }

    /// The observations against it.
    pub fn rows(&self, used: &[Sighting], sights: &[Sight], state: &Unknowns) -> Vec<Row> {
        let observable = self.options.observable;
        let mut rows = Vec::with_capacity(2 * used.len());
        for (satellite, (sighting, sight)) in used.iter().zip(sights).enumerate() {
            if let Some(range_m) = sighting.range_m.filter(|_| observable.contains(BIAS)) {
                rows.push(Row {
                    satellite,
                    clock: BIAS,
                    gradient: -sight.direction,
                    residual: range_m - sight.range_m - state[BIAS],
                    noise: sighting.observation.range_sigma_m,
                    model: sight.range_sigma_m,
                });
            }
            if let Some((rate, noise)) =
                sighting.range_rate().filter(|_| observable.contains(DRIFT))
            {
                rows.push(Row {
                    satellite,
                    clock: DRIFT,
                    gradient: sight.rate_gradient,
                    residual: rate - sight.range_rate(&Vector3::zeros(), state[DRIFT]),
                    noise,
                    model: sight.rate_sigma_mps,
                });
            }
        }
        rows
    }

    /// From `start`, to which `spent` iterations led, by the satellites `used`.
    pub fn solve<'s>(
        &self,
        used: Vec<Sighting<'s>>,
        start: Unknowns,
        spent: usize,
    ) -> Result<Adjusted<'s>, PositioningError> {
        let (mut state, mut iterations, mut scales) = (start, spent, [1.0; 2]);
        let mut round = self.settle(&used, &mut state, &mut iterations, Robust::None, scales)?;
        if self.options.observable == Observable::Both {
            for _ in 0..COMPONENT_ROUNDS {
                scales = round.scales();
                round = self.settle(&used, &mut state, &mut iterations, Robust::None, scales)?;
            }
        }
        for &law in self.options.robust.stages() {
            round = self.settle(&used, &mut state, &mut iterations, law, scales)?;
        }
        self.finish(used, state, round, iterations)
    }

    /// Gauss-Newton under one law and one set of scales until it moves no more.
    fn settle(
        &self,
        used: &[Sighting],
        state: &mut Unknowns,
        iterations: &mut usize,
        law: Robust,
        scales: [f64; 2],
    ) -> Result<Round, PositioningError> {
        let satellites = used.len();
        let failed = |cause| PositioningError::Diverged { satellites, cause };
        let most = if law == Robust::None { MAX_REFINEMENTS } else { MAX_REWEIGHTED };
        for _ in 0..most {
            *iterations += 1;
            let round = self.round(used, state, law, scales).ok_or_else(|| {
                failed(Failure::Singular { state: self.place(state), iterations: *iterations })
            })?;
            *state += round.step;
            let radius_m = position(state).norm();
            if !ITERATES_M.contains(&radius_m) {
                return Err(PositioningError::ImplausibleRadius { radius_m });
            }
            if round.step.norm() < REFINED_M {
                return Ok(round);
            }
        }
        Err(failed(Failure::TooSlow { state: self.place(state), iterations: *iterations }))
    }

    /// One step of Gauss-Newton; none if the system is singular.
    fn round(
        &self,
        used: &[Sighting],
        state: &Unknowns,
        law: Robust,
        scales: [f64; 2],
    ) -> Option<Round> {
        let sights = self.sights(used, state);
        let rows = self.rows(used, &sights, state);
        let mut weights = Vec::with_capacity(rows.len());
        let mut system = LeastSquares::<5>::default();
        let mut cost = 0.0;
        let mut spread = SMatrix::<f64, 5, 5>::zeros();
        for row in &rows {
            let weight = law.weight(row.residual / row.sigma());
            weights.push(weight);
            if weight > 0.0 {
                let sigma = row.sigma() / weight.sqrt();
                let scaled = sigma * scales[row.clock - BIAS];
                let design = row.design() / scaled;
                system.push(&design, row.residual / scaled);
                cost += (row.residual / sigma).powi(2);
                spread += design * design.transpose() / scales[row.clock - BIAS].powi(2);
            }
        }
        if let Some(known) = self.options.height {
            let place = Geodetic::from_ecef(&position(state));
            let up = place.ecef_to_enu().row(2).transpose() / known.sigma_m;
            let residual = (known.height_m - place.height) / known.sigma_m;
            let design = Unknowns::new(up.x, up.y, up.z, 0.0, 0.0);
            system.push(&design, residual);
            cost += residual * residual;
            spread += design * design.transpose();
        }
        for clock in [BIAS, DRIFT] {
            if !self.options.observable.contains(clock) {
                let mut row = Unknowns::zeros();
                row[clock] = 1.0;
                system.push(&row, 0.0);
            }
        }
        let solution = system.solve()?;
        let mut covariance = solution.cofactor();
        if scales != [1.0; 2] {
            // Of the estimate with these weights, by the deviations as they were.
            covariance = covariance * spread * covariance;
        }
        Some(Round { sights, rows, weights, step: solution.x, covariance, cost })
    }

    /// The last checks.
    fn finish<'s>(
        &self,
        used: Vec<Sighting<'s>>,
        state: Unknowns,
        round: Round,
        iterations: usize,
    ) -> Result<Adjusted<'s>, PositioningError> {
        let place = position(&state);
        let radius_m = place.norm();
        if !(MIN_RADIUS..MAX_RADIUS).contains(&radius_m) {
            return Err(PositioningError::ImplausibleRadius { radius_m });
        }
        let satellites = used.len();
        let degenerate = |name, value, limit| PositioningError::DegenerateGeometry {
            satellites,
            name,
            value,
            limit,
        };
        // Dilutions are those of ranges, whatever was observed.
        let mut plain = LeastSquares::<4>::default();
        for sight in &round.sights {
            plain.push(&(-sight.direction).push(1.0), 0.0);
        }
        let plain =
            plain.solve().ok_or(degenerate("dilution of precision", f64::INFINITY, 100.0))?;
        let geometry = Geometry::new(&place, &plain.cofactor(), satellites)?;
        let sigma_m = round.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
        if sigma_m > MAX_SIGMA_M {
            let name = "standard deviation of the position in metres";
            return Err(degenerate(name, sigma_m, MAX_SIGMA_M));
        }
        let rows = round.weights.iter().filter(|w| **w > 0.0).count();
        let rows = rows + usize::from(self.options.height.is_some());
        Ok(Adjusted {
            used,
            sights: round.sights,
            rows: round.rows,
            weights: round.weights,
            state,
            time: self.time(&state),
            covariance: round.covariance,
            geometry,
            cost: round.cost,
            iterations,
            redundancy: rows.saturating_sub(self.options.observable.unknowns()),
        })
    }

    /// A state as the bare solvers have it.
    pub fn place(&self, state: &Unknowns) -> State {
        let observed =
            |clock: usize| self.options.observable.contains(clock).then_some(state[clock]);
        let (bias_m, drift_mps) = (observed(BIAS), observed(DRIFT));
        State { position_m: position(state), bias_m, drift_mps }
    }
}

/// One step of Gauss-Newton and what it was computed from.
struct Round {
    sights: Vec<Sight>,
    rows: Vec<Row>,
    weights: Vec<f64>,
    step: Unknowns,
    covariance: SMatrix<f64, 5, 5>,
    cost: f64,
}

impl Round {
    /// Variance components of pseudoranges and Dopplers, as scales of their deviations.
    fn scales(&self) -> [f64; 2] {
        let scale = |clock: usize, unknowns: usize| {
            let of_kind = || self.rows.iter().filter(|row| row.clock == clock);
            let cost: f64 = of_kind().map(|row| (row.residual / row.sigma()).powi(2)).sum();
            match of_kind().count().saturating_sub(unknowns) {
                0 => 1.0,
                freedom => (cost / freedom as f64).sqrt(),
            }
        };
        [scale(BIAS, 4).clamp(MIN_SCALE, 1.0), scale(DRIFT, 1).max(1.0)]
    }
}
