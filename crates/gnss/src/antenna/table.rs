//! An array in TOML.

use super::{AntennaArray, Attitude};
use crate::checked;
use crate::signal::L1_WAVELENGTH;
use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Elements that a capture may have.
const MOST: usize = 1024;
/// No element is farther than this from the origin, m: the model is one plane wave with one Doppler.
const FARTHEST_M: f64 = 1000.0;

/// The keys of an array file, and of `[array]` in a scenario.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ArrayTable {
    #[serde(skip_serializing_if = "String::is_empty")]
    pub description: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    elements_m: Option<Vec<[f64; 3]>>,
    #[serde(skip_serializing)]
    linear: Option<Linear>,
    #[serde(skip_serializing)]
    rectangular: Option<Rectangular>,
    #[serde(skip_serializing)]
    circular: Option<Circular>,
    pub attitude: Attitude,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub errors: Option<Errors>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Linear {
    count: usize,
    #[serde(default = "half", deserialize_with = "checked::positive")]
    spacing_wavelengths: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rectangular {
    columns: usize,
    rows: usize,
    #[serde(default = "half", deserialize_with = "checked::positive")]
    spacing_wavelengths: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Circular {
    count: usize,
    #[serde(deserialize_with = "checked::positive")]
    radius_wavelengths: f64,
}

fn half() -> f64 {
    0.5
}

/// Gain and phase of the elements: lists, or normal random numbers of these standard deviations.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Errors {
    #[serde(skip_serializing_if = "Option::is_none")]
    gain_db: Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    phase_deg: Option<Vec<f64>>,
    #[serde(skip_serializing, deserialize_with = "checked::not_negative")]
    gain_rms_db: f64,
    #[serde(skip_serializing, deserialize_with = "checked::not_negative")]
    phase_rms_deg: f64,
    #[serde(skip_serializing)]
    seed: u64,
}

/// Factors of the channels in a receiver.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Calibration {
    #[serde(skip_serializing_if = "Option::is_none")]
    gain_db: Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    phase_deg: Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    weights: Option<Vec<[f64; 2]>>,
}

/// 10^(dB / 20) exp(j phase) for each element.
fn weights(
    key: &str,
    count: usize,
    gain_db: &Option<Vec<f64>>,
    phase_deg: &Option<Vec<f64>>,
) -> Result<Vec<Complex64>, String> {
    let column = |name: &str, list: &Option<Vec<f64>>| match list {
        None => Ok(vec![0.0; count]),
        Some(list) if list.len() != count => Err(format!(
            "{key}.{name} has {} values for {count} elements: give one for each",
            list.len()
        )),
        Some(list) if !list.iter().all(|v| v.is_finite() && v.abs() <= 1e6) => {
            Err(format!("{key}.{name}: each must be a number of at most 1e6"))
        }
        Some(list) => Ok(list.clone()),
    };
    let (gain, phase) = (column("gain_db", gain_db)?, column("phase_deg", phase_deg)?);
    if let Some(g) = gain.iter().find(|g| g.abs() > 200.0) {
        return Err(format!("{key}.gain_db: {g} must be -200 to 200 dB"));
    }
    let weight = |(g, p): (&f64, &f64)| Complex64::from_polar(10f64.powf(g / 20.0), p.to_radians());
    Ok(gain.iter().zip(&phase).map(weight).collect())
}

impl Errors {
    pub fn resolve(&self, count: usize) -> Result<Vec<Complex64>, String> {
        let drawn = self.gain_rms_db > 0.0 || self.phase_rms_deg > 0.0;
        if !drawn {
            return weights("errors", count, &self.gain_db, &self.phase_deg);
        }
        if self.gain_db.is_some() || self.phase_deg.is_some() {
            return Err(
                "errors: give lists (gain_db, phase_deg) or standard deviations (gain_rms_db, \
                        phase_rms_deg, seed), not both"
                    .into(),
            );
        }
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut draw = |rms: f64| -> f64 {
            let normal: f64 = StandardNormal.sample(&mut rng);
            rms * normal
        };
        let (gain, phase) =
            (0..count).map(|_| (draw(self.gain_rms_db), draw(self.phase_rms_deg))).unzip();
        weights("errors", count, &Some(gain), &Some(phase))
    }
}

impl Calibration {
    pub fn resolve(&self, count: usize) -> Result<Vec<Complex64>, String> {
        let Some(list) = &self.weights else {
            return weights("calibration", count, &self.gain_db, &self.phase_deg);
        };
        if self.gain_db.is_some() || self.phase_deg.is_some() {
            return Err(
                "calibration: give weights, or gain_db and phase_deg, not all of them".into()
            );
        }
        if list.len() != count {
            return Err(format!(
                "calibration.weights has {} values for {count} elements: give [re, im] for each",
                list.len()
            ));
        }
        if !list.iter().flatten().all(|v| v.is_finite()) {
            return Err("calibration.weights: each must be two finite numbers [re, im]".into());
        }
        Ok(list.iter().map(|&[re, im]| Complex64::new(re, im)).collect())
    }
}

impl ArrayTable {
    /// The one geometry that is given.
    pub fn elements(&self) -> Result<AntennaArray, String> {
        let within = |count: Option<usize>| match count {
            Some(1..=MOST) => Ok(()),
            _ => Err(format!("the number of elements must be 1 to {MOST}")),
        };
        let array = match (&self.elements_m, &self.linear, &self.rectangular, &self.circular) {
            (Some(list), None, None, None) => {
                within(Some(list.len()))?;
                AntennaArray::new(list.iter().map(|&p| p.into()).collect())
            }
            (None, Some(l), None, None) => {
                within(Some(l.count))?;
                AntennaArray::linear(l.count, l.spacing_wavelengths * L1_WAVELENGTH)
            }
            (None, None, Some(r), None) => {
                within(r.columns.checked_mul(r.rows))?;
                let spacing_m = r.spacing_wavelengths * L1_WAVELENGTH;
                AntennaArray::rectangular(r.columns, r.rows, spacing_m)
            }
            (None, None, None, Some(c)) => {
                within(Some(c.count))?;
                AntennaArray::circular(c.count, c.radius_wavelengths * L1_WAVELENGTH)
            }
            _ => {
                return Err("give one of elements_m, linear, rectangular and circular".into());
            }
        };
        match array.elements_m.iter().find(|p| !p.iter().all(|v| v.abs() <= FARTHEST_M)) {
            Some(p) => Err(format!(
                "an element at [{}, {}, {}]: positions are metres within {FARTHEST_M} of the origin",
                p.x, p.y, p.z
            )),
            None => Ok(array),
        }
    }
    /// The table that lists elements, errors and weights one by one.
    pub fn listed(
        description: String,
        array: &AntennaArray,
        attitude: Attitude,
        errors: &[Complex64],
        calibration: Option<Vec<Complex64>>,
    ) -> Self {
        let listed = Errors {
            gain_db: Some(errors.iter().map(|g| 20.0 * g.norm().log10()).collect()),
            phase_deg: Some(errors.iter().map(|g| g.arg().to_degrees()).collect()),
            ..Errors::default()
        };
        let pairs = |list: Vec<Complex64>| list.iter().map(|w| [w.re, w.im]).collect();
        let calibration = calibration
            .map(|list| Calibration { weights: Some(pairs(list)), ..Calibration::default() });
        Self {
            description,
            elements_m: Some(array.elements_m.iter().map(|p| (*p).into()).collect()),
            attitude,
            errors: errors.iter().any(|g| *g != Complex64::ONE).then_some(listed),
            calibration,
            ..Self::default()
        }
    }
}
