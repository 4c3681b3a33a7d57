//! Figures of several reports: statistics of the fixes, and the satellites of the last fix.

use super::Run;
use crate::gnss::Sv;
use crate::gnss::coordinates::Geodetic;
use crate::gnss::signal::L1_CENTRE_HZ;
use crate::position::{Fix, Residual};
use nalgebra::Vector3;

/// A satellite of the last fix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SatelliteInView {
    /// The satellite.
    pub sv: Sv,
    /// Azimuth, rad from north over east.
    pub azimuth: f64,
    /// Elevation, rad.
    pub elevation: f64,
    /// Carrier-to-noise density at the last epoch with the satellite, dB-Hz.
    pub cn0_dbhz: Option<f64>,
}

/// The satellites of the last fix that counts, in the order of [`Sv`].
pub fn satellites_in_view(run: &Run) -> Vec<SatelliteInView> {
    let cn0 = |sv: Sv| {
        let newest = run.epochs.iter().rev().flat_map(|e| &e.observations).find(|o| o.sv() == sv);
        match newest {
            Some(observation) => observation.cn0_dbhz,
            None => run.acquisitions.iter().find(|a| a.sv() == sv).map(|a| a.cn0_dbhz),
        }
    };
    let entry = |r: &Residual| {
        let (sv, azimuth, elevation) = (r.sv, r.azimuth, r.elevation);
        SatelliteInView { sv, azimuth, elevation, cn0_dbhz: cn0(sv) }
    };
    counted(run.fixes).last().map_or(Vec::new(), |fix| fix.residuals.iter().map(entry).collect())
}

/// The positions that count: those that redundant observations prove; all, where none is proved.
pub fn counted(fixes: &[Fix]) -> Vec<&Fix> {
    let proved: Vec<&Fix> = fixes.iter().filter(|fix| fix.integrity.is_proved()).collect();
    if proved.is_empty() { fixes.iter().collect() } else { proved }
}

/// Speed above which a receiver is taken to move, m/s: five standard deviations of a velocity at 30 dB-Hz.
const MOVING_MPS: f64 = 0.5;
/// Spread, in standard deviations of a fix, that only motion explains.
const MOVING_SIGMAS: f64 = 10.0;

/// Statistics of the fixes of a run that count ([`counted`]) around their median.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Number of fixes that count.
    pub fixes: usize,
    /// Whether they are proved.
    pub proved: bool,
    /// First fix, s after the first sample.
    pub first_fix_s: f64,
    /// Whether the receiver moves: by its median speed, or without velocities by what the standard deviations do not
    /// explain of the spread.
    pub moving: bool,
    /// What stands for all fixes, m, ECEF: their median, or the last of a moving receiver.
    pub place_m: Vector3<f64>,
    /// Median of each coordinate, m, ECEF.
    pub median_m: Vector3<f64>,
    /// East, north and up of each fix from the median, m.
    pub offsets_m: Vec<Vector3<f64>>,
    /// Half of the fixes are horizontally within this distance of the median, m.
    pub horizontal_50_m: f64,
    /// 95 of 100 fixes are.
    pub horizontal_95_m: f64,
    /// Half of the heights are within this distance of the median, m.
    pub vertical_50_m: f64,
    /// 95 of 100 heights are.
    pub vertical_95_m: f64,
    /// Median speed, m/s, where velocities are known.
    pub speed_mps: Option<f64>,
    /// Median PDOP.
    pub pdop: f64,
}

impl Summary {
    /// The statistics of the fixes of a stream of `rate_hz`; `None` without fixes.
    pub fn new(fixes: &[Fix], rate_hz: f64) -> Option<Self> {
        let fixes = counted(fixes);
        let first = fixes.first()?;
        let coordinate = |k: usize| quantile(fixes.iter().map(|f| f.position_m[k]).collect(), 0.5);
        let median_m = Vector3::new(coordinate(0)?, coordinate(1)?, coordinate(2)?);
        let to_enu = Geodetic::from_ecef(&median_m).ecef_to_enu();
        let offsets_m: Vec<_> = fixes.iter().map(|f| to_enu * (f.position_m - median_m)).collect();
        let horizontal = |q| quantile(offsets_m.iter().map(|o| o.xy().norm()).collect(), q);
        let vertical = |q| quantile(offsets_m.iter().map(|o| o.z.abs()).collect(), q);
        let speeds = fixes.iter().filter_map(|f| f.velocity_mps).map(|v| v.norm()).collect();
        let speed_mps = quantile(speeds, 0.5);
        let sigmas = fixes.iter().map(|f| f.covariance.trace().max(0.0).sqrt()).collect();
        let moving = match speed_mps {
            Some(speed_mps) => speed_mps > MOVING_MPS,
            None => horizontal(0.95)? > MOVING_SIGMAS * quantile(sigmas, 0.5)?,
        };
        Some(Self {
            moving,
            place_m: if moving { fixes.last()?.position_m } else { median_m },
            fixes: fixes.len(),
            proved: first.integrity.is_proved(),
            first_fix_s: first.sample / rate_hz,
            median_m,
            horizontal_50_m: horizontal(0.5)?,
            horizontal_95_m: horizontal(0.95)?,
            vertical_50_m: vertical(0.5)?,
            vertical_95_m: vertical(0.95)?,
            speed_mps,
            pdop: quantile(fixes.iter().map(|f| f.pdop).collect(), 0.5)?,
            offsets_m,
        })
    }
}

/// How the receiver's oscillators run.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Oscillators {
    /// Rate of the sampling clock against the stated one, parts per million: the slope of the clock's bias.
    pub sample_clock_ppm: f64,
    /// By how much all carriers are seen higher than that explains, Hz: the mixer's own offset.
    pub carrier_offset_hz: f64,
}

impl Oscillators {
    /// From the fixes that count; none of fewer than five, or where their clocks are not known.
    pub fn new(fixes: &[Fix]) -> Option<Self> {
        let fixes = counted(fixes);
        let first = fixes.first().filter(|_| fixes.len() >= 5)?;
        let points = fixes.iter().map(|f| Some((f.time - first.time, f.clock_bias_s?)));
        let points: Vec<(f64, f64)> = points.collect::<Option<_>>()?;
        let count = points.len() as f64;
        let mean = |part: fn(&(f64, f64)) -> f64| points.iter().map(part).sum::<f64>() / count;
        let (t, b) = (mean(|p| p.0), mean(|p| p.1));
        let products: f64 = points.iter().map(|p| (p.0 - t) * (p.1 - b)).sum();
        let squares: f64 = points.iter().map(|p| (p.0 - t).powi(2)).sum();
        let slope = products / squares;
        let drifts: Option<Vec<f64>> = fixes.iter().map(|f| f.clock_drift_sps).collect();
        let drift = quantile(drifts?, 0.5)?;
        slope.is_finite().then_some(Self {
            sample_clock_ppm: slope * 1e6,
            carrier_offset_hz: (slope - drift) * L1_CENTRE_HZ,
        })
    }
}

/// The `q` quantile by linear interpolation between order statistics, none of an empty list.
pub(super) fn quantile(mut values: Vec<f64>, q: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let at = q * values.len().checked_sub(1)? as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    Some(values[low] + (values[high] - values[low]) * at.fract())
}
