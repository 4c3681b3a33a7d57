//! The receiver's clock: at which samples all satellites are measured, and when those samples were received.
//!
//! Until the first fix gives the time, instants lie a whole number of intervals after the first sample. From
//! then on each lies at the sample nearest a round instant of GPS time (a multiple of the interval from the start
//! of the week), whatever the offset and drift of the sampling clock.

use crate::gnss::GpsTime;
use crate::position::Fix;

/// Instants of measurement, and the time of a sample.
#[derive(Clone, Debug)]
pub(super) struct ReceiverClock {
    rate_hz: f64,
    interval_s: f64,
    /// Receive time of sample 0 by this clock.
    origin: Option<GpsTime>,
    /// By the newest fix: its sample, the clock's bias there (s), and its drift.
    reading: Option<(f64, f64, f64)>,
    /// Instants that tracks may still have to measure, ascending.
    instants: Vec<u64>,
    /// Those of them before this one have been taken by [`Self::complete`].
    next_complete: u64,
    /// The last of those.
    newest: Option<u64>,
}

impl ReceiverClock {
    pub(super) fn new(rate_hz: f64, interval_s: f64) -> Self {
        Self {
            rate_hz,
            interval_s,
            origin: None,
            reading: None,
            instants: vec![0],
            next_complete: 0,
            newest: None,
        }
    }

    pub(super) fn origin(&self) -> Option<GpsTime> {
        self.origin
    }

    pub(super) fn set_origin(&mut self, origin: GpsTime) {
        self.origin = Some(origin);
    }

    /// Instants for a stretch of samples that ends at `end`; those before `start` are forgotten.
    pub(super) fn advance(&mut self, start: u64, end: u64) {
        while let Some(next) = self.instants.last().map(|&last| self.after(last))
            && self.instants.last().is_some_and(|&last| last < end)
        {
            self.instants.push(next);
        }
        // The last is kept: the next follows from it.
        let old = self.instants.partition_point(|&s| s < start).min(self.instants.len() - 1);
        self.instants.drain(..old);
    }

    pub(super) fn instants(&self) -> &[u64] {
        &self.instants
    }

    /// The instants that all tracks have passed since the last call.
    pub(super) fn complete(&mut self, reached: f64) -> Vec<u64> {
        let passed = |s: &u64| *s >= self.next_complete && (*s as f64) < reached;
        let complete: Vec<u64> = self.instants.iter().copied().filter(passed).collect();
        if let Some(&last) = complete.last() {
            (self.newest, self.next_complete) = (Some(last), last + 1);
        }
        complete
    }

    /// The newest instant that all tracks have passed.
    pub(super) fn newest_complete(&self) -> Option<u64> {
        self.newest
    }

    /// Sets the clock by a fix: instants from `end` on, which no track has reached, follow it.
    pub(super) fn steer(&mut self, fix: &Fix, end: u64) {
        let Some(bias_s) = fix.clock_bias_s else { return };
        self.reading = Some((fix.sample, bias_s, fix.clock_drift_sps.unwrap_or(0.0)));
        let reached = self.instants.partition_point(|&s| s < end).max(1);
        self.instants.truncate(reached);
    }

    /// The instant after one.
    fn after(&self, last: u64) -> u64 {
        let spacing = (self.interval_s * self.rate_hz).round().max(1.0) as u64;
        let (Some(origin), Some((sample, bias_s, drift))) = (self.origin, self.reading) else {
            return last + spacing;
        };
        let bias_s = bias_s + drift * (last as f64 - sample) / self.rate_hz;
        let time = origin + last as f64 / self.rate_hz - bias_s;
        let into = time.tow().rem_euclid(self.interval_s);
        let to_round = self.interval_s - into;
        // One that is nearer than half an interval is the present one, or too near to it.
        let wait_s =
            if to_round < 0.5 * self.interval_s { to_round + self.interval_s } else { to_round };
        last + (wait_s * self.rate_hz / (1.0 - drift)).round().max(1.0) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_are_whole_intervals_after_the_first_sample_until_the_time_is_known() {
        let mut clock = ReceiverClock::new(2.6e6, 0.1);
        clock.advance(0, 1_000_000);
        assert_eq!(clock.instants(), [0, 260_000, 520_000, 780_000, 1_040_000]);
        assert_eq!(clock.complete(300_000.0), [0, 260_000]);
        assert_eq!(clock.complete(300_000.0), [0u64; 0]);
        clock.advance(600_000, 1_100_000);
        assert_eq!(clock.instants(), [780_000, 1_040_000, 1_300_000]);
    }

    #[test]
    fn a_clock_that_is_off_and_drifts_keeps_the_round_instants_of_gps_time() {
        // Sample 0 at 0.37 s past a second; the clock ahead by 2 ms at sample 0, gaining 3 us a second.
        let (rate, bias, drift) = (2e6, 2e-3, 3e-6);
        let start = GpsTime::from_week_tow(2200, 1000.37);
        let mut clock = ReceiverClock::new(rate, 1.0);
        clock.set_origin(start + bias);
        clock.advance(0, 200_000);
        clock.reading = Some((0.0, bias, drift));
        clock.advance(0, 120_000_000);
        let late = |s: &u64| {
            let t = start + *s as f64 / rate * (1.0 - drift);
            t.tow() - t.tow().round()
        };
        let steered = &clock.instants()[2..];
        assert!(steered.len() >= 59);
        // Half a sample.
        assert!(
            steered.iter().all(|s| late(s).abs() < 0.26e-6),
            "{:?}",
            steered.iter().map(late).collect::<Vec<_>>()
        );
        assert!(steered.windows(2).all(|w| w[1] - w[0] == 2_000_006));
    }
}
