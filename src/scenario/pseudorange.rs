//! The true pseudorange of each satellite, exact at any instant and interpolated between knots.

use super::receiver::Trajectory;
use crate::gnss::atmosphere::{Klobuchar, Troposphere};
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::coordinates::{Geodetic, azimuth_elevation};
use crate::gnss::orbit::Propagation;
use crate::gnss::{Ephemeris, GpsTime};

/// Code and carrier pseudorange by the receiver's clock, m: c times (clock reading of reception minus
/// satellite time of transmission).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pseudoranges {
    /// Of the code: delayed by the ionosphere.
    pub code_m: f64,
    /// Of the carrier: advanced by as much.
    pub carrier_m: f64,
}

/// How one satellite's signal reaches the receiver.
#[derive(Clone, Debug)]
pub struct SignalPath {
    /// The satellite.
    pub ephemeris: Ephemeris,
    /// Ionosphere, if any.
    pub ionosphere: Option<Klobuchar>,
    /// Troposphere.
    pub troposphere: Troposphere,
    /// The receiver.
    pub trajectory: Trajectory,
}

/// Propagation from one satellite to the receiver.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Light-time solution.
    pub propagation: Propagation,
    /// Azimuth, rad.
    pub azimuth: f64,
    /// Elevation, rad.
    pub elevation: f64,
    /// Pseudoranges.
    pub pseudorange: Pseudoranges,
}

impl SignalPath {
    /// The view at `elapsed` seconds of the receiver's clock after the first sample:
    /// P = r + c (b - dt) + T +- I (code +, carrier -), with r the range after light time and Earth
    /// rotation, b the receiver clock, dt the satellite clock of an L1 C/A user (polynomial,
    /// relativity, -T_GD), T and I the delays of troposphere and ionosphere. The satellite's motion
    /// during those delays (below 0.1 mm) is neglected, as in receivers' models.
    pub fn view(&self, elapsed: f64) -> View {
        let receiver = self.trajectory.state(elapsed);
        let propagation = Propagation::solve(&self.ephemeris, &receiver.position_m, receiver.time);
        let satellite = &propagation.satellite;
        let (azimuth, elevation) = azimuth_elevation(&receiver.position_m, &satellite.position_m);
        let position = Geodetic::from_ecef(&receiver.position_m);
        let delay = |model: &Klobuchar| model.delay_m(position, azimuth, elevation, receiver.time);
        let ionosphere = self.ionosphere.as_ref().map_or(0.0, delay);
        let clocks = SPEED_OF_LIGHT * (receiver.clock_bias_s - satellite.clock_bias_s);
        let common = propagation.range_m + clocks + self.troposphere.delay_m(position, elevation);
        let pseudorange =
            Pseudoranges { code_m: common + ionosphere, carrier_m: common - ionosphere };
        View { propagation, azimuth, elevation, pseudorange }
    }

    /// Rate of the carrier pseudorange per second of the receiver's clock, m/s, by a central
    /// difference over 20 ms: rounding gives 1e-5 m/s, truncation h^2/6 of the jerk as much.
    pub fn carrier_rate(&self, elapsed: f64) -> f64 {
        const H: f64 = 0.01;
        let carrier = |t: f64| self.view(t).pseudorange.carrier_m;
        (carrier(elapsed + H) - carrier(elapsed - H)) / (2.0 * H)
    }

    /// Satellite time of transmission of the code received when `elapsed` has passed.
    pub fn transmit_time(&self, elapsed: f64, pseudorange: &Pseudoranges) -> GpsTime {
        self.trajectory.state(elapsed).clock_reading - pseudorange.code_m / SPEED_OF_LIGHT
    }
}

/// A sliding window of exact pseudoranges at equidistant knots, with a cubic through four of them.
///
/// Between the middle knots the error is at most 9/16 h^4 / 24 max|P''''|: for a receiver that
/// circles with acceleration a and rate w it is 0.0234 a w^2 h^4, below 5e-6 m for 800 m/s^2, 8 rad/s
/// and h = 8 ms; for orbits it is below 1e-15 m. Rounding of the knots adds 1e-7 m.
#[derive(Clone, Debug)]
pub struct PseudorangeTable {
    path: SignalPath,
    spacing_s: f64,
    first: i64,
    knots: [View; 4],
}

impl PseudorangeTable {
    /// A table with knots every `spacing_s` seconds of the receiver's clock.
    pub fn new(path: SignalPath, spacing_s: f64) -> Self {
        let knots = std::array::from_fn(|i| path.view((i as f64 - 1.0) * spacing_s));
        Self { path, spacing_s, first: -1, knots }
    }

    /// The signal path behind the table.
    pub fn path(&self) -> &SignalPath {
        &self.path
    }

    /// Makes the interval from knot `knot` to `knot` + 1 the current one.
    pub fn move_to(&mut self, knot: i64) {
        let exact = |k: i64| self.path.view(k as f64 * self.spacing_s);
        if self.first == knot - 2 {
            self.knots.rotate_left(1);
            self.knots[3] = exact(knot + 2);
        } else if self.first != knot - 1 {
            self.knots = std::array::from_fn(|i| exact(knot - 1 + i as i64));
        }
        self.first = knot - 1;
    }

    /// The exact view at the start of the current interval.
    pub fn view(&self) -> &View {
        &self.knots[1]
    }

    /// The exact view at the end of the current interval.
    pub fn next_view(&self) -> &View {
        &self.knots[2]
    }

    /// Pseudoranges at the fraction `x` (0 to 1) of the current interval (Lagrange's cubic, in the form of
    /// Neville's divided differences around the first middle knot, which loses no digits).
    pub fn at(&self, x: f64) -> Pseudoranges {
        let cubic = |get: fn(&Pseudoranges) -> f64| {
            let [a, b, c, d] = self.knots.each_ref().map(|k| get(&k.pseudorange));
            let (before, here, after) = (b - a, c - b, d - c);
            let (second, third) = (here - before, (after - here) - (here - before));
            b + x * (here + (x - 1.0) / 2.0 * (second + (x + 1.0) / 3.0 * third))
        };
        Pseudoranges { code_m: cubic(|p| p.code_m), carrier_m: cubic(|p| p.carrier_m) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::receiver::{AntennaPosition, Motion, SimulatedReceiver};
    use super::*;
    use crate::gnss::orbit::broadcast::sample_ephemeris;

    #[test]
    fn interpolated_pseudoranges_are_exact_to_a_tenth_of_a_millimetre_on_a_violent_circle() {
        let ephemeris = sample_ephemeris();
        let receiver = SimulatedReceiver {
            position: AntennaPosition::EcefM([3_959_617.5, -3_350_136.6, -3_699_531.5]),
            // 100 m/s at 12.5 m: 800 m/s^2 and 8 rad/s.
            motion: Motion::Circle { radius_m: 12.5, speed_mps: 100.0 },
            clock_offset_s: 1e-3,
            clock_drift_ppm: 3.0,
        };
        let path = SignalPath {
            trajectory: Trajectory::new(&receiver, ephemeris.toe),
            ephemeris,
            ionosphere: Some(Klobuchar { alpha: [1e-8; 4], beta: [9e4; 4] }),
            troposphere: Troposphere::Saastamoinen,
        };
        let spacing = 8e-3;
        let mut table = PseudorangeTable::new(path.clone(), spacing);
        for knot in [-3, -2, -1, 0, 1, 2, 50, 51, 5000, 3] {
            table.move_to(knot);
            for segment in 0..8 {
                // What the kernel does: linear from segment to segment of 1 ms, anchored at the cubic.
                let at = |k: i32| table.at(f64::from(k) / 8.0);
                let exact = path.view((knot as f64 + f64::from(segment) / 8.0) * spacing);
                assert!((at(segment).code_m - exact.pseudorange.code_m).abs() < 5e-6);
                assert!((at(segment).carrier_m - exact.pseudorange.carrier_m).abs() < 5e-6);
                let middle = path.view((knot as f64 + (f64::from(segment) + 0.5) / 8.0) * spacing);
                let linear = 0.5 * (at(segment).code_m + at(segment + 1).code_m);
                // a T^2 / 8 at 800 m/s^2 and 1 ms, and the cubic's 5e-6.
                assert!((linear - middle.pseudorange.code_m).abs() < 1.05e-4);
            }
        }
    }

    #[test]
    fn code_and_carrier_diverge_by_twice_the_ionosphere_and_the_rate_is_the_range_rate() {
        let ephemeris = sample_ephemeris();
        let antenna = AntennaPosition::EcefM([3_959_617.5, -3_350_136.6, -3_699_531.5]);
        let receiver = SimulatedReceiver {
            position: antenna,
            motion: Motion::Static,
            clock_offset_s: 0.0,
            clock_drift_ppm: 1.0,
        };
        let model = Klobuchar { alpha: [1e-8, 0.0, 0.0, 0.0], beta: [9e4, 0.0, 0.0, 0.0] };
        let path = SignalPath {
            trajectory: Trajectory::new(&receiver, ephemeris.toe),
            ephemeris,
            ionosphere: Some(model),
            troposphere: Troposphere::None,
        };
        let view = path.view(10.0);
        let ground = Geodetic::from_ecef(&antenna.ecef());
        let time = path.trajectory.state(10.0).time;
        let delay = model.delay_m(ground, view.azimuth, view.elevation, time);
        let divergence = view.pseudorange.code_m - view.pseudorange.carrier_m;
        // Rounding of 2e7 m in double precision.
        assert!((divergence - 2.0 * delay).abs() < 1e-8);

        // d P / ds = (v_s . u (1 - v_s . u / c) + c (d_r - d_s)) / (1 + d), Sagnac included in the frame.
        let still = SignalPath { ionosphere: None, ..path };
        let satellite = view.propagation.satellite;
        let toward = (satellite.position_m - antenna.ecef()).normalize();
        let rotation = nalgebra::Vector3::new(0.0, 0.0, crate::gnss::constants::OMEGA_EARTH);
        let frame = rotation.cross(&satellite.position_m).dot(&toward);
        let radial = satellite.velocity_mps.dot(&toward);
        let rate = (radial + frame) / (1.0 + (radial + frame) / SPEED_OF_LIGHT) - frame;
        let clocks = SPEED_OF_LIGHT * (1e-6 - satellite.clock_drift_sps);
        // Left out: the Earth turns the receiver as well, v_r . u of second order: 0.5 mm/s.
        assert!((still.carrier_rate(10.0) - rate - clocks).abs() < 2e-3);
    }
}
