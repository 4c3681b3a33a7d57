//! From tracks to pseudoranges: the measurements of each channel at the common receive instants, dated by the
//! navigation message.

use super::phase_lock::PhaseLock;
use super::{Epoch, Quality};
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::observation::{CodeRange, Observation, ObservationEpoch};
use crate::gnss::{GpsTime, Transmission};

/// Time after a start in which the loops still pull in, s: carrier and code are not yet in step.
const PULL_IN_S: f64 = 2.0;

/// Measurements of one track at the receive instants, a few numbers each: its memory grows with the number of
/// instants, not of samples.
#[derive(Clone, Debug)]
pub struct TrackLog {
    /// The satellite and its signal.
    pub transmission: Transmission,
    measurements: Vec<Measurement>,
    /// Correlation intervals whose time of transmission is known, s of week, in order.
    anchors: Vec<(u64, f64)>,
    last: Option<Epoch>,
    phase_lock: PhaseLock,
}

/// A track at one receive instant.
#[derive(Clone, Copy, Debug)]
struct Measurement {
    /// Sample at which it was measured.
    sample: u64,
    /// Whether the carrier may have slipped since the measurement before.
    slipped: bool,
    /// Correlation interval under way, and how much of it has passed.
    period: u64,
    fraction: f64,
    carrier_cycles: f64,
    doppler_hz: f64,
    quality: Quality,
}

impl TrackLog {
    /// An empty log.
    pub fn new(transmission: Transmission) -> Self {
        Self {
            transmission,
            measurements: Vec::new(),
            anchors: Vec::new(),
            last: None,
            phase_lock: PhaseLock::default(),
        }
    }

    fn interval_s(&self) -> f64 {
        self.transmission.timing().interval_s
    }

    /// Takes the next epochs of the track (in order, without gaps) and keeps the measurements at the receive
    /// `instants` (samples, ascending).
    pub fn extend(&mut self, epochs: &[Epoch], quality: &Quality, instants: &[u64]) {
        for &epoch in epochs {
            let Some(last) = self.last.replace(epoch) else { continue };
            let length = epoch.start_sample - last.start_sample;
            let length_s = self.interval_s() * (epoch.period - last.period) as f64;
            self.phase_lock.push(last.prompt, length_s, quality.cn0_dbhz);
            let pulls_in = last.period as f64 * self.interval_s() < PULL_IN_S;
            let first = instants.partition_point(|&s| (s as f64) < last.start_sample);
            for &sample in &instants[first..] {
                if sample as f64 >= epoch.start_sample {
                    break;
                }
                let fraction = (sample as f64 - last.start_sample) / length;
                self.measurements.push(Measurement {
                    sample,
                    slipped: self.phase_lock.take_slip() || pulls_in,
                    period: last.period,
                    fraction,
                    carrier_cycles: last.carrier_cycles
                        + fraction * (epoch.carrier_cycles - last.carrier_cycles),
                    doppler_hz: last.doppler_hz,
                    quality: *quality,
                });
            }
        }
    }

    /// Sample up to which instants have been measured; 0 before the first code period.
    pub fn reached(&self) -> f64 {
        self.last.map_or(0.0, |epoch| epoch.start_sample)
    }

    /// Removes measurements before a sample; returns whether any are left.
    pub fn discard_before(&mut self, sample: u64) -> bool {
        let old = self.measurements.partition_point(|m| m.sample < sample);
        self.measurements.drain(..old);
        !self.measurements.is_empty()
    }

    /// Sets the transmit time of correlation interval `period` to time of week `tow_s`. One that follows from the
    /// known ones is not added.
    pub fn anchor(&mut self, period: u64, tow_s: f64) {
        let known = self.tow_s(period, 0.0);
        if known.is_none_or(|tow| (tow - tow_s).abs() > 0.5 * self.interval_s()) {
            self.anchors.push((period, tow_s));
        }
    }

    /// By how many correlation intervals the dates put the symbols that start at `edge` (modulo their `cycle`) after whole
    /// symbols: 0 where dates and symbols agree.
    pub fn misfit(&self, edge: u64, cycle: u64) -> Option<i64> {
        let last = self.last?.period;
        let period = last - (last + cycle - edge % cycle) % cycle;
        let periods = self.tow_s(period, 0.0)? / self.interval_s();
        let off = (periods.round() as i64).rem_euclid(cycle as i64);
        Some(if off >= cycle as i64 / 2 { off - cycle as i64 } else { off })
    }

    /// Dates all by so many correlation intervals later.
    pub fn redate(&mut self, periods: i64) {
        let later_s = periods as f64 * self.interval_s();
        self.anchors.iter_mut().for_each(|(_, tow_s)| *tow_s += later_s);
    }

    /// Forgets what was measured after a sample and up to another, where samples were lost: the carrier does not go on
    /// from one to the other.
    pub fn forget_between(&mut self, after: u64, until: u64) {
        self.measurements.retain(|m| m.sample <= after || m.sample > until);
        if let Some(next) = self.measurements.iter_mut().find(|m| m.sample > until) {
            next.slipped = true;
        }
    }

    /// Dates what was measured after a sample by so many correlation intervals later.
    pub fn redate_after(&mut self, sample: u64, periods: i64) {
        let first = self.measurements.iter().find(|m| m.sample > sample).map(|m| m.period);
        let Some(period) = first.or(self.last.map(|last| last.period)) else { return };
        let later_s = periods as f64 * self.interval_s();
        let Some(tow_s) = self.tow_s(period, 0.0) else { return };
        self.anchors.retain(|a| a.0 < period);
        self.anchors.push((period, tow_s + later_s));
    }

    /// Whether any period's time of transmission is known.
    pub fn is_dated(&self) -> bool {
        !self.anchors.is_empty()
    }

    /// Dates this track by one of the same transmission that ended before: the transmit time advances by the
    /// samples between, and is rounded to whole code periods. Returns the rounding error, s: the jump of the
    /// code phase, which shows missing or repeated samples if all satellites have it.
    /// `code_offset`: by which fraction codes run faster than their carriers say.
    pub fn continue_from(&mut self, before: &Self, rate_hz: f64, code_offset: f64) -> Option<f64> {
        let (old, new) = (before.last?, self.last?);
        let tow = before.tow_s(old.period, 0.0)?;
        let elapsed = (new.start_sample - old.start_sample) / rate_hz;
        let doppler = 0.5 * (old.doppler_hz + new.doppler_hz);
        let expected = elapsed * (1.0 + doppler / self.transmission.carrier_hz() + code_offset);
        let period_s = self.transmission.signal.period_s();
        // Between the starts of code periods.
        let intervals = self.transmission.signal.intervals() as u64;
        let into = |epoch: Epoch| (epoch.period % intervals) as f64 * self.interval_s();
        let within = into(new) - into(old);
        let whole_s = ((expected - within) / period_s).round() * period_s + within;
        self.anchor(new.period, tow + whole_s);
        Some(expected - whole_s)
    }

    /// The sample and transmit time of week (s) of the earliest dated measurement.
    pub fn first_dated(&self) -> Option<(u64, f64)> {
        let m = self.measurements.first()?;
        Some((m.sample, self.tow_s(m.period, m.fraction)?))
    }

    /// Time of week of transmission, s, of a period and a fraction of one: by the latest anchor before it,
    /// else by the first.
    fn tow_s(&self, period: u64, fraction: f64) -> Option<f64> {
        let after = self.anchors.partition_point(|a| a.0 <= period);
        let (origin, tow) = *self.anchors.get(after.saturating_sub(1))?;
        let periods = period as f64 - origin as f64;
        Some(tow + (periods + fraction) * self.interval_s())
    }

    /// The dated measurement at a sample that was received at `receive_time` by the receiver's clock.
    fn observation(&self, sample: u64, receive_time: GpsTime) -> Option<Observation> {
        let k = self.measurements.binary_search_by_key(&sample, |m| m.sample).ok()?;
        let m = &self.measurements[k];
        let tow = self.tow_s(m.period, m.fraction)?;
        let sent = receive_time.nearest_with_tow(tow.rem_euclid(604_800.0));
        Some(Observation {
            transmission: self.transmission,
            range: Some(CodeRange::Pseudorange((receive_time - sent) * SPEED_OF_LIGHT)),
            range_sigma_m: m.quality.code_sigma_m,
            doppler_hz: Some(m.doppler_hz),
            doppler_sigma_hz: m.quality.doppler_sigma_hz,
            carrier_phase_cycles: Some(-m.carrier_cycles),
            lost_lock: m.slipped,
            cn0_dbhz: m.quality.cn0_dbhz,
        })
    }
}

/// The dated measurements of all tracks at one sample; `None` where there are none. `origin` is the receive
/// time of sample 0 by the receiver's clock. Of two logs of one transmission the first counts.
pub fn observation_epoch<'a>(
    logs: impl Iterator<Item = &'a TrackLog>,
    sample: u64,
    origin: GpsTime,
    rate_hz: f64,
) -> Option<ObservationEpoch> {
    let receive_time = origin + sample as f64 / rate_hz;
    let mut observations: Vec<Observation> =
        logs.filter_map(|log| log.observation(sample, receive_time)).collect();
    observations.sort_by_key(|o| o.transmission);
    observations.dedup_by_key(|o| o.transmission);
    let sample = sample as f64;
    (!observations.is_empty()).then_some(ObservationEpoch { receive_time, sample, observations })
}

/// The dated measurements of all tracks at all samples at which any measured, in order of time.
pub fn observation_epochs<'a>(
    logs: impl Iterator<Item = &'a TrackLog> + Clone,
    origin: GpsTime,
    rate_hz: f64,
) -> Vec<ObservationEpoch> {
    let mut samples: Vec<u64> =
        logs.clone().flat_map(|log| log.measurements.iter().map(|m| m.sample)).collect();
    samples.sort_unstable();
    samples.dedup();
    let epoch = |sample| observation_epoch(logs.clone(), sample, origin, rate_hz);
    samples.into_iter().filter_map(epoch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::signal::{self, GPS_L1_CA, L1_WAVELENGTH};
    use num_complex::Complex64;

    const RATE: f64 = 2.6e6;
    const QUALITY: Quality =
        Quality { cn0_dbhz: Some(45.0), code_sigma_m: 1.0, doppler_sigma_hz: 0.1 };

    /// Every 0.1 s.
    fn instants() -> Vec<u64> {
        (0..200).map(|k| k * 260_000).collect()
    }

    /// Epochs of a satellite whose code starts at `start` s and whose range shrinks by `speed` m/s.
    fn epochs(start: f64, speed: f64, periods: std::ops::Range<u64>) -> Vec<Epoch> {
        let scale = 1.0 - speed / SPEED_OF_LIGHT;
        let doppler_hz = speed / L1_WAVELENGTH;
        periods
            .map(|period| {
                let wait = period as f64 * GPS_L1_CA.period_s() * scale;
                let (start_sample, carrier_cycles) = ((start + wait) * RATE, doppler_hz * wait);
                Epoch { period, start_sample, carrier_cycles, doppler_hz, prompt: Complex64::ONE }
            })
            .collect()
    }

    #[test]
    fn pseudoranges_are_receive_time_less_transmit_time() {
        let (start, speed, sent) = (0.4e-3, 600.0, 345_600.0);
        let all = epochs(start, speed, 0..3000);
        let mut log = TrackLog::new(signal::of("G03".parse().unwrap()));
        // In several parts, as in reception.
        log.extend(&all[..777], &QUALITY, &instants());
        log.extend(&all[777..], &QUALITY, &instants());
        log.anchor(500, sent);
        log.anchor(1000, sent + 0.5);
        assert_eq!(log.anchors.len(), 1, "the second follows from the first");
        let received = GpsTime::from_week_tow(2190, sent - 0.5 + 0.07 - start);
        let epochs = observation_epochs([&log].into_iter(), received, RATE);
        assert_eq!(epochs.len(), 29, "instants 1 to 29, the code starts after instant 0");
        for epoch in &epochs {
            let t = epoch.sample / RATE;
            let o = &epoch.observations[0];
            // Sent at sent - 0.5 s + (t - start) / scale.
            let expected = (0.07
                - (t - start) * speed / SPEED_OF_LIGHT / (1.0 - speed / SPEED_OF_LIGHT))
                * SPEED_OF_LIGHT;
            let range = o.pseudorange_m().unwrap();
            // A time of week in f64 has 6e-11 s (17 mm).
            assert!((range - expected).abs() < 0.04, "{range} {expected}");
            let cycles = speed / L1_WAVELENGTH * (t - start);
            assert!((o.carrier_phase_cycles.unwrap() + cycles).abs() < 1e-5);
        }
    }

    #[test]
    fn a_resumed_track_is_dated_by_the_one_before_and_shows_missing_samples() {
        let mut before = TrackLog::new(signal::of("G03".parse().unwrap()));
        before.extend(&epochs(0.0, -300.0, 0..1000), &QUALITY, &instants());
        before.anchor(0, 1000.0);
        // Eight seconds later, with 100 us of samples missing: everything arrives earlier by that.
        let scale = 1.0 + 300.0 / SPEED_OF_LIGHT;
        let mut after = TrackLog::new(before.transmission);
        after.extend(&epochs(9.0 * scale - 100e-6, -300.0, 0..100), &QUALITY, &instants());
        let jump = after.continue_from(&before, RATE, 0.0).unwrap();
        assert!((jump + 100e-6).abs() < 1e-9, "{jump}");
        assert!((after.tow_s(0, 0.0).unwrap() - 1009.0).abs() < 1e-9);
    }
}
