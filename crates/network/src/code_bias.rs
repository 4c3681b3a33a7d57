//! Satellite code biases from pseudoranges on three frequencies (section 5 of Khodabandeh & Teunissen, Meas. Sci.
//! Technol. 30 (2019) 044005).
//!
//! A pseudorange on frequency j is y_j = rho + mu_j I + d_j: range, clocks and troposphere in rho, the first-order
//! ionosphere as mu_j = f_1^2 / f_j^2 times its delay on the first frequency, and the code biases of receiver and
//! satellite in d_j. Two frequencies give rho and I up to biases,
//! ```text
//! IF = (mu_2 y_1 - mu_1 y_2) / (mu_2 - mu_1)        GF = (y_2 - y_1) / (mu_2 - mu_1)
//! ```
//! so that y_3 - IF - mu_3 GF holds nothing but a bias of the receiver plus one of the satellite. One constant
//! can be moved from all satellites to all receivers: a *datum* fixes it. With the first receiver's bias
//! set to zero (the S-basis of the paper, [`ReceiverBias::Reference`]) the observations fix the satellites' biases
//! ([`Datum::Observed`](super::Datum::Observed)), but only as precisely as one receiver can; with every receiver's
//! bias eliminated their mean is set to zero ([`Datum::ZeroMean`](super::Datum::ZeroMean)), which is three to four
//! times more precise and is transformed to the S-basis afterwards by [`to_reference_receiver`].

use super::{LinearModel, NetworkError, NetworkSolution, Normals};
use nalgebra::{DMatrix, DVector};
use sdr_rx_gnss::signal::L1_CENTRE_HZ;

/// Standard deviation of a code observation at the zenith where nothing else is known, m.
pub const ZENITH_SIGMA_M: f64 = 0.20;

/// The three carriers of a system whose codes are combined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carriers {
    /// Frequencies, Hz: the first two give range and ionosphere, with which the third is compared.
    pub frequencies_hz: [f64; 3],
}

impl Carriers {
    /// GPS and QZSS L1, L2, L5 (IS-GPS-200N 3.3.1.1, IS-GPS-705J 3.3.1.1, IS-QZSS-PNT-005 table 3.1.1-1).
    pub const GPS: Self = Self { frequencies_hz: [L1_CENTRE_HZ, 1_227.60e6, 1_176.45e6] };
    /// Galileo E1, E5a, E5b (Galileo OS SIS ICD 2.1, table 2).
    pub const GALILEO: Self = Self { frequencies_hz: [L1_CENTRE_HZ, 1_176.45e6, 1_207.14e6] };

    /// The factors of the three pseudoranges in y_3 - IF - mu_3 GF. They add to zero, and so do their products
    /// with mu_j.
    pub fn factors(&self) -> [f64; 3] {
        let [mu_1, mu_2, mu_3] = self.frequencies_hz.map(|f| (self.frequencies_hz[0] / f).powi(2));
        [(mu_3 - mu_2) / (mu_2 - mu_1), (mu_1 - mu_3) / (mu_2 - mu_1), 1.0]
    }

    /// The combination of pseudoranges (m): receiver bias plus satellite bias, m.
    pub fn combine(&self, pseudoranges_m: [f64; 3]) -> f64 {
        // Differences first, so that ranges of 2e7 m keep their nanometres.
        let [first, second, third] = pseudoranges_m;
        let factors = self.factors();
        (third - first) + factors[1] * (second - first)
    }

    /// The combination's variance in units of that of one pseudorange, all three being equally good.
    pub fn variance_factor(&self) -> f64 {
        self.factors().iter().map(|factor| factor * factor).sum()
    }
}

/// The weight of an observation at an elevation (rad), 1 for all practical purposes at the zenith:
/// sigma = sigma_zenith (1 + 10 exp(-E / 10 deg)) of Euler & Goad (Bull. Geod. 65 (1991) 130-143).
pub fn elevation_weight(elevation_rad: f64) -> f64 {
    (1.0 + 10.0 * (-elevation_rad.to_degrees() / 10.0).exp()).powi(-2)
}

/// An observation of one satellite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiasObservation {
    /// Which of the network's satellites: the index of its bias among the parameters, from 0.
    pub satellite: usize,
    /// The combination of its pseudoranges, m ([`Carriers::combine`]).
    pub combination_m: f64,
    /// Its elevation, rad.
    pub elevation_rad: f64,
}

/// Treatment of a receiver's own bias.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceiverBias {
    /// It is zero: that of the one receiver to which the satellites' biases refer.
    Reference,
    /// It is unknown, and eliminated.
    Eliminated,
}

/// A receiver's observations of one epoch as a model of the biases of all `satellites`, m.
///
/// `zenith_sigma_m` is the standard deviation of one pseudorange at the zenith ([`ZENITH_SIGMA_M`]).
///
/// # Errors
/// [`NetworkError::WrongSize`] when an observation is of a satellite beyond the last.
pub fn station_model(
    observations: &[BiasObservation],
    satellites: usize,
    carriers: &Carriers,
    zenith_sigma_m: f64,
    receiver: ReceiverBias,
) -> Result<LinearModel, NetworkError> {
    if let Some(o) = observations.iter().find(|o| o.satellite >= satellites) {
        let what = "the number of an observed satellite".into();
        return Err(NetworkError::WrongSize { what, found: o.satellite, expected: satellites });
    }
    let design = DMatrix::from_fn(observations.len(), satellites, |k, satellite| {
        f64::from(u8::from(observations[k].satellite == satellite))
    });
    let combinations = observations.iter().map(|o| o.combination_m);
    let combinations = DVector::from_iterator(observations.len(), combinations);
    let zenith = 1.0 / (carriers.variance_factor() * zenith_sigma_m * zenith_sigma_m);
    let weights: Vec<f64> =
        observations.iter().map(|o| zenith * elevation_weight(o.elevation_rad)).collect();
    Ok(match receiver {
        ReceiverBias::Reference => LinearModel::independent(design, combinations, &weights),
        ReceiverBias::Eliminated => LinearModel::with_receiver_bias(design, combinations, &weights),
    })
}

/// Satellite biases of the free datum, referred to one receiver's bias: x + 1 w'(l - x) / sum(w), with the
/// observations l and weights w of that receiver alone, whose normal equations (not eliminated) are `reference`.
///
/// Of one epoch it is exactly the network's solution with [`ReceiverBias::Reference`] at that
/// receiver: the weighted mean of the receiver's observations, which no difference holds, is now used to fix the
/// constant. Where each epoch has a receiver bias of its own, `reference` is one epoch's,
/// and the constant is that epoch's.
///
/// # Errors
/// [`NetworkError::WrongSize`], or [`NetworkError::Singular`] when the receiver has observed nothing.
pub fn to_reference_receiver(
    free: &NetworkSolution,
    reference: &Normals,
) -> Result<NetworkSolution, NetworkError> {
    let p = free.x.len();
    if reference.parameters() != p {
        let what = "the reference receiver's model".into();
        return Err(NetworkError::WrongSize { what, found: reference.parameters(), expected: p });
    }
    let weights = reference.matrix.column_sum();
    let sum = weights.sum();
    if sum <= 0.0 {
        return Err(NetworkError::Singular(p));
    }
    let shift = (reference.right.sum() - weights.dot(&free.x)) / sum;
    // The mean of the receiver's observations has variance 1 / sum(w), and is uncorrelated with differences.
    let transform = DMatrix::identity(p, p) - DVector::repeat(p, 1.0) * weights.transpose() / sum;
    let mut covariance = &transform * &free.covariance * transform.transpose();
    covariance.add_scalar_mut(1.0 / sum);
    Ok(NetworkSolution { x: free.x.add_scalar(shift), covariance, ..free.clone() })
}

#[cfg(test)]
mod tests {
    use super::super::Datum;
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn range_clocks_and_ionosphere_cancel_and_the_variance_grows_as_printed() {
        for carriers in [Carriers::GPS, Carriers::GALILEO] {
            let f = carriers.frequencies_hz;
            let (range, delay, biases) = (2.3e7, 37.0, [0.4, -0.9, 1.3]);
            let y = [0, 1, 2].map(|j| range + delay * (f[0] / f[j]).powi(2) + biases[j]);
            let mu = f.map(|fj| (f[0] / fj).powi(2));
            let ionosphere_free = (mu[1] * biases[0] - mu[0] * biases[1]) / (mu[1] - mu[0]);
            let geometry_free = (biases[1] - biases[0]) / (mu[1] - mu[0]);
            let expected = biases[2] - ionosphere_free - mu[2] * geometry_free;
            // A range of 2.3e7 m is rounded to 4e-9 m.
            assert!((carriers.combine(y) - expected).abs() < 2e-8);
        }
        // The note's factor 2.555, and from exact ratios 154 : 120 : 115 of 10.23 MHz.
        let (a, b) = ((154.0f64 / 120.0).powi(2), (154.0f64 / 115.0).powi(2));
        let exact = 1.0 + ((b - a) / (a - 1.0)).powi(2) + ((b - 1.0) / (a - 1.0)).powi(2);
        assert!((Carriers::GPS.variance_factor() - exact).abs() < 1e-12);
        assert!((exact - 2.555).abs() < 5e-4);
    }

    #[test]
    fn weights_follow_the_model() {
        assert!((elevation_weight(std::f64::consts::FRAC_PI_2) - 1.0).abs() < 3e-3);
        let at_10_deg = 1.0 + 10.0 / std::f64::consts::E;
        assert!((elevation_weight(10f64.to_radians()) - at_10_deg.powi(-2)).abs() < 1e-15);
    }

    /// Nine receivers of four to eight of ten satellites.
    fn stations(seed: u64) -> Vec<Vec<BiasObservation>> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut station = |_| {
            let seen: usize = random.random_range(4..=8);
            let first: usize = random.random_range(0..10);
            let observe = |k| BiasObservation {
                satellite: (first + k) % 10,
                combination_m: random.random_range(-3.0..3.0),
                elevation_rad: random.random_range(0.1..1.5),
            };
            (0..seen).map(observe).collect()
        };
        (0..9).map(&mut station).collect()
    }

    fn normals(station: &[BiasObservation], receiver: ReceiverBias) -> Normals {
        let carriers = Carriers::GPS;
        station_model(station, 10, &carriers, ZENITH_SIGMA_M, receiver).unwrap().normals()
    }

    fn sum<'a>(all: impl IntoIterator<Item = &'a Normals>) -> Normals {
        all.into_iter().fold(Normals::none(10), |mut sum, one| {
            sum.add(one);
            sum
        })
    }

    #[test]
    fn the_free_datum_becomes_that_of_the_reference_receiver_with_its_covariance() {
        for seed in 0..20 {
            let stations = stations(seed);
            let free: Vec<_> =
                stations.iter().map(|s| normals(s, ReceiverBias::Eliminated)).collect();
            let reference = normals(&stations[0], ReceiverBias::Reference);
            let expected = sum(free[1..].iter().chain([&reference])).solve(Datum::Observed);
            let expected = expected.unwrap();
            let free = sum(&free).solve(Datum::ZeroMean).unwrap();
            assert!(free.x.mean().abs() < 1e-12);
            let moved = to_reference_receiver(&free, &reference).unwrap();
            // Numbers of order 1, normal matrices of condition below 1e3: a thousand roundings of 1e-16, times ten.
            assert!((moved.x - &expected.x).amax() < 1e-12);
            assert!((moved.covariance - &expected.covariance).amax() < 1e-12);
            assert!((moved.misfit - expected.misfit).abs() < 1e-8 * expected.misfit);
            assert_eq!(moved.freedom, expected.freedom);
            assert!(free.sigma().sum() < expected.sigma().sum());
        }
    }

    #[test]
    fn a_satellite_beyond_the_last_is_refused() {
        let stray = BiasObservation { satellite: 10, combination_m: 0.0, elevation_rad: 1.0 };
        let refused = station_model(&[stray], 10, &Carriers::GPS, 0.2, ReceiverBias::Reference);
        assert!(matches!(refused, Err(NetworkError::WrongSize { found: 10, expected: 10, .. })));
        let free = sum(&[normals(&stations(0)[0], ReceiverBias::Reference)]);
        let nothing = normals(&[], ReceiverBias::Reference);
        let solution = NetworkSolution {
            x: DVector::zeros(10),
            covariance: DMatrix::zeros(10, 10),
            misfit: 0.0,
            freedom: 0.0,
        };
        assert_eq!(to_reference_receiver(&solution, &nothing), Err(NetworkError::Singular(10)));
        assert!(to_reference_receiver(&solution, &free).is_ok());
    }
}
