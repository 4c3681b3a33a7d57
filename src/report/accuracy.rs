//! Errors of fixes against a known position.

use super::summary::{counted, quantile};
use crate::gnss::coordinates::Geodetic;
use crate::position::Fix;
use nalgebra::Vector3;
use serde::Serialize;

/// A known position, or track.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference<'a> {
    /// The position, m, ECEF: one, or that at each fix of the run.
    pub positions_m: Vec<Vector3<f64>>,
    /// Its origin.
    pub source: &'a str,
}

/// Errors of fixes, m.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// Origin of the known position.
    pub reference: String,
    /// The known position, m, ECEF, at the last fix.
    pub reference_ecef_m: [f64; 3],
    /// Half of the fixes are within this distance.
    pub error_50_m: f64,
    /// 95 of 100 fixes are.
    pub error_95_m: f64,
    /// The largest distance.
    pub error_max_m: f64,
    /// Half of the fixes are horizontally within this distance.
    pub horizontal_50_m: f64,
    /// Half of the heights are within this.
    pub vertical_50_m: f64,
    /// Mean error: east, north, up.
    pub mean_enu_m: [f64; 3],
}

impl Accuracy {
    /// The errors of the fixes that count ([`super::counted`]); `None` without fixes.
    pub fn new(fixes: &[Fix], reference: &Reference) -> Option<Self> {
        let truths = reference.positions_m.iter().cycle();
        let proved = counted(fixes).first()?.integrity.is_proved();
        let counts = |(fix, _): &(&Fix, _)| fix.integrity.is_proved() || !proved;
        let pairs: Vec<_> = fixes.iter().zip(truths).filter(counts).collect();
        let error = |(fix, truth_m): &(&Fix, &Vector3<f64>)| {
            Geodetic::from_ecef(truth_m).ecef_to_enu() * (fix.position_m - *truth_m)
        };
        let errors: Vec<Vector3<f64>> = pairs.iter().map(error).collect();
        let truth_m = *pairs.last()?.1;
        let of = |part: fn(&Vector3<f64>) -> f64, q| quantile(errors.iter().map(part).collect(), q);
        let mean: Vector3<f64> = errors.iter().sum::<Vector3<f64>>() / errors.len().max(1) as f64;
        Some(Self {
            reference: reference.source.to_owned(),
            reference_ecef_m: truth_m.into(),
            error_50_m: of(|e| e.norm(), 0.5)?,
            error_95_m: of(|e| e.norm(), 0.95)?,
            error_max_m: of(|e| e.norm(), 1.0)?,
            horizontal_50_m: of(|e| e.xy().norm(), 0.5)?,
            vertical_50_m: of(|e| e.z.abs(), 0.5)?,
            mean_enu_m: mean.into(),
        })
    }
}
