//! One position of a receiver at rest from all epochs.
//!
//! Each epoch is first solved by itself ([`super::point`]): that finds its clock and the satellites that
//! contradict the others. Then all rows of all epochs share one position; the clock terms of each epoch are
//! eliminated (the design of its rows less its weighted mean over those that share a clock), so that the
//! normal equations have three unknowns however many epochs there are:
//!
//! ```text
//! N = sum A' W A,   n = sum A' W e    with A, e centred per epoch and clock
//! ```
//!
//! Thermal noise averages out over the epochs; what is wrong with a satellite's orbit, clock and delays does
//! not. The covariance takes the first as independent and the second as one constant per satellite:
//! `N^-1 (sum A' W R W A + sum_s g_s g_s') N^-1`, with `g_s` the sum of `A' w sigma` over the satellite's rows.

use super::adjustment::{Adjustment, BIAS, DRIFT, Row, Unknowns};
use super::error::PositioningError;
use super::fix::Fix;
use super::options::SolveOptions;
use super::point::{sightings, solve_observed};
use super::sight::Sighting;
use super::solver::outcome::Step;
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
    options: &SolveOptions,
    trace: &mut dyn FnMut(usize, &Step),
) -> Result<(Fix, Vec<(usize, PositioningError)>), PositioningError> {
    let mut refused = Vec::new();
    let mut solved: Vec<(Fix, Vec<Sighting>, Adjustment, Unknowns)> = Vec::new();
    for (k, epoch) in epochs.iter().enumerate() {
        match solve_observed(epoch, nav, options, &mut |step| trace(k, step)) {
            Ok(fix) => {
                let used = |s: &Sighting| fix.residuals.iter().any(|r| r.sv == s.observation.sv);
                let mut set = sightings(epoch, nav, options.observable)?;
                set.retain(used);
                let place = fix.position_m;
                let mut state = Unknowns::new(place.x, place.y, place.z, 0.0, 0.0);
                state[BIAS] = fix.clock_bias_s.unwrap_or(0.0) * SPEED_OF_LIGHT;
                state[DRIFT] = fix.clock_drift_sps.unwrap_or(0.0) * SPEED_OF_LIGHT;
                let adjustment = Adjustment { receive_time: epoch.receive_time, nav, options };
                solved.push((fix, set, adjustment, state));
            }
            Err(error) => refused.push((k, error)),
        }
    }
    let Some(last) = solved.len().checked_sub(1) else {
        let first = refused.into_iter().next().map(|(_, error)| error);
        let nothing =
            PositioningError::TooFewSatellites { usable: 0, needed: 4, dropped: Vec::new() };
        return Err(first.unwrap_or(nothing));
    };
    let median = |k: usize| {
        let mut values: Vec<f64> = solved.iter().map(|s| s.0.position_m[k]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let mut place = Vector3::new(median(0), median(1), median(2));
    let mut rounds = 0;
    let covariance = loop {
        rounds += 1;
        let mut normal = Normal::new(&place, options);
        for (_, set, adjustment, state) in &mut solved {
            state.fixed_rows_mut::<3>(0).copy_from(&place);
            normal.add(adjustment, set, state);
        }
        let inverse = normal.matrix.try_inverse().ok_or(PositioningError::DegenerateGeometry {
            satellites: normal.satellites.len(),
            name: "dilution of precision",
            value: f64::INFINITY,
            limit: 100.0,
        })?;
        let step = inverse * normal.right;
        place += step;
        if step.norm() < REFINED_M || rounds == MAX_ROUNDS {
            break inverse * normal.spread() * inverse;
        }
    };
    let mut fix = solved.swap_remove(last).0;
    let enu = Geodetic::from_ecef(&place).ecef_to_enu();
    fix.position_m = place;
    fix.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(enu * covariance * enu.transpose()));
    fix.velocity_mps = None;
    fix.iterations += rounds;
    fix.excluded.extend(solved.iter().flat_map(|s| &s.0.excluded));
    fix.excluded.sort();
    fix.excluded.dedup();
    Ok((fix, refused))
}

/// Normal equations of the common position in the making.
struct Normal<'a> {
    options: &'a SolveOptions,
    matrix: Matrix3<f64>,
    right: Vector3<f64>,
    /// Of independent noise.
    noise: Matrix3<f64>,
    /// What a deviation of each satellite's ranges and rates does to the right side.
    satellites: BTreeMap<(Sv, usize), Vector3<f64>>,
}

impl<'a> Normal<'a> {
    fn new(place: &Vector3<f64>, options: &'a SolveOptions) -> Self {
        let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
        if let Some(known) = options.height {
            let geodetic = Geodetic::from_ecef(place);
            let up = geodetic.ecef_to_enu().row(2).transpose() / known.sigma_m;
            matrix += up * up.transpose();
            right += up * (known.height_m - geodetic.height) / known.sigma_m;
        }
        Self { options, matrix, right, noise: matrix, satellites: BTreeMap::new() }
    }

    /// Adds an epoch at `state`, whose clock terms it moves to where they fit best.
    fn add(&mut self, adjustment: &Adjustment, set: &[Sighting], state: &mut Unknowns) {
        let sights = adjustment.sights(set, state);
        let rows = adjustment.rows(set, &sights, state);
        let weight = |row: &Row| {
            let sigma = row.sigma();
            self.options.robust.weight(row.residual / sigma) / (sigma * sigma)
        };
        for clock in [BIAS, DRIFT] {
            let of_clock = || rows.iter().filter(|row| row.clock == clock);
            let total: f64 = of_clock().map(weight).sum();
            if total.is_nan() || total <= 0.0 {
                continue;
            }
            let mean: Vector3<f64> =
                of_clock().map(|row| weight(row) * row.gradient).sum::<Vector3<f64>>() / total;
            let offset = of_clock().map(|row| weight(row) * row.residual).sum::<f64>() / total;
            state[clock] += offset;
            for row in of_clock() {
                let (w, design) = (weight(row), row.gradient - mean);
                let weighted = w * design;
                self.matrix += weighted * design.transpose();
                self.right += weighted * (row.residual - offset);
                self.noise += weighted * weighted.transpose() * row.noise.powi(2);
                let sv = set[row.satellite].observation.sv;
                *self.satellites.entry((sv, clock)).or_default() += weighted * row.model;
            }
        }
    }

    /// Covariance of the right side.
    fn spread(&self) -> Matrix3<f64> {
        self.noise + self.satellites.values().map(|g| g * g.transpose()).sum::<Matrix3<f64>>()
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{Truth, navigation_data};
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use sdr_rx_gnss::observation::CodeRange;

    #[test]
    fn noise_averages_out_and_the_covariance_says_by_how_much() {
        let (nav, options) = (navigation_data(), SolveOptions::default());
        let truth = Truth { bias_s: 1e-4, drift_sps: 1e-8, ..Truth::at_rest() };
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        const EPOCHS: usize = 40;
        let epochs: Vec<ObservationEpoch> = (0..EPOCHS)
            .map(|k| {
                let truth = Truth { time: truth.time + 30.0 * k as f64, ..truth };
                let mut epoch = truth.observe(&nav, &options.positioning, 0.1);
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
    fn single(epoch: &ObservationEpoch, nav: &NavigationData) -> nalgebra::Matrix4<f64> {
        solve_observed(epoch, nav, &SolveOptions::default(), &mut |_| ()).unwrap().covariance
    }

    #[test]
    fn no_position_of_any_epoch_is_the_first_ones_error() {
        let (nav, options) = (navigation_data(), SolveOptions::default());
        let mut epoch = Truth::at_rest().observe(&nav, &options.positioning, 0.1);
        epoch.observations.truncate(3);
        let error = solve_static(&[epoch], &nav, &options, &mut |_, _| ()).unwrap_err();
        assert!(error.to_string().contains("3 usable satellites"), "{error}");
        assert!(solve_static(&[], &nav, &options, &mut |_, _| ()).is_err());
    }
}
