//! Almanac of Galileo: three satellites in the words 7 to 10 (Galileo OS SIS ICD 2.1, 5.1.10 and 4.3.5).

use crate::galileo_data::{GalileoGpsOffset, GalileoHealth};
use crate::message::fields::{Fields, Walk};
use crate::message::lnav::resolve_week;
use crate::{Constellation, GpsTime, Sv};

/// Semi-major axis to which almanacs and reduced ephemerides refer, m (OS SIS ICD table 1).
pub(super) const NOMINAL_A_M: f64 = 29_600e3;
/// Inclination to which they refer, degrees.
pub(super) const NOMINAL_I_DEG: f64 = 56.0;

/// Satellite, and form and orientation of its orbit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacOrbit {
    /// Satellite, 1 to 36; 0: no almanac.
    pub sv_id: u8,
    /// Square root of the semi-major axis minus that of 29 600 km, sqrt(m).
    pub delta_sqrt_a: f64,
    /// Eccentricity.
    pub e: f64,
    /// Argument of perigee, rad.
    pub omega: f64,
    /// Inclination minus 56 degrees, rad.
    pub delta_i: f64,
}

/// Node of the orbit of an almanac.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacNode {
    /// Longitude of the ascending node at the start of the week, rad.
    pub omega0: f64,
    /// Rate of right ascension, rad/s.
    pub omega_dot: f64,
}

/// Clock and health of an almanac.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacClock {
    /// Clock bias, s.
    pub af0: f64,
    /// Clock drift, s/s.
    pub af1: f64,
    /// Health status of E5b: see [`GalileoHealth`].
    pub e5b_status: u8,
    /// Health status of E1-B and E1-C.
    pub e1b_status: u8,
}

/// Reference time of an almanac.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacTime {
    /// Week of GST modulo 4.
    pub week_a: u8,
    /// Time of week `t_0a`, s, unit 600 s.
    pub t0a: f64,
}

/// Type 7.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacWord7 {
    /// Issue of data of the almanac, 4 bits.
    pub iod_a: u8,
    /// Reference time of the satellites 1 and 2.
    pub time: AlmanacTime,
    /// Satellite 1.
    pub orbit: AlmanacOrbit,
    /// Node of satellite 1.
    pub node: AlmanacNode,
    /// Mean anomaly of satellite 1, rad.
    pub m0: f64,
}

/// Type 8.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacWord8 {
    /// Issue of data of the almanac.
    pub iod_a: u8,
    /// Clock of satellite 1.
    pub clock: AlmanacClock,
    /// Satellite 2.
    pub orbit: AlmanacOrbit,
    /// Node of satellite 2.
    pub node: AlmanacNode,
}

/// Type 9.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacWord9 {
    /// Issue of data of the almanac.
    pub iod_a: u8,
    /// Reference time of the satellites 2 and 3.
    pub time: AlmanacTime,
    /// Mean anomaly of satellite 2, rad.
    pub m0: f64,
    /// Clock of satellite 2.
    pub clock: AlmanacClock,
    /// Satellite 3.
    pub orbit: AlmanacOrbit,
}

/// Type 10.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlmanacWord10 {
    /// Issue of data of the almanac.
    pub iod_a: u8,
    /// Node of satellite 3.
    pub node: AlmanacNode,
    /// Mean anomaly of satellite 3, rad.
    pub m0: f64,
    /// Clock of satellite 3.
    pub clock: AlmanacClock,
    /// GST against GPS time.
    pub gps_offset: SentGpsOffset,
}

/// GST minus GPS time as sent (OS SIS ICD 5.1.8).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SentGpsOffset {
    /// Constant term A_0G, s.
    pub a0g: f64,
    /// First-order term A_1G, s/s.
    pub a1g: f64,
    /// Reference time of week t_0G, s, unit 3600 s.
    pub t0g: f64,
    /// Reference week modulo 64.
    pub week_0g: u8,
}

impl SentGpsOffset {
    /// The offset, with the week modulo 64 resolved to that nearest the (full, GPS) `week` of the page; none where all
    /// bits are ones: not available.
    pub fn resolve(&self, week: i32) -> Option<GalileoGpsOffset> {
        let absent = (-(2f64.powi(-35)), -(2f64.powi(-51)), 255.0 * 3600.0, 63);
        let Self { a0g, a1g, t0g, week_0g } = *self;
        // Week 0 of GST is week 1024 of GPS time, a multiple of 64.
        let t0 = GpsTime::from_week_tow(resolve_week(week_0g.into(), 6, week), t0g);
        ((a0g, a1g, t0g, week_0g) != absent).then_some(GalileoGpsOffset { a0: a0g, a1: a1g, t0 })
    }
}

/// Almanac of a Galileo satellite.
#[derive(Clone, Debug, PartialEq)]
pub struct GalileoAlmanac {
    /// The satellite.
    pub sv: Sv,
    /// Issue of data of the almanac, 4 bits.
    pub iod_a: u8,
    /// Reference time.
    pub t0a: GpsTime,
    /// Square root of the semi-major axis, sqrt(m).
    pub sqrt_a: f64,
    /// Eccentricity.
    pub e: f64,
    /// Inclination, rad.
    pub i0: f64,
    /// Argument of perigee, rad.
    pub omega: f64,
    /// Longitude of the ascending node at the start of the week of the reference time, rad.
    pub omega0: f64,
    /// Rate of right ascension, rad/s.
    pub omega_dot: f64,
    /// Mean anomaly, rad.
    pub m0: f64,
    /// Clock bias, s.
    pub af0: f64,
    /// Clock drift, s/s.
    pub af1: f64,
    /// Health status of both signals; validity of data is not part of an almanac.
    pub health: GalileoHealth,
}

/// The last almanac words of a satellite, of types 7 to 10, from which almanacs are put together.
#[derive(Clone, Debug, Default)]
pub(super) struct AlmanacWords {
    pub first: Option<AlmanacWord7>,
    pub second: Option<AlmanacWord8>,
    pub third: Option<AlmanacWord9>,
    pub fourth: Option<AlmanacWord10>,
}

impl AlmanacWords {
    /// The almanac that the last two words complete, where they are of one issue of data; the week modulo 4 is
    /// resolved to that nearest the (full, GPS) `week`.
    pub(super) fn almanac(&self, week: i32) -> Option<GalileoAlmanac> {
        match (&self.first, &self.second, &self.third, &self.fourth) {
            (_, _, Some(a), Some(b)) if a.iod_a == b.iod_a => {
                almanac((a.iod_a, &a.time), &a.orbit, &b.node, b.m0, &b.clock, week)
            }
            (_, Some(a), Some(b), None) if a.iod_a == b.iod_a => {
                almanac((b.iod_a, &b.time), &a.orbit, &a.node, b.m0, &b.clock, week)
            }
            (Some(a), Some(b), None, None) if a.iod_a == b.iod_a => {
                almanac((a.iod_a, &a.time), &a.orbit, &a.node, a.m0, &b.clock, week)
            }
            _ => None,
        }
    }
}

fn almanac(
    (iod_a, time): (u8, &AlmanacTime),
    orbit: &AlmanacOrbit,
    node: &AlmanacNode,
    m0: f64,
    clock: &AlmanacClock,
    week: i32,
) -> Option<GalileoAlmanac> {
    let AlmanacClock { af0, af1, e5b_status, e1b_status } = *clock;
    Some(GalileoAlmanac {
        sv: Sv::new(Constellation::Galileo, orbit.sv_id)?,
        iod_a,
        t0a: GpsTime::from_week_tow(resolve_week(time.week_a.into(), 2, week), time.t0a),
        sqrt_a: NOMINAL_A_M.sqrt() + orbit.delta_sqrt_a,
        e: orbit.e,
        i0: NOMINAL_I_DEG.to_radians() + orbit.delta_i,
        omega: orbit.omega,
        omega0: node.omega0,
        omega_dot: node.omega_dot,
        m0,
        af0,
        af1,
        health: GalileoHealth { e5b_status, e1b_status, ..GalileoHealth::default() },
    })
}

fn lsb(exponent: i32) -> f64 {
    2f64.powi(exponent)
}

impl Fields for AlmanacOrbit {
    fn walk(&mut self, w: &mut Walk) {
        w.count("SVID", &mut self.sv_id, 6);
        w.signed("delta sqrt A", &mut self.delta_sqrt_a, 13, lsb(-9));
        w.unsigned("e", &mut self.e, 11, lsb(-16));
        w.angle("omega", &mut self.omega, 16);
        w.semicircles("delta i", &mut self.delta_i, 11, lsb(-14));
    }
}

impl Fields for AlmanacNode {
    fn walk(&mut self, w: &mut Walk) {
        w.angle("Omega_0", &mut self.omega0, 16);
        w.semicircles("Omega dot", &mut self.omega_dot, 11, lsb(-33));
    }
}

impl Fields for AlmanacClock {
    fn walk(&mut self, w: &mut Walk) {
        w.signed("a_f0", &mut self.af0, 16, lsb(-19));
        w.signed("a_f1", &mut self.af1, 13, lsb(-38));
        w.count("E5b HS", &mut self.e5b_status, 2);
        w.count("E1-B HS", &mut self.e1b_status, 2);
    }
}

impl Fields for AlmanacTime {
    fn walk(&mut self, w: &mut Walk) {
        w.count("WN_a", &mut self.week_a, 2);
        w.unsigned("t_0a", &mut self.t0a, 10, 600.0);
    }
}

impl Fields for SentGpsOffset {
    fn walk(&mut self, w: &mut Walk) {
        w.signed("A_0G", &mut self.a0g, 16, lsb(-35));
        w.signed("A_1G", &mut self.a1g, 12, lsb(-51));
        w.unsigned("t_0G", &mut self.t0g, 8, 3600.0);
        w.count("WN_0G", &mut self.week_0g, 6);
    }
}

impl Fields for AlmanacWord7 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODa", &mut self.iod_a, 4);
        self.time.walk(w);
        self.orbit.walk(w);
        self.node.walk(w);
        w.angle("M_0", &mut self.m0, 16);
        w.alternating(6);
    }
}

impl Fields for AlmanacWord8 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODa", &mut self.iod_a, 4);
        self.clock.walk(w);
        self.orbit.walk(w);
        self.node.walk(w);
        w.alternating(1);
    }
}

impl Fields for AlmanacWord9 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODa", &mut self.iod_a, 4);
        self.time.walk(w);
        w.angle("M_0", &mut self.m0, 16);
        self.clock.walk(w);
        self.orbit.walk(w);
    }
}

impl Fields for AlmanacWord10 {
    fn walk(&mut self, w: &mut Walk) {
        w.count("IODa", &mut self.iod_a, 4);
        self.node.walk(w);
        w.angle("M_0", &mut self.m0, 16);
        self.clock.walk(w);
        self.gps_offset.walk(w);
    }
}
