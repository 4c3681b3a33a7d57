//! Antenna arrays: where their elements are, and how they answer a plane wave.

use super::constants::L1_WAVELENGTH;
use nalgebra::{Unit, Vector3};
use num_complex::Complex64;

/// An array of antenna elements that all see the same sky.
///
/// Positions are east, north and up of the array's origin (or right, forward and up of a platform,
/// where the array is turned with it), in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct AntennaArray {
    /// Element positions, m.
    pub elements_m: Vec<Vector3<f64>>,
    /// What each element makes of a wave beyond the geometry: gain and phase, 1 when calibrated.
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
        let turn = |p: &Vector3<f64>| std::f64::consts::TAU * p.dot(towards) / L1_WAVELENGTH;
        self.elements_m.iter().zip(&self.gains).map(|(p, g)| g * Complex64::cis(turn(p))).collect()
    }
}
