//! The `sdr-rx/1` JSON record. A field that does not apply is absent.

use super::array_sky::{ArraySkyRecord, DirectionRecord, directions};
use super::{Accuracy, Input, Oscillators, Run};
use crate::acquisition::Acquisition;
use crate::capture::StreamInfo;
use crate::front_end::{ImpulseReport, Interferer};
use crate::gnss::Sv;
use crate::gnss::coordinates::Geodetic;
use crate::gnss::message::sbas;
use crate::position::{Doubt, Fix, FixMethod, Integrity, InterSystemOffset, ProtectionLevel};
use serde::Serialize;

/// The whole record of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Document {
    schema: &'static str,
    version: &'static str,
    #[serde(skip_serializing_if = "serde_json::Value::is_null")]
    options: serde_json::Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    capture: Capture,
    #[serde(skip_serializing_if = "Option::is_none")]
    noise: Option<ImpulseReport>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    interference: Vec<Interferer>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sky: Option<ArraySkyRecord>,
    acquisitions: Vec<AcquisitionRecord>,
    /// The newest message of each type of each SBAS satellite.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sbas: Vec<SbasRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    first_fix_s: Option<f64>,
    fixes: Vec<FixRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    oscillators: Option<Oscillators>,
    #[serde(skip_serializing_if = "Option::is_none")]
    accuracy: Option<Accuracy>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    warnings: Vec<String>,
}

#[derive(Clone, Debug, Serialize)]
struct Capture {
    name: String,
    format: String,
    #[serde(flatten)]
    stream: Option<Stream>,
}

#[derive(Clone, Debug, Serialize)]
struct Stream {
    rate_hz: f64,
    if_hz: f64,
    channels: usize,
    real: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    samples: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    duration_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    start_utc: Option<String>,
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct AcquisitionRecord {
    sv: Sv,
    prn: u8,
    doppler_hz: f64,
    code_phase_chips: f64,
    /// Time from the first sample to the next start of a code period, us in [0, 1000).
    code_offset_us: f64,
    cn0_dbhz: f64,
    statistic: f64,
    false_alarm: f64,
}

/// A message of an SBAS satellite: its type and content.
#[derive(Clone, Debug, Serialize)]
struct SbasRecord {
    sv: Sv,
    #[serde(flatten)]
    message: sbas::SbasMessage,
}

/// A solver that did not lead to a fix, and why.
#[derive(Clone, Debug, Serialize)]
struct FailedSolverRecord {
    solver: &'static str,
    cause: String,
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct FixRecord {
    gps_week: i32,
    tow_s: f64,
    utc: String,
    sample: f64,
    lat_deg: f64,
    lon_deg: f64,
    /// Above the WGS 84 ellipsoid.
    height_m: f64,
    ecef_m: [f64; 3],
    /// ECEF.
    #[serde(skip_serializing_if = "Option::is_none")]
    velocity_mps: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock_bias_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock_bias_sigma_s: Option<f64>,
    /// Letter of the system whose time the bias is against, and the other systems' clocks against its one.
    reference_system: char,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    system_offsets: Vec<OffsetRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock_drift_sps: Option<f64>,
    satellites: Vec<Sv>,
    method: FixMethod,
    /// The solver that led from the Earth's centre to where the full model started, and its iterations.
    solver: &'static str,
    start_iterations: usize,
    /// The solver that was asked for, where another one took over, and why.
    #[serde(skip_serializing_if = "Option::is_none")]
    failed_solver: Option<FailedSolverRecord>,
    /// Where the time of the fix was searched: length of the time window, and expected number of false fixes that
    /// explain the measurements equally well.
    #[serde(skip_serializing_if = "Option::is_none")]
    time_searched_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    false_fixes_expected: Option<f64>,
    iterations: usize,
    /// East, north, up.
    sigma_m: [f64; 3],
    pdop: f64,
    hdop: f64,
    vdop: f64,
    residuals: Vec<ResidualRecord>,
    /// Directions of the satellites by an array, at the look nearest in time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    directions: Vec<DirectionRecord>,
    /// Other positions that explain the observations equally well, ECEF.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    alternatives_ecef_m: Vec<[f64; 3]>,
    /// Whether redundant observations prove it, and how far the true place may be, m.
    integrity: Integrity,
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<Doubt>,
    #[serde(skip_serializing_if = "Option::is_none")]
    protection: Option<ProtectionLevel>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    excluded: Vec<Sv>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    unused: Vec<UnusedRecord>,
}

/// The receiver's clock against a system's time less that against the reference's.
#[derive(Clone, Debug, Serialize)]
struct OffsetRecord {
    system: char,
    offset_s: f64,
    sigma_s: f64,
}

impl OffsetRecord {
    fn new(offset: &InterSystemOffset) -> Self {
        let &InterSystemOffset { system, offset_s, sigma_s } = offset;
        Self { system: system.letter(), offset_s, sigma_s }
    }
}

/// A satellite that was not used.
#[derive(Clone, Debug, Serialize)]
struct UnusedRecord {
    sv: Sv,
    reason: String,
}

#[derive(Clone, Debug, Serialize)]
struct ResidualRecord {
    sv: Sv,
    range_m: Option<f64>,
    doppler_hz: Option<f64>,
    azimuth_deg: f64,
    elevation_deg: f64,
}

impl Document {
    /// The record of a run.
    pub fn new(run: &Run) -> Self {
        Self {
            schema: "sdr-rx/1",
            version: env!("CARGO_PKG_VERSION"),
            options: run.options.clone(),
            seed: run.seed,
            capture: Capture::new(run.capture, &run.input),
            noise: run.noise.cloned(),
            interference: run.interferers.to_vec(),
            sky: run.sky.map(ArraySkyRecord::new),
            acquisitions: run.acquisitions.iter().map(AcquisitionRecord::new).collect(),
            sbas: run.sbas.iter().map(SbasRecord::new).collect(),
            first_fix_s: run.first_fix_s,
            fixes: run.fixes.iter().map(|f| FixRecord::new(f, directions(run, f.sample))).collect(),
            oscillators: Some(())
                .filter(|()| matches!(run.input, Input::Samples(_)))
                .and_then(|()| Oscillators::new(run.fixes)),
            accuracy: run.reference.as_ref().and_then(|r| Accuracy::new(run.fixes, r)),
            reason: run.reason.map(str::to_owned),
            warnings: run.warnings.to_vec(),
        }
    }
}

impl SbasRecord {
    fn new((sv, message): &(Sv, sbas::SbasMessage)) -> Self {
        Self { sv: *sv, message: message.clone() }
    }
}

impl Capture {
    fn new(name: &str, input: &Input) -> Self {
        let (format, stream) = match input {
            Input::Samples(stream) => (stream.format.clone(), Some(Stream::new(stream))),
            Input::Observations { version } => (format!("RINEX {version:.2}"), None),
        };
        Self { name: name.to_owned(), format, stream }
    }
}

impl Stream {
    fn new(stream: &StreamInfo) -> Self {
        Self {
            rate_hz: stream.rate_hz,
            if_hz: stream.if_hz,
            channels: stream.channels,
            real: stream.real,
            samples: stream.samples,
            duration_s: stream.samples.map(|n| n as f64 / stream.rate_hz),
            start_utc: stream.start_time.map(|t| t.utc_iso()),
        }
    }
}

impl AcquisitionRecord {
    pub(super) fn new(a: &Acquisition) -> Self {
        Self {
            sv: a.sv(),
            prn: a.sv().prn(),
            doppler_hz: a.doppler_hz,
            code_phase_chips: a.code_phase_chips,
            code_offset_us: a.code_offset_s() * 1e6,
            cn0_dbhz: a.cn0_dbhz,
            statistic: a.statistic,
            false_alarm: a.false_alarm,
        }
    }
}

impl FixRecord {
    pub(super) fn new(fix: &Fix, directions: Vec<DirectionRecord>) -> Self {
        let position = Geodetic::from_ecef(&fix.position_m);
        let residuals = fix.residuals.iter().map(|r| ResidualRecord {
            sv: r.sv,
            range_m: r.range_m,
            doppler_hz: r.doppler_hz,
            azimuth_deg: r.azimuth.to_degrees(),
            elevation_deg: r.elevation.to_degrees(),
        });
        Self {
            gps_week: fix.time.week(),
            tow_s: fix.time.tow(),
            utc: fix.time.utc_iso(),
            sample: fix.sample,
            lat_deg: position.latitude.to_degrees(),
            lon_deg: position.longitude.to_degrees(),
            height_m: position.height,
            ecef_m: fix.position_m.into(),
            velocity_mps: fix.velocity_mps.map(Into::into),
            clock_bias_s: fix.clock_bias_s,
            clock_bias_sigma_s: fix.clock_bias_sigma_s,
            reference_system: fix.reference.letter(),
            system_offsets: fix.offsets.iter().map(OffsetRecord::new).collect(),
            clock_drift_sps: fix.clock_drift_sps,
            satellites: fix.residuals.iter().map(|r| r.sv).collect(),
            method: fix.method,
            solver: fix.start.solver,
            start_iterations: fix.start.iterations,
            failed_solver: fix.start.failed.as_ref().map(|failed| FailedSolverRecord {
                solver: failed.solver,
                cause: failed.cause.to_string(),
            }),
            time_searched_s: fix.time_search.map(|s| s.searched_s),
            false_fixes_expected: fix.time_search.map(|s| s.false_expected),
            iterations: fix.iterations,
            sigma_m: std::array::from_fn(|k| fix.covariance[(k, k)].max(0.0).sqrt()),
            pdop: fix.pdop,
            hdop: fix.hdop,
            vdop: fix.vdop,
            residuals: residuals.collect(),
            directions,
            alternatives_ecef_m: fix
                .alternatives_m
                .iter()
                .map(|&position| position.into())
                .collect(),
            integrity: fix.integrity,
            doubt: fix.doubt,
            protection: fix.protection,
            excluded: fix.excluded.clone(),
            unused: (fix.unused.iter())
                .map(|d| UnusedRecord { sv: d.sv, reason: d.reason.to_string() })
                .collect(),
        }
    }
}

/// The record as one line of JSON with a line end. Numbers that are not finite become `null`.
pub fn json(run: &Run) -> String {
    // Serialising plain structs with string keys cannot fail.
    serde_json::to_string(&Document::new(run)).expect("plain data serialises") + "\n"
}
