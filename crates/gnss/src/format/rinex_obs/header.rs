//! The header of a RINEX observation file, and the fields of a satellite's signals in its records.

use super::Source;
use super::signals;
use crate::format::records::{LeftOut, Line};
use crate::signal::Signal;
use crate::{Constellation, GpsTime, ReadError, Sv};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::io::BufRead;

/// Contents of the header of an observation file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObservationHeader {
    /// The format's version, such as 3.04.
    pub version: f64,
    /// Name of the station, empty if none is given.
    pub marker: String,
    /// Approximate position of the marker, m, ECEF, where one is given (not zeros).
    pub approximate_position_m: Option<Vector3<f64>>,
    /// Antenna above (up), east and north of the marker, m.
    pub antenna_uen_m: Vector3<f64>,
    /// Time between epochs, s, where it is given.
    pub interval_s: Option<f64>,
    /// Frequency channels of satellites of GLONASS.
    pub glonass_channels: BTreeMap<Sv, i8>,
}

/// Fields of a signal in a satellite's record, by their index in it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fields {
    pub signal: &'static Signal,
    /// Codes, the preferred first.
    pub code: Vec<usize>,
    pub phase: Option<usize>,
    pub doppler: Option<usize>,
    pub strength: Option<usize>,
}

/// Fields of the signals, and time system.
#[derive(Clone, Debug)]
pub(super) struct Signals {
    pub version: f64,
    /// System of satellites without a letter (version 2).
    pub system: char,
    /// Of version 2, one for all systems; else by system letter.
    names: Vec<(char, usize, Vec<String>)>,
    /// Factors that stored values were multiplied by, by system letter, for the types named, or all.
    factors: Vec<(char, f64, Vec<String>)>,
    /// By system letter.
    fields: Vec<(char, Fields)>,
    time_system: TimeSystem,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum TimeSystem {
    Gps,
    Utc,
    BeiDou,
}

/// Reads up to END OF HEADER. Of a header that is cut by another the other is read. Where one ends at an epoch, with
/// or without what everything needs, the source stays at it (`again`).
pub(super) fn read<R: BufRead>(
    source: &mut Source<R>,
    left_out: &mut LeftOut,
) -> Result<(ObservationHeader, Signals), ReadError> {
    loop {
        match read_one(source, left_out) {
            Err(error) if source.again && source.is_header() => {
                left_out.add(HEADERS_LEFT_OUT, &error);
            }
            header => return header,
        }
    }
}

/// What is left out where a header is cut.
pub(super) const HEADERS_LEFT_OUT: &str = "headers left out";

/// What is left out where a line of the header is malformed.
const LINES_LEFT_OUT: &str = "lines of the header left out";
/// What is named where a header is used though it is cut.
const HEADERS_CUT: &str = "headers without an end";

/// Whether a line without the label of a header starts an epoch.
fn starts_epoch(line: &Line, version: f64) -> bool {
    if version >= 3.0 {
        return line.text.starts_with("> ");
    }
    let count = line.integer::<usize>(29, 3);
    line.epoch(1, 2, 11).is_ok() && matches!(line.columns(28, 1), "0" | "1") && count.is_ok()
}

fn read_one<R: BufRead>(
    source: &mut Source<R>,
    left_out: &mut LeftOut,
) -> Result<(ObservationHeader, Signals), ReadError> {
    let mut started = source.advance()?;
    while started && source.text.is_empty() {
        started = source.advance()?;
    }
    let first = source.line();
    if !started || !first.columns(60, 20).eq_ignore_ascii_case("RINEX VERSION / TYPE") {
        let right = "a RINEX file starts with a line that ends in 'RINEX VERSION / TYPE'";
        return Err(first.malformed("this is no RINEX file", right));
    }
    let version = first.real(0, 9)?.unwrap_or(0.0);
    if !(2.0..5.0).contains(&version) {
        let problem = format!("version {version} is not known");
        return Err(first.malformed(problem, "versions 2.10 to 4.99 are read"));
    }
    let kind = first.columns(20, 20);
    if !kind.starts_with(['O', 'o']) {
        let problem = format!("the file holds '{kind}'");
        return Err(first.malformed(problem, "an observation file has O in column 21"));
    }
    let system = first.columns(40, 1).chars().next().unwrap_or('G').to_ascii_uppercase();
    let mut header = ObservationHeader { version, ..ObservationHeader::default() };
    let mut signals = Signals {
        version,
        system: if system == 'M' { 'G' } else { system },
        names: Vec::new(),
        factors: Vec::new(),
        fields: Vec::new(),
        time_system: if system == 'R' { TimeSystem::Utc } else { TimeSystem::Gps },
    };
    loop {
        if !source.advance()? {
            let right = "it ends with 'END OF HEADER'";
            return Err(source.line().malformed("the header does not end", right));
        }
        let line = source.line();
        if line.columns(60, 20).eq_ignore_ascii_case("END OF HEADER") {
            break;
        }
        if source.is_header() {
            let right = "it ends with 'END OF HEADER'";
            let error = line.malformed("a header starts before the last one ended", right);
            source.again = true;
            return Err(error);
        }
        if starts_epoch(&line, version) {
            let right = "'END OF HEADER' stands before it";
            left_out.add(HEADERS_CUT, &line.malformed("an epoch follows the header", right));
            source.again = true;
            break;
        }
        if let Err(error) = take(&mut header, &mut signals, &line) {
            // What types of observations there are must be known, in version 2 for all systems at once.
            if version < 3.0
                && signals.names.iter().all(|names| names.2.is_empty())
                && is_types(&line)
            {
                return Err(error);
            }
            left_out.add(LINES_LEFT_OUT, &error);
        }
    }
    signals.resolve();
    for (system, count, list) in &mut signals.names {
        if list.len() < *count {
            let problem =
                format!("{} types of observations of '{system}', not {count}", list.len());
            left_out.add(LINES_LEFT_OUT, &source.line().malformed(problem, "all types are listed"));
            *count = list.len();
        }
    }
    if signals.names.is_empty() {
        let right = "'# / TYPES OF OBSERV' (version 2) or 'SYS / # / OBS TYPES' lists them";
        return Err(source.line().malformed("the header names no types of observations", right));
    }
    Ok((header, signals))
}

/// Takes a line of the header.
fn take(
    header: &mut ObservationHeader,
    signals: &mut Signals,
    line: &Line,
) -> Result<(), ReadError> {
    match line.columns(60, 20).to_ascii_uppercase().as_str() {
        "MARKER NAME" => header.marker = line.columns(0, 60).to_owned(),
        "APPROX POSITION XYZ" => {
            let position = three(line)?;
            header.approximate_position_m = Some(position).filter(|p| p.norm() > 1.0);
        }
        "ANTENNA: DELTA H/E/N" => header.antenna_uen_m = three(line)?,
        "GLONASS SLOT / FRQ #" => take_channels(&mut header.glonass_channels, line)?,
        "INTERVAL" => header.interval_s = line.real(0, 10)?.filter(|s| *s > 0.0),
        _ => signals.take(line)?,
    }
    Ok(())
}

/// Eight slots of a line with their frequency channels, as in `R01  1 R02 -4`.
fn take_channels(channels: &mut BTreeMap<Sv, i8>, line: &Line) -> Result<(), ReadError> {
    for k in 0..8 {
        let (name, channel) = (line.columns(4 + 7 * k, 3), line.columns(8 + 7 * k, 2));
        let sv = name.replace(' ', "0").parse::<Sv>().ok();
        let sv = sv.filter(|sv| sv.constellation() == Constellation::Glonass);
        match (sv, channel.parse::<i8>()) {
            _ if name.is_empty() && channel.is_empty() => continue,
            (Some(sv), Ok(channel)) if (-7..=13).contains(&channel) => {
                channels.insert(sv, channel);
            }
            _ => {
                let problem = format!("'{name} {channel}' is no slot with its frequency channel");
                return Err(line.malformed(problem, "as in 'R02 -4', channels from -7 to 13"));
            }
        }
    }
    Ok(())
}

/// Three numbers of 14 columns, blanks as zeros; or, of writers that miss the columns, with blanks between.
fn three(line: &Line) -> Result<Vector3<f64>, ReadError> {
    let number = |k: usize| Ok(line.real(14 * k, 14)?.unwrap_or(0.0));
    let columns = number(0).and_then(|x| Ok(Vector3::new(x, number(1)?, number(2)?)));
    let words: Vec<f64> =
        line.columns(0, 60).split_whitespace().map_while(|word| word.parse().ok()).collect();
    match (columns, &words[..]) {
        (Err(_), &[x, y, z]) => Ok(Vector3::new(x, y, z)),
        (columns, _) => columns,
    }
}

fn is_types(line: &Line) -> bool {
    line.columns(60, 20).to_ascii_uppercase().contains("TYPES")
}

/// Whether a name is one of a type of observation: C1 or P2, CA of version 2.12, C1C from version 3 on.
fn is_type(name: &str) -> bool {
    match name.as_bytes() {
        [b'C' | b'P' | b'L' | b'D' | b'S' | b'T' | b'I' | b'X', second] => {
            second.is_ascii_alphanumeric()
        }
        [b'C' | b'L' | b'D' | b'S' | b'I' | b'X', band, code] => {
            band.is_ascii_digit() && code.is_ascii_alphabetic()
        }
        _ => false,
    }
}

/// Labels of lines that say what values mean.
const TYPES: &str = "SYS / # / OBS TYPES";
const OLD_TYPES: &str = "# / TYPES OF OBSERV";
const SCALE_FACTOR: &str = "SYS / SCALE FACTOR";
const TIME_OF_FIRST: &str = "TIME OF FIRST OBS";

/// Whether a label may be one of those, but cut or with tabs for blanks.
fn is_damaged(label: &str) -> bool {
    let plain = label.replace('\t', " ");
    let is = |whole: &&str| *whole != label && whole.starts_with(plain.trim_end());
    [TYPES, OLD_TYPES, SCALE_FACTOR, TIME_OF_FIRST].iter().any(is)
}

impl Signals {
    /// Takes a header line, if it concerns the fields of observations or the time system; such lines
    /// come in event records too.
    pub fn take(&mut self, line: &Line) -> Result<(), ReadError> {
        match line.columns(60, 20).to_ascii_uppercase().as_str() {
            OLD_TYPES if self.version < 3.0 => {
                let names = (0..9).map(|k| line.columns(10 + 6 * k, 2));
                let count = line.columns(0, 6);
                self.list(line, 'G', count, names.map(str::to_owned).collect())
            }
            TYPES if self.version >= 3.0 => {
                let letter = line.columns(0, 1).chars().next();
                let names = (0..13).map(|k| line.columns(7 + 4 * k, 3));
                let system = letter.or(self.names.last().map(|n| n.0)).unwrap_or(' ');
                // A continuation has neither letter nor count.
                let count = if letter.is_some() { line.columns(3, 3) } else { "" };
                self.list(line, system, count, names.map(str::to_owned).collect())
            }
            SCALE_FACTOR => {
                let names = (0..12).map(|k| line.columns(10 + 4 * k, 3).to_owned());
                let names: Vec<String> = names.filter(|name| !name.is_empty()).collect();
                match line.columns(0, 1).chars().next() {
                    Some(system) => {
                        let factor: f64 = line.integer::<u32>(2, 4)?.into();
                        if factor == 0.0 {
                            return Err(
                                line.malformed("a factor of 0", "1, 10, 100 or 1000 stands there")
                            );
                        }
                        self.factors.push((system, factor, names));
                    }
                    // A continuation.
                    None => self.factors.iter_mut().next_back().into_iter().for_each(|last| {
                        last.2.extend(names.iter().cloned());
                    }),
                }
                Ok(())
            }
            TIME_OF_FIRST => {
                self.time_system = match line.columns(48, 3) {
                    "GLO" | "UTC" => TimeSystem::Utc,
                    "BDT" => TimeSystem::BeiDou,
                    "" => self.time_system,
                    _ => TimeSystem::Gps,
                };
                Ok(())
            }
            label => match is_damaged(label) && !line.text.trim().is_empty() {
                true => {
                    let right = format!("a label such as '{TYPES}' stands in columns 61 to 80");
                    Err(line.malformed(format!("'{label}' is no label"), right))
                }
                false => Ok(()),
            },
        }
    }

    /// Adds names of types of observations to those of a system, or starts them anew with a count.
    fn list(
        &mut self,
        line: &Line,
        system: char,
        count: &str,
        names: Vec<String>,
    ) -> Result<(), ReadError> {
        if !count.is_empty() {
            let count = count.parse().ok().filter(|n| (1..=400).contains(n)).ok_or_else(|| {
                let problem = format!("'{count}' is no number of types of observations");
                line.malformed(problem, "a number from 1 to 400 stands there")
            })?;
            self.names.retain(|n| n.0 != system);
            self.names.push((system, count, Vec::new()));
        }
        let Some((_, count, list)) = self.names.iter_mut().rfind(|n| n.0 == system) else {
            let right = "the first line of a list has the number of its types";
            return Err(line.malformed("a list of types goes on that was not begun", right));
        };
        // One that is blank has a field all the same.
        let end = names.iter().rposition(|n| !n.is_empty()).map_or(0, |k| k + 1);
        let room = count.saturating_sub(list.len());
        let names = &names[..end.min(room)];
        list.extend_from_slice(names);
        match names.iter().find(|name| !is_type(&name.to_ascii_uppercase())) {
            Some(name) => {
                let right = "types have names such as C1 and L2, from version 3 on such as C1C";
                Err(line.malformed(format!("'{name}' is no type of observation"), right))
            }
            None => Ok(()),
        }
    }

    /// Finds the fields of the signals in the lists of names.
    pub fn resolve(&mut self) {
        let is_old = self.version < 3.0;
        let fields = |names: &signals::Names| {
            let index = |name: String| self.index(names.system, &name);
            let of = |kind: char| -> Vec<usize> {
                match (is_old, kind) {
                    (true, 'C') => names.old.iter().filter_map(|n| index((*n).into())).collect(),
                    (true, _) if names.old.is_empty() => Vec::new(),
                    (true, _) => index(format!("{kind}1")).into_iter().collect(),
                    (false, _) => {
                        let named = names.modern.iter().map(|name| format!("{kind}{name}"));
                        named.filter_map(index).collect()
                    }
                }
            };
            let first = |kind| of(kind).first().copied();
            let (code, doppler) = (of('C'), first('D'));
            let fields = Fields {
                signal: names.signal,
                code,
                phase: first('L'),
                doppler,
                strength: first('S'),
            };
            let is_there = !fields.code.is_empty() || doppler.is_some();
            is_there.then_some((names.system, fields))
        };
        self.fields = signals::ALL.iter().filter_map(fields).collect();
    }

    /// The signals of a system's records.
    pub fn of(&self, sv: Sv) -> impl Iterator<Item = &Fields> {
        let letter = sv.constellation().letter();
        self.fields.iter().filter(move |(system, _)| *system == letter).map(|f| &f.1)
    }

    /// Number of fields of a record of version 2.
    pub fn old_count(&self) -> usize {
        self.names.first().map_or(0, |n| n.1)
    }

    /// The factor of the field `k` of a system's records.
    pub fn factor(&self, system: char, k: usize) -> f64 {
        let list = self.names.iter().find(|n| n.0 == system).and_then(|n| n.2.get(k));
        let of = |(letter, _, names): &&(char, f64, Vec<String>)| {
            *letter == system && (names.is_empty() || list.is_some_and(|name| names.contains(name)))
        };
        self.factors.iter().rfind(of).map_or(1.0, |factor| factor.1)
    }

    /// The index of a type of observation in the records of a system: in version 2 one list is for all.
    fn index(&self, system: char, name: &str) -> Option<usize> {
        let (.., names) = self.names.iter().find(|n| n.0 == system || self.version < 3.0)?;
        names.iter().position(|n| n.eq_ignore_ascii_case(name))
    }

    /// The same, for the records of a satellite.
    pub fn index_of(&self, sv: Sv, name: &str) -> Option<usize> {
        self.index(sv.constellation().letter(), name)
    }

    /// GPS time of a date as the file prints it.
    pub fn gps_time(&self, printed: GpsTime) -> GpsTime {
        match self.time_system {
            TimeSystem::Gps => printed,
            TimeSystem::Utc => {
                let (year, month, day, hour, minute, second) = printed.calendar();
                GpsTime::from_utc(year, month, day, hour, minute, second)
            }
            TimeSystem::BeiDou => printed + 14.0,
        }
    }
}
