//! Positions by each satellite system and by all together, of observations at a known place (`SDR_RX_DATA`,
//! `obs/matrtklib-static`), against those of an independent solver.

use nalgebra::Vector3;
use sdr_rx_gnss::NavigationData;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::coordinates::Geodetic;
use sdr_rx_gnss::format::{rinex_nav, rinex_obs};
use sdr_rx_gnss::observation::ObservationEpoch;
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

#[test]
fn each_system_and_all_together_are_as_good_as_an_independent_solver() -> Result<(), Failed> {
    let Some(folder) = folder() else { return Ok(()) };
    for name in ["rover", "base"] {
        let receiver = Receiver::read(&folder, name)?;
        for systems in ["G", "E", "C", "R", "G,J", "G,E", "G,C", "G,R", "G,J,E,C,R"] {
            let start = std::time::Instant::now();
            let fixes = receiver.fixes(systems, 10)?;
            let ms = start.elapsed().as_secs_f64() * 1e3 / fixes.len() as f64;
            let error_m = median(fixes.iter().map(|f| (f.position_m - receiver.position_m).norm()));
            let enu = Geodetic::from_ecef(&receiver.position_m).ecef_to_enu();
            let axis = |k: usize| {
                median(fixes.iter().map(|f| (enu * (f.position_m - receiver.position_m))[k]))
            };
            let last = fixes.last().unwrap();
            let offsets: Vec<String> = last
                .offsets
                .iter()
                .map(|o| {
                    format!(
                        "{:?} {:.2}+-{:.2}",
                        o.system,
                        o.offset_s * SPEED_OF_LIGHT,
                        o.sigma_s * SPEED_OF_LIGHT
                    )
                })
                .collect();
            println!(
                "{name} {systems}: {} sats {error_m:.2} m ENU {:.2} {:.2} {:.2}, {ms:.2} ms, {:?} {:?} excl {:?} bias {:?} {:?} {}",
                last.residuals.len(),
                axis(0),
                axis(1),
                axis(2),
                last.integrity,
                last.reference,
                last.excluded,
                last.clock_bias_s.map(|b| b * SPEED_OF_LIGHT),
                last.clock_bias_sigma_s.map(|b| b * SPEED_OF_LIGHT),
                offsets.join(" ")
            );
        }
    }
    Ok(())
}
