//! Antenna arrays: positions of the elements, attitude, and response to a plane wave.

mod attitude;
mod description;
mod error;
mod table;

pub use attitude::Attitude;
pub use description::ArrayDescription;
pub use error::ArrayError;

use super::signal::L1_WAVELENGTH;
use nalgebra::{Unit, Vector3};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// An array of antenna elements of equal pattern.
///
/// Positions are east, north and up of the array's origin (or right, forward and up of a platform,
/// where the array is turned with it), in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct AntennaArray {
    /// Element positions, m.
    pub elements_m: Vec<Vector3<f64>>,
    /// Gain and phase of each element beyond the geometry, 1 when calibrated.
    pub gains: Vec<Complex64>,
}

impl AntennaArray {
    /// Calibrated elements at these positions (m).
    pub fn new(elements_m: Vec<Vector3<f64>>) -> Self {
        let gains = vec![Complex64::ONE; elements_m.len()];
        Self { elements_m, gains }
    }

    /// A uniform linear array of `count` elements along east, the first at the origin.
    pub fn linear(count: usize, spacing_m: f64) -> Self {
        Self::new((0..count).map(|m| Vector3::new(m as f64 * spacing_m, 0.0, 0.0)).collect())
    }

    /// The same with half a wavelength of L1 between neighbours: an element's phase is pi sin(theta), with
    /// theta from broadside towards east.
    pub fn half_wavelength(count: usize) -> Self {
        Self::linear(count, L1_WAVELENGTH / 2.0)
    }

    /// A uniform rectangular array: rows of `columns` elements along east, one row after the other towards
    /// north; the first element is the south-western one, at the origin, the second its eastern neighbour.
    pub fn rectangular(columns: usize, rows: usize, spacing_m: f64) -> Self {
        let at = |column: usize, row: usize| {
            Vector3::new(column as f64 * spacing_m, row as f64 * spacing_m, 0.0)
        };
        Self::new((0..rows).flat_map(|r| (0..columns).map(move |c| at(c, r))).collect())
    }

    /// A uniform circular array around the origin: the first element in the north, then over east.
    pub fn circular(count: usize, radius_m: f64) -> Self {
        let at = |m: usize| {
            let (sin, cos) = (TAU * m as f64 / count as f64).sin_cos();
            Vector3::new(radius_m * sin, radius_m * cos, 0.0)
        };
        Self::new((0..count).map(at).collect())
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.elements_m.len()
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.elements_m.is_empty()
    }

    /// Response to a wave from the direction of the unit vector `towards` (in the frame of the positions):
    /// gain x exp(+j 2 pi p.u / lambda) for each element.
    pub fn response(&self, towards: &Unit<Vector3<f64>>) -> Vec<Complex64> {
        let turn = |p: &Vector3<f64>| TAU * p.dot(towards) / L1_WAVELENGTH;
        self.elements_m.iter().zip(&self.gains).map(|(p, g)| g * Complex64::cis(turn(p))).collect()
    }

    /// Direction of the axis of a linear array, from its first element towards its last; none where the
    /// elements lie on no line, or at one position (to a millionth of a wavelength).
    pub fn axis(&self) -> Option<Unit<Vector3<f64>>> {
        let (first, last) = (self.elements_m.first()?, self.elements_m.last()?);
        let axis = Unit::try_new(last - first, 1e-6 * L1_WAVELENGTH)?;
        let off = |p: &Vector3<f64>| (p - first).cross(&axis).norm();
        self.elements_m.iter().all(|p| off(p) < 1e-6 * L1_WAVELENGTH).then_some(axis)
    }
}

/// Unit vector (east, north, up) towards an azimuth from north over east and an elevation, rad.
pub fn direction(azimuth: f64, elevation: f64) -> Unit<Vector3<f64>> {
    let ((sa, ca), (se, ce)) = (azimuth.sin_cos(), elevation.sin_cos());
    Unit::new_normalize(Vector3::new(ce * sa, ce * ca, se))
}
