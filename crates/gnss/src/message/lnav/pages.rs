//! Pages of subframes 4 and 5: almanac, ionosphere and UTC, health (IS-GPS-200N 20.3.3.5).

use super::fields::{Fields, Walk};
use super::resolve_week;
use crate::atmosphere::Klobuchar;
use crate::constants::{GPS_PI, MU_EARTH, OMEGA_EARTH};
use crate::navigation_data::UtcParameters;
use crate::{Ephemeris, GpsTime};

/// Almanac of one satellite (subframe 5 pages 1-24, subframe 4 pages 2-5 and 7-10; table 20-VI).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Almanac {
    /// Page identity, the PRN number 1 to 32; 0 is a dummy satellite.
    pub sv_id: u8,
    /// Eccentricity.
    pub e: f64,
    /// Almanac reference time of week, s.
    pub toa: f64,
    /// Inclination minus 0.3 semicircles, rad.
    pub delta_i: f64,
    /// Rate of right ascension, rad/s.
    pub omega_dot: f64,
    /// Eight-bit health word; 0 is healthy.
    pub health: u8,
    /// Square root of the semi-major axis, sqrt(m).
    pub sqrt_a: f64,
    /// Longitude of the ascending node at the start of the week, rad.
    pub omega0: f64,
    /// Argument of perigee, rad.
    pub omega: f64,
    /// Mean anomaly, rad.
    pub m0: f64,
    /// Clock bias, s.
    pub af0: f64,
    /// Clock drift, s/s.
    pub af1: f64,
}

impl Fields for Almanac {
    fn walk(&mut self, w: &mut Walk) {
        w.count("SV ID", &mut self.sv_id, &[(3, 3, 6)]);
        w.real("e", &mut self.e, &[(3, 9, 16)], -21, false);
        w.real("t_oa", &mut self.toa, &[(4, 1, 8)], 12, false);
        w.semicircles("delta i", &mut self.delta_i, &[(4, 9, 16)], -19);
        w.semicircles("Omega dot", &mut self.omega_dot, &[(5, 1, 16)], -38);
        w.count("SV health", &mut self.health, &[(5, 17, 8)]);
        w.real("sqrt A", &mut self.sqrt_a, &[(6, 1, 24)], -11, false);
        w.angle("Omega_0", &mut self.omega0, &[(7, 1, 24)], -23);
        w.angle("omega", &mut self.omega, &[(8, 1, 24)], -23);
        w.angle("M_0", &mut self.m0, &[(9, 1, 24)], -23);
        w.real("a_f0", &mut self.af0, &[(10, 1, 8), (10, 20, 3)], -20, true);
        w.real("a_f1", &mut self.af1, &[(10, 9, 11)], -38, true);
    }
}

impl Almanac {
    /// The almanac of an ephemeris for the reference time `toa` (a multiple of 4096 s of its week):
    /// the Keplerian orbit carried to `toa`, harmonic corrections left out.
    pub fn new(eph: &Ephemeris, toa: GpsTime) -> Self {
        let dt = toa - eph.toe;
        let mean_motion = (MU_EARTH / eph.sqrt_a.powi(6)).sqrt() + eph.delta_n;
        Self {
            sv_id: eph.sv.prn(),
            e: eph.e,
            toa: toa.tow(),
            delta_i: eph.i0 + eph.idot * dt - 0.3 * GPS_PI,
            omega_dot: eph.omega_dot,
            health: eph.health,
            sqrt_a: eph.sqrt_a,
            omega0: eph.omega0
                + eph.omega_dot * dt
                + OMEGA_EARTH * (toa.tow() - eph.toe.tow() - dt),
            omega: eph.omega,
            m0: eph.m0 + mean_motion * dt,
            af0: eph.af0 + eph.af1 * (toa - eph.toc),
            af1: eph.af1,
        }
    }
}

/// Ionosphere and UTC (subframe 4 page 18; tables 20-IX and 20-X). Week numbers are modulo 256.
#[derive(Clone, Debug, PartialEq)]
pub struct IonosphereUtc {
    /// Ionosphere.
    pub klobuchar: Klobuchar,
    /// Constant term of GPS minus UTC, s.
    pub a0: f64,
    /// First-order term, s/s.
    pub a1: f64,
    /// Reference time of week, s.
    pub tot: f64,
    /// Reference week, modulo 256.
    pub week_t: u8,
    /// Leap seconds now, s.
    pub delta_t_ls: f64,
    /// Week of the leap second change, modulo 256.
    pub week_lsf: u8,
    /// Day of that week, 1 (Sunday) to 7.
    pub day: u8,
    /// Leap seconds after the change, s.
    pub delta_t_lsf: f64,
}

impl Default for IonosphereUtc {
    fn default() -> Self {
        let klobuchar = Klobuchar { alpha: [0.0; 4], beta: [0.0; 4] };
        let (a0, a1, tot, delta_t_ls, delta_t_lsf) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let (week_t, week_lsf, day) = (0, 0, 0);
        Self { klobuchar, a0, a1, tot, week_t, delta_t_ls, week_lsf, day, delta_t_lsf }
    }
}

impl Fields for IonosphereUtc {
    fn walk(&mut self, w: &mut Walk) {
        let Klobuchar { alpha, beta } = &mut self.klobuchar;
        w.real("alpha_0", &mut alpha[0], &[(3, 9, 8)], -30, true);
        w.real("alpha_1", &mut alpha[1], &[(3, 17, 8)], -27, true);
        w.real("alpha_2", &mut alpha[2], &[(4, 1, 8)], -24, true);
        w.real("alpha_3", &mut alpha[3], &[(4, 9, 8)], -24, true);
        w.real("beta_0", &mut beta[0], &[(4, 17, 8)], 11, true);
        w.real("beta_1", &mut beta[1], &[(5, 1, 8)], 14, true);
        w.real("beta_2", &mut beta[2], &[(5, 9, 8)], 16, true);
        w.real("beta_3", &mut beta[3], &[(5, 17, 8)], 16, true);
        w.real("A_1", &mut self.a1, &[(6, 1, 24)], -50, true);
        w.real("A_0", &mut self.a0, &[(7, 1, 24), (8, 1, 8)], -30, true);
        w.real("t_ot", &mut self.tot, &[(8, 9, 8)], 12, false);
        w.count("WN_t", &mut self.week_t, &[(8, 17, 8)]);
        w.real("delta t_LS", &mut self.delta_t_ls, &[(9, 1, 8)], 0, true);
        w.count("WN_LSF", &mut self.week_lsf, &[(9, 9, 8)]);
        w.count("DN", &mut self.day, &[(9, 17, 8)]);
        w.real("delta t_LSF", &mut self.delta_t_lsf, &[(10, 1, 8)], 0, true);
    }
}

impl IonosphereUtc {
    /// The page that carries these models.
    pub fn new(klobuchar: Klobuchar, utc: &UtcParameters) -> Self {
        Self {
            klobuchar,
            a0: utc.a0,
            a1: utc.a1,
            tot: utc.tot.tow(),
            week_t: utc.tot.week().rem_euclid(256) as u8,
            delta_t_ls: utc.delta_t_ls.into(),
            week_lsf: utc.wn_lsf.rem_euclid(256) as u8,
            day: utc.day,
            delta_t_lsf: utc.delta_t_lsf.into(),
        }
    }

    /// The UTC parameters, with weeks modulo 256 resolved to those nearest the (full) week in which
    /// the page was sent.
    pub fn utc(&self, week: i32) -> UtcParameters {
        UtcParameters {
            a0: self.a0,
            a1: self.a1,
            tot: GpsTime::from_week_tow(resolve_week(self.week_t.into(), 8, week), self.tot),
            delta_t_ls: self.delta_t_ls as i32,
            delta_t_lsf: self.delta_t_lsf as i32,
            wn_lsf: resolve_week(self.week_lsf.into(), 8, week),
            day: self.day,
        }
    }
}

/// Almanac reference and health of satellites 1 to 24 (subframe 5 page 25; figure 20-1 sheet 5).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Health1To24 {
    /// Almanac reference time of week, s.
    pub toa: f64,
    /// Almanac week, modulo 256.
    pub week_a: u8,
    /// Six-bit health words of PRN 1 to 24; 0 is healthy.
    pub health: [u8; 24],
}

impl Fields for Health1To24 {
    fn walk(&mut self, w: &mut Walk) {
        w.real("t_oa", &mut self.toa, &[(3, 9, 8)], 12, false);
        w.count("WN_a", &mut self.week_a, &[(3, 17, 8)]);
        for (k, health) in self.health.iter_mut().enumerate() {
            w.count("SV health", health, &[(4 + k / 4, 1 + 6 * (k as u32 % 4), 6)]);
        }
    }
}

/// Configurations of all satellites, and health of satellites 25 to 32 (subframe 4 page 25).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Health25To32 {
    /// Anti-spoof flag (top bit) and configuration (3 bits) of PRN 1 to 32.
    pub configuration: [u8; 32],
    /// Six-bit health words of PRN 25 to 32; 0 is healthy.
    pub health: [u8; 8],
}

impl Fields for Health25To32 {
    fn walk(&mut self, w: &mut Walk) {
        for (k, configuration) in self.configuration.iter_mut().enumerate() {
            // Four in the last 16 bits of word 3, then six a word.
            let (word, slot) = if k < 4 { (3, k + 2) } else { (4 + (k - 4) / 6, (k - 4) % 6) };
            w.count("SV configuration", configuration, &[(word, 1 + 4 * slot as u32, 4)]);
        }
        w.count("SV health", &mut self.health[0], &[(8, 19, 6)]);
        for (k, health) in self.health[1..].iter_mut().enumerate() {
            w.count("SV health", health, &[(9 + k / 4, 1 + 6 * (k as u32 % 4), 6)]);
        }
    }
}

/// The SV ID (page identity) of page 1 to 25 of subframe 4 or 5 (IS-GPS-200N table 20-V).
pub fn page_sv_id(subframe: u8, page: u8) -> u8 {
    match (subframe, page) {
        (5, 1..=24) => page,
        (5, _) => 51,
        (_, 2..=5) => 23 + page,
        (_, 7..=10) => 22 + page,
        (_, 12 | 24) => 62,
        (_, 13..=15) => 39 + page,
        (_, 17) => 55,
        (_, 18) => 56,
        (_, 19) => 58,
        (_, 20) => 59,
        (_, 22) => 60,
        (_, 23) => 61,
        (_, 25) => 63,
        _ => 57,
    }
}
