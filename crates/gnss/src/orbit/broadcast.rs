//! Broadcast ephemeris, and satellite position, velocity and clock by it.

use crate::orbit::system::SystemModel;
use crate::{Constellation, GpsTime, Sv};
use nalgebra::{Rotation3, Vector3};

/// A GPS or QZSS LNAV broadcast ephemeris: subframes 1 to 3, in SI units and rad
/// (IS-GPS-200N 20.3.3.3 and 20.3.3.4; names of tables 20-I and 20-III); or one of Galileo I/NAV: words 1 to 5 (Galileo
/// OS SIS ICD 2.1, 5.1), its times in Galileo System Time counted by GPS weeks, which differs from GPS time by
/// nanoseconds; or one of BeiDou D1 or D2 (BDS-SIS-ICD-B1I-3.0, 5.2.4), its times brought from BeiDou to GPS time. What else Galileo sends of a satellite is in [`GalileoStatus`](crate::galileo_data::GalileoStatus).
#[derive(Clone, Debug, PartialEq)]
pub struct Ephemeris {
    /// The satellite.
    pub sv: Sv,
    /// Issue of data, clock (10 bits); IODnav of Galileo, AODC of BeiDou.
    pub iodc: u16,
    /// Issue of data, ephemeris (8 bits); the low bits of IODnav of Galileo, AODE of BeiDou.
    pub iode: u8,
    /// URA index, 0 to 15; of Galileo that whose bound is next to SISA.
    pub ura_index: u8,
    /// Six-bit health word, three bits of E1-B of Galileo, SatH1 of BeiDou; 0 is healthy.
    pub health: u8,
    /// Codes on the L2 channel.
    pub l2_codes: u8,
    /// Whether the L2 P-code carries no navigation data.
    pub l2_p_data: bool,
    /// Whether the curve-fit interval is longer than 4 hours.
    pub fit_interval_flag: bool,
    /// Clock reference time `t_oc`.
    pub toc: GpsTime,
    /// Ephemeris reference time `t_oe`.
    pub toe: GpsTime,
    /// When the message was sent (start of the frame), if known.
    pub transmission_time: Option<GpsTime>,
    /// Clock bias `a_f0`, s.
    pub af0: f64,
    /// Clock drift `a_f1`, s/s.
    pub af1: f64,
    /// Clock drift rate `a_f2`, s/s^2.
    pub af2: f64,
    /// Group delay of the signal on L1 against the clock's reference, s: T_GD, BGD(E1, E5b) of Galileo, or T_GD1
    /// of B1I of BeiDou, which stands for B1C as well: that differs by some nanoseconds.
    pub tgd: f64,
    /// Square root of the semi-major axis, sqrt(m).
    pub sqrt_a: f64,
    /// Eccentricity.
    pub e: f64,
    /// Mean anomaly at `t_oe`, rad.
    pub m0: f64,
    /// Mean motion difference, rad/s.
    pub delta_n: f64,
    /// Longitude of the ascending node at the start of the week, rad.
    pub omega0: f64,
    /// Rate of right ascension, rad/s.
    pub omega_dot: f64,
    /// Inclination at `t_oe`, rad.
    pub i0: f64,
    /// Rate of inclination, rad/s.
    pub idot: f64,
    /// Argument of perigee, rad.
    pub omega: f64,
    /// Cosine correction to the argument of latitude, rad.
    pub cuc: f64,
    /// Sine correction to the argument of latitude, rad.
    pub cus: f64,
    /// Cosine correction to the orbit radius, m.
    pub crc: f64,
    /// Sine correction to the orbit radius, m.
    pub crs: f64,
    /// Cosine correction to the inclination, rad.
    pub cic: f64,
    /// Sine correction to the inclination, rad.
    pub cis: f64,
}

/// Position, velocity and clock of a satellite at one instant of GPS time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SatelliteState {
    /// Antenna position, m, ECEF of the instant itself (for the signal's flight see
    /// [`Propagation`](super::Propagation)).
    pub position_m: Vector3<f64>,
    /// Velocity, m/s, in the rotating ECEF frame.
    pub velocity_mps: Vector3<f64>,
    /// Satellite clock minus the time of its system for a user of its signal on L1, s: polynomial, relativity and -T_GD.
    pub clock_bias_s: f64,
    /// Rate of the satellite clock, s/s.
    pub clock_drift_sps: f64,
}

impl Ephemeris {
    /// Satellite state at GPS time `t` (IS-GPS-200N tables 20-IV and 20-V, equations of 20.3.3.3.3.1).
    /// The velocity is the analytic derivative of the same formulas.
    pub fn state(&self, t: GpsTime) -> SatelliteState {
        let tk = t - self.toe;
        let a = self.sqrt_a * self.sqrt_a;
        let &SystemModel { mu, relativistic_f, omega_earth, behind_gps_s, .. } =
            self.sv.constellation().model();
        let n = (mu / (a * a * a)).sqrt() + self.delta_n;
        let ek = eccentric_anomaly(self.m0 + n * tk, self.e);
        let (sin_e, cos_e) = ek.sin_cos();
        let ek_dot = n / (1.0 - self.e * cos_e);
        let root = (1.0 - self.e * self.e).sqrt();
        let phi = (root * sin_e).atan2(cos_e - self.e) + self.omega;
        let phi_dot = root * ek_dot / (1.0 - self.e * cos_e);

        let (s2, c2) = (2.0 * phi).sin_cos();
        let u = phi + self.cus * s2 + self.cuc * c2;
        let r = a * (1.0 - self.e * cos_e) + self.crs * s2 + self.crc * c2;
        let i = self.i0 + self.idot * tk + self.cis * s2 + self.cic * c2;
        let u_dot = phi_dot * (1.0 + 2.0 * (self.cus * c2 - self.cuc * s2));
        let r_dot = a * self.e * sin_e * ek_dot + 2.0 * phi_dot * (self.crs * c2 - self.crc * s2);
        let i_dot = self.idot + 2.0 * phi_dot * (self.cis * c2 - self.cic * s2);

        let (sin_u, cos_u) = u.sin_cos();
        let (x, y) = (r * cos_u, r * sin_u);
        let (x_dot, y_dot) = (r_dot * cos_u - y * u_dot, r_dot * sin_u + x * u_dot);
        // Of geostationary satellites of BeiDou the elements hold in a frame that stands still from t_oe on.
        let is_geo = self.sv.is_beidou_geo();
        let node_rate = if is_geo { self.omega_dot } else { self.omega_dot - omega_earth };
        let toe_tow = (self.toe - behind_gps_s).tow();
        let node = self.omega0 + node_rate * tk - omega_earth * toe_tow;
        let (sin_o, cos_o) = node.sin_cos();
        let (sin_i, cos_i) = i.sin_cos();
        let position_m =
            Vector3::new(x * cos_o - y * cos_i * sin_o, x * sin_o + y * cos_i * cos_o, y * sin_i);
        let z_dot = y_dot * cos_i - y * sin_i * i_dot;
        let velocity_mps = Vector3::new(
            x_dot * cos_o - z_dot * sin_o - node_rate * position_m.y,
            x_dot * sin_o + z_dot * cos_o + node_rate * position_m.x,
            y_dot * sin_i + y * cos_i * i_dot,
        );

        let (position_m, velocity_mps) = match is_geo {
            true => from_geo_frame(&position_m, &velocity_mps, omega_earth, tk),
            false => (position_m, velocity_mps),
        };

        let tc = t - self.toc;
        let relativity = relativistic_f * self.e * self.sqrt_a;
        SatelliteState {
            position_m,
            velocity_mps,
            clock_bias_s: self.af0 + tc * (self.af1 + tc * self.af2) + relativity * sin_e
                - self.tgd,
            clock_drift_sps: self.af1 + 2.0 * tc * self.af2 + relativity * cos_e * ek_dot,
        }
    }

    /// Whether the signal is good for use by the health word. Of QZSS the lowest bit belongs to L1C/B, which most
    /// of its satellites do not send, and counts for nothing (IS-QZSS-PNT-005 table 4.1.2-5).
    pub fn is_healthy(&self) -> bool {
        match self.sv.constellation() {
            Constellation::Qzss => self.health & !1 == 0,
            _ => self.health == 0,
        }
    }

    /// Half the curve-fit interval, s: how far from `t_oe` the ephemeris may be used. Galileo states none: a healthy
    /// satellite sends one issue for at most 4 hours (OS SIS ICD 2.1, 5.1.9.2); BeiDou changes it every hour.
    pub fn half_fit_interval(&self) -> f64 {
        match self.fit_interval_flag {
            true => 3.0 * 3600.0,
            false => self.sv.constellation().model().half_fit_interval_s,
        }
    }
}

/// Position and velocity of a geostationary satellite of BeiDou, `tk` after its reference time, from the frame of its
/// elements, whose equator is turned by 5 degrees about the x axis: R_Z(omega tk) R_X(-5 deg) (BDS-SIS-ICD-B1I-3.0 table
/// 5-11).
fn from_geo_frame(
    position_m: &Vector3<f64>,
    velocity_mps: &Vector3<f64>,
    omega_earth: f64,
    tk: f64,
) -> (Vector3<f64>, Vector3<f64>) {
    // Rotations of axes are those of vectors by the opposite angle.
    let tilt = Rotation3::from_axis_angle(&Vector3::x_axis(), 5f64.to_radians());
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -omega_earth * tk) * tilt;
    let position_m = turn * position_m;
    let rotation = Vector3::z() * omega_earth;
    (position_m, turn * velocity_mps - rotation.cross(&position_m))
}

/// Solves Kepler's equation M = E - e sin E by Newton's method, to the last bit in at most 10 steps
/// for e < 0.5.
fn eccentric_anomaly(mean_anomaly: f64, e: f64) -> f64 {
    let mut ek = mean_anomaly;
    for _ in 0..10 {
        let step = (mean_anomaly - ek + e * ek.sin()) / (1.0 - e * ek.cos());
        ek += step;
        if step.abs() < 1e-15 {
            break;
        }
    }
    ek
}

/// Upper bounds of user range accuracy of index 0 to 14, m (IS-GPS-200N 20.3.3.3.1.3).
const URA_BOUNDS: [f64; 15] = [
    2.4, 3.4, 4.85, 6.85, 9.65, 13.65, 24.0, 48.0, 96.0, 192.0, 384.0, 768.0, 1536.0, 3072.0,
    6144.0,
];

/// Index of an accuracy that is not stated.
pub(crate) const NO_ACCURACY: u8 = 15;

/// User range accuracy of an index, m: the upper bound of IS-GPS-200N 20.3.3.3.1.3 (6144 beyond 14).
pub fn ura_metres(index: u8) -> f64 {
    URA_BOUNDS.get(usize::from(index)).copied().unwrap_or(6144.0)
}

/// Index of a user range accuracy in m: the smallest whose bound is not below it, so that files which print
/// bounds (2.4, 3.4, ...) and those which print nominal values (2.0, 2.8, ...) give the same; 15 beyond.
pub fn ura_index(metres: f64) -> u8 {
    URA_BOUNDS.iter().position(|&bound| metres <= bound).map_or(NO_ACCURACY, |k| k as u8)
}

/// An ephemeris for examples and tests: G01 of 2022-01-01T00:00 GPST from a public IGS broadcast file.
pub fn sample_ephemeris() -> Ephemeris {
    let toe = GpsTime::from_week_tow(2190, 518_400.0);
    Ephemeris {
        sv: Sv::all_gps().next().expect("PRN 1"),
        iodc: 39,
        iode: 39,
        ura_index: 0,
        health: 0,
        l2_codes: 1,
        l2_p_data: false,
        fit_interval_flag: false,
        toc: toe,
        toe,
        transmission_time: None,
        af0: 0.469126738608e-03,
        af1: -0.100044417195e-10,
        af2: 0.0,
        tgd: 0.512227416039e-08,
        sqrt_a: 0.515367499542e+04,
        e: 0.112181392033e-01,
        m0: -0.624294238235,
        delta_n: 0.398838041777e-08,
        omega0: -0.103661124009e+01,
        omega_dot: -0.813355308085e-08,
        i0: 0.986418769490,
        idot: -0.377872882780e-09,
        omega: 0.884087601569,
        cuc: -0.736303627491e-05,
        cus: 0.469572842121e-05,
        crc: 0.299750000000e+03,
        crs: -0.141125000000e+03,
        cic: -0.316649675369e-07,
        cis: 0.195577740669e-06,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::{OMEGA_EARTH, SPEED_OF_LIGHT};

    #[test]
    fn velocity_and_clock_drift_are_the_derivatives_of_position_and_clock() {
        let eph = sample_ephemeris();
        for k in -4..=4 {
            let t = eph.toe + 1800.0 * f64::from(k);
            let (before, at, after) = (eph.state(t - 1.0), eph.state(t), eph.state(t + 1.0));
            let difference = (after.position_m - before.position_m) / 2.0;
            // Truncation of the central difference: h^2/6 times the third derivative, about 1e-5 m/s.
            assert!(
                (difference - at.velocity_mps).norm() < 1e-4,
                "{difference} {}",
                at.velocity_mps
            );
            let drift = (after.clock_bias_s - before.clock_bias_s) / 2.0;
            assert!((drift - at.clock_drift_sps).abs() < 1e-16);
            // GPS orbits: 26 560 km and about 3.9 km/s inertial.
            assert!((at.position_m.norm() / 26.56e6 - 1.0).abs() < 0.03);
        }
    }

    /// A geostationary satellite stays over its place: with the elements of C01 the velocity is that of the position, and
    /// both stay within its box of some tenths of a degree.
    #[test]
    fn a_geostationary_satellite_of_beidou_stands_still_and_its_velocity_is_the_derivative() {
        let toe = GpsTime::from_week_tow(2320, 115_200.0 + 14.0);
        let c01 = Ephemeris {
            sv: "C01".parse().unwrap(),
            toe,
            toc: toe,
            crs: 398.78125,
            delta_n: 1.168655822063e-8,
            m0: -0.7785119710056,
            cuc: 1.305714249611e-5,
            e: 2.352053998038e-4,
            cus: -1.721968874335e-5,
            sqrt_a: 6493.358730316,
            cic: 3.771856427193e-8,
            omega0: -1.376223151778,
            cis: -3.306195139885e-8,
            i0: 6.493194956776e-2,
            crc: 519.28125,
            omega: 0.5103894865136,
            omega_dot: -1.047865076358e-8,
            idot: 2.235807416067e-10,
            ..sample_ephemeris()
        };
        for k in -4..=4 {
            let t = toe + 1800.0 * f64::from(k);
            let (before, at, after) = (c01.state(t - 1.0), c01.state(t), c01.state(t + 1.0));
            let difference = (after.position_m - before.position_m) / 2.0;
            assert!((difference - at.velocity_mps).norm() < 1e-4);
            let longitude = |s: &SatelliteState| s.position_m.y.atan2(s.position_m.x).to_degrees();
            assert!((longitude(&at) - longitude(&c01.state(toe))).abs() < 0.5);
            // Inclined by up to 2 degrees it moves by up to 100 m/s.
            assert!(at.velocity_mps.norm() < 120.0 && at.position_m.z.abs() < 1.6e6);
        }
    }

    /// E14 and E18 are on orbits of e = 0.16. Without corrections the speed in inertial space obeys the vis-viva
    /// equation, and the relativistic correction is -2 r v / c^2, each with the constants of its system (GPS and
    /// Galileo differ by 1.5e-7).
    #[test]
    fn orbits_and_relativity_follow_the_constants_of_their_system() {
        let none = [0.0; 6];
        for (name, mu) in [("E14", 3.986_004_418e14), ("G14", 3.986_005e14)] {
            let [cuc, cus, crc, crs, cic, cis] = none;
            let [delta_n, omega_dot, idot, af0, af1, tgd] = none;
            let orbit = Ephemeris { cuc, cus, crc, crs, cic, cis, ..sample_ephemeris() };
            let orbit = Ephemeris { delta_n, omega_dot, idot, af0, af1, tgd, ..orbit };
            let sv = name.parse().unwrap();
            let eph = Ephemeris { sv, e: 0.16, sqrt_a: 5291.0, ..orbit };
            for k in 0..12 {
                let state = eph.state(eph.toe + 3600.0 * f64::from(k));
                let (r, rotation) = (state.position_m, Vector3::z() * OMEGA_EARTH);
                let v = state.velocity_mps + rotation.cross(&r);
                let speed_squared = mu * (2.0 / r.norm() - 1.0 / eph.sqrt_a.powi(2));
                assert!((v.norm_squared() / speed_squared - 1.0).abs() < 1e-11, "{name}");
                let relativity = -2.0 * r.dot(&v) / SPEED_OF_LIGHT.powi(2);
                assert!((state.clock_bias_s - relativity).abs() < 1e-16, "{name}");
            }
        }
    }
}
