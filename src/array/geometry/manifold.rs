//! The array manifold: responses over all directions that an array can resolve.
//!
//! A linear array measures only the cosine of the angle between a source and its axis (a cone of directions);
//! any other array measures two direction cosines in its principal plane, the source being on the positive
//! side of that plane. Both are points in the unit interval or disc, in which the phases are linear (van
//! Trees, Optimum Array Processing, 2.2 and 4.1).

use crate::array::CMat;
use crate::gnss::antenna::AntennaArray;
use crate::gnss::signal::L1_WAVELENGTH;
use nalgebra::{Matrix3, Unit, Vector3};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Direction cosines along the array's axes: of a linear array the first alone, sin(theta) with theta from
/// broadside; the second is then 0.
pub type Point = [f64; 2];

/// A direction as angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bearing {
    /// Angle from the broadside of a linear array towards its axis, rad: a cone of directions.
    Cone(f64),
    /// A direction in the frame of the elements' positions, rad.
    Direction {
        /// From north over east.
        azimuth: f64,
        /// Above the horizon.
        elevation: f64,
    },
}

/// All responses of an array.
#[derive(Clone, Debug)]
pub struct Manifold {
    array: AntennaArray,
    /// First axis, second axis, normal.
    axes: [Vector3<f64>; 3],
    dimensions: usize,
    /// Directions that were projected away from the samples: orthonormal columns.
    hidden: Option<CMat>,
}

impl Manifold {
    /// The manifold of an array. An array of one element, or with all elements in one position, has no
    /// dimension: it cannot resolve directions.
    pub fn new(array: AntennaArray) -> Self {
        let count = array.len().max(1) as f64;
        let centre = array.elements_m.iter().sum::<Vector3<f64>>() / count;
        let spread: Matrix3<f64> =
            array.elements_m.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
        let eigen = spread.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        // An extent below a millionth of a wavelength counts as none.
        let flat = (1e-6 * L1_WAVELENGTH).powi(2);
        let extents = order.iter().filter(|&&k| eigen.eigenvalues[k] > flat).count();
        let vector = |k: usize| eigen.eigenvectors.column(order[k]).into_owned();
        let axes = match extents {
            0 => [Vector3::x(), Vector3::y(), Vector3::z()],
            1 => {
                // Along the axis, from the first element towards the last.
                let last = array.elements_m[array.len() - 1] - array.elements_m[0];
                let axis = vector(0) * vector(0).dot(&last).signum();
                [axis, vector(1), vector(2)]
            }
            _ => {
                // The normal points up (of a vertical array: north or east); a volume uses the hemisphere
                // above.
                let normal = if extents == 2 { vector(2) } else { Vector3::z() };
                let lean = [normal.z, normal.y, normal.x];
                let side = lean.into_iter().find(|c| c.abs() > 1e-9).unwrap_or(1.0).signum();
                let normal = normal * side;
                // The first axis lies as near to east as the plane allows (or north where it is east).
                let flattened = |v: Vector3<f64>| v - normal * normal.dot(&v);
                let east = flattened(Vector3::x());
                let first = if east.norm() > 0.1 { east } else { flattened(Vector3::y()) };
                let first = first.normalize();
                [first, normal.cross(&first), normal]
            }
        };
        Self { array, axes, dimensions: extents.min(2), hidden: None }
    }

    /// The manifold for samples from which the span of these orthonormal columns (jammers) was removed.
    pub fn beside(self, hidden: &CMat) -> Self {
        Self { hidden: (hidden.ncols() > 0).then(|| hidden.clone()), ..self }
    }

    fn reduced(&self, response: Vec<Complex64>) -> Vec<Complex64> {
        let Some(hidden) = &self.hidden else { return response };
        let mut left = response.clone();
        for column in hidden.col_iter() {
            let along: Complex64 = column.iter().zip(&response).map(|(h, a)| h.conj() * a).sum();
            left.iter_mut().zip(column.iter()).for_each(|(l, h)| *l -= along * h);
        }
        left
    }

    /// First axis, second axis, and normal, of norm 1.
    pub fn axes(&self) -> [Vector3<f64>; 3] {
        self.axes
    }

    /// The array.
    pub fn array(&self) -> &AntennaArray {
        &self.array
    }

    /// Number of elements.
    pub fn elements(&self) -> usize {
        self.array.len()
    }

    /// Number of coordinates in use: 0, 1 (linear) or 2.
    pub fn dimensions(&self) -> usize {
        self.dimensions
    }

    /// Point of a direction (unit vector towards the source) on the manifold.
    pub fn point(&self, towards: &Unit<Vector3<f64>>) -> Point {
        let cosine = |axis: usize| match axis < self.dimensions {
            true => self.axes[axis].dot(towards),
            false => 0.0,
        };
        [cosine(0), cosine(1)]
    }

    /// A direction of a point: the one on the positive side of the plane (for a linear array: one of the
    /// cone, in the plane of its axis and second axis). Points beyond the unit circle count as on it.
    pub fn towards(&self, point: Point) -> Unit<Vector3<f64>> {
        let reach = point[0].hypot(point[1]).max(1.0);
        let [s, t] = point.map(|p| p / reach);
        let rest = (1.0 - s * s - t * t).max(0.0).sqrt();
        let [first, second, normal] = self.axes;
        let last = if self.dimensions < 2 { second } else { normal };
        let along = if self.dimensions < 2 { first * s } else { first * s + second * t };
        Unit::new_normalize(along + last * rest)
    }

    /// A point as angles.
    pub fn bearing(&self, point: Point) -> Bearing {
        if self.dimensions < 2 {
            return Bearing::Cone(point[0].clamp(-1.0, 1.0).asin());
        }
        let u = self.towards(point);
        Bearing::Direction { azimuth: u.x.atan2(u.y).rem_euclid(TAU), elevation: u.z.asin() }
    }

    /// Response of each element to a wave from a point.
    pub fn response(&self, point: Point) -> Vec<Complex64> {
        self.reduced(self.whole_response(point))
    }

    fn whole_response(&self, point: Point) -> Vec<Complex64> {
        if self.dimensions < 2 {
            // Exactly linear in the coordinate, also beyond the visible interval.
            let turn = |p: &Vector3<f64>| TAU * point[0] * self.axes[0].dot(p) / L1_WAVELENGTH;
            let elements = self.array.elements_m.iter().zip(&self.array.gains);
            return elements.map(|(p, g)| g * Complex64::cis(turn(p))).collect();
        }
        self.array.response(&self.towards(point))
    }

    /// Derivatives of the response by the coordinates.
    pub fn derivatives(&self, point: Point) -> Vec<Vec<Complex64>> {
        let response = self.whole_response(point);
        let [first, second, normal] = self.axes;
        let u = self.towards(point);
        let height = u.dot(&normal).max(1e-3);
        let slope = |axis: usize| {
            // u = s a1 + t a2 + sqrt(1 - s^2 - t^2) n
            let direction = match (self.dimensions, axis) {
                (1, _) => first,
                (_, 0) => first - normal * (point[0] / height),
                _ => second - normal * (point[1] / height),
            };
            let rate = |p: &Vector3<f64>| TAU * direction.dot(p) / L1_WAVELENGTH;
            let elements = self.array.elements_m.iter().zip(&response);
            elements.map(|(p, a)| a * Complex64::new(0.0, rate(p))).collect()
        };
        (0..self.dimensions).map(|axis| self.reduced(slope(axis))).collect()
    }

    /// A grid over the manifold: `per_axis` equal steps over [-1, 1], both ends included, of a plane those
    /// inside the unit circle.
    pub fn grid(&self, per_axis: usize) -> Vec<Point> {
        let at = |k: usize| 2.0 * k as f64 / per_axis.max(1) as f64 - 1.0;
        match self.dimensions {
            0 => vec![[0.0; 2]],
            1 => (0..=per_axis).map(|k| [at(k), 0.0]).collect(),
            _ => (0..=per_axis)
                .flat_map(|i| (0..=per_axis).map(move |k| [at(i), at(k)]))
                .filter(|p| p[0].hypot(p[1]) <= 1.0)
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(azimuth: f64, elevation: f64) -> Unit<Vector3<f64>> {
        let (s, c) = elevation.sin_cos();
        Unit::new_normalize(Vector3::new(c * azimuth.sin(), c * azimuth.cos(), s))
    }

    fn arrays() -> [AntennaArray; 3] {
        let square = [[0.0, 0.0], [0.095, 0.0], [0.0, 0.095], [0.095, 0.095]];
        let cube = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.02], [0.0, 0.1, 0.05], [0.05, 0.03, 0.1]];
        [
            AntennaArray::half_wavelength(5),
            AntennaArray::new(square.map(|[x, y]| Vector3::new(x, y, 0.0)).to_vec()),
            AntennaArray::new(cube.map(Vector3::from).to_vec()),
        ]
    }

    #[test]
    fn the_response_of_a_directions_point_is_the_response_of_the_direction() {
        for (array, dimensions) in arrays().into_iter().zip([1, 2, 2]) {
            let manifold = Manifold::new(array.clone());
            assert_eq!(manifold.dimensions(), dimensions);
            for (azimuth, elevation) in [(0.3, 0.2), (2.0, 1.0), (4.0, 0.1), (6.0, 1.4)] {
                let u = unit(azimuth, elevation);
                let point = manifold.point(&u);
                let pairs = manifold.response(point).into_iter().zip(array.response(&u));
                assert!(pairs.into_iter().all(|(a, b)| (a - b).norm() < 1e-12));
                if let Bearing::Direction { azimuth: a, elevation: e } = manifold.bearing(point) {
                    assert!((a - azimuth).abs() < 1e-9 && (e - elevation).abs() < 1e-9);
                }
            }
        }
        // East of broadside by 30 degrees: half a cycle times one half per element.
        let linear = Manifold::new(AntennaArray::half_wavelength(3));
        let response = linear.response([0.5, 0.0]);
        assert!((response[1] - Complex64::cis(std::f64::consts::FRAC_PI_2)).norm() < 1e-12);
        let Bearing::Cone(angle) = linear.bearing([0.5, 0.0]) else {
            panic!("a linear array measures cones")
        };
        assert!((angle.to_degrees() - 30.0).abs() < 1e-9);
    }

    #[test]
    fn derivatives_are_those_of_the_response() {
        for array in arrays() {
            let manifold = Manifold::new(array);
            let at = [0.3, if manifold.dimensions() == 2 { -0.4 } else { 0.0 }];
            for (axis, slope) in manifold.derivatives(at).iter().enumerate() {
                let h = 1e-6;
                let shifted = |sign: f64| {
                    let mut point = at;
                    point[axis] += sign * h;
                    manifold.response(point)
                };
                for ((plus, minus), d) in shifted(1.0).iter().zip(shifted(-1.0)).zip(slope) {
                    // The error of the central difference is h^2/6 times the third derivative, < 1e-8.
                    assert!(((plus - minus) / (2.0 * h) - d).norm() < 1e-7);
                }
            }
        }
    }
}
