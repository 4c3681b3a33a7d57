//! The result: a position with everything a person needs to trust it.

use crate::error::Dropped;
use crate::solver::failure::Failure;
use nalgebra::{Matrix3, Vector3};
use sdr_rx_gnss::{Constellation, GpsTime, Sv};

/// How the observations came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FixMethod {
    /// Full pseudoranges of tracked satellites.
    Tracking,
    /// Code phases of a snapshot, with coarse time.
    Snapshot,
    /// Dopplers alone, of a receiver at rest.
    Doppler,
    /// Full pseudoranges and Dopplers together, of a receiver at rest.
    Combined,
}

/// How far redundant observations prove a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Integrity {
    /// Every fault hypothesis that the observations do not contradict leads to a place within the alert limit.
    Verified,
    /// The same, after satellites were excluded as faulty.
    Excluded,
    /// A place that one more fault than the observations show could move beyond the alert limit, or that nothing
    /// checks.
    Unverified,
}

impl Integrity {
    /// Whether the position counts as a fix.
    pub fn is_proved(self) -> bool {
        self != Self::Unverified
    }
}

/// Why a position is not proved.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Doubt {
    /// The satellites are too few to check each other.
    NoRedundancy,
    /// A fault that the observations do not show could move it beyond the alert limit; or no test was asked for.
    ProtectionLevel,
    /// It lies so far, m, from where the fix before and the velocities lead.
    Motion(f64),
    /// The receiver's clock is so far, m, from where the fix before and its drift lead.
    Clock(f64),
}

/// How far the true place may be from the printed one, m: exceeded with a probability of 1e-5 if a satellite is faulty
/// with one of 1e-3, whatever its error.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ProtectionLevel {
    /// In space.
    pub position_m: f64,
    /// In the horizontal plane.
    pub horizontal_m: f64,
    /// In height.
    pub vertical_m: f64,
}

impl ProtectionLevel {
    /// The same about a place `distance_m` away.
    pub(crate) fn widened(self, distance_m: f64) -> Self {
        Self {
            position_m: self.position_m + distance_m,
            horizontal_m: self.horizontal_m + distance_m,
            vertical_m: self.vertical_m + distance_m,
        }
    }
}

/// What a satellite contributed to a fix.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// The satellite.
    pub sv: Sv,
    /// Observed minus computed code range, m, where one was used.
    pub range_m: Option<f64>,
    /// Observed minus computed Doppler, Hz, where one was measured.
    pub doppler_hz: Option<f64>,
    /// Azimuth, rad from north over east.
    pub azimuth: f64,
    /// Elevation, rad.
    pub elevation: f64,
}

/// How a fix came from the Earth's centre to the region of the receiver, where the full model takes over.
#[derive(Clone, Debug, PartialEq)]
pub struct FixStart {
    /// Name of the solver that led there, such as `aw-dgn-bt`; [`FixStart::SEEDS`] where none did.
    pub solver: &'static str,
    /// Linearisations from the centre to there, those of a solver that failed included.
    pub iterations: usize,
    /// The solver that was asked for, where another one took over.
    pub failed: Option<FailedStart>,
}

impl FixStart {
    /// Instead of a solver's name: points on the ground around the direction of the satellites, tried one by one.
    pub const SEEDS: &'static str = "seeds";
}

/// A solver that was asked for and gave no start.
#[derive(Clone, Debug, PartialEq)]
pub struct FailedStart {
    /// Its name.
    pub solver: &'static str,
    /// Why it gave none.
    pub cause: FailedStartCause,
}

/// Why a solver gave no start.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FailedStartCause {
    /// It did not converge near the Earth.
    #[error(transparent)]
    NoPlace(Failure),
    /// From its place the full model finds none that explains the observations; from another solver's it does.
    #[error("from its place the full model finds none that explains the observations")]
    Unexplained,
}

/// How the time of a snapshot was found, where it was not known beforehand.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TimeSearch {
    /// Time that was searched, s: that with ephemerides in force.
    pub searched_s: f64,
    /// Time of the given window that was not, for lack of ephemerides, s; infinite for a window without
    /// end.
    pub left_out_s: f64,
    /// Places and times that explained the Dopplers.
    pub hypotheses: usize,
    /// Bound on the expected number of false solutions that explain the measurements as well as this one.
    pub false_expected: f64,
}

/// Receiver clock against the time of a satellite system less that against the time of the reference, as its ranges
/// have them: the difference of both times, and of the receiver's delays of their signals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterSystemOffset {
    /// The system.
    pub system: Constellation,
    /// The offset, s.
    pub offset_s: f64,
    /// Its standard deviation, s.
    pub sigma_s: f64,
}

/// A position solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Fix {
    /// GPS time of reception (corrected by the clock bias).
    pub time: GpsTime,
    /// Index of the sample that the fix refers to, counted from the start of the stream.
    pub sample: f64,
    /// Position, m, ECEF.
    pub position_m: Vector3<f64>,
    /// Velocity, m/s, ECEF, if Dopplers gave it.
    pub velocity_mps: Option<Vector3<f64>>,
    /// Receiver clock minus the time of the reference system in terms of GPS time, s (against the epoch's nominal receive time); none where
    /// Dopplers alone were used.
    pub clock_bias_s: Option<f64>,
    /// The system whose time the bias is against: GPS, to which QZSS and SBAS belong, if one of its satellites is used,
    /// else Galileo, BeiDou, GLONASS.
    pub reference: Constellation,
    /// The other systems that are used.
    pub offsets: Vec<InterSystemOffset>,
    /// Rate of the receiver clock, s/s.
    pub clock_drift_sps: Option<f64>,
    /// Covariance of the position (east, north, up), m^2.
    pub covariance: Matrix3<f64>,
    /// Standard deviation of the clock bias, s, where that is.
    pub clock_bias_sigma_s: Option<f64>,
    /// Position dilution of precision of ranges: sqrt of the trace of the position part of (H^T H)^-1.
    pub pdop: f64,
    /// Horizontal dilution of precision.
    pub hdop: f64,
    /// Vertical dilution of precision.
    pub vdop: f64,
    /// Satellites used, in the order of [`Sv`], with their residuals.
    pub residuals: Vec<Residual>,
    /// Satellites excluded as faulty.
    pub excluded: Vec<Sv>,
    /// Other satellites that were not used, with reasons.
    pub unused: Vec<Dropped>,
    /// How far redundant observations prove it.
    pub integrity: Integrity,
    /// Why it is not proved, where it is not.
    pub doubt: Option<Doubt>,
    /// Protection level; none where a fault more than the observations show would leave too few satellites.
    pub protection: Option<ProtectionLevel>,
    /// How the observations came about.
    pub method: FixMethod,
    /// How the time was searched for, where it was.
    pub time_search: Option<TimeSearch>,
    /// Where the full model started, and by what solver.
    pub start: FixStart,
    /// Other places that explain the observations as well, m, ECEF: four satellites can have two.
    pub alternatives_m: Vec<Vector3<f64>>,
    /// Linearisations from the Earth's centre to convergence.
    pub iterations: usize,
}
