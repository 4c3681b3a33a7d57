//! Acquisition from signals by their code periods: all codes are searched in a few waveforms, instead of in
//! every millisecond of every element.
//!
//! The first r right singular vectors of the code periods ([`super::svd`]) span the waveforms of the
//! satellites present. A waveform w of unit norm that is not among them has the fraction
//!
//! s = sum_j |v_j^H w|^2 ~ Beta(r, N - r), P(s > x) = sum_{i < r} C(N-1, i) x^i (1-x)^(N-1-i)
//!
//! of its power in a random r-dimensional subspace of N dimensions, which is what noise gives. Three passes:
//!
//! 1. Strong satellites: the first eight vectors, Dopplers 1 kHz apart. A code is certain if its fraction
//!    exceeds the threshold by three times the maximum cross-correlation; half a Doppler step off, 0.4 of the
//!    fraction remains. Codes that are certain are interpolated between the cells and projected out of the
//!    subspace.
//! 2. All others, in the remainder of all r vectors, Dopplers 0.5 kHz apart.
//! 3. Codes that have become certain are projected out too. Of the rest, those that passed must still pass;
//!    those that nearly passed and were mostly cross-correlation of a certain code are searched again.
//!
//! Cost: a forward transform for each code, vector and fraction of 1 kHz, and an inverse transform for each
//! satellite, Doppler and vector. The first pass takes 32 x 11 x 8 for 5 kHz; each satellite that it finds
//! saves 21 r in the second one, and, from a fraction of 0.2 on, 21 for each other satellite.

use super::cells::{Cell, Cells, CodeFound, Row};
use super::periods::{CodePeriods, product};
use super::svd::CodePeriodSvd;
use crate::acquisition::AcquisitionError;
use crate::acquisition::search::{add_product, searched_signal};
use crate::array::CMat;
use crate::gnss::{Sv, Transmission, signal};
use num_complex::{Complex32, Complex64};
use sdr_rx_linalg::hermitian_eigen;

/// Maximum number of rows, elements x periods: the cost of eigenvalues grows with their cube.
const MAX_ROWS: usize = 1024;

/// Maximum cross-correlation of two C/A codes at any Doppler, -21.1 dB (Kaplan & Hegarty, 3rd ed., 3.3): the
/// contribution of a satellite of fraction 1 to another's code.
const CROSS_CORRELATION: f64 = 0.0078;
/// A code is certain if its fraction exceeds the threshold by so many maximum cross-correlations.
const CERTAIN: f64 = 3.0;
/// The last pass searches the codes whose fraction was above this part of the threshold in the second, and
/// fell below this part of its value when the satellites found were projected out.
const NEARLY: f64 = 0.75;
/// Fraction of its power that a direction of the subspace must keep in the projection to be used further: a
/// satellite found with a fraction of 0.2 or more removes the direction nearest to it.
const MIN_KEPT: f64 = 0.8;
/// Probability that the number of signals is too high: 2.5 widths of the Tracy-Widom distribution.
const RANK_FALSE_ALARM: f64 = 2.5e-5;
/// Vectors that the pass for strong satellites uses, unless there are more signals.
const STRONG_COMPONENTS: usize = 8;

/// Options of the search.
#[derive(Clone, Debug)]
pub struct CodePeriodOptions {
    /// Satellites and their signals, of one code length and chip rate.
    pub satellites: Vec<Transmission>,
    /// Maximum Doppler, Hz.
    pub max_doppler_hz: f64,
    /// Code periods used, at most 1024 over the number of elements.
    pub periods: usize,
    /// Right vectors searched, unless there are more signals.
    pub components: usize,
    /// Probability of one or more false satellites.
    pub false_alarm: f64,
}

impl CodePeriodOptions {
    /// All GPS satellites within +-5 kHz, one false alarm in 10^5 searches; 16 vectors, or 24 with one
    /// antenna and more than 50 ms.
    pub fn new(elements: usize, periods: usize) -> Self {
        Self {
            satellites: Sv::all_gps().map(signal::of).collect(),
            max_doppler_hz: 5000.0,
            periods,
            components: if elements == 1 && periods > 50 { 24 } else { 16 },
            false_alarm: 1e-5,
        }
    }
}

/// Result of the search.
#[derive(Clone, Debug)]
pub struct CodePeriodLook {
    /// The decomposition: number of signals, noise variance, right vectors, snapshots without codes.
    pub svd: CodePeriodSvd,
    /// Satellites, strongest first.
    pub found: Vec<CodeFound>,
    /// Number of Fourier transforms.
    pub transforms: usize,
    /// Inverse transforms of the full non-coherent search of the same elements, periods, satellites and
    /// Dopplers (1 ms coherent).
    pub full_search_transforms: usize,
}

/// Searches the samples of all channels (baseband, of one length and equal noise floors, interference removed,
/// impulses suppressed); `nulled` spatial directions were projected away.
pub fn search_code_periods(
    channels: &[&[Complex32]],
    rate_hz: f64,
    nulled: usize,
    options: &CodePeriodOptions,
) -> Result<CodePeriodLook, AcquisitionError> {
    let samples = channels.first().map_or(0, |c| c.len());
    let signal = searched_signal(&options.satellites, rate_hz)?;
    let need = (rate_hz * signal.period_s()).ceil() as usize;
    let reason = match () {
        _ if !(0.0..=0.5 * rate_hz).contains(&options.max_doppler_hz) => {
            Some("the Doppler interval must lie in the sampled band")
        }
        _ if options.components == 0 => Some("at least one component is needed"),
        _ if channels.iter().any(|c| c.len() != samples) => Some("the channels differ in length"),
        _ if !(options.false_alarm > 0.0 && options.false_alarm < 1.0) => {
            Some("the false-alarm probability must be between 0 and 1")
        }
        _ => None,
    };
    if let Some(reason) = reason {
        return Err(AcquisitionError::Options(reason));
    }
    if samples < need || options.periods == 0 {
        return Err(AcquisitionError::TooShort { have: samples, need, coherent_ms: 1, rate_hz });
    }
    search_periods(CodePeriods::new(channels, rate_hz, signal, options.periods), nulled, options)
}

/// The same in the first `options.periods` of samples sorted by code period.
///
/// # Errors
/// When all samples are zero, or one is not finite.
pub fn search_periods(
    data: CodePeriods,
    nulled: usize,
    options: &CodePeriodOptions,
) -> Result<CodePeriodLook, AcquisitionError> {
    let most = MAX_ROWS / data.elements.max(1);
    let data = data.first(options.periods.min(most));
    let svd = CodePeriodSvd::new(&data, options.components, nulled, RANK_FALSE_ALARM)
        .ok_or(AcquisitionError::Options("the samples are all zero, or not finite"))?;
    let search = Search::new(&data, options);
    let rows: Vec<Row> = svd.right.iter().cloned().map(Row::of_all).collect();
    let offsets = search.all_offsets();

    let mut found: Vec<(Cell, usize)> = Vec::new();
    let strong = STRONG_COMPONENTS.max(svd.division.rank).min(rows.len());
    let (cells, mut transforms) =
        search.cells.best(&rows[..strong], &options.satellites, &offsets[..1]);
    search.take(&rows, &cells, search.certain(strong), &mut found);

    let right = search.without(&rows, &found);
    let left = unfound(&options.satellites, &found);
    let (cells, more) = search.cells.best(&right, &left, &offsets);
    transforms += more;
    search.take(&right, &cells, search.certain(right.len()), &mut found);

    let right = search.without(&rows, &found);
    let threshold = search.threshold(right.len());
    let left = unfound(&left, &found);
    let nearly = |c: &Cell| left.contains(&c.transmission) && c.fraction > NEARLY * threshold;
    let (mut own, mut correlated) = (Vec::new(), Vec::new());
    for cell in cells.into_iter().filter(nearly) {
        let fraction = search.cells.fraction(&right, &cell);
        if fraction > NEARLY * cell.fraction {
            own.push(Cell { fraction, ..cell });
        } else {
            correlated.push(cell.transmission);
        }
    }
    let (again, more) = search.cells.best(&right, &correlated, &offsets);
    transforms += more;
    search.take(&right, &[own, again].concat(), threshold, &mut found);

    found.sort_by(|a, b| b.0.fraction.total_cmp(&a.0.fraction));
    let found = found
        .iter()
        .map(|(cell, r)| search.measure(cell, *r, svd.division.noise_variance))
        .collect();
    let full_search_transforms =
        data.rows.len() * options.satellites.len() * search.cells.dopplers(&offsets);
    Ok(CodePeriodLook { svd, found, transforms, full_search_transforms })
}

/// The satellites not yet found.
fn unfound(satellites: &[Transmission], found: &[(Cell, usize)]) -> Vec<Transmission> {
    let is_left = |t: &&Transmission| found.iter().all(|f| f.0.transmission != **t);
    satellites.iter().filter(is_left).copied().collect()
}

/// Orthonormal basis of the remainder of orthonormal `rows` after the waveforms are projected out.
fn project_out(rows: &[Row], waves: &[Vec<Complex32>]) -> Vec<Row> {
    let single = |z: Complex64| Complex32::new(z.re as f32, z.im as f32);
    let normalised = |mut x: Vec<Complex32>| {
        let norm = product(&x, &x).re.sqrt().max(f64::MIN_POSITIVE);
        x.iter_mut().for_each(|x| *x /= norm as f32);
        x
    };
    let without = |x: &[Complex32], basis: &[Vec<Complex32>]| {
        let mut left = x.to_vec();
        for b in basis {
            add_product(single(-product(x, b)), b, &mut left);
        }
        left
    };
    let mut basis: Vec<Vec<Complex32>> = Vec::new();
    for wave in waves {
        basis.push(normalised(without(&without(wave, &basis), &basis)));
    }
    let left: Vec<Vec<Complex32>> = rows.iter().map(|row| without(&row.samples, &basis)).collect();
    let gram = CMat::from_fn(rows.len(), rows.len(), |i, k| product(&left[i], &left[k]));
    let Some((values, vectors)) = hermitian_eigen(&gram) else {
        return left.into_iter().map(Row::of_all).collect();
    };
    let kept = values.iter().take_while(|&&l| l > MIN_KEPT).count();
    let combine = |j: usize| {
        let mut sum = vec![Complex32::ZERO; left[0].len()];
        for (i, row) in left.iter().enumerate() {
            add_product(single(vectors[(i, j)].conj()), row, &mut sum);
        }
        Row::of_all(normalised(sum))
    };
    (0..kept).map(combine).collect()
}

/// State common to all passes of one search.
struct Search<'a> {
    data: &'a CodePeriods,
    cells: Cells,
    /// Doppler spacing, Hz: half the inverse of a code period. The pass for strong satellites uses every
    /// other.
    doppler_step_hz: f64,
    options: &'a CodePeriodOptions,
}

impl<'a> Search<'a> {
    fn new(data: &'a CodePeriods, options: &'a CodePeriodOptions) -> Self {
        let most = options.max_doppler_hz;
        let cells = Cells::new(data, (-most, most));
        Self { data, cells, doppler_step_hz: 0.5 / data.period_s, options }
    }

    /// The subspace after projection of the satellites found.
    fn without(&self, right: &[Row], found: &[(Cell, usize)]) -> Vec<Row> {
        let waves: Vec<_> = found.iter().map(|f| self.cells.waveform(&f.0, 0.0)).collect();
        project_out(right, &waves)
    }

    /// Adds the cells above a fraction to those found, interpolated between the cells.
    fn take(&self, right: &[Row], cells: &[Cell], above: f64, found: &mut Vec<(Cell, usize)>) {
        let above = cells.iter().filter(|c| c.fraction > above);
        found.extend(above.map(|c| (self.refine(right, *c), right.len())));
    }

    /// Fraction above which a code is certainly present, whatever the other satellites.
    fn certain(&self, components: usize) -> f64 {
        self.threshold(components) + CERTAIN * CROSS_CORRELATION
    }

    /// Fraction that noise exceeds anywhere with the requested probability.
    fn threshold(&self, components: usize) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if self.false_alarm(middle, components) > self.options.false_alarm {
                low = middle
            } else {
                high = middle
            }
        }
        high
    }

    /// Offsets of the Dopplers searched from whole inverse code periods: all of them.
    fn all_offsets(&self) -> [f64; 2] {
        [0.0, self.doppler_step_hz]
    }

    /// Probability that noise exceeds a fraction in any cell (taken as independent: an overestimate).
    fn false_alarm(&self, fraction: f64, components: usize) -> f64 {
        let dopplers = self.cells.dopplers(&self.all_offsets());
        let cells = self.options.satellites.len() * dopplers * self.data.bins;
        let tail = fraction_tail(fraction, components, self.data.bins);
        -(cells as f64 * (-tail).ln_1p()).exp_m1()
    }

    /// Interpolates Doppler and delay between the cells.
    fn refine(&self, right: &[Row], start: Cell) -> Cell {
        let mean = right.len() as f64 / self.data.bins as f64;
        // One step off, the parabola would have no maximum. (The cell may come from fewer vectors.)
        let cells = [-self.doppler_step_hz, self.doppler_step_hz, 0.0].map(|shift| {
            let cell = Cell { doppler_hz: start.doppler_hz + shift, ..start };
            Cell { fraction: self.cells.fraction(right, &cell), ..cell }
        });
        let start =
            cells.into_iter().max_by(|a, b| a.fraction.total_cmp(&b.fraction)).unwrap_or(start);
        let mut cell = start;
        for reach_hz in [0.5, 0.24].map(|steps| steps * self.doppler_step_hz) {
            cell = self.cells.centred(right, cell, mean);
            let at = |shift: f64| {
                let cell = Cell { doppler_hz: cell.doppler_hz + shift, ..cell };
                self.cells.fraction(right, &cell)
            };
            let [low, middle, high] = [-reach_hz, 0.0, reach_hz].map(at);
            let bend = 2.0 * middle - low - high;
            if bend > 0.0 {
                cell.doppler_hz +=
                    (0.5 * reach_hz * (high - low) / bend).clamp(-reach_hz, reach_hz);
            }
        }
        cell.fraction = self.cells.fraction(right, &cell);
        if cell.fraction >= start.fraction { cell } else { start }
    }

    /// The satellite of a cell found in so many vectors.
    fn measure(&self, cell: &Cell, components: usize, noise: f64) -> CodeFound {
        let span_hz = 0.5 * self.doppler_step_hz;
        let mut found = self.cells.measure(self.data, self.data.periods, cell, span_hz, noise);
        let acquisition = &mut found.acquisition;
        acquisition.statistic = cell.fraction * self.data.bins as f64 / components.max(1) as f64;
        acquisition.false_alarm = self.false_alarm(cell.fraction, components);
        found
    }
}

/// Probability that the fraction of a waveform's power in a random subspace of `components` of `bins`
/// dimensions exceeds `fraction`: the tail of the beta distribution as a binomial sum.
fn fraction_tail(fraction: f64, components: usize, bins: usize) -> f64 {
    if fraction <= 0.0 || components >= bins {
        return 1.0;
    }
    if fraction >= 1.0 {
        return 0.0;
    }
    let n = (bins - 1) as f64;
    // Terms as logarithms: (1 - x)^N can exceed the range of f64.
    let mut log_term = n * (-fraction).ln_1p();
    let log_ratio = fraction.ln() - (-fraction).ln_1p();
    let mut sum = 0.0;
    for i in 0..components {
        sum += log_term.exp();
        log_term += ((n - i as f64) / (i + 1) as f64).ln() + log_ratio;
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fraction_has_the_beta_distribution() {
        // r = 1: P = (1 - x)^(N-1). Mean of Beta(r, N - r) is r/N: the integral of the tail.
        assert!((fraction_tail(0.01, 1, 2048) - 0.99f64.powi(2047)).abs() < 1e-15);
        let steps = 20_000;
        let integral: f64 = (0..steps)
            .map(|k| fraction_tail((f64::from(k) + 0.5) / f64::from(steps), 16, 200))
            .sum();
        assert!((integral / f64::from(steps) - 16.0 / 200.0).abs() < 1e-6);
    }
}
