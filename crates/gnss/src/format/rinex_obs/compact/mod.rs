//! Decoder of compact RINEX, versions 1 (of RINEX 2) and 3 (of RINEX 3 and 4): line for line it gives the observation file
//! that was compacted (Y. Hatanaka, "A Compression Format and Tools for GNSS Observation Data", Bulletin of the
//! Geographical Survey Institute 55, 2008).
//!
//! An epoch is a line of its date and satellites, one of the clock's offset, and one for each satellite. Text is written
//! as what changed since the epoch before, numbers as differences of a stated order. All starts anew where an epoch
//! line begins with `&` (version 1) or `>`.
//!
//! A line that is lost or doubled shifts all differences that follow to satellites they do not belong to. So an epoch is
//! given out once the line after it proves to start another; else it is left out, with all up to where the
//! differences start anew. A number that is damaged loses its own series only.

mod differences;
#[cfg(test)]
mod tests;

use crate::format::records::Line;
use crate::{GpsTime, ReadError};
use differences::{Number, Series, changed, decimal};
use std::collections::{BTreeMap, VecDeque};

/// Satellites on an epoch line of RINEX 2, and on each that continues it.
const NAMES_PER_LINE: usize = 12;
/// Fields on a line of RINEX 2.
const FIELDS_PER_LINE: usize = 5;
/// Column of the clock's offset in RINEX 2 and 3.
const CLOCK_COLUMN: (usize, usize) = (68, 41);
const RIGHT: &str =
    "the lines of an epoch are its date and satellites, the clock, and one for each satellite";

/// What is left out where lines do not go together.
pub(super) const LOST: &str =
    "parts of compact RINEX left out, up to where its differences start anew";
/// What is left out where one number is damaged.
pub(super) const LOST_SERIES: &str = "series of values left out, up to where they start anew";

/// A compact file as far as it was read.
pub(super) struct Compact {
    /// Version 3.
    modern: bool,
    expected: Expected,
    /// Types of observations by system, of RINEX 2 one for all.
    types: BTreeMap<char, usize>,
    /// The line of the epoch, and its time.
    epoch: String,
    time: Option<GpsTime>,
    clock: Series,
    /// Its satellites by name, and how many of them are read.
    names: Vec<String>,
    /// Series of the satellites of the epoch before that are not yet read.
    before: BTreeMap<String, Satellite>,
    now: BTreeMap<String, Satellite>,
    /// Lines of the epoch that the next one has to confirm.
    held: Vec<(usize, String)>,
    /// Decoded lines and the numbers of the lines that they are made of.
    ready: VecDeque<(usize, String)>,
}

/// The line that is to come.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Expected {
    Header,
    Epoch,
    Clock,
    /// Of the satellite with this index.
    Satellite(usize),
    /// One of so many lines of an event.
    Event(usize),
    /// Whatever comes before the differences start anew.
    Anew,
    /// Another file, which is not compact.
    Plain,
}

#[derive(Default)]
struct Satellite {
    series: Vec<Series>,
    /// Loss of lock and strength of each field.
    flags: String,
}

/// What is left out, and why.
pub(super) type Loss = (&'static str, ReadError);

impl Compact {
    /// Whether a line starts a compact file.
    pub fn starts(line: &Line) -> bool {
        line.columns(60, 20).eq_ignore_ascii_case("CRINEX VERS   / TYPE")
    }

    /// The decoder of the file whose first line this is.
    pub fn new(line: &Line) -> Result<Self, ReadError> {
        let modern = match line.columns(0, 20).as_bytes() {
            [b'1', ..] => false,
            [b'3', ..] => true,
            _ => {
                let problem = format!("version '{}' of compact RINEX", line.columns(0, 20));
                return Err(line.malformed(problem, "versions 1 and 3 are read"));
            }
        };
        Ok(Self {
            modern,
            expected: Expected::Header,
            types: BTreeMap::new(),
            epoch: String::new(),
            time: None,
            clock: Series::default(),
            names: Vec::new(),
            before: BTreeMap::new(),
            now: BTreeMap::new(),
            held: Vec::new(),
            ready: VecDeque::new(),
        })
    }

    /// Goes on with another compact file, whose first line this is.
    pub fn restart(&mut self, line: &Line) -> Result<(), Loss> {
        self.finish();
        self.expected = Expected::Anew;
        let next = Self::new(line).map_err(|error| ("files left out", error))?;
        *self = Self { ready: std::mem::take(&mut self.ready), ..next };
        Ok(())
    }

    /// The next decoded line, and the number of the line that it was made of.
    pub fn pop(&mut self) -> Option<(usize, String)> {
        self.ready.pop_front()
    }

    /// Ends the file before `line`. The last epoch is left out where it is not complete, unless the file was cut within a
    /// line: else any of its lines may be lost.
    pub fn end(&mut self, line: &Line, was_cut: bool) -> Result<(), Loss> {
        let is_complete = !matches!(self.expected, Expected::Clock | Expected::Satellite(_));
        if is_complete || was_cut {
            return Ok(());
        }
        self.lose();
        Err((LOST, line.malformed("the file ends in the middle of an epoch", RIGHT)))
    }

    /// Gives out what is held, at the end of a file; false where that is nothing.
    pub fn finish(&mut self) -> bool {
        self.ready.extend(self.held.drain(..));
        !self.ready.is_empty()
    }

    /// Takes the next line of the file; `is_cut` where the file ends within it.
    pub fn push(&mut self, line: &Line, is_cut: bool) -> Result<(), Loss> {
        if self.expected != Expected::Header && self.expected != Expected::Plain {
            if line.columns(60, 20).eq_ignore_ascii_case("RINEX VERSION / TYPE") {
                self.finish();
                self.expected = Expected::Plain;
            } else if line.text.starts_with(if self.modern { '>' } else { '&' }) {
                return self.anew(line);
            }
        }
        let taken = match self.expected {
            Expected::Header | Expected::Plain => self.header(line),
            Expected::Epoch => self.epoch(line),
            Expected::Clock => self.clock(line),
            Expected::Satellite(k) => self.satellite(k, line, is_cut),
            Expected::Event(left) => self.event(left, line),
            Expected::Anew => Ok(()),
        };
        taken.inspect_err(|(what, _)| {
            if *what == LOST {
                self.lose()
            }
        })
    }

    /// Leaves the epoch out, and all up to where the differences start anew.
    fn lose(&mut self) {
        self.held.clear();
        self.expected = Expected::Anew;
    }

    fn pass_on(&mut self, line: &Line) {
        self.ready.push_back((line.number, line.text.to_owned()));
    }

    /// A line of the header, or of a file that is not compact.
    fn header(&mut self, line: &Line) -> Result<(), Loss> {
        let label = line.columns(60, 20).to_ascii_uppercase();
        if self.expected == Expected::Header && label.starts_with("CRINEX") {
            return Ok(());
        }
        self.count_types(line);
        if self.expected == Expected::Header && label == "END OF HEADER" {
            self.expected = Expected::Epoch;
        }
        self.pass_on(line);
        Ok(())
    }

    /// Counts the types of observations that a line of a header or an event lists; a line that continues has no count.
    fn count_types(&mut self, line: &Line) {
        let (system, count) = match line.columns(60, 20).to_ascii_uppercase().as_str() {
            "# / TYPES OF OBSERV" => (' ', line.columns(0, 6)),
            "SYS / # / OBS TYPES" => (line.text.chars().next().unwrap_or(' '), line.columns(3, 3)),
            _ => return,
        };
        if let Some(count) = count.parse().ok().filter(|n| *n <= 400) {
            self.types.insert(system, count);
        }
    }

    /// An epoch line from which all starts anew, or an event.
    fn anew(&mut self, line: &Line) -> Result<(), Loss> {
        let short = matches!(self.expected, Expected::Clock | Expected::Satellite(_));
        let problem = format!(
            "an epoch starts before the {} satellites of the last one ended",
            self.names.len()
        );
        if short {
            self.lose();
        }
        self.finish();
        self.epoch.clear();
        (self.before, self.now, self.time) = Default::default();
        self.clock = Series::default();
        let text = if self.modern { line.text.to_owned() } else { line.text.replacen('&', " ", 1) };
        let text = Line { text: &text, ..*line };
        let flag = text.columns(if self.modern { 31 } else { 28 }, 1);
        let taken = match flag.parse().unwrap_or(0) {
            2..=6u8 => {
                let count = text.columns(if self.modern { 32 } else { 29 }, 3);
                self.expected = events(count.parse().unwrap_or(0));
                self.pass_on(&text);
                Ok(())
            }
            _ => self.epoch(&text),
        };
        if taken.is_err() {
            self.lose();
        }
        let early = || Err((LOST, line.malformed(problem, RIGHT)));
        if short { taken.and_then(|()| early()) } else { taken }
    }

    fn event(&mut self, left: usize, line: &Line) -> Result<(), Loss> {
        self.count_types(line);
        self.expected = events(left - 1);
        self.pass_on(line);
        Ok(())
    }

    /// The line of an epoch, which confirms the one before.
    fn epoch(&mut self, line: &Line) -> Result<(), Loss> {
        let lost = |problem: String| (LOST, line.malformed(problem, RIGHT));
        let text = changed(&self.epoch, line.text);
        let full = Line { text: &text, ..*line };
        let (flag, names) = if self.modern { (31, 41) } else { (28, 32) };
        let time = match self.modern {
            true => full.epoch(2, 4, 11),
            false => full.epoch(1, 2, 11),
        };
        let starts = text.starts_with(if self.modern { "> " } else { " " });
        let time = time.ok().filter(|_| starts && matches!(full.columns(flag, 1), "" | "0" | "1"));
        let count: Option<usize> = full.columns(flag + 1, 3).parse().ok();
        let (Some(time), Some(count)) = (time, count) else {
            return Err(lost(format!("'{}' is no epoch", line.columns(0, 40))));
        };
        if self.time.is_some_and(|before| time <= before) {
            return Err(lost("the epoch is not later than the one before".to_owned()));
        }
        // Names that are left over from an epoch of more satellites stay as blanks.
        let list = full.columns(names, 3 * count + 3);
        let list = format!("{list:>width$}", width = 3 * count);
        let good = |name: &[u8]| matches!(name, [_, b'0'..=b'9' | b' ', b'0'..=b'9']);
        if list.len() != 3 * count || !list.as_bytes().chunks(3).all(good) {
            return Err(lost(format!("'{list}' does not name {count} satellites")));
        }
        self.finish();
        self.names = list.as_bytes().chunks(3).map(|n| String::from_utf8_lossy(n).into()).collect();
        self.before = std::mem::take(&mut self.now);
        (self.time, self.expected) = (Some(time), Expected::Clock);
        self.epoch = text;
        Ok(())
    }

    fn clock(&mut self, line: &Line) -> Result<(), Loss> {
        let clock = match self.clock.take(line.text.trim()) {
            Number::Value(value) => Some(value),
            Number::Missing => None,
            Number::Wrong | Number::NotBegun => {
                let problem = format!("'{}' is no clock offset", line.columns(0, 40));
                return Err((LOST, line.malformed(problem, RIGHT)));
            }
        };
        let lines = self.epoch_lines(clock);
        self.held = lines.into_iter().map(|text| (line.number, text)).collect();
        self.expected = self.following(0);
        Ok(())
    }

    /// The epoch's lines as RINEX writes them.
    fn epoch_lines(&self, clock: Option<i64>) -> Vec<String> {
        let start = if self.modern { 41 } else { 32 };
        let date = self.epoch.get(..start.min(self.epoch.len())).unwrap_or_default();
        if self.modern {
            let clock = clock.map_or(String::new(), |clock| decimal(clock, 12, 15));
            let column = CLOCK_COLUMN.1;
            return vec![format!("{date:column$}{clock}").trim_end().to_owned()];
        }
        let mut lines: Vec<String> = self
            .names
            .chunks(NAMES_PER_LINE)
            .map(|names| format!("{:start$}{}", "", names.concat()))
            .collect();
        let first = format!("{date:start$}{}", lines.first().map_or("", |line| &line[start..]));
        let clock = clock.map_or(String::new(), |clock| decimal(clock, 9, 12));
        let column = CLOCK_COLUMN.0;
        lines.splice(
            ..lines.len().min(1),
            [format!("{first:column$}{clock}").trim_end().to_owned()],
        );
        lines
    }

    /// What follows satellite lines when `k` are read.
    fn following(&self, k: usize) -> Expected {
        if k < self.names.len() { Expected::Satellite(k) } else { Expected::Epoch }
    }

    fn satellite(&mut self, k: usize, line: &Line, is_cut: bool) -> Result<(), Loss> {
        let name = self.names[k].clone();
        let system = if self.modern { name.chars().next().unwrap_or(' ') } else { ' ' };
        let count = self.types.get(&system).copied().unwrap_or(0);
        let mut satellite = self.before.remove(&name).unwrap_or_default();
        satellite.series.resize_with(count, Series::default);
        // The last number may lack digits where the file ends in it.
        let mut rest =
            if is_cut { line.text.rfind(' ').map_or("", |k| &line.text[..k]) } else { line.text };
        let mut values = Vec::with_capacity(count);
        let mut wrong = None;
        for series in &mut satellite.series {
            let (text, after) = rest.split_once(' ').unwrap_or((rest, ""));
            rest = after;
            values.push(match series.take(text) {
                Number::Value(value) => Some(value),
                Number::Missing => None,
                Number::Wrong => {
                    wrong.get_or_insert_with(|| format!("'{text}' of {name} is no value"));
                    None
                }
                Number::NotBegun => {
                    let problem =
                        format!("'{text}' of {name} is a difference, but its series was not begun");
                    return Err((LOST, line.malformed(problem, RIGHT)));
                }
            });
        }
        if rest.len() > 2 * count {
            let problem = format!("'{}' of {name} follows its {count} values", line.columns(0, 40));
            return Err((LOST, line.malformed(problem, RIGHT)));
        }
        satellite.flags = changed(&satellite.flags, rest);
        let lines = self.satellite_lines(&name, &values, &satellite.flags);
        self.held.extend(lines.into_iter().map(|text| (line.number, text)));
        self.now.insert(name, satellite);
        self.expected = self.following(k + 1);
        let right = "a value is a whole number, or its order, & and the number";
        wrong.map_or(Ok(()), |problem| Err((LOST_SERIES, line.malformed(problem, right))))
    }

    /// A satellite's lines as RINEX writes them.
    fn satellite_lines(&self, name: &str, values: &[Option<i64>], flags: &str) -> Vec<String> {
        let field = |(k, value): (usize, &Option<i64>)| {
            let flags = flags.get(2 * k..).map_or("", |f| &f[..f.len().min(2)]);
            let value = value.map_or(String::new(), |value| decimal(value, 3, 14));
            format!("{value:14}{flags:2}")
        };
        let fields: Vec<String> = values.iter().enumerate().map(field).collect();
        match self.modern {
            true => vec![format!("{name}{}", fields.concat()).trim_end().to_owned()],
            false => {
                fields.chunks(FIELDS_PER_LINE).map(|f| f.concat().trim_end().to_owned()).collect()
            }
        }
    }
}

/// What comes when `left` lines of an event are to come.
fn events(left: usize) -> Expected {
    if left > 0 { Expected::Event(left) } else { Expected::Epoch }
}
