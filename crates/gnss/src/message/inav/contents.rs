//! Contents of the words of I/NAV but those of the almanac: ephemeris, clock, time, ionosphere and health (Galileo OS SIS
//! ICD 2.1, 4.3.5). Values are in SI units and rad; angles are sent in semicircles.

use crate::galileo_data::GalileoHealth;
use crate::message::fields::{Fields, Walk};

/// Type 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word0 {
    /// 2 where week and time of week are valid.
    pub time: u8,
    /// Week of GST modulo 4096.
    pub week: u16,
    /// Time of week of the start of the page, s.
    pub tow: u32,
}

/// Type 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word1 {
    /// Issue of data of the ephemeris, 10 bits.
    pub iod_nav: u16,
    /// Reference time of week of the ephemeris `t_0e`, s, unit 60 s.
    pub toe: f64,
    /// Mean anomaly at `t_0e`, rad.
    pub m0: f64,
    /// Eccentricity.
    pub e: f64,
    /// Square root of the semi-major axis, sqrt(m).
    pub sqrt_a: f64,
    /// Two reserved bits.
    pub reserved: u8,
}

/// Type 2.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word2 {
    /// Issue of data.
    pub iod_nav: u16,
    /// Longitude of the ascending node at the start of the week, rad.
    pub omega0: f64,
    /// Inclination at `t_0e`, rad.
    pub i0: f64,
    /// Argument of perigee, rad.
    pub omega: f64,
    /// Rate of inclination, rad/s.
    pub idot: f64,
}

/// Type 3.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word3 {
    /// Issue of data.
    pub iod_nav: u16,
    /// Rate of right ascension, rad/s.
    pub omega_dot: f64,
    /// Mean motion difference, rad/s.
    pub delta_n: f64,
    /// Cosine correction to the argument of latitude, rad.
    pub cuc: f64,
    /// Sine correction to the argument of latitude, rad.
    pub cus: f64,
    /// Cosine correction to the orbit radius, m.
    pub crc: f64,
    /// Sine correction to the orbit radius, m.
    pub crs: f64,
    /// Index of the accuracy SISA(E1, E5b): see [`sisa_m`].
    pub sisa: u8,
}

/// Type 4.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word4 {
    /// Issue of data.
    pub iod_nav: u16,
    /// The satellite, 1 to 36.
    pub sv_id: u8,
    /// Cosine correction to the inclination, rad.
    pub cic: f64,
    /// Sine correction to the inclination, rad.
    pub cis: f64,
    /// Reference time of week of the clock `t_0c`, s, unit 60 s.
    pub toc: f64,
    /// Clock bias against GST of the combination of E1 and E5b, s.
    pub af0: f64,
    /// Clock drift, s/s.
    pub af1: f64,
    /// Clock drift rate, s/s^2.
    pub af2: f64,
}

/// Type 5.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word5 {
    /// Coefficients and flags of NeQuick G: see [`NequickCoefficients`](crate::galileo_data::NequickCoefficients).
    pub ai: [f64; 3],
    /// Its flags.
    pub storm_flags: u8,
    /// Broadcast group delay BGD(E1, E5a), s.
    pub bgd_e1_e5a: f64,
    /// Broadcast group delay BGD(E1, E5b), s: that of the clock of I/NAV.
    pub bgd_e1_e5b: f64,
    /// State of the two signals.
    pub health: GalileoHealth,
    /// Week of GST modulo 4096.
    pub week: u16,
    /// Time of week of the start of the page, s.
    pub tow: u32,
}

/// Type 6. Parameters as in IS-GPS-200, of GST in place of GPS time (OS SIS ICD 5.1.7).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word6 {
    /// Constant term of GST minus UTC, s.
    pub a0: f64,
    /// First-order term, s/s.
    pub a1: f64,
    /// Leap seconds now, s.
    pub delta_t_ls: f64,
    /// Reference time of week, s, unit 3600 s.
    pub t0t: f64,
    /// Reference week modulo 256.
    pub week_0t: u8,
    /// Week of the leap second change modulo 256.
    pub week_lsf: u8,
    /// Day of that week at whose end it is, 1 (Sunday) to 7.
    pub day: u8,
    /// Leap seconds after the change, s.
    pub delta_t_lsf: f64,
    /// Time of week of the start of the page, s.
    pub tow: u32,
}

/// Type 16: reduced ephemeris and clock, good for some 10 minutes, to metres and tens of metres (OS SIS ICD 5.1.11).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word16 {
    /// Semi-major axis minus 29 600 km, m, unit 256 m.
    pub delta_a: f64,
    /// e cos(omega).
    pub ex: f64,
    /// e sin(omega).
    pub ey: f64,
    /// Inclination minus 56 degrees, rad.
    pub delta_i0: f64,
    /// Longitude of the ascending node at the start of the week, rad.
    pub omega0: f64,
    /// Mean argument of latitude, mean anomaly plus argument of perigee, rad.
    pub lambda0: f64,
    /// Clock bias, s.
    pub af0: f64,
    /// Clock drift, s/s.
    pub af1: f64,
}

/// Types 17 to 20: a quarter of the Reed-Solomon parity of the words 1 to 4 (OS SIS ICD 5.1.13).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParityWord {
    /// Type, 17 to 20.
    pub kind: u8,
    /// First octet of parity.
    pub first: u8,
    /// The two lowest bits of IODnav of the words 1 to 4.
    pub iod_nav: u8,
    /// The other octets of parity.
    pub octets: [u8; 14],
}

/// A word whose type is not known here.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OtherWord {
    /// Type, 0 to 63.
    pub kind: u8,
    /// The 122 bits after the type, the last byte filled up with zeros.
    pub data: [u8; 16],
}

/// Accuracy of an index SISA, m, from 0 to 6; none where it is not stated (OS SIS ICD 5.1.12: 255, and reserved ones).
pub fn sisa_m(index: u8) -> Option<f64> {
    let i = f64::from(index);
    match index {
        0..=49 => Some(0.01 * i),
        50..=74 => Some(0.5 + 0.02 * (i - 50.0)),
        75..=99 => Some(1.0 + 0.04 * (i - 75.0)),
        100..=125 => Some(2.0 + 0.16 * (i - 100.0)),
        _ => None,
    }
}

/// 2^`exponent`, the unit of a field.
fn lsb(exponent: i32) -> f64 {
    2f64.powi(exponent)
}

impl Fields for Word0 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("time", &mut self.time, 2);
        w.alternating(88);
        w.count("WN", &mut self.week, 12);
        w.count("TOW", &mut self.tow, 20);
    }
}

impl Fields for Word1 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODnav", &mut self.iod_nav, 10);
        w.unsigned("t_0e", &mut self.toe, 14, 60.0);
        w.angle("M_0", &mut self.m0, 32);
        w.unsigned("e", &mut self.e, 32, lsb(-33));
        w.unsigned("sqrt A", &mut self.sqrt_a, 32, lsb(-19));
        w.count("reserved", &mut self.reserved, 2);
    }
}

impl Fields for Word2 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODnav", &mut self.iod_nav, 10);
        w.angle("Omega_0", &mut self.omega0, 32);
        w.semicircles("i_0", &mut self.i0, 32, lsb(-31));
        w.angle("omega", &mut self.omega, 32);
        w.semicircles("idot", &mut self.idot, 14, lsb(-43));
        w.alternating(2);
    }
}

impl Fields for Word3 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODnav", &mut self.iod_nav, 10);
        w.semicircles("Omega dot", &mut self.omega_dot, 24, lsb(-43));
        w.semicircles("delta n", &mut self.delta_n, 16, lsb(-43));
        w.signed("C_uc", &mut self.cuc, 16, lsb(-29));
        w.signed("C_us", &mut self.cus, 16, lsb(-29));
        w.signed("C_rc", &mut self.crc, 16, lsb(-5));
        w.signed("C_rs", &mut self.crs, 16, lsb(-5));
        w.count("SISA", &mut self.sisa, 8);
    }
}

impl Fields for Word4 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODnav", &mut self.iod_nav, 10);
        w.count("SVID", &mut self.sv_id, 6);
        w.signed("C_ic", &mut self.cic, 16, lsb(-29));
        w.signed("C_is", &mut self.cis, 16, lsb(-29));
        w.unsigned("t_0c", &mut self.toc, 14, 60.0);
        w.signed("a_f0", &mut self.af0, 31, lsb(-34));
        w.signed("a_f1", &mut self.af1, 21, lsb(-46));
        w.signed("a_f2", &mut self.af2, 6, lsb(-59));
        w.alternating(2);
    }
}

impl Fields for Word5 {
    fn walk(&mut self, w: &mut Walk) {
        let [ai0, ai1, ai2] = &mut self.ai;
        w.unsigned("a_i0", ai0, 11, lsb(-2));
        w.signed("a_i1", ai1, 11, lsb(-8));
        w.signed("a_i2", ai2, 14, lsb(-15));
        w.count("storm flags", &mut self.storm_flags, 5);
        w.signed("BGD(E1, E5a)", &mut self.bgd_e1_e5a, 10, lsb(-32));
        w.signed("BGD(E1, E5b)", &mut self.bgd_e1_e5b, 10, lsb(-32));
        w.count("E5b HS", &mut self.health.e5b_status, 2);
        w.count("E1-B HS", &mut self.health.e1b_status, 2);
        w.flag(&mut self.health.e5b_not_valid);
        w.flag(&mut self.health.e1b_not_valid);
        w.count("WN", &mut self.week, 12);
        w.count("TOW", &mut self.tow, 20);
        w.alternating(23);
    }
}

impl Fields for Word6 {
    fn walk(&mut self, w: &mut Walk) {
        w.signed("A_0", &mut self.a0, 32, lsb(-30));
        w.signed("A_1", &mut self.a1, 24, lsb(-50));
        w.signed("delta t_LS", &mut self.delta_t_ls, 8, 1.0);
        w.unsigned("t_0t", &mut self.t0t, 8, 3600.0);
        w.count("WN_0t", &mut self.week_0t, 8);
        w.count("WN_LSF", &mut self.week_lsf, 8);
        w.count("DN", &mut self.day, 3);
        w.signed("delta t_LSF", &mut self.delta_t_lsf, 8, 1.0);
        w.count("TOW", &mut self.tow, 20);
        w.alternating(3);
    }
}

impl Fields for Word16 {
    fn walk(&mut self, w: &mut Walk) {
        w.signed("delta A", &mut self.delta_a, 5, lsb(8));
        w.signed("e_x", &mut self.ex, 13, lsb(-22));
        w.signed("e_y", &mut self.ey, 13, lsb(-22));
        w.semicircles("delta i_0", &mut self.delta_i0, 17, lsb(-22));
        w.angle("Omega_0", &mut self.omega0, 23);
        w.angle("lambda_0", &mut self.lambda0, 23);
        w.signed("a_f0", &mut self.af0, 22, lsb(-26));
        w.signed("a_f1", &mut self.af1, 6, lsb(-35));
    }
}

impl Fields for ParityWord {
    fn walk(&mut self, w: &mut Walk) {
        w.count("parity", &mut self.first, 8);
        w.count("IODnav", &mut self.iod_nav, 2);
        self.octets.iter_mut().for_each(|octet| w.count("parity", octet, 8));
    }
}

impl Fields for OtherWord {
    fn walk(&mut self, w: &mut Walk) {
        self.data[..15].iter_mut().for_each(|byte| w.count("data", byte, 8));
        let mut last = self.data[15] >> 6;
        w.count("data", &mut last, 2);
        self.data[15] = last << 6;
    }
}
