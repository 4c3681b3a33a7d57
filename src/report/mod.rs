//! What a person or another program reads: tables, JSON, RINEX, NMEA, GeoJSON, KML, plots.
//!
//! Every format is a function of the plain results of a [`Run`] and gives text; [`write_all`] puts them
//! into a folder, each file whole or not at all. The same results give the same bytes: no report holds
//! the time of its own making.

mod accuracy;
mod array_sky;
mod error;
mod events;
mod files;
mod geojson;
mod heat_map;
mod html;
mod json;
mod kml;
mod line_plot;
mod nmea;
mod summary;
mod svg;
mod table;

pub use accuracy::{Accuracy, Reference};
pub use array_sky::array_sky_table;
pub use error::ReportError;
pub use events::{event_line, events_start};
pub use files::{OutputDir, write_all, write_atomically, write_check};
pub use geojson::geojson;
pub use heat_map::HeatMap;
pub use html::html;
pub use json::{Document, json};
pub use kml::kml;
pub use line_plot::{Curve, LinePlot};
pub use nmea::nmea;
pub use summary::{SkyEntry, Summary, sky};
pub use svg::{Dot, arrival_plot, dot_plot, east_north_plot, height_plot, sky_plot};
pub use table::{acquisition_table, fix_table, noise_line, sky_text};

use crate::acquisition::Acquisition;
use crate::array::{ArraySky, SkyEpoch};
use crate::capture::StreamInfo;
use crate::front_end::ImpulseReport;
use crate::gnss::message::sbas;
use crate::gnss::observation::ObservationEpoch;
use crate::gnss::{NavigationData, Sv};
use crate::position::Fix;

/// What a run was made from.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// Samples, and what is known of them.
    Samples(&'a StreamInfo),
    /// A file of RINEX observations of this version: `sample` counts seconds from its first epoch.
    Observations {
        /// The format's version.
        version: f64,
    },
}

impl Input<'_> {
    /// How many of what `sample` counts make a second.
    pub fn rate_hz(&self) -> f64 {
        match self {
            Self::Samples(stream) => stream.rate_hz,
            Self::Observations { .. } => 1.0,
        }
    }
}

/// All that a run of the receiver brought forth, as the reports read it.
#[derive(Clone, Debug)]
pub struct Run<'a> {
    /// Name of the capture, without its folder.
    pub capture: &'a str,
    /// What it was made from.
    pub input: Input<'a>,
    /// Satellites found.
    pub acquisitions: &'a [Acquisition],
    /// The satellites as an array sees them.
    pub sky: Option<&'a ArraySky>,
    /// The same while they were tracked, in order of time.
    pub sky_epochs: &'a [SkyEpoch],
    /// Measurements, in order of time.
    pub epochs: &'a [ObservationEpoch],
    /// Positions, in order of time.
    pub fixes: &'a [Fix],
    /// Ephemerides, ionosphere and UTC that were used or decoded.
    pub navigation: &'a NavigationData,
    /// The newest message of each type of each SBAS satellite.
    pub sbas: &'a [(Sv, sbas::Message)],
    /// Impulsive noise, where some was found and suppressed.
    pub noise: Option<&'a ImpulseReport>,
    /// What a person should know.
    pub warnings: &'a [String],
    /// Why there is no fix, if there is none.
    pub reason: Option<&'a str>,
    /// Signal from the first sample on that the first fix needed, s, where there is one.
    pub first_fix_s: Option<f64>,
    /// A place that the fixes are to be compared with.
    pub reference: Option<Reference<'a>>,
    /// Seed of random draws, if any were made.
    pub seed: Option<u64>,
    /// The options of the run, as they are to be echoed.
    pub options: serde_json::Value,
}
