//! NMEA 0183 sentences: RMC, GGA, GST, GSA and GSV for every fix.

use super::{Run, SatelliteInView, satellites_in_view};
use crate::gnss::coordinates::Geodetic;
use crate::gnss::{Constellation, GpsTime, Sv};
use crate::position::Fix;
use std::fmt::Write;

/// Metres per second in a knot.
const KNOT: f64 = 1852.0 / 3600.0;

/// The fixes of a run as NMEA 0183 (2.3 with GPS only, talker GP; 4.11 with several systems, talker GN).
///
/// Height: no geoid model is used, so GGA gives the height above the WGS 84 ellipsoid and a geoid
/// separation of 0.0; a reader that adds the two gets the ellipsoidal height back.
///
/// A position that is not proved has status V and mode E in RMC, and quality 6 (estimated) in GGA.
pub fn nmea(run: &Run) -> String {
    let mut text = String::new();
    for fix in run.fixes {
        let one = Run { fixes: std::slice::from_ref(fix), epochs: until(run, fix), ..run.clone() };
        sentences(&mut text, fix, &satellites_in_view(&one));
    }
    text
}

/// The epochs up to a fix.
fn until<'a>(run: &Run<'a>, fix: &Fix) -> &'a [crate::gnss::observation::ObservationEpoch] {
    let count = run.epochs.partition_point(|e| e.sample <= fix.sample);
    &run.epochs[..count]
}

fn sentences(text: &mut String, fix: &Fix, in_view: &[SatelliteInView]) {
    let systems: Vec<Constellation> =
        [Constellation::Gps, Constellation::Sbas, Constellation::Qzss]
            .into_iter()
            .filter(|c| in_view.iter().any(|s| s.sv.constellation() == *c))
            .collect();
    let mixed = systems.contains(&Constellation::Qzss);
    let talker = if mixed { "GN" } else { "GP" };
    let position = Geodetic::from_ecef(&fix.position_m);
    let latitude = angle(position.latitude, 2, ['N', 'S']);
    let longitude = angle(position.longitude, 3, ['E', 'W']);
    let (date, time) = date_time(fix.time);

    let (mut speed, mut course) = (String::new(), String::new());
    if let Some(v) = fix.velocity_mps {
        let enu = position.ecef_to_enu() * v;
        speed = format!("{:.3}", enu.xy().norm() / KNOT);
        let hundredths = (enu.x.atan2(enu.y).to_degrees() * 100.0).round();
        course = format!("{:.2}", hundredths.rem_euclid(36_000.0) / 100.0);
    }
    let (status, mode, quality) = match fix.integrity.is_proved() {
        true => ('A', 'A', 1),
        // A warning, and an estimate.
        false => ('V', 'E', 6),
    };
    push(
        text,
        &format!(
            "{talker}RMC,{time},{status},{latitude},{longitude},{speed},{course},{date},,,{mode}"
        ),
    );
    let used = fix.residuals.len().min(12);
    let (hdop, height) = (fix.hdop, position.height);
    push(
        text,
        &format!(
            "{talker}GGA,{time},{latitude},{longitude},{quality},{used:02},{hdop:.2},{height:.3},M,0.0,M,,"
        ),
    );
    push(text, &format!("{talker}GST,{time},{}", error_statistics(fix)));
    for &group in if mixed { &systems[..] } else { &[Constellation::Gps][..] } {
        let mut sentence = format!("{talker}GSA,A,3");
        let member = |sv: Sv| !mixed || sv.constellation() == group;
        let mut satellites = fix.residuals.iter().map(|r| r.sv).filter(|&sv| member(sv));
        for _ in 0..12 {
            let id =
                satellites.next().map_or(String::new(), |sv| format!("{:02}", satellite_id(sv)));
            let _ = write!(sentence, ",{id}");
        }
        let _ = write!(sentence, ",{:.2},{:.2},{:.2}", fix.pdop, fix.hdop, fix.vdop);
        if mixed {
            let _ = write!(sentence, ",{}", if group == Constellation::Qzss { 5 } else { 1 });
        }
        push(text, &sentence);
    }
    for (talker, qzss) in [("GP", false), ("GQ", true)] {
        let view: Vec<_> = in_view
            .iter()
            .filter(|s| (s.sv.constellation() == Constellation::Qzss) == qzss)
            .collect();
        let total = view.chunks(4).len();
        for (k, four) in view.chunks(4).enumerate() {
            let mut sentence = format!("{talker}GSV,{total},{},{:02}", k + 1, view.len());
            for s in four {
                let strength = s.cn0_dbhz.map_or(String::new(), |c| format!("{c:02.0}"));
                let azimuth = s.azimuth.to_degrees().round().rem_euclid(360.0);
                let elevation = s.elevation.to_degrees();
                let id = satellite_id(s.sv);
                let _ = write!(sentence, ",{id:02},{elevation:02.0},{azimuth:03.0},{strength}");
            }
            push(text, &sentence);
        }
    }
}

/// Fields of GST after the time: rms of the pseudoranges' residuals, m; standard deviations of the horizontal error
/// ellipse, m, and the direction of its major axis, degrees from north; of latitude, longitude and height, m.
fn error_statistics(fix: &Fix) -> String {
    let ranges: Vec<f64> = fix.residuals.iter().filter_map(|r| r.range_m).collect();
    let mean_square = ranges.iter().map(|r| r * r).sum::<f64>() / ranges.len() as f64;
    let rms = match ranges.is_empty() {
        true => String::new(),
        false => format!("{:.2}", mean_square.sqrt()),
    };
    let covariance = fix.covariance;
    let ellipse = covariance.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
    let (major, minor) = (ellipse.eigenvalues.max(), ellipse.eigenvalues.min());
    let axis = ellipse.eigenvectors.column(ellipse.eigenvalues.imax());
    let direction = axis[0].atan2(axis[1]).to_degrees().rem_euclid(180.0);
    let sigma = |variance: f64| variance.max(0.0).sqrt();
    let [east, north, up] = [0, 1, 2].map(|k| sigma(covariance[(k, k)]));
    let (major, minor) = (sigma(major), sigma(minor));
    format!("{rms},{major:.2},{minor:.2},{direction:.1},{north:.2},{east:.2},{up:.2}")
}

/// Adds `$`, the checksum (exclusive or of all characters between) and CR LF.
fn push(text: &mut String, sentence: &str) {
    let checksum = sentence.bytes().fold(0, |sum, byte| sum ^ byte);
    let _ = write!(text, "${sentence}*{checksum:02X}\r\n");
}

/// NMEA's satellite number: GPS 1-32, SBAS PRN - 87 (33-51), QZSS its PRN.
fn satellite_id(sv: Sv) -> u8 {
    if sv.constellation() == Constellation::Sbas { sv.prn() - 87 } else { sv.prn() }
}

/// Degrees and minutes to 1e-6 (2 mm), and the hemisphere.
fn angle(rad: f64, degree_digits: usize, [positive, negative]: [char; 2]) -> String {
    let micro_minutes = (rad.to_degrees().abs() * 60e6).round() as u64;
    let (degrees, rest) = (micro_minutes / 60_000_000, micro_minutes % 60_000_000);
    let hemisphere = if rad < 0.0 { negative } else { positive };
    let (minutes, millionths) = (rest / 1_000_000, rest % 1_000_000);
    format!("{degrees:0degree_digits$}{minutes:02}.{millionths:06},{hemisphere}")
}

/// UTC as (ddmmyy, hhmmss.sss).
fn date_time(t: GpsTime) -> (String, String) {
    let (year, month, day, hour, minute, second) = (t + 0.0005).utc_calendar();
    let milliseconds = ((second.fract() * 1e3).floor() as u32).min(999);
    let date = format!("{day:02}{month:02}{:02}", year.rem_euclid(100));
    (date, format!("{hour:02}{minute:02}{:02}.{milliseconds:03}", second.floor() as u32))
}
