//! Reader of SP3 files, versions a to d: precise orbits and clocks (S. Hilla, "The Extended Standard
//! Product 3 Orbit Format (SP3-d)", 2016).
//!
//! Positions (km) and clocks (us) of GPS and QZSS are kept; other systems, velocities, correlations and
//! predicted or manoeuvre flags are skipped. Tables of points are
//! interpolated in [`precise_orbit`](crate::orbit::precise).

use crate::format::records::{LeftOut, Line, ReadError, plain, read_text, whole_fields};
use crate::orbit::precise::{PreciseOrbit, PrecisePoint};
use crate::{GpsTime, NavigationData, Sv};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::path::Path;

/// Clocks from this value on, us, are not known (999999.999999).
const UNKNOWN_CLOCK_US: f64 = 999_999.0;

/// Distances from the Earth's centre that are believed, km: GPS has 26 600, QZSS 37 000 to 47 000.
const RADII_KM: std::ops::Range<f64> = 20e3..50e3;

/// Contents of an SP3 file.
#[derive(Clone, Debug, PartialEq)]
pub struct PreciseFile {
    /// Orbits of GPS and QZSS.
    pub orbits: BTreeMap<Sv, PreciseOrbit>,
    /// Satellites of other systems.
    pub skipped: usize,
    /// Lines that do not follow the format.
    pub left_out: LeftOut,
}

impl PreciseFile {
    /// The orbits as navigation data, to be merged with what was broadcast.
    pub fn into_navigation_data(self) -> NavigationData {
        let mut data = NavigationData::default();
        self.orbits.into_iter().for_each(|(sv, orbit)| data.insert_precise(sv, orbit));
        data
    }
}

/// Reads an SP3 file.
///
/// # Errors
/// As [`parse`], and when the file cannot be read.
pub fn read(path: impl AsRef<Path>) -> Result<PreciseFile, ReadError> {
    let path = path.as_ref();
    let file = read_text("SP3", path)?;
    let mut parsed = parse(&file.text, &path.display().to_string())?;
    parsed.left_out.add_damage(file.damage.as_ref());
    Ok(parsed)
}

/// Parses the text of an SP3 file, or of several one after the other; `name` stands in error messages. A malformed line
/// loses itself only, an epoch its positions.
///
/// # Errors
/// When the text is no SP3 file, or has no position of any satellite that is used.
pub fn parse(text: &str, name: &str) -> Result<PreciseFile, ReadError> {
    let text = plain(text);
    let is_cut = !text.ends_with('\n');
    let count = text.lines().count();
    let lines = text.lines().enumerate().map(|(k, text)| {
        let cut = is_cut && k + 1 == count && text.starts_with('P');
        let text = if cut { whole_fields(text, 4, 14) } else { text };
        Line { format: "SP3", file: name, number: k + 1, text }
    });
    let mut lines = lines.skip_while(|line| line.text.trim().is_empty());
    let none = Line { format: "SP3", file: name, number: 1, text: "" };
    let first = lines.next().unwrap_or(none);
    if !is_header(&first) {
        let right = "an SP3 file starts with '#a', '#b', '#c' or '#d'";
        return Err(first.malformed("this is no SP3 file", right));
    }
    let mut reading = Reading::default();
    for line in lines {
        if let Err((what, error)) = reading.take(&line) {
            reading.left_out.add(what, &error);
            reading.first_error.get_or_insert(error);
        }
    }
    if !reading.points.is_empty() {
        return Ok(reading.finish());
    }
    Err(reading.first_error.unwrap_or_else(|| {
        let right = "a position of GPS or QZSS starts with 'PG' or 'PJ'";
        first.malformed("no position of a satellite that is used follows", right)
    }))
}

fn is_header(line: &Line) -> bool {
    line.columns(0, 1) == "#" && matches!(line.columns(1, 1), "a" | "b" | "c" | "d")
}

/// A file as far as it was read.
#[derive(Default)]
struct Reading {
    /// Satellites of the header, and their accuracy exponents in the same order, in lines of their own.
    names: Vec<String>,
    exponents: Vec<String>,
    /// Stated accuracy by satellite, m, of files before this one.
    accuracies_m: BTreeMap<Sv, f64>,
    system: Option<TimeSystem>,
    /// Time of the positions that follow, none where it is not known.
    time: Option<GpsTime>,
    points: BTreeMap<Sv, Vec<PrecisePoint>>,
    skipped: usize,
    left_out: LeftOut,
    first_error: Option<ReadError>,
}

impl Reading {
    /// Takes a line; where it is malformed, what is left out and why.
    fn take(&mut self, line: &Line) -> Result<(), (&'static str, ReadError)> {
        let columns = || (0..17).map(|k| line.columns(9 + 3 * k, 3).to_owned());
        match line.columns(0, 2) {
            _ if is_header(line) => self.end_file(),
            "++" => self.exponents.extend(columns()),
            "+" => self.names.extend(columns()),
            "%c" if self.system.is_none() => {
                self.system = Some(TimeSystem::Unknown);
                self.system = Some(time_system(line).map_err(|e| ("files left out", e))?);
            }
            "*" => {
                // Positions up to the next epoch have no time where this one has none.
                self.time = None;
                let system = self.system.unwrap_or(TimeSystem::Gps);
                self.time = Some(epoch(line, system).map_err(|e| ("epochs left out", e))?);
            }
            tag if tag.starts_with('P') => {
                return self.position(line).map_err(|e| ("positions left out", e));
            }
            _ => {}
        }
        Ok(())
    }

    fn position(&mut self, line: &Line) -> Result<(), ReadError> {
        if self.system == Some(TimeSystem::Unknown) {
            return Ok(());
        }
        let Some(sv) = satellite(line)? else { return Ok(()) };
        let time = self.time.ok_or_else(|| {
            line.malformed("a position comes before any epoch", "an epoch starts with '*'")
        })?;
        if let Some(point) = point(line, time)? {
            self.points.entry(sv).or_default().push(point);
        }
        Ok(())
    }

    /// Keeps what the header of the file said that ends here.
    fn end_file(&mut self) {
        let exponents = std::mem::take(&mut self.exponents);
        let mut exponents = exponents.iter();
        for name in std::mem::take(&mut self.names) {
            let exponent = exponents.next().and_then(|n| n.parse().ok());
            match (known(&name), exponent.filter(|n| (1..30).contains(n))) {
                // 2^n mm, and 0 for unknown.
                (Some(sv), Some(n)) => drop(self.accuracies_m.insert(sv, 1e-3 * 2f64.powi(n))),
                (None, _) if name.bytes().any(|b| b.is_ascii_alphabetic()) => self.skipped += 1,
                _ => {}
            }
        }
        (self.system, self.time) = (None, None);
    }

    fn finish(mut self) -> PreciseFile {
        self.end_file();
        let Self { points, accuracies_m, skipped, left_out, .. } = self;
        let orbit = |(sv, points)| (sv, PreciseOrbit::new(points, accuracies_m.get(&sv).copied()));
        PreciseFile { orbits: points.into_iter().map(orbit).collect(), skipped, left_out }
    }
}

/// The satellite of a position, none of a system that is skipped.
fn satellite(line: &Line) -> Result<Option<Sv>, ReadError> {
    let name = line.columns(1, 3);
    let skipped = name.starts_with(['R', 'E', 'C', 'I', 'S', 'L', 'M']);
    match known(name) {
        None if !skipped => {
            let right = "a satellite such as G07 stands in columns 2 to 4";
            Err(line.malformed(format!("'{name}' names no satellite"), right))
        }
        sv => Ok(sv),
    }
}

/// `G01`, or in version a a bare number; none for other systems and for the zeros that fill lists.
fn known(name: &str) -> Option<Sv> {
    let gps_or_qzss = name.starts_with(['G', 'J']) || name.bytes().all(|b| b.is_ascii_digit());
    name.replace(' ', "0").parse().ok().filter(|_| gps_or_qzss)
}

/// The time that epochs are in.
#[derive(Clone, Copy, PartialEq)]
enum TimeSystem {
    Gps,
    Utc,
    Tai,
    BeiDou,
    /// One that is not known: nothing can be used up to the next header.
    Unknown,
}

/// From the first `%c` line.
fn time_system(line: &Line) -> Result<TimeSystem, ReadError> {
    match line.columns(9, 3) {
        "GPS" | "GAL" | "QZS" | "IRN" | "ccc" | "" => Ok(TimeSystem::Gps),
        "UTC" | "GLO" => Ok(TimeSystem::Utc),
        "TAI" => Ok(TimeSystem::Tai),
        "BDT" => Ok(TimeSystem::BeiDou),
        other => Err(line.malformed(
            format!("the time system '{other}' is not known"),
            "GPS, GAL, QZS, GLO, UTC, TAI, BDT or IRN stands in columns 10 to 12",
        )),
    }
}

fn epoch(line: &Line, system: TimeSystem) -> Result<GpsTime, ReadError> {
    let time = line.epoch(3, 4, 12)?;
    Ok(match system {
        TimeSystem::Gps | TimeSystem::Unknown => time,
        TimeSystem::BeiDou => time + 14.0,
        TimeSystem::Utc => {
            let (year, month, day, hour, minute, second) = time.calendar();
            GpsTime::from_utc(year, month, day, hour, minute, second)
        }
        TimeSystem::Tai => time - 19.0,
    })
}

/// A position line: none where the position is not known (all zeros).
fn point(line: &Line, time: GpsTime) -> Result<Option<PrecisePoint>, ReadError> {
    let coordinate = |k: usize| {
        line.real(4 + 14 * k, 14)?.ok_or_else(|| {
            let right = "three coordinates in km stand in columns 5 to 46";
            line.malformed("a coordinate is missing", right)
        })
    };
    let position_km = Vector3::new(coordinate(0)?, coordinate(1)?, coordinate(2)?);
    let radius_km = position_km.norm();
    if radius_km == 0.0 {
        return Ok(None);
    }
    if !RADII_KM.contains(&radius_km) {
        let problem = format!("a position {radius_km:.0} km from the Earth's centre");
        return Err(line.malformed(problem, "orbits of GPS and QZSS have 20000 to 50000 km"));
    }
    let clock_us = line.real(46, 14)?.filter(|us| us.abs() < UNKNOWN_CLOCK_US);
    let clock_s = clock_us.map(|us| 1e-6 * us);
    Ok(Some(PrecisePoint { time, position_m: 1e3 * position_km, clock_s }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// G05 and a satellite of another system, 12 epochs of 15 minutes, on a straight line.
    fn text(version: &str, system: &str) -> String {
        let mut text = format!(
            "#{version}P2022  1  1  0  0  0.00000000      12 ORBIT IGS20 HLM  IGS\n\
             ## 2190 518400.00000000   900.00000000 59580 0.0000000000000\n\
             +    2   G05R02  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0\n\
             ++         7  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0\n\
             %c M  cc {system} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc\n\
             %c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc\n\
             /* A COMMENT\n"
        );
        for k in 0..12 {
            let (hour, minute) = (k / 4, 15 * (k % 4));
            text += &format!("*  2022  1  1 {hour:2} {minute:2}  0.00000000\n");
            let x = 20e3 + f64::from(k);
            text += &format!("PG05{x:14.6}{:14.6}{:14.6}{:14.6}  7  6  8 110\n", -5e3, 15e3, 123.5);
            text += "VG05      0.000000      0.000000      0.000000 999999.999999\n";
            text += &format!("PR02{x:14.6}{x:14.6}{x:14.6} 999999.999999\n");
        }
        text + "EOF\n"
    }

    #[test]
    fn positions_clocks_and_accuracy_come_out_in_si_units() {
        for version in ["a", "c", "d"] {
            let file = parse(&text(version, "GPS").replace('\n', "\r\n"), "x").unwrap();
            assert_eq!((file.orbits.len(), file.skipped), (1, 1));
            let data = file.into_navigation_data();
            let sv: Sv = "G05".parse().unwrap();
            let t = GpsTime::from_week_tow(2190, 518_400.0 + 4500.0);
            let orbit = data.orbit(sv, t).unwrap();
            let state = orbit.state(t);
            // Written to 1e-6 km; a straight line is interpolated to rounding of 2e7 m.
            assert!((state.position_m - Vector3::new(20.005e6, -5e6, 15e6)).norm() < 1e-6);
            assert!((state.velocity_mps.x - 1e3 / 900.0).abs() < 1e-9);
            let relativity = -2.0 * 20.005e6 * (1e3 / 900.0) / 299_792_458f64.powi(2);
            assert!((state.clock_bias_s - 123.5e-6 - relativity).abs() < 1e-15);
            // 2^7 mm, 0.5 m of antenna, 3 m of unknown group delay.
            assert!((orbit.range_sigma_m() - 0.128f64.hypot(0.5).hypot(3.0)).abs() < 1e-12);
            assert!(data.orbit(sv, t + 86_400.0).is_err());
        }
    }

    #[test]
    fn times_in_tai_and_utc_become_gps_time() {
        let sv: Sv = "G05".parse().unwrap();
        let t = GpsTime::from_week_tow(2190, 518_400.0);
        for (system, shift) in [("TAI", -19.0), ("UTC", 18.0)] {
            let data = parse(&text("d", system), "x").unwrap().into_navigation_data();
            assert!(data.orbit(sv, t + shift).is_ok() && data.orbit(sv, t + shift - 0.1).is_err());
        }
    }

    #[test]
    fn each_mistake_is_named_with_its_line_and_what_would_be_right() {
        let good = text("c", "GPS");
        let cases = [
            (String::new(), "line 1: this is no SP3 file; an SP3 file starts with '#a'"),
            (good.replace(" GPS ccc", " XYZ ccc"), "line 5: the time system 'XYZ' is not known"),
            (good.replacen("*  2022", "/* 2022", 1), "line 9: a position comes before any epoch"),
            (good.replacen("*  2022  1", "*  2022 13", 1), "line 8: '2022 13  1  0  0  0.00000"),
            (good.replacen("  -5000.000000", "  -5000.0x0000", 1), "line 9: '-5000.0x0000' in col"),
            (good.replacen("  15000.000000", "              ", 1), "line 9: a coordinate is miss"),
        ];
        for (text, message) in cases {
            let error = match parse(&text, "igs.sp3") {
                Err(error) => error.to_string(),
                Ok(file) => file.left_out.kinds()[0].first.clone(),
            };
            assert!(error.starts_with("reading SP3 igs.sp3, line "), "{error}");
            assert!(error.contains(message), "'{error}' should contain '{message}'");
        }
    }

    proptest::proptest! {
        #[test]
        fn mutilated_files_never_panic(at in 0usize..3000, with in ".{0,30}", cut in 0usize..3000) {
            let mut text = text("c", "GPS");
            let at = at.min(text.len());
            let to = (at + with.len()).min(text.len());
            text.replace_range(at..to, &with);
            let _ = parse(&text, "x");
            let _ = parse(text.get(..cut).unwrap_or(&text), "x");
        }
    }
}
