//! A receiver at rest in Tokyo, its observations computed from broadcast ephemerides without noise.

use crate::common::Failed;
use nalgebra::{Matrix3, Vector3};
use sdr_rx::acquisition::Acquisition;
use sdr_rx::capture::StreamInfo;
use sdr_rx::gnss::constants::SPEED_OF_LIGHT;
use sdr_rx::gnss::coordinates::azimuth_elevation;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::observation::{CodeRange, Observation, ObservationEpoch};
use sdr_rx::gnss::orbit::Propagation;
use sdr_rx::gnss::signal::{self, L1_CENTRE_HZ, L1_WAVELENGTH};
use sdr_rx::gnss::{Constellation, GpsTime, NavigationData, Sv};
use sdr_rx::position::{Fix, FixMethod, FixStart, Integrity, ProtectionLevel, Residual};
use sdr_rx::report::{Input, Run};
use std::path::Path;

/// Position of the receiver, m, ECEF.
pub const TRUTH_M: Vector3<f64> = Vector3::new(-3_959_617.5, 3_350_136.6, 3_699_531.5);
/// Receive times, one a second.
pub const EPOCHS: usize = 30;
/// Samples per second.
const RATE_HZ: f64 = 2.6e6;

pub struct Scene {
    pub navigation: NavigationData,
    pub epochs: Vec<ObservationEpoch>,
    pub fixes: Vec<Fix>,
    acquisitions: Vec<Acquisition>,
    stream: StreamInfo,
    warnings: Vec<String>,
}

impl Scene {
    pub fn new(folder: &Path) -> Result<Self, Failed> {
        let navigation = rinex_nav::read(folder.join("nav/brdc0010.22n"))?.data;
        let start = GpsTime::from_week_tow(2190, 525_600.0);
        let epochs: Vec<_> = (0..EPOCHS).map(|k| epoch(&navigation, start + k as f64, k)).collect();
        let fixes = epochs.iter().map(|e| fix(&navigation, e)).collect();
        let acquisition = |o: &Observation| Acquisition {
            transmission: o.transmission,
            doppler_hz: o.doppler_hz.unwrap(),
            code_phase_chips: 511.5,
            cn0_dbhz: o.cn0_dbhz.unwrap(),
            statistic: 50.0,
            false_alarm: 1e-12,
        };
        let stream = StreamInfo {
            rate_hz: RATE_HZ,
            if_hz: 0.0,
            channels: 1,
            real: false,
            samples: Some((EPOCHS as f64 * RATE_HZ) as u64),
            start_time: None,
            format: "cs8".to_owned(),
            array: None,
        };
        let acquisitions = epochs[0].observations.iter().map(acquisition).collect();
        let warnings = vec!["spectrum <mirrored>?".to_owned()];
        Ok(Self { navigation, epochs, fixes, acquisitions, stream, warnings })
    }

    pub fn run(&self) -> Run<'_> {
        Run {
            sky: None,
            sky_epochs: &[],
            sbas: &[],
            noise: None,
            interferers: &[],
            capture: "scene & co.bin",
            input: Input::Samples(&self.stream),
            acquisitions: &self.acquisitions,
            epochs: &self.epochs,
            fixes: &self.fixes,
            navigation: &self.navigation,
            warnings: &self.warnings,
            reason: None,
            first_fix_s: None,
            reference: None,
            seed: Some(7),
            options: serde_json::json!({ "troposphere": "none" }),
        }
    }
}

fn epoch(navigation: &NavigationData, time: GpsTime, k: usize) -> ObservationEpoch {
    let observe = |sv: Sv| {
        let eph = navigation.ephemeris(sv, time).filter(|e| e.health == 0)?;
        let p = Propagation::solve(eph, &TRUTH_M, time);
        let (_, elevation) = azimuth_elevation(&TRUTH_M, &p.satellite.position_m);
        let metres = p.range_m - SPEED_OF_LIGHT * p.satellite.clock_bias_s;
        let sight = (p.satellite.position_m - TRUTH_M) / p.range_m;
        let doppler_hz = -sight.dot(&p.satellite.velocity_mps) / L1_WAVELENGTH
            + L1_CENTRE_HZ * p.satellite.clock_drift_sps;
        (elevation > 0.26).then_some(Observation {
            transmission: signal::of(sv),
            range: Some(CodeRange::Pseudorange(metres)),
            range_sigma_m: 1.0,
            doppler_hz: Some(doppler_hz),
            doppler_sigma_hz: 1.0,
            carrier_phase_cycles: Some(metres / L1_WAVELENGTH),
            lost_lock: k == 3,
            cn0_dbhz: Some(35.0 + 10.0 * elevation.sin()),
        })
    };
    let observations = navigation.satellites().filter_map(observe).collect();
    ObservationEpoch { receive_time: time, sample: k as f64 * RATE_HZ, observations }
}

/// A fix a metre to the east or west of the true position by turns.
fn fix(navigation: &NavigationData, epoch: &ObservationEpoch) -> Fix {
    let residual = |o: &Observation| {
        let eph = navigation.ephemeris(o.sv(), epoch.receive_time)?;
        let p = Propagation::solve(eph, &TRUTH_M, epoch.receive_time);
        let (azimuth, elevation) = azimuth_elevation(&TRUTH_M, &p.satellite.position_m);
        Some(Residual { sv: o.sv(), range_m: Some(0.5), doppler_hz: Some(0.1), azimuth, elevation })
    };
    let side = if (epoch.sample as u64 / RATE_HZ as u64).is_multiple_of(2) { 1.0 } else { -1.0 };
    let to_enu = sdr_rx::gnss::coordinates::Geodetic::from_ecef(&TRUTH_M).ecef_to_enu();
    Fix {
        time: epoch.receive_time,
        sample: epoch.sample,
        position_m: TRUTH_M + to_enu.transpose() * Vector3::new(side, 0.0, 0.0),
        velocity_mps: Some(to_enu.transpose() * Vector3::new(0.0, 2.0, 0.0)),
        clock_bias_s: Some(0.0),
        reference: Constellation::Gps,
        offsets: Vec::new(),
        clock_drift_sps: Some(0.0),
        covariance: Matrix3::identity(),
        clock_bias_sigma_s: Some(3e-9),
        pdop: 2.0,
        hdop: 1.2,
        vdop: 1.6,
        residuals: epoch.observations.iter().filter_map(residual).collect(),
        excluded: Vec::new(),
        unused: Vec::new(),
        integrity: Integrity::Verified,
        doubt: None,
        protection: Some(ProtectionLevel {
            position_m: 20.0,
            horizontal_m: 12.0,
            vertical_m: 16.0,
        }),
        method: FixMethod::Tracking,
        time_search: None,
        alternatives_m: Vec::new(),
        start: FixStart { solver: "aw-dgn-bt", iterations: 6, failed: None },
        iterations: 9,
    }
}
