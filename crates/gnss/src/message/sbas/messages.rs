//! Contents of the messages of SBAS L1: RTCA DO-229 Appendix A, with the same contents ICAO Annex 10 volume
//! I, appendix B.
//!
//! Corrections refer to satellites by their slot in the PRN mask and to grid points by their index in the
//! grid masks; the issues of data (IODP, IODI) identify the mask, IODF and IODE fast correction and ephemeris.
//! All of them stay as sent: a receiver has to combine them.

use super::{CHECKED_BITS, MESSAGE_BITS, MessageBits, OutOfRange, PREAMBLES, preamble_of, seal};
use crate::message::fields::{Fields, Walk};
use serde::Serialize;

/// One message.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SbasMessage {
    /// Type, 0 to 63.
    pub kind: u8,
    /// Which of the three preambles it began with, 0 to 2.
    pub preamble: u8,
    /// Contents.
    pub content: SbasContent,
}

/// Contents by message type.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum SbasContent {
    /// Type 0: do not use this satellite for safety. A system under test sends the contents of type 2
    /// here; they are absent where all data bits are zero.
    DoNotUse(Option<FastCorrections>),
    /// Type 1.
    PrnMask(PrnMask),
    /// Types 2 to 5: satellites 1 to 13, 14 to 26, 27 to 39, 40 to 51 of the mask.
    FastCorrections(FastCorrections),
    /// Type 6.
    Integrity(IntegrityInformation),
    /// Type 7.
    FastDegradation(FastDegradation),
    /// Type 9.
    GeoNavigation(GeoNavigation),
    /// Type 10.
    Degradation(DegradationParameters),
    /// Type 12.
    NetworkTime(NetworkTime),
    /// Type 17.
    GeoAlmanacs(GeoAlmanacs),
    /// Type 18.
    GridMask(GridMask),
    /// Type 24.
    Mixed(MixedCorrections),
    /// Type 25: two halves.
    LongTerm([LongTermHalf; 2]),
    /// Type 26.
    GridDelays(GridDelays),
    /// Type 62: internal test, data as sent.
    InternalTest(RawData),
    /// Type 63: null message, data as sent.
    Null(RawData),
    /// Any other type, data as sent.
    Other(RawData),
}

/// The 212 bits of data of a message, the first as the highest bit; the last four bits are zero.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RawData(pub [u8; 27]);

/// Type 1: the satellites of the corrections.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PrnMask {
    /// Slots that are set, ascending: 1 to 37 GPS PRN, 38 to 61 GLONASS slot + 37, 120 to 138 SBAS PRN,
    /// others reserved. The n-th of them is satellite n of the other messages; at most 51 are valid.
    pub slots: Vec<u8>,
    /// Issue of this mask, 0 to 3.
    pub iodp: u8,
}

/// Fast correction of one satellite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FastCorrection {
    /// To be added to the pseudorange, m, -256 to 255.875, at the time of the first bit of the message.
    pub range_m: f64,
    /// UDREI, indicator of the variance of the error that is left (DO-229 Table A-6); 14 not monitored, 15 do
    /// not use.
    pub udrei: u8,
}

/// Types 2 to 5: fast corrections of 13 satellites.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FastCorrections {
    /// Issue of these corrections, 0 to 2; 3 is an alert.
    pub iodf: u8,
    /// Issue of the PRN mask.
    pub iodp: u8,
    /// In the order of the mask; type 5 holds satellites 40 to 51, and its last is unused.
    pub satellites: [FastCorrection; 13],
}

/// Type 6: integrity of all satellites of the mask.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct IntegrityInformation {
    /// Issues of the fast corrections (types 2 to 5) that the UDREI belong to; 3 means any.
    pub iodf: [u8; 4],
    /// UDREI of satellites 1 to 51 of the mask.
    pub udrei: Vec<u8>,
}

/// Type 7: how fast corrections degrade.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FastDegradation {
    /// System latency, s.
    pub latency_s: u8,
    /// Issue of the PRN mask.
    pub iodp: u8,
    /// Degradation factor indicators of satellites 1 to 51 of the mask, 0 to 15.
    pub indicators: Vec<u8>,
}

/// Type 9: orbit and clock of the satellite that sends it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GeoNavigation {
    /// The first eight bits: an issue of data (IODN), reserved in later editions.
    pub iodn: u8,
    /// Reference time, s of the day of SBAS network time, unit 16 s.
    pub t0_s: f64,
    /// User range accuracy index; 15 do not use for ranging.
    pub ura: u8,
    /// Earth-fixed WGS 84, m; units 0.08, 0.08, 0.4 m.
    pub position_m: [f64; 3],
    /// m/s; units 0.000625, 0.000625, 0.004 m/s.
    pub velocity_m_s: [f64; 3],
    /// m/s2; units 0.0000125, 0.0000125, 0.0000625 m/s2.
    pub acceleration_m_s2: [f64; 3],
    /// Clock offset from SBAS network time, s, unit 2^-31 s.
    pub clock_s: f64,
    /// Clock drift, s/s, unit 2^-40 s/s.
    pub drift_s_s: f64,
}

/// Type 10: degradation parameters of the corrections, names as in DO-229.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DegradationParameters {
    /// Brrc, range-rate corrections, m, unit 0.002.
    pub b_rrc_m: f64,
    /// Cltc_lsb, rounding of long-term corrections, m, unit 0.002.
    pub c_ltc_lsb_m: f64,
    /// Cltc_v1, velocity error, velocity code 1, m/s, unit 0.00005.
    pub c_ltc_v1_m_s: f64,
    /// Iltc_v1, update interval, velocity code 1, s.
    pub i_ltc_v1_s: u16,
    /// Cltc_v0, velocity code 0, m, unit 0.002.
    pub c_ltc_v0_m: f64,
    /// Iltc_v0, update interval, velocity code 0, s.
    pub i_ltc_v0_s: u16,
    /// Cgeo_lsb, rounding of type 9, m, unit 0.0005.
    pub c_geo_lsb_m: f64,
    /// Cgeo_v, velocity error of type 9, m/s, unit 0.00005.
    pub c_geo_v_m_s: f64,
    /// Igeo, update interval of type 9, s.
    pub i_geo_s: u16,
    /// Cer, m, unit 0.5.
    pub c_er_m: f64,
    /// Ciono_step, m, unit 0.001.
    pub c_iono_step_m: f64,
    /// Iiono, update interval of grid delays, s.
    pub i_iono_s: u16,
    /// Ciono_ramp, m/s, unit 0.000005.
    pub c_iono_ramp_m_s: f64,
    /// Whether the terms of the fast and long-term residual add as squares.
    pub rss_udre: bool,
    /// Whether the terms of the ionospheric residual add as squares.
    pub rss_iono: bool,
    /// Ccovariance, unit 0.1.
    pub c_covariance: f64,
}

/// Type 12: SBAS network time against UTC, and the week. Parameters as in IS-GPS-200, 20.3.3.5.2.4.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NetworkTime {
    /// A1, s/s, unit 2^-50.
    pub a1_s_s: f64,
    /// A0, s, unit 2^-30.
    pub a0_s: f64,
    /// Reference time t0t, s of the week, unit 4096 s.
    pub t0t_s: f64,
    /// Week of the reference time modulo 256.
    pub week_t: u8,
    /// Leap seconds, s.
    pub leap_s: f64,
    /// Week of the next or last leap second modulo 256.
    pub week_lsf: u8,
    /// Day of that week at whose end it is, 1 to 7.
    pub day: u8,
    /// Leap seconds from then on, s.
    pub leap_future_s: f64,
    /// Identifier of the laboratory whose UTC it is; 7: no UTC is given.
    pub utc_standard: u8,
    /// GPS time of week of the first bit of this message, s.
    pub gps_tow_s: u32,
    /// GPS week modulo 1024.
    pub gps_week: u16,
    /// Whether GLONASS time parameters follow.
    pub glonass: bool,
}

/// Coarse orbit of one satellite of the system.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct GeoAlmanac {
    /// Data identifier, 0.
    pub data_id: u8,
    /// PRN; 0: this almanac is empty.
    pub prn: u8,
    /// Status as sent: bits 0, 1, 2 (the lowest first) are set where ranging, corrections, integrity are
    /// off; the four highest are the provider (0 WAAS, 1 EGNOS, 2 MSAS).
    pub health: u8,
    /// Earth-fixed, m; units 2600, 2600, 26 000 m.
    pub position_m: [f64; 3],
    /// m/s; units 10, 10, 60 m/s.
    pub velocity_m_s: [f64; 3],
}

/// Type 17: almanacs of up to three satellites.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GeoAlmanacs {
    /// Empty ones have PRN 0.
    pub satellites: [GeoAlmanac; 3],
    /// Reference time, s of the day, unit 64 s.
    pub t0_s: f64,
}

/// Type 18: the grid points of one band with delays.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GridMask {
    /// Number of bands that this satellite sends.
    pub bands: u8,
    /// This band, 0 to 10.
    pub band: u8,
    /// Issue of the grid masks.
    pub iodi: u8,
    /// Numbers of the points that are set, ascending from 1 to 201, as DO-229 Table A-14 counts them.
    pub points: Vec<u8>,
}

/// Half of a type 24 or 25: long-term corrections of one satellite with rates or two without.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LongTermHalf {
    /// Without rates (velocity code 0) two corrections, with rates (velocity code 1) one.
    pub corrections: Vec<LongTermCorrection>,
    /// Issue of the PRN mask.
    pub iodp: u8,
}

/// Long-term correction of one satellite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LongTermCorrection {
    /// Satellite, 1 to 51, by its index in the mask; 0: no correction.
    pub satellite: u8,
    /// Issue of the ephemeris that is corrected (IODE of GPS).
    pub iode: u8,
    /// To be added to the position by the ephemeris, Earth-fixed, m, unit 0.125 m.
    pub position_m: [f64; 3],
    /// To be added to the satellite clock offset, s, unit 2^-31 s.
    pub clock_s: f64,
    /// Rates of both, with velocity code 1.
    pub rate: Option<LongTermRate>,
}

/// Rates of a long-term correction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LongTermRate {
    /// m/s, unit 2^-11 m/s.
    pub velocity_m_s: [f64; 3],
    /// s/s, unit 2^-39 s/s.
    pub drift_s_s: f64,
    /// Time of applicability, s of the day, unit 16 s.
    pub t0_s: f64,
}

/// Type 24: fast corrections of six satellites and half a type 25.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MixedCorrections {
    /// The first six of the satellites of the block.
    pub satellites: [FastCorrection; 6],
    /// Issue of the PRN mask.
    pub iodp: u8,
    /// 0 to 3: as if of type 2 to 5.
    pub block: u8,
    /// Issue of the fast corrections.
    pub iodf: u8,
    /// Long-term corrections.
    pub long_term: LongTermHalf,
}

/// Delay at one grid point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct GridDelay {
    /// Vertical delay at L1, m, unit 0.125 m; absent: do not use.
    pub vertical_m: Option<f64>,
    /// GIVEI, indicator of the variance of the vertical delay (DO-229 Table A-17); 15 not monitored.
    pub givei: u8,
}

/// Type 26: delays at 15 grid points.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GridDelays {
    /// Band, 0 to 10.
    pub band: u8,
    /// These are the points 15 x block + 1 to 15 x block + 15 of those set in the mask of the band.
    pub block: u8,
    /// The delays.
    pub points: [GridDelay; 15],
    /// Issue of the grid masks.
    pub iodi: u8,
}

impl SbasMessage {
    /// Reads the contents of a message whose parity was checked. None if it begins with no preamble.
    pub fn decode(bits: &MessageBits) -> Option<Self> {
        let preamble = preamble_of(bits)?;
        let mut kind = 0;
        Walk::reader(bits, 8).count("type", &mut kind, 6);
        let mut w = Walk::reader(bits, 14);
        let empty = !bits[14..CHECKED_BITS].contains(&true);
        let content = match kind {
            0 => SbasContent::DoNotUse((!empty).then(|| w.read())),
            1 => SbasContent::PrnMask(w.read()),
            2..=5 => SbasContent::FastCorrections(w.read()),
            6 => SbasContent::Integrity(w.read()),
            7 => SbasContent::FastDegradation(w.read()),
            9 => SbasContent::GeoNavigation(w.read()),
            10 => SbasContent::Degradation(w.read()),
            12 => SbasContent::NetworkTime(w.read()),
            17 => SbasContent::GeoAlmanacs(w.read()),
            18 => SbasContent::GridMask(w.read()),
            24 => SbasContent::Mixed(w.read()),
            25 => SbasContent::LongTerm([w.read(), w.read()]),
            26 => SbasContent::GridDelays(w.read()),
            62 => SbasContent::InternalTest(w.read()),
            63 => SbasContent::Null(w.read()),
            _ => SbasContent::Other(w.read()),
        };
        Some(Self { kind, preamble, content })
    }

    /// The bits of the message with preamble and parity. The caller sees to it that type and contents
    /// belong together. An error if a value does not fit its field.
    pub fn encode(&self) -> Result<MessageBits, OutOfRange> {
        let mut w = Walk::writer(&[false; MESSAGE_BITS]);
        let mut preamble = PREAMBLES[usize::from(self.preamble % 3)];
        w.count("preamble", &mut preamble, 8);
        w.count("type", &mut { self.kind }, 6);
        match self.content.clone() {
            SbasContent::DoNotUse(None) => {}
            SbasContent::DoNotUse(Some(mut c)) | SbasContent::FastCorrections(mut c) => {
                c.walk(&mut w)
            }
            SbasContent::PrnMask(mut c) => c.walk(&mut w),
            SbasContent::Integrity(mut c) => c.walk(&mut w),
            SbasContent::FastDegradation(mut c) => c.walk(&mut w),
            SbasContent::GeoNavigation(mut c) => c.walk(&mut w),
            SbasContent::Degradation(mut c) => c.walk(&mut w),
            SbasContent::NetworkTime(mut c) => c.walk(&mut w),
            SbasContent::GeoAlmanacs(mut c) => c.walk(&mut w),
            SbasContent::GridMask(mut c) => c.walk(&mut w),
            SbasContent::Mixed(mut c) => c.walk(&mut w),
            SbasContent::LongTerm(mut halves) => {
                halves.iter_mut().for_each(|half| half.walk(&mut w))
            }
            SbasContent::GridDelays(mut c) => c.walk(&mut w),
            SbasContent::InternalTest(mut c)
            | SbasContent::Null(mut c)
            | SbasContent::Other(mut c) => c.walk(&mut w),
        }
        let mut bits: MessageBits = w.finish()?;
        seal(&mut bits);
        Ok(bits)
    }

    /// GPS time of week of its first bit, s, if it contains it (type 12).
    pub fn tow_s(&self) -> Option<f64> {
        match &self.content {
            SbasContent::NetworkTime(time) if time.gps_tow_s < 604_800 => {
                Some(f64::from(time.gps_tow_s))
            }
            _ => None,
        }
    }
}

impl Fields for RawData {
    fn walk(&mut self, w: &mut Walk) {
        self.0[..26].iter_mut().for_each(|byte| w.count("data", byte, 8));
        let mut last = self.0[26] >> 4;
        w.count("data", &mut last, 4);
        self.0[26] = last << 4;
    }
}

impl Fields for PrnMask {
    fn walk(&mut self, w: &mut Walk) {
        w.mask("slots", &mut self.slots, 210);
        w.count("iodp", &mut self.iodp, 2);
    }
}

/// All corrections come first, then all indicators.
fn walk_fast(satellites: &mut [FastCorrection], w: &mut Walk) {
    satellites.iter_mut().for_each(|s| w.signed("range_m", &mut s.range_m, 12, 0.125));
    satellites.iter_mut().for_each(|s| w.count("udrei", &mut s.udrei, 4));
}

impl Fields for FastCorrections {
    fn walk(&mut self, w: &mut Walk) {
        w.count("iodf", &mut self.iodf, 2);
        w.count("iodp", &mut self.iodp, 2);
        walk_fast(&mut self.satellites, w);
    }
}

impl Fields for IntegrityInformation {
    fn walk(&mut self, w: &mut Walk) {
        self.iodf.iter_mut().for_each(|iodf| w.count("iodf", iodf, 2));
        w.list("udrei", &mut self.udrei, 51, 4);
    }
}

impl Fields for FastDegradation {
    fn walk(&mut self, w: &mut Walk) {
        w.count("latency_s", &mut self.latency_s, 4);
        w.count("iodp", &mut self.iodp, 2);
        w.spare(2);
        w.list("indicators", &mut self.indicators, 51, 4);
    }
}

impl Fields for GeoNavigation {
    fn walk(&mut self, w: &mut Walk) {
        w.count("iodn", &mut self.iodn, 8);
        w.unsigned("t0_s", &mut self.t0_s, 13, 16.0);
        w.count("ura", &mut self.ura, 4);
        for (name, vector, widths, lsbs) in [
            ("position_m", &mut self.position_m, [30, 30, 25], [0.08, 0.08, 0.4]),
            ("velocity_m_s", &mut self.velocity_m_s, [17, 17, 18], [6.25e-4, 6.25e-4, 4e-3]),
            (
                "acceleration_m_s2",
                &mut self.acceleration_m_s2,
                [10; 3],
                [1.25e-5, 1.25e-5, 6.25e-5],
            ),
        ] {
            (0..3).for_each(|k| w.signed(name, &mut vector[k], widths[k], lsbs[k]));
        }
        w.signed("clock_s", &mut self.clock_s, 12, 2f64.powi(-31));
        w.signed("drift_s_s", &mut self.drift_s_s, 8, 2f64.powi(-40));
    }
}

impl Fields for DegradationParameters {
    fn walk(&mut self, w: &mut Walk) {
        w.unsigned("b_rrc_m", &mut self.b_rrc_m, 10, 0.002);
        w.unsigned("c_ltc_lsb_m", &mut self.c_ltc_lsb_m, 10, 0.002);
        w.unsigned("c_ltc_v1_m_s", &mut self.c_ltc_v1_m_s, 10, 5e-5);
        w.count("i_ltc_v1_s", &mut self.i_ltc_v1_s, 9);
        w.unsigned("c_ltc_v0_m", &mut self.c_ltc_v0_m, 10, 0.002);
        w.count("i_ltc_v0_s", &mut self.i_ltc_v0_s, 9);
        w.unsigned("c_geo_lsb_m", &mut self.c_geo_lsb_m, 10, 5e-4);
        w.unsigned("c_geo_v_m_s", &mut self.c_geo_v_m_s, 10, 5e-5);
        w.count("i_geo_s", &mut self.i_geo_s, 9);
        w.unsigned("c_er_m", &mut self.c_er_m, 6, 0.5);
        w.unsigned("c_iono_step_m", &mut self.c_iono_step_m, 10, 0.001);
        w.count("i_iono_s", &mut self.i_iono_s, 9);
        w.unsigned("c_iono_ramp_m_s", &mut self.c_iono_ramp_m_s, 10, 5e-6);
        w.flag(&mut self.rss_udre);
        w.flag(&mut self.rss_iono);
        w.unsigned("c_covariance", &mut self.c_covariance, 7, 0.1);
    }
}

impl Fields for NetworkTime {
    fn walk(&mut self, w: &mut Walk) {
        w.signed("a1_s_s", &mut self.a1_s_s, 24, 2f64.powi(-50));
        w.signed("a0_s", &mut self.a0_s, 32, 2f64.powi(-30));
        w.unsigned("t0t_s", &mut self.t0t_s, 8, 4096.0);
        w.count("week_t", &mut self.week_t, 8);
        w.signed("leap_s", &mut self.leap_s, 8, 1.0);
        w.count("week_lsf", &mut self.week_lsf, 8);
        w.count("day", &mut self.day, 8);
        w.signed("leap_future_s", &mut self.leap_future_s, 8, 1.0);
        w.count("utc_standard", &mut self.utc_standard, 3);
        w.count("gps_tow_s", &mut self.gps_tow_s, 20);
        w.count("gps_week", &mut self.gps_week, 10);
        w.flag(&mut self.glonass);
    }
}

impl Fields for GeoAlmanacs {
    fn walk(&mut self, w: &mut Walk) {
        for s in &mut self.satellites {
            w.count("data_id", &mut s.data_id, 2);
            w.count("prn", &mut s.prn, 8);
            w.count("health", &mut s.health, 8);
            let (position, velocity) = (&mut s.position_m, &mut s.velocity_m_s);
            for (k, width, lsb) in [(0, 15, 2600.0), (1, 15, 2600.0), (2, 9, 26_000.0)] {
                w.signed("position_m", &mut position[k], width, lsb);
            }
            for (k, width, lsb) in [(0, 3, 10.0), (1, 3, 10.0), (2, 4, 60.0)] {
                w.signed("velocity_m_s", &mut velocity[k], width, lsb);
            }
        }
        w.unsigned("t0_s", &mut self.t0_s, 11, 64.0);
    }
}

impl Fields for GridMask {
    fn walk(&mut self, w: &mut Walk) {
        w.count("bands", &mut self.bands, 4);
        w.count("band", &mut self.band, 4);
        w.count("iodi", &mut self.iodi, 2);
        w.mask("points", &mut self.points, 201);
    }
}

impl Fields for LongTermHalf {
    fn walk(&mut self, w: &mut Walk) {
        let mut velocity_code = self.corrections.first().is_some_and(|c| c.rate.is_some());
        w.flag(&mut velocity_code);
        let (count, position_bits, clock_bits) =
            if velocity_code { (1, 11, 11) } else { (2, 9, 10) };
        self.corrections.resize(count, LongTermCorrection::default());
        for c in &mut self.corrections {
            w.count("satellite", &mut c.satellite, 6);
            w.count("iode", &mut c.iode, 8);
            c.position_m.iter_mut().for_each(|x| w.signed("position_m", x, position_bits, 0.125));
            w.signed("clock_s", &mut c.clock_s, clock_bits, 2f64.powi(-31));
            if velocity_code {
                let rate = c.rate.get_or_insert_default();
                rate.velocity_m_s
                    .iter_mut()
                    .for_each(|v| w.signed("velocity_m_s", v, 8, 2f64.powi(-11)));
                w.signed("drift_s_s", &mut rate.drift_s_s, 8, 2f64.powi(-39));
                w.unsigned("t0_s", &mut rate.t0_s, 13, 16.0);
            }
        }
        w.count("iodp", &mut self.iodp, 2);
        w.spare(usize::from(!velocity_code));
    }
}

impl Fields for MixedCorrections {
    fn walk(&mut self, w: &mut Walk) {
        walk_fast(&mut self.satellites, w);
        w.count("iodp", &mut self.iodp, 2);
        w.count("block", &mut self.block, 2);
        w.count("iodf", &mut self.iodf, 2);
        w.spare(4);
        self.long_term.walk(w);
    }
}

impl Fields for GridDelays {
    fn walk(&mut self, w: &mut Walk) {
        /// All ones: do not use.
        const DO_NOT_USE_M: f64 = 511.0 * 0.125;
        w.count("band", &mut self.band, 4);
        w.count("block", &mut self.block, 4);
        for point in &mut self.points {
            let mut delay = point.vertical_m.unwrap_or(DO_NOT_USE_M);
            w.unsigned("vertical_m", &mut delay, 9, 0.125);
            point.vertical_m = (delay != DO_NOT_USE_M).then_some(delay);
            w.count("givei", &mut point.givei, 4);
        }
        w.count("iodi", &mut self.iodi, 2);
    }
}
