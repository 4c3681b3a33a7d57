//! Satellites from two-line element sets, by SGP4 (Hoots and Roehrich 1980; Vallado et al., "Revisiting
//! Spacetrack Report #3", AIAA 2006-6753), through the `sgp4` crate.
//!
//! SGP4 gives states of the true equator and mean equinox (TEME); they are turned to the Earth-fixed frame
//! by the mean sidereal time alone. UT1 is taken as UTC and polar motion is neglected: up to 0.4 km
//! and 15 m in low orbits, within the accuracy of element sets (about 1 km at their epoch, growing by
//! 1 to 3 km a day).

use crate::GpsTime;
use crate::constants::OMEGA_EARTH;
use crate::format::records::{Line, ReadError, read_text};
use nalgebra::{Rotation3, Vector3};
use sgp4::chrono::{Datelike, Timelike};
use std::path::Path;

/// A satellite and its mean elements.
#[derive(Clone, Debug)]
pub struct Tle {
    /// Name, as the line before the elements has it, else the catalogue number.
    pub name: String,
    /// Number in the catalogue (NORAD).
    pub catalogue_number: u64,
    /// Epoch of the elements.
    pub epoch: GpsTime,
    /// Mean motion of the elements, rad/s.
    pub mean_motion_rps: f64,
    constants: sgp4::Constants,
}

/// Position and velocity, Earth-fixed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EcefState {
    /// Position, m.
    pub position_m: Vector3<f64>,
    /// Velocity, m/s, in the rotating frame.
    pub velocity_mps: Vector3<f64>,
}

/// Why the elements of a satellite give no state at a time.
#[derive(Debug, thiserror::Error)]
#[error(
    "propagating the elements of {name} by {days:.1} days: {problem}; take elements nearer in time"
)]
pub struct PropagationError {
    name: String,
    days: f64,
    problem: String,
}

impl Tle {
    /// Satellite state at GPS time `t`.
    ///
    /// # Errors
    /// When the elements have decayed by then.
    pub fn state(&self, t: GpsTime) -> Result<EcefState, PropagationError> {
        let elapsed_s = t - self.epoch;
        let fail = |problem: String| PropagationError {
            name: self.name.clone(),
            days: elapsed_s / 86_400.0,
            problem,
        };
        let minutes = sgp4::MinutesSinceEpoch(elapsed_s / 60.0);
        let teme = self.constants.propagate(minutes).map_err(|e| fail(e.to_string()))?;
        let position_m = 1e3 * Vector3::from(teme.position);
        let velocity_mps = 1e3 * Vector3::from(teme.velocity);
        if !(position_m.norm().is_finite() && velocity_mps.norm().is_finite()) {
            return Err(fail("the state is not finite".to_owned()));
        }
        Ok(earth_fixed(&position_m, &velocity_mps, t))
    }
}

/// From TEME to the Earth-fixed frame, with UT1 as UTC.
fn earth_fixed(position_m: &Vector3<f64>, velocity_mps: &Vector3<f64>, t: GpsTime) -> EcefState {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -mean_sidereal_time(t));
    let position_m = turn * position_m;
    let velocity_mps = turn * velocity_mps - OMEGA_EARTH * Vector3::z().cross(&position_m);
    EcefState { position_m, velocity_mps }
}

/// Greenwich mean sidereal time, rad (IAU 1982; Aoki et al.), with UT1 as UTC.
fn mean_sidereal_time(t: GpsTime) -> f64 {
    let noon_of_2000 = GpsTime::from_utc(2000, 1, 1, 12, 0, 0.0);
    // Days of 86400 s of UTC, which leap seconds do not lengthen.
    let leap = t.leap_seconds() - noon_of_2000.leap_seconds();
    let days = (t - noon_of_2000 - f64::from(leap)) / 86_400.0;
    let centuries = days / 36_525.0;
    let seconds = 67_310.548_41
        + 8_640_184.812_866 * centuries
        + 0.093_104 * centuries.powi(2)
        - 6.2e-6 * centuries.powi(3)
        // 876 600 h a century are whole turns but for the part of the day.
        + 86_400.0 * days.fract();
    (seconds / 86_400.0).rem_euclid(1.0) * std::f64::consts::TAU
}

/// Reads a file of element sets, with or without lines of names.
///
/// # Errors
/// When the file cannot be read or unpacked, or an element set is malformed.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<Tle>, ReadError> {
    let path = path.as_ref();
    let file = read_text("TLE", path)?;
    file.damage.map_or(Ok(()), Err)?;
    parse(&file.text, &path.display().to_string())
}

/// Parses element sets: pairs of lines that start with 1 and 2, each perhaps after a line with the name;
/// blank lines and those that start with '#' are skipped. `file` stands in error messages.
///
/// # Errors
/// When a line is missing, or its columns, its checksum or its values are wrong.
pub fn parse(text: &str, file: &str) -> Result<Vec<Tle>, ReadError> {
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(k, text)| Line { format: "TLE", file, number: k + 1, text: text.trim_end() })
        .filter(|line| !line.text.is_empty() && !line.text.starts_with('#'));
    let mut satellites = Vec::new();
    let mut name: Option<&str> = None;
    while let Some(first) = lines.next() {
        if !first.text.starts_with("1 ") {
            if let Some(name) = name {
                let problem = format!("the name '{name}' is followed by no elements");
                return Err(first.malformed(problem, RIGHT));
            }
            name = Some(first.text.strip_prefix("0 ").unwrap_or(first.text).trim());
            continue;
        }
        let second = lines.next().filter(|line| line.text.starts_with("2 "));
        let second = second.ok_or_else(|| first.malformed("line 2 of it is missing", RIGHT))?;
        satellites.push(satellite(name.take(), &first, &second)?);
    }
    match name {
        Some(name) => {
            let number = text.lines().count();
            let last = Line { format: "TLE", file, number, text: "" };
            let problem = format!("the name '{name}' is followed by no elements");
            Err(last.malformed(problem, RIGHT))
        }
        None => Ok(satellites),
    }
}

/// Format of an element set.
const RIGHT: &str = "an element set is two lines of 69 columns that start with 1 and 2 and end with their checksums";

fn satellite(name: Option<&str>, first: &Line, second: &Line) -> Result<Tle, ReadError> {
    // The crate requires these.
    for line in [first, second] {
        let digit = line.text.as_bytes().get(68).is_some_and(u8::is_ascii_digit);
        if line.text.len() != 69 || !line.text.is_ascii() || !digit {
            let problem = format!("the line has {} columns or no checksum", line.text.len());
            return Err(line.malformed(problem, RIGHT));
        }
    }
    let (one, two) = (first.text.as_bytes(), second.text.as_bytes());
    let elements = sgp4::Elements::from_tle(None, one, two)
        .map_err(|e| first.malformed(e.to_string(), RIGHT))?;
    let constants = sgp4::Constants::from_elements(&elements).map_err(|e| {
        first.malformed(e.to_string(), "the mean motion is positive and the eccentricity below 1")
    })?;
    let date = elements.datetime;
    let second = f64::from(date.second()) + f64::from(date.nanosecond()) * 1e-9;
    let epoch = GpsTime::from_utc(
        date.year(),
        date.month(),
        date.day(),
        date.hour(),
        date.minute(),
        second,
    );
    Ok(Tle {
        name: name.map_or_else(|| elements.norad_id.to_string(), str::to_owned),
        catalogue_number: elements.norad_id,
        epoch,
        mean_motion_rps: elements.mean_motion * std::f64::consts::TAU / 86_400.0,
        constants,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::MU_EARTH;

    /// A satellite of the verification set of AIAA 2006-6753, and a real one of today.
    const VANGUARD: &str = "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753\n\
                            2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667\n";
    const STARLINK: &str = "1 44714U 19074B   26204.36464777  .00027142  00000+0  41251-3 0  9990\n\
                            2 44714  53.1491 254.9265 0005630 347.9654  12.1222 15.54373498369838\n";

    #[test]
    fn the_turn_from_teme_is_that_of_the_published_example() {
        // Vallado, Fundamentals of Astrodynamics, example 3-15: 2004-04-06 07:51:28.386009 UTC with
        // UT1 - UTC = -0.4399619 s.
        let utc = GpsTime::from_utc(2004, 4, 6, 7, 51, 28.386_009);
        let r = Vector3::new(5_094_180.162_1, 6_127_644.659_5, 6_380_344.532_7);
        let v = Vector3::new(-4_746.131_487, 785.818_041, 5_531.931_288);
        let fixed = earth_fixed(&r, &v, utc - 0.439_961_9);
        let expected = Vector3::new(-1_033_475.031_3, 7_901_305.585_6, 6_380_344.532_7);
        // Its Julian date is one double, good to 20 us, in which the Earth turns by 12 mm there.
        assert!((fixed.position_m - expected).norm() < 0.015, "{}", fixed.position_m);
        let expected = Vector3::new(-3_225.632_747, -2_872.442_511, 5_531.931_288);
        // The day of that date was 1.6 ms longer: 2e-8 of 580 m/s.
        assert!((fixed.velocity_mps - expected).norm() < 1e-4, "{}", fixed.velocity_mps);
    }

    #[test]
    fn states_are_those_of_the_verification_set() {
        let satellite = &parse(VANGUARD, "x").unwrap()[0];
        assert_eq!(satellite.name, "5");
        // At 360 min, TEME; the set was made with WGS 72 constants, which move this orbit by metres.
        let expected = Vector3::new(-7_154_031.2, -3_783_176.8, -3_536_194.1);
        let state = satellite.state(satellite.epoch + 360.0 * 60.0).unwrap();
        assert!((state.position_m.z - expected.z).abs() < 100.0, "{}", state.position_m);
        assert!((state.position_m.xy().norm() - expected.xy().norm()).abs() < 100.0);
    }

    #[test]
    fn heights_follow_from_the_mean_motion_and_velocities_from_the_positions() {
        for satellite in parse(&format!("STARLINK-1008\n{STARLINK}{VANGUARD}"), "x").unwrap() {
            let a = (MU_EARTH / satellite.mean_motion_rps.powi(2)).cbrt();
            let e = if satellite.catalogue_number == 5 { 0.186 } else { 0.0006 };
            for minutes in (0..200).step_by(20) {
                let t = satellite.epoch + 60.0 * f64::from(minutes);
                let at = |dt: f64| satellite.state(t + dt).unwrap();
                let height = at(0.0).position_m.norm();
                // Short-period terms of J2 are about 10 km.
                assert!((a * (1.0 - e) - 2e4..a * (1.0 + e) + 2e4).contains(&height), "{height}");
                let difference = at(0.5).position_m - at(-0.5).position_m;
                // SGP4's velocity leaves out derivatives of short-period terms: J2 e of it, 1 m/s for
                // the eccentric satellite; of the circular one its square, J2^2 of 7.6 km/s, and drag.
                let limit = if e > 0.1 { 3.0 } else { 0.05 };
                let error = (difference - at(0.0).velocity_mps).norm();
                assert!(error < limit, "{error}");
            }
        }
    }

    #[test]
    fn names_and_comments_are_told_from_elements() {
        let text = format!("# some\n\n0 VANGUARD 1 \r\n{VANGUARD}STARLINK-1008  \n{STARLINK}");
        let names: Vec<String> = parse(&text, "x").unwrap().into_iter().map(|s| s.name).collect();
        assert_eq!(names, ["VANGUARD 1", "STARLINK-1008"]);
    }

    #[test]
    fn each_mistake_is_named_with_its_line_and_what_would_be_right() {
        let lines: Vec<&str> = STARLINK.lines().collect();
        let cases = [
            (format!("A\n{}\n", lines[0]), "line 2: line 2 of it is missing; an element set is"),
            (format!("{STARLINK}B\n"), "line 3: the name 'B' is followed by no elements"),
            (format!("{STARLINK}B\nC\n"), "line 4: the name 'B' is followed by no elements"),
            (STARLINK.replace("53.1491", "53.1492"), "line 1: TLE parse error"),
            (STARLINK.replace("53.1491", "53.149"), "line 2: the line has 68 columns or no check"),
        ];
        for (text, message) in cases {
            let error = parse(&text, "active.tle").unwrap_err().to_string();
            assert!(error.starts_with("reading TLE active.tle, line "), "{error}");
            assert!(error.contains(message), "'{error}' should contain '{message}'");
        }
    }

    proptest::proptest! {
        #[test]
        fn mutilated_element_sets_never_panic(at in 0usize..140, with in ".{0,9}", days in -1e5..1e5) {
            let mut text = STARLINK.to_owned();
            let at = at.min(text.len());
            let to = (at + with.len()).min(text.len());
            text.replace_range(at..to, &with);
            for satellite in parse(&text, "x").unwrap_or_default() {
                let _ = satellite.state(satellite.epoch + days * 86_400.0);
            }
        }
    }
}
