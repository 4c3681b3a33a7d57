//! Checks of single values while TOML is read, so that the message shows line and column.

use serde::de::{Deserialize, Deserializer, Error};

/// A number for which `holds`; `right` describes valid ones.
pub fn number<'de, D: Deserializer<'de>>(
    d: D,
    holds: impl Fn(f64) -> bool,
    right: &str,
) -> Result<f64, D::Error> {
    let value = f64::deserialize(d)?;
    if holds(value) { Ok(value) } else { Err(D::Error::custom(format!("{value} must be {right}"))) }
}

/// A finite number.
pub fn finite<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, f64::is_finite, "finite")
}

/// A finite number above zero.
pub fn positive<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| v > 0.0 && v.is_finite(), "above 0")
}

/// As [`positive`], for a value that may be absent.
pub fn some_positive<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    positive(d).map(Some)
}

/// A finite number, zero or above.
pub fn not_negative<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    number(d, |v| v >= 0.0 && v.is_finite(), "0 or above")
}
