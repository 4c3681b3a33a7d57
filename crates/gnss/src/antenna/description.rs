//! Description of an array: geometry, attitude, errors, calibration.

use super::table::ArrayTable;
use super::{AntennaArray, ArrayError, Attitude};
use crate::signal::L1_WAVELENGTH;
use nalgebra::{Unit, Vector3};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// An antenna array on its platform.
///
/// As TOML (a file of its own, or `[array]` in a scenario; unknown keys are refused):
///
/// ```toml
/// linear = { count = 8, spacing_wavelengths = 0.5 }       # one of these four
/// rectangular = { columns = 2, rows = 2, spacing_wavelengths = 0.5 }
/// circular = { count = 8, radius_wavelengths = 0.5 }
/// elements_m = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]         # right (east), forward (north), up
/// attitude = { yaw_deg = 0.0, pitch_deg = 0.0, roll_deg = 0.0 }
/// errors = { gain_db = [0.0, 0.3], phase_deg = [0.0, 5.0] }        # or drawn:
/// errors = { gain_rms_db = 0.5, phase_rms_deg = 5.0, seed = 1 }
/// calibration = { gain_db = [0.0, -0.3], phase_deg = [0.0, -5.0] } # or weights = [[1.0, 0.0], ..]
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ArrayTable", into = "ArrayTable")]
pub struct ArrayDescription {
    /// Name.
    pub description: String,
    /// The elements, ideal (all gains 1): right, forward and up of the platform.
    pub array: AntennaArray,
    /// Attitude of the platform.
    pub attitude: Attitude,
    /// Gain and phase of each element beyond the geometry: a simulation applies them, a receiver is not given
    /// them.
    pub errors: Vec<Complex64>,
    /// Factor of each channel in a receiver.
    pub calibration: Option<Vec<Complex64>>,
}

impl From<AntennaArray> for ArrayDescription {
    /// An array on a level platform with forward to the north; its gains are errors.
    fn from(array: AntennaArray) -> Self {
        let AntennaArray { elements_m, gains } = array;
        Self {
            description: String::new(),
            array: AntennaArray::new(elements_m),
            attitude: Attitude::default(),
            errors: gains,
            calibration: None,
        }
    }
}

impl TryFrom<ArrayTable> for ArrayDescription {
    type Error = String;

    fn try_from(table: ArrayTable) -> Result<Self, String> {
        let array = table.elements()?;
        let count = array.len();
        let errors = table.errors.unwrap_or_default().resolve(count)?;
        let calibration = table.calibration.map(|c| c.resolve(count)).transpose()?;
        let (description, attitude) = (table.description, table.attitude);
        Ok(Self { description, array, attitude, errors, calibration })
    }
}

impl From<ArrayDescription> for ArrayTable {
    fn from(from: ArrayDescription) -> Self {
        let ArrayDescription { description, array, attitude, errors, calibration } = from;
        Self::listed(description, &array, attitude, &errors, calibration)
    }
}

impl ArrayDescription {
    /// An array by its short form: `ula:8`, `ula:8:0.5`, `ura:2x2`, `ura:2x2:0.5`,
    /// `uca:8:0.5` (elements; spacing or radius in wavelengths, half a wavelength of spacing by default),
    /// or the path of a `.toml` file.
    ///
    /// # Errors
    /// When it is none of these, or the file is wrong: with line and column.
    pub fn parse(text: &str) -> Result<Self, ArrayError> {
        if text.ends_with(".toml") {
            return Self::read(text.as_ref());
        }
        short(text)
            .map(Self::from)
            .map_err(|reason| ArrayError::Short { text: text.to_owned(), reason })
    }

    /// Reads an array file.
    ///
    /// # Errors
    /// When it cannot be read, is no TOML, has an unknown key, or a value outside its range.
    pub fn read(path: &Path) -> Result<Self, ArrayError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ArrayError::Read { path: path.into(), source })?;
        toml::from_str(&text).map_err(|source| ArrayError::Toml {
            name: path.display().to_string(),
            source: Box::new(source),
        })
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.array.len()
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.array.is_empty()
    }

    /// The ideal array in the frame east, north, up, as a receiver assumes it after calibration. Directions of
    /// its manifold are then azimuths and elevations.
    pub fn in_enu(&self) -> AntennaArray {
        let turn = self.attitude.to_enu();
        AntennaArray::new(self.array.elements_m.iter().map(|p| turn * p).collect())
    }

    /// The true array, in the frame east, north, up: the errors are its gains.
    pub fn real_in_enu(&self) -> AntennaArray {
        AntennaArray { gains: self.errors.clone(), ..self.in_enu() }
    }

    /// The description for a receiver: all but the errors.
    pub fn without_errors(&self) -> Self {
        Self { errors: vec![Complex64::ONE; self.len()], ..self.clone() }
    }

    /// A direction (east, north, up) in the frame of the platform (right, forward, up).
    pub fn to_platform(&self, towards: &Unit<Vector3<f64>>) -> Unit<Vector3<f64>> {
        Unit::new_normalize(self.attitude.to_enu().transpose() * towards.into_inner())
    }
}

/// `ula:8`, `ula:8:0.5`, `ura:2x2`, `uca:8:0.5`.
fn short(text: &str) -> Result<AntennaArray, String> {
    let mut parts = text.split(':');
    let kind = parts.next().unwrap_or_default();
    let (size, length, rest) = (parts.next(), parts.next(), parts.next());
    if rest.is_some() {
        return Err("it has too many parts".into());
    }
    let count = |text: &str| match text.parse() {
        Ok(n @ 1..=1024) => Ok(n),
        _ => Err(format!("'{text}' is no number of elements from 1 to 1024")),
    };
    let metres = |text: &str| match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v <= 100.0 => Ok(v * L1_WAVELENGTH),
        _ => Err(format!("'{text}' is no length in wavelengths (above 0, at most 100)")),
    };
    let spacing = || metres(length.unwrap_or("0.5"));
    let size = size.ok_or("it is no array")?;
    match kind {
        "ula" => Ok(AntennaArray::linear(count(size)?, spacing()?)),
        "ura" => {
            let (columns, rows) = size.split_once('x').ok_or("'ura' needs columns x rows")?;
            let (columns, rows) = (count(columns)?, count(rows)?);
            count(&(columns * rows).to_string())?;
            Ok(AntennaArray::rectangular(columns, rows, spacing()?))
        }
        "uca" => {
            let radius = length.ok_or("'uca' needs a radius")?;
            Ok(AntennaArray::circular(count(size)?, metres(radius)?))
        }
        _ => Err(format!("'{kind}' is no kind of array")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn table(text: &str) -> Result<ArrayDescription, String> {
        toml::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn short_forms_and_toml_say_the_same() {
        for (short, toml) in [
            ("ula:8", "linear = { count = 8 }"),
            ("ula:3:0.4", "linear = { count = 3, spacing_wavelengths = 0.4 }"),
            ("ura:3x2", "rectangular = { columns = 3, rows = 2, spacing_wavelengths = 0.5 }"),
            ("uca:5:0.7", "circular = { count = 5, radius_wavelengths = 0.7 }"),
        ] {
            let named = ArrayDescription::parse(short).unwrap();
            assert_eq!(named, table(toml).unwrap(), "{short}");
            // What is written equals what was read.
            assert_eq!(named, table(&toml::to_string(&named).unwrap()).unwrap());
        }
        let d = L1_WAVELENGTH / 2.0;
        let square = ArrayDescription::parse("ura:2x2").unwrap().array.elements_m;
        let expected = [[0.0, 0.0], [d, 0.0], [0.0, d], [d, d]];
        assert_eq!(square, expected.map(|[e, n]| Vector3::new(e, n, 0.0)));
        let circle = ArrayDescription::parse("uca:4:0.5").unwrap().array.elements_m;
        assert!((circle[0] - Vector3::new(0.0, d, 0.0)).norm() < 1e-15);
        assert!((circle[1] - Vector3::new(d, 0.0, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn errors_and_attitude_enter_the_response_and_calibration_undoes_errors() {
        let text = "linear = { count = 2 }\nattitude = { yaw_deg = 90.0 }\n\
                    errors = { gain_db = [0.0, 6.0], phase_deg = [0.0, 30.0] }\n\
                    calibration = { gain_db = [0.0, -6.0], phase_deg = [0.0, -30.0] }";
        let array = table(text).unwrap();
        // Forward is east, so right is south: from azimuth 180 - 30, elevation 0, the wave
        // reaches the second element first by d cos 30.
        let towards = super::super::direction(150f64.to_radians(), 0.0);
        let response = array.real_in_enu().response(&towards);
        let phase = PI * 30f64.to_radians().cos() + 30f64.to_radians();
        let expected = Complex64::from_polar(10f64.powf(0.3), phase);
        assert!((response[0] - 1.0).norm() < 1e-14 && (response[1] - expected).norm() < 1e-14);
        let calibrated = response[1] * array.calibration.as_ref().unwrap()[1];
        let ideal = array.in_enu().response(&towards)[1];
        assert!((calibrated - ideal).norm() < 1e-14);
        let cosine = array.to_platform(&towards).dot(&array.array.axis().unwrap());
        assert!((cosine - 30f64.to_radians().cos()).abs() < 1e-14);
        let back = table(&toml::to_string(&array).unwrap()).unwrap();
        assert!((back.errors[1] - array.errors[1]).norm() < 1e-14);
        assert_eq!(back.calibration, array.calibration);
    }

    #[test]
    fn drawn_errors_have_the_given_standard_deviations_and_follow_the_seed() {
        let draw = |seed: u64| {
            let errors = format!("{{ gain_rms_db = 0.5, phase_rms_deg = 5.0, seed = {seed} }}");
            table(&format!("linear = {{ count = 1000 }}\nerrors = {errors}")).unwrap().errors
        };
        let rms = |list: Vec<f64>| (list.iter().map(|v| v * v).sum::<f64>() / 1000.0).sqrt();
        let errors = draw(1);
        // The standard deviation of an rms of 1000 draws is 1 / sqrt(2000) = 2.2 %: four of it.
        let gain = rms(errors.iter().map(|g| 20.0 * g.norm().log10()).collect());
        let phase = rms(errors.iter().map(|g| g.arg().to_degrees()).collect());
        assert!((gain / 0.5 - 1.0).abs() < 0.09 && (phase / 5.0 - 1.0).abs() < 0.09);
        assert!(errors == draw(1) && errors != draw(2));
    }

    #[test]
    fn what_is_no_array_is_refused_with_reason_and_line() {
        for (text, reason) in [
            ("ula", "it is no array"),
            ("ula:0", "'0' is no number of elements"),
            ("ula:8:0.5:1", "too many parts"),
            ("ula:8:-1", "'-1' is no length"),
            ("ura:22", "columns x rows"),
            ("ura:100x100", "'10000' is no number"),
            ("uca:8", "needs a radius"),
            ("yagi:8", "'yagi' is no kind"),
            ("none.toml", "reading array 'none.toml'"),
        ] {
            let message = ArrayDescription::parse(text).unwrap_err().to_string();
            assert!(message.contains(reason), "{text}: {message}");
        }
        let line = "linear = { count = 2 }\n";
        for (text, reason) in [
            ("", "one of elements_m, linear"),
            ("linear = { count = 2 }\ncircular = { count = 2, radius_wavelengths = 1 }", "one of"),
            ("linear = { count = 0 }", "1 to 1024"),
            ("linear = { number = 2 }", "unknown field `number`"),
            ("\nlinear = { count = 2, spacing_wavelengths = 0.0 }", "line 2"),
            ("elements_m = [[0, 0, 0], [1e9, 0, 0]]", "within 1000"),
            ("elements_m = [[0, 0, nan]]", "within 1000"),
            (&format!("{line}attitude = {{ yaw_deg = inf }}"), "line 2"),
            (&format!("{line}errors = {{ gain_db = [1.0] }}"), "1 values for 2 elements"),
            (&format!("{line}errors = {{ gain_db = [1, 2], gain_rms_db = 1 }}"), "not both"),
            (&format!("{line}errors = {{ gain_rms_db = -1 }}"), "0 or above"),
            (&format!("{line}calibration = {{ weights = [[1, 0]] }}"), "[re, im] for each"),
            (&format!("{line}calibration = {{ weights = [], gain_db = [] }}"), "not all of them"),
        ] {
            let message = table(text).unwrap_err();
            assert!(message.contains(reason), "{text}: {message}");
        }
    }
}
