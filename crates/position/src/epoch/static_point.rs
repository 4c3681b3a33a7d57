//! One position of a receiver at rest from all epochs.
//!
//! Each epoch is first solved by itself ([`super`]): that finds its clock and the satellites that contradict
//! the others. Then all rows of all epochs share one position, with clock terms of each epoch, which the
//! least squares eliminate: there are three unknowns however many epochs.
//!
//! Thermal noise averages out over the epochs; what is wrong with a satellite's orbit, clock and delays does
//! not. The covariance takes the first as independent and the second as one constant per satellite (and of the ionosphere
//! as shared by neighbours, as that of an epoch does): with
//! `g_i` what a residual does to the position, `sum (g_i noise_i)(g_i noise_i)' + sum_s G_s G_s'`, where `G_s`
//! is the sum of `g_i model_i` over the rows of a satellite.

use super::adjustment::{Adjustment, DRIFT, Measured, bias, point};
use super::sighting::{Sighting, clock_of, system_of};
use super::{sightings, solve_traced};
use crate::error::PositioningError;
use crate::fix::Fix;
use crate::gauss_newton::{Damping, Model, Step, Verdict, gauss_newton};
use crate::least_squares::{LeastSquares, LinearRow};
use crate::options::PositioningOptions;
use crate::place::Place;
use crate::point::Point;
use crate::point::Terms;
use crate::problem::RowKind;
use crate::solver::point_solution::Iteration;
use nalgebra::{Matrix3, Vector3};
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::observation::ObservationEpoch;
use sdr_rx_gnss::{NavigationData, Sv};
use std::collections::BTreeMap;

/// Most rounds of Gauss-Newton: from the median of the epochs' positions three suffice.
const MAX_ROUNDS: usize = 30;
/// Refined until the position moves less than this, m.
const REFINED_M: f64 = 1e-4;

/// The position of a receiver at rest, from all epochs that have one by themselves, as the fix of the last of
/// them: clock, residuals and dilutions are those of that epoch; position and covariance are common to all.
/// Beside it the epochs that have no position, with the reasons.
///
/// # Errors
/// That of the first epoch, if none has a position, or what the common solution lacks.
pub fn solve_static(
    epochs: &[ObservationEpoch],
    nav: &NavigationData,
    options: &PositioningOptions,
    trace: &mut dyn FnMut(usize, &Iteration),
) -> Result<(Fix, Vec<(usize, PositioningError)>), PositioningError> {
    let mut refused = Vec::new();
    let mut fixes: Vec<Fix> = Vec::new();
    let mut all = Together { options, epochs: Vec::new() };
    let mut clocks = Terms::new();
    for (k, epoch) in epochs.iter().enumerate() {
        match solve_traced(epoch, nav, options, &mut |step| trace(k, step)) {
            Ok(fix) => {
                let used = |s: &Sighting| fix.residuals.iter().any(|r| r.sv == s.observation.sv());
                let (mut set, _) = sightings(epoch, nav, options)?;
                set.retain(used);
                let mut own = point(&Place::at(fix.position_m), &set).clocks;
                own[DRIFT] = fix.clock_drift_sps.unwrap_or(0.0) * SPEED_OF_LIGHT;
                for clock in set.iter().map(|s| clock_of(s.sv())) {
                    let offset = fix.offsets.iter().find(|o| o.system == system_of(clock));
                    let bias_s =
                        fix.clock_bias_s.unwrap_or(0.0) + offset.map_or(0.0, |o| o.offset_s);
                    own[bias(clock)] = bias_s * SPEED_OF_LIGHT;
                }
                let adjustment = Adjustment { receive_time: epoch.receive_time, nav, options };
                all.epochs.push(Epoch {
                    adjustment,
                    set,
                    terms: clocks.len()..clocks.len() + own.len(),
                });
                clocks.extend(own);
                fixes.push(fix);
            }
            Err(error) => refused.push((k, error)),
        }
    }
    if fixes.is_empty() {
        let first = refused.into_iter().next().map(|(_, error)| error);
        let nothing =
            PositioningError::TooFewSatellites { usable: 0, needed: 4, dropped: Vec::new() };
        return Err(first.unwrap_or(nothing));
    }
    let median = |k: usize| {
        let mut values: Vec<f64> = fixes.iter().map(|fix| fix.position_m[k]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let start = Point { x: Vector3::new(median(0), median(1), median(2)), clocks };
    let found = gauss_newton(&all, start, &Damping::plain(MAX_ROUNDS), |_| ());
    let found = found.map_err(|_| PositioningError::DegenerateGeometry {
        satellites: all.satellites(),
        name: "dilution of precision",
        value: f64::INFINITY,
        limit: 100.0,
    })?;
    let covariance = all.covariance(&found.view, &found.system);
    let to_enu = Geodetic::from_ecef(&found.point.x).ecef_to_enu();
    let mut excluded: Vec<Sv> = fixes.iter().flat_map(|fix| &fix.excluded).copied().collect();
    excluded.sort();
    excluded.dedup();
    let last = fixes.remove(fixes.len() - 1);
    let fix = Fix {
        position_m: found.point.x,
        covariance: to_enu * covariance * to_enu.transpose(),
        velocity_mps: None,
        iterations: last.iterations + found.iterations,
        excluded,
        ..last
    };
    Ok((fix, refused))
}

/// An epoch of those that share a position.
struct Epoch<'a> {
    adjustment: Adjustment<'a>,
    set: Vec<Sighting<'a>>,
    /// Its clock terms among all.
    terms: std::ops::Range<usize>,
}

/// All epochs.
struct Together<'a> {
    options: &'a PositioningOptions,
    epochs: Vec<Epoch<'a>>,
}

impl Together<'_> {
    fn satellites(&self) -> usize {
        let mut all: Vec<Sv> =
            self.epochs.iter().flat_map(|e| &e.set).map(|s| s.observation.sv()).collect();
        all.sort();
        all.dedup();
        all.len()
    }

    /// Covariance of the position, ECEF, m^2.
    fn covariance(&self, view: &[Seen], system: &LeastSquares<3, 4>) -> Matrix3<f64> {
        let mut covariance = Matrix3::zeros();
        let mut shared: Matrix3<f64> = Matrix3::zeros();
        let mut lasting: BTreeMap<(Sv, RowKind), Vector3<f64>> = BTreeMap::new();
        let mut influences = system.influences();
        for (Seen { sv, row, linear }, influence) in view.iter().zip(&mut influences) {
            let by = influence * linear.weight;
            covariance += by * by.transpose() * row.noise.powi(2);
            *lasting.entry((*sv, row.kind)).or_default() += by * row.own_model();
            shared += by * row.shared.transpose();
        }
        covariance += shared * shared.transpose();
        // What is left is of the prior.
        influences.chain(lasting.into_values()).fold(covariance, |sum, g| sum + g * g.transpose())
    }
}

/// A row that has weight.
struct Seen {
    sv: Sv,
    row: Measured,
    linear: LinearRow<4>,
}

impl Model<3, 4> for Together<'_> {
    type View = Vec<Seen>;

    fn look(&self, at: &Point<3>, view: &mut Vec<Seen>, system: &mut LeastSquares<3, 4>) {
        view.clear();
        for Epoch { adjustment, set, terms } in &self.epochs {
            let own = Point { x: at.x, clocks: Terms::from(&at.clocks[terms.clone()]) };
            let predictions = adjustment.predict(set, &own);
            view.extend(adjustment.measured(set, &predictions, &own).filter_map(|row| {
                let weight = self.options.robust.weight(row.residual / row.sigma());
                let linear = row.linear(row.sigma() / weight.sqrt(), terms.start);
                let sv = set[row.satellite].observation.sv();
                (weight > 0.0).then_some(Seen { sv, row, linear })
            }));
        }
        let height = self.options.height.map(|height| height.row(&at.x));
        system.set(view.iter().map(|seen| seen.linear).chain(height));
    }

    fn verdict(&self, step: &Step<3>, _: &LeastSquares<3, 4>) -> Verdict {
        let settled = (step.to.x - step.from.x).norm() < REFINED_M;
        if settled || step.iterations == MAX_ROUNDS {
            Verdict::Converged
        } else {
            Verdict::Continue
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::{Truth, navigation_data};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use sdr_rx_gnss::observation::CodeRange;

    #[test]
    fn noise_averages_out_and_the_covariance_says_by_how_much() {
        let (nav, options) = (navigation_data(), PositioningOptions::default());
        let truth = Truth { bias_s: 1e-4, drift_sps: 1e-8, ..Truth::at_rest() };
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        const EPOCHS: usize = 40;
        let epochs: Vec<ObservationEpoch> = (0..EPOCHS)
            .map(|k| {
                let truth = Truth { time: truth.time + 30.0 * k as f64, ..truth };
                let mut epoch = truth.observe(&nav, &options, 0.1);
                for observation in &mut epoch.observations {
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    if let Some(CodeRange::Pseudorange(range_m)) = &mut observation.range {
                        *range_m += noise;
                    }
                }
                epoch
            })
            .collect();
        let (fix, refused) = solve_static(&epochs, &nav, &options, &mut |_, _| ()).unwrap();
        assert!(refused.is_empty());
        // Noise of 1 m, a dilution of 3 at most, averaged over 40 epochs: 0.5 m, and four deviations.
        let error_m = (fix.position_m - truth.position_m).norm();
        assert!(error_m < 2.0, "{error_m}");
        // The model's part does not average out, so that the deviation stays above that of exact data.
        let (one, _) = solve_static(&epochs[..1], &nav, &options, &mut |_, _| ()).unwrap();
        let sigma = |fix: &Fix| fix.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
        assert!(sigma(&fix) < sigma(&one) && sigma(&fix) > error_m / 4.0);
        assert!((one.covariance - single(&epochs[0], &nav)).norm() < 1e-3 * one.covariance.norm());
        assert!((fix.clock_bias_s.unwrap() - truth.bias_s).abs() * SPEED_OF_LIGHT < 10.0);
    }

    /// The covariance of an epoch by itself.
    fn single(epoch: &ObservationEpoch, nav: &NavigationData) -> Matrix3<f64> {
        crate::solve_epoch(epoch, nav, &PositioningOptions::default()).unwrap().covariance
    }

    #[test]
    fn no_position_of_any_epoch_is_the_first_ones_error() {
        let (nav, options) = (navigation_data(), PositioningOptions::default());
        let mut epoch = Truth::at_rest().observe(&nav, &options, 0.1);
        epoch.observations.truncate(3);
        let error = solve_static(&[epoch], &nav, &options, &mut |_, _| ()).unwrap_err();
        assert!(error.to_string().contains("3 usable satellites"), "{error}");
        assert!(solve_static(&[], &nav, &options, &mut |_, _| ()).is_err());
    }
}
