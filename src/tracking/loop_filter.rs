//! Loop filters.

/// A third-order phase-locked loop filter with a second-order frequency-locked loop's assistance (Kaplan &
/// Hegarty, 3rd ed., table 8.6: B = 0.7845 w0, a3 = 1.1, b3 = 2.4; B = 0.53 w0f, a2 = 1.414).
#[derive(Clone, Debug)]
pub struct CarrierFilter {
    acceleration: f64,
    velocity: f64,
    /// The acceleration, smoothed over [`RATE_TIME_S`].
    rate: f64,
}

/// Time constant of the smoothing of the Doppler's rate, s: it changes by 4 Hz/s in a second at most (550
/// km).
const RATE_TIME_S: f64 = 1.0;

impl CarrierFilter {
    /// Starts at a Doppler, Hz, and its rate, Hz/s.
    pub fn new(doppler_hz: f64, rate_hz_s: f64) -> Self {
        Self { acceleration: rate_hz_s, velocity: doppler_hz, rate: rate_hz_s }
    }

    /// Takes the phase error (cycles) and, during pull-in, the frequency error (Hz) over the last
    /// `interval_s` seconds; returns the Doppler (Hz) for the next interval. Bandwidths in Hz.
    pub fn update(
        &mut self,
        phase: f64,
        pll_hz: f64,
        frequency: f64,
        fll_hz: f64,
        interval_s: f64,
    ) -> f64 {
        let w = pll_hz / 0.7845;
        let wf = fll_hz / 0.53;
        self.acceleration += (w * w * w * phase + wf * wf * frequency) * interval_s;
        self.velocity +=
            (self.acceleration + 1.1 * w * w * phase + 1.414 * wf * frequency) * interval_s;
        self.rate += (self.acceleration - self.rate) * interval_s / RATE_TIME_S;
        self.velocity + 2.4 * w * phase
    }

    /// The filter's own Doppler, Hz, without the jitter of the phase error: that of the middle of the next
    /// interval, for which the replica's frequency is set.
    pub fn doppler_hz(&self) -> f64 {
        self.velocity
    }

    /// Rate of the Doppler, Hz/s.
    pub fn rate_hz_s(&self) -> f64 {
        self.rate
    }

    /// Changes the Doppler by `step_hz`, to leave a false lock.
    pub fn step(&mut self, step_hz: f64) {
        self.velocity += step_hz;
        self.acceleration = 0.0;
    }
}

/// Gain of a first-order delay-locked loop of noise bandwidth `bandwidth_hz`: chips/s per chip of error
/// (Kaplan & Hegarty, 3rd ed., table 8.6: B = w0 / 4).
pub fn code_gain(bandwidth_hz: f64) -> f64 {
    4.0 * bandwidth_hz
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A third-order loop follows a constant Doppler rate without remaining phase error.
    #[test]
    fn a_doppler_ramp_is_followed_without_error() {
        let (mut filter, mut replica, interval) = (CarrierFilter::new(1000.0, 0.0), 0.0, 0.01);
        let (mut truth, mut doppler, mut error) = (0.1f64, 1000.0, 0.0);
        let mut nco = 1000.0;
        for _ in 0..2000 {
            truth += (doppler + 5.0 * interval / 2.0) * interval;
            doppler += 5.0 * interval;
            replica += nco * interval;
            error = truth - replica;
            nco = filter.update(error, 12.0, 0.0, 0.0, interval);
        }
        assert!(error.abs() < 1e-6, "{error}");
        // The remainder after 20 s of a transient with time constants of 0.1 and 1 s.
        assert!((filter.doppler_hz() - 5.0 * interval / 2.0 - doppler).abs() < 1e-6);
        assert!((filter.rate_hz_s() - 5.0).abs() < 1e-6);
    }
}
