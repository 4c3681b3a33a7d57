//! What a receiver at a place and time would measure of a satellite, with every correction that
//! broadcast data allow, and how far that may be off.

use crate::PositioningOptions;
use crate::problem::Satellite;
use nalgebra::Vector3;
use sdr_rx_gnss::constants::{MU_EARTH, OMEGA_EARTH, SPEED_OF_LIGHT};
use sdr_rx_gnss::coordinates::{Geodetic, azimuth_elevation};
use sdr_rx_gnss::orbit::Propagation;
use sdr_rx_gnss::signal::L1_CENTRE_HZ;
use sdr_rx_gnss::{GpsTime, NavigationData, Orbit};

/// The prediction for one satellite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Predicted {
    /// The satellite as it was at transmission, ECEF of reception.
    pub satellite: Satellite,
    /// Unit vector from receiver to satellite, ECEF of reception.
    pub direction: Vector3<f64>,
    pub azimuth: f64,
    pub elevation: f64,
    /// Pseudorange but for the receiver's clock, m.
    pub range_m: f64,
    /// Standard deviation of that prediction, m.
    pub range_sigma_m: f64,
    /// The part of it by the ionosphere, m, whose errors neighbouring satellites share.
    pub ionosphere_sigma_m: f64,
    /// Rate of the geometric range for a receiver at rest, m/s (see [`Predicted::range_rate`]).
    static_rate_mps: f64,
    /// Rate of what the atmosphere adds to the carrier's range, m/s.
    atmosphere_rate_mps: f64,
    /// Standard deviation of a predicted range rate, m/s.
    pub rate_sigma_mps: f64,
    /// 1 + u.v_s/c with the satellite's inertial velocity: reception dilates transmission.
    dilation: f64,
    /// Satellite clock rate, s/s.
    clock_drift_sps: f64,
    /// Gradient of the range rate by the receiver's position, 1/s.
    pub rate_gradient: Vector3<f64>,
    /// Rate of the range rate for a receiver at rest, m/s^2 (good to 0.1 %: for linearisation only).
    pub acceleration_mps2: f64,
}

/// How well a range rate can be predicted at the zenith, m/s: satellite velocity, what the ionosphere does.
/// Below, the atmosphere's rate may be off by all of itself: at 5 degrees that is as much again, and the
/// signals of most simulators know no troposphere.
const RATE_SIGMA_MPS: f64 = 0.02;

impl Predicted {
    /// Prediction at `receiver_m` (ECEF, on the Earth) at GPS time `t` on a carrier, Hz.
    pub fn new<'a>(
        orbit: impl Into<Orbit<'a>>,
        carrier_hz: f64,
        receiver_m: &Vector3<f64>,
        t: GpsTime,
        nav: &NavigationData,
        options: &PositioningOptions,
    ) -> Self {
        let orbit = orbit.into();
        let path = Propagation::solve(orbit, receiver_m, t);
        let satellite = &path.satellite;
        let direction = (satellite.position_m - receiver_m) / path.range_m;
        let (azimuth, elevation) = azimuth_elevation(receiver_m, &satellite.position_m);
        let place = Geodetic::from_ecef(receiver_m);
        // The model is that of L1.
        let dispersion = (L1_CENTRE_HZ / carrier_hz).powi(2);
        let ionosphere = |azimuth, elevation, t| {
            nav.ionosphere.map(|model| dispersion * model.delay_m(place, azimuth, elevation, t))
        };
        let ionosphere_m = ionosphere(azimuth, elevation, t);
        let troposphere_m = options.troposphere.delay_m(place, elevation);

        // What is left of the ionosphere after the Klobuchar model, and without it, by the model's own slant factor;
        // of the troposphere after the standard atmosphere; reflections at the antenna: all as measured against known
        // positions (docs/positioning.md, "Standard deviations").
        let slant = 1.0 + 16.0 * (0.53 - elevation.max(0.0) / std::f64::consts::PI).powi(3);
        let ionosphere_sigma = ionosphere_m.map_or(2.5 * dispersion * slant, |delay| 0.15 * delay);
        let troposphere_sigma = 0.03 * troposphere_m;
        let multipath_sigma = 0.15 / elevation.max(0.05).sin();
        let range_sigma_m =
            [ionosphere_sigma, troposphere_sigma, orbit.range_sigma_m(), multipath_sigma]
                .iter()
                .map(|s| s * s)
                .sum::<f64>()
                .sqrt();

        let omega = Vector3::new(0.0, 0.0, OMEGA_EARTH);
        let velocity = satellite.velocity_mps;
        let inertial_mps = velocity + omega.cross(&satellite.position_m);
        // Two-body gravity with the Coriolis and centrifugal terms of the rotating frame.
        let gravity = -MU_EARTH / satellite.position_m.norm().powi(3) * satellite.position_m;
        let acceleration = gravity - omega.cross(&(velocity + inertial_mps));
        let static_rate_mps = direction.dot(&velocity);
        // The troposphere delays the carrier as it does the code, the ionosphere advances it.
        let carrier_delay = |dt: f64| {
            let later = satellite.position_m + dt * velocity;
            let (azimuth, elevation) = azimuth_elevation(receiver_m, &later);
            let ionosphere_m = ionosphere(azimuth, elevation, t + dt).unwrap_or(0.0);
            options.troposphere.delay_m(place, elevation) - ionosphere_m
        };
        let atmosphere_rate_mps = carrier_delay(0.5) - carrier_delay(-0.5);
        Self {
            satellite: Satellite { position_m: satellite.position_m, velocity_mps: velocity },
            direction,
            azimuth,
            elevation,
            range_m: path.range_m - SPEED_OF_LIGHT * satellite.clock_bias_s
                + ionosphere_m.unwrap_or(0.0)
                + troposphere_m,
            range_sigma_m,
            ionosphere_sigma_m: ionosphere_sigma,
            static_rate_mps,
            atmosphere_rate_mps,
            rate_sigma_mps: RATE_SIGMA_MPS.hypot(atmosphere_rate_mps),
            dilation: 1.0 + direction.dot(&inertial_mps) / SPEED_OF_LIGHT,
            clock_drift_sps: satellite.clock_drift_sps,
            rate_gradient: (direction * static_rate_mps - velocity) / path.range_m,
            acceleration_mps2: direction.dot(&acceleration)
                + (velocity.norm_squared() - static_rate_mps.powi(2)) / path.range_m,
        }
    }

    /// Rate of the pseudorange, m/s per second of the receiver's clock, which is `-lambda D`.
    ///
    /// With `P = c (t_r - t_s)` on the clocks of receiver and satellite and `rho` the light path,
    /// `d rho/dt = u.(v_s - v_r) / (1 + u.v_s/c)`: the velocities are Earth-fixed in the numerator,
    /// as the Earth's rotation is perpendicular to the line of predicted between two points that turn
    /// with it, and inertial in the denominator. `drift_mps` is c times the rate of the receiver's
    /// clock; satellite clock rate and both clocks' own scales count for some mm/s each, and so does the
    /// atmosphere at the horizon (for low orbits a metre per second).
    pub fn range_rate(&self, velocity_mps: &Vector3<f64>, drift_mps: f64) -> f64 {
        let rate = (self.static_rate_mps - self.direction.dot(velocity_mps)) / self.dilation
            + self.atmosphere_rate_mps;
        let satellite_clock = self.clock_drift_sps * (SPEED_OF_LIGHT - rate);
        (rate + drift_mps - satellite_clock) / (1.0 + drift_mps / SPEED_OF_LIGHT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::{Truth, navigation_data};
    use sdr_rx_gnss::Ephemeris;
    use sdr_rx_gnss::atmosphere::Troposphere;

    #[test]
    fn derivatives_of_the_rate_agree_with_differences() {
        // Without an atmosphere, whose rate changes by a hundredth where the height changes by 800 m.
        let mut nav = navigation_data();
        nav.ionosphere = None;
        let options =
            PositioningOptions { troposphere: Troposphere::None, ..PositioningOptions::default() };
        let truth = Truth::at_rest();
        let rate = |ephemeris: &Ephemeris, receiver: &Vector3<f64>, t: GpsTime| {
            Predicted::new(ephemeris, L1_CENTRE_HZ, receiver, t, &nav, &options)
                .range_rate(&Vector3::zeros(), 0.0)
        };
        for ephemeris in nav.iter() {
            let (r, t) = (truth.position_m, truth.time);
            let predicted = Predicted::new(ephemeris, L1_CENTRE_HZ, &r, t, &nav, &options);
            let slope = (rate(ephemeris, &r, t + 1.0) - rate(ephemeris, &r, t - 1.0)) / 2.0;
            // The perturbations left out are 1e-3 of gravity; slopes are about 0.1 m/s^2.
            assert!((slope - predicted.acceleration_mps2).abs() < 1e-3, "{slope}");
            let step = Vector3::new(300.0, -500.0, 800.0);
            let change = (rate(ephemeris, &(r + step), t) - rate(ephemeris, &(r - step), t)) / 2.0;
            // 1e-5 by the dilation, step/range = 5e-5 squared by curvature.
            let predicted = predicted.rate_gradient.dot(&step);
            assert!((change - predicted).abs() < 1e-4 * step.norm() * 2e-4, "{change} {predicted}");
        }
    }
}
