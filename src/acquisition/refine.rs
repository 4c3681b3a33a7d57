//! Refinement: Doppler, code phase, symbol edge and C/N0 of an acquired satellite over a whole snapshot.
//!
//! The snapshot is correlated once per correlation interval at three taps (one pass over the samples, twice in
//! all, and once more for each side peak of the autocorrelation). The prompts give the carrier by maximum likelihood over frequency and symbol edge; the
//! data are then wiped off and all periods summed, which gives the code phase by early minus late.
//! Standard deviations are the Cramer-Rao bounds at the measured C/N0 (Kay, Estimation Theory, 3.11;
//! Kaplan & Hegarty, 3rd ed., 8.6).

use super::Acquisition;
use crate::correlator::carrier::{CarrierSpan, estimate_carrier};
use crate::correlator::{CodeTable, SampleBuffer, correlate, lateness_chips};
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Distance of early and late from prompt, chips, in the first and the second pass.
const TAP_CHIPS: [f64; 2] = [0.5, 0.25];

/// Maximum distance of early and late where the autocorrelation is steeper, as the fraction of the peak that it has
/// fallen by.
const LARGEST_TAP: f64 = 0.5;

/// Refined measurements of a satellite in a snapshot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Doppler (in the middle of the snapshot), code phase (at its first sample) and C/N0, refined.
    pub acquisition: Acquisition,
    /// Rate of the Doppler, Hz/s; 0 where none was searched.
    pub doppler_rate_hz_s: f64,
    /// Instant of the Doppler: this long after the first sample, s.
    pub doppler_at_s: f64,
    /// Standard deviation of the Doppler, Hz.
    pub doppler_sigma_hz: f64,
    /// Standard deviation of the code phase, chips.
    pub code_sigma_chips: f64,
    /// Rate of the code phase beyond that predicted from the Doppler, chips/s: zero within `code_rate_sigma`,
    /// unless the spectrum is mirrored or samples are missing.
    pub code_rate_excess: f64,
    /// Standard deviation of `code_rate_excess`, chips/s.
    pub code_rate_sigma: f64,
    /// Carrier phase at the first sample, cycles, ambiguous by half a cycle.
    pub carrier_phase: f64,
    /// Index of the first whole code period after the first sample that starts a data symbol, where the
    /// snapshot shows it.
    pub symbol_edge: Option<usize>,
}

impl Refined {
    /// The precision of a search of `coherent_ms`, where the signal is too short to refine: uniform errors
    /// over half a bin of Doppler and of code.
    pub fn unrefined(found: &Acquisition, rate_hz: f64, coherent_ms: usize) -> Self {
        Self {
            acquisition: *found,
            doppler_rate_hz_s: 0.0,
            doppler_at_s: 0.0,
            doppler_sigma_hz: 500.0 / coherent_ms as f64 / 12f64.sqrt(),
            code_sigma_chips: found.transmission.signal.chip_rate_hz / rate_hz / 12f64.sqrt(),
            code_rate_excess: 0.0,
            code_rate_sigma: f64::INFINITY,
            carrier_phase: 0.0,
            symbol_edge: None,
        }
    }
}

/// Measures acquired satellites on the samples of one buffer.
pub struct Refiner<'a> {
    samples: &'a SampleBuffer,
    rate_hz: f64,
    start: u64,
    end: u64,
    doppler_rate_hz_s: f64,
    code_offset: f64,
}

impl<'a> Refiner<'a> {
    /// For the samples `start..end` (stream indices) of a buffer that holds them.
    pub fn new(samples: &'a SampleBuffer, rate_hz: f64, start: u64, end: u64) -> Self {
        Self {
            samples,
            rate_hz,
            start: start.max(samples.first_sample()),
            end: end.min(samples.end()),
            doppler_rate_hz_s: 0.0,
            code_offset: 0.0,
        }
    }

    /// The code runs faster than the carrier says by this fraction.
    #[must_use]
    pub fn with_code_offset(self, code_offset: f64) -> Self {
        Self { code_offset, ..self }
    }

    /// Searches rates of the Doppler up to `doppler_rate_hz_s` (Hz/s) either way: satellites in low orbits
    /// reach 600, those in high ones stay below 1.
    #[must_use]
    pub fn with_doppler_rate(self, doppler_rate_hz_s: f64) -> Self {
        Self { doppler_rate_hz_s, ..self }
    }

    /// Refines one acquisition whose code phase refers to the first sample of the window. `search_hz` is the
    /// maximum error of the Doppler (two bins of the search). `None` when the window is shorter than two code
    /// periods or shows no power at all.
    pub fn refine(
        &self,
        coarse: &Acquisition,
        table: &CodeTable,
        search_hz: f64,
    ) -> Option<Refined> {
        let modulation = coarse.transmission.signal.modulation;
        let taps = TAP_CHIPS.map(|tap| tap.min(LARGEST_TAP / modulation.slope()));
        let first = self.measure(coarse, table, taps[0], search_hz)?;
        // A cell of the search may lie on a side peak: more signal tells.
        let side_peaks = modulation.side_peaks_chips().flat_map(|delay| [delay, -delay]);
        let others = side_peaks.filter_map(|delay| {
            let chips = coarse.transmission.signal.chips as f64;
            let code_phase_chips = (coarse.code_phase_chips + delay).rem_euclid(chips);
            self.measure(&Acquisition { code_phase_chips, ..*coarse }, table, taps[0], search_hz)
        });
        let strength = |r: &Refined| r.acquisition.cn0_dbhz;
        let best = others.chain([first]).max_by(|a, b| strength(a).total_cmp(&strength(b)))?;
        self.measure(&best.acquisition, table, taps[1], search_hz.min(20.0))
    }

    fn measure(
        &self,
        now: &Acquisition,
        table: &CodeTable,
        tap_chips: f64,
        span_hz: f64,
    ) -> Option<Refined> {
        let Acquisition { transmission, .. } = *now;
        let clock = transmission.clock_beside(now.doppler_hz, self.code_offset);
        let timing = transmission.timing();
        let length = clock.period_samples(self.rate_hz) / transmission.signal.intervals() as f64;
        let first = self.start as f64 + clock.seconds_to_start(now.code_phase_chips) * self.rate_hz;
        let count = ((self.end as f64 - first) / length).floor().max(0.0) as usize;
        if count < 2 {
            return None;
        }
        let step = now.doppler_hz / self.rate_hz;
        let mut offset = 0.0;
        let sums: Vec<[Complex64; 3]> = (0..count)
            .map_while(|k| {
                let begin = first + k as f64 * length;
                let taps = table.taps(k as u64, begin, begin + length, tap_chips);
                let window =
                    self.samples.window(taps.first_sample, taps.first_sample + taps.len as u64)?;
                let phase = (step * (taps.first_sample - self.start) as f64).fract();
                offset += taps.offset / count as f64;
                Some(
                    correlate(window, taps.codes, phase, step)
                        .map(|s| Complex64::new(s.re.into(), s.im.into())),
                )
            })
            .collect();
        let prompts: Vec<Complex64> = sums.iter().map(|s| s[1]).collect();
        let span = CarrierSpan { frequency_hz: span_hz, rate_hz_s: self.doppler_rate_hz_s };
        let carrier = estimate_carrier(&prompts, timing, span)?;
        let count = prompts.len() as f64;

        let wiped = |tap: usize, range: std::ops::Range<usize>| -> Complex64 {
            range.map(|k| sums[k][tap] * carrier.wipe_off[k]).sum()
        };
        let amplitude = wiped(1, 0..prompts.len()) / count;
        // Half the power of the difference of neighbours, so that slow phase errors do not count as noise.
        let still: Vec<Complex64> =
            prompts.iter().zip(&carrier.wipe_off).map(|(p, w)| p * w).collect();
        let differences: f64 = still.windows(2).map(|w| (w[1] - w[0]).norm_sqr()).sum();
        let noise = 0.5 * differences / (count - 1.0);
        let snr = ((amplitude.norm_sqr() - noise / count) / noise.max(f64::MIN_POSITIVE)).max(1e-6);
        let cn0 = snr / timing.interval_s;

        let chips_per_sample = transmission.signal.chip_rate_hz / self.rate_hz;
        let distance = table.tap_distance(tap_chips) * chips_per_sample;
        let slope = transmission.signal.modulation.slope();
        let lateness = |range: std::ops::Range<usize>| {
            lateness_chips(wiped(0, range.clone()), wiped(2, range), distance, slope)
        };
        let half = prompts.len() / 2;
        let late_chips = lateness(0..prompts.len()) + offset * chips_per_sample;
        let duration = count * timing.interval_s;
        let code_sigma_chips = (distance / (slope * 2.0 * cn0 * duration)).sqrt();
        // Later by x chips in the second half: the phase at a given sample is x less.
        let code_rate_excess =
            -(lateness(half..prompts.len()) - lateness(0..half)) / (duration / 2.0);

        // The prompts do not fill the window: their middle is up to half a code period off its own.
        let middle_s = (first - self.start as f64) / self.rate_hz + duration / 2.0;
        let window_middle_s = 0.5 * (self.end - self.start) as f64 / self.rate_hz;
        let doppler_hz = now.doppler_hz
            + carrier.frequency_hz
            + carrier.rate_hz_s * (window_middle_s - middle_s);
        let code_phase =
            (now.code_phase_chips - late_chips).rem_euclid(transmission.signal.chips as f64);
        Some(Refined {
            acquisition: Acquisition {
                doppler_hz,
                code_phase_chips: code_phase,
                cn0_dbhz: 10.0 * cn0.log10(),
                ..*now
            },
            doppler_rate_hz_s: carrier.rate_hz_s,
            doppler_at_s: window_middle_s,
            doppler_sigma_hz: (6.0 / (snr * count.powi(3))).sqrt() / (TAU * timing.interval_s),
            code_sigma_chips,
            code_rate_excess,
            code_rate_sigma: code_sigma_chips * 2.0 * 2f64.sqrt() / (duration / 2.0),
            carrier_phase: (carrier.phase / TAU
                - (carrier.frequency_hz - 0.5 * carrier.rate_hz_s * middle_s) * middle_s)
                .rem_euclid(1.0),
            symbol_edge: carrier.symbol_edge,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlator::test_signal::TestSignal;
    use crate::gnss::signal;

    /// Normalised errors of Doppler and code over many seeds: their mean and rms, and the number of symbol
    /// edges found.
    fn errors(rate: f64, ms: usize, cn0_dbhz: f64, seeds: u64) -> ([f64; 2], [f64; 2], usize) {
        let transmission = signal::of("G11".parse().unwrap());
        let table = CodeTable::new(transmission, rate);
        let (mut mean, mut square, mut edges) = ([0.0; 2], [0.0; 2], 0);
        for seed in 0..seeds {
            let shift = seed as f64 / seeds as f64;
            let (doppler, delay_s) = (3000.0 * (shift - 0.3), (0.1 + 0.77 * shift) * 1e-3);
            let signal = TestSignal {
                rate,
                doppler,
                delay_s,
                cn0_dbhz,
                fade_db: 0.0,
                fade_s: 0.0,
                symbol_edge: 7,
                seed,
            };
            let mut buffer = SampleBuffer::default();
            buffer.push(&signal.samples(transmission.sv, (rate * 1e-3 * ms as f64) as usize));
            let chip_rate = transmission.clock(doppler).chip_rate_hz;
            let truth = (-delay_s * chip_rate).rem_euclid(1023.0);
            let coarse = Acquisition {
                transmission,
                doppler_hz: doppler + 40.0 * (shift - 0.5),
                code_phase_chips: truth + 0.8 * (shift - 0.5),
                cn0_dbhz: 0.0,
                statistic: 0.0,
                false_alarm: 0.0,
            };
            let refined = Refiner::new(&buffer, rate, 0, buffer.end())
                .refine(&coarse, &table, 100.0)
                .unwrap();
            let code =
                (refined.acquisition.code_phase_chips - truth + 511.5).rem_euclid(1023.0) - 511.5;
            let z = [
                (refined.acquisition.doppler_hz - doppler) / refined.doppler_sigma_hz,
                code / refined.code_sigma_chips,
            ];
            for k in 0..2 {
                mean[k] += z[k] / seeds as f64;
                square[k] += z[k] * z[k] / seeds as f64;
            }
            // C/N0 within five standard deviations of its estimate: 4.34 dB x sqrt(2/(snr) + 1/n) .
            let snr = 10f64.powf(cn0_dbhz / 10.0) * 1e-3;
            let sigma = 4.343 * ((2.0 / snr + 1.0) / ms as f64).sqrt();
            assert!(
                (refined.acquisition.cn0_dbhz - cn0_dbhz).abs() < 5.0 * sigma + 0.3,
                "{}",
                refined.acquisition.cn0_dbhz
            );
            edges += usize::from(refined.symbol_edge == Some(7));
        }
        (mean, square.map(f64::sqrt), edges)
    }

    #[test]
    fn errors_are_those_of_the_cramer_rao_bound() {
        for (ms, cn0) in [(10, 45.0), (20, 45.0), (100, 40.0), (500, 35.0)] {
            let seeds = 60;
            let (mean, rms, edges) = errors(2.6e6, ms, cn0, seeds);
            println!("{ms} ms {cn0} dB-Hz: mean {mean:.2?} rms {rms:.2?} edges {edges}");
            for k in 0..2 {
                // Mean 0 +- 4/sqrt(60); rms 1 +- 4/sqrt(120), and a quarter for what the bound omits.
                assert!(mean[k].abs() < 0.52, "{ms} ms: {mean:?}");
                assert!((0.63..1.62).contains(&rms[k]), "{ms} ms: {rms:?}");
            }
            if ms == 500 {
                assert_eq!(edges, seeds as usize);
            }
        }
    }
}
