//! The filter of one track: averages of code minus carrier.
//!
//! Code and carrier of a satellite grow alike with the range and the clocks, so their difference
//! `d = P - lambda phi` is a constant (of the carrier's unknown cycles), the noise of the code, and twice the
//! delay of the ionosphere, which delays the code and advances the carrier. An average `m` of it makes the
//! smoothed pseudorange `lambda phi + m` (Hatch 1982):
//!
//! ```text
//! m <- (1 - g) m + g d                      g = 1 / n, n the measurements so far, at most W / dt
//! v <- (1 - g)^2 v + g^2 s^2 + 2 g (1 - g) r c,   c <- (1 - g) r c + g s^2,   r = exp(-dt / tau)
//! l <- (1 - g) (l + dt)                     by how much m lags behind where d drifts, s
//! ```
//!
//! `v` is the variance of `m` where the code has noise of standard deviation `s` that forgets itself within `tau`.
//! White noise gives `s^2 / n` while the window fills, and `s^2 / (2 W / dt - 1)` after.

/// Standard deviations beyond which a difference is no noise.
const SIGNIFICANT: f64 = 3.0;
/// Standard deviations beyond which code and carrier have slipped against each other, and what reflections may add to
/// them from one measurement to the next, m.
const SLIP_SIGMAS: f64 = 6.0;
const REFLECTIONS_M: f64 = 1.0;
/// Jerk of a vehicle, m/s^3, that the mean of two Dopplers does not show.
const JERK_MPS3: f64 = 10.0;
/// Standard deviation of a carrier phase by noise and reflections, m.
const CARRIER_SIGMA_M: f64 = 0.01;
/// Standard deviation of the rate at which code and carrier diverge where the measurements do not tell it, m/s: an
/// ionosphere whose slant delay changes by 1 mm/s.
const DIVERGENCE_MPS: f64 = 2e-3;

/// How pseudoranges are smoothed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// Time over which code minus carrier is averaged, s.
    pub window_s: f64,
    /// Time in which the code's noise forgets itself, s: 1 / (4 B) of a first-order loop of bandwidth B.
    pub correlation_s: f64,
}

impl Smoothing {
    /// Window of a receiver's smoothing, s, that is customary (and DO-229's): the ionosphere drifts little within it.
    pub const WINDOW_S: f64 = 100.0;

    /// For a code loop of this noise bandwidth, Hz.
    pub fn of_code_loop(window_s: f64, bandwidth_hz: f64) -> Self {
        Self { window_s, correlation_s: 0.25 / bandwidth_hz }
    }

    /// Correlation of the code's noise with that so much later.
    fn correlation(&self, later_s: f64) -> f64 {
        if later_s > 0.0 { (-later_s / self.correlation_s).exp() } else { 1.0 }
    }
}

/// What is measured of a track at an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    /// Receive time since some origin, s.
    pub time_s: f64,
    /// Pseudorange and its standard deviation, m.
    pub code_m: f64,
    pub code_sigma_m: f64,
    /// Carrier phase, m, that grows with the range.
    pub carrier_m: f64,
    /// Rate of the range by the Doppler and its standard deviation, m/s.
    pub rate_mps: Option<(f64, f64)>,
}

impl Measured {
    /// Code minus carrier, m.
    pub fn difference_m(&self) -> f64 {
        self.code_m - self.carrier_m
    }

    /// The same where time runs backwards.
    pub fn reversed(self) -> Self {
        let rate_mps = self.rate_mps.map(|(mps, sigma_mps)| (-mps, sigma_mps));
        Self { time_s: -self.time_s, rate_mps, ..self }
    }

    /// Whether all of it are numbers that can be smoothed.
    pub fn is_sound(&self) -> bool {
        let rate = self.rate_mps.is_none_or(|(mps, sigma)| mps.is_finite() && sigma.is_finite());
        let sigma = self.code_sigma_m.is_finite() && self.code_sigma_m > 0.0;
        self.difference_m().is_finite() && sigma && rate
    }
}

/// An average, and what is known of it.
#[derive(Clone, Copy, Debug)]
struct Average {
    mean_m: f64,
    /// Its variance by noise, m^2.
    variance: f64,
    /// Its covariance with the noise of the newest measurement, m^2.
    covariance: f64,
    /// By which time it lags behind a drift, s.
    lag_s: f64,
}

impl Average {
    fn new(value_m: f64, variance: f64) -> Self {
        Self { mean_m: value_m, variance, covariance: variance, lag_s: 0.0 }
    }

    /// Takes a value `dt` after the last, with a gain; `rho` correlates its noise with the last one's.
    fn add(&mut self, gain: f64, value_m: f64, variance: f64, rho: f64, dt_s: f64) {
        let kept = 1.0 - gain;
        let covariance = rho * self.covariance;
        self.mean_m += gain * (value_m - self.mean_m);
        self.variance =
            kept * kept * self.variance + gain * gain * variance + 2.0 * gain * kept * covariance;
        self.covariance = kept * covariance + gain * variance;
        self.lag_s = kept * (self.lag_s + dt_s);
    }
}

/// The drift of code against carrier: an average over the whole window and the average of that one lag
/// behind it by different times.
#[derive(Clone, Copy, Debug)]
struct Divergence {
    first: Average,
    second_m: f64,
    second_lag_s: f64,
    /// Of white noise of variance 1: variance of the first, their covariance, variance of the second.
    white: [f64; 3],
}

impl Divergence {
    fn new(value_m: f64, variance: f64) -> Self {
        Self {
            first: Average::new(value_m, variance),
            second_m: value_m,
            second_lag_s: 0.0,
            white: [1.0; 3],
        }
    }

    fn add(&mut self, gain: f64, value_m: f64, variance: f64, rho: f64, dt_s: f64) {
        self.first.add(gain, value_m, variance, rho, dt_s);
        let kept = 1.0 - gain;
        self.second_m += gain * (self.first.mean_m - self.second_m);
        self.second_lag_s = kept * (self.second_lag_s + dt_s) + gain * self.first.lag_s;
        let [first, both, second] = self.white;
        // The new first average with the old second one, then with the new.
        let (first, mixed) = (kept * kept * first + gain * gain, kept * both);
        let second = kept * kept * second + gain * gain * first + 2.0 * gain * kept * mixed;
        self.white = [first, kept * mixed + gain * first, second];
    }

    /// The drift, m/s, and its standard deviation, of noise whose long averages have this variance a measurement.
    fn rate(&self, variance: f64) -> Option<Rate> {
        let span_s = self.second_lag_s - self.first.lag_s;
        let [first, both, second] = self.white;
        let variance = (first + second - 2.0 * both) * variance;
        (span_s > 0.0).then(|| Rate {
            mps: (self.first.mean_m - self.second_m) / span_s,
            sigma_mps: variance.sqrt() / span_s,
        })
    }
}

/// A rate of code minus carrier, and its standard deviation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rate {
    pub mps: f64,
    pub sigma_mps: f64,
}

/// What a track's average of code minus carrier is at an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub mean_m: f64,
    /// By noise alone, m^2.
    pub variance: f64,
    /// Covariance with the noise of the code at the instant, over the standard deviation of that, m.
    shared_m: f64,
    /// By which time it lags behind a drift, s; negative where it was averaged backwards.
    pub lag_s: f64,
    /// Standard deviation of the drift of this track against the others, m/s.
    pub drift_mps: f64,
}

impl Level {
    /// Standard deviation of a pseudorange with it, m.
    pub fn sigma_m(&self) -> f64 {
        let drifted_m = self.drift_mps * self.lag_s;
        (self.variance + drifted_m * drifted_m + CARRIER_SIGMA_M * CARRIER_SIGMA_M).sqrt()
    }

    /// The same about another origin.
    pub fn raised(self, by_m: f64) -> Self {
        Self { mean_m: self.mean_m + by_m, ..self }
    }

    /// The mean with one from later measurements that were averaged backwards, of the least variance by noise. Drifts
    /// cancel as far as the lags are alike.
    pub fn with_later(&self, later: &Self) -> Self {
        let both = self.shared_m * later.shared_m;
        let apart = self.variance + later.variance - 2.0 * both;
        let weight = if apart > 0.0 { (later.variance - both) / apart } else { 0.5 };
        let weight = weight.clamp(0.0, 1.0);
        let rest = 1.0 - weight;
        Self {
            mean_m: weight * self.mean_m + rest * later.mean_m,
            variance: weight * weight * self.variance
                + rest * rest * later.variance
                + 2.0 * weight * rest * both,
            shared_m: self.shared_m,
            lag_s: weight * self.lag_s - rest * later.lag_s,
            drift_mps: self.drift_mps.max(later.drift_mps),
        }
    }
}

/// The averages of one track.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filter {
    last: Measured,
    /// Variance that a measurement adds to a long average, m^2 / n: that of the noise, and more where it is correlated.
    variance: f64,
    /// Weights of the past, in measurements: of the average, and of the one that is used.
    count: f64,
    depth: f64,
    used: Average,
    divergence: Divergence,
}

impl Filter {
    /// Starts with a measurement and its code minus carrier.
    pub fn new(measured: Measured, difference_m: f64) -> Self {
        let variance = measured.code_sigma_m.powi(2);
        Self {
            last: measured,
            variance,
            count: 1.0,
            depth: 1.0,
            used: Average::new(difference_m, variance),
            divergence: Divergence::new(difference_m, variance),
        }
    }

    /// Whether the carrier's phase moved otherwise than the Dopplers say, so that cycles have slipped, or `next` is no
    /// later. What a vehicle's jerk explains does not show.
    pub fn has_slipped(&self, next: &Measured) -> bool {
        let dt_s = next.time_s - self.last.time_s;
        let (Some((before, sigma_1)), Some((after, sigma_2))) = (self.last.rate_mps, next.rate_mps)
        else {
            return dt_s <= 0.0;
        };
        let moved_m = next.carrier_m - self.last.carrier_m;
        let off_m = (moved_m - 0.5 * (before + after) * dt_s).abs();
        let noise_m = (0.5 * sigma_1.hypot(sigma_2) * dt_s).hypot(2.0 * CARRIER_SIGMA_M);
        dt_s <= 0.0 || off_m > SLIP_SIGMAS * noise_m + JERK_MPS3 * dt_s.powi(3) / 12.0
    }

    /// Code minus carrier against its prediction, m, and how far that may be without a slip. All tracks drift by
    /// `common_mps`.
    pub fn innovation(&self, next: &Measured, difference_m: f64, common_mps: f64) -> (f64, f64) {
        let later_s = next.time_s - self.last.time_s;
        let predicted_m = self.used.mean_m + common_mps * (self.used.lag_s + later_s);
        let sigma_m = (next.code_sigma_m.powi(2) + self.used.variance).sqrt();
        (difference_m - predicted_m, SLIP_SIGMAS * sigma_m + REFLECTIONS_M)
    }

    /// Takes the next measurement, which is later, and its code minus carrier.
    pub fn add(
        &mut self,
        next: Measured,
        difference_m: f64,
        common_mps: f64,
        smoothing: &Smoothing,
    ) {
        let dt_s = next.time_s - self.last.time_s;
        let (rho, variance) = (smoothing.correlation(dt_s), next.code_sigma_m.powi(2));
        self.variance = variance * (1.0 + rho) / (1.0 - rho);
        self.last = next;
        let most = (smoothing.window_s / dt_s).max(1.0);
        self.count = (self.count + 1.0).min(most);
        self.divergence.add(1.0 / self.count, difference_m, variance, rho, dt_s);
        // Where this track drifts from the others, the mean square error, s^2 / (2 n) + (n dt drift)^2, limits the window.
        let drift = self.significant_drift(common_mps).unwrap_or(0.0);
        let best = (self.variance.sqrt() / (2.0 * drift * dt_s)).powf(2.0 / 3.0);
        self.depth = (self.depth + 1.0).min(most).min(best.max(1.0));
        self.used.add(1.0 / self.depth, difference_m, variance, rho, dt_s);
    }

    /// The rate at which code minus carrier drifts; none of a single measurement.
    pub fn rate(&self) -> Option<Rate> {
        self.divergence.rate(self.variance)
    }

    /// How fast this track drifts from the others, m/s, where noise does not explain it.
    fn significant_drift(&self, common_mps: f64) -> Option<f64> {
        let rate = self.rate()?;
        let own = (rate.mps - common_mps).abs();
        (own > SIGNIFICANT * rate.sigma_mps).then_some(own)
    }

    /// The averages so much later than the last measurement, by the common drift: the one that is used, and that over the
    /// whole window.
    pub fn levels(&self, later_s: f64, common_mps: f64, smoothing: &Smoothing) -> [Level; 2] {
        let unseen =
            self.rate().map_or(DIVERGENCE_MPS, |r| DIVERGENCE_MPS.min(SIGNIFICANT * r.sigma_mps));
        let drift_mps = self.significant_drift(common_mps).unwrap_or(unseen);
        let shared = smoothing.correlation(later_s) / self.last.code_sigma_m;
        [self.used, self.divergence.first].map(|average| {
            let lag_s = average.lag_s + later_s;
            Level {
                mean_m: average.mean_m + common_mps * lag_s,
                variance: average.variance,
                shared_m: average.covariance * shared,
                lag_s,
                drift_mps,
            }
        })
    }

    /// Time of the last measurement, s.
    pub fn time_s(&self) -> f64 {
        self.last.time_s
    }
}
