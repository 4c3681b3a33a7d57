//! Common corrections for receivers of one frequency.
//!
//! At a station of known position each pseudorange contains, beside the station's clock, the errors of the satellite
//! that are common to the region: orbit, clock, ionosphere, troposphere. With the clock eliminated this is the
//! model of satellite biases again, and the network estimates the corrections as it does biases. A receiver
//! near the network then subtracts them, and weights each satellite by the variance of its correction.
//!
//! A satellite in view of no station, and the constant that could move to the clocks, are determined by an a-priori
//! weight, of which each of the n stations has 1/n: the sum over the network contains it once.

use super::nonlinear::pseudoranges_about;
use super::{Datum, LinearModel, NetworkError, NetworkSolution, Normals};
use nalgebra::{DMatrix, DVector, Vector3};

/// Standard deviation a priori of a correction where nothing else is known, m.
pub const PRIOR_SIGMA_M: f64 = 10.0;

/// A pseudorange of one of the network's satellites.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranging {
    /// Which satellite: the index of its correction among the parameters, from 0.
    pub satellite: usize,
    /// Its position at transmission in the frame of the instant of reception, ECEF, m.
    pub position_m: Vector3<f64>,
    /// The pseudorange, the satellite's clock and what else is modelled removed, m.
    pub pseudorange_m: f64,
    /// Standard deviation of the noise of this observation alone, m.
    pub sigma_m: f64,
}

/// A station's normal equations of the corrections of all `satellites`, m, as they add to pseudoranges: from its
/// known position (ECEF, m), its own clock eliminated, with the fraction 1 / `stations` of the weight a priori.
///
/// # Errors
/// [`NetworkError::WrongSize`] when an observation is of a satellite beyond the last.
pub fn station_normals(
    station_m: &Vector3<f64>,
    observed: &[Ranging],
    satellites: usize,
    prior_sigma_m: f64,
    stations: usize,
) -> Result<Normals, NetworkError> {
    check(observed, satellites)?;
    let design = DMatrix::from_fn(observed.len(), satellites, |k, satellite| {
        f64::from(u8::from(observed[k].satellite == satellite))
    });
    let residual = |o: &Ranging| o.pseudorange_m - (o.position_m - station_m).norm();
    let residuals = DVector::from_iterator(observed.len(), observed.iter().map(residual));
    let weights: Vec<f64> = observed.iter().map(|o| o.sigma_m.powi(-2)).collect();
    let mut normals = LinearModel::with_receiver_bias(design, residuals, &weights).normals();
    let fraction = 1.0 / stations as f64;
    for satellite in 0..satellites {
        normals.matrix[(satellite, satellite)] += fraction * prior_sigma_m.powi(-2);
    }
    normals.freedom += fraction * satellites as f64;
    Ok(normals)
}

/// A position (ECEF, m) from pseudoranges and the network's corrections, by Gauss-Newton from `start_m`, the clock
/// eliminated. The observations' covariance is that of the noise plus that of the corrections.
///
/// # Errors
/// [`NetworkError::WrongSize`] for a satellite without a correction, [`NetworkError::Singular`] when the
/// satellites do not determine a position or no solution is found in 30 steps.
pub fn position(
    start_m: &Vector3<f64>,
    observed: &[Ranging],
    corrections: &NetworkSolution,
) -> Result<NetworkSolution, NetworkError> {
    check(observed, corrections.x.len())?;
    let m = observed.len();
    let of = |k: usize| observed[k].satellite;
    let mut covariance = DMatrix::from_fn(m, m, |j, k| corrections.covariance[(of(j), of(k))]);
    for (k, o) in observed.iter().enumerate() {
        covariance[(k, k)] += o.sigma_m * o.sigma_m;
    }
    let weight = covariance.cholesky().ok_or(NetworkError::Singular(m))?.inverse();
    let summed = weight.column_sum();
    let weight = &weight - &summed * summed.transpose() / summed.sum();
    let satellites_m: Vec<Vector3<f64>> = observed.iter().map(|o| o.position_m).collect();
    let corrected: Vec<f64> =
        observed.iter().map(|o| o.pseudorange_m - corrections.x[o.satellite]).collect();
    let mut position_m = *start_m;
    for _ in 0..30 {
        let about = pseudoranges_about(&position_m, &satellites_m, &corrected, &vec![1.0; m]);
        let model = LinearModel { weight: weight.clone(), ..about };
        let step = model.normals().solve(Datum::Observed)?;
        position_m += &step.x;
        if step.x.norm() < 1e-6 {
            let x = DVector::from_column_slice(position_m.as_slice());
            return Ok(NetworkSolution { x, ..step });
        }
    }
    Err(NetworkError::Singular(3))
}

fn check(observed: &[Ranging], satellites: usize) -> Result<(), NetworkError> {
    match observed.iter().find(|o| o.satellite >= satellites) {
        None => Ok(()),
        Some(o) => {
            let what = "the number of an observed satellite".into();
            Err(NetworkError::WrongSize { what, found: o.satellite, expected: satellites })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::consensus::{Node, NodeOptions};
    use super::super::plan::{self, Plan};
    use super::super::{Constraints, info, sim, test_scene};
    use super::*;
    use rand::RngExt;
    use rand::seq::IndexedRandom;
    use rand_chacha::ChaCha8Rng;
    use rayon::prelude::*;
    use std::f64::consts::TAU;

    const SATELLITES: usize = 9;
    const NOISE_M: f64 = 0.6;
    const COMMON_M: f64 = 3.0;

    /// A position, and nine satellites anywhere above 10 deg of elevation.
    fn constellation(random: &mut ChaCha8Rng) -> (Vector3<f64>, Vec<Vector3<f64>>) {
        let receiver_m = Vector3::x() * test_scene::EARTH_M;
        let satellite = |_| {
            let up: f64 = random.random_range(10f64.to_radians().sin()..1.0);
            let (north, east) = random.random_range(0.0..TAU).sin_cos();
            let across = (1.0 - up * up).sqrt();
            receiver_m + 2.2e7 * Vector3::new(up, across * east, across * north)
        };
        (receiver_m, (0..SATELLITES).map(satellite).collect())
    }

    fn observe(
        station_m: &Vector3<f64>,
        seen: &[usize],
        satellites_m: &[Vector3<f64>],
        common_m: &[f64],
        random: &mut ChaCha8Rng,
    ) -> Vec<Ranging> {
        let clock_m = 1e5 * test_scene::normal(random);
        let mut ranging = |&satellite: &usize| {
            let range_m = (satellites_m[satellite] - station_m).norm();
            let noise_m = NOISE_M * test_scene::normal(random);
            let pseudorange_m = range_m + clock_m + common_m[satellite] + noise_m;
            Ranging {
                satellite,
                position_m: satellites_m[satellite],
                pseudorange_m,
                sigma_m: NOISE_M,
            }
        };
        seen.iter().map(&mut ranging).collect()
    }

    /// Results of a receiver near nine stations, as (squared 3-D error, error normalised by its covariance):
    /// without corrections, with those of its node's ten averages, with a centre's, with the true ones.
    fn trial(seed: u64, constraints: &Constraints, plan: &Plan) -> [(f64, f64); 4] {
        let random = &mut test_scene::stream(11, seed);
        let (middle, satellites_m) = constellation(random);
        let common_m: Vec<f64> =
            (0..SATELLITES).map(|_| COMMON_M * test_scene::normal(random)).collect();
        let all: Vec<usize> = (0..SATELLITES).collect();
        let station = |_| {
            let receiver_m = test_scene::position_near(&middle, 0.03, random);
            let count = random.random_range(3..=6);
            let seen: Vec<usize> = all.sample(random, count).copied().collect();
            let observed = observe(&receiver_m, &seen, &satellites_m, &common_m, random);
            station_normals(&receiver_m, &observed, SATELLITES, PRIOR_SIGMA_M, 9).unwrap()
        };
        let stations: Vec<Normals> = (0..9).map(station).collect();
        let mut sum = Normals::none(SATELLITES);
        stations.iter().for_each(|station| sum.add(station));

        let options = NodeOptions { relaxation: plan.relaxation, ..NodeOptions::default() };
        let node = |id: usize| {
            let own = info::pack(&stations[id]);
            let problem = info::Average { own, rho: plan.rho };
            Node::new(id, constraints, problem, options).unwrap()
        };
        let mut nodes: Vec<_> = (0..9).map(node).collect();
        (0..10).for_each(|_| sim::iterate(&mut nodes));
        let mean = info::unpack(nodes[8].estimate(), SATELLITES).unwrap();

        let receiver_m = test_scene::position_near(&middle, 0.03, random);
        let observed = observe(&receiver_m, &all, &satellites_m, &common_m, random);
        let none = NetworkSolution {
            x: DVector::zeros(SATELLITES),
            covariance: DMatrix::zeros(SATELLITES, SATELLITES),
            misfit: 0.0,
            freedom: 0.0,
        };
        let perfect = NetworkSolution { x: DVector::from_column_slice(&common_m), ..none.clone() };
        let averaged = mean.scaled(9.0).solve(Datum::Observed).unwrap();
        let central = sum.solve(Datum::Observed).unwrap();
        [none, averaged, central, perfect].map(|corrections| {
            let found = position(&(receiver_m * 1.001), &observed, &corrections).unwrap();
            let error = found.x - DVector::from_column_slice(receiver_m.as_slice());
            let precision = found.covariance.cholesky().unwrap();
            (error.norm_squared(), error.dot(&precision.solve(&error)))
        })
    }

    #[test]
    fn a_receiver_near_the_network_gains_by_the_corrections() {
        const TRIALS: u32 = 1000;
        let constraints = test_scene::nine();
        let plan = plan::plan(&constraints).unwrap();
        let trial = |seed: u32| trial(seed.into(), &constraints, &plan);
        let trials: Vec<_> = (0..TRIALS).into_par_iter().map(trial).collect();
        let mean = |of: fn(&(f64, f64)) -> f64, k: usize| {
            trials.iter().map(|trial| of(&trial[k])).sum::<f64>() / f64::from(TRIALS)
        };
        let [plain, with, central, bound] = [0, 1, 2, 3].map(|k| mean(|e| e.0, k).sqrt());
        assert!(plain > 5.0 && with < 1.8 && bound < with, "{plain} {with} {bound} m");
        // Ten averages leave an error far below the noise.
        assert!((with - central).abs() < 0.01 * central);
        // The mean of chi-squares of 3 degrees, to four of its standard deviations.
        let allowed = 4.0 * (6.0 / f64::from(TRIALS)).sqrt();
        for k in [1, 3] {
            assert!((mean(|e| e.1, k) - 3.0).abs() < allowed, "{}", mean(|e| e.1, k));
        }
    }

    #[test]
    fn a_satellite_in_view_of_no_station_keeps_its_weight_a_priori() {
        let random = &mut test_scene::stream(5, 0);
        let (receiver_m, satellites_m) = constellation(random);
        let seen: Vec<usize> = (0..8).collect();
        let observed = observe(&receiver_m, &seen, &satellites_m, &[0.0; SATELLITES], random);
        let mut sum = Normals::none(SATELLITES);
        for _ in 0..3 {
            sum.add(
                &station_normals(&receiver_m, &observed, SATELLITES, PRIOR_SIGMA_M, 3).unwrap(),
            );
        }
        let corrections = sum.solve(Datum::Observed).unwrap();
        assert!((corrections.sigma()[8] - PRIOR_SIGMA_M).abs() < 1e-9);
        assert!(station_normals(&receiver_m, &observed, 7, PRIOR_SIGMA_M, 3).is_err());
        assert!(position(&receiver_m, &observed[..3], &corrections).is_err());
    }
}
