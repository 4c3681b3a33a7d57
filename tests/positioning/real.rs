//! Real and independent observations with known coordinates.

use crate::common::{Failed, Tested, data};
use nalgebra::Vector3;
use sdr_rx::gnss::NavigationData;
use sdr_rx::gnss::atmosphere::Troposphere;
use sdr_rx::gnss::constants::SPEED_OF_LIGHT;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::format::rinex_obs;
use sdr_rx::gnss::observation::{CodeRange, ObservationEpoch};
use sdr_rx::position::{Fix, PositioningOptions, solve_epoch, solve_snapshot};
use std::path::Path;

#[test]
fn real_code_phases_of_one_epoch_are_a_snapshot() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    snapshot(d, 10, 60.0, PositioningOptions::default())
}

#[test]
fn real_code_phases_give_the_time_within_five_hours() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    let time_uncertainty_s = 18_000.0;
    let options = PositioningOptions { time_uncertainty_s, ..PositioningOptions::default() };
    snapshot(d, 30, time_uncertainty_s, options)
}

#[test]
fn real_code_phases_give_the_time_of_the_navigation_file() -> Tested {
    let Some(d) = data() else { return Ok(()) };
    let time_uncertainty_s = f64::INFINITY;
    let options = PositioningOptions { time_uncertainty_s, ..PositioningOptions::default() };
    snapshot(d, 30, 1e8, options)
}

/// The GPS and QZSS L1 C/A part of a file.
fn epochs(path: &Path) -> Result<Vec<ObservationEpoch>, Failed> {
    Ok(rinex_obs::open(path)?.collect::<Result<_, _>>()?)
}

pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Every epoch has a fix; the median 3-D error is below `bound_m`.
fn check(
    epochs: &[ObservationEpoch],
    truth: &Vector3<f64>,
    bound_m: f64,
    solve: impl Fn(&ObservationEpoch) -> Result<Fix, Failed>,
) -> Tested {
    let fixes: Vec<Fix> = epochs.iter().map(solve).collect::<Result<_, _>>()?;
    let error = median(fixes.iter().map(|f| (f.position_m - truth).norm()).collect());
    let speed = median(fixes.iter().filter_map(|f| Some(f.velocity_mps?.norm())).collect());
    let iterations = fixes.iter().map(|f| f.iterations).sum::<usize>() as f64 / fixes.len() as f64;
    let satellites = fixes.iter().map(|f| f.residuals.len()).sum::<usize>() / fixes.len();
    let excluded = fixes.iter().filter(|f| !f.excluded.is_empty()).count();
    println!(
        "{} epochs: median error {error:.2} m, speed {speed:.3} m/s, {satellites} satellites, \
         {iterations:.1} iterations, exclusions in {excluded}",
        fixes.len()
    );
    // The receivers are at rest; a Doppler of 0.1 to 0.5 Hz is 0.02 to 0.1 m/s, times a dilution of 3.
    if error <= bound_m && speed < 0.3 {
        Ok(())
    } else {
        Err(format!("median error {error} m, speed {speed} m/s").into())
    }
}

fn full(
    nav: &NavigationData,
    options: PositioningOptions,
) -> impl Fn(&ObservationEpoch) -> Result<Fix, Failed> {
    move |epoch| Ok(solve_epoch(epoch, nav, &options)?)
}

#[test]
fn a_simulated_ublox_is_located_to_three_metres() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let folder = folder.join("obs/gps-sdr-sim-rtk");
    let nav = rinex_nav::read(folder.join("base.nav"))?.data;
    let truth = Vector3::new(-3_813_409.771, 3_554_349.703, 3_662_785.237);
    let options = PositioningOptions { troposphere: Troposphere::None, ..Default::default() };
    check(&epochs(&folder.join("base.obs"))?, &truth, 3.0, full(&nav, options))
}

#[test]
fn a_septentrio_on_a_roof_is_located_to_five_metres() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    let folder = folder.join("obs/matrtklib-static");
    let nav = rinex_nav::read(folder.join("base.nav"))?.data;
    for station in ["rover", "base"] {
        let truth = place(&folder.join(format!("{station}_position.txt")))?;
        let epochs = epochs(&folder.join(format!("{station}.obs")))?;
        check(&epochs, &truth, 5.0, full(&nav, PositioningOptions::default()))?;
    }
    Ok(())
}

/// Latitude, longitude (deg) and height (m) of a file, as ECEF.
pub fn place(path: &Path) -> Result<Vector3<f64>, Failed> {
    let text = std::fs::read_to_string(path)?;
    let numbers: Vec<f64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
    let &[latitude, longitude, height] = &numbers[..] else { return Err("three numbers".into()) };
    Ok(Geodetic::from_degrees(latitude, longitude, height).to_ecef())
}

/// The pseudoranges of the roof, of every so many epochs, modulo a millisecond, and the time given with an error
/// of up to `off_s`: it is found to 0.1 s. Coarse time costs about three times the error of the
/// full fix.
fn snapshot(folder: &Path, every: usize, off_s: f64, options: PositioningOptions) -> Tested {
    // Whole milliseconds are resolved for one clock.
    let options = PositioningOptions { systems: "G,J".parse()?, ..options };
    let folder = folder.join("obs/matrtklib-static");
    let nav = rinex_nav::read(folder.join("base.nav"))?.data;
    let truth = place(&folder.join("rover_position.txt"))?;
    let mut epochs: Vec<ObservationEpoch> =
        epochs(&folder.join("rover.obs"))?.into_iter().step_by(every).collect();
    let mut times = Vec::new();
    for (k, epoch) in epochs.iter_mut().enumerate() {
        times.push(epoch.receive_time);
        epoch.receive_time =
            epoch.receive_time + off_s * ((37.0 * k as f64).rem_euclid(120.0) / 60.0 - 1.0);
        for observation in &mut epoch.observations {
            if let Some(range_m) = observation.pseudorange_m() {
                let phase_m = range_m.rem_euclid(SPEED_OF_LIGHT * 1e-3);
                observation.range = Some(CodeRange::ModuloCodePeriod(phase_m));
            }
        }
    }
    check(&epochs, &truth, 15.0, |epoch| {
        let fix = solve_snapshot(epoch, &nav, &options)?;
        let nearest = times.iter().map(|t| (fix.time - *t).abs()).fold(f64::INFINITY, f64::min);
        if nearest < 0.1 { Ok(fix) } else { Err(format!("time off by {nearest} s").into()) }
    })
}
