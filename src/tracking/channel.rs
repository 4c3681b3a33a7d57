//! Tracking of one satellite through the stream.

use super::discriminators::{costas_cycles, frequency_hz, phase_cycles};
use super::lock::{LockDetector, LockState};
use super::loop_filter::{CarrierFilter, code_gain};
use super::overlay_sync::OverlaySynchroniser;
use super::peaks::{Neighbour, PeakMonitor};
use super::symbol_sync::{Symbol, SymbolSynchroniser};
use crate::acquisition::{Acquisition, Refined};
use crate::correlator::{CodeTable, SampleBuffer, correlate, lateness_chips};
use crate::gnss::Transmission;
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::signal::{CodeClock, SymbolTiming};
use num_complex::Complex64;

/// Frequency error from which a reliably measured one is a false lock and not dynamics, as a fraction of the
/// distance of false locks, half the symbol rate: 8 of 25 Hz with symbols of 20 ms.
const FALSE_LOCK: f64 = 0.32;

/// Maximum distance of early and late from prompt, as the fraction of the peak by which the autocorrelation has fallen.
const LARGEST_TAP: f64 = 0.5;

/// Time for which the loops stay wide after a start, s.
const SETTLING_S: f64 = 1.0;

/// Bandwidths and integration times of the loops.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackingOptions {
    /// Coherent integration once the symbol edge, of a pilot the secondary code, is known, ms: a divisor of a symbol or of
    /// the secondary code, and at most one.
    pub coherent_ms: usize,
    /// Noise bandwidth of the phase-locked loop, Hz (lowered to 0.15 / coherent time where that is less).
    pub pll_hz: f64,
    /// Noise bandwidth of the frequency-locked loop that assists until the symbol edge is known, Hz.
    pub fll_hz: f64,
    /// Noise bandwidth of the carrier-aided delay-locked loop, Hz (four times that in the first second).
    pub dll_hz: f64,
    /// Distance of early and late from prompt, chips; less where the autocorrelation has fallen to half before.
    pub tap_chips: f64,
}

impl Default for TrackingOptions {
    /// 10 ms, 15 Hz, 8 Hz, 0.5 Hz, 0.25 chips.
    fn default() -> Self {
        Self { coherent_ms: 10, pll_hz: 15.0, fll_hz: 8.0, dll_hz: 0.5, tap_chips: 0.25 }
    }
}

/// Start of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackStart {
    /// Stream index of the sample that the acquisition's code phase refers to.
    pub sample: u64,
    /// The acquisition, with the Doppler at that sample.
    pub acquisition: Acquisition,
    /// Rate of the Doppler, Hz/s.
    pub doppler_rate_hz_s: f64,
    /// Carrier phase at that sample, cycles.
    pub carrier_phase: f64,
    /// Whole code period after that sample that starts a data symbol, if known.
    pub symbol_edge: Option<usize>,
}

impl TrackStart {
    /// From a refined acquisition whose snapshot starts at the stream index `sample`.
    pub fn from_refined(refined: &Refined, sample: u64) -> Self {
        let doppler_hz =
            refined.acquisition.doppler_hz - refined.doppler_rate_hz_s * refined.doppler_at_s;
        Self {
            sample,
            acquisition: Acquisition { doppler_hz, ..refined.acquisition },
            doppler_rate_hz_s: refined.doppler_rate_hz_s,
            carrier_phase: refined.carrier_phase,
            symbol_edge: refined.symbol_edge,
        }
    }
}

/// The state of a track at the start of one correlation interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Epoch {
    /// Index of the interval, counted from the start of the track, which is that of a code period.
    pub period: u64,
    /// Stream index (fractional) of the sample at which the interval starts.
    pub start_sample: f64,
    /// Carrier cycles of the replica since the start of the track, at the start of the interval.
    pub carrier_cycles: f64,
    /// Doppler at the start of the interval, Hz.
    pub doppler_hz: f64,
    /// Prompt correlation over the interval, of a pilot without its secondary code once that is known.
    pub prompt: Complex64,
}

/// Precision of a channel's measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// C/N0 over the last second, dB-Hz; none in the first 0.2 s.
    pub cn0_dbhz: Option<f64>,
    /// Standard deviation of the code phase, m.
    pub code_sigma_m: f64,
    /// Standard deviation of the Doppler, Hz.
    pub doppler_sigma_hz: f64,
}

/// The loops of one satellite: on its signal, or on the pilot of data and pilot.
pub struct Channel {
    table: CodeTable,
    /// Beside a pilot, the data component.
    data: Option<CodeTable>,
    overlay: Option<OverlaySynchroniser>,
    /// Where the autocorrelation has side peaks, the first of them, chips.
    side_chips: Option<f64>,
    peaks: PeakMonitor,
    rate_hz: f64,
    options: TrackingOptions,
    period: u64,
    code_start: f64,
    carrier_cycles: f64,
    /// Frequency of the carrier replica, Hz.
    carrier_hz: f64,
    /// By which fraction the code runs faster than the carrier says, common to all satellites.
    code_offset: f64,
    /// Correction of the delay-locked loop to the carrier's aid, chips/s.
    code_correction: f64,
    filter: CarrierFilter,
    interval: Interval,
    last_prompt: Option<Complex64>,
    lock: LockDetector,
    symbols: SymbolSynchroniser,
}

/// Sums since the last update of the loops.
#[derive(Clone, Copy, Debug, Default)]
struct Interval {
    taps: [Complex64; 3],
    /// Very early and very late.
    sides: [Complex64; 2],
    /// Sum of the replicas' offsets from the code phase set by the loop, samples.
    offset: f64,
    count: usize,
}

/// Correlations of one interval, the pilot's without its secondary code once that is known.
struct Sums {
    /// Early, prompt and late.
    taps: [Complex64; 3],
    /// Very early and very late, where they are needed.
    sides: Option<[Complex64; 2]>,
    /// Prompt of the data component.
    data: Complex64,
    offset: f64,
}

impl Channel {
    /// Starts a track on samples at `rate_hz`.
    pub fn new(start: &TrackStart, rate_hz: f64, options: TrackingOptions) -> Self {
        let Acquisition { transmission, doppler_hz, .. } = start.acquisition;
        let wait_s =
            start.acquisition.code_offset_s() / (1.0 + doppler_hz / transmission.carrier_hz());
        let timing = transmission.timing();
        let signal = transmission.signal;
        let data = transmission.partner().filter(|_| transmission.is_pilot());
        let overlay = transmission.overlay().filter(|_| transmission.is_pilot());
        Self {
            table: CodeTable::new(transmission, rate_hz),
            data: data.map(|data| CodeTable::new(data, rate_hz)),
            overlay: overlay.map(|chips| OverlaySynchroniser::new(chips, signal.intervals())),
            side_chips: signal.modulation.side_peaks_chips().next(),
            peaks: PeakMonitor::default(),
            rate_hz,
            options,
            period: 0,
            code_start: start.sample as f64 + wait_s * rate_hz,
            carrier_cycles: start.carrier_phase + doppler_hz * wait_s,
            carrier_hz: doppler_hz,
            code_offset: 0.0,
            code_correction: 0.0,
            filter: CarrierFilter::new(doppler_hz, start.doppler_rate_hz_s),
            interval: Interval::default(),
            last_prompt: None,
            lock: LockDetector::new(timing, signal.power_fraction),
            symbols: SymbolSynchroniser::new(timing, start.symbol_edge.map(|e| e as u64)),
        }
    }

    /// The same, where codes run faster than their carriers say by a fraction common to all satellites.
    #[must_use]
    pub fn with_code_offset(self, code_offset: f64) -> Self {
        Self { code_offset, ..self }
    }

    /// Changes that fraction from here on.
    pub fn set_code_offset(&mut self, code_offset: f64) {
        self.code_offset = code_offset;
    }

    /// The delay-locked loop's correction to what carrier and offset say, as a fraction of the chip rate.
    pub fn code_correction(&self) -> f64 {
        self.code_correction / self.transmission().signal.chip_rate_hz
    }

    /// The satellite and signal tracked.
    pub fn transmission(&self) -> Transmission {
        self.table.transmission()
    }

    fn timing(&self) -> SymbolTiming {
        self.symbols.timing()
    }

    /// The code's replicas.
    pub fn code_table(&self) -> &CodeTable {
        &self.table
    }

    /// State of the lock detector.
    pub fn lock(&self) -> LockState {
        self.lock.state()
    }

    /// C/N0 over the last second, dB-Hz, once known.
    pub fn cn0_dbhz(&self) -> Option<f64> {
        self.lock.cn0_dbhz()
    }

    /// Current Doppler, Hz: the loop filter's is that of the middle of the current interval.
    pub fn doppler_hz(&self) -> f64 {
        let from_middle = self.interval.count as f64 - 0.5 * self.loop_intervals() as f64;
        self.filter.doppler_hz() + self.filter.rate_hz_s() * from_middle * self.timing().interval_s
    }

    /// Code phase at a sample near the newest one tracked, chips from 0 to below a code period.
    pub fn code_phase_chips(&self, sample: u64) -> f64 {
        let clock = self.transmission().clock_beside(self.carrier_hz, self.code_offset);
        let signal = self.transmission().signal;
        let (chips, intervals) = (signal.chips as f64, signal.intervals() as u64);
        let before = (self.period % intervals) as f64 / intervals as f64 * chips;
        let since_start_s = (sample as f64 - self.code_start) / self.rate_hz;
        (before + since_start_s * clock.chip_rate_hz).rem_euclid(chips) % chips
    }

    /// Current precision of the measurements.
    pub fn quality(&self) -> Quality {
        Quality {
            cn0_dbhz: self.cn0_dbhz(),
            code_sigma_m: self.code_sigma_m(),
            doppler_sigma_hz: self.doppler_sigma_hz(),
        }
    }

    /// Standard deviation of the code phase, m: thermal noise through the delay-locked loop at the
    /// measured C/N0 (Kaplan & Hegarty, 3rd ed., 8.6.3, for a wide front end; where the autocorrelation is steeper by a
    /// factor, the noise of early less late, and the square of the discriminator's gain, are so too).
    pub fn code_sigma_m(&self) -> f64 {
        let cn0 = 10f64.powf(self.cn0_dbhz().unwrap_or(30.0) / 10.0);
        let interval = self.loop_intervals() as f64 * self.timing().interval_s;
        let slope = self.transmission().signal.modulation.slope();
        let taps = self.tap_chips() / slope;
        let variance = self.options.dll_hz * taps / cn0 * (1.0 + 1.0 / (interval * cn0));
        variance.sqrt() * SPEED_OF_LIGHT / self.transmission().signal.chip_rate_hz
    }

    /// Standard deviation of the Doppler of the phase-locked loop, Hz: white phase noise of density 1/(2
    /// C/N0) through the loop filter's frequency state.
    pub fn doppler_sigma_hz(&self) -> f64 {
        let cn0 = 10f64.powf(self.cn0_dbhz().unwrap_or(30.0) / 10.0);
        let (_, bandwidth) = self.bandwidths();
        let interval = self.loop_intervals() as f64 * self.timing().interval_s;
        // |s (1.1 w^2 s + w^3) / (s^3 + 2.4 w s^2 + 1.1 w^2 s + w^3)|^2 integrated: 0.711 w^3.
        let w = bandwidth / 0.7845;
        let squaring = 1.0 + 0.5 / (interval * cn0);
        (0.711 * w.powi(3) / (2.0 * cn0) * squaring).sqrt() / std::f64::consts::TAU
    }

    fn tap_chips(&self) -> f64 {
        let slope = self.transmission().signal.modulation.slope();
        self.options.tap_chips.min(LARGEST_TAP / slope)
    }

    /// Tracks the signal through all whole correlation intervals of `samples`: appends an epoch for each and the
    /// symbols they complete. Cost: one pass over the samples, two of data and pilot.
    pub fn process(
        &mut self,
        samples: &SampleBuffer,
        epochs: &mut Vec<Epoch>,
        symbols: &mut Vec<Symbol>,
    ) {
        let transmission = self.transmission();
        let intervals = transmission.signal.intervals() as f64;
        loop {
            let clock = transmission.clock_beside(self.carrier_hz, self.code_offset);
            let chip_rate_hz = clock.chip_rate_hz + self.code_correction;
            let period = CodeClock { chip_rate_hz, ..clock }.period_samples(self.rate_hz);
            let length = period / intervals;
            let (start, end) = (self.code_start, self.code_start + length);
            let taps = self.table.taps(self.period, start, end, self.tap_chips());
            let window = samples.window(taps.first_sample, taps.first_sample + taps.len as u64);
            let Some(window) = window else { return };
            let step = self.carrier_hz / self.rate_hz;
            let phase = self.carrier_cycles + step * (taps.first_sample as f64 - self.code_start);
            let correlate = |codes: [&[u8]; 3]| {
                correlate(window, codes, phase.fract(), step)
                    .map(|s| Complex64::new(s.re.into(), s.im.into()))
            };
            let sign = self.overlay.as_ref().map_or(1.0, |overlay| overlay.sign(self.period));
            let taken = correlate(taps.codes).map(|sum| sum * sign);
            let mut sums = Sums { taps: taken, sides: None, data: taken[1], offset: taps.offset };
            if let (Some(data), Some(side)) = (&self.data, self.side_chips) {
                let [_, prompt, _] = data.taps(self.period, start, end, side).codes;
                let [early, _, late] = self.table.taps(self.period, start, end, side).codes;
                let [data, early, late] = correlate([prompt, early, late]);
                (sums.data, sums.sides) = (data, Some([early * sign, late * sign]));
            }
            epochs.push(Epoch {
                period: self.period,
                start_sample: start,
                carrier_cycles: self.carrier_cycles,
                doppler_hz: self.doppler_hz(),
                prompt: sums.taps[1],
            });
            self.code_start = end;
            self.carrier_cycles += step * length;
            self.advance(sums, symbols);
        }
    }

    /// Accumulates one correlation interval and closes the loops where theirs ends.
    fn advance(&mut self, sums: Sums, symbols: &mut Vec<Symbol>) {
        // By the edge and the secondary code as they were known during the interval.
        let position = self.symbols.position(self.period);
        let end = self.coherent_position(self.period + 1);
        let coherent = self.loop_intervals() as u64;
        let prompt = sums.taps[1];
        let false_lock = self.lock.push(prompt, position);
        self.symbols.push(self.period, self.data_symbol(sums.data), self.lock.powers(), symbols);
        for (sum, new) in self.interval.taps.iter_mut().zip(sums.taps) {
            *sum += new;
        }
        for (sum, new) in self.interval.sides.iter_mut().zip(sums.sides.into_iter().flatten()) {
            *sum += new;
        }
        self.interval.offset += sums.offset;
        self.interval.count += 1;
        let is_pure = self.overlay.as_ref().is_some_and(|o| o.position(self.period).is_some());
        if let Some(overlay) = &mut self.overlay {
            overlay.push(self.period, prompt * overlay.sign(self.period));
        }
        self.period += 1;
        if end.is_none_or(|position| position % coherent == 0) {
            self.close_loops(is_pure);
        }
        let SymbolTiming { interval_s, cycle, .. } = self.timing();
        let false_lock_hz = FALSE_LOCK / (2.0 * cycle as f64 * interval_s);
        if let Some(error_hz) = false_lock.filter(|e| e.abs() > false_lock_hz) {
            self.filter.step(error_hz);
            self.carrier_hz = self.filter.doppler_hz();
        }
    }

    /// The prompt of the data component with the phase of the tracked one.
    fn data_symbol(&self, prompt: Complex64) -> Complex64 {
        let (Some(data), Some(overlay)) = (&self.data, &self.overlay) else { return prompt };
        let pilot = self.transmission().signal.phase_cycles;
        let ahead = data.transmission().signal.phase_cycles - pilot;
        prompt * Complex64::cis(-std::f64::consts::TAU * ahead) * overlay.polarity()
    }

    fn close_loops(&mut self, is_pure: bool) {
        let Interval { taps: [early, prompt, late], sides, offset, count } =
            std::mem::take(&mut self.interval);
        let interval_s = count as f64 * self.timing().interval_s;
        let (fll_hz, pll_hz) = self.bandwidths();
        let frequency = match self.last_prompt.replace(prompt) {
            Some(last) if fll_hz > 0.0 => frequency_hz(last, prompt, interval_s),
            _ => 0.0,
        };
        let phase = if is_pure { phase_cycles(prompt) } else { costas_cycles(prompt) };
        self.carrier_hz = self.filter.update(phase, pll_hz, frequency, fll_hz, interval_s);

        let signal = self.transmission().signal;
        let chips_per_sample = signal.chip_rate_hz / self.rate_hz;
        let distance = self.table.tap_distance(self.tap_chips()) * chips_per_sample;
        let late_chips = lateness_chips(early, late, distance, signal.modulation.slope())
            + offset / count as f64 * chips_per_sample;
        let settling = self.period as f64 * self.timing().interval_s < SETTLING_S;
        let bandwidth = self.options.dll_hz * if settling { 4.0 } else { 1.0 };
        self.code_correction = -code_gain(bandwidth) * late_chips;
        if let Some(side_chips) = self.side_chips.filter(|_| self.data.is_some())
            && let Some(neighbour) = self.peaks.push(prompt, sides)
        {
            let later = if neighbour == Neighbour::Later { side_chips } else { -side_chips };
            self.code_start += later / chips_per_sample;
            self.code_correction = 0.0;
        }
    }

    /// Current bandwidths of the frequency- and the phase-locked loop, Hz.
    fn bandwidths(&self) -> (f64, f64) {
        let stable = 0.15 / (self.loop_intervals() as f64 * self.timing().interval_s);
        let fll = if self.is_synchronised() { 0.0 } else { self.options.fll_hz };
        (fll, self.options.pll_hz.min(stable))
    }

    /// Whether the symbol edge, of a pilot the secondary code, is known.
    fn is_synchronised(&self) -> bool {
        match &self.overlay {
            Some(overlay) => overlay.position(0).is_some(),
            None => self.symbols.edge().is_some(),
        }
    }

    /// Place of a correlation interval in what nothing but noise changes the sign of: the secondary code, where it is
    /// known, else a symbol.
    fn coherent_position(&self, interval: u64) -> Option<u64> {
        let of_overlay = self.overlay.as_ref().and_then(|overlay| overlay.position(interval));
        of_overlay.or_else(|| self.symbols.position(interval))
    }

    /// Correlation intervals between updates of the loops.
    fn loop_intervals(&self) -> usize {
        let cycle = match &self.overlay {
            Some(overlay) if self.is_synchronised() => overlay.cycle(),
            _ if self.symbols.edge().is_some() => self.timing().cycle,
            _ => return 1,
        };
        SymbolTiming { cycle, ..self.timing() }.coherent_intervals(self.options.coherent_ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlator::test_signal::{TestSignal, data_bit};
    use crate::gnss::signal;
    use rayon::prelude::*;

    const RATE: f64 = 2.048e6;

    /// Tracks a signal from an acquisition that is off by `doppler_error` Hz and 0.3 chips, and returns the
    /// channel, its symbols and the last code phase error in chips.
    fn track(
        signal: &TestSignal,
        seconds: f64,
        doppler_error: f64,
        edge: Option<usize>,
        options: TrackingOptions,
    ) -> (Channel, Vec<Symbol>, f64) {
        let transmission = signal::of("G19".parse().unwrap());
        let mut buffer = SampleBuffer::default();
        buffer.push(&signal.samples(transmission.sv, (RATE * seconds) as usize));
        let chip_rate = transmission.clock(signal.doppler).chip_rate_hz;
        let acquisition = Acquisition {
            transmission,
            doppler_hz: signal.doppler + doppler_error,
            code_phase_chips: (0.3 - signal.delay_s * chip_rate).rem_euclid(1023.0),
            cn0_dbhz: signal.cn0_dbhz,
            statistic: 0.0,
            false_alarm: 0.0,
        };
        let start = TrackStart {
            sample: 0,
            acquisition,
            doppler_rate_hz_s: 0.0,
            carrier_phase: 0.2,
            symbol_edge: edge,
        };
        let mut channel = Channel::new(&start, RATE, options);
        let (mut epochs, mut bits) = (Vec::new(), Vec::new());
        channel.process(&buffer, &mut epochs, &mut bits);
        let last = epochs.last().unwrap();
        let truth = (signal.delay_s + last.period as f64 * 1023.0 / chip_rate) * RATE;
        let error = (last.start_sample - truth) / RATE * transmission.signal.chip_rate_hz;
        (channel, bits, (error + 511.5).rem_euclid(1023.0) - 511.5)
    }

    fn bit_errors(bits: &[Symbol], edge: u64) -> usize {
        let sign =
            |b: &Symbol| f64::from(b.value) * data_bit((b.first_period as i64 - edge as i64) / 20);
        let negative = bits.iter().filter(|b| sign(b) < 0.0).count();
        negative.min(bits.len() - negative)
    }

    #[test]
    fn a_channel_pulls_in_at_35_dbhz_and_holds_at_30_dbhz() {
        // Twenty seeds: acquired with 20 Hz and 0.3 chips of error and an unknown symbol edge at 35 dB-Hz,
        // faded to 30 dB-Hz over four seconds and held there for four.
        (0..20u64).into_par_iter().for_each(|seed| {
            let signal = TestSignal {
                rate: RATE,
                doppler: 300.0 * (seed as f64 - 10.0),
                delay_s: 0.04e-3 * (seed + 1) as f64,
                cn0_dbhz: 35.0,
                fade_db: 5.0,
                fade_s: 4.0,
                symbol_edge: (seed % 20) as i64,
                seed,
            };
            let (channel, bits, code_error) =
                track(&signal, 8.0, 20.0, None, TrackingOptions::default());
            assert_eq!(channel.lock(), LockState::Locked, "seed {seed}");
            assert!(
                (channel.cn0_dbhz().unwrap() - 30.0).abs() < 1.5,
                "seed {seed}: {:?}",
                channel.cn0_dbhz()
            );
            let doppler_error = channel.doppler_hz() - signal.doppler;
            let sigma = channel.doppler_sigma_hz();
            println!("seed {seed}: {doppler_error:.3} Hz of {sigma:.3}, {code_error:.4} chips");
            assert!(
                doppler_error.abs() < 5.0 * sigma,
                "seed {seed}: {doppler_error} Hz of {sigma}"
            );
            let sigma_chips = channel.code_sigma_m() / 293.05;
            assert!(
                code_error.abs() < 5.0 * sigma_chips,
                "seed {seed}: {code_error} of {sigma_chips}"
            );
            // The first second is pull-in. After it Eb/N0 >= 13 dB: Q(sqrt(40)) = 1.3e-10 per bit.
            assert!(bits.len() > 350, "seed {seed}: {} bits", bits.len());
            assert_eq!(bit_errors(&bits[50..], signal.symbol_edge as u64), 0, "seed {seed}");
        });
    }

    #[test]
    fn with_a_known_edge_all_symbols_are_correct_at_any_integration_time() {
        for coherent_ms in [1, 2, 4, 5, 10, 20] {
            let signal = TestSignal {
                rate: RATE,
                doppler: -2222.0,
                delay_s: 0.3e-3,
                cn0_dbhz: 40.0,
                fade_db: 0.0,
                fade_s: 0.0,
                symbol_edge: 13,
                seed: 5,
            };
            let options = TrackingOptions { coherent_ms, ..Default::default() };
            let (channel, bits, _) = track(&signal, 2.0, 0.5, Some(13), options);
            assert_eq!(channel.lock(), LockState::Locked);
            assert_eq!(bits[0].first_period, 13);
            assert_eq!(bit_errors(&bits, 13), 0, "{coherent_ms} ms");
        }
    }

    #[test]
    fn a_signal_that_ends_gives_loss_of_lock() {
        let mut signal = TestSignal {
            rate: RATE,
            doppler: 100.0,
            delay_s: 0.0,
            cn0_dbhz: 45.0,
            fade_db: 60.0,
            fade_s: 1.0,
            symbol_edge: 0,
            seed: 9,
        };
        assert_eq!(
            track(&signal, 3.0, 1.0, Some(0), TrackingOptions::default()).0.lock(),
            LockState::Lost
        );
        signal.fade_db = 0.0;
        assert_eq!(
            track(&signal, 3.0, 1.0, Some(0), TrackingOptions::default()).0.lock(),
            LockState::Locked
        );
    }
}
