//! Codes in waveforms of one code period: the cell of maximum power over Doppler and delay, its refinement, and the
//! prompts that it gives.

use super::periods::{CodePeriods, product};
use crate::acquisition::Acquisition;
use crate::acquisition::search::{add_power, multiply, phasor};
use crate::array::{CMat, Signature};
use crate::correlator::carrier::{CarrierSpan, estimate_carrier};
use crate::gnss::Transmission;
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;
use sdr_rx_linalg::{Fft, forward_transform, inverse_transform};
use std::f64::consts::TAU;
use std::sync::Arc;

/// A satellite found.
#[derive(Clone, Debug)]
pub struct CodeFound {
    /// Doppler, code phase at the first sample and C/N0 of one element (of the samples as they are: after a
    /// map with its loss), refined.
    pub acquisition: Acquisition,
    /// Fraction of the power of the code's waveform in the searched rows.
    pub fraction: f64,
    /// Prompts of every element and code period, despread with the waveform found (M x K); Doppler and data
    /// from period to period are still in them.
    pub prompts: CMat,
    /// Spatial signature; `None` with one element.
    pub signature: Option<Signature>,
}

/// One code, Doppler and delay.
#[derive(Clone, Copy, Debug)]
pub(in crate::array) struct Cell {
    pub(in crate::array) transmission: Transmission,
    /// Sum over the rows of the squared product with the waveform of norm 1.
    pub(in crate::array) fraction: f64,
    pub(in crate::array) doppler_hz: f64,
    /// In the middle of the samples.
    pub(in crate::array) delay_bins: f64,
}

/// A waveform of one code period in which codes are searched.
#[derive(Clone, Debug)]
pub(in crate::array) struct Row {
    pub(in crate::array) samples: Vec<Complex32>,
    /// Its time from the middle of the samples, s: codes have moved until then.
    pub(in crate::array) at_s: f64,
}

impl Row {
    /// Of all samples.
    pub(super) fn of_all(samples: Vec<Complex32>) -> Self {
        Self { samples, at_s: 0.0 }
    }
}

/// Searches the code periods of one signal.
pub(in crate::array) struct Cells {
    bins: usize,
    /// Mean position of a sample in its bin.
    offset: f64,
    /// Code period, s.
    period_s: f64,
    doppler_hz: (f64, f64),
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
}

impl Cells {
    /// For Dopplers in an interval.
    pub(in crate::array) fn new(data: &CodePeriods, doppler_hz: (f64, f64)) -> Self {
        let &CodePeriods { bins, offset, period_s, .. } = data;
        let (forward, inverse) = (forward_transform(bins), inverse_transform(bins));
        Self { bins, offset, period_s, doppler_hz, forward, inverse }
    }

    /// Dopplers searched, in whole inverse code periods, besides this offset.
    fn lines(&self, offset_hz: f64) -> std::ops::RangeInclusive<i64> {
        // The ends count within a cell of 20 code periods.
        const MARGIN: f64 = 0.03;
        let lines = |doppler_hz: f64| (doppler_hz - offset_hz) * self.period_s;
        let (low, high) = (lines(self.doppler_hz.0) - MARGIN, lines(self.doppler_hz.1) + MARGIN);
        low.ceil() as i64..=high.floor() as i64
    }

    /// Number of Dopplers searched with these offsets.
    pub(in crate::array) fn dopplers(&self, offsets_hz: &[f64]) -> usize {
        offsets_hz.iter().map(|offset| self.lines(*offset).count()).sum()
    }

    /// The best cell of every satellite, at Dopplers of whole inverse code periods besides each offset, and the number
    /// of transforms.
    pub(in crate::array) fn best(
        &self,
        rows: &[Row],
        satellites: &[Transmission],
        offsets_hz: &[f64],
    ) -> (Vec<Cell>, usize) {
        if satellites.is_empty() {
            return (Vec::new(), 0);
        }
        // Whole inverse periods are shifts of the spectrum by lines.
        let spectra: Vec<Vec<Row>> = offsets_hz
            .iter()
            .map(|offset_hz| {
                let turn = |n| phasor(offset_hz * self.period_s * n as f64 / self.bins as f64);
                let spectrum = |row: &Row| {
                    let pairs = row.samples.iter().enumerate();
                    let mut samples: Vec<_> = pairs.map(|(n, x)| x * turn(n)).collect();
                    self.forward.process(&mut samples);
                    Row { samples, ..*row }
                };
                rows.iter().map(spectrum).collect()
            })
            .collect();
        let best = |&t: &Transmission| self.best_of(t, &spectra, offsets_hz);
        let cells = satellites.par_iter().map(best).collect();
        let forward = spectra.len() * rows.len() + satellites.len();
        (cells, forward + satellites.len() * self.dopplers(offsets_hz) * rows.len())
    }

    /// The best cell of a satellite in the spectra of all rows, by offset.
    fn best_of(
        &self,
        transmission: Transmission,
        spectra: &[Vec<Row>],
        offsets_hz: &[f64],
    ) -> Cell {
        let bins = self.bins;
        let mut best = Cell { transmission, fraction: 0.0, doppler_hz: 0.0, delay_bins: 0.0 };
        let mut code = self.waveform(&best, 0.0);
        self.forward.process(&mut code);
        code.iter_mut().for_each(|c| *c = c.conj());
        let mut correlation = vec![Complex32::ZERO; bins];
        let mut scratch = vec![Complex32::ZERO; self.inverse.get_inplace_scratch_len()];
        let mut power = vec![0f32; bins];
        for (rows, offset_hz) in spectra.iter().zip(offsets_hz) {
            for line in self.lines(*offset_hz) {
                let doppler_hz = offset_hz + line as f64 / self.period_s;
                let line = line.rem_euclid(bins as i64) as usize;
                power.fill(0.0);
                for Row { samples, at_s } in rows {
                    let (head, tail) = samples.split_at(line);
                    let (code_head, code_tail) = code.split_at(bins - line);
                    multiply(tail, code_head, &mut correlation[..bins - line]);
                    multiply(head, code_tail, &mut correlation[bins - line..]);
                    self.inverse.process_with_scratch(&mut correlation, &mut scratch);
                    let advance = self.advance_bins(transmission, doppler_hz, *at_s).round() as i64;
                    let advance = advance.rem_euclid(bins as i64) as usize;
                    let (early, late) = correlation.split_at(bins - advance);
                    add_power(early, &mut power[advance..], false);
                    add_power(late, &mut power[..advance], false);
                }
                let peak = power.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
                let (bin, highest) = peak.map_or((0, 0.0), |(bin, p)| (bin, f64::from(*p)));
                // Both transforms are without normalisation: N^2 of the power; the waveform has norm 1.
                let fraction = highest / (bins as f64).powi(2);
                if fraction > best.fraction {
                    best = Cell { fraction, doppler_hz, delay_bins: bin as f64, ..best };
                }
            }
        }
        best
    }

    /// Bins by which the code is earlier at a time from the middle of the samples: it runs faster with the Doppler.
    fn advance_bins(&self, transmission: Transmission, doppler_hz: f64, at_s: f64) -> f64 {
        let chips = doppler_hz / transmission.cycles_per_chip() * at_s;
        chips * self.bins as f64 / transmission.signal.chips as f64
    }

    /// The waveform of a cell, of norm 1: the code at the mean sampling instant of each bin.
    pub(in crate::array) fn waveform(&self, cell: &Cell, at_s: f64) -> Vec<Complex32> {
        let chips = cell.transmission.code();
        let bins = self.bins as f64;
        let delay = cell.delay_bins - self.advance_bins(cell.transmission, cell.doppler_hz, at_s);
        let turn = Complex64::cis(TAU * cell.doppler_hz * self.period_s / bins);
        let mut carrier = Complex64::from(bins.sqrt().recip());
        (0..self.bins)
            .map(|n| {
                let phase = (n as f64 + self.offset - delay) / bins;
                let chip = (phase.rem_euclid(1.0) * chips.len() as f64) as usize;
                let value = carrier * f64::from(chips[chip.min(chips.len() - 1)]);
                carrier *= turn;
                Complex32::new(value.re as f32, value.im as f32)
            })
            .collect()
    }

    /// The sum over the rows of the squared product with the waveform of a cell.
    pub(in crate::array) fn fraction(&self, rows: &[Row], cell: &Cell) -> f64 {
        let (mut sum, mut made) = (0.0, None);
        for row in rows {
            if made.as_ref().is_none_or(|(at_s, _)| *at_s != row.at_s) {
                made = Some((row.at_s, self.waveform(cell, row.at_s)));
            }
            sum += made.as_ref().map_or(0.0, |(_, wave)| product(&row.samples, wave).norm_sqr());
        }
        sum
    }

    /// The delay at the balance of early and late half a chip away (the correlation of chips is a triangle). `mean` is
    /// what noise alone gives.
    pub(in crate::array) fn centred(&self, rows: &[Row], cell: Cell, mean: f64) -> Cell {
        let half_chip = 0.5 * self.bins as f64 / cell.transmission.signal.chips as f64;
        let at =
            |shift: f64| self.fraction(rows, &Cell { delay_bins: cell.delay_bins + shift, ..cell });
        let [early, late] = [-half_chip, half_chip].map(|d| (at(d) - mean).max(0.0).sqrt());
        if early + late == 0.0 {
            return cell;
        }
        let delay_bins = cell.delay_bins + half_chip * (late - early) / (late + early);
        Cell { delay_bins, ..cell }
    }

    /// Despreads the samples with the cell found, in blocks of so many code periods, and estimates C/N0 and the rest of
    /// the Doppler, up to `span_hz` either way, from the prompts. `noise` is the noise variance of a bin.
    pub(in crate::array) fn measure(
        &self,
        data: &CodePeriods,
        block: usize,
        cell: &Cell,
        span_hz: f64,
        noise: f64,
    ) -> CodeFound {
        let prompts = self.prompts(data, block, cell);
        let (elements, periods) = prompts.shape();
        let signature = Signature::estimate(&prompts);
        let ones = vec![Complex64::ONE; elements];
        let response = signature.as_ref().map_or(&ones, |s| &s.response);
        let beam: Vec<Complex64> = (0..periods)
            .map(|k| {
                let sum: Complex64 =
                    (0..elements).map(|m| response[m].conj() * prompts[(m, k)]).sum();
                sum * Complex64::cis(-TAU * cell.doppler_hz * self.period_s * k as f64)
            })
            .collect();
        let span = CarrierSpan { frequency_hz: span_hz, rate_hz_s: 0.0 };
        let rest = estimate_carrier(&beam, cell.transmission.timing(), span)
            .map_or(0.0, |c| c.frequency_hz);
        let doppler_hz = cell.doppler_hz + if periods > 1 { rest } else { 0.0 };
        let power: f64 = (0..periods)
            .flat_map(|k| (0..elements).map(move |m| (m, k)))
            .map(|at| prompts[at].norm_sqr())
            .sum();
        let snr = power / (noise * (elements * periods) as f64) - 1.0;
        // The delay is that of the middle of the periods; the code rate depends on the Doppler.
        let chips = cell.transmission.signal.chips as f64;
        let drift =
            doppler_hz / cell.transmission.cycles_per_chip() * periods as f64 * self.period_s / 2.0;
        let code_phase = -cell.delay_bins * chips / self.bins as f64 - drift;
        let acquisition = Acquisition {
            transmission: cell.transmission,
            doppler_hz,
            code_phase_chips: code_phase.rem_euclid(chips) % chips,
            cn0_dbhz: 10.0 * (snr.max(1e-3) / self.period_s).log10(),
            statistic: 0.0,
            false_alarm: 0.0,
        };
        CodeFound { acquisition, fraction: cell.fraction, prompts, signature }
    }

    /// Time of a block of so many code periods from the middle of all, s.
    pub(in crate::array) fn block_time_s(
        &self,
        data: &CodePeriods,
        block: usize,
        at: usize,
    ) -> f64 {
        let middle = (at * block) as f64 + 0.5 * block.min(data.periods - at * block) as f64;
        (middle - 0.5 * data.periods as f64) * self.period_s
    }

    /// Sum of x(n) conj(w(n)) for every element and code period, M x K.
    pub(in crate::array) fn prompts(&self, data: &CodePeriods, block: usize, cell: &Cell) -> CMat {
        let mut prompts = CMat::zeros(data.elements, data.periods);
        for first in (0..data.periods).step_by(block) {
            let wave = self.waveform(cell, self.block_time_s(data, block, first / block));
            for k in first..(first + block).min(data.periods) {
                for m in 0..data.elements {
                    prompts[(m, k)] = product(data.row(m, k), &wave);
                }
            }
        }
        prompts
    }
}
