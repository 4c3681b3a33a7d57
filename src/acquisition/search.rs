//! Parallel code-phase search over all satellites and Dopplers.
//!
//! Per coherent window of K code periods T the samples are sorted into N bins per period. Folding the K
//! periods after a carrier of Doppler f = f_j + c/T is removed needs only the 2K fractions f_j of 1/T (1 kHz
//! of a C/A code), since exp(-j 2 pi (c/T) m T) = 1 for whole periods m; within the period c/T is a shift of
//! the spectrum by c lines. Cost: 2K forward FFTs of N per window, and then one inverse FFT of N per
//! satellite, Doppler, window and channel, which dominates.

use super::{Acquisition, statistics};
use crate::gnss::{Signal, Sv, Transmission, signal};
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use sdr_rx_linalg::{Fft, forward_transform, inverse_transform};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Minimum and maximum number of bins per chip.
const BINS_PER_CHIP: (usize, usize) = (2, 5);

/// What to search.
#[derive(Clone, Debug)]
pub struct SearchOptions {
    /// Satellites and their signals, of one code length and chip rate.
    pub satellites: Vec<Transmission>,
    /// Doppler interval, Hz, both ends included.
    pub doppler_hz: (f64, f64),
    /// Maximum rate of the Doppler, Hz/s, either way, that the refinement searches; the search itself assumes
    /// none, which loses nothing below 1 / (8 T^2) for windows of T seconds.
    pub doppler_rate_hz_s: f64,
    /// Coherent integration, whole ms (1 to 20).
    pub coherent_ms: usize,
    /// Maximum number of coherent windows summed non-coherently.
    pub max_windows: usize,
    /// Probability of one or more false alarms in the whole search.
    pub false_alarm: f64,
}

impl Default for SearchOptions {
    /// All GPS satellites, +-5 kHz, two windows of 10 ms (one of them is free of a symbol edge), and one
    /// false alarm in 1000 searches.
    fn default() -> Self {
        Self {
            satellites: Sv::all_gps().map(signal::of).collect(),
            doppler_hz: (-5000.0, 5000.0),
            doppler_rate_hz_s: 0.0,
            coherent_ms: 10,
            max_windows: 2,
            false_alarm: 1e-3,
        }
    }
}

/// Why a search is impossible.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AcquisitionError {
    /// The rate is too low for the code.
    #[error(
        "a sampling rate of {rate_hz} Hz is below the chip rate of {name}, {} MHz: is the rate right?",
        chip_rate_hz / 1e6
    )]
    Rate {
        /// Rate, Hz.
        rate_hz: f64,
        /// The signal.
        name: &'static str,
        /// Its chip rate, Hz.
        chip_rate_hz: f64,
    },
    /// Fewer samples than one coherent window.
    #[error(
        "{have} samples are too few to search: {need} are needed for {coherent_ms} ms of coherent integration at {rate_hz} Hz"
    )]
    TooShort {
        /// Samples given.
        have: usize,
        /// Samples needed.
        need: usize,
        /// Coherent integration, ms.
        coherent_ms: usize,
        /// Rate, Hz.
        rate_hz: f64,
    },
    /// Options that define no search.
    #[error("no search: {0}")]
    Options(&'static str),
}

/// Tables and transforms of a search at one rate.
pub struct SearchPlan {
    options: SearchOptions,
    rate_hz: f64,
    /// Code period, s, and how many of them make a coherent window.
    period_s: f64,
    periods: usize,
    /// Chips in a period.
    chips: f64,
    /// Bins per code period.
    bins: usize,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
    /// Conjugate spectra of the codes, one per transmission.
    codes: Vec<Vec<Complex32>>,
}

/// The spectra of the folded windows, by window of each channel and fraction of the spacing of the lines.
struct Folded {
    /// `[channel][window][fraction][bin]`, flattened.
    spectra: Vec<Complex32>,
    windows: usize,
    looks: usize,
}

/// The best cell of one satellite.
struct Peak {
    statistic: f64,
    /// Power per window over that of the noise.
    power: f64,
    doppler_hz: f64,
    bin: usize,
}

impl SearchPlan {
    /// Prepares a search at `rate_hz`. Cost: one FFT per satellite.
    pub fn new(rate_hz: f64, options: SearchOptions) -> Result<Self, AcquisitionError> {
        let signal = searched_signal(&options.satellites, rate_hz)?;
        let (low, high) = options.doppler_hz;
        let reason = match () {
            _ if low.is_nan() || high.is_nan() || high < low => {
                Some("the Doppler interval is empty")
            }
            _ if low.abs().max(high.abs()) > rate_hz / 2.0 => {
                Some("the Doppler interval is wider than the sampled band")
            }
            _ if !(1..=20).contains(&options.coherent_ms) => {
                Some("coherent integration must be 1 to 20 ms")
            }
            _ if options.max_windows == 0 => Some("at least one window is needed"),
            _ if !(options.false_alarm > 0.0 && options.false_alarm < 1.0) => {
                Some("the false-alarm probability must be between 0 and 1")
            }
            _ => None,
        };
        if let Some(reason) = reason {
            return Err(AcquisitionError::Options(reason));
        }
        let bins = bins_per_period(signal, rate_hz);
        let (forward, inverse) = (forward_transform(bins), inverse_transform(bins));
        let codes = options
            .satellites
            .iter()
            .map(|transmission| {
                let mut spectrum = sampled_code(&transmission.code(), bins);
                forward.process(&mut spectrum);
                spectrum.iter_mut().for_each(|c| *c = c.conj());
                spectrum
            })
            .collect();
        let (period_s, chips) = (signal.period_s(), signal.chips as f64);
        let periods = (options.coherent_ms as f64 * 1e-3 / period_s).round().max(1.0) as usize;
        Ok(Self { options, rate_hz, period_s, periods, chips, bins, forward, inverse, codes })
    }

    /// Samples of one coherent window.
    pub fn window_len(&self) -> usize {
        (self.periods as f64 * self.rate_hz * self.period_s).ceil() as usize
    }

    /// Dopplers searched, Hz: multiples of half the inverse coherent time.
    fn dopplers(&self) -> impl Iterator<Item = i64> + use<> {
        let step = self.doppler_step();
        let (low, high) = self.options.doppler_hz;
        (low / step).floor() as i64..=(high / step).ceil() as i64
    }

    /// Coherent windows that a search of `samples` samples sums.
    pub fn windows(&self, samples: usize) -> usize {
        (samples / self.window_len()).min(self.options.max_windows)
    }

    /// Doppler bin spacing, Hz.
    pub fn doppler_step(&self) -> f64 {
        0.5 / self.period_s / self.periods as f64
    }

    /// Number of cells of the whole search.
    pub fn cells(&self) -> f64 {
        (self.options.satellites.len() * self.bins * self.dopplers().count()) as f64
    }

    /// Threshold of the statistic after `windows` non-coherent sums.
    pub fn threshold(&self, windows: usize) -> f64 {
        statistics::threshold(self.options.false_alarm, windows, self.cells())
    }

    /// Searches the samples of one channel (baseband) and returns the satellites whose statistic passes the
    /// threshold, strongest first.
    pub fn search(&self, samples: &[Complex32]) -> Result<Vec<Acquisition>, AcquisitionError> {
        self.search_channels(&[samples])
    }

    /// The same over all channels of an array, whose powers are summed: no geometry is needed. The channels
    /// are of one length and have equal noise floors. The C/N0 is that of one element.
    pub fn search_channels(
        &self,
        channels: &[&[Complex32]],
    ) -> Result<Vec<Acquisition>, AcquisitionError> {
        let samples = channels.first().copied().unwrap_or(&[]);
        let need = self.window_len();
        let windows = self.windows(samples.len());
        if windows == 0 {
            return Err(AcquisitionError::TooShort {
                have: samples.len(),
                need,
                coherent_ms: self.options.coherent_ms,
                rate_hz: self.rate_hz,
            });
        }
        let folded = self.fold(channels, windows);
        let looks = folded.looks;
        let threshold = self.threshold(looks);
        let peaks: Vec<Peak> = self
            .codes
            .par_iter()
            .zip(&self.options.satellites)
            .map(|(code, t)| self.search_one(code, t.cycles_per_chip(), &folded))
            .collect();
        let mut found: Vec<Acquisition> = self
            .options
            .satellites
            .iter()
            .zip(peaks)
            .filter(|(_, peak)| peak.statistic > threshold)
            .map(|(&transmission, peak)| self.acquisition(transmission, &peak, looks))
            .collect();
        found.sort_by(|a, b| b.statistic.total_cmp(&a.statistic));
        Ok(found)
    }

    fn acquisition(&self, transmission: Transmission, peak: &Peak, looks: usize) -> Acquisition {
        let delay = peak.bin as f64 / self.bins as f64 * self.chips;
        let snr = (peak.power - 1.0).max(1e-3);
        Acquisition {
            transmission,
            doppler_hz: peak.doppler_hz,
            code_phase_chips: (self.chips - delay) % self.chips,
            cn0_dbhz: 10.0 * (snr * (1.0 / self.period_s) / self.periods as f64).log10(),
            statistic: peak.statistic,
            false_alarm: statistics::search_false_alarm(peak.statistic, looks, self.cells()),
        }
    }

    /// Folds each window to one code period for every fraction of the spacing of the lines, and transforms
    /// it.
    fn fold(&self, channels: &[&[Complex32]], windows: usize) -> Folded {
        let (bins, periods) = (self.bins, self.periods);
        let fractions = 2 * periods;
        let looks = windows * channels.len();
        let mut spectra = vec![Complex32::ZERO; looks * fractions * bins];
        spectra.par_chunks_exact_mut(fractions * bins).enumerate().for_each(|(look, spectra)| {
            let sorted = self.sort_into_bins(channels[look / windows], look % windows);
            for (fraction, folded) in spectra.chunks_exact_mut(bins).enumerate() {
                let doppler = fraction as f64 * self.doppler_step();
                for (period, row) in sorted.chunks_exact(bins).enumerate() {
                    let turn = phasor(doppler * period as f64 * self.period_s);
                    folded.iter_mut().zip(row).for_each(|(sum, x)| *sum += x * turn);
                }
                for (bin, sum) in folded.iter_mut().enumerate() {
                    *sum *= phasor(doppler * bin as f64 / bins as f64 * self.period_s);
                }
                self.forward.process(folded);
            }
        });
        Folded { spectra, windows, looks }
    }

    /// Sums the samples of a window into as many rows as periods, of `bins` bins of code phase.
    fn sort_into_bins(&self, samples: &[Complex32], window: usize) -> Vec<Complex32> {
        let bins_per_sample = self.bins as f64 / (self.rate_hz * self.period_s);
        let total = self.periods * self.bins;
        let mut sorted = vec![Complex32::ZERO; total];
        let first_bin = (window * total) as f64;
        let first = (first_bin / bins_per_sample - 1e-6).ceil() as usize;
        for (n, sample) in samples.iter().enumerate().skip(first) {
            // A sample on the edge between two bins belongs to the later one in spite of rounding.
            let bin = (n as f64 * bins_per_sample - first_bin + 1e-6) as usize;
            match sorted.get_mut(bin) {
                Some(sum) => *sum += sample,
                None => break,
            }
        }
        sorted
    }

    /// The cell of maximum statistic for one code.
    fn search_one(&self, code: &[Complex32], cycles_per_chip: f64, folded: &Folded) -> Peak {
        let bins = self.bins;
        let fractions = 2 * self.periods as i64;
        let mut product = vec![Complex32::ZERO; bins];
        let mut scratch = vec![Complex32::ZERO; self.inverse.get_inplace_scratch_len()];
        let mut power = vec![0f32; bins];
        let mut best = Peak { statistic: 0.0, power: 0.0, doppler_hz: 0.0, bin: 0 };
        let dopplers = self.dopplers().count();
        let mut floors = Vec::with_capacity(dopplers);
        for index in self.dopplers() {
            let doppler_hz = index as f64 * self.doppler_step();
            let fraction = index.rem_euclid(fractions) as usize;
            let lines = index.div_euclid(fractions).rem_euclid(bins as i64) as usize;
            for look in 0..folded.looks {
                let window = look % folded.windows;
                let at = (look * fractions as usize + fraction) * bins;
                let (head, tail) = folded.spectra[at..at + bins].split_at(lines);
                let (code_head, code_tail) = code.split_at(bins - lines);
                multiply(tail, code_head, &mut product[..bins - lines]);
                multiply(head, code_tail, &mut product[bins - lines..]);
                self.inverse.process_with_scratch(&mut product, &mut scratch);
                // The code runs faster with the Doppler: later windows show it earlier by that much.
                let seconds = (window * self.periods) as f64 * self.period_s;
                let advance = doppler_hz / cycles_per_chip * seconds * bins as f64 / self.chips;
                let advance = (advance.round() as i64).rem_euclid(bins as i64) as usize;
                let (early, late) = product.split_at(bins - advance);
                add_power(early, &mut power[advance..], look == 0);
                add_power(late, &mut power[..advance], look == 0);
            }
            let (bin, highest, total) = peak_and_sum(&power);
            let statistic = f64::from(highest) * (folded.looks * bins) as f64
                / f64::from(total).max(f64::MIN_POSITIVE);
            if statistic > best.statistic {
                let power = f64::from(highest) * bins as f64;
                best = Peak { statistic, power, doppler_hz, bin };
            }
            floors.push(total);
        }
        // A strong signal raises the mean of its own row, so the noise is that of the median row.
        let (_, &mut floor, _) = floors.select_nth_unstable_by(dopplers / 2, f32::total_cmp);
        best.power /= f64::from(floor).max(f64::MIN_POSITIVE);
        best
    }
}

/// The signal parameters common to all transmissions of a search, which must suit the sampling rate.
pub(crate) fn searched_signal(
    satellites: &[Transmission],
    rate_hz: f64,
) -> Result<&'static Signal, AcquisitionError> {
    let no_search = AcquisitionError::Options;
    let signal = satellites.first().ok_or(no_search("no satellite is requested"))?.signal;
    let Signal { name, chip_rate_hz, chips, .. } = *signal;
    let alike = |t: &Transmission| (t.signal.chips, t.signal.chip_rate_hz) == (chips, chip_rate_hz);
    if !satellites.iter().all(alike) {
        return Err(no_search("codes of different lengths or rates are searched one by one"));
    }
    if !rate_hz.is_finite() || rate_hz < chip_rate_hz {
        return Err(AcquisitionError::Rate { rate_hz, name, chip_rate_hz });
    }
    Ok(signal)
}

/// Bins per code period: as many as samples or slightly fewer, two to five per chip, with prime factors
/// 2, 3 and 5 only. (FFT lengths with larger ones cost up to four times as much.)
fn bins_per_period(signal: &Signal, rate_hz: f64) -> usize {
    let is_smooth = |n: &usize| {
        let rest = [2, 3, 5].into_iter().fold(*n, |mut rest, prime| {
            while rest.is_multiple_of(prime) {
                rest /= prime;
            }
            rest
        });
        rest == 1
    };
    let from = |bins: usize| (bins..).find(is_smooth).unwrap_or(bins);
    let (lowest, highest) = (BINS_PER_CHIP.0 * signal.chips, from(BINS_PER_CHIP.1 * signal.chips));
    let samples = (rate_hz * signal.period_s() + 1e-6) as usize;
    (lowest..=samples.min(highest)).rev().find(is_smooth).unwrap_or(from(lowest))
}

/// One period of a code at the middle of each of `bins` bins.
fn sampled_code(chips: &[i8], bins: usize) -> Vec<Complex32> {
    (0..bins)
        .map(|bin| Complex32::from(f32::from(chips[(2 * bin + 1) * chips.len() / (2 * bins)])))
        .collect()
}

/// exp(-j 2 pi cycles).
pub(crate) fn phasor(cycles: f64) -> Complex32 {
    let turn = Complex64::cis(-TAU * cycles.fract());
    Complex32::new(turn.re as f32, turn.im as f32)
}

#[multiversion::multiversion(targets(
    "x86_64+avx2+fma",
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "aarch64+neon"
))]
pub(crate) fn multiply(a: &[Complex32], b: &[Complex32], out: &mut [Complex32]) {
    for ((a, b), out) in a.iter().zip(b).zip(out) {
        *out = Complex32::new(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx2+fma",
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "aarch64+neon"
))]
pub(crate) fn add_power(values: &[Complex32], power: &mut [f32], replace: bool) {
    for (power, value) in power.iter_mut().zip(values) {
        let norm = value.re * value.re + value.im * value.im;
        *power = if replace { norm } else { *power + norm };
    }
}

/// Index and value of the maximum, and the sum of all.
#[multiversion::multiversion(targets(
    "x86_64+avx2+fma",
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "aarch64+neon"
))]
fn peak_and_sum(power: &[f32]) -> (usize, f32, f32) {
    const LANES: usize = 16;
    let (chunks, rest) = power.as_chunks::<LANES>();
    let (mut highest, mut sums) = ([0f32; LANES], [0f32; LANES]);
    for chunk in chunks {
        for lane in 0..LANES {
            highest[lane] = highest[lane].max(chunk[lane]);
            sums[lane] += chunk[lane];
        }
    }
    let peak = rest.iter().chain(&highest).copied().fold(0f32, f32::max);
    let sum = sums.iter().chain(rest).sum();
    (power.iter().position(|&p| p == peak).unwrap_or(0), peak, sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlator::test_signal::{TestSignal, four_valued_noise};

    #[test]
    fn a_satellite_is_found_at_its_code_phase_and_doppler_at_every_kind_of_rate() {
        for (rate, doppler, delay) in [
            (2.6e6, 1234.0, 0.123e-3),
            (4e6, -4321.0, 0.9e-3),
            (5.456e6, 2500.0, 0.5e-3),
            (20e6, -10.0, 0.4444e-3),
            (2.048e6, 4987.0, 0.0),
        ] {
            let sv = "G17".parse().unwrap();
            let satellites = vec![signal::of(sv)];
            let plan =
                SearchPlan::new(rate, SearchOptions { satellites, ..Default::default() }).unwrap();
            let len = (rate * 20e-3) as usize;
            // A symbol edge in the middle of the first window must not hide it.
            let signal = TestSignal {
                rate,
                doppler,
                delay_s: delay,
                cn0_dbhz: 44.0,
                fade_db: 0.0,
                fade_s: 0.0,
                symbol_edge: 5,
                seed: 1,
            };
            let found = plan.search(&signal.samples(sv, len)).unwrap();
            assert_eq!(found.len(), 1, "{rate}");
            assert!(
                (found[0].doppler_hz - doppler).abs() <= 100.0,
                "{rate}: {}",
                found[0].doppler_hz
            );
            let error = (found[0].code_offset_s() - delay + 0.5e-3).rem_euclid(1e-3) - 0.5e-3;
            assert!((error * 1.023e6).abs() < 0.5, "{rate}: {} chips", error * 1.023e6);
        }
    }

    #[test]
    fn false_alarms_occur_with_the_requested_probability() {
        // 10^5 searches of pure noise: one satellite, +-500 Hz, one window of 1 ms, 1 % requested.
        const SEARCHES: usize = 100_000;
        let rate = 2.048e6;
        let options = SearchOptions {
            satellites: vec![signal::of("G05".parse().unwrap())],
            doppler_hz: (-500.0, 500.0),
            doppler_rate_hz_s: 0.0,
            coherent_ms: 1,
            max_windows: 1,
            false_alarm: 0.01,
        };
        let plan = SearchPlan::new(rate, options).unwrap();
        let alarms: usize = (0..SEARCHES as u64)
            .into_par_iter()
            .map(|seed| plan.search(&four_valued_noise(plan.window_len(), seed)).unwrap().len())
            .sum();
        // 1000 expected if all cells were independent, standard deviation 32; neighbours that exceed
        // together lower it by at most a tenth (see the module `statistics`).
        assert!((800..=1100).contains(&alarms), "{alarms} false alarms in {SEARCHES} searches");
    }

    #[test]
    fn impossible_searches_are_errors() {
        let with = |change: fn(&mut SearchOptions)| {
            let mut options = SearchOptions::default();
            change(&mut options);
            SearchPlan::new(4e6, options).err()
        };
        assert!(matches!(
            SearchPlan::new(1e6, SearchOptions::default()).err(),
            Some(AcquisitionError::Rate { .. })
        ));
        assert!(with(|o| o.satellites.clear()).is_some());
        assert!(with(|o| o.doppler_hz = (1.0, -1.0)).is_some());
        assert!(with(|o| o.doppler_hz = (-3e6, 3e6)).is_some());
        assert!(with(|o| o.coherent_ms = 0).is_some());
        assert!(with(|o| o.false_alarm = 0.0).is_some());
        let plan = SearchPlan::new(4e6, SearchOptions::default()).unwrap();
        assert!(matches!(
            plan.search(&[Complex32::ZERO; 100]),
            Err(AcquisitionError::TooShort { .. })
        ));
        assert!(plan.search(&vec![Complex32::ZERO; 40_000]).unwrap().is_empty());
    }
}
