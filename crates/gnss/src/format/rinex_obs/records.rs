//! The records of a RINEX observation file: epochs, their satellites, and events between them.

use super::ObservationReader;
use super::header::Signals;
use crate::format::records::Line;
use crate::observation::{CodeRange, Observation, typical_noise};
use crate::{Constellation, GpsTime, ReadError, Sv, signal};
use std::io::BufRead;

/// Fields on a line of version 2.
const FIELDS_PER_LINE: usize = 5;
/// Satellites on the first line of an epoch of version 2, and on each that continues it.
const NAMES_PER_LINE: usize = 12;
/// C/N0 that is accepted, dB-Hz: files in other units lie outside.
const BELIEVED_DBHZ: std::ops::Range<f64> = 5.0..75.0;

/// An epoch, with what `take` made of each satellite's record.
pub(super) struct Epoch<T> {
    pub receive_time: GpsTime,
    /// Power failed since the epoch before.
    pub power_failed: bool,
    pub satellites: Vec<T>,
}

/// The next epoch, none at the end of the file. `take` converts a satellite's fields, given by
/// their indices; none if they hold nothing of interest.
pub(super) fn next_epoch<R: BufRead, T>(
    reader: &mut ObservationReader<R>,
    take: impl for<'a> Fn(Sv, &Signals, &dyn Fn(usize) -> Field<'a>) -> Result<Option<T>, ReadError>,
) -> Result<Option<Epoch<T>>, ReadError> {
    loop {
        if !reader.source.advance()? {
            return Ok(None);
        }
        let line = reader.source.line();
        if line.text.is_empty() {
            continue;
        }
        let modern = reader.signals.version >= 3.0;
        if modern && !line.text.starts_with('>') {
            let problem = format!("'{}' starts no epoch", line.columns(0, 20));
            return Err(line.malformed(problem, "an epoch starts with '>'"));
        }
        let (flag, count) = if modern { (31, 32) } else { (28, 29) };
        let flag: u8 = match line.columns(flag, 1) {
            "" => 0,
            _ => line.integer(flag, 1)?,
        };
        let count: usize = line.integer(count, 3)?;
        match flag {
            0 | 1 => {
                let epoch = if modern { line.epoch(2, 4, 11)? } else { line.epoch(1, 2, 11)? };
                let receive_time = reader.signals.gps_time(epoch);
                let satellites = satellites(reader, count, &take)?;
                return Ok(Some(Epoch { receive_time, power_failed: flag == 1, satellites }));
            }
            // Events: so many lines of the header follow, comments among them.
            2..=5 => {
                for _ in 0..count {
                    reader.source.step()?;
                    reader.signals.take(&reader.source.line())?;
                }
                reader.signals.resolve();
            }
            // Cycle slips, in the form of observations: they are no measurements.
            6 => drop(satellites(reader, count, &take)?),
            other => {
                let problem = format!("the epoch flag {other} is not known");
                return Err(line.malformed(problem, "flags are 0 to 6"));
            }
        }
    }
}

/// The `count` satellites of an epoch whose first line the source is at, those that are read.
fn satellites<R: BufRead, T>(
    reader: &mut ObservationReader<R>,
    count: usize,
    take: &impl for<'a> Fn(Sv, &Signals, &dyn Fn(usize) -> Field<'a>) -> Result<Option<T>, ReadError>,
) -> Result<Vec<T>, ReadError> {
    let ObservationReader { source, signals, skipped, .. } = reader;
    let mut taken = Vec::with_capacity(count);
    let mut add = |satellite: Option<T>| match satellite {
        Some(satellite) => taken.push(satellite),
        None => *skipped += 1,
    };
    if signals.version >= 3.0 {
        for _ in 0..count {
            source.expect("the satellites of the epoch")?;
            let line = source.line();
            if line.text.starts_with('>') {
                let right = format!("{count} satellites follow their epoch");
                return Err(line.malformed("an epoch starts before the last one ended", right));
            }
            let name = line.columns(0, 3).to_owned();
            let field = |k: usize| Field { line, start: 3 + 16 * k };
            let sv = known(&name, &line, signals.system)?;
            add(sv.map(|sv| take(sv, signals, &field)).transpose()?.flatten());
        }
        return Ok(taken);
    }
    let mut names: Vec<(String, usize)> = Vec::with_capacity(count);
    loop {
        let line = source.line();
        let here = (count - names.len()).min(NAMES_PER_LINE);
        names.extend((0..here).map(|k| (line.columns(32 + 3 * k, 3).to_owned(), line.number)));
        if names.len() == count {
            break;
        }
        source.expect("further satellites of the epoch")?;
    }
    let count = signals.gps.count.div_ceil(FIELDS_PER_LINE);
    for (name, number) in names {
        let mut lines = Vec::with_capacity(count);
        for _ in 0..count {
            source.expect("the observations of the epoch")?;
            lines.push((source.text.clone(), source.number));
        }
        let at = Line { format: "RINEX", file: &source.name, number, text: "" };
        let field = |k: usize| {
            let (text, number) = &lines[k / FIELDS_PER_LINE];
            let line = Line { text, number: *number, ..at };
            Field { line, start: 16 * (k % FIELDS_PER_LINE) }
        };
        let sv = known(&name, &at, signals.system)?;
        add(sv.map(|sv| take(sv, signals, &field)).transpose()?.flatten());
    }
    Ok(taken)
}

/// The satellite that a name such as `G07`, `G 7` or `7` means, none of a system that is skipped.
fn known(name: &str, line: &Line, system: char) -> Result<Option<Sv>, ReadError> {
    let letter = name.chars().next().filter(char::is_ascii_alphabetic);
    let number = name.trim_start_matches(|c: char| c.is_ascii_alphabetic()).trim();
    let letter = letter.unwrap_or(system).to_ascii_uppercase();
    let sv = match (letter, number.parse::<u8>()) {
        ('R' | 'S' | 'E' | 'C' | 'I' | 'T', Ok(_)) => return Ok(None),
        ('G' | 'J', Ok(number)) => format!("{letter}{number:02}").parse().ok(),
        _ => None,
    };
    sv.map(Some).ok_or_else(|| {
        let right = "a satellite such as G07 stands there";
        line.malformed(format!("'{name}' names no satellite"), right)
    })
}

/// One field of a record: value of 14 columns, loss of lock, signal strength.
pub(super) struct Field<'a> {
    line: Line<'a>,
    start: usize,
}

impl Field<'_> {
    /// The value; blank and zero mean that it is missing.
    pub fn value(&self) -> Result<Option<f64>, ReadError> {
        Ok(self.line.real(self.start, 14)?.filter(|v| *v != 0.0))
    }

    /// Bit 0 of the loss-of-lock indicator.
    fn lost_lock(&self) -> bool {
        self.line.columns(self.start + 14, 1).parse().is_ok_and(|flags: u8| flags & 1 == 1)
    }

    /// Signal strength, 1 to 9.
    fn strength(&self) -> Option<u8> {
        self.line.columns(self.start + 15, 1).parse().ok().filter(|s| (1..=9).contains(s))
    }
}

/// The observation of a satellite; none if it has neither code nor Doppler.
pub(super) fn observation<'a>(
    sv: Sv,
    signals: &Signals,
    field: &dyn Fn(usize) -> Field<'a>,
) -> Result<Option<Observation>, ReadError> {
    let qzss = sv.constellation() == Constellation::Qzss;
    let fields = if qzss { &signals.qzss } else { &signals.gps };
    let value = |k: Option<usize>| k.map_or(Ok(None), |k| field(k).value());
    let mut code = None;
    for &k in &fields.code {
        code = code.or(field(k).value()?.filter(|range| *range > 0.0));
    }
    let doppler = value(fields.doppler)?;
    let phase = value(fields.phase)?;
    if code.is_none() && doppler.is_none() {
        return Ok(None);
    }
    let class = || {
        let strength =
            fields.code.iter().chain(&fields.phase).find_map(|&k| field(k).strength())?;
        // Class n is n x 6 to n x 6 + 5 dB-Hz (RINEX 3.04 section 5.7).
        Some(f64::from(strength) * 6.0 + 3.0)
    };
    let stated = value(fields.strength)?.filter(|v| BELIEVED_DBHZ.contains(v));
    let cn0_dbhz = stated.or_else(class);
    let (range_sigma_m, doppler_sigma_hz) = typical_noise(cn0_dbhz);
    Ok(Some(Observation {
        transmission: signal::of(sv),
        range: code.map(CodeRange::Pseudorange),
        range_sigma_m,
        doppler_hz: doppler,
        doppler_sigma_hz,
        carrier_phase_cycles: phase,
        lost_lock: fields.phase.is_some_and(|k| field(k).lost_lock()),
        cn0_dbhz,
    }))
}
