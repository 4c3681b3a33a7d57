//! RINEX 3.04 observation file (RINEX 3.04 tables A2 and A3): C1C L1C D1C S1C.

use super::rinex_nav::{header_line, program_line};
use super::{Run, Summary};
use crate::gnss::{Constellation, GpsTime};
use crate::observables::{CodeRange, Observation};
use std::fmt::Write;

/// The observations of a run. Doppler is positive when the satellite approaches, the carrier phase grows
/// with the pseudorange, and code ranges known only modulo a code period are left out (blank). Times and
/// ranges are by the receiver's clock; no offset is applied.
pub fn rinex_observations(run: &Run) -> String {
    let mut text = header(run);
    for epoch in run.epochs {
        let (year, month, day, hour, minute, second) = tenth_microsecond(epoch.receive_time);
        let count = epoch.observations.len();
        let _ = writeln!(
            text,
            "> {year:04} {month:02} {day:02} {hour:02} {minute:02}{second:11.7}  0{count:3}"
        );
        for observation in &epoch.observations {
            text += &line(observation);
        }
    }
    text
}

/// File name by RINEX 3's rule, such as `SDRX00XXX_S_20220010200_45S_01S_MO.rnx`: start, duration and
/// interval of the observations.
pub fn observation_file_name(first: GpsTime, last: GpsTime, epochs: usize) -> String {
    let (year, _, _, hour, minute, _) = first.calendar();
    let day = first.day_of_year();
    let interval = interval_s(first, last, epochs).unwrap_or(0.0);
    let (duration, spacing) = (period(last - first + interval), period(interval));
    format!("SDRX00XXX_S_{year:04}{day:03}{hour:02}{minute:02}_{duration}_{spacing}_MO.rnx")
}

/// Two digits and a unit: seconds, minutes or hours; hertz below a second; 00U if unknown.
fn period(seconds: f64) -> String {
    match seconds {
        s if s <= 0.0 => "00U".to_owned(),
        s if s < 0.999 => format!("{:02.0}Z", (1.0 / s).min(99.0)),
        s if s < 99.5 => format!("{s:02.0}S"),
        s if s < 99.5 * 60.0 => format!("{:02.0}M", s / 60.0),
        s => format!("{:02.0}H", (s / 3600.0).min(99.0)),
    }
}

/// Mean spacing of the epochs, s, to a millisecond; none for a single one.
fn interval_s(first: GpsTime, last: GpsTime, epochs: usize) -> Option<f64> {
    let gaps = epochs.checked_sub(1).filter(|&n| n > 0)?;
    Some(((last - first) / gaps as f64 * 1e3).round() / 1e3)
}

/// Calendar rounded to the 0.1 us that the format prints, so that no second is printed as 60.
fn tenth_microsecond(t: GpsTime) -> (i32, u32, u32, u32, u32, f64) {
    let (whole, fraction) = t.parts();
    let ticks = (fraction * 1e7).round();
    (GpsTime::from_week_tow(0, whole as f64) + ticks / 1e7).calendar()
}

fn header(run: &Run) -> String {
    let systems: Vec<char> =
        [(Constellation::Gps, 'G'), (Constellation::Qzss, 'J'), (Constellation::Sbas, 'S')]
            .into_iter()
            .filter(|(c, _)| {
                run.epochs.iter().flat_map(|e| &e.observations).any(|o| o.sv.constellation() == *c)
            })
            .map(|(_, letter)| letter)
            .collect();
    let system = if systems == ['G'] { "G: GPS" } else { "M: MIXED" };
    let kind = format!("{:>9.2}{:11}{:20}{system}", 3.04, "", "OBSERVATION DATA");
    let position =
        Summary::new(run.fixes, run.input.rate_hz()).map_or([0.0; 3], |s| s.median_m.into());
    let [x, y, z] = position;
    let mut lines = vec![
        (kind, "RINEX VERSION / TYPE"),
        (String::new(), "PGM / RUN BY / DATE"),
        ("SDRX".to_owned(), "MARKER NAME"),
        ("NON_GEODETIC".to_owned(), "MARKER TYPE"),
        (String::new(), "OBSERVER / AGENCY"),
        (
            format!("{:20}{:20}{:20}", "", "SDR-RX", env!("CARGO_PKG_VERSION")),
            "REC # / TYPE / VERS",
        ),
        (String::new(), "ANT # / TYPE"),
        (format!("{x:14.4}{y:14.4}{z:14.4}"), "APPROX POSITION XYZ"),
        (format!("{0:14.4}{0:14.4}{0:14.4}", 0.0), "ANTENNA: DELTA H/E/N"),
    ];
    for letter in &systems {
        lines.push((format!("{letter}    4 C1C L1C D1C S1C"), "SYS / # / OBS TYPES"));
    }
    lines.push(("DBHZ".to_owned(), "SIGNAL STRENGTH UNIT"));
    if let (Some(first), Some(last)) = (run.epochs.first(), run.epochs.last()) {
        let (first, last) = (first.receive_time, last.receive_time);
        if let Some(interval) = interval_s(first, last, run.epochs.len()) {
            lines.push((format!("{interval:10.3}"), "INTERVAL"));
        }
        let (year, month, day, hour, minute, second) = tenth_microsecond(first);
        let time = format!("{year:6}{month:6}{day:6}{hour:6}{minute:6}{second:13.7}     GPS");
        lines.push((time, "TIME OF FIRST OBS"));
        for letter in &systems {
            lines.push((format!("{letter} L1C"), "SYS / PHASE SHIFT"));
        }
        lines.push((format!("{:6}", first.leap_seconds()), "LEAP SECONDS"));
    }
    lines.push((String::new(), "END OF HEADER"));
    let print = |(contents, label): &(String, &str)| match *label {
        "PGM / RUN BY / DATE" => program_line(),
        label => header_line(contents, label),
    };
    lines.iter().map(print).collect()
}

fn line(o: &Observation) -> String {
    let code = match o.range {
        CodeRange::Pseudorange(metres) => Some(metres),
        CodeRange::ModuloCodePeriod(_) => None,
    };
    let lli = if o.lost_lock { '1' } else { ' ' };
    // Signal strength 1 to 9: 6 dB-Hz a step (RINEX 3.04 section 5.7).
    let strength = match o.cn0_dbhz {
        cn0 if cn0.is_finite() => ((cn0 / 6.0).floor().clamp(1.0, 9.0) as u8).to_string(),
        _ => " ".to_owned(),
    };
    let mut text = o.sv.to_string();
    let fields = [
        (code, ' '),
        (o.carrier_phase_cycles, lli),
        (Some(o.doppler_hz), ' '),
        (Some(o.cn0_dbhz), ' '),
    ];
    for (k, (value, flag)) in fields.into_iter().enumerate() {
        // What does not fit its 14 columns is left out, as the format has it for missing values.
        let value = value.filter(|v| v.is_finite());
        let number = value.map(|v| format!("{v:14.3}")).filter(|n| n.len() == 14);
        let _ = match number {
            Some(number) if k == 1 => write!(text, "{number}{flag}{strength}"),
            Some(number) => write!(text, "{number}  "),
            None => write!(text, "{:16}", ""),
        };
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    text
}
