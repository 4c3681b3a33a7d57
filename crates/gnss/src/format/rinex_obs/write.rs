//! RINEX 3.04 observation file (RINEX 3.04 tables A2 and A3): code, phase, Doppler and strength of each signal,
//! C1C L1C D1C S1C of L1 C/A.

use crate::format::rinex_nav::write::{header_line, program_line};
use crate::observation::{Observation, ObservationEpoch};
use crate::{Constellation, GpsTime, Signal, Transmission};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Observations as a file, `position_m` (ECEF) as its approximate position, what that is as a comment (of at most 60
/// characters). Doppler is positive when the
/// satellite approaches, the carrier phase grows with the pseudorange, and code ranges known only modulo a code
/// period are left out (blank). Times and
/// ranges are by the receiver's clock; no offset is applied.
pub fn write(epochs: &[ObservationEpoch], position_m: Vector3<f64>, comment: &str) -> String {
    let signals = signals(epochs);
    let mut text = header(epochs, position_m, comment, &signals);
    for epoch in epochs {
        let (year, month, day, hour, minute, second) = tenth_microsecond(epoch.receive_time);
        let of_satellites = || epoch.observations.chunk_by(|a, b| a.sv() == b.sv());
        let count = of_satellites().count();
        let _ = writeln!(
            text,
            "> {year:04} {month:02} {day:02} {hour:02} {minute:02}{second:11.7}  0{count:3}"
        );
        for observations in of_satellites() {
            text += &line(observations, &signals);
        }
    }
    text
}

/// The signals observed, by system.
fn signals(epochs: &[ObservationEpoch]) -> BTreeMap<Constellation, BTreeSet<&'static Signal>> {
    let mut signals: BTreeMap<_, BTreeSet<_>> = BTreeMap::new();
    for Transmission { signal, .. } in
        epochs.iter().flat_map(|e| &e.observations).map(|o| o.transmission)
    {
        signals.entry(signal.constellation).or_default().insert(signal);
    }
    signals
}

/// File name by RINEX 3's rule, such as `SDRX00XXX_S_20220010200_45S_01S_MO.rnx`: start, duration and
/// interval of the observations.
pub fn file_name(first: GpsTime, last: GpsTime, epochs: usize) -> String {
    let (year, _, _, hour, minute, _) = first.calendar();
    let day = first.day_of_year();
    let interval = interval_s(first, last, epochs).unwrap_or(0.0);
    let (duration, spacing) = (period(last - first + interval), period(interval));
    format!("SDRX00XXX_S_{year:04}{day:03}{hour:02}{minute:02}_{duration}_{spacing}_MO.rnx")
}

/// Whether a name is one that [`file_name`] gives.
pub fn is_file_name(name: &str) -> bool {
    name.starts_with("SDRX00XXX_S_") && name.ends_with("_MO.rnx")
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

fn header(
    epochs: &[ObservationEpoch],
    position_m: Vector3<f64>,
    comment: &str,
    signals: &BTreeMap<Constellation, BTreeSet<&Signal>>,
) -> String {
    let gps_only = signals.keys().eq([&Constellation::Gps]);
    let system = if gps_only { "G: GPS" } else { "M: MIXED" };
    let kind = format!("{:>9.2}{:11}{:20}{system}", 3.04, "", "OBSERVATION DATA");
    let [x, y, z]: [f64; 3] = position_m.into();
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
        (comment.to_owned(), "COMMENT"),
        (format!("{x:14.4}{y:14.4}{z:14.4}"), "APPROX POSITION XYZ"),
        (format!("{0:14.4}{0:14.4}{0:14.4}", 0.0), "ANTENNA: DELTA H/E/N"),
    ];
    for (system, signals) in signals {
        let mut types = format!("{}  {:3}", system.letter(), FIELDS * signals.len());
        for signal in signals {
            let _ = write!(types, " C{0} L{0} D{0} S{0}", signal.rinex);
        }
        lines.push((types, "SYS / # / OBS TYPES"));
    }
    lines.push(("DBHZ".to_owned(), "SIGNAL STRENGTH UNIT"));
    if let (Some(first), Some(last)) = (epochs.first(), epochs.last()) {
        let (first, last) = (first.receive_time, last.receive_time);
        if let Some(interval) = interval_s(first, last, epochs.len()) {
            lines.push((format!("{interval:10.3}"), "INTERVAL"));
        }
        let (year, month, day, hour, minute, second) = tenth_microsecond(first);
        let time = format!("{year:6}{month:6}{day:6}{hour:6}{minute:6}{second:13.7}     GPS");
        lines.push((time, "TIME OF FIRST OBS"));
        for signal in signals.values().flatten() {
            let shifted = format!("{} L{}", signal.constellation.letter(), signal.rinex);
            lines.push((shifted, "SYS / PHASE SHIFT"));
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

/// Fields of a signal.
const FIELDS: usize = 4;

/// The line of a satellite: its signals in the order of the header.
fn line(
    observations: &[Observation],
    signals: &BTreeMap<Constellation, BTreeSet<&Signal>>,
) -> String {
    let sv = observations[0].sv();
    let mut text = sv.to_string();
    for signal in signals.get(&sv.constellation()).into_iter().flatten() {
        match observations.iter().find(|o| o.transmission.signal == *signal) {
            Some(observation) => fields(observation, &mut text),
            None => text += &" ".repeat(16 * FIELDS),
        }
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    text
}

fn fields(o: &Observation, text: &mut String) {
    let lli = if o.lost_lock { '1' } else { ' ' };
    // Signal strength 1 to 9: 6 dB-Hz a step (RINEX 3.04 section 5.7).
    let class = |cn0: f64| ((cn0 / 6.0).floor().clamp(1.0, 9.0) as u8).to_string();
    let strength = o.cn0_dbhz.map_or(" ".to_owned(), class);
    let fields: [_; FIELDS] = [
        (o.pseudorange_m(), ' '),
        (o.carrier_phase_cycles, lli),
        (o.doppler_hz, ' '),
        (o.cn0_dbhz, ' '),
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
}

#[cfg(test)]
mod tests {
    use super::super::ObservationReader;
    use super::*;
    use crate::observation::{CodeRange, typical_noise};
    use crate::{Sv, signal};
    use proptest::collection::{btree_map, vec};
    use proptest::prelude::*;

    /// Observations as a file can hold them: 1e-3 of each unit, Dopplers other than zero.
    fn observation() -> impl Strategy<Value = Observation> {
        let range = proptest::option::of(18_000_000_000i64..42_000_000_000);
        let phase = proptest::option::of(1i64..999_999_999_999);
        (range, phase, 1i64..9_999_999, any::<bool>(), any::<bool>(), 10_000i64..60_000).prop_map(
            |(range, phase, doppler, sign, lost, cn0)| {
                let milli = |v: i64| v as f64 / 1e3;
                let cn0_dbhz = milli(cn0);
                let (range_sigma_m, doppler_sigma_hz) = typical_noise(Some(cn0_dbhz));
                Observation {
                    transmission: signal::of(Sv::all_gps().next().unwrap()),
                    range: range.map(milli).map(CodeRange::Pseudorange),
                    range_sigma_m,
                    doppler_hz: Some(if sign { milli(doppler) } else { -milli(doppler) }),
                    doppler_sigma_hz,
                    carrier_phase_cycles: phase.map(milli),
                    lost_lock: lost && phase.is_some(),
                    cn0_dbhz: Some(cn0_dbhz),
                }
            },
        )
    }

    fn epochs() -> impl Strategy<Value = Vec<ObservationEpoch>> {
        let sv = (1u8..=39).prop_map(|n| Sv::from_prn(if n > 32 { n + 160 } else { n }).unwrap());
        let epoch = (1i64..9_999_999, btree_map(sv, observation(), 1..20));
        vec(epoch, 1..6).prop_map(|list| {
            let start = GpsTime::from_calendar(2023, 12, 31, 23, 59, 30.0);
            let mut time = start;
            list.into_iter()
                .map(|(wait, satellites)| {
                    // Printed to 1e-7 s.
                    time = time + wait as f64 * 1e-7;
                    let observations = satellites
                        .into_iter()
                        .map(|(sv, o)| Observation { transmission: signal::of(sv), ..o });
                    let observations = observations.collect();
                    ObservationEpoch { receive_time: time, sample: time - start, observations }
                })
                .collect()
        })
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(epochs in epochs()) {
            let text = write(&epochs, Vector3::zeros(), "");
            let reader = ObservationReader::new(text.as_bytes(), "x").unwrap();
            let read: Vec<ObservationEpoch> = reader.collect::<Result<_, _>>().unwrap();
            prop_assert_eq!(read.len(), epochs.len());
            for (a, b) in epochs.iter().zip(&read) {
                // Half of the last digit of the time, and the rounding of decimal fractions.
                prop_assert!((a.receive_time - b.receive_time).abs() < 0.51e-7);
                prop_assert_eq!(a.observations.len(), b.observations.len());
                for (a, b) in a.observations.iter().zip(&b.observations) {
                    prop_assert_eq!((a.sv(), a.range), (b.sv(), b.range));
                    prop_assert_eq!((a.doppler_hz, a.cn0_dbhz), (b.doppler_hz, b.cn0_dbhz));
                    prop_assert_eq!(a.carrier_phase_cycles, b.carrier_phase_cycles);
                    prop_assert_eq!(a.lost_lock, b.lost_lock);
                    prop_assert_eq!(a.range_sigma_m, b.range_sigma_m);
                }
            }
        }
    }
}
