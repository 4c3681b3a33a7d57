//! Observations of one receiver, as JSON.

use super::{NetworkFileError, error};
use crate::LinearModel;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// A receiver's observations of the common parameters.
///
/// ```json
/// {"receiver_bias": true,
///  "observations": [{"coefficients": {"G10": 1.0}, "value": 2.31, "sigma": 0.35}]}
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Whether one unknown constant of the receiver is in all of its observations.
    #[serde(default)]
    pub receiver_bias: bool,
    /// The observations.
    pub observations: Vec<ObservationEntry>,
}

/// One observation: value = sum of coefficients times parameters (+ the receiver's bias) + noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationEntry {
    /// Coefficient of each parameter, by name; the others are 0.
    pub coefficients: BTreeMap<String, f64>,
    /// The observed value.
    pub value: f64,
    /// Its standard deviation, in the same unit.
    pub sigma: f64,
}

impl ModelFile {
    /// Reads a file as the model of these parameters.
    ///
    /// # Errors
    /// [`NetworkFileError`].
    pub fn read(path: &Path, parameters: &[String]) -> Result<LinearModel, NetworkFileError> {
        let text = error::read(path)?;
        let file: Self = serde_json::from_str(&text)
            .map_err(|source| NetworkFileError::Json { path: path.into(), source })?;
        file.model(parameters).map_err(|what| NetworkFileError::Content { path: path.into(), what })
    }

    /// The model of these parameters, or what is wrong with it.
    pub fn model(&self, parameters: &[String]) -> Result<LinearModel, String> {
        let count = self.observations.len();
        let mut design = DMatrix::zeros(count, parameters.len());
        for (row, entry) in self.observations.iter().enumerate() {
            let which = format!("observation {row} (counted from 0)");
            if !(entry.sigma > 0.0 && entry.sigma.is_finite() && entry.value.is_finite()) {
                let (value, sigma) = (entry.value, entry.sigma);
                return Err(format!(
                    "{which}: value {value}, sigma {sigma}: sigma must be positive"
                ));
            }
            for (name, coefficient) in &entry.coefficients {
                let column = parameters.iter().position(|parameter| parameter == name);
                let column = column.ok_or_else(|| {
                    let known = parameters.join(", ");
                    format!("{which}: the network has no parameter '{name}', but {known}")
                })?;
                design[(row, column)] = *coefficient;
            }
        }
        let weights: Vec<f64> = self.observations.iter().map(|o| o.sigma.powi(-2)).collect();
        let values = DVector::from_iterator(count, self.observations.iter().map(|o| o.value));
        Ok(if self.receiver_bias {
            LinearModel::with_receiver_bias(design, values, &weights)
        } else {
            LinearModel::independent(design, values, &weights)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_is_read_and_its_mistakes_are_named() {
        let parameters = ["a".to_owned(), "b".to_owned()];
        let text =
            r#"{"observations": [{"coefficients": {"b": 2.0}, "value": 3.0, "sigma": 0.5}]}"#;
        let file: ModelFile = serde_json::from_str(text).unwrap();
        let model = file.model(&parameters).unwrap();
        assert_eq!(
            (model.design[(0, 1)], model.observations[0], model.weight[(0, 0)]),
            (2.0, 3.0, 4.0)
        );
        let other = file.model(&parameters[..1]).unwrap_err();
        assert!(other.contains("no parameter 'b', but a"), "{other}");
        let mut flat = file.clone();
        flat.observations[0].sigma = 0.0;
        assert!(flat.model(&parameters).unwrap_err().contains("sigma must be positive"));
    }
}
