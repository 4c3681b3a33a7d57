//! RINEX 3.04 navigation file (RINEX 3.04 tables A5 to A14).

use crate::galileo_data::GalileoStatus;
use crate::orbit::broadcast::{NO_ACCURACY, ura_index, ura_metres};
use crate::{Constellation, Ephemeris, GlonassEphemeris, GpsTime, NavigationData, Sv};
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

/// The navigation data of all systems as a RINEX 3.04 file.
pub fn write(data: &NavigationData) -> String {
    let is_mixed = data.satellites().any(|sv| sv.constellation() != Constellation::Gps);
    let system = if is_mixed { "M: MIXED" } else { "G: GPS" };
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
    data.iter().for_each(|eph| keplerian(&mut text, eph, data.galileo.status.get(&eph.sv)));
    data.glonass().for_each(|eph| glonass(&mut text, eph));
    text
}

/// The fields of a record of four each line, the first line without its epoch; what is not known stays blank.
fn record(text: &mut String, sv: Sv, epoch: GpsTime, fields: &[&[Option<f64>]]) {
    let (year, month, day, hour, minute, second) = epoch.calendar();
    // Reference times are multiples of 16 s, or of 60 s: whole seconds lose nothing.
    let _ = write!(text, "{sv} {year:04} {month:02} {day:02} {hour:02} {minute:02} {second:02.0}");
    for (k, line) in fields.iter().enumerate() {
        text.push_str(if k == 0 { "" } else { "\n    " });
        for value in *line {
            *text += &value.map_or(format!("{:19}", ""), |value| exponent(value, 12, 19));
        }
        text.truncate(text.trim_end_matches(' ').len());
    }
    text.push('\n');
}

/// A record of LNAV, I/NAV, D1 or D2 (tables A6, A8, A12, A14).
fn keplerian(text: &mut String, eph: &Ephemeris, status: Option<&GalileoStatus>) {
    let model = eph.sv.constellation().model();
    // Epochs, weeks and seconds are those of the system's time.
    let [toc, toe] = [eph.toc, eph.toe].map(|t| t - model.behind_gps_s);
    // Times of transmission count from the week of toe.
    let start_of_week = GpsTime::from_week_tow(toe.week(), 0.0);
    let sent = eph.transmission_time.map_or(0.9999e9, |t| t - model.behind_gps_s - start_of_week);
    let week = Some(f64::from(toe.week() - model.first_week));
    let (tgd, issue) = (Some(eph.tgd), Some(f64::from(eph.iode)));
    let lnav_fit = |flag: bool| match (eph.sv.constellation(), flag) {
        (Constellation::Gps, false) => 4.0,
        (Constellation::Gps, true) => 6.0,
        (_, flag) => f64::from(u8::from(flag)),
    };
    let ura = || Some(nominal_ura(eph.ura_index));
    let iodc = Some(f64::from(eph.iodc));
    let health = Some(f64::from(eph.health));
    let (issue, spare, accuracy, last) = match eph.sv.constellation() {
        Constellation::Galileo => (
            iodc,
            [Some(SOURCE_INAV_E1B), week, None],
            [
                Some(sisa(eph, status)),
                Some(galileo_health(eph, status)),
                status.map(|s| s.bgd_e1_e5a),
                tgd,
            ],
            None,
        ),
        // The group delay of B2I is not kept.
        Constellation::BeiDou => (issue, [None, week, None], [ura(), health, tgd, None], iodc),
        _ => (
            issue,
            [Some(eph.l2_codes.into()), week, Some(f64::from(u8::from(eph.l2_p_data)))],
            [ura(), health, tgd, iodc],
            Some(lnav_fit(eph.fit_interval_flag)),
        ),
    };
    let known = |values: [f64; 4]| values.map(Some);
    let fields: [&[Option<f64>]; 8] = [
        &[eph.af0, eph.af1, eph.af2].map(Some),
        &[issue, Some(eph.crs), Some(eph.delta_n), Some(eph.m0)],
        &known([eph.cuc, eph.e, eph.cus, eph.sqrt_a]),
        &known([toe.tow(), eph.cic, eph.omega0, eph.cis]),
        &known([eph.i0, eph.crc, eph.omega, eph.omega_dot]),
        &[Some(eph.idot), spare[0], spare[1], spare[2]],
        &accuracy,
        &[Some(sent), last],
    ];
    record(text, eph.sv, toc, &fields);
}

/// Data source of Galileo: I/NAV on E1-B, whose clock is that of E5b and E1 (table A8, bits 0 and 9).
const SOURCE_INAV_E1B: f64 = 513.0;

/// SISA, m: as sent, where that is known and belongs to the ephemeris; else the bound of its index, -1 where there is none.
fn sisa(eph: &Ephemeris, status: Option<&GalileoStatus>) -> f64 {
    let sent = status.and_then(|s| s.sisa_m).filter(|&m| ura_index(m) == eph.ura_index);
    match eph.ura_index {
        NO_ACCURACY.. => -1.0,
        index => sent.unwrap_or(ura_metres(index)),
    }
}

/// Health of the ephemeris in the bits of E1-B, of the status in those of E5b.
fn galileo_health(eph: &Ephemeris, status: Option<&GalileoStatus>) -> f64 {
    let e5b = status.map_or(0, |s| {
        u16::from(s.health.e5b_not_valid) << 6 | u16::from(s.health.e5b_status) << 7
    });
    f64::from(u16::from(eph.health) | e5b)
}

/// A record of GLONASS (table A10), its epoch in UTC, lengths in km; health by the highest bit of B_n, or l_n.
fn glonass(text: &mut String, eph: &GlonassEphemeris) {
    let utc = |t: GpsTime| t - f64::from(t.leap_seconds());
    let tb = utc(eph.tb);
    let sent = eph.sent.map_or(0.9999e9, |t| utc(t) - GpsTime::from_week_tow(tb.week(), 0.0));
    let health = if eph.health < 8 { f64::from(eph.health) } else { 1.0 };
    let extra = [Some(health), eph.channel.map(f64::from), Some(f64::from(eph.age_days))];
    let axis = |k: usize| {
        let [r, v, a] =
            [eph.position_m, eph.velocity_mps, eph.acceleration_mps2].map(|x| x[k] / 1e3);
        [Some(r), Some(v), Some(a), extra[k]]
    };
    let clock = [eph.clock_bias_s, eph.clock_drift_sps, sent].map(Some);
    record(text, eph.sv, tb, &[&clock, &axis(0), &axis(1), &axis(2)]);
}

/// Nominal user range accuracy of an index, m (IS-GPS-200N 20.3.3.3.1.3), as RINEX files print it.
fn nominal_ura(index: u8) -> f64 {
    match index {
        0..=6 => (2f64.powf(1.0 + f64::from(index) / 2.0) * 10.0).round() / 10.0,
        _ => 2f64.powi(i32::from(index) - 2),
    }
}
