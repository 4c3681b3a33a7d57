//! A constellation and observations of known truth, for the tests of this floor.

use crate::PositioningOptions;
use nalgebra::Vector3;
use sdr_rx_gnss::atmosphere::Klobuchar;
use sdr_rx_gnss::constants::{MU_EARTH, SPEED_OF_LIGHT};
use sdr_rx_gnss::coordinates::{Geodetic, azimuth_elevation};
use sdr_rx_gnss::observation::{CodeRange, Observation, ObservationEpoch};
use sdr_rx_gnss::orbit::Propagation;
use sdr_rx_gnss::orbit::broadcast::sample_ephemeris;
use sdr_rx_gnss::signal::{self, L1_CENTRE_HZ};
use sdr_rx_gnss::{Ephemeris, GpsTime, NavigationData, Sv};

/// GPS-like Walker 30/6/1 with the orbit shape and corrections of a real ephemeris.
pub fn navigation_data() -> NavigationData {
    let mut nav = NavigationData::default();
    for index in 0..30u8 {
        let (plane, slot) = (f64::from(index / 5), f64::from(index % 5));
        let base = sample_ephemeris();
        nav.insert(Ephemeris {
            sv: Sv::from_prn(index + 1).unwrap(),
            omega0: base.omega0 + (60.0 * plane).to_radians(),
            m0: base.m0 + (72.0 * slot + 12.0 * plane).to_radians(),
            af0: base.af0 * (1.0 - 0.1 * f64::from(index)),
            ..base
        });
    }
    nav.ionosphere = Some(Klobuchar {
        alpha: [1.118e-8, 7.451e-9, -5.961e-8, -5.961e-8],
        beta: [9.011e4, 1.638e4, -1.966e5, -6.554e4],
    });
    nav
}

/// A receiver whose state is known.
#[derive(Clone, Copy)]
pub struct Truth {
    pub time: GpsTime,
    pub position_m: Vector3<f64>,
    pub velocity_mps: Vector3<f64>,
    pub bias_s: f64,
    pub drift_sps: f64,
}

impl Truth {
    /// At rest in Tokyo with a perfect clock, ten minutes after the ephemerides' reference.
    pub fn at_rest() -> Self {
        Self {
            time: sample_ephemeris().toe + 600.0,
            position_m: Geodetic::from_degrees(35.681298, 139.766247, 10.0).to_ecef(),
            velocity_mps: Vector3::zeros(),
            bias_s: 0.0,
            drift_sps: 0.0,
        }
    }

    /// Pseudorange without atmosphere, `dt` seconds later.
    fn pseudorange(&self, ephemeris: &Ephemeris, dt: f64) -> f64 {
        let position = self.position_m + dt * self.velocity_mps;
        let path = Propagation::solve(ephemeris, &position, self.time + dt);
        let clocks = self.bias_s + self.drift_sps * dt - path.satellite.clock_bias_s;
        path.range_m + SPEED_OF_LIGHT * clocks
    }

    /// Exact observations of all satellites above `mask` (rad): pseudoranges with the atmosphere of
    /// the models, Dopplers as numeric derivatives of the pseudoranges on the receiver's clock.
    pub fn observe(
        &self,
        nav: &NavigationData,
        options: &PositioningOptions,
        mask: f64,
    ) -> ObservationEpoch {
        let place = Geodetic::from_ecef(&self.position_m);
        let in_force = |sv: Sv| nav.nearest(sv, self.time);
        let observations = nav.satellites().filter_map(in_force).filter_map(|ephemeris| {
            let satellite = Propagation::solve(ephemeris, &self.position_m, self.time).satellite;
            let (azimuth, elevation) = azimuth_elevation(&self.position_m, &satellite.position_m);
            let transmission = signal::of(ephemeris.sv);
            let dispersion = (L1_CENTRE_HZ / transmission.carrier_hz()).powi(2);
            let ionosphere = |azimuth, elevation, t| {
                let delay_m = |k: Klobuchar| k.delay_m(place, azimuth, elevation, t);
                nav.ionosphere.map_or(0.0, |k| dispersion * delay_m(k))
            };
            let troposphere = |elevation| options.troposphere.delay_m(place, elevation);
            let delay_m = ionosphere(azimuth, elevation, self.time) + troposphere(elevation);
            // The ionosphere advances the carrier.
            let carrier = |dt: f64| {
                let t = self.time + dt;
                let satellite = Propagation::solve(ephemeris, &self.position_m, t).satellite;
                let (azimuth, elevation) =
                    azimuth_elevation(&self.position_m, &satellite.position_m);
                self.pseudorange(ephemeris, dt) + troposphere(elevation)
                    - ionosphere(azimuth, elevation, t)
            };
            let change = carrier(0.5) - carrier(-0.5);
            let observation = Observation {
                transmission,
                range: Some(CodeRange::Pseudorange(self.pseudorange(ephemeris, 0.0) + delay_m)),
                range_sigma_m: 1.0,
                doppler_hz: Some(-change / (1.0 + self.drift_sps) / transmission.wavelength_m()),
                doppler_sigma_hz: 0.5,
                carrier_phase_cycles: None,
                lost_lock: false,
                cn0_dbhz: Some(45.0),
            };
            (elevation >= mask).then_some(observation)
        });
        ObservationEpoch {
            receive_time: self.time + self.bias_s,
            sample: 0.0,
            observations: observations.collect(),
        }
    }
}

/// The same orbit and clock with its reference times `dt` s later, in the same week.
pub fn moved(ephemeris: &Ephemeris, dt: f64) -> Ephemeris {
    let a = ephemeris.sqrt_a * ephemeris.sqrt_a;
    let motion = (MU_EARTH / (a * a * a)).sqrt() + ephemeris.delta_n;
    Ephemeris {
        toe: ephemeris.toe + dt,
        toc: ephemeris.toc + dt,
        m0: ephemeris.m0 + motion * dt,
        omega0: ephemeris.omega0 + ephemeris.omega_dot * dt,
        i0: ephemeris.i0 + ephemeris.idot * dt,
        af0: ephemeris.af0 + ephemeris.af1 * dt,
        ..ephemeris.clone()
    }
}

/// Navigation data of many hours from the start of the week on, every two hours a new issue; semi-major
/// axes differ by some km and clock rates by some 1e-12, as those of the real satellites do.
pub fn navigation_data_of_hours(hours: u32) -> NavigationData {
    let base = navigation_data();
    let mut nav = NavigationData::default();
    nav.ionosphere = base.ionosphere;
    for (k, ephemeris) in base.iter().enumerate() {
        // Irrational steps spread both evenly over -1..1.
        let spread = |step: f64| 2.0 * (step * k as f64).fract() - 1.0;
        let a = ephemeris.sqrt_a.powi(2) + 1.7e3 * spread(0.618_034);
        let own =
            Ephemeris { sqrt_a: a.sqrt(), af1: 3e-12 * spread(0.414_214), ..ephemeris.clone() };
        for issue in 0..=hours / 2 {
            nav.insert(moved(&own, f64::from(issue) * 7200.0 - ephemeris.toe.tow()));
        }
    }
    nav
}
