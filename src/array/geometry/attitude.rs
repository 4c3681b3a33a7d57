//! Attitude of an array, and gains of its elements, from satellites whose directions are known.
//!
//! A signature gives the direction cosines of a satellite along the array's axes ([`super::arrival`]); orbit and
//! position give its direction u in east, north, up. The rotation R of the array minimises
//! sum |p_q - (a_i . R^T u_q)_i|^2 / sigma_q^2, by Gauss-Newton over small turns d, where a_i . R^T u changes by
//! d . (R a_i x u), from the solution of Wahba's problem (Markley 1988). Of a linear array the direction of its axis
//! follows.

use super::{Manifold, Signature, arrival};
use crate::array::CMat;
use crate::gnss::antenna::{AntennaArray, Attitude};
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use num_complex::Complex64;
use sdr_rx_linalg::thin_svd;

/// Satellites from which an attitude is estimated, at least: one more than two, which leave nothing to test it by.
const MIN_SATELLITES: usize = 3;
/// Gauss-Newton steps at most.
const STEPS: usize = 20;

/// Attitude of an array by its satellites.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArrayAttitude {
    /// Attitude of the platform; of a linear array a turn that brings its axis where it is.
    pub attitude: Attitude,
    /// Standard deviations, rad: of the heading (azimuth of forward), and of the tilt (of up, both ways together).
    pub sigma: [f64; 2],
    /// Satellites used.
    pub satellites: usize,
    /// Sum of squared residuals over their variance, per degree of freedom: 1 where noise alone disturbs. Where it is
    /// larger, as with errors of the elements' phases, the standard deviations contain it.
    pub misfit: f64,
}

impl ArrayAttitude {
    /// Of an array whose elements are given as right, forward and up of its platform, from signatures and directions
    /// (east, north, up). `None` with fewer than three satellites, or where they leave it open.
    pub fn estimate(
        array: &AntennaArray,
        seen: &[(&Signature, Unit<Vector3<f64>>)],
    ) -> Option<Self> {
        let manifold = Manifold::new(array.clone());
        let dimensions = manifold.dimensions();
        let axes = manifold.axes();
        let measured = |(signature, u): &(&Signature, Unit<Vector3<f64>>)| {
            let arrival = arrival(&manifold, signature)?;
            Some((arrival.point, arrival.sigma, u.into_inner()))
        };
        let seen: Vec<_> = seen.iter().filter_map(measured).collect();
        if seen.len() < MIN_SATELLITES || dimensions == 0 {
            return None;
        }
        let weight = |sigma: &[f64; 2]| 1.0 / (sigma[0] * sigma[0] + sigma[1] * sigma[1]);
        let mut rotation = match dimensions {
            1 => {
                // The axis by linear least squares.
                let normal: Matrix3<f64> =
                    seen.iter().map(|(_, s, u)| u * u.transpose() * weight(s)).sum();
                let right: Vector3<f64> = seen.iter().map(|(p, s, u)| u * (p[0] * weight(s))).sum();
                let axis = (normal.try_inverse()? * right).try_normalize(1e-9)?;
                Rotation3::rotation_between(&axes[0], &axis).unwrap_or_else(|| {
                    Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI)
                })
            }
            _ => {
                let outer = |(p, s, u): &([f64; 2], [f64; 2], Vector3<f64>)| {
                    let height = (1.0 - p[0] * p[0] - p[1] * p[1]).max(0.0).sqrt();
                    let v = axes[0] * p[0] + axes[1] * p[1] + axes[2] * height;
                    u * v.transpose() * weight(s)
                };
                let svd = seen.iter().map(outer).sum::<Matrix3<f64>>().svd(true, true);
                let (u, v) = (svd.u?, svd.v_t?);
                let proper = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant()));
                Rotation3::from_matrix_unchecked(u * proper * v)
            }
        };
        let mut covariance = Matrix3::zeros();
        let mut squares = 0.0;
        for _ in 0..STEPS {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            squares = 0.0;
            for (p, sigma, u) in &seen {
                for axis in 0..dimensions {
                    let b = rotation * axes[axis];
                    let slope = b.cross(u);
                    let residual = p[axis] - b.dot(u);
                    let weight = sigma[axis].powi(-2);
                    normal += slope * slope.transpose() * weight;
                    right += slope * (residual * weight);
                    squares += residual * residual * weight;
                }
            }
            if dimensions == 1 {
                // Turns about the axis change nothing.
                let b = rotation * axes[0];
                normal += b * b.transpose() * normal.trace();
            }
            covariance = normal.try_inverse()?;
            let step = covariance * right;
            rotation = Rotation3::new(step) * rotation;
            if step.norm() < 1e-9 {
                break;
            }
        }
        let unknowns = if dimensions == 1 { 2 } else { 3 };
        let misfit = squares / (seen.len() * dimensions - unknowns).max(1) as f64;
        covariance *= misfit.max(1.0);
        let attitude = Attitude::of(rotation.matrix());
        let forward = rotation * if dimensions == 1 { axes[0] } else { Vector3::y() };
        let across = forward.xy().norm_squared();
        // Heading and its slope over small turns d: forward changes by d x forward.
        let slope =
            Vector3::new(forward.x * forward.z / across, forward.y * forward.z / across, -1.0);
        let heading = (slope.transpose() * covariance * slope)[0].sqrt();
        let tilt = (covariance[(0, 0)] + covariance[(1, 1)]).sqrt();
        Some(Self { attitude, sigma: [heading, tilt], satellites: seen.len(), misfit })
    }
}

/// Complex gains of the elements against the model, the first one real and the mean power 1, from signatures of
/// satellites in known directions (in the frame of the manifold's elements): the largest singular vector of the
/// signatures over their model responses. `None` with fewer than three.
pub fn element_gains(
    manifold: &Manifold,
    seen: &[(&Signature, Unit<Vector3<f64>>)],
) -> Option<Vec<Complex64>> {
    if seen.len() < MIN_SATELLITES {
        return None;
    }
    let models: Vec<Vec<Complex64>> =
        seen.iter().map(|(_, u)| manifold.response(manifold.point(u))).collect();
    let ratios = CMat::from_fn(manifold.elements(), seen.len(), |m, q| {
        let (signature, _) = &seen[q];
        signature.response[m] * models[q][m].conj() / signature.variance.sqrt()
    });
    let (u, _, _) = thin_svd(&ratios)?;
    let first = u[(0, 0)].conj() / u[(0, 0)].norm();
    let scale = (manifold.elements() as f64).sqrt();
    Some((0..manifold.elements()).map(|m| u[(m, 0)] * first * scale).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::antenna::direction;
    use crate::gnss::random::SplitMix64;
    use crate::gnss::signal::L1_WAVELENGTH;

    fn square(side: usize) -> AntennaArray {
        let half = L1_WAVELENGTH / 2.0;
        let at = |k: usize| Vector3::new((k % side) as f64 * half, (k / side) as f64 * half, 0.0);
        AntennaArray::new((0..side * side).map(at).collect())
    }

    /// Signatures of five satellites of 45 dB-Hz over a second, seen by an array of this attitude.
    fn scene(
        array: &AntennaArray,
        attitude: &Attitude,
        gains: &[Complex64],
        rng: &mut SplitMix64,
    ) -> Vec<(Signature, Unit<Vector3<f64>>)> {
        let (snr, periods) = (10f64.powf(1.5), 1000.0);
        let turn = attitude.to_enu();
        let sky = [(20.0, 70.0), (95.0, 35.0), (170.0, 25.0), (230.0, 50.0), (310.0, 30.0)];
        let variance = (1.0 + 1.0 / (array.len() as f64 * snr)) / (periods * snr);
        sky.iter()
            .map(|(azimuth, elevation): &(f64, f64)| {
                let u = direction(azimuth.to_radians(), elevation.to_radians());
                let body = Unit::new_normalize(turn.transpose() * u.into_inner());
                let response = array.response(&body);
                let noisy = |(a, g): (&Complex64, &Complex64)| {
                    a * g + rng.complex_normal() * variance.sqrt()
                };
                let response: Vec<Complex64> = response.iter().zip(gains).map(noisy).collect();
                (Signature { response, variance, snr }, u)
            })
            .collect()
    }

    fn refer(scene: &[(Signature, Unit<Vector3<f64>>)]) -> Vec<(&Signature, Unit<Vector3<f64>>)> {
        scene.iter().map(|(s, u)| (s, *u)).collect()
    }

    #[test]
    fn attitudes_are_as_accurate_as_stated_and_as_a_reference_finds() {
        // Degrees rms by a reference in another language, 45 dB-Hz and 1 s: heading and tilt of 2 x 2 .05 and .06, of
        // 4 x 4 .01 and .01; the sky there is another, which the factor of 2 allows for.
        for (side, heading_deg, tilt_deg) in [(2, 0.05, 0.06), (4, 0.01, 0.01)] {
            let array = square(side);
            let gains = vec![Complex64::ONE; array.len()];
            let mut rng = SplitMix64::new(5);
            let (runs, mut heading, mut tilt, mut honest) = (200, 0.0, 0.0, 0.0);
            for run in 0..runs {
                let truth = Attitude {
                    yaw_deg: f64::from(run) * 7.3 - 180.0,
                    pitch_deg: f64::from(run % 9) - 4.0,
                    roll_deg: f64::from(run % 7) - 3.0,
                };
                let seen = scene(&array, &truth, &gains, &mut rng);
                let found = ArrayAttitude::estimate(&array, &refer(&seen)).unwrap();
                let error = found.attitude.yaw_deg - truth.yaw_deg;
                let error = error - 360.0 * (error / 360.0).round();
                heading += error * error / f64::from(runs);
                honest += (error.to_radians() / found.sigma[0]).powi(2) / f64::from(runs);
                let up = |a: &Attitude| a.to_enu() * Vector3::z();
                let apart = up(&found.attitude).angle(&up(&truth)).to_degrees();
                tilt += apart * apart / f64::from(runs);
            }
            let (heading, tilt) = (heading.sqrt(), tilt.sqrt());
            println!("{side} x {side}: heading {heading:.4}, tilt {tilt:.4} deg rms, {honest:.2}");
            assert!(heading < 2.0 * heading_deg && tilt < 2.0 * tilt_deg, "{heading} {tilt}");
            // Chi-square of 200 over 200, and the factor of misfits above 1.
            assert!((0.5..1.4).contains(&honest), "{honest}");
        }
    }

    #[test]
    fn the_axis_of_a_line_is_found() {
        let array = AntennaArray::half_wavelength(8);
        let mut rng = SplitMix64::new(6);
        let truth = Attitude { yaw_deg: 70.0, pitch_deg: 5.0, roll_deg: 10.0 };
        let axis = Manifold::new(array.clone()).axes()[0];
        let gains = vec![Complex64::ONE; 8];
        let seen = scene(&array, &truth, &gains, &mut rng);
        let found = ArrayAttitude::estimate(&array, &refer(&seen)).unwrap();
        let apart = (found.attitude.to_enu() * axis).angle(&(truth.to_enu() * axis));
        // Heading and elevation of the axis, five standard deviations.
        assert!(apart < 5.0 * found.sigma[0].hypot(found.sigma[1]) && apart < 2e-3, "{apart}");
    }

    #[test]
    fn gains_of_the_elements_follow_from_known_directions() {
        let array = square(2);
        let level = Attitude::default();
        let truth: Vec<Complex64> =
            [0.0f64, 25.0, -40.0, 10.0].iter().map(|d| Complex64::cis(d.to_radians())).collect();
        let mut rng = SplitMix64::new(8);
        let seen = scene(&array, &level, &truth, &mut rng);
        let found = element_gains(&Manifold::new(array.clone()), &refer(&seen)).unwrap();
        // Five signatures of variance 3.2e-5: 0.2 deg an element, five standard deviations.
        for (found, truth) in found.iter().zip(&truth) {
            assert!((found / truth).arg().abs().to_degrees() < 1.0, "{found} {truth}");
        }
        let few = &refer(&seen)[..2];
        assert!(element_gains(&Manifold::new(array.clone()), few).is_none());
        assert!(ArrayAttitude::estimate(&array, few).is_none());
    }
}
