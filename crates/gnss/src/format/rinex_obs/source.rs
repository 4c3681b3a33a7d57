//! The lines of an observation file, compact or not.

use super::LONGEST_LINE;
use super::compact::{Compact, Loss};
use crate::ReadError;
use crate::format::records::{Line, NOT_UNPACKED, plain};
use crate::format::unpack::is_damage;
use std::io::BufRead;

/// Lines of a file without its comments.
pub(super) struct Source<R> {
    input: R,
    pub name: String,
    pub text: String,
    /// Of the line, in a compact file of the one that it was made of.
    pub number: usize,
    /// Lines and bytes read.
    lines: usize,
    pub bytes: u64,
    /// Whether the file ends within the line.
    pub is_cut: bool,
    /// Whether it ended within the line before, and so has ended.
    pub was_cut: bool,
    /// Whether the next step stays at this line.
    pub again: bool,
    compact: Option<Compact>,
    /// What could not be read since it was last asked for.
    pub losses: Vec<Loss>,
}

impl<R: BufRead> Source<R> {
    pub fn new(input: R, name: &str) -> Self {
        Self {
            input,
            name: name.to_owned(),
            text: String::new(),
            number: 0,
            lines: 0,
            bytes: 0,
            is_cut: false,
            was_cut: false,
            again: false,
            compact: None,
            losses: Vec::new(),
        }
    }

    /// The bytes up to the next line feed or carriage return, or both, and whether one came. Of a line that is too long
    /// the first [`LONGEST_LINE`].
    fn read_line(&mut self) -> std::io::Result<(Vec<u8>, bool)> {
        let mut line = Vec::new();
        let ends = |b: &u8| matches!(b, b'\n' | b'\r');
        loop {
            let buffer = self.input.fill_buf()?;
            let end = buffer.iter().position(ends);
            let (used, ended) = (end.map_or(buffer.len(), |k| k + 1), end.is_some());
            let is_return = end.is_some_and(|k| buffer[k] == b'\r');
            let room = LONGEST_LINE - line.len();
            line.extend_from_slice(&buffer[..end.unwrap_or(used).min(room)]);
            self.input.consume(used);
            self.bytes += used as u64;
            if is_return && self.input.fill_buf()?.first() == Some(&b'\n') {
                self.input.consume(1);
                self.bytes += 1;
            }
            let is_first = self.lines == 0;
            if ended || used == 0 || is_first && line.len() >= LONGEST_LINE {
                return Ok((line, ended));
            }
        }
    }

    /// Goes to the next line as the file has it; false at the end of the file.
    fn step_in_file(&mut self) -> Result<bool, ReadError> {
        let read = self.read_line();
        self.lines += 1;
        self.number = self.lines;
        let (bytes, ended) = match read {
            Ok(read) => read,
            Err(source) => {
                let damage = is_damage(&source);
                let path = self.name.as_str().into();
                let error = ReadError::Io { format: "RINEX", path, source };
                if !damage {
                    return Err(error);
                }
                self.losses.push((NOT_UNPACKED, error));
                (Vec::new(), false)
            }
        };
        self.was_cut = self.is_cut && self.lines > 1;
        self.is_cut = !ended;
        self.text = plain(String::from_utf8_lossy(&bytes).trim_end()).trim_end().to_owned();
        if bytes.len() >= LONGEST_LINE {
            let problem = format!("the line has {LONGEST_LINE} bytes or more");
            let error = self.line().malformed(problem, "RINEX files are text");
            self.text.clear();
            if self.lines == 1 {
                return Err(error);
            }
            self.losses.push(("lines left out", error));
        }
        Ok(ended || !bytes.is_empty())
    }

    /// Goes to the next line; false at the end of the file.
    pub fn step(&mut self) -> Result<bool, ReadError> {
        if std::mem::take(&mut self.again) {
            return Ok(true);
        }
        loop {
            if let Some((number, text)) = self.compact.as_mut().and_then(Compact::pop) {
                (self.number, self.text, self.is_cut) = (number, text, false);
                return Ok(true);
            }
            let there = self.step_in_file()?;
            let line =
                Line { format: "RINEX", file: &self.name, number: self.number, text: &self.text };
            let starts = there && Compact::starts(&line);
            match &mut self.compact {
                None if starts => self.compact = Some(Compact::new(&line)?),
                None => return Ok(there),
                Some(compact) if !there => {
                    self.losses.extend(compact.end(&line, self.was_cut).err());
                    if !compact.finish() {
                        return Ok(false);
                    }
                }
                Some(compact) if starts => self.losses.extend(compact.restart(&line).err()),
                Some(compact) => self.losses.extend(compact.push(&line, self.is_cut).err()),
            }
        }
    }

    /// Goes to the next line that is no comment; false at the end of the file.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        loop {
            let there = self.step()?;
            if !there || !self.line().columns(60, 20).eq_ignore_ascii_case("COMMENT") {
                return Ok(there);
            }
        }
    }

    /// Whether a header starts at this line.
    pub fn is_header(&self) -> bool {
        self.line().columns(60, 20).eq_ignore_ascii_case("RINEX VERSION / TYPE")
    }

    pub fn line(&self) -> Line<'_> {
        Line { format: "RINEX", file: &self.name, number: self.number, text: &self.text }
    }
}
