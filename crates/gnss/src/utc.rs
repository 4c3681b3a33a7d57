//! System time against UTC.

use crate::GpsTime;

/// Parameters that relate GPS time to UTC (IS-GPS-200N 20.3.3.5.1.6), or Galileo System Time (Galileo OS SIS ICD 2.1,
/// 5.1.7).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UtcParameters {
    /// Constant term, s.
    pub a0: f64,
    /// First-order term, s/s.
    pub a1: f64,
    /// Reference time.
    pub tot: GpsTime,
    /// Leap seconds now, s.
    pub delta_t_ls: i32,
    /// Leap seconds after the next (or last) change, s.
    pub delta_t_lsf: i32,
    /// Full week number of that change.
    pub wn_lsf: i32,
    /// Day of that week, 1 (Sunday) to 7.
    pub day: u8,
}

impl UtcParameters {
    /// Adds the leap second that they announce to the table by which times are written in UTC.
    pub fn announce(&self) {
        if self.delta_t_lsf == self.delta_t_ls + 1 {
            let after = GpsTime::from_week_tow(self.wn_lsf, f64::from(self.day) * 86_400.0);
            after.announce_leap_second(self.delta_t_lsf);
        }
    }
}
