//! Why a scenario cannot be simulated.

use super::sent::MessageError;
use crate::gnss::{GpsTime, Sv};
use std::path::PathBuf;

/// Why a scenario cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The scenario file cannot be read.
    #[error("reading scenario '{}': {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// No TOML, an unknown key, or a value outside its range; with line and column.
    #[error("reading scenario '{name}': {}", source.to_string().trim_end())]
    Toml {
        /// The file.
        name: String,
        /// What was wrong, and where.
        source: Box<toml::de::Error>,
    },
    /// Values that do not fit together.
    #[error("reading scenario '{name}': {conflict}")]
    Conflict {
        /// The file.
        name: String,
        /// Which, and what is valid.
        conflict: String,
    },
    /// The navigation file cannot be read.
    #[error("reading the orbits of the scenario: {0}")]
    Navigation(#[from] crate::gnss::ReadError),
    /// A satellite without ephemeris.
    #[error("no ephemeris of {sv}: the orbits hold {known}")]
    UnknownSatellite {
        /// The satellite.
        sv: Sv,
        /// Satellites that have one.
        known: String,
    },
    /// An ephemeris that is not valid at the scenario's start.
    #[error(
        "the ephemeris of {sv} nearest the start ({start}) is {hours:.1} hours away: take the navigation \
         file of that day, or start at {}", toe.utc_iso()
    )]
    StaleEphemeris {
        /// The satellite.
        sv: Sv,
        /// The scenario's start.
        start: GpsTime,
        /// Hours between.
        hours: f64,
        /// Reference time of the ephemeris.
        toe: GpsTime,
    },
    /// A requested satellite is not in view.
    #[error(
        "{sv} is at an elevation of {elevation_deg:.1} degrees at the start: leave it out, or choose \
         another start"
    )]
    BelowHorizon {
        /// The satellite.
        sv: Sv,
        /// Its elevation, degrees.
        elevation_deg: f64,
    },
    /// No satellite at all.
    #[error(
        "no satellite is above {mask_deg} degrees at the start: check position and start, or lower elevation_mask_deg"
    )]
    NothingVisible {
        /// Elevation mask, degrees.
        mask_deg: f64,
    },
    /// A satellite listed twice.
    #[error("satellites: {sv} is listed twice")]
    Duplicate {
        /// The satellite.
        sv: Sv,
    },
    /// A spoofed satellite that is not simulated.
    #[error("[spoofer] satellites: {sv} is not among the satellites simulated: {known}")]
    SpoofedUnknown {
        /// The satellite.
        sv: Sv,
        /// Which ones are.
        known: String,
    },
    /// A direction that the array does not have.
    #[error("{0}")]
    Direction(String),
    /// Klobuchar's model without coefficients.
    #[error(
        "ionosphere = \"klobuchar\" needs coefficients, and the orbits have none: give [atmosphere] klobuchar = {{ alpha = [..4], beta = [..4] }}"
    )]
    NoKlobuchar,
    /// An ephemeris that the navigation message cannot carry.
    #[error("{sv}: {source}")]
    Message {
        /// The satellite.
        sv: Sv,
        /// Which value.
        source: MessageError,
    },
    /// A satellite whose message cannot be made.
    #[error("the message of {sv} cannot be made: simulate satellites of G, J and E")]
    NoMessage {
        /// The satellite.
        sv: Sv,
    },
}
