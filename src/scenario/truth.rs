//! The truth of a simulated capture.

use super::sky::Emitter;
use super::{Scenario, ScenarioSource};
use crate::capture::SampleSource;
use crate::gnss::Sv;
use crate::gnss::antenna::direction;
use crate::gnss::coordinates::Geodetic;
use nalgebra::{Unit, Vector3};
use serde::Serialize;

/// The truth of a capture, as written beside it.
#[derive(Clone, Debug, Serialize)]
pub struct Truth {
    /// Schema: `sdr-rx-truth/1`.
    pub schema: &'static str,
    /// The scenario with all defaults; its array is the real one, errors drawn and included.
    pub scenario: Scenario,
    /// The jammers, in the scenario's order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub jammers: Vec<JammerTruth>,
    /// The first sample, and the first at or after each second.
    pub epochs: Vec<TruthEpoch>,
}

/// Direction of a jammer.
#[derive(Clone, Debug, Serialize)]
pub struct JammerTruth {
    /// Azimuth, degrees from north over east.
    pub azimuth_deg: f64,
    /// Elevation, degrees.
    pub elevation_deg: f64,
    /// In the frame of the array.
    #[serde(flatten)]
    pub arrival: Option<ArrivalTruth>,
}

/// Direction of a wave in the frame of the array.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ArrivalTruth {
    /// Unit vector towards the source in the frame of the array: right, forward, up.
    pub direction_cosines: [f64; 3],
    /// Of a linear array: the angle from its broadside towards its last element, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub array_angle_deg: Option<f64>,
}

/// The truth at one sample.
#[derive(Clone, Debug, Serialize)]
pub struct TruthEpoch {
    /// Index of the sample.
    pub sample: u64,
    /// GPS week.
    pub gps_week: i32,
    /// True GPS time of week, s.
    pub tow_s: f64,
    /// Antenna position, m, ECEF.
    pub position_ecef_m: [f64; 3],
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Height above the ellipsoid, m.
    pub height_m: f64,
    /// Velocity, m/s, ECEF.
    pub velocity_ecef_mps: [f64; 3],
    /// Receiver clock minus GPS time, s.
    pub clock_bias_s: f64,
    /// Drift of the receiver clock, s/s.
    pub clock_drift_sps: f64,
    /// The satellites.
    pub satellites: Vec<SatelliteTruth>,
}

/// The truth of one satellite at one sample.
#[derive(Clone, Debug, Serialize)]
pub struct SatelliteTruth {
    /// The satellite.
    pub sv: Sv,
    /// Position at transmission in the ECEF frame of reception, m.
    pub position_ecef_m: [f64; 3],
    /// Satellite clock minus GPS time for a user of this signal, s.
    pub clock_bias_s: f64,
    /// Satellite time of week of transmission, s.
    pub transmit_tow_s: f64,
    /// Geometric range, m.
    pub range_m: f64,
    /// Code pseudorange by the receiver's clock, m.
    pub pseudorange_m: f64,
    /// Carrier phase, cycles, growing with the range; the phase of the baseband signal is minus this.
    pub carrier_phase_cycles: f64,
    /// Apparent Doppler by the receiver's clock, Hz: positive when the satellite approaches.
    pub doppler_hz: f64,
    /// Code phase, chips from 0 to below a code period.
    pub code_phase_chips: f64,
    /// Azimuth of the satellite, degrees from north over east.
    pub azimuth_deg: f64,
    /// Elevation of the satellite, degrees.
    pub elevation_deg: f64,
    /// Direction of its signal at the array (of the spoofer, when that sends it).
    #[serde(flatten)]
    pub arrival: Option<ArrivalTruth>,
    /// Whether a spoofer sends its signal.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub spoofed: bool,
    /// Carrier-to-noise density of the background noise, dB-Hz.
    pub cn0_dbhz: f64,
}

impl ScenarioSource {
    /// The truth of the whole capture.
    pub fn truth(&self) -> Truth {
        let rate = self.info().rate_hz;
        let samples = self.info().samples.unwrap_or(0);
        let epochs = (0u64..)
            .map(|second| (second as f64 * rate).ceil() as u64)
            .take_while(|&sample| sample == 0 || sample < samples)
            .map(|sample| self.truth_at(sample))
            .collect();
        let jammers = self.jamming().iter().map(|j| jammer_truth(self.scenario(), &j.towards));
        Truth {
            schema: "sdr-rx-truth/1",
            scenario: self.scenario().clone(),
            jammers: jammers.collect(),
            epochs,
        }
    }

    /// The truth at one sample: exact, not from the interpolation that made the signal.
    pub fn truth_at(&self, sample: u64) -> TruthEpoch {
        let elapsed = sample as f64 / self.info().rate_hz;
        let receiver = self.emitters()[0].range.path().trajectory.state(elapsed);
        let position = Geodetic::from_ecef(&receiver.position_m);
        TruthEpoch {
            sample,
            gps_week: receiver.time.week(),
            tow_s: receiver.time.tow(),
            position_ecef_m: receiver.position_m.into(),
            latitude_deg: position.latitude.to_degrees(),
            longitude_deg: position.longitude.to_degrees(),
            height_m: position.height,
            velocity_ecef_mps: receiver.velocity_mps.into(),
            clock_bias_s: receiver.clock_bias_s,
            clock_drift_sps: receiver.clock_drift_sps,
            satellites: self
                .emitters()
                .iter()
                .map(|e| satellite_truth(self.scenario(), e, elapsed))
                .collect(),
        }
    }
}

fn jammer_truth(scenario: &Scenario, towards: &Unit<Vector3<f64>>) -> JammerTruth {
    JammerTruth {
        azimuth_deg: towards.x.atan2(towards.y).to_degrees().rem_euclid(360.0),
        elevation_deg: towards.z.asin().to_degrees(),
        arrival: arrival(scenario, towards),
    }
}

fn arrival(scenario: &Scenario, towards: &Unit<Vector3<f64>>) -> Option<ArrivalTruth> {
    let array = scenario.array.as_ref()?;
    let local = array.to_platform(towards);
    let angle = |axis: Unit<Vector3<f64>>| axis.dot(&local).clamp(-1.0, 1.0).asin().to_degrees();
    Some(ArrivalTruth {
        direction_cosines: local.into_inner().into(),
        array_angle_deg: array.array.axis().map(angle),
    })
}

fn satellite_truth(scenario: &Scenario, emitter: &Emitter, elapsed: f64) -> SatelliteTruth {
    let path = emitter.range.path();
    let view = path.view(elapsed);
    let transmit = path.transmit_time(elapsed, &view.pseudorange);
    let transmission = emitter.transmission;
    let periods = transmit.parts().1 / transmission.signal.period_s();
    let spoofed_from = emitter.spoofed_from(elapsed);
    let towards = spoofed_from.unwrap_or_else(|| direction(view.azimuth, view.elevation));
    SatelliteTruth {
        sv: transmission.sv,
        position_ecef_m: view.propagation.satellite.position_m.into(),
        clock_bias_s: view.propagation.satellite.clock_bias_s,
        transmit_tow_s: transmit.tow(),
        range_m: view.propagation.range_m,
        pseudorange_m: view.pseudorange.code_m,
        carrier_phase_cycles: view.pseudorange.carrier_m / transmission.wavelength_m()
            - emitter.phase,
        doppler_hz: -path.carrier_rate(elapsed) / transmission.wavelength_m(),
        code_phase_chips: periods.fract() * transmission.signal.chips as f64,
        azimuth_deg: view.azimuth.to_degrees(),
        elevation_deg: view.elevation.to_degrees(),
        arrival: arrival(scenario, &towards),
        spoofed: spoofed_from.is_some(),
        cn0_dbhz: scenario.signal.cn0_dbhz(transmission.sv, view.elevation, elapsed),
    }
}
