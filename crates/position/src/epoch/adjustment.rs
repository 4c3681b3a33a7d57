//! Weighted Gauss-Newton on one epoch with the receiver's full model.
//!
//! Unknowns are position (ECEF, m), clock bias (m) of each satellite system's time and clock drift (m/s) of a
//! receiver at rest. Rows per satellite, with the predictions of [`Predicted`] at the time of reception
//! corrected by the bias:
//!
//! ```text
//! P          = range(r, t) + b   row (-u, 1, 0)
//! -lambda D  = rate(r, t) + d    row (grad rate, 0, 1)
//! height     = height(r)         row (up, 0, 0), where it is known
//! ```
//!
//! each divided by its standard deviation, and times the square root of the robust loss's weight.
//!
//! Standard deviations weigh pseudoranges against Dopplers only as well as they are true, and those of
//! pseudoranges are mostly the model's, common to all and taken up by the clock. So where both are used their
//! weights against each other follow from their own residuals (Helmert's variance components): each kind's
//! standard deviations are scaled by `sqrt(cost / degrees of freedom)` of that kind, the position taking its
//! three from the pseudoranges; downwards for pseudoranges and upwards for Dopplers only, so that a few lucky
//! residuals never let the weaker observable spoil the stronger. Test and covariance keep the standard
//! deviations as they were.

use super::predicted::Predicted;
use super::sighting::{Sighting, clock_of, reference_clock, system_of};
use crate::error::PositioningError;
use crate::fix::InterSystemOffset;
use crate::gauss_newton::{Damping, Minimum, Model, Step, Stopped, Verdict, Why, gauss_newton};
use crate::integrity::{Geometry, MAX_RADIUS, MIN_RADIUS, chi_square_limit};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::loss::Robust;
use crate::options::{Height, Observable, PositioningOptions};
use crate::place::Place;
use crate::point::Point;
use crate::point::Terms;
use crate::problem::RowKind;
use crate::solver::failure::Failure;
use nalgebra::{Matrix3, Vector3};
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::{Constellation, GpsTime, NavigationData};

/// The clock term of all range rates: the receiver has one drift, m/s.
pub(crate) const DRIFT: usize = 1;

/// The clock term of a clock's bias, m. Those of systems without satellites are in no row, and stay as they are.
pub(crate) fn bias(clock: usize) -> usize {
    2 * clock
}

/// Gauss-Newton is quadratic near the ground: from the bare solver's 100 m it takes 3 or 4 steps.
const MAX_REFINEMENTS: usize = 10;
/// Reweighting converges by a factor a step.
const MAX_REWEIGHTED: usize = 60;
/// Refined until the step is shorter than this, m (and m/s).
const REFINED_M: f64 = 1e-4;
/// While it iterates, a place between these distances from the Earth's centre, m, may still become one on
/// the ground.
pub(crate) const ITERATES_M: std::ops::Range<f64> = 5e6..1e7;
/// Largest standard deviation of a position, m, that is worth printing: of one by Dopplers.
const MAX_SIGMA_M: f64 = 100e3;
/// Rounds of variance components: they settle to per cent in two.
const COMPONENT_ROUNDS: usize = 2;
/// Smallest scale of standard deviations that a few lucky residuals may give.
const MIN_SCALE: f64 = 0.03;

/// One observation against its prediction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measured {
    /// Index of its satellite.
    pub satellite: usize,
    pub kind: RowKind,
    /// Which clock term it contains.
    pub term: usize,
    /// Gradient by the position.
    pub gradient: Vector3<f64>,
    /// Observed minus computed, m or m/s.
    pub residual: f64,
    /// Standard deviation by thermal noise.
    pub noise: f64,
    /// Standard deviation of the prediction, which lasts from epoch to epoch.
    pub model: f64,
    /// The part of the prediction's error that satellites share, of unit variance in each axis: what is left of the
    /// ionosphere is smooth over the sky, taken as correlated by the cosine of the angle between two satellites.
    pub shared: Vector3<f64>,
}

impl Measured {
    /// Standard deviation of observed minus computed.
    pub fn sigma(&self) -> f64 {
        self.noise.hypot(self.model)
    }

    /// Standard deviation of the prediction but for the shared part.
    pub fn own_model(&self) -> f64 {
        (self.model * self.model - self.shared.norm_squared()).max(0.0).sqrt()
    }

    /// The linearised row, with its weight by a loss and all terms after `first_term`.
    pub fn linear(&self, sigma: f64, first_term: usize) -> LinearRow<4> {
        let g = self.gradient;
        LinearRow::new([g.x, g.y, g.z, self.residual], sigma, Some(first_term + self.term))
    }
}

impl Height {
    /// The prior on the height as a row at a place (ECEF, m).
    pub(crate) fn row(&self, place: &Vector3<f64>) -> LinearRow<4> {
        let geodetic = Geodetic::from_ecef(place);
        let up = geodetic.ecef_to_enu().row(2).transpose();
        let off = self.height_m - geodetic.height;
        LinearRow::new([up.x, up.y, up.z, off], self.sigma_m, None)
    }
}

/// What an epoch is adjusted with.
#[derive(Clone, Copy)]
pub(crate) struct Adjustment<'a> {
    pub receive_time: GpsTime,
    pub nav: &'a NavigationData,
    pub options: &'a PositioningOptions,
}

/// A converged solution and what it was made of.
pub(crate) struct Adjusted<'a> {
    pub used: Vec<Sighting<'a>>,
    pub view: EpochView,
    pub state: Point<3>,
    pub time: GpsTime,
    /// Of the position, ECEF, m^2.
    pub covariance: Matrix3<f64>,
    /// Bias of the reference clock, m, and its standard deviation, where it was observed.
    pub bias_m: Option<(f64, f64)>,
    pub reference: Constellation,
    pub offsets: Vec<InterSystemOffset>,
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
        let weighted = |row: &Measured| row.residual.abs() / row.sigma();
        let worst = self.view.rows.iter().max_by(|a, b| weighted(a).total_cmp(&weighted(b)));
        PositioningError::Inconsistent {
            satellites: self.used.len(),
            cost: self.cost,
            threshold: chi_square_limit(self.redundancy.max(1)),
            places: Vec::new(),
            suspect: worst.map(|row| self.used[row.satellite].observation.sv()),
        }
    }
}

impl Observable {
    /// Whether rows of this kind belong to it.
    pub(crate) fn contains(self, kind: RowKind) -> bool {
        match self {
            Self::Pseudorange => kind == RowKind::Range,
            Self::Doppler => kind == RowKind::RangeRate,
            Self::Both => true,
        }
    }
}

impl<'a> Adjustment<'a> {
    /// GPS time of reception by a clock's bias, m: of any system that is observed, as their times differ by less than a
    /// microsecond, in which satellites move by millimetres.
    pub fn time(&self, bias_m: f64) -> GpsTime {
        self.receive_time - bias_m / SPEED_OF_LIGHT
    }

    /// What would be seen of the satellites at a point, at the time by their reference clock.
    pub fn predict(&self, used: &[Sighting], at: &Point<3>) -> Vec<Predicted> {
        self.predict_by(used, at, at.clocks[bias(reference_clock(used))])
    }

    /// The same at the time by a bias, m.
    pub fn predict_by(&self, used: &[Sighting], at: &Point<3>, bias_m: f64) -> Vec<Predicted> {
        let (time, nav, options) = (self.time(bias_m), self.nav, self.options);
        let predict =
            |s: &Sighting| Predicted::new(s.orbit, s.carrier_hz, &at.x, time, nav, options);
        used.iter().map(predict).collect()
    }

    /// The observations against it.
    pub fn measured<'s>(
        &self,
        used: &'s [Sighting],
        predictions: &'s [Predicted],
        at: &'s Point<3>,
    ) -> impl Iterator<Item = Measured> + use<'s> {
        let observable = self.options.observable;
        used.iter().zip(predictions).enumerate().flat_map(
            move |(satellite, (sighting, predicted))| {
                let term = bias(clock_of(sighting.sv()));
                let range = sighting.range_m.map(|range_m| Measured {
                    satellite,
                    kind: RowKind::Range,
                    term,
                    gradient: -predicted.direction,
                    residual: range_m - predicted.range_m - at.clocks[term],
                    noise: sighting.observation.range_sigma_m,
                    model: predicted.range_sigma_m,
                    shared: predicted.direction * predicted.ionosphere_sigma_m,
                });
                let rate = sighting.range_rate().map(|(rate, noise)| Measured {
                    satellite,
                    kind: RowKind::RangeRate,
                    term: DRIFT,
                    gradient: predicted.rate_gradient,
                    residual: rate - predicted.range_rate(&Vector3::zeros(), at.clocks[DRIFT]),
                    noise,
                    model: predicted.rate_sigma_mps,
                    shared: Vector3::zeros(),
                });
                [range, rate].into_iter().flatten().filter(move |row| observable.contains(row.kind))
            },
        )
    }

    /// From `start`, to which `spent` iterations led, by the satellites `used`.
    pub fn solve<'s>(
        &self,
        used: Vec<Sighting<'s>>,
        start: Point<3>,
        spent: usize,
    ) -> Result<Adjusted<'s>, PositioningError> {
        if self.options.observable == Observable::Both
            && used.iter().all(|sighting| sighting.range_rate().is_none())
        {
            // Nothing determines the drift, which is asked for.
            let cause = Failure::Singular { state: Place::at(start.x), iterations: spent + 1 };
            return Err(PositioningError::Diverged { satellites: used.len(), cause });
        }
        let (mut iterations, mut scales) = (spent, [1.0; 2]);
        let mut settle = |start: Point<3>, loss: Robust, scales: [f64; 2]| {
            let settling = Settling { adjustment: self, used: &used, loss, scales };
            settling.solve(start, &mut iterations)
        };
        let mut found = settle(start, Robust::None, scales)?;
        if self.options.observable == Observable::Both {
            for _ in 0..COMPONENT_ROUNDS {
                scales = found.view.scales();
                found = settle(found.point, Robust::None, scales)?;
            }
        }
        for &loss in self.options.robust.stages() {
            found = settle(found.point, loss, scales)?;
        }
        self.finish(used, found, scales, iterations)
    }

    /// The last checks.
    fn finish<'s>(
        &self,
        used: Vec<Sighting<'s>>,
        found: Minimum<3, 4, EpochView>,
        scales: [f64; 2],
        iterations: usize,
    ) -> Result<Adjusted<'s>, PositioningError> {
        let Minimum { point: state, view, mut system, .. } = found;
        let radius_m = state.x.norm();
        if !(MIN_RADIUS..MAX_RADIUS).contains(&radius_m) {
            return Err(PositioningError::ImplausibleRadius { radius_m });
        }
        // Of the estimate with these weights, by the standard deviations as they were: each row's own error and its part
        // of the shared one, over the row's standard deviation.
        let errors = view.weighted().map(|(row, _)| {
            let by = 1.0 / (row.sigma() * scales[row.kind as usize]);
            (row.noise.hypot(row.own_model()) * by, row.shared * by)
        });
        let errors: Vec<(f64, Vector3<f64>)> = errors.chain([(1.0, Vector3::zeros())]).collect();
        let (mut own, mut shared) = (Matrix3::zeros(), Matrix3::zeros());
        for (g, (error, common)) in system.influences().zip(&errors) {
            own += g * g.transpose() * (error * error);
            shared += g * common.transpose();
        }
        let covariance: Matrix3<f64> = own + shared * shared.transpose();
        let spread = |influences: &mut dyn Iterator<Item = f64>| {
            let (mut own, mut shared) = (0.0, Vector3::zeros());
            for (g, (error, common)) in influences.zip(&errors) {
                own += (g * error).powi(2);
                shared += g * common;
            }
            (own + shared.norm_squared()).sqrt()
        };
        // Of those with weight.
        let is_observed = |clock: &usize| {
            let mut rows = view.weighted().map(|(row, _)| row);
            rows.any(|row| row.kind == RowKind::Range && row.term == bias(*clock))
        };
        let mut clocks = (0..state.clocks.len() / 2).filter(is_observed);
        let first = clocks.next();
        let reference = first.unwrap_or_else(|| reference_clock(&used));
        let bias_m = first.map(|clock| {
            (state.clocks[bias(clock)], spread(&mut system.clock_influences(bias(clock))))
        });
        let offsets: Vec<InterSystemOffset> = clocks
            .map(|clock| {
                let own = system.clock_influences(bias(clock));
                let influences = own.zip(system.clock_influences(bias(reference)));
                InterSystemOffset {
                    system: system_of(clock),
                    offset_s: (state.clocks[bias(clock)] - state.clocks[bias(reference)])
                        / SPEED_OF_LIGHT,
                    sigma_s: spread(&mut influences.map(|(a, b)| a - b)) / SPEED_OF_LIGHT,
                }
            })
            .collect();
        let rows = errors.len() - usize::from(self.options.height.is_none());
        let mut terms: Vec<usize> = view.rows.iter().map(|row| row.term).collect();
        terms.sort_unstable();
        terms.dedup();

        let (satellites, cost) = (used.len(), view.cost());
        let degenerate = |name, value, limit| PositioningError::DegenerateGeometry {
            satellites,
            name,
            value,
            limit,
        };
        // Dilutions are those of ranges, whatever was observed.
        system.set(view.predictions.iter().zip(&used).map(|(predicted, sighting)| {
            let g = -predicted.direction;
            let term = Some(bias(clock_of(sighting.sv())));
            LinearRow::new([g.x, g.y, g.z, 0.0], 1.0, term)
        }));
        let infinite = degenerate("dilution of precision", f64::INFINITY, 100.0);
        system.factor(state.clocks.len()).ok_or(infinite)?;
        let geometry = Geometry::new(&state.x, &system.covariance(), satellites)?;
        let sigma_m = covariance.trace().sqrt();
        if sigma_m > MAX_SIGMA_M {
            let name = "standard deviation of the position in metres";
            return Err(degenerate(name, sigma_m, MAX_SIGMA_M));
        }
        Ok(Adjusted {
            used,
            view,
            time: self.time(state.clocks[bias(reference)]),
            state,
            covariance,
            bias_m,
            reference: system_of(reference),
            offsets,
            geometry,
            cost,
            iterations,
            redundancy: rows.saturating_sub(3 + terms.len()),
        })
    }
}

/// An epoch under one loss and one set of scales.
struct Settling<'a, 's> {
    adjustment: &'a Adjustment<'a>,
    used: &'a [Sighting<'s>],
    loss: Robust,
    /// Of the standard deviations of ranges and range rates.
    scales: [f64; 2],
}

/// An epoch as seen from a point.
#[derive(Default)]
pub(crate) struct EpochView {
    pub predictions: Vec<Predicted>,
    pub rows: Vec<Measured>,
    /// Robust weights of the rows.
    pub weights: Vec<f64>,
    /// Squared residual of the height, weighted.
    prior_cost: f64,
}

impl EpochView {
    /// The rows that have weight, with it.
    fn weighted(&self) -> impl Iterator<Item = (&Measured, f64)> {
        self.rows.iter().zip(self.weights.iter().copied()).filter(|(_, weight)| *weight > 0.0)
    }

    /// Weighted sum of squared residuals, by the standard deviations as they are.
    fn cost(&self) -> f64 {
        let square =
            |(row, weight): (&Measured, f64)| weight * (row.residual / row.sigma()).powi(2);
        self.weighted().map(square).sum::<f64>() + self.prior_cost
    }

    /// Variance components of pseudoranges and Dopplers, as scales of their standard deviations.
    fn scales(&self) -> [f64; 2] {
        let scale = |kind: RowKind, unknowns: usize| {
            let of_kind = || self.rows.iter().filter(|row| row.kind == kind);
            let cost: f64 = of_kind().map(|row| (row.residual / row.sigma()).powi(2)).sum();
            match of_kind().count().saturating_sub(unknowns) {
                0 => 1.0,
                freedom => (cost / freedom as f64).sqrt(),
            }
        };
        let mut terms: Vec<usize> = self.rows.iter().map(|row| row.term).collect();
        terms.retain(|term| *term != DRIFT);
        terms.sort_unstable();
        terms.dedup();
        let of_ranges = 3 + terms.len();
        [
            scale(RowKind::Range, of_ranges).clamp(MIN_SCALE, 1.0),
            scale(RowKind::RangeRate, 1).max(1.0),
        ]
    }
}

impl Settling<'_, '_> {
    /// Gauss-Newton from `start` until it moves no more.
    fn solve(
        &self,
        start: Point<3>,
        iterations: &mut usize,
    ) -> Result<Minimum<3, 4, EpochView>, PositioningError> {
        let most = if self.loss == Robust::None { MAX_REFINEMENTS } else { MAX_REWEIGHTED };
        let found = gauss_newton(self, start, &Damping::plain(most), |_| ());
        let (Ok(Minimum { iterations: spent, .. }) | Err(Stopped { iterations: spent, .. })) =
            &found;
        *iterations += spent;
        found.map_err(|Stopped { point, why, .. }| {
            let state = Place::at(point.x);
            let cause = match why {
                Why::Abandoned => {
                    let radius_m = point.x.norm();
                    return PositioningError::ImplausibleRadius { radius_m };
                }
                Why::Singular => Failure::Singular { state, iterations: *iterations },
                _ => Failure::TooSlow { state, iterations: *iterations },
            };
            PositioningError::Diverged { satellites: self.used.len(), cause }
        })
    }
}

impl Model<3, 4> for Settling<'_, '_> {
    type View = EpochView;

    fn look(&self, at: &Point<3>, view: &mut EpochView, system: &mut LeastSquares<3, 4>) {
        view.predictions = self.adjustment.predict(self.used, at);
        view.rows = self.adjustment.measured(self.used, &view.predictions, at).collect();
        let weight = |row: &Measured| self.loss.weight(row.residual / row.sigma());
        view.weights = view.rows.iter().map(weight).collect();
        let height = self.adjustment.options.height.map(|height| height.row(&at.x));
        view.prior_cost = height.map_or(0.0, |prior| prior.row[3].powi(2));
        let rows = view.weighted().map(|(row, weight)| {
            row.linear(row.sigma() / weight.sqrt() * self.scales[row.kind as usize], 0)
        });
        system.set(rows.chain(height));
    }

    fn verdict(&self, step: &Step<3>, _: &LeastSquares<3, 4>) -> Verdict {
        match step.length {
            _ if !ITERATES_M.contains(&step.to.x.norm()) => Verdict::Abandon,
            length if length < REFINED_M => Verdict::Converged,
            _ => Verdict::Continue,
        }
    }
}

/// The point of a place, with the clock terms of the satellites `used`; 0 where it has none.
pub(crate) fn point(place: &Place, used: &[Sighting]) -> Point<3> {
    let clocks = used.iter().map(|s| clock_of(s.observation.sv()) + 1).max().unwrap_or(1);
    let terms = (0..clocks).flat_map(|clock| [place.bias_m(clock), place.drift_mps(clock)]);
    let clocks: Terms<f64> = terms.map(|term| term.unwrap_or(0.0)).collect();
    Point { x: place.position_m, clocks }
}
