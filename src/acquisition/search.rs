//! Parallel code-phase search over all satellites and Dopplers.
//!
//! Per coherent window of K code periods T the samples are sorted into N bins per period. Folding the K
//! periods after a carrier of Doppler f = f_j + c/T is removed needs only the 2K fractions f_j of 1/T (1 kHz
//! of a C/A code), since exp(-j 2 pi (c/T) m T) = 1 for whole periods m; within the period c/T is a shift of
//! the spectrum by c lines. Cost: 2K forward FFTs of N per window, and then one inverse FFT of N per
//! satellite, component, Doppler, window and channel, which dominates; sixteen satellites are transformed
//! side by side.
//!
//! Where each code period may change its sign (symbols of one period, or the secondary code of a pilot) a window is one
//! period, K = 1. A change within it costs half of the power at worst, a third on average. Of data and pilot, which are
//! of equal power, the powers of both are summed.
//!
//! The noise is what the samples show, not white noise by assumption. Each window counts by its own power, and one of
//! zeros not at all. Each row (code, Doppler) is compared with its own mean. Where the powers of a row vary more from
//! cell to cell than those of noise do, as under a carrier or a strong satellite, it has as many looks as its spread
//! shows ([`super::statistics`]).

mod fan;
mod lanes;
mod rows;

use super::subtract::subtract;
use super::{Acquisition, cross_correlation, statistics};
use crate::gnss::{Signal, Sv, Transmission, signal};
use fan::Fan;
use lanes::LaneTransform;
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use sdr_rx_linalg::{Fft, forward_transform, inverse_transform};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Minimum and maximum number of bins per chip.
const BINS_PER_CHIP: (usize, usize) = (2, 5);
/// Bins per chip of a signal with a subcarrier, whose peak is three times narrower. They may be more than samples: a bin
/// is the place of a sample in the code.
const BINS_PER_BOC_CHIP: usize = 4;
/// Maximum number of windows where a window is one code period of 4 ms and more.
const MOST_ALIGNED_WINDOWS: usize = 10;

/// What to search.
#[derive(Clone, Debug)]
pub struct SearchOptions {
    /// Satellites and their signals; those of a plan are of one code length and chip rate ([`SearchOptions::by_code`]).
    pub satellites: Vec<Transmission>,
    /// Doppler interval, Hz, both ends included.
    pub doppler_hz: (f64, f64),
    /// Maximum rate of the Doppler, Hz/s, either way, that the refinement searches; the search itself assumes
    /// none, which loses nothing below 1 / (8 T^2) for windows of T seconds.
    pub doppler_rate_hz_s: f64,
    /// Coherent integration, whole ms (1 to 20); one code period where each may change its sign.
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

impl SearchOptions {
    /// The same for the satellites of each code length and chip rate, in the order in which they are first named. The
    /// false-alarm probability is divided equally.
    pub fn by_code(&self) -> Vec<Self> {
        let code = |t: &Transmission| (t.signal.chips, t.signal.chip_rate_hz);
        let mut groups: Vec<Vec<Transmission>> = Vec::new();
        for &transmission in &self.satellites {
            match groups.iter_mut().find(|g| code(&g[0]) == code(&transmission)) {
                Some(group) => group.push(transmission),
                None => groups.push(vec![transmission]),
            }
        }
        let false_alarm = self.false_alarm / groups.len().max(1) as f64;
        let of = |satellites| Self { satellites, false_alarm, ..self.clone() };
        groups.into_iter().map(of).collect()
    }
}

/// Why a search is impossible.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AcquisitionError {
    /// The rate is too low for the signal.
    #[error(
        "a sampling rate of {rate_hz} Hz is below what {name} needs, {} MHz: is the rate right?",
        least_hz / 1e6
    )]
    Rate {
        /// Rate, Hz.
        rate_hz: f64,
        /// The signal.
        name: &'static str,
        /// The lowest rate at which its chips, or halves of its subcarrier, are told apart, Hz.
        least_hz: f64,
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
    lanes: LaneTransform,
    /// Conjugate spectra of the codes of each satellite, one per component.
    codes: Vec<Vec<Vec<Complex32>>>,
    components: usize,
    /// Beams of the channels, of norm 1.
    beams: Vec<Vec<Complex32>>,
}

/// Standard deviations by which the spread of a row exceeds that of noise before it is not noise.
const SPREAD_SIGMAS: f64 = 4.0;
/// Independent powers in a row, per chip: the correlation of chips is a triangle, whose square has an area of 2/3.
const POWERS_PER_CHIP: f64 = 1.5;
/// Chips either side of a peak that do not count as noise.
const PEAK_CHIPS: f64 = 1.5;
/// Up to this mean power of its cross-correlations (of the noise's) in a row, a satellite's own level and codes say
/// which cell it explains; above, the spread of the row decides.
const MINOR_CROSS_CORRELATION: f64 = 1.0;
/// Relative variance of the cross-correlations of two codes from cell to cell, at most: at equal Dopplers they have
/// three values (Kaplan & Hegarty, 3rd ed., 3.3.3).
const CROSS_CORRELATION_SPREAD: f64 = 3.0;

/// The spectra of the folded windows, by look (a window of a channel) and fraction of the spacing of the lines.
struct Folded {
    /// `[look][fraction][bin]`, flattened; each look of mean power 1 before it was folded.
    spectra: Vec<Complex32>,
    /// The window of each look.
    windows: Vec<usize>,
}

/// The best cell of a row.
#[derive(Clone, Copy)]
struct Peak {
    /// Doppler, in steps.
    index: i64,
    bin: usize,
    /// Power over the mean of its row, times the number of looks.
    statistic: f64,
    /// Logarithm of the probability that noise of the row's spread reaches it in one cell.
    ln_false_alarm: f64,
    /// Power over that of the noise.
    power: f64,
    /// Relative variance of the other cells of the row.
    spread: f64,
}

/// A satellite of a search: what was found, and its code's spectrum.
#[derive(Clone)]
struct Candidate<'a> {
    acquisition: Acquisition,
    index: i64,
    bin: usize,
    /// Power over that of the noise.
    power: f64,
    codes: std::borrow::Cow<'a, [Vec<Complex32>]>,
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
        let codes: Vec<_> =
            options.satellites.iter().map(|t| code_spectra(*t, bins, &*forward)).collect();
        let components = codes[0].len();
        let (period_s, chips) = (signal.period_s(), signal.chips as f64);
        let periods = match options.satellites[0].timing().is_aligned {
            true => 1,
            false => (options.coherent_ms as f64 * 1e-3 / period_s).round().max(1.0) as usize,
        };
        let beams = Vec::new();
        Ok(Self {
            options,
            rate_hz,
            period_s,
            periods,
            chips,
            bins,
            forward,
            inverse,
            lanes: LaneTransform::new(bins),
            codes,
            components,
            beams,
        })
    }

    /// The same search, which also decides on the power of each of these beams of the channels (one weight a channel),
    /// in all of which the noise is alike. The false-alarm probability is divided between the beams and the sum of the
    /// channels' powers. Beams are formed of the correlations, so they cost no transforms.
    pub fn with_beams(mut self, beams: &[Vec<Complex64>]) -> Self {
        let unit = |beam: &Vec<Complex64>| {
            let norm = beam.iter().map(|w| w.norm_sqr()).sum::<f64>().sqrt();
            beam.iter()
                .map(|w| Complex32::new((w.re / norm) as f32, (w.im / norm) as f32))
                .collect()
        };
        self.beams = beams.iter().map(unit).collect();
        self
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
        let asked_s = (self.options.coherent_ms * self.options.max_windows) as f64 * 1e-3;
        let window_s = self.periods as f64 * self.period_s;
        let most = match self.options.satellites[0].timing().is_aligned {
            true => ((asked_s / window_s + 1e-6) as usize).clamp(1, MOST_ALIGNED_WINDOWS),
            false => self.options.max_windows,
        };
        (samples / self.window_len()).min(most)
    }

    /// Doppler bin spacing, Hz.
    pub fn doppler_step(&self) -> f64 {
        0.5 / self.period_s / self.periods as f64
    }

    /// Number of cells of the whole search.
    pub fn cells(&self) -> f64 {
        (self.options.satellites.len() * self.bins * self.dopplers().count()) as f64
    }

    /// Threshold of the statistic after `looks` non-coherent sums.
    pub fn threshold(&self, looks: usize) -> f64 {
        statistics::threshold(self.options.false_alarm, looks as f64, self.cells() * self.tests())
    }

    /// Tests of each cell: with beams also theirs, which have half of the false-alarm probability.
    fn tests(&self) -> f64 {
        if self.beams.is_empty() { 1.0 } else { 2.0 }
    }

    /// Searches the samples of one channel (baseband) and returns the satellites that noise, or the cross-correlation
    /// with a stronger one, would show less often than the false-alarm probability has it, strongest first.
    pub fn search(&self, samples: &[Complex32]) -> Result<Vec<Acquisition>, AcquisitionError> {
        self.search_channels(&[samples], &[])
    }

    /// The same over all channels of an array, whose powers are summed: no geometry is needed. The channels
    /// are of one length and have equal noise floors. The C/N0 is that of one element. Of satellites `known`
    /// beforehand (code phases at the first sample) the cross-correlations are not returned.
    ///
    /// Satellites whose cross-correlations exceed the noise are subtracted, and the others searched once more.
    pub fn search_channels(
        &self,
        channels: &[&[Complex32]],
        known: &[Acquisition],
    ) -> Result<Vec<Acquisition>, AcquisitionError> {
        let mut found = self.search_once(channels, known, &[])?;
        let all: Vec<Acquisition> = found.iter().chain(known).copied().collect();
        // In a beam, and against the noise of the sum, cross-correlations are stronger than in one channel.
        let gain = channels.len() as f64;
        let strong = masking(&all, gain * self.periods as f64 * self.period_s);
        if strong.is_empty() {
            return Ok(found);
        }
        let used = self.windows(channels[0].len()) * self.window_len();
        let mut rest: Vec<Vec<Complex32>> = channels.iter().map(|c| c[..used].to_vec()).collect();
        subtract(&mut rest, self.rate_hz, &strong, 2.0 * self.doppler_step(), 0.0);
        let rest: Vec<&[Complex32]> = rest.iter().map(Vec::as_slice).collect();
        let is_strong = |a: &Acquisition| strong.iter().any(|s| s.transmission == a.transmission);
        found.retain(is_strong);
        let known: Vec<_> = known.iter().filter(|a| !is_strong(a)).copied().collect();
        found.extend(self.search_once(&rest, &known, &strong)?);
        found.sort_by(|a, b| b.cn0_dbhz.total_cmp(&a.cn0_dbhz));
        Ok(found)
    }

    /// One pass for the satellites that are not among `skipped`.
    fn search_once(
        &self,
        channels: &[&[Complex32]],
        known: &[Acquisition],
        skipped: &[Acquisition],
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
        let looks = self.looks(&folded);
        let is_wanted =
            |k: &usize| skipped.iter().all(|s| s.transmission != self.options.satellites[*k]);
        let wanted: Vec<usize> = (0..self.codes.len()).filter(is_wanted).collect();
        if looks == 0 || wanted.is_empty() {
            return Ok(Vec::new());
        }
        let threshold = self.threshold(looks);
        let is_whole = looks == windows * channels.len();
        let fan = (is_whole && !self.beams.is_empty()).then(|| Fan::new(self, windows));
        let best = self.search_all(&wanted, &folded, threshold, fan.as_ref());
        let mut floors: Vec<f64> = best.iter().map(|b| b.floor).collect();
        let (_, &mut floor, _) = floors.select_nth_unstable_by(best.len() / 2, f64::total_cmp);
        let candidate = |(k, peak): (usize, Peak)| Candidate {
            acquisition: self.acquisition(self.options.satellites[k], &peak),
            index: peak.index,
            bin: peak.bin,
            power: peak.power,
            codes: self.codes[k].as_slice().into(),
        };
        let own = |pick: fn(&rows::Best) -> Option<Peak>| {
            wanted.iter().zip(&best).filter_map(move |(&k, b)| Some((k, pick(b)?)))
        };
        let mut found: Vec<Candidate> = own(|b| b.sound).map(candidate).collect();
        found.extend(known.iter().filter_map(|a| self.known(a, &folded, floor)));
        let is_alike = |peak: &Peak| self.is_cross_correlation_minor(peak, &found, &folded, floor);
        // Of these all looks decide, as of white noise.
        let white = |(k, peak): (usize, Peak)| {
            let ln_false_alarm = statistics::ln_cell_false_alarm(peak.statistic, looks as f64);
            (k, Peak { ln_false_alarm, ..peak })
        };
        let more: Vec<Candidate> = own(|b| b.doubtful.filter(|_| b.sound.is_none()))
            .filter(|(_, peak)| is_alike(peak))
            .map(white)
            .map(candidate)
            .collect();
        found.extend(more);
        found.sort_by(|a, b| b.power.total_cmp(&a.power));
        let mut kept: Vec<Candidate> = Vec::new();
        for weak in found {
            let explains = |strong: &Candidate| self.explains(strong, &weak, &folded, floor);
            if !kept.iter().any(explains) {
                kept.push(weak);
            }
        }
        let is_new = |a: &Acquisition| known.iter().all(|k| k.transmission != a.transmission);
        Ok(kept.iter().map(|c| c.acquisition).filter(is_new).collect())
    }

    fn acquisition(&self, transmission: Transmission, peak: &Peak) -> Acquisition {
        let delay = peak.bin as f64 / self.bins as f64 * self.chips;
        let snr = (peak.power - 1.0).max(1e-3);
        let cell = (peak.ln_false_alarm.exp() * self.tests()).min(1.0);
        Acquisition {
            transmission,
            doppler_hz: peak.index as f64 * self.doppler_step(),
            code_phase_chips: (self.chips - delay) % self.chips,
            cn0_dbhz: 10.0 * (snr * (1.0 / self.period_s) / self.periods as f64).log10(),
            statistic: peak.statistic,
            false_alarm: -(self.cells() * (-cell).ln_1p()).exp_m1(),
        }
    }

    /// A satellite that is known to be there.
    fn known(&self, a: &Acquisition, folded: &Folded, floor: f64) -> Option<Candidate<'static>> {
        let Signal { chips, chip_rate_hz, .. } = *a.transmission.signal;
        let own = self.options.satellites[0].signal;
        if (chips, chip_rate_hz) != (own.chips, own.chip_rate_hz) {
            return None;
        }
        let delay = (self.chips - a.code_phase_chips) / self.chips * self.bins as f64;
        let mut candidate = Candidate {
            acquisition: *a,
            index: (a.doppler_hz / self.doppler_step()).round() as i64,
            bin: delay.round() as usize % self.bins,
            power: 0.0,
            codes: code_spectra(a.transmission, self.bins, &*self.forward).into(),
        };
        // The nearest cell of the grid is not always the one that shows most.
        let (index, bin) = (candidate.index, candidate.bin + self.bins);
        for (index, bin) in
            [-1, 0, 1].into_iter().flat_map(|i| (bin - 1..=bin + 1).map(move |b| (index + i, b)))
        {
            let at = Candidate { index, bin: bin % self.bins, ..candidate.clone() };
            let power = self.cell_power(&at, index, folded, floor);
            if power > candidate.power {
                candidate = Candidate { power, ..at };
            }
        }
        Some(candidate)
    }

    /// Whether the powers of a row vary from cell to cell as noise does to which the cross-correlations of these
    /// satellites, all weak, are added.
    fn is_cross_correlation_minor(
        &self,
        peak: &Peak,
        satellites: &[Candidate],
        folded: &Folded,
        floor: f64,
    ) -> bool {
        let means = satellites.iter().map(|s| {
            (self.cell_power(s, self.nearest_row(s, peak.index), folded, floor) - 1.0).max(0.0)
                / self.chips
        });
        let (mean, squares) = means.fold((0.0, 0.0), |(m, q), p| (m + p, q + p * p));
        let noise = (1.0 + 2.0 * mean) / self.looks(folded) as f64;
        let expected = (noise + CROSS_CORRELATION_SPREAD * squares) / (1.0 + mean).powi(2);
        mean < MINOR_CROSS_CORRELATION && peak.spread < expected * (1.0 + self.spread_error())
    }

    /// Whether the cross-correlation with a stronger satellite explains a cell.
    fn explains(&self, strong: &Candidate, weak: &Candidate, folded: &Folded, floor: f64) -> bool {
        // No two C/A codes correlate to more than -19 dB at any Doppler.
        if strong.power < cross_correlation::MIN_SUPPRESSION * (weak.power - 1.0) {
            return false;
        }
        // As much of the stronger one as is in the same fraction of the spacing of the lines, data included.
        let row = self.nearest_row(strong, weak.index);
        // Its own Doppler lies up to half a row off.
        let powers = [row - 1, row, row + 1].map(|r| self.cell_power(strong, r, folded, floor));
        let there = powers.into_iter().fold(1.0, f64::max) - 1.0;
        let lines = (row - weak.index) / (2 * self.periods as i64);
        let share = cross_correlation::cross_power(&strong.acquisition, &weak.acquisition, lines);
        cross_correlation::explains(there * share, weak.power - 1.0, self.looks(folded))
    }

    /// The row nearest to a satellite of those with the fraction of the spacing of the lines of row `index`.
    fn nearest_row(&self, satellite: &Candidate, index: i64) -> i64 {
        let fractions = 2 * self.periods as i64;
        let lines = (satellite.index - index) as f64 / fractions as f64;
        index + lines.round() as i64 * fractions
    }

    /// Standard deviations, times how many count, of the measured relative variance of a row of noise.
    fn spread_error(&self) -> f64 {
        SPREAD_SIGMAS * 2.0 / (POWERS_PER_CHIP * self.chips).sqrt()
    }

    /// Folds each window to one code period for every fraction of the spacing of the lines, and transforms
    /// it.
    fn fold(&self, channels: &[&[Complex32]], windows: usize) -> Folded {
        let (bins, periods) = (self.bins, self.periods);
        let looks: Vec<(usize, Vec<Complex32>)> = (0..windows * channels.len())
            .into_par_iter()
            .filter_map(|look| {
                let mut sorted = self.sort_into_bins(channels[look / windows], look % windows);
                let power = sorted.iter().map(|x| f64::from(x.norm_sqr())).sum::<f64>();
                let scale = (sorted.len() as f64 / power).sqrt() as f32;
                sorted.iter_mut().for_each(|x| *x *= scale);
                (power > 0.0 && scale.is_finite()).then_some((look % windows, sorted))
            })
            .collect();
        let fractions = 2 * periods;
        let mut spectra = vec![Complex32::ZERO; looks.len() * fractions * bins];
        spectra.par_chunks_exact_mut(fractions * bins).zip(&looks).for_each(
            |(spectra, (_, sorted))| {
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
            },
        );
        Folded { spectra, windows: looks.into_iter().map(|l| l.0).collect() }
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

    /// The spectrum of a look for the fraction of the spacing of the lines of row `index`, and by how many lines it is
    /// shifted there.
    fn row_spectrum<'a>(
        &self,
        index: i64,
        look: usize,
        folded: &'a Folded,
    ) -> (&'a [Complex32], usize) {
        let (bins, fractions) = (self.bins, 2 * self.periods as i64);
        let fraction = index.rem_euclid(fractions) as usize;
        let lines = index.div_euclid(fractions).rem_euclid(bins as i64) as usize;
        let at = (look * fractions as usize + fraction) * bins;
        (&folded.spectra[at..at + bins], lines)
    }

    /// The spectrum of a row's correlation in one look.
    fn multiply_row(
        &self,
        code: &[Complex32],
        index: i64,
        look: usize,
        folded: &Folded,
        product: &mut [Complex32],
    ) {
        let bins = self.bins;
        let (spectrum, lines) = self.row_spectrum(index, look, folded);
        let (head, tail) = spectrum.split_at(lines);
        let (code_head, code_tail) = code.split_at(bins - lines);
        multiply(tail, code_head, &mut product[..bins - lines]);
        multiply(head, code_tail, &mut product[bins - lines..]);
    }

    /// Bins by which a look shows a code earlier than the first window does: it runs faster with the Doppler.
    fn advance(&self, cycles_per_chip: f64, index: i64, look: usize, folded: &Folded) -> usize {
        let doppler_hz = index as f64 * self.doppler_step();
        let seconds = (folded.windows[look] * self.periods) as f64 * self.period_s;
        let advance = doppler_hz / cycles_per_chip * seconds * self.bins as f64 / self.chips;
        (advance.round() as i64).rem_euclid(self.bins as i64) as usize
    }

    /// Power over that of the noise of a satellite, at its code phase, in one row.
    fn cell_power(&self, satellite: &Candidate, index: i64, folded: &Folded, floor: f64) -> f64 {
        let bins = self.bins;
        let cycles_per_chip = satellite.acquisition.transmission.cycles_per_chip();
        let mut product = vec![Complex32::ZERO; bins];
        let power = |(code, look): (&[Complex32], usize)| {
            self.multiply_row(code, index, look, folded, &mut product);
            let advance = self.advance(cycles_per_chip, satellite.index, look, folded);
            let bin = (satellite.bin + bins - advance) % bins;
            let turn = |n: usize| phasor(-((n * bin % bins) as f64) / bins as f64);
            let sum: Complex32 = product.iter().enumerate().map(|(n, x)| x * turn(n)).sum();
            f64::from(sum.norm_sqr())
        };
        let total: f64 = looks_of(&satellite.codes, folded).map(power).sum();
        total * bins as f64 / floor
    }

    /// Powers that are summed in a cell: of each component in each window and channel.
    fn looks(&self, folded: &Folded) -> usize {
        self.components * folded.windows.len()
    }
}

/// The satellites whose cross-correlations exceed the noise of so many coherent seconds, strongest first.
pub(crate) fn masking(satellites: &[Acquisition], coherent_s: f64) -> Vec<Acquisition> {
    let is_masking = |a: &&Acquisition| {
        let snr = 10f64.powf(a.cn0_dbhz / 10.0) * coherent_s;
        snr / a.transmission.signal.chips as f64 > MINOR_CROSS_CORRELATION
    };
    let mut strong: Vec<_> = satellites.iter().filter(is_masking).copied().collect();
    strong.sort_by(|a, b| b.cn0_dbhz.total_cmp(&a.cn0_dbhz));
    strong
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
    let least_hz = signal.modulation.narrowband().pieces() as f64 * chip_rate_hz;
    if !rate_hz.is_finite() || rate_hz < least_hz {
        return Err(AcquisitionError::Rate { rate_hz, name, least_hz });
    }
    Ok(signal)
}

/// Bins per code period: as many as samples or slightly fewer, two to five per chip, with prime factors
/// 2, 3 and 5 only; four per chip of a signal with a subcarrier. (FFT lengths with larger ones cost up to four times as much.)
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
    if signal.modulation.side_peaks_chips().next().is_some() {
        return from(BINS_PER_BOC_CHIP * signal.chips);
    }
    let (lowest, highest) = (BINS_PER_CHIP.0 * signal.chips, from(BINS_PER_CHIP.1 * signal.chips));
    let samples = (rate_hz * signal.period_s() + 1e-6) as usize;
    (lowest..=samples.min(highest)).rev().find(is_smooth).unwrap_or(from(lowest))
}

/// Conjugate spectra of the codes of a transmission and of its other component of equal power.
fn code_spectra(
    transmission: Transmission,
    bins: usize,
    forward: &dyn Fft<f32>,
) -> Vec<Vec<Complex32>> {
    let fraction = transmission.signal.power_fraction;
    let partner = transmission.partner().filter(|p| p.signal.power_fraction == fraction);
    let spectrum = |component: Transmission| {
        let (_, replica) = component.signal.modulation.replica(&component.code());
        let mut spectrum = sampled_code(&replica, bins);
        forward.process(&mut spectrum);
        spectrum.iter_mut().for_each(|c| *c = c.conj());
        spectrum
    };
    [transmission].into_iter().chain(partner).map(spectrum).collect()
}

/// The codes of each component in each look.
fn looks_of<'a>(
    codes: &'a [Vec<Complex32>],
    folded: &Folded,
) -> impl Iterator<Item = (&'a [Complex32], usize)> + use<'a> {
    let looks = folded.windows.len();
    codes.iter().flat_map(move |code| (0..looks).map(move |look| (&code[..], look)))
}

/// One period of a code, in equal pieces, at the middle of each of `bins` bins.
fn sampled_code(chips: &[i8], bins: usize) -> Vec<Complex32> {
    (0..bins)
        .map(|bin| Complex32::from(f32::from(chips[(2 * bin + 1) * chips.len() / (2 * bins)])))
        .collect()
}

/// Adds weight x.
#[multiversion::multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
pub(crate) fn add_product(weight: Complex32, x: &[Complex32], sums: &mut [Complex32]) {
    for (sum, x) in sums.iter_mut().zip(x) {
        sum.re += weight.re * x.re - weight.im * x.im;
        sum.im += weight.re * x.im + weight.im * x.re;
    }
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

/// The maximum, and the sum of all.
#[cfg(test)]
mod tests;
