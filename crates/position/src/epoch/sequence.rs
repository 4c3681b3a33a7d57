//! Epochs of one receiver in order: what those before say of the next.
//!
//! With position `x`, velocity `v`, clock bias `b` and drift `d` (as lengths) of a fix and of the one `T` before:
//!
//! ```text
//! place   |x2 - x1 - T (v1 + v2)/2|  <=  k sqrt( tr(Q1 + Q2) + T^2 tr(Qv1 + Qv2)/4 + (J T^3/12)^2 )
//! clock   |b2 - b1 - T (d1 + d2)/2 - m T|  <=  k sqrt( sb1^2 + sb2^2 + T^2 (sd1^2 + sd2^2)/4 + (A T^2/4)^2 ),  modulo 1 ms
//! ```
//!
//! `k` = 8: 5.3 would be a false alarm of 1e-7 if errors were normal; the steps of real receivers have a kurtosis of
//! 5.6. Q are the covariances of the fixes, velocities those of rates as scattered as this receiver's; `J` is the jerk of
//! a vehicle, `A` the acceleration of a clock without compensation of temperature, `m` the median of what the bias does
//! beyond the drift (mixer and sampler may have clocks of their own). Receivers that keep their clock within
//! a millisecond let it jump by whole ones.

use super::Candidates;
use crate::error::PositioningError;
use crate::fix::{Doubt, Fix, Integrity};
use nalgebra::Vector3;
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use std::collections::VecDeque;

/// Epochs whose residuals are remembered, and how many a scale needs.
const REMEMBERED: usize = 120;
const ENOUGH: usize = 20;
/// Largest scale of variances: reflections that make errors six times the model's.
const MOST: f64 = 36.0;
/// Smallest, where no model of the ionosphere is known and the standard deviation allows for a day of a solar maximum.
const LEAST_WITHOUT_IONOSPHERE: f64 = 0.04;
/// Standard deviation of a range rate, m/s: while too few are known, and the smallest.
const RATE_SIGMA_MPS: f64 = 0.3;
const LEAST_RATE_SIGMA_MPS: f64 = 0.05;
/// Standard deviations that a step may be off.
const K: f64 = 8.0;
/// Longest time between fixes that are compared, s.
const LONGEST_S: f64 = 10.0;
/// Jerk of a vehicle, m/s^3.
const JERK_MPS3: f64 = 10.0;
/// Change of a crystal's rate, m/s per s: 1 ppm a minute.
const CLOCK_MPS2: f64 = 5.0;
/// A millisecond, m.
const MILLISECOND_M: f64 = 1e-3 * SPEED_OF_LIGHT;

/// The scale of a receiver's errors against the error model, and its last fix.
#[derive(Clone, Debug, Default)]
pub struct Sequence {
    /// Variance ratios of the last epochs that gave a position, oldest first.
    ratios: VecDeque<f64>,
    /// Medians of the absolute residuals of their range rates, m/s.
    rates: VecDeque<f64>,
    /// Steps of the clock's bias beyond its drift, m/s: what mixer and sampler differ by.
    clocks: VecDeque<f64>,
    last: Option<Fix>,
}

impl Sequence {
    /// The position of the next epoch.
    ///
    /// # Errors
    /// As [`crate::solve_epoch`].
    pub fn judge(&mut self, candidates: Candidates) -> Result<Fix, PositioningError> {
        let ratio = candidates.variance_ratio();
        let least = match candidates.adjustment.nav.ionosphere {
            Some(_) => 1.0,
            None => LEAST_WITHOUT_IONOSPHERE,
        };
        // A fault now and then does not raise the 80 % quantile.
        let factor = quantile(&self.ratios, 0.8).map_or(1.0, |q| q.clamp(least, MOST));
        let mut fix = candidates.judge(factor)?;
        if let Some(last) = self.last.take() {
            if let Some(doubt) = self.discontinuity(&last, &fix) {
                (fix.integrity, fix.doubt) = (Integrity::Unverified, Some(doubt));
            }
            let rate = clock_step(&last, &fix).map(|(step_m, t)| step_m / t);
            remember(&mut self.clocks, rate);
        }
        remember(&mut self.ratios, ratio);
        remember(&mut self.rates, rate_residual(&fix));
        self.last = Some(fix.clone());
        Ok(fix)
    }

    /// Scale of the variances of this receiver's ranges against the error model, as its last epochs show it; 1 while they
    /// are too few.
    pub fn scale(&self) -> f64 {
        quantile(&self.ratios, 0.8).map_or(1.0, |q| q.clamp(LEAST_WITHOUT_IONOSPHERE, MOST))
    }

    /// Standard deviation of a range rate, m/s.
    fn rate_sigma(&self) -> f64 {
        // 1.48 median absolute residuals are a standard deviation if normal; their tails are three times as wide.
        let scattered = quantile(&self.rates, 0.5).map(|median| 3.0 * 1.48 * median);
        scattered.map_or(RATE_SIGMA_MPS, |sigma| sigma.max(LEAST_RATE_SIGMA_MPS))
    }

    /// What of a fix does not follow from the one before.
    fn discontinuity(&self, before: &Fix, fix: &Fix) -> Option<Doubt> {
        let t = fix.time - before.time;
        if !(0.0..=LONGEST_S).contains(&t) || t == 0.0 {
            return None;
        }
        let speed_variance = |fix: &Fix| (fix.pdop * self.rate_sigma()).powi(2);
        let rates = t * t * (speed_variance(before) + speed_variance(fix)) / 4.0;
        if let (Some(v1), Some(v2)) = (before.velocity_mps, fix.velocity_mps) {
            let moved: Vector3<f64> = fix.position_m - before.position_m;
            let off = (moved - (v1 + v2) * (0.5 * t)).norm();
            let places = before.covariance.trace() + fix.covariance.trace();
            if off > K * (places + rates + (JERK_MPS3 * t.powi(3) / 12.0).powi(2)).sqrt() {
                return Some(Doubt::Motion(off));
            }
        }
        let (step_m, _) = clock_step(before, fix)?;
        let off = (step_m - quantile(&self.clocks, 0.5)? * t).abs();
        let sigma = |fix: &Fix| fix.clock_bias_sigma_s.map(|sigma_s| sigma_s * SPEED_OF_LIGHT);
        let biases = sigma(before)?.powi(2) + sigma(fix)?.powi(2);
        let drift = (CLOCK_MPS2 * t * t / 4.0).powi(2);
        (off > K * (biases + rates + drift).sqrt()).then_some(Doubt::Clock(off))
    }
}

/// What the clock's bias did beyond its drift from one fix to the next, m, whole milliseconds taken out; and the time
/// between, s.
fn clock_step(before: &Fix, fix: &Fix) -> Option<(f64, f64)> {
    // The times of two systems may differ by more than a clock's step.
    if fix.reference != before.reference {
        return None;
    }
    let t = fix.time - before.time;
    let step = fix.clock_bias_s?
        - before.clock_bias_s?
        - t * (fix.clock_drift_sps? + before.clock_drift_sps?) / 2.0;
    let step_m = step * SPEED_OF_LIGHT;
    let known = t > 0.0 && t <= LONGEST_S;
    known.then(|| (step_m - (step_m / MILLISECOND_M).round() * MILLISECOND_M, t))
}

/// Median absolute residual of the range rates of a fix, m/s.
fn rate_residual(fix: &Fix) -> Option<f64> {
    let wavelength_m = |sv| sdr_rx_gnss::signal::of(sv).wavelength_m();
    let residuals = fix.residuals.iter();
    let rates = residuals.filter_map(|r| Some((r.doppler_hz? * wavelength_m(r.sv)).abs()));
    let rates: VecDeque<f64> = rates.collect();
    if rates.len() > 4 { middle(&rates, 0.5) } else { None }
}

fn remember(values: &mut VecDeque<f64>, value: Option<f64>) {
    values.extend(value);
    if values.len() > REMEMBERED {
        values.pop_front();
    }
}

/// A quantile of values, if they are enough.
fn quantile(values: &VecDeque<f64>, share: f64) -> Option<f64> {
    if values.len() >= ENOUGH { middle(values, share) } else { None }
}

fn middle(values: &VecDeque<f64>, share: f64) -> Option<f64> {
    let mut values: Vec<f64> = values.iter().copied().collect();
    let rank = (values.len() as f64 * share) as usize;
    (rank < values.len()).then(|| *values.select_nth_unstable_by(rank, f64::total_cmp).1)
}
