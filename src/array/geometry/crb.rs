//! The Cramer-Rao bound of directions.

use super::{Manifold, Point, dictionary};
use crate::array::CMat;
use sdr_rx_linalg::Cholesky;

/// The minimum covariance of each source's coordinates for an unbiased estimate, the signals being unknown,
/// uncorrelated numbers (Stoica and Nehorai 1989, "MUSIC, maximum likelihood, and Cramer-Rao bound", IEEE
/// Trans. ASSP 37(5), eq. 4.6):
///
/// cov_q = sigma^2 / (2 N p_q) \[ Re D_q^H (I - A (A^H A)^-1 A^H) D_q \]^-1
///
/// for N `snapshots`, sources of power p_q at an element of unit gain, and noise of variance sigma^2; in
/// noise of another distribution sigma^2 is the inverse of a sample's Fisher information. For one source on a
/// uniform linear array of M elements half a wavelength apart: 6 sigma^2 / (N p M (M^2 - 1) pi^2).
///
/// The second coordinate of a linear array has no covariance (0). Infinite where the array cannot resolve the
/// sources.
pub fn cramer_rao(
    manifold: &Manifold,
    points: &[Point],
    powers: &[f64],
    snapshots: f64,
    noise: f64,
) -> Vec<[[f64; 2]; 2]> {
    let a = dictionary(manifold, points);
    let gram = a.adjoint() * &a;
    let sources = points.iter().zip(powers).map(|(point, power)| {
        let slopes = manifold.derivatives(*point);
        let d = CMat::from_fn(manifold.elements(), slopes.len(), |m, k| slopes[k][m]);
        let crossed = a.adjoint() * &d;
        let inside = match Cholesky::new(&gram) {
            Some(factor) => crossed.adjoint() * factor.solve(&crossed),
            None => d.adjoint() * &d,
        };
        let outside = d.adjoint() * &d - inside;
        let scale = noise / (2.0 * snapshots * power);
        inverse(|i, j| outside[(i, j)].re, slopes.len()).map(|row| row.map(|v| scale * v))
    });
    sources.collect()
}

/// The inverse of a positive definite matrix of one or two rows, infinite where it is singular.
pub(in crate::array) fn inverse(at: impl Fn(usize, usize) -> f64, size: usize) -> [[f64; 2]; 2] {
    if size == 1 {
        return [[1.0 / at(0, 0).max(0.0), 0.0], [0.0; 2]];
    }
    let determinant = at(0, 0) * at(1, 1) - at(0, 1) * at(1, 0);
    if determinant > 0.0 {
        let crossed = -at(0, 1) / determinant;
        [[at(1, 1) / determinant, crossed], [crossed, at(0, 0) / determinant]]
    } else {
        [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::antenna::AntennaArray;
    use nalgebra::Vector3;
    use std::f64::consts::PI;

    #[test]
    fn one_source_on_a_line_has_the_closed_form_at_any_direction() {
        let manifold = Manifold::new(AntennaArray::half_wavelength(10));
        let expected = 6.0 * 2.0 / (50.0 * 3.0 * 10.0 * 99.0 * PI * PI);
        for s in [-0.7, 0.0, 0.3] {
            let bound = cramer_rao(&manifold, &[[s, 0.0]], &[3.0], 50.0, 2.0)[0];
            assert!((bound[0][0] / expected - 1.0).abs() < 1e-9);
            assert_eq!([bound[0][1], bound[1][1]], [0.0; 2]);
        }
    }

    #[test]
    fn a_square_has_the_same_bound_on_both_axes_and_a_neighbour_raises_it() {
        let half = crate::gnss::signal::L1_WAVELENGTH / 2.0;
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let square = corners.map(|[x, y]| Vector3::new(x * half, y * half, 0.0)).to_vec();
        let manifold = Manifold::new(AntennaArray::new(square));
        // Each axis: phases +-pi/2 about the middle, so D^H P D = 4 (pi/2)^2 = pi^2.
        let bound = cramer_rao(&manifold, &[[0.2, -0.1]], &[1.0], 10.0, 1.0)[0];
        let expected = 1.0 / (20.0 * PI * PI);
        assert!((bound[0][0] / expected - 1.0).abs() < 1e-9);
        assert!((bound[1][1] / expected - 1.0).abs() < 1e-9 && bound[0][1].abs() < 1e-12);
        let two = cramer_rao(&manifold, &[[0.2, -0.1], [0.5, 0.3]], &[1.0; 2], 10.0, 1.0);
        assert!(two[0][0][0] > 1.1 * expected && two[0][0][0].is_finite());
    }
}
