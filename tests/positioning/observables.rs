//! Real and independent observations by pseudorange, by Doppler alone and by both, from the Earth's centre.

use super::real::{median, place};
use crate::common::{Failed, Tested, data};
use nalgebra::Vector3;
use rayon::prelude::*;
use sdr_rx::gnss::NavigationData;
use sdr_rx::gnss::atmosphere::Troposphere;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::format::rinex_obs;
use sdr_rx::gnss::observation::ObservationEpoch;
use sdr_rx::position::{Fix, Observable, PositioningOptions, Solver, solve_epoch};

#[test]
fn a_septentrio_is_located_by_each_observable() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let folder = folder.join("obs/matrtklib-static");
    for station in ["rover", "base"] {
        Station {
            observations: folder.join(format!("{station}.obs")),
            navigation: folder.join("base.nav"),
            truth: place(&folder.join(format!("{station}_position.txt")))?,
            troposphere: Troposphere::Saastamoinen,
        }
        .check(5.0, 250.0)?;
    }
    Ok(())
}

#[test]
fn a_simulated_ublox_is_located_by_each_observable() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let folder = folder.join("obs/gps-sdr-sim-rtk");
    Station {
        observations: folder.join("base.obs"),
        navigation: folder.join("base.nav"),
        truth: Vector3::new(-3_813_409.771, 3_554_349.703, 3_662_785.237),
        troposphere: Troposphere::None,
    }
    .check(3.0, 500.0)
}

#[test]
fn a_monitor_station_is_located_by_each_observable() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let folder = folder.join("obs/gnsstk-arlm");
    Station {
        observations: folder.join("arlm200a.15o"),
        navigation: folder.join("arlm2000.15n"),
        truth: Vector3::new(-740_289.918, -5_457_071.734, 3_207_245.542),
        troposphere: Troposphere::Saastamoinen,
    }
    .check(8.0, 100.0)
}

/// Files and the position of the receiver.
struct Station {
    observations: std::path::PathBuf,
    navigation: std::path::PathBuf,
    truth: Vector3<f64>,
    troposphere: Troposphere,
}

impl Station {
    /// Every epoch has a fix by every solver and observable; median 3-D errors are within the bounds, m, and
    /// that by both observables is not above that by pseudoranges.
    fn check(&self, range_bound_m: f64, doppler_bound_m: f64) -> Tested {
        let nav = rinex_nav::read(&self.navigation)?.data;
        let epochs: Vec<_> = rinex_obs::open(&self.observations)?.collect::<Result<_, _>>()?;
        for solver in [Solver::AwDgnBt, Solver::Best] {
            let error = |observable| self.median_error(&epochs, &nav, observable, solver);
            let range = error(Observable::Pseudorange)?;
            let doppler = error(Observable::Doppler)?;
            let both = error(Observable::Both)?;
            // Dopplers have a weight of at most (1 m / 500 m)^2 of the pseudoranges, which is mm of their error.
            if range > range_bound_m || doppler > doppler_bound_m || both > range + 0.01 {
                return Err(
                    format!("{solver}: {range} m, Doppler {doppler} m, both {both} m").into()
                );
            }
        }
        Ok(())
    }

    fn median_error(
        &self,
        epochs: &[ObservationEpoch],
        nav: &NavigationData,
        observable: Observable,
        solver: Solver,
    ) -> Result<f64, Failed> {
        let troposphere = self.troposphere;
        let options =
            PositioningOptions { troposphere, observable, solver, ..PositioningOptions::default() };
        let solve = |epoch: &ObservationEpoch| solve_epoch(epoch, nav, &options);
        let fixes: Vec<Fix> = epochs.par_iter().map(solve).collect::<Result<_, _>>()?;
        let error_m = median(fixes.iter().map(|f| (f.position_m - self.truth).norm()).collect());
        let n = fixes.len() as f64;
        println!(
            "{} {observable:?} {solver}: {n} epochs, median {error_m:.2} m, {:.1} satellites, {:.1} iterations, {} exclusions, sigma {:.1} m",
            self.observations.display(),
            fixes.iter().map(|f| f.residuals.len()).sum::<usize>() as f64 / n,
            fixes.iter().map(|f| f.iterations).sum::<usize>() as f64 / n,
            fixes.iter().filter(|f| !f.excluded.is_empty()).count(),
            median(
                fixes
                    .iter()
                    .map(|f| f.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt())
                    .collect()
            ),
        );
        Ok(error_m)
    }
}
