//! Records of GLONASS: four lines (RINEX 2.11 table A11, 3.04 table A10), or five (3.05 table A10).

use super::record::RecordFields;
use crate::format::records::ReadError;
use crate::time::SECONDS_PER_WEEK;
use crate::{GlonassEphemeris, GpsTime};
use nalgebra::Vector3;

/// Lines of a record at most.
const LINES: usize = 5;
/// Channels that were ever in use (RINEX 3.05 table A10).
const CHANNELS: std::ops::RangeInclusive<f64> = -7.0..=13.0;
/// `l_n` among the health flags of the fifth line, and where it is kept.
const LN_FLAG: u32 = 1;
const LN_HEALTH: u8 = 8;

/// The ephemeris of a record.
pub fn ephemeris(r: &RecordFields) -> Result<GlonassEphemeris, ReadError> {
    r.count(LINES)?;
    // Epochs are in UTC, positions in km.
    let (year, month, day, hour, minute, second) = r.epoch()?.calendar();
    let tb = GpsTime::from_utc(year, month, day, hour, minute, second);
    let three = |column: usize, names: [&str; 3], max: f64| -> Result<Vector3<f64>, ReadError> {
        let axis = |k: usize| r.within(4 * (k + 1) + column, names[k], -max, max);
        Ok(Vector3::new(axis(0)?, axis(1)?, axis(2)?) * 1e3)
    };
    let position_m = three(0, ["X", "Y", "Z"], 3e4)?;
    if !(2.4e7..2.7e7).contains(&position_m.norm()) {
        let radius_km = position_m.norm() / 1e3;
        let problem = format!("{} is {radius_km:.0} km from the Earth's centre", r.sv);
        return Err(r.malformed(1, problem, "GLONASS is at 25 500 km"));
    }
    let flags = r.field(19)?.filter(|flags| (0.0..8.0).contains(flags)).unwrap_or(0.0) as u32;
    let is_ln = flags & LN_FLAG != 0;
    // Seconds of the week, or from some writers of the day, in UTC; of unknown time a large number.
    let sent = r.field(3)?.filter(|tow| (0.0..SECONDS_PER_WEEK as f64).contains(tow));
    let utc_tb = tb - f64::from(tb.leap_seconds());
    Ok(GlonassEphemeris {
        sv: r.sv,
        tb,
        sent: sent.map(|tow| utc_tb.nearest_with_tow(tow) + f64::from(tb.leap_seconds())),
        clock_bias_s: r.within(1, "-tau", -0.1, 0.1)?,
        clock_drift_sps: r.within(2, "gamma", -1e-6, 1e-6)?,
        position_m,
        velocity_mps: three(1, ["velocity X", "velocity Y", "velocity Z"], 10.0)?,
        acceleration_mps2: three(2, ["acceleration X", "acceleration Y", "acceleration Z"], 1e-7)?,
        health: r.within(7, "health", 0.0, 7.0)? as u8 | if is_ln { LN_HEALTH } else { 0 },
        channel: r.field(11)?.filter(|channel| CHANNELS.contains(channel)).map(|v| v as i8),
        age_days: r.field(15)?.map_or(0, |days| days.clamp(0.0, 31.0) as u8),
    })
}
