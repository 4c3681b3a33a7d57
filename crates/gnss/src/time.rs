//! GPS system time.

use std::fmt;
use std::ops::{Add, Sub};
use std::str::FromStr;
use std::sync::atomic::{AtomicI64, Ordering};

/// Seconds in a GPS week.
pub const SECONDS_PER_WEEK: i64 = 604_800;

/// GPS epoch (1980-01-06) as days since 1970-01-01.
const GPS_EPOCH_DAYS: i64 = 3657;

/// Days (since 1970-01-01) from whose midnight UTC each leap second counts, 1981 to 2017 (IERS Bulletin C).
const LEAP_SECOND_DAYS: [i64; 18] = [
    4199, 4564, 4929, 5660, 6574, 7305, 7670, 8217, 8582, 8947, 9496, 10043, 10592, 13149, 14245,
    15522, 16617, 17167,
];

/// GPS time, s, from whose next second on an announced leap second after those of the table counts; 0 while none is
/// announced. What satellites announce is a fact of the world, as the table is.
static ANNOUNCED_S: AtomicI64 = AtomicI64::new(0);

/// An instant of GPS system time: whole seconds since 1980-01-06T00:00:00 and a fraction.
///
/// The fraction keeps a resolution of 1e-16 s (30 nm of range) at any date, which neither a time of
/// week in one `f64` (35 mm) nor integer nanoseconds (300 mm) would.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct GpsTime {
    seconds: i64,
    fraction: f64,
}

impl GpsTime {
    /// From the full (not modulo 1024) week number and the time of week in s (any finite value).
    pub fn from_week_tow(week: i32, tow_s: f64) -> Self {
        Self { seconds: i64::from(week) * SECONDS_PER_WEEK, fraction: 0.0 } + tow_s
    }

    /// From a calendar date and time of day already in GPS time (as in RINEX files): no leap seconds.
    pub fn from_calendar(
        year: i32,
        month: u32,
        day: u32,
        hour: u32,
        minute: u32,
        second: f64,
    ) -> Self {
        let days = days_from_civil(year, month, day) - GPS_EPOCH_DAYS;
        let seconds = days * 86_400 + i64::from(hour) * 3600 + i64::from(minute) * 60;
        Self { seconds, fraction: 0.0 } + second
    }

    /// From a calendar date and time of day in UTC; leap seconds are added from the built-in table.
    pub fn from_utc(year: i32, month: u32, day: u32, hour: u32, minute: u32, second: f64) -> Self {
        let leap = LEAP_SECOND_DAYS.partition_point(|&d| d <= days_from_civil(year, month, day));
        Self::from_calendar(year, month, day, hour, minute, second) + leap as f64
    }

    /// From a day of UTC, counted from 1970-01-01, and seconds after its midnight, of any number.
    fn from_utc_day(day: i64, second: f64) -> Self {
        let day = day + (second / 86_400.0).floor() as i64;
        let (year, month, date) = civil_from_days(day);
        Self::from_utc(year, month, date, 0, 0, second.rem_euclid(86_400.0))
    }

    /// Full week number since 1980-01-06.
    pub fn week(self) -> i32 {
        self.seconds.div_euclid(SECONDS_PER_WEEK) as i32
    }

    /// Time of week, s, in [0, 604800).
    pub fn tow(self) -> f64 {
        self.seconds.rem_euclid(SECONDS_PER_WEEK) as f64 + self.fraction
    }

    /// The instant nearest this one whose time of week is `tow_s` (modulo a week): for a reference
    /// time sent without its week.
    pub fn nearest_with_tow(self, tow_s: f64) -> Self {
        let same_week = Self::from_week_tow(self.week(), tow_s);
        let week = SECONDS_PER_WEEK as f64;
        same_week + ((self - same_week) / week).round() * week
    }

    /// Whole seconds since the GPS epoch, and the fraction of a second in [0, 1).
    pub fn parts(self) -> (i64, f64) {
        (self.seconds, self.fraction)
    }

    /// Leap seconds, as the GPS seconds that are 23:59:60.
    fn inserted_s() -> impl Iterator<Item = i64> {
        let table = LEAP_SECOND_DAYS.iter().enumerate();
        let announced = Some(ANNOUNCED_S.load(Ordering::Relaxed)).filter(|&s| s > 0);
        table.map(|(i, d)| (d - GPS_EPOCH_DAYS) * 86_400 + i as i64).chain(announced)
    }

    /// GPS minus UTC at this instant, s: 18 since 2017, where the table ends, or what satellites announced since.
    pub fn leap_seconds(self) -> i32 {
        Self::inserted_s().filter(|&s| self.seconds > s).count() as i32
    }

    /// Announces that UTC loses a second at the end of the day that ends at this instant (in UTC), and is `seconds`
    /// behind GPS time from then on. What the table knows, or does not lead to, is ignored.
    pub(crate) fn announce_leap_second(self, seconds: i32) {
        let known = LEAP_SECOND_DAYS.len() as i64;
        let last = LEAP_SECOND_DAYS.last().map_or(0, |d| (d - GPS_EPOCH_DAYS) * 86_400);
        if i64::from(seconds) == known + 1 && self.seconds > last {
            ANNOUNCED_S.store(self.seconds + known, Ordering::Relaxed);
        }
    }

    /// Calendar (year, month, day, hour, minute, second) in GPS time, as RINEX files print it.
    pub fn calendar(self) -> (i32, u32, u32, u32, u32, f64) {
        let (year, month, day) = civil_from_days(self.seconds.div_euclid(86_400) + GPS_EPOCH_DAYS);
        let s = self.seconds.rem_euclid(86_400);
        (year, month, day, (s / 3600) as u32, (s / 60 % 60) as u32, (s % 60) as f64 + self.fraction)
    }

    /// Calendar (year, month, day, hour, minute, second) in UTC. A leap second is second 60.
    pub fn utc_calendar(self) -> (i32, u32, u32, u32, u32, f64) {
        let leap = f64::from(self.leap_seconds());
        if Self::inserted_s().any(|s| s == self.seconds) {
            let (year, month, day, hour, minute, second) = (self - leap - 1.0).calendar();
            return (year, month, day, hour, minute, second + 1.0);
        }
        (self - leap).calendar()
    }

    /// UTC in ISO 8601 with milliseconds, such as `2022-01-01T01:59:42.000Z`.
    pub fn utc_iso(self) -> String {
        let rounded = self + 0.0005;
        let (y, mo, d, h, mi, s) = rounded.utc_calendar();
        let ms = ((s.fract() * 1000.0).floor() as u32).min(999);
        format!("{y:04}-{mo:02}-{d:02}T{h:02}:{mi:02}:{:02}.{ms:03}Z", s.floor() as u32)
    }

    /// Day of year, 1 to 366, in GPS time.
    pub fn day_of_year(self) -> u32 {
        let (year, ..) = self.calendar();
        let days = self.seconds.div_euclid(86_400) + GPS_EPOCH_DAYS;
        (days - days_from_civil(year, 1, 1) + 1) as u32
    }
}

/// Seconds added; exact to 1e-16 s for small steps.
impl Add<f64> for GpsTime {
    type Output = Self;
    fn add(self, dt_s: f64) -> Self {
        let whole = dt_s.floor();
        let fraction = self.fraction + (dt_s - whole);
        let carry = fraction.floor();
        Self { seconds: self.seconds + whole as i64 + carry as i64, fraction: fraction - carry }
    }
}

impl Sub<f64> for GpsTime {
    type Output = Self;
    fn sub(self, dt_s: f64) -> Self {
        self + -dt_s
    }
}

/// Difference in s.
impl Sub for GpsTime {
    type Output = f64;
    fn sub(self, other: Self) -> f64 {
        (self.seconds - other.seconds) as f64 + (self.fraction - other.fraction)
    }
}

impl fmt::Display for GpsTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GPS week {} tow {:.3}", self.week(), self.tow())
    }
}

/// Why a text is not a time.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error(
    "'{0}' is no time: write UTC as 2021-12-02T08:47:00Z, or GPS time as week:tow such as 2190:525600"
)]
pub struct ParseTimeError(String);

/// UTC as `2021-12-02T08:47:00[.5][Z]`, or GPS time as `week:tow`.
impl FromStr for GpsTime {
    type Err = ParseTimeError;
    fn from_str(text: &str) -> Result<Self, ParseTimeError> {
        let fail = || ParseTimeError(text.to_owned());
        if let Some((week, tow)) = text.split_once(':').filter(|_| !text.contains(['T', '-'])) {
            let week: i32 = week.parse().map_err(|_| fail())?;
            let tow: f64 = tow.parse().map_err(|_| fail())?;
            let in_range =
                (0..10_000).contains(&week) && (0.0..SECONDS_PER_WEEK as f64).contains(&tow);
            return if in_range { Ok(Self::from_week_tow(week, tow)) } else { Err(fail()) };
        }
        if let Some(since_1970_s) = text.parse().ok().filter(|s| UNIX_TIMES_S.contains(s)) {
            return Ok(Self::from_utc_day(0, since_1970_s));
        }
        let (date, time) = text.trim_end_matches('Z').split_once(['T', ' ']).ok_or_else(fail)?;
        // An offset of local time from UTC, as in 09:30:00+01:00.
        let (time, ahead_s) = match time.rfind(['+', '-']) {
            None => (time, 0.0),
            Some(at) => {
                let (hours, minutes) = time[at + 1..].split_once(':').ok_or_else(fail)?;
                let hours: u32 = hours.parse().map_err(|_| fail())?;
                let minutes: u32 = minutes.parse().map_err(|_| fail())?;
                if hours > 14 || minutes > 59 {
                    return Err(fail());
                }
                let sign = if time.as_bytes()[at] == b'+' { 1.0 } else { -1.0 };
                (&time[..at], sign * f64::from(3600 * hours + 60 * minutes))
            }
        };
        let date: Vec<u32> =
            date.split('-').map(str::parse).collect::<Result<_, _>>().map_err(|_| fail())?;
        let clock: Vec<&str> = time.split(':').collect();
        let (&[year, month, day], &[hour, minute, ref rest @ ..]) = (&date[..], &clock[..]) else {
            return Err(fail());
        };
        let hour: u32 = hour.parse().map_err(|_| fail())?;
        let minute: u32 = minute.parse().map_err(|_| fail())?;
        let second: f64 = match rest {
            [] => 0.0,
            [s] => s.parse().map_err(|_| fail())?,
            _ => return Err(fail()),
        };
        let known_day = (1980..2200).contains(&year)
            && (1..=12).contains(&month)
            && civil_from_days(days_from_civil(year as i32, month, day))
                == (year as i32, month, day);
        if !known_day || hour > 23 || minute > 59 || !(0.0..61.0).contains(&second) {
            return Err(fail());
        }
        if ahead_s == 0.0 {
            return Ok(Self::from_utc(year as i32, month, day, hour, minute, second));
        }
        let of_day = f64::from(3600 * hour + 60 * minute) + second - ahead_s;
        Ok(Self::from_utc_day(days_from_civil(year as i32, month, day), of_day))
    }
}

/// Seconds since 1970 that are taken for a time: of 1980 to 2200.
const UNIX_TIMES_S: std::ops::Range<f64> = 315_964_800.0..7_258_118_400.0;

/// Days since 1970-01-01 of a proleptic Gregorian date.
fn days_from_civil(year: i32, month: u32, day: u32) -> i64 {
    let y = i64::from(year) - i64::from(month <= 2);
    let era = y.div_euclid(400);
    let year_of_era = y.rem_euclid(400);
    let day_of_year = (153 * ((i64::from(month) + 9) % 12) + 2) / 5 + i64::from(day) - 1;
    era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468
}

/// The Gregorian date of a day count since 1970-01-01.
fn civil_from_days(days: i64) -> (i32, u32, u32) {
    let z = days + 719_468;
    let era = z.div_euclid(146_097);
    let day_of_era = z.rem_euclid(146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_shifted = (5 * day_of_year + 2) / 153;
    let day = (day_of_year - (153 * month_shifted + 2) / 5 + 1) as u32;
    let month = ((month_shifted + 2) % 12 + 1) as u32;
    ((year_of_era + era * 400 + i64::from(month <= 2)) as i32, month, day)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_instants() {
        // First sample of a published simulator run: 2022-01-01T02:00:00 GPS time.
        let t = GpsTime::from_calendar(2022, 1, 1, 2, 0, 0.0);
        assert_eq!((t.week(), t.tow()), (2190, 525_600.0));
        assert_eq!(t.leap_seconds(), 18);
        assert_eq!(t.utc_iso(), "2022-01-01T01:59:42.000Z");
        assert_eq!("2022-01-01T01:59:42Z".parse(), Ok(t));
        assert_eq!("2190:525600".parse(), Ok(t));
        assert_eq!(t.day_of_year(), 1);
        assert_eq!(GpsTime::from_utc(1980, 1, 6, 0, 0, 0.0).parts(), (0, 0.0));
    }

    /// IERS: each since 1981 at the start of a January or July.
    #[test]
    fn leap_seconds_count_from_the_days_of_the_iers() {
        let (january, july) = (1, 7);
        let days = [
            (1981, july),
            (1982, july),
            (1983, july),
            (1985, july),
            (1988, january),
            (1990, january),
            (1991, january),
            (1992, july),
            (1993, july),
            (1994, july),
            (1996, january),
            (1997, july),
            (1999, january),
            (2006, january),
            (2009, january),
            (2012, july),
            (2015, july),
            (2017, january),
        ];
        assert_eq!(LEAP_SECOND_DAYS, days.map(|(year, month)| days_from_civil(year, month, 1)));
    }

    #[test]
    fn wrong_times_are_refused() {
        for text in [
            "",
            "noon",
            "2021-02-30T00:00:00Z",
            "2021-12-02",
            "2190:700000",
            "2021-12-02T25:00:00Z",
        ] {
            assert!(text.parse::<GpsTime>().is_err(), "{text}");
        }
    }

    #[test]
    fn offsets_from_utc_and_seconds_since_1970_are_times() {
        let time: GpsTime = "2017-01-01T00:30:00Z".parse().unwrap();
        // 1 483 230 600 by `date -u -d 2017-01-01T00:30:00 +%s`.
        for text in [
            "2017-01-01T01:30:00+01:00",
            "2016-12-31T18:45:00.000000-05:45",
            "2017-01-01T00:30:00+00:00",
            "1483230600",
            "1483230600.0",
        ] {
            assert_eq!(text.parse::<GpsTime>(), Ok(time), "{text}");
        }
        for text in ["2017-01-01T01:30:00+1", "2017-01-01T01:30:00+99:00", "12345"] {
            assert!(text.parse::<GpsTime>().is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn leap_seconds_and_calendar_agree_with_hifitime(s in 0i64..1_900_000_000, f in 0.0f64..1.0) {
            let ours = GpsTime { seconds: s, fraction: f };
            let theirs = hifitime::Epoch::from_gpst_seconds(s as f64);
            let (y, mo, d, h, mi, se, _) = theirs.to_gregorian_utc();
            // Inside a leap second itself calendars differ by choice; 18 such seconds exist.
            prop_assume!(se < 60);
            // hifitime counts a leap second some seconds early: 1997-06-30T23:59:30 UTC is 23:59:29 there.
            prop_assume!(ours.leap_seconds() == (ours + 60.0).leap_seconds());
            let utc = GpsTime { seconds: s, fraction: 0.0 }.utc_calendar();
            prop_assert_eq!(utc, (y, mo.into(), d.into(), h.into(), mi.into(), f64::from(se)));
            prop_assert_eq!(GpsTime::from_utc(utc.0, utc.1, utc.2, utc.3, utc.4, utc.5).seconds, s);
            prop_assert!(((ours + 1e5) - ours - 1e5).abs() < 1e-10);
        }
    }
}
