//! RINEX 3.04 navigation file (RINEX 3.04 tables A5, A6 and A8).

use crate::{Constellation, Ephemeris, NavigationData, Sv};
use std::fmt::Write;

/// A header line: contents in columns 1 to 60, label in 61 to 80.
pub(crate) fn header_line(contents: &str, label: &str) -> String {
    format!("{contents:<60}{label:<20}\n")
}

/// Program, with blank run-by and date: the same results give the same bytes.
pub(crate) fn program_line() -> String {
    let program = concat!("sdr-rx ", env!("CARGO_PKG_VERSION"));
    header_line(&format!("{program:<40}"), "PGM / RUN BY / DATE")
}

/// Fortran's exponent form, `digits` after the point, in `width` columns: `-1.774230040610E-04`.
fn exponent(value: f64, digits: usize, width: usize) -> String {
    let text = format!("{value:.digits$e}");
    let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
    let power: i32 = power.parse().unwrap_or(0);
    let sign = if power < 0 { '-' } else { '+' };
    format!("{:>width$}", format!("{mantissa}E{sign}{:02}", power.abs()))
}

/// The navigation data of GPS, QZSS and Galileo (I/NAV of E1-B) as a RINEX 3.04 file.
pub fn write(data: &NavigationData) -> String {
    let sent = |sv: Sv| {
        use Constellation::{Galileo, Gps, Qzss};
        matches!(sv.constellation(), Gps | Qzss | Galileo)
    };
    let mixed = data.satellites().any(|sv| sent(sv) && sv.constellation() != Constellation::Gps);
    let system = if mixed { "M: MIXED" } else { "G: GPS" };
    let kind = format!("{:>9.2}{:11}{:20}{system}", 3.04, "", "N: GNSS NAV DATA");
    let mut text = header_line(&kind, "RINEX VERSION / TYPE") + &program_line();
    if let Some(model) = data.ionosphere {
        for (name, values) in [("GPSA", model.alpha), ("GPSB", model.beta)] {
            let values: String = values.iter().map(|&v| exponent(v, 4, 12)).collect();
            text += &header_line(&format!("{name} {values}"), "IONOSPHERIC CORR");
        }
    }
    if let Some(offset) = data.galileo.gps_offset {
        let (a0, a1) = (exponent(offset.a0, 10, 17), exponent(offset.a1, 9, 16));
        let (tot, week) = (offset.t0.tow(), offset.t0.week());
        text += &header_line(&format!("GPGA {a0}{a1} {tot:6.0} {week:4}"), "TIME SYSTEM CORR");
    }
    if let Some(utc) = data.utc {
        let (a0, a1) = (exponent(utc.a0, 10, 17), exponent(utc.a1, 9, 16));
        let (tot, week) = (utc.tot.tow(), utc.tot.week());
        text += &header_line(&format!("GPUT {a0}{a1} {tot:6.0} {week:4}"), "TIME SYSTEM CORR");
        let leap =
            format!("{:6}{:6}{:6}{:6}", utc.delta_t_ls, utc.delta_t_lsf, utc.wn_lsf, utc.day);
        text += &header_line(&leap, "LEAP SECONDS");
    }
    text += &header_line("", "END OF HEADER");
    data.iter().filter(|eph| sent(eph.sv)).for_each(|eph| record(&mut text, eph, data));
    text
}

/// Data source of a Galileo record: I/NAV of E1-B, clock of E1 and E5b.
const INAV_E1B: f64 = 513.0;

fn record(text: &mut String, eph: &Ephemeris, data: &NavigationData) {
    let (year, month, day, hour, minute, second) = eph.toc.calendar();
    // Clock reference times are multiples of 16 s: whole seconds lose nothing.
    let _ = write!(
        text,
        "{} {year:04} {month:02} {day:02} {hour:02} {minute:02} {second:02.0}",
        eph.sv
    );
    let start_of_week = crate::GpsTime::from_week_tow(eph.toe.week(), 0.0);
    let sent = eph.transmission_time.map_or(0.9999e9, |t| t - start_of_week);
    let fit = match (eph.sv.constellation(), eph.fit_interval_flag) {
        (Constellation::Gps, false) => 4.0,
        (Constellation::Gps, true) => 6.0,
        (_, flag) => f64::from(u8::from(flag)),
    };
    let mut values = [
        [eph.iode.into(), eph.crs, eph.delta_n, eph.m0],
        [eph.cuc, eph.e, eph.cus, eph.sqrt_a],
        [eph.toe.tow(), eph.cic, eph.omega0, eph.cis],
        [eph.i0, eph.crc, eph.omega, eph.omega_dot],
        [eph.idot, eph.l2_codes.into(), eph.toe.week().into(), f64::from(u8::from(eph.l2_p_data))],
        [nominal_ura(eph.ura_index), eph.health.into(), eph.tgd, eph.iodc.into()],
    ];
    if eph.sv.constellation() == Constellation::Galileo {
        let status = data.galileo.status.get(&eph.sv);
        values[0][0] = eph.iodc.into();
        values[4] = [eph.idot, INAV_E1B, eph.toe.week().into(), 0.0];
        // -1: no accuracy is stated.
        let sisa_m = status.map_or(Some(nominal_ura(eph.ura_index)), |s| s.sisa_m).unwrap_or(-1.0);
        let bgd_e1_e5a = status.map_or(eph.tgd, |s| s.bgd_e1_e5a);
        values[5] = [sisa_m, eph.health.into(), bgd_e1_e5a, eph.tgd];
    }
    for value in [eph.af0, eph.af1, eph.af2] {
        *text += &exponent(value, 12, 19);
    }
    for row in values.iter().map(|row| &row[..]).chain([&[sent, fit][..]]) {
        *text += "\n    ";
        row.iter().for_each(|&value| *text += &exponent(value, 12, 19));
    }
    text.push('\n');
}

/// Nominal user range accuracy of an index, m (IS-GPS-200N 20.3.3.3.1.3), as RINEX files print it.
fn nominal_ura(index: u8) -> f64 {
    match index {
        0..=6 => (2f64.powf(1.0 + f64::from(index) / 2.0) * 10.0).round() / 10.0,
        _ => 2f64.powi(i32::from(index) - 2),
    }
}
