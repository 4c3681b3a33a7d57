//! Results as tables, JSON, RINEX, NMEA, GeoJSON, KML and plots.
//!
//! Every format is a function of the plain results of a [`Run`] and gives text; [`write_all`] puts them
//! into a folder, each file completely or not at all. The same results give the same bytes: no report holds
//! the time at which it was written.

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
mod track;

pub use accuracy::{Accuracy, Reference};
pub use array_sky::array_sky_table;
pub use error::ReportError;
pub use events::{event_line, events_start};
pub use files::{OutputDir, is_ours, write_all, write_atomically, write_check};
pub use geojson::geojson;
pub use heat_map::HeatMap;
pub use html::html;
pub use json::{Document, json};
pub use kml::kml;
pub use line_plot::{Curve, LinePlot};
pub use nmea::nmea;
pub use summary::{Oscillators, SatelliteInView, Summary, counted, satellites_in_view};
pub use svg::{Dot, arrival_plot, dot_plot, east_north_plot, height_plot, sky_plot};
pub use table::{acquisition_table, fix_table, noise_line, sky_plot_text};

use crate::acquisition::Acquisition;
use crate::array::{ArraySky, SkyEpoch};
use crate::capture::StreamInfo;
use crate::front_end::{ImpulseReport, Interferer};
use crate::gnss::message::sbas;
use crate::gnss::observation::ObservationEpoch;
use crate::gnss::{NavigationData, Sv};
use crate::position::Fix;

/// Input of a run.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// Samples with the properties of their stream.
    Samples(&'a StreamInfo),
    /// A file of RINEX observations of this version: `sample` counts seconds from its first epoch.
    Observations {
        /// The format's version.
        version: f64,
    },
}

impl Input<'_> {
    /// Rate of `sample`, Hz.
    pub fn rate_hz(&self) -> f64 {
        match self {
            Self::Samples(stream) => stream.rate_hz,
            Self::Observations { .. } => 1.0,
        }
    }
}

/// All results of a run of the receiver.
#[derive(Clone, Debug)]
pub struct Run<'a> {
    /// Name of the capture, without its folder.
    pub capture: &'a str,
    /// Input.
    pub input: Input<'a>,
    /// Satellites found.
    pub acquisitions: &'a [Acquisition],
    /// Sources and directions by an array.
    pub sky: Option<&'a ArraySky>,
    /// The same during tracking, in order of time.
    pub sky_epochs: &'a [SkyEpoch],
    /// Measurements, in order of time.
    pub epochs: &'a [ObservationEpoch],
    /// Positions, in order of time.
    pub fixes: &'a [Fix],
    /// Ephemerides, ionosphere and UTC that were used or decoded.
    pub navigation: &'a NavigationData,
    /// The newest message of each type of each SBAS satellite.
    pub sbas: &'a [(Sv, sbas::SbasMessage)],
    /// Impulsive noise, where some was found and suppressed.
    pub noise: Option<&'a ImpulseReport>,
    /// Interference that was excised from the samples of one antenna.
    pub interferers: &'a [Interferer],
    /// Notices to the user.
    pub warnings: &'a [String],
    /// Why there is no fix.
    pub reason: Option<&'a str>,
    /// Signal that the first fix needed, s from the first sample.
    pub first_fix_s: Option<f64>,
    /// A known position to compare the fixes with.
    pub reference: Option<Reference<'a>>,
    /// Seed of random draws, if any were made.
    pub seed: Option<u64>,
    /// The options of the run.
    pub options: serde_json::Value,
}
