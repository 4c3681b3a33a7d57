//! Records of GPS and QZSS LNAV, Galileo I/NAV, BeiDou D1 and D2: up to eight lines of four fields (RINEX 2.11 table A4,
//! 3.05 tables A6, A8, A14), which differ by system in few of them.

use super::record::RecordFields;
use crate::format::records::ReadError;
use crate::galileo_data::{GalileoHealth, GalileoStatus};
use crate::orbit::broadcast::{NO_ACCURACY, ura_index};
use crate::time::SECONDS_PER_WEEK;
use crate::{Constellation, Ephemeris};

/// Weeks after which the 10 bits of a week number start anew.
const WEEKS_PER_CYCLE: i64 = 1 << 10;
/// Lines of a record.
const LINES: usize = 8;
/// The largest user range accuracy that is sent, m.
const WORST_URA_M: f64 = 8192.0;
/// Data sources of Galileo whose clock is that of I/NAV: E1-B and E5b (table A8, bits 0 and 2). Records of F/NAV (bit 1)
/// hold another clock for E5a.
const OF_INAV: u32 = 0b101;

/// The ephemeris of a record.
pub fn ephemeris(r: &RecordFields) -> Result<Ephemeris, ReadError> {
    let (sv, system) = (r.sv, r.sv.constellation());
    let count = r.count(LINES)?;
    // In the time of the system, and by its week, up to the end.
    let toc = r.epoch()?;
    let toe = toc.nearest_with_tow(r.within(12, "toe", 0.0, SECONDS_PER_WEEK as f64)?);
    let model = system.model();
    if let Some(week) = r.field(22)? {
        // The week goes with toe, or with the transmission at most a fit interval away.
        let off = week as i64 + i64::from(model.first_week) - i64::from(toe.week());
        if (off.rem_euclid(WEEKS_PER_CYCLE) + 1) % WEEKS_PER_CYCLE > 2 {
            let own = toc.week() - model.first_week;
            let problem = format!("week {week} of {sv} does not go with its epoch, in week {own}");
            return Err(r.malformed(5, problem, "both are of the same week"));
        }
    }
    // The last line may be missing; where another is, this is the time of transmission.
    let accuracy_m = r.field(24)?;
    if let Some(ura) = accuracy_m.filter(|ura| count < LINES && *ura > WORST_URA_M) {
        let problem = format!("the record of {sv} has {count} lines, and its URA is {ura} m");
        return Err(r.malformed(0, problem, format!("it has {LINES}")));
    }
    let fit = r.field(29)?.unwrap_or(0.0);
    let sent = r.field(28)?.filter(|tow| tow.abs() <= 2.0 * SECONDS_PER_WEEK as f64);
    let sent = sent.map(|tow| toe.nearest_with_tow(tow) + model.behind_gps_s);
    let is_lnav = matches!(system, Constellation::Gps | Constellation::Qzss);
    const TEN_BITS: f64 = ((1u16 << 10) - 1) as f64;
    let (iode, iodc, tgd, health) = match system {
        Constellation::Galileo => {
            let issue = r.within(4, "IODnav", 0.0, TEN_BITS)? as u16;
            let health = r.within(25, "health", 0.0, 511.0)? as u16;
            ((issue & 0xFF) as u8, issue, r.any(27, "BGD E5b/E1")?, (health & 0b111) as u8)
        }
        Constellation::BeiDou => {
            let aodc = r.field(29)?.unwrap_or(0.0).clamp(0.0, TEN_BITS) as u16;
            let aode = r.within(4, "AODE", 0.0, 255.0)? as u8;
            (aode, aodc, r.any(26, "TGD1")?, r.within(25, "SatH1", 0.0, 255.0)? as u8)
        }
        _ => {
            let iodc = r.within(27, "IODC", 0.0, TEN_BITS)? as u16;
            let iode = r.within(4, "IODE", 0.0, 255.0)? as u8;
            (iode, iodc, r.any(26, "TGD")?, r.within(25, "health", 0.0, 63.0)? as u8)
        }
    };
    Ok(Ephemeris {
        sv,
        iodc,
        iode,
        // Where none is stated, what is usual.
        ura_index: match accuracy_m {
            Some(metres) if metres < 0.0 => NO_ACCURACY,
            stated => stated.map_or(0, ura_index),
        },
        health,
        l2_codes: r.field(21)?.filter(|_| is_lnav).map_or(0, |v| v.clamp(0.0, 3.0) as u8),
        l2_p_data: is_lnav && r.field(23)?.is_some_and(|v| v != 0.0),
        // Hours, or from older writers and of QZSS the flag itself.
        fit_interval_flag: is_lnav && (fit == 1.0 || fit > 4.0),
        toc: toc + model.behind_gps_s,
        toe: toe + model.behind_gps_s,
        transmission_time: sent,
        af0: r.any(1, "af0")?,
        af1: r.any(2, "af1")?,
        af2: r.any(3, "af2")?,
        tgd,
        sqrt_a: r.within(11, "sqrt(A)", 2000.0, 8192.0)?,
        e: r.within(9, "e", 0.0, 0.5)?,
        m0: r.any(7, "M0")?,
        delta_n: r.any(6, "Delta n")?,
        omega0: r.any(14, "OMEGA0")?,
        omega_dot: r.any(19, "OMEGA DOT")?,
        i0: r.any(16, "i0")?,
        idot: r.any(20, "IDOT")?,
        omega: r.any(18, "omega")?,
        cuc: r.any(8, "Cuc")?,
        cus: r.any(10, "Cus")?,
        crc: r.any(17, "Crc")?,
        crs: r.any(5, "Crs")?,
        cic: r.any(13, "Cic")?,
        cis: r.any(15, "Cis")?,
    })
}

/// Whether a record of Galileo is one of I/NAV.
pub fn is_inav(r: &RecordFields) -> Result<bool, ReadError> {
    Ok(r.field(21)?.is_some_and(|source| source as u32 & OF_INAV != 0))
}

/// What a record of Galileo's I/NAV holds beside the ephemeris.
pub fn galileo_status(r: &RecordFields) -> Result<GalileoStatus, ReadError> {
    let word = r.within(25, "health", 0.0, 511.0)? as u16;
    let bits = |from: u16, mask: u16| (word >> from & mask) as u8;
    Ok(GalileoStatus {
        sisa_m: r.field(24)?.filter(|sisa| *sisa >= 0.0),
        bgd_e1_e5a: r.field(26)?.unwrap_or(0.0),
        bgd_e1_e5b: r.any(27, "BGD E5b/E1")?,
        health: GalileoHealth {
            e1b_not_valid: bits(0, 1) == 1,
            e1b_status: bits(1, 3),
            e5b_not_valid: bits(6, 1) == 1,
            e5b_status: bits(7, 3),
        },
    })
}
