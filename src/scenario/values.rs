//! Checks of single values while a scenario is read, so that the message shows line and column.

use crate::gnss::checked::number;
pub(crate) use crate::gnss::checked::{finite, positive, some_positive};
use crate::gnss::{Constellation, GpsTime};
use serde::de::{Deserialize, Deserializer, Error};
use serde::ser::Serializer;

/// A number from 0 to 1.
pub fn zero_to_one<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| (0.0..=1.0).contains(&v), "a number from 0 to 1")
}

/// Exponent of a stable distribution, where there is one.
pub fn stable_exponent<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    number(d, |v| (0.3..=2.0).contains(&v), "an exponent from 0.3 to 2").map(Some)
}

/// A fraction above 0, up to 1.
pub fn fraction<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| v > 0.0 && v <= 1.0, "a number above 0, up to 1")
}

/// Power of a jammer over the background noise, dB.
pub fn power<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| (-100.0..=150.0).contains(&v), "-100 to 150 dB")
}

/// Plausible carrier-to-noise density, dB-Hz.
pub fn cn0<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| (0.0..=90.0).contains(&v), "0 to 90 dB-Hz")
}

/// As [`cn0`], for a value that may be absent.
pub fn some_cn0<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    cn0(d).map(Some)
}

/// An elevation, degrees.
pub fn elevation<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| (-90.0..=90.0).contains(&v), "-90 to 90 degrees")
}

/// Sampling rate, Hz: the code's main lobe needs about 2 MHz, its half still tracks.
pub fn rate<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| (1e6..=1e9).contains(&v), "a rate from 1e6 to 1e9 samples per second")
}

/// Frequency error of an oscillator, parts per million: more than 1000 is an error.
pub fn ppm<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| v.abs() <= 1000.0, "-1000 to 1000 ppm")
}

/// Quantiser bits of I or Q.
pub fn bits<'de, D: Deserializer<'de>>(d: D) -> Result<Option<u32>, D::Error> {
    match u32::deserialize(d)? {
        bits @ (1 | 2 | 3 | 4 | 8 | 16) => Ok(Some(bits)),
        other => Err(D::Error::custom(format!(
            "{other} bits: write 1, 2, 3, 4, 8 or 16, or leave the key out for none"
        ))),
    }
}

/// A time as text: UTC in ISO 8601, or GPS `week:tow`.
pub fn time<'de, D: Deserializer<'de>>(d: D) -> Result<GpsTime, D::Error> {
    String::deserialize(d)?.parse().map_err(D::Error::custom)
}

/// The system of this letter in RINEX, of those whose signals are simulated.
pub fn system(letter: &str) -> Result<Constellation, String> {
    let simulated = [Constellation::Gps, Constellation::Qzss, Constellation::Galileo];
    let named = |system: &Constellation| letter.chars().eq([system.letter()]);
    simulated
        .into_iter()
        .find(named)
        .ok_or(format!("'{letter}' is no system that can be simulated: write G, J or E"))
}

/// Systems as a list of letters.
pub fn systems<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Vec<Constellation>>, D::Error> {
    let letters = Vec::<String>::deserialize(d)?;
    let systems = letters.iter().map(|letter| system(letter)).collect::<Result<_, _>>();
    systems.map(Some).map_err(D::Error::custom)
}

/// Prints systems as a list of letters.
pub fn print_systems<S: Serializer>(
    systems: &Option<Vec<Constellation>>,
    s: S,
) -> Result<S::Ok, S::Error> {
    s.collect_seq(systems.iter().flatten().map(|system| system.letter()))
}

/// One system as its letter.
pub fn one_system<'de, D: Deserializer<'de>>(d: D) -> Result<Constellation, D::Error> {
    system(&String::deserialize(d)?).map_err(D::Error::custom)
}

/// Prints one system as its letter.
pub fn print_system<S: Serializer>(system: &Constellation, s: S) -> Result<S::Ok, S::Error> {
    s.collect_str(&system.letter())
}

/// Prints a time as GPS `week:tow`.
pub fn print_time<S: Serializer>(t: &GpsTime, s: S) -> Result<S::Ok, S::Error> {
    s.collect_str(&format_args!("{}:{}", t.week(), t.tow()))
}
