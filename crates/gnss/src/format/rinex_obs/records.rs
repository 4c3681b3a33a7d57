//! The records of a RINEX observation file: epochs, their satellites, and events between them.

use super::ObservationReader;
use super::header::{self, Fields, Signals};
use crate::format::records::Line;
use crate::observation::{CodeRange, Observation, typical_noise};
use crate::{GpsTime, ReadError, Sv, Transmission};
use std::collections::BTreeMap;
use std::io::BufRead;

/// Fields on a line of version 2.
const FIELDS_PER_LINE: usize = 5;
/// Satellites on the first line of an epoch of version 2, and on each that continues it.
const NAMES_PER_LINE: usize = 12;
/// C/N0 that is accepted, dB-Hz: files in other units lie outside.
const BELIEVED_DBHZ: std::ops::Range<f64> = 5.0..75.0;

/// What is left out where an epoch is malformed.
const EPOCHS_LEFT_OUT: &str = "epochs left out";

/// An epoch, with what `take` made of each satellite's record.
pub(super) struct Epoch<T> {
    pub receive_time: GpsTime,
    /// Power failed since the epoch before.
    pub power_failed: bool,
    pub satellites: Vec<T>,
}

/// What converts a satellite's fields, given by their indices; none if they hold nothing of interest.
pub(super) trait Take<T>:
    for<'a> Fn(Sv, &Signals, &dyn Fn(usize) -> Field<'a>) -> Result<Option<T>, ReadError>
{
}

impl<T, F> Take<T> for F where
    F: for<'a> Fn(Sv, &Signals, &dyn Fn(usize) -> Field<'a>) -> Result<Option<T>, ReadError>
{
}

/// The first line of an epoch or event.
struct Start {
    flag: u8,
    /// Satellites, or lines, that follow.
    count: usize,
    receive_time: GpsTime,
}

impl Start {
    fn of(line: &Line, signals: &Signals) -> Result<Self, ReadError> {
        let modern = signals.version >= 3.0;
        if modern && !line.text.starts_with('>') {
            let problem = format!("'{}' starts no epoch", line.columns(0, 20));
            return Err(line.malformed(problem, "an epoch starts with '>'"));
        }
        let (flag, count) = if modern { (31, 32) } else { (28, 29) };
        let flag: u8 = match line.columns(flag, 1) {
            "" => 0,
            _ => line.integer(flag, 1)?,
        };
        let is_event = (2..=5).contains(&flag);
        let count = match line.columns(count, 3) {
            "" if is_event => 0,
            _ => line.integer(count, 3)?,
        };
        let has_no_date = line.columns(0, 28).trim_start_matches('>').is_empty();
        let receive_time = match flag {
            // Of events a date is not needed; what stands in its place in version 2 makes the line another one.
            2..=6 if modern || has_no_date => GpsTime::from_week_tow(0, 0.0),
            0..=6 if modern => signals.gps_time(line.epoch(2, 4, 11)?),
            0..=6 => signals.gps_time(line.epoch(1, 2, 11)?),
            other => {
                let problem = format!("the epoch flag {other} is not known");
                return Err(line.malformed(problem, "flags are 0 to 6"));
            }
        };
        Ok(Self { flag, count, receive_time })
    }
}

/// The next epoch, none at the end of the file.
pub(super) fn next_epoch<R: BufRead, T>(
    reader: &mut ObservationReader<R>,
    take: impl Take<T>,
) -> Result<Option<Epoch<T>>, ReadError> {
    // Whether what does not start an epoch is told already.
    let mut is_lost = false;
    loop {
        if !reader.source.advance()? {
            return Ok(None);
        }
        if reader.source.text.is_empty() {
            continue;
        }
        if reader.source.is_header() {
            if !next_file(reader)? {
                return Ok(None);
            }
            continue;
        }
        let start = match Start::of(&reader.source.line(), &reader.signals) {
            Ok(start) => start,
            Err(error) => {
                if !std::mem::replace(&mut is_lost, true) {
                    reader.leave_out(EPOCHS_LEFT_OUT, error);
                }
                continue;
            }
        };
        is_lost = false;
        match start.flag {
            0 | 1 => {
                let Some(satellites) = satellites(reader, start.count, &take)? else {
                    is_lost = true;
                    continue;
                };
                let (receive_time, power_failed) = (start.receive_time, start.flag == 1);
                return Ok(Some(Epoch { receive_time, power_failed, satellites }));
            }
            // Events: so many lines of the header follow, comments among them.
            2..=5 => {
                for _ in 0..start.count {
                    if !reader.source.step()? {
                        return Ok(None);
                    }
                    if let Err(error) = reader.signals.take(&reader.source.line()) {
                        reader.leave_out("lines of events left out", error);
                    }
                }
                reader.signals.resolve();
            }
            // Cycle slips, in the form of observations: they are no measurements.
            _ => drop(satellites(reader, start.count, &take)?),
        }
    }
}

/// Reads the header at which another file starts. One of no use is left out: with the records of its file, up to the next
/// header (false where there is none), or alone where an epoch follows it.
fn next_file<R: BufRead>(reader: &mut ObservationReader<R>) -> Result<bool, ReadError> {
    reader.source.again = true;
    match header::read(&mut reader.source, &mut reader.left_out) {
        Ok((_, signals)) => reader.signals = signals,
        Err(error @ ReadError::Io { .. }) => return Err(error),
        Err(error) if reader.source.again => reader.leave_out(header::HEADERS_LEFT_OUT, error),
        Err(error) => {
            reader.leave_out("files left out", error);
            while !reader.source.is_header() {
                if !reader.source.advance()? {
                    return Ok(false);
                }
            }
            reader.source.again = true;
        }
    }
    Ok(true)
}

/// The `count` satellites of an epoch whose first line the source is at, those that are read. Where the next epoch starts
/// earlier, or the file ends, there are fewer. None in version 2, whose lines do not name their satellites, where there are
/// fewer or more lines than satellites.
fn satellites<R: BufRead, T>(
    reader: &mut ObservationReader<R>,
    count: usize,
    take: &impl Take<T>,
) -> Result<Option<Vec<T>>, ReadError> {
    if reader.signals.version >= 3.0 {
        modern_satellites(reader, count, take).map(Some)
    } else {
        old_satellites(reader, count, take)
    }
}

impl<R: BufRead> ObservationReader<R> {
    /// Goes to the next line of an epoch; false, with a note, where it has none.
    fn within_epoch(
        &mut self,
        what: &str,
        ends: fn(&Line, &Signals) -> bool,
    ) -> Result<bool, ReadError> {
        let there = self.source.advance()?;
        let line = self.source.line();
        let problem = match there {
            false => "the file ends in the middle of a record",
            true if self.source.is_header() || ends(&line, &self.signals) => {
                "an epoch starts before the last one ended"
            }
            true => return Ok(true),
        };
        let error = line.malformed(problem, format!("{what} follow"));
        self.source.again = there;
        let whole = there && self.signals.version < 3.0;
        self.leave_out(if whole { EPOCHS_LEFT_OUT } else { "epochs cut short" }, error);
        Ok(false)
    }

    /// Goes to the next line, and says whether the epoch of version 3 or 4 ends before it; with a note where its count is
    /// not the number of satellites `found`.
    fn ends_modern_epoch(&mut self, found: usize, count: usize) -> Result<bool, ReadError> {
        let there = self.source.advance()?;
        let line = self.source.line();
        // A '>' without any number starts no epoch.
        let starts = line.text.starts_with('>')
            && (found >= count || line.text.bytes().any(|b| b.is_ascii_digit()));
        if there && !starts && !self.source.is_header() {
            return Ok(false);
        }
        let problem = match there {
            true => format!("{found} satellites where the epoch's count says {count}"),
            false => "the file ends in the middle of a record".to_owned(),
        };
        let error = line.malformed(problem, "as many satellites as the epoch's count says follow");
        if found != count {
            self.leave_out("epochs miscounted", error);
        }
        self.source.again = there;
        Ok(true)
    }

    /// Whether no line of observations follows those of an epoch of version 2; else with a note.
    fn is_epoch_over(&mut self) -> Result<bool, ReadError> {
        self.source.again = self.source.advance()?;
        let line = self.source.line();
        // The point and three decimals of a field.
        let is_field = |start: usize| {
            let end = line.columns(start + 10, 4);
            end.len() == 4 && end.starts_with('.') && end[1..].bytes().all(|b| b.is_ascii_digit())
        };
        if !(self.source.again && (0..FIELDS_PER_LINE).any(|k| is_field(16 * k))) {
            return Ok(true);
        }
        let right = "an epoch has as many as its satellites and types need";
        let error = line.malformed("a line of observations of no satellite", right);
        self.leave_out(EPOCHS_LEFT_OUT, error);
        Ok(false)
    }

    /// Adds what `take` makes of a satellite.
    fn add<T>(&mut self, satellite: Result<Option<T>, ReadError>, taken: &mut Vec<T>) {
        match satellite {
            Ok(Some(satellite)) => taken.push(satellite),
            Ok(None) => self.skipped += 1,
            Err(error) => self.leave_out("satellites left out", error),
        }
    }
}

/// The satellites of an epoch of version 3 or 4, whose lines name them: up to the next epoch, whatever its count says.
fn modern_satellites<R: BufRead, T>(
    reader: &mut ObservationReader<R>,
    count: usize,
    take: &impl Take<T>,
) -> Result<Vec<T>, ReadError> {
    let mut taken: Vec<(Sv, T)> = Vec::new();
    let mut lines: BTreeMap<String, String> = BTreeMap::new();
    let mut found = 0;
    while !reader.ends_modern_epoch(found, count)? {
        let line = reader.source.line();
        if line.text.is_empty() {
            continue;
        }
        found += 1;
        let name = line.columns(0, 3);
        let Some(before) = lines.insert(name.to_owned(), line.text.to_owned()) else {
            let satellite = modern_satellite(reader, take);
            reader.add(satellite, &mut taken);
            continue;
        };
        if before != line.text {
            // Neither is known to be right.
            taken.retain(|(sv, _)| sv.to_string() != name);
        }
        let right = "an epoch has a satellite once";
        let error = line.malformed(format!("{name} comes twice"), right);
        reader.leave_out("satellites left out", error);
    }
    Ok(taken.into_iter().map(|satellite| satellite.1).collect())
}

/// What `take` makes of the satellite of this line.
fn modern_satellite<R: BufRead, T>(
    reader: &ObservationReader<R>,
    take: &impl Take<T>,
) -> Result<Option<(Sv, T)>, ReadError> {
    let (line, is_cut) = (reader.source.line(), reader.source.is_cut);
    let name = line.columns(0, 3);
    let system = name.chars().next().unwrap_or(' ').to_ascii_uppercase();
    let signals = &reader.signals;
    let field = |k: usize| {
        let factor = signals.factor(system, k);
        Field { line, start: 3 + 16 * k, factor, is_cut }
    };
    let Some(sv) = known(name, &line, signals.system)? else { return Ok(None) };
    Ok(take(sv, signals, &field)?.map(|taken| (sv, taken)))
}

fn old_satellites<R: BufRead, T>(
    reader: &mut ObservationReader<R>,
    count: usize,
    take: &impl Take<T>,
) -> Result<Option<Vec<T>>, ReadError> {
    let mut names: Vec<(String, usize)> = Vec::new();
    loop {
        let line = reader.source.line();
        let here = (count - names.len()).min(NAMES_PER_LINE);
        names.extend((0..here).map(|k| (line.columns(32 + 3 * k, 3).to_owned(), line.number)));
        if names.len() == count {
            break;
        }
        if !reader.within_epoch("further satellites of the epoch", |_, _| false)? {
            break;
        }
    }
    let mut taken = Vec::new();
    let lines_each = reader.signals.old_count().div_ceil(FIELDS_PER_LINE);
    for (name, number) in names {
        let mut lines = Vec::with_capacity(lines_each);
        for _ in 0..lines_each {
            let starts = |line: &Line, signals: &Signals| Start::of(line, signals).is_ok();
            if !reader.within_epoch("the observations of the epoch", starts)? {
                // A file that ends within a line was cut there; else any line may be lost.
                return Ok(reader.source.was_cut.then_some(taken));
            }
            let source = &reader.source;
            lines.push((source.text.clone(), source.number, source.is_cut));
        }
        let signals = &reader.signals;
        let at = Line { format: "RINEX", file: &reader.source.name, number, text: "" };
        let field = |k: usize| {
            let (text, number, is_cut) = &lines[k / FIELDS_PER_LINE];
            let line = Line { text, number: *number, ..at };
            Field { line, start: 16 * (k % FIELDS_PER_LINE), factor: 1.0, is_cut: *is_cut }
        };
        let sv = known(&name, &at, signals.system);
        let satellite = sv.and_then(|sv| sv.map_or(Ok(None), |sv| take(sv, signals, &field)));
        reader.add(satellite, &mut taken);
    }
    Ok(reader.is_epoch_over()?.then_some(taken))
}

/// The satellite that a name such as `G07`, `G 7` or `7` means, none of a system that is skipped.
fn known(name: &str, line: &Line, system: char) -> Result<Option<Sv>, ReadError> {
    let letter = name.chars().next().filter(char::is_ascii_alphabetic);
    let number = name.trim_start_matches(|c: char| c.is_ascii_alphabetic()).trim();
    let letter = letter.unwrap_or(system).to_ascii_uppercase();
    let sv = match (letter, number.parse::<u8>()) {
        ('S' | 'I' | 'T', Ok(_)) => return Ok(None),
        ('G' | 'J' | 'R' | 'E' | 'C', Ok(number)) => format!("{letter}{number:02}").parse().ok(),
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
    /// What the stored value was multiplied by.
    factor: f64,
    /// Whether the file ends within the line.
    is_cut: bool,
}

impl Field<'_> {
    /// The value; blank and zero mean that it is missing, and where the file ends within it it is not known.
    pub fn value(&self) -> Result<Option<f64>, ReadError> {
        if self.is_cut && self.line.text.len() < self.start + 14 {
            return Ok(None);
        }
        let value = self.line.real(self.start, 14)?.filter(|v| *v != 0.0);
        Ok(value.map(|v| v / self.factor))
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

/// The observations of a satellite, one of each signal that has code or Doppler; none if none has.
pub(super) fn observations<'a>(
    sv: Sv,
    signals: &Signals,
    field: &dyn Fn(usize) -> Field<'a>,
) -> Result<Option<Vec<Observation>>, ReadError> {
    let of_signal = |fields: &Fields| observation(sv, fields, field).transpose();
    let list: Vec<Observation> = signals.of(sv).filter_map(of_signal).collect::<Result<_, _>>()?;
    Ok((!list.is_empty()).then_some(list))
}

/// The observation of one of its signals.
fn observation<'a>(
    sv: Sv,
    fields: &Fields,
    field: &dyn Fn(usize) -> Field<'a>,
) -> Result<Option<Observation>, ReadError> {
    let value = |k: Option<usize>| k.map_or(Ok(None), |k| field(k).value());
    let mut code = None;
    for &k in &fields.code {
        code = code.or(field(k).value()?);
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
        transmission: Transmission { sv, signal: fields.signal },
        range: code.map(CodeRange::Pseudorange),
        range_sigma_m,
        doppler_hz: doppler,
        doppler_sigma_hz,
        carrier_phase_cycles: phase,
        lost_lock: fields.phase.is_some_and(|k| field(k).lost_lock()),
        cn0_dbhz,
    }))
}
