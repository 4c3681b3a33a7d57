//! Subframes 1 to 3: clock and ephemeris (IS-GPS-200N figure 20-1, tables 20-I and 20-III).

use super::fields::{Fields, Walk};
use super::resolve_week;
use crate::{Ephemeris, GpsTime, Sv};

/// Subframe 1: week number, health and clock.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Subframe1 {
    /// Week of the start of the frame, modulo 1024.
    pub week: u16,
    /// Codes on the L2 channel.
    pub l2_codes: u8,
    /// URA index, 0 to 15.
    pub ura_index: u8,
    /// Six-bit health word; 0 is healthy.
    pub health: u8,
    /// Issue of data, clock (10 bits).
    pub iodc: u16,
    /// Whether the L2 P-code carries no navigation data.
    pub l2_p_data: bool,
    /// Group delay T_GD, s.
    pub tgd: f64,
    /// Clock reference time of week, s.
    pub toc: f64,
    /// Clock drift rate, s/s^2.
    pub af2: f64,
    /// Clock drift, s/s.
    pub af1: f64,
    /// Clock bias, s.
    pub af0: f64,
}

impl Fields for Subframe1 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("week", &mut self.week, &[(3, 1, 10)]);
        w.count("codes on L2", &mut self.l2_codes, &[(3, 11, 2)]);
        w.count("URA index", &mut self.ura_index, &[(3, 13, 4)]);
        w.count("health", &mut self.health, &[(3, 17, 6)]);
        w.count("IODC", &mut self.iodc, &[(3, 23, 2), (8, 1, 8)]);
        w.flag(&mut self.l2_p_data, &[(4, 1, 1)]);
        w.real("T_GD", &mut self.tgd, &[(7, 17, 8)], -31, true);
        w.real("t_oc", &mut self.toc, &[(8, 9, 16)], 4, false);
        w.real("a_f2", &mut self.af2, &[(9, 1, 8)], -55, true);
        w.real("a_f1", &mut self.af1, &[(9, 9, 16)], -43, true);
        w.real("a_f0", &mut self.af0, &[(10, 1, 22)], -31, true);
    }
}

impl Subframe1 {
    /// The subframe 1 of an ephemeris, for a frame that starts in (full) `week`.
    pub fn new(eph: &Ephemeris, week: i32) -> Self {
        Self {
            week: week.rem_euclid(1024) as u16,
            l2_codes: eph.l2_codes,
            ura_index: eph.ura_index,
            health: eph.health,
            iodc: eph.iodc,
            l2_p_data: eph.l2_p_data,
            tgd: eph.tgd,
            toc: eph.toc.tow(),
            af2: eph.af2,
            af1: eph.af1,
            af0: eph.af0,
        }
    }
}

/// Subframe 2: first half of the ephemeris.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Subframe2 {
    /// Issue of data, ephemeris.
    pub iode: u8,
    /// Sine correction to the orbit radius, m.
    pub crs: f64,
    /// Mean motion difference, rad/s.
    pub delta_n: f64,
    /// Mean anomaly, rad.
    pub m0: f64,
    /// Cosine correction to the argument of latitude, rad.
    pub cuc: f64,
    /// Eccentricity.
    pub e: f64,
    /// Sine correction to the argument of latitude, rad.
    pub cus: f64,
    /// Square root of the semi-major axis, sqrt(m).
    pub sqrt_a: f64,
    /// Ephemeris reference time of week, s.
    pub toe: f64,
    /// Whether the curve-fit interval is longer than 4 hours.
    pub fit_interval_flag: bool,
    /// Age of data offset, units of 900 s (31: no correction table).
    pub aodo: u8,
}

impl Fields for Subframe2 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODE", &mut self.iode, &[(3, 1, 8)]);
        w.real("C_rs", &mut self.crs, &[(3, 9, 16)], -5, true);
        w.semicircles("delta n", &mut self.delta_n, &[(4, 1, 16)], -43);
        w.angle("M_0", &mut self.m0, &[(4, 17, 8), (5, 1, 24)], -31);
        w.real("C_uc", &mut self.cuc, &[(6, 1, 16)], -29, true);
        w.real("e", &mut self.e, &[(6, 17, 8), (7, 1, 24)], -33, false);
        w.real("C_us", &mut self.cus, &[(8, 1, 16)], -29, true);
        w.real("sqrt A", &mut self.sqrt_a, &[(8, 17, 8), (9, 1, 24)], -19, false);
        w.real("t_oe", &mut self.toe, &[(10, 1, 16)], 4, false);
        w.flag(&mut self.fit_interval_flag, &[(10, 17, 1)]);
        w.count("AODO", &mut self.aodo, &[(10, 18, 5)]);
    }
}

impl From<&Ephemeris> for Subframe2 {
    fn from(eph: &Ephemeris) -> Self {
        Self {
            iode: eph.iode,
            crs: eph.crs,
            delta_n: eph.delta_n,
            m0: eph.m0,
            cuc: eph.cuc,
            e: eph.e,
            cus: eph.cus,
            sqrt_a: eph.sqrt_a,
            toe: eph.toe.tow(),
            fit_interval_flag: eph.fit_interval_flag,
            aodo: 31,
        }
    }
}

/// Subframe 3: second half of the ephemeris.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Subframe3 {
    /// Cosine correction to the inclination, rad.
    pub cic: f64,
    /// Longitude of the ascending node at the start of the week, rad.
    pub omega0: f64,
    /// Sine correction to the inclination, rad.
    pub cis: f64,
    /// Inclination, rad.
    pub i0: f64,
    /// Cosine correction to the orbit radius, m.
    pub crc: f64,
    /// Argument of perigee, rad.
    pub omega: f64,
    /// Rate of right ascension, rad/s.
    pub omega_dot: f64,
    /// Issue of data, ephemeris.
    pub iode: u8,
    /// Rate of inclination, rad/s.
    pub idot: f64,
}

impl Fields for Subframe3 {
    fn walk(&mut self, w: &mut Walk) {
        w.real("C_ic", &mut self.cic, &[(3, 1, 16)], -29, true);
        w.angle("Omega_0", &mut self.omega0, &[(3, 17, 8), (4, 1, 24)], -31);
        w.real("C_is", &mut self.cis, &[(5, 1, 16)], -29, true);
        w.semicircles("i_0", &mut self.i0, &[(5, 17, 8), (6, 1, 24)], -31);
        w.real("C_rc", &mut self.crc, &[(7, 1, 16)], -5, true);
        w.angle("omega", &mut self.omega, &[(7, 17, 8), (8, 1, 24)], -31);
        w.semicircles("Omega dot", &mut self.omega_dot, &[(9, 1, 24)], -43);
        w.count("IODE", &mut self.iode, &[(10, 1, 8)]);
        w.semicircles("IDOT", &mut self.idot, &[(10, 9, 14)], -43);
    }
}

impl From<&Ephemeris> for Subframe3 {
    fn from(eph: &Ephemeris) -> Self {
        Self {
            cic: eph.cic,
            omega0: eph.omega0,
            cis: eph.cis,
            i0: eph.i0,
            crc: eph.crc,
            omega: eph.omega,
            omega_dot: eph.omega_dot,
            iode: eph.iode,
            idot: eph.idot,
        }
    }
}

/// The ephemeris that three subframes carry, or nothing when their issues of data disagree (IODC low 8
/// bits, both IODEs: IS-GPS-200N 20.3.4.4). `frame_tow` is the time of week (s) of the start of
/// subframe 1's frame; the week modulo 1024 is resolved to that nearest `reference_week`.
pub fn assemble(
    sv: Sv,
    (s1, s2, s3): (&Subframe1, &Subframe2, &Subframe3),
    frame_tow: f64,
    reference_week: i32,
) -> Option<Ephemeris> {
    if s2.iode != s3.iode || s1.iodc & 0xFF != u16::from(s2.iode) {
        return None;
    }
    let week = resolve_week(s1.week.into(), 10, reference_week);
    let transmission_time = GpsTime::from_week_tow(week, frame_tow);
    Some(Ephemeris {
        sv,
        iodc: s1.iodc,
        iode: s2.iode,
        ura_index: s1.ura_index,
        health: s1.health,
        l2_codes: s1.l2_codes,
        l2_p_data: s1.l2_p_data,
        fit_interval_flag: s2.fit_interval_flag,
        toc: transmission_time.nearest_with_tow(s1.toc),
        toe: transmission_time.nearest_with_tow(s2.toe),
        transmission_time: Some(transmission_time),
        af0: s1.af0,
        af1: s1.af1,
        af2: s1.af2,
        tgd: s1.tgd,
        sqrt_a: s2.sqrt_a,
        e: s2.e,
        m0: s2.m0,
        delta_n: s2.delta_n,
        omega0: s3.omega0,
        omega_dot: s3.omega_dot,
        i0: s3.i0,
        idot: s3.idot,
        omega: s3.omega,
        cuc: s2.cuc,
        cus: s2.cus,
        crc: s3.crc,
        crs: s2.crs,
        cic: s3.cic,
        cis: s3.cis,
    })
}
