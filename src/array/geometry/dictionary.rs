//! Dictionaries: the responses of an array to a list of directions.

use super::{Manifold, Point};
use crate::array::CMat;
use crate::gnss::antenna::AntennaArray;

/// The matrix A (elements x points) whose columns are the responses to `points`, not normalised.
pub fn dictionary(manifold: &Manifold, points: &[Point]) -> CMat {
    let columns: Vec<_> = points.iter().map(|p| manifold.response(*p)).collect();
    CMat::from_fn(manifold.elements(), points.len(), |m, l| columns[l][m])
}

/// Points of a linear array: every degree from `first` to `last` (deg from broadside), both included.
pub fn degree_grid(first: i32, last: i32) -> Vec<Point> {
    (first..=last).map(|deg| [f64::from(deg).to_radians().sin(), 0.0]).collect()
}

/// The dictionary of the paper on JANE (IEEE TVT 72(5), 2023): a uniform linear array of `elements`, half a
/// wavelength apart, over directions of 25 to 55 degrees in steps of one.
pub fn paper_dictionary(elements: usize) -> CMat {
    dictionary(&Manifold::new(AntennaArray::half_wavelength(elements)), &degree_grid(25, 55))
}
