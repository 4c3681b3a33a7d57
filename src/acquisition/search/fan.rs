//! A fan of beams, formed of the correlations of all channels: beams are linear, so they need no transforms of their own.
//!
//! A cell's power in a beam of norm 1, over the noise, is Gamma(K, 1) of K windows, and at most the sum of the channels'
//! powers, Gamma(M K, 1): only the few cells whose sum is high enough for a beam are looked at. Twice as many beams as
//! elements lie within 0.2 dB of the best beam.

use super::{Peak, SearchPlan, add_power, add_product};
use crate::acquisition::statistics;
use num_complex::Complex32;

/// Probability that noise in the dimensions beside a beam is weaker than assumed: a cell at the threshold is then missed.
const MISSED: f64 = 0.01;

/// The beams of one search.
pub(super) struct Fan<'a> {
    beams: &'a [Vec<Complex32>],
    windows: usize,
    threshold: f64,
    /// Sum of the channels' powers, over the noise, from which a cell is looked at.
    enough: f64,
}

/// The strongest cell of a row in a beam.
pub(super) struct BeamPeak {
    pub(super) bin: usize,
    /// Power over the noise, Gamma-distributed of as many looks as windows.
    statistic: f64,
    noise: f64,
    windows: f64,
    beams: f64,
}

impl<'a> Fan<'a> {
    pub(super) fn new(plan: &'a SearchPlan, windows: usize) -> Self {
        let beams = &plan.beams[..];
        let tests = plan.cells() * plan.tests() * beams.len() as f64;
        let threshold = statistics::threshold(plan.options.false_alarm, windows as f64, tests);
        let beside = ((beams[0].len() - 1) * windows) as f64;
        let least =
            if beside > 0.0 { statistics::threshold(1.0 - MISSED, beside, 1.0) } else { 0.0 };
        Self { beams, windows, threshold, enough: threshold + least }
    }

    /// Sum of the channels' powers, over the noise, from which a row is worth its correlations.
    pub(super) fn enough(&self) -> f64 {
        self.enough
    }

    /// The strongest cell of a row in any beam, if it exceeds the threshold. `powers` are the sums of the channels,
    /// `correlations` those of each look (channel by channel, window by window), which lie `advances` bins early;
    /// `noise` is the mean power of one look.
    pub(super) fn strongest(
        &self,
        powers: &[f32],
        correlations: &[Complex32],
        advances: &[usize],
        noise: f64,
    ) -> Option<BeamPeak> {
        let bins = powers.len();
        let enough = (self.enough * noise) as f32;
        let strong: Vec<usize> = (0..bins).filter(|&bin| powers[bin] > enough).collect();
        if strong.is_empty() {
            return None;
        }
        // Of each look the strong cells side by side.
        let cells: Vec<Vec<Complex32>> = advances
            .iter()
            .enumerate()
            .map(|(look, advance)| {
                let at = |bin: &usize| correlations[look * bins + (bin + bins - advance) % bins];
                strong.iter().map(at).collect()
            })
            .collect();
        let mut best = (0, 0f32);
        let mut sum = vec![Complex32::ZERO; strong.len()];
        let mut power = vec![0f32; strong.len()];
        for beam in self.beams {
            for window in 0..self.windows {
                sum.fill(Complex32::ZERO);
                for (cells, w) in cells[window..].iter().step_by(self.windows).zip(beam) {
                    add_product(w.conj(), cells, &mut sum);
                }
                add_power(&sum, &mut power, window == 0);
            }
            for (bin, power) in strong.iter().zip(&power) {
                if *power > best.1 {
                    best = (*bin, *power);
                }
            }
        }
        let statistic = f64::from(best.1) / noise;
        (statistic > self.threshold).then_some(BeamPeak {
            bin: best.0,
            statistic,
            noise,
            windows: self.windows as f64,
            beams: self.beams.len() as f64,
        })
    }
}

impl BeamPeak {
    /// As the peak of a row, of which `row` is what all channels show there; `None` where the row's powers vary more
    /// than those of noise.
    pub(super) fn peak(&self, row: &Peak, looks: f64, spread_error: f64) -> Option<Peak> {
        if row.spread * looks >= 1.0 + spread_error {
            return None;
        }
        let elements = looks / self.windows;
        let snr = (self.statistic / self.windows - 1.0) / elements;
        let one = statistics::ln_cell_false_alarm(self.statistic, self.windows);
        Some(Peak {
            statistic: self.statistic,
            // Of any beam.
            ln_false_alarm: one + self.beams.ln(),
            power: self.noise * looks * (1.0 + snr),
            ..*row
        })
    }
}
