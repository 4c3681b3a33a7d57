//! Positions by each satellite system and by all together, of observations at a known place (`SDR_RX_DATA`,
//! `obs/matrtklib-static`), against those of an independent solver.

use nalgebra::Vector3;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::format::{rinex_nav, rinex_obs};
use sdr_rx_gnss::observation::{CodeRange, ObservationEpoch};
use sdr_rx_gnss::{Constellation, NavigationData};
use sdr_rx_position::{Fix, PositioningOptions, solve_epoch};
use std::path::{Path, PathBuf};

type Failed = Box<dyn std::error::Error + Send + Sync>;

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("SDR_RX_DATA");
    if folder.is_none() {
        println!("SDR_RX_DATA is not set: observations of all systems are passed over");
    }
    folder.map(|data| Path::new(&data).join("obs/matrtklib-static"))
}

/// A receiver's epochs, its orbits and its position.
struct Receiver {
    epochs: Vec<ObservationEpoch>,
    navigation: NavigationData,
    position_m: Vector3<f64>,
}

impl Receiver {
    fn read(folder: &Path, name: &str) -> Result<Self, Failed> {
        let mut reader = rinex_obs::open(folder.join(format!("{name}.obs")))?;
        let mut navigation = rinex_nav::read(folder.join("base.nav"))?.data;
        navigation.glonass_channels.extend(reader.header().glonass_channels.clone());
        let epochs = reader.by_ref().collect::<Result<_, _>>()?;
        let text = std::fs::read_to_string(folder.join(format!("{name}_position.txt")))?;
        let numbers: Vec<f64> =
            text.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let [latitude, longitude, height] = numbers[..] else { return Err("no position".into()) };
        let position_m = Geodetic::from_degrees(latitude, longitude, height).to_ecef();
        Ok(Self { epochs, navigation, position_m })
    }

    /// The fixes of each `step`th epoch.
    fn fixes(&self, systems: &str, step: usize) -> Result<Vec<Fix>, Failed> {
        let options = options(systems)?;
        let epochs = self.epochs.iter().step_by(step);
        epochs.map(|e| Ok(solve_epoch(e, &self.navigation, &options)?)).collect()
    }
}

fn options(systems: &str) -> Result<PositioningOptions, Failed> {
    Ok(PositioningOptions {
        systems: systems.parse()?,
        elevation_mask: 15f64.to_radians(),
        min_cn0_dbhz: Some(28.0),
        ..PositioningOptions::default()
    })
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Median 3-D errors, m, of RTKLIB 2.4.3 b34 (`rnx2rtkp`: 15 degrees, broadcast ionosphere, Saastamoinen, frequency l1,
/// QZSS on GPS's clock) on the same files, rover and base.
const REFERENCE: [(&str, [f64; 2]); 6] = [
    ("G", [4.13, 4.06]),
    ("E", [2.17, 2.18]),
    ("C", [2.88, 2.77]),
    ("R", [3.71, 3.38]),
    ("G,E", [3.18, 3.18]),
    ("G,J,E,C,R", [2.68, 2.59]),
];
/// Solutions differ by their weights alone: RTKLIB's and an independent one of other weights by up to 0.15 m in these
/// medians; twice that.
const WEIGHTS_M: f64 = 0.3;
/// The same of offsets to GPS, m, of the independent solution: Galileo, BeiDou, GLONASS (that of two systems, as its fix is).
const OFFSETS_M: [(&str, Constellation, [f64; 2]); 3] = [
    ("G,E", Constellation::Galileo, [0.1, 0.1]),
    ("G,C", Constellation::BeiDou, [1.9, 4.8]),
    ("G,R", Constellation::Glonass, [2.8, 3.0]),
];

#[test]
fn each_system_and_all_together_are_as_good_as_an_independent_solver() -> Result<(), Failed> {
    let Some(folder) = folder() else { return Ok(()) };
    for (which, name) in ["rover", "base"].into_iter().enumerate() {
        let receiver = Receiver::read(&folder, name)?;
        for (systems, reference_m) in REFERENCE {
            let start = std::time::Instant::now();
            let fixes = receiver.fixes(systems, 1)?;
            let ms = start.elapsed().as_secs_f64() * 1e3 / fixes.len() as f64;
            let errors_m = fixes.iter().map(|f| (f.position_m - receiver.position_m).norm());
            let error_m = median(errors_m.clone());
            let worst_m = errors_m.fold(0.0, f64::max);
            let most = fixes.iter().map(|f| f.residuals.len()).max().unwrap_or(0);
            println!(
                "{name} {systems}: {most} satellites, median {error_m:.2} m (RTKLIB {}), worst {worst_m:.2} m, {ms:.2} ms a fix",
                reference_m[which]
            );
            assert_eq!(fixes.len(), receiver.epochs.len());
            assert!(error_m < reference_m[which] + WEIGHTS_M, "{name} {systems}: {error_m} m");
            // Errors are those that the covariances state, within four of these.
            for fix in &fixes {
                let sigma_m = fix.covariance.trace().sqrt();
                assert!((fix.position_m - receiver.position_m).norm() < 4.0 * sigma_m);
            }
        }
    }
    Ok(())
}

#[test]
fn offsets_between_systems_agree_with_an_independent_solver_and_with_each_system_alone()
-> Result<(), Failed> {
    let Some(folder) = folder() else { return Ok(()) };
    for (which, name) in ["rover", "base"].into_iter().enumerate() {
        let receiver = Receiver::read(&folder, name)?;
        for (systems, system, reference_m) in OFFSETS_M {
            let (both, alone) = (receiver.fixes(systems, 10)?, receiver.fixes(&systems[2..], 10)?);
            let offset = |fix: &Fix| fix.offsets.iter().find(|o| o.system == system).copied();
            let offsets: Vec<_> = both.iter().filter_map(offset).collect();
            assert_eq!(offsets.len(), both.len());
            let offset_m = median(offsets.iter().map(|o| o.offset_s * SPEED_OF_LIGHT));
            println!("{name} {system:?}: {offset_m:.2} m against GPS ({})", reference_m[which]);
            assert!((offset_m - reference_m[which]).abs() < WEIGHTS_M, "{name} {system:?}");
            for ((both, alone), offset) in both.iter().zip(&alone).zip(&offsets) {
                assert_eq!((both.reference, alone.reference), (Constellation::Gps, system));
                let bias = |fix: &Fix| fix.clock_bias_s.zip(fix.clock_bias_sigma_s);
                let (Some((joint_s, _)), Some((alone_s, sigma_s))) = (bias(both), bias(alone))
                else {
                    return Err("no bias".into());
                };
                // The system's clock in both solutions, which share its ranges: within three deviations of the one alone.
                let off_s = alone_s - (joint_s + offset.offset_s);
                assert!(off_s.abs() < 3.0 * sigma_s, "{name} {system:?}: {off_s} s");
            }
        }
    }
    Ok(())
}

/// Two of 42 satellites are wrong by hundreds of metres: 12 341 sets without up to three of them are judged.
#[test]
fn two_faults_among_all_satellites_are_excluded() -> Result<(), Failed> {
    let Some(folder) = folder() else { return Ok(()) };
    let receiver = Receiver::read(&folder, "rover")?;
    let options = options("G,J,E,C,R")?;
    let good = solve_epoch(&receiver.epochs[0], &receiver.navigation, &options)?;
    let faulty = ["G05", "E11"];
    let mut epoch = receiver.epochs[0].clone();
    for o in epoch.observations.iter_mut().filter(|o| faulty.contains(&&*o.sv().to_string())) {
        if let Some(CodeRange::Pseudorange(range_m)) = &mut o.range {
            *range_m += 300.0;
        }
    }
    let start = std::time::Instant::now();
    let fix = solve_epoch(&epoch, &receiver.navigation, &options)?;
    println!("two faults of {}: {:?}", good.residuals.len(), start.elapsed());
    let excluded: Vec<String> = fix.excluded.iter().map(ToString::to_string).collect();
    assert_eq!(excluded, faulty);
    // What two of 42 satellites weigh: by far less than the standard deviation.
    let moved_m = (fix.position_m - good.position_m).norm();
    assert!(moved_m < good.covariance.trace().sqrt(), "{moved_m} m");
    Ok(())
}
