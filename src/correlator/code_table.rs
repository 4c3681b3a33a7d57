//! Codes sampled at the capture's rate, at finely stepped starting phases.

use super::VECTOR;
use crate::gnss::Transmission;

/// Starting phases per chip: a replica is placed to half of 1/40 chip (3.7 m), and the remainder is known
/// exactly, so that a code discriminator can correct for it.
const PHASES_PER_CHIP: f64 = 40.0;

/// Samples of guard at both ends of a row: the farthest tap plus one vector of the kernel.
const GUARD: usize = FARTHEST_TAP + VECTOR + 8;
/// Distance of the farthest tap, samples.
const FARTHEST_TAP: usize = 128;

/// The code of one transmission at one sampling rate.
///
/// Row `p` of `phases` holds the code, with its subcarrier as a narrow front end shows it, at the instants (n + (p +
/// 1/2) / phases) / rate, 0 for +1 and 255 for -1. The table has about 40 bytes a chip whatever the rate: of a code of
/// 1023 chips it stays in the second-level cache.
#[derive(Clone, Debug)]
pub struct CodeTable {
    transmission: Transmission,
    rows: Vec<Vec<u8>>,
    samples_per_interval: f64,
    intervals: usize,
    rate_hz: f64,
}

/// Early, prompt and late replicas for the samples from `first_sample` on.
pub struct Taps<'a> {
    /// The three replicas, 0 for +1 and 255 for -1; up to [`VECTOR`] entries beyond `len` may be read.
    pub codes: [&'a [u8]; 3],
    /// Number of samples in the correlation interval.
    pub len: usize,
    /// Index of the sample that the first entries belong to.
    pub first_sample: u64,
    /// Actual position of the prompt replica: replica minus requested, samples.
    pub offset: f64,
}

impl CodeTable {
    /// Tabulates the code at `rate_hz` (at least the chip rate).
    pub fn new(transmission: Transmission, rate_hz: f64) -> Self {
        let signal = transmission.signal;
        let (pieces, replica) = signal.modulation.replica(&transmission.code());
        let phases = (PHASES_PER_CHIP * signal.chip_rate_hz / rate_hz).ceil().max(1.0) as usize;
        let samples_per_period = rate_hz * signal.period_s();
        let pieces_per_sample = pieces as f64 * signal.chip_rate_hz / rate_hz;
        let len = samples_per_period.ceil() as usize + 2 * GUARD + 1;
        let row = |phase: usize| {
            let start = (phase as f64 + 0.5) / phases as f64 - GUARD as f64;
            (0..len)
                .map(|n| {
                    let piece = ((start + n as f64) * pieces_per_sample).floor() as i64;
                    let value = replica[piece.rem_euclid(replica.len() as i64) as usize];
                    if value < 0 { 255 } else { 0 }
                })
                .collect()
        };
        let intervals = signal.intervals();
        Self {
            transmission,
            rows: (0..phases).map(row).collect(),
            samples_per_interval: samples_per_period / intervals as f64,
            intervals,
            rate_hz,
        }
    }

    /// The satellite and signal of the code.
    pub fn transmission(&self) -> Transmission {
        self.transmission
    }

    /// Distance of early and late from prompt, samples: the nearest to `chips` that the table can give.
    pub fn tap_distance(&self, chips: f64) -> f64 {
        self.steps(chips) as f64 / self.rows.len() as f64
    }

    fn steps(&self, chips: f64) -> usize {
        let samples = chips * self.rate_hz / self.transmission.signal.chip_rate_hz;
        let samples = samples.min(FARTHEST_TAP as f64);
        (samples * self.rows.len() as f64).round().max(1.0) as usize
    }

    /// Replicas for the correlation interval of this number (of a code period, modulo [`Signal::intervals`]), from the
    /// fractional sample index `start` to `end`, early and late `tap_chips` away from prompt. The table ignores the
    /// Doppler of the code: replica and interval are aligned in their middles, where a Doppler of 30 kHz shifts the ends
    /// by 0.01 chip.
    ///
    /// [`Signal::intervals`]: crate::gnss::Signal::intervals
    pub fn taps(&self, interval: u64, start: f64, end: f64, tap_chips: f64) -> Taps<'_> {
        let phases = self.rows.len();
        let first = start.ceil();
        let len = (end.ceil() - first).clamp(0.0, self.samples_per_interval + 8.0) as usize;
        let stretch = end - start - self.samples_per_interval;
        let before = (interval % self.intervals as u64) as f64 * self.samples_per_interval;
        let lead = before + first - (start + 0.5 * stretch);
        let step = (lead * phases as f64).floor() as isize;
        let distance = self.steps(tap_chips);
        let replica = |shift: isize| {
            let index = step + shift + (GUARD * phases) as isize;
            let (row, first) =
                (index.rem_euclid(phases as isize), index.div_euclid(phases as isize));
            &self.rows[row as usize][first as usize..]
        };
        Taps {
            // A replica that starts earlier is further into the code at the same sample.
            codes: [replica(distance as isize), replica(0), replica(-(distance as isize))],
            len,
            first_sample: first as u64,
            offset: lead - (step as f64 + 0.5) / phases as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlator::sign;
    use crate::gnss::signal;

    #[test]
    fn taps_are_the_code_at_the_documented_offsets() {
        let transmission = signal::of("G07".parse().unwrap());
        let chips = transmission.code();
        let chip_rate = transmission.signal.chip_rate_hz;
        for rate in [2.6e6, 4e6, 5.456e6, 20e6] {
            let table = CodeTable::new(transmission, rate);
            let period = rate * 1e-3;
            for k in 0..50 {
                let start = 1000.0 + 0.37 * f64::from(k);
                // A Doppler of up to 40 kHz on the carrier.
                let stretch = 2.5e-5 * period * (f64::from(k) / 25.0 - 1.0);
                let taps = table.taps(0, start, start + period + stretch, 0.25);
                let distance = table.tap_distance(0.25);
                assert!((distance * chip_rate / rate - 0.25).abs() <= 0.5 / 40.0 + 1e-12);
                assert!(taps.offset.abs() <= 0.5 / table.rows.len() as f64 + 1e-9);
                for (tap, shift) in [(0, -distance), (1, 0.0), (2, distance)] {
                    for n in (0..taps.len).step_by(7) {
                        let replica_start = start + 0.5 * stretch + taps.offset + shift;
                        let chip = (taps.first_sample as f64 + n as f64 - replica_start)
                            * chip_rate
                            / rate;
                        if (chip - chip.round()).abs() > 1e-6 {
                            let expected = chips[(chip.floor() as i64).rem_euclid(1023) as usize];
                            assert_eq!(sign(taps.codes[tap][n]), f64::from(expected));
                        }
                    }
                }
            }
        }
    }
}
