//! Codes of the sources of a look: candidates drive the search.
//!
//! Strongest first, a candidate's beam is formed at its Doppler modulo the inverse of a code period, where the full gain
//! of all elements and code periods is in one waveform of one code period. In it every code is searched, at the whole
//! inverse code periods alone. A cell is accepted when noise would not reach it *and* when it holds 0.15 of the
//! candidate's power: a foreign code, or a carrier, spreads over all cells. What was found is removed from the samples,
//! and the others are judged in what is left.

use super::look::{Candidate, Look, LookCodes, LookError};
use crate::acquisition::search::add_product;
use crate::acquisition::statistics;
use crate::array::code_periods::CodeFound;
use crate::array::code_periods::cells::{Cell, Cells, Row};
use crate::array::code_periods::periods::product;
use num_complex::Complex32;

/// Fraction of a candidate's power that a code has to explain.
const MIN_FRACTION: f64 = 0.15;
/// Maximum number of candidates whose codes are searched.
const MAX_TRIED: usize = 48;
/// Candidates of one direction that were searched in vain, after which no more of it is searched in this round.
const MAX_VAIN: usize = 3;
/// Rounds of candidates at most: what a strong satellite hid is seen in the next.
const MAX_ROUNDS: usize = 6;
/// The Doppler lies within so many inverse block lengths of a candidate's: with an edge of the data bits in a block its
/// spectrum has two lobes.
const DOPPLER_SPAN: f64 = 2.0;

/// Satellites found, and candidates.
#[derive(Default)]
pub(in crate::array) struct Identified {
    /// Each with the candidate in which it was found, strongest first.
    pub(in crate::array) found: Vec<(CodeFound, Candidate)>,
    /// Candidates in what is left.
    pub(in crate::array) rest: Vec<Candidate>,
    /// Number of Fourier transforms, and of those of a full search: every element, period, code and Doppler, half an
    /// inverse code period apart.
    pub(in crate::array) transforms: usize,
    pub(in crate::array) full_search: usize,
}

impl Look {
    /// Searches the codes of the candidates, and removes what it finds.
    pub(in crate::array) fn identify(
        &mut self,
        codes: &LookCodes<'_>,
    ) -> Result<Identified, LookError> {
        let search = Search {
            cells: Cells::new(&self.data, codes.doppler_hz),
            false_alarm: codes.false_alarm / MAX_TRIED as f64,
        };
        let dopplers = search.cells.dopplers(&[0.0, 0.5 / self.data.period_s]);
        let full_search = self.data.rows.len() * codes.satellites.len() * dopplers;
        let mut out = Identified { full_search, ..Identified::default() };
        let mut left = codes.satellites.to_vec();
        let mut tried: Vec<Candidate> = Vec::new();
        let mut searched = 0;
        for _ in 0..MAX_ROUNDS {
            out.rest = self.candidates()?;
            let mut is_new = false;
            let mut vain: Vec<Candidate> = Vec::new();
            for candidate in out.rest.clone() {
                let excess = self.doppler.power(candidate.index, &candidate.beam) - 1.0;
                let one_direction = |t: &&Candidate| t.is_beside(&candidate);
                let again = tried.iter().filter(one_direction);
                let is_vain = vain.iter().filter(one_direction).count() >= MAX_VAIN
                    && candidate.beam.len() > 1;
                // With the satellites found by now much of it may be gone.
                if excess < 0.5 * candidate.excess
                    || again
                        .into_iter()
                        .any(|t| self.doppler.blocks_apart(t.index, candidate.index) < 1.0)
                    || is_vain
                    || searched >= MAX_TRIED
                    || left.is_empty()
                {
                    continue;
                }
                searched += 1;
                let candidate = Candidate { excess, ..candidate };
                let rows = search.rows(self, &candidate);
                let (cells, transforms) =
                    search.cells.best(&rows, &left, &[self.doppler.doppler_hz(candidate.index)]);
                out.transforms += transforms;
                let best = cells.into_iter().max_by(|a, b| a.fraction.total_cmp(&b.fraction));
                let Some(cell) =
                    best.filter(|cell| search.accepts(self, &candidate, cell, left.len()))
                else {
                    tried.push(candidate.clone());
                    vain.push(candidate);
                    continue;
                };
                let false_alarm = search.false_alarm(self, &candidate, &cell, left.len());
                left.retain(|t| *t != cell.transmission);
                let found = search.measured(self, &rows, cell, false_alarm);
                search.remove(self, &found.1);
                out.found.push((found.0, candidate));
                is_new = true;
            }
            if !is_new {
                break;
            }
        }
        out.rest = self.candidates()?;
        out.found.sort_by(|a, b| b.0.fraction.total_cmp(&a.0.fraction));
        Ok(out)
    }
}

struct Search {
    cells: Cells,
    /// Of one candidate.
    false_alarm: f64,
}

impl Search {
    fn rows(&self, look: &Look, candidate: &Candidate) -> Vec<Row> {
        let block = look.doppler.block;
        let time_s = |b: usize| self.cells.block_time_s(&look.data, block, b);
        look.doppler.rows(&look.data, candidate.index, &candidate.beam, time_s)
    }

    /// The statistic of a cell, gamma-distributed of as many looks as blocks in noise.
    fn statistic(look: &Look, cell: &Cell) -> f64 {
        cell.fraction * look.data.bins as f64
    }

    /// Probability that noise reaches a cell anywhere in a search of so many satellites: noise of the power that the
    /// candidate's beam has beside the cell.
    fn false_alarm(
        &self,
        look: &Look,
        candidate: &Candidate,
        cell: &Cell,
        satellites: usize,
    ) -> f64 {
        let cells = satellites * look.data.bins * self.cells.dopplers(&[0.0]);
        let looks = look.doppler.blocks as f64;
        let statistic = Self::statistic(look, cell);
        let beside = 1.0 + candidate.excess - statistic / (look.data.bins as f64 * looks);
        statistics::search_false_alarm(statistic / beside.max(1.0), looks, cells as f64)
    }

    fn accepts(&self, look: &Look, candidate: &Candidate, cell: &Cell, satellites: usize) -> bool {
        let looks = look.doppler.blocks as f64;
        let all = candidate.excess * look.data.bins as f64 * looks;
        self.false_alarm(look, candidate, cell, satellites) < self.false_alarm
            && Self::statistic(look, cell) - looks >= MIN_FRACTION * all
    }

    /// The satellite of a cell, with its delay between the bins, and that cell.
    fn measured(
        &self,
        look: &Look,
        rows: &[Row],
        cell: Cell,
        false_alarm: f64,
    ) -> (CodeFound, Cell) {
        let mean = look.doppler.blocks as f64 / look.data.bins as f64;
        let start = cell;
        let mut cell = (0..2).fold(cell, |cell, _| self.cells.centred(rows, cell, mean));
        cell.fraction = self.cells.fraction(rows, &cell);
        if cell.fraction < start.fraction {
            cell = start;
        }
        let span_hz = DOPPLER_SPAN * 2.0 * look.doppler.step_hz;
        let noise = look.doppler.noise_variance;
        let mut found = self.cells.measure(&look.data, look.doppler.block, &cell, span_hz, noise);
        found.acquisition.statistic = Self::statistic(look, &cell) / look.doppler.blocks as f64;
        found.acquisition.false_alarm = 1.0 - (1.0 - false_alarm).powi(MAX_TRIED as i32);
        (found, cell)
    }

    /// Removes the waveform of a cell, and those half a chip early and late: what front ends make of a chip lies in
    /// their span.
    fn remove(&self, look: &mut Look, cell: &Cell) {
        let half_chip = 0.5 * look.data.bins as f64 / cell.transmission.signal.chips as f64;
        let waves = |b: usize| {
            let at_s = self.cells.block_time_s(&look.data, look.doppler.block, b);
            let wave = |shift: f64| {
                let cell = Cell { delay_bins: cell.delay_bins + shift, ..*cell };
                self.cells.waveform(&cell, at_s)
            };
            orthonormal([0.0, -half_chip, half_chip].map(wave))
        };
        let waves: Vec<Vec<Vec<Complex32>>> = (0..look.doppler.blocks).map(waves).collect();
        look.doppler.remove(&mut look.data, &waves);
    }
}

/// Gram and Schmidt.
fn orthonormal(waves: [Vec<Complex32>; 3]) -> Vec<Vec<Complex32>> {
    let mut basis: Vec<Vec<Complex32>> = Vec::new();
    for mut wave in waves {
        for _ in 0..2 {
            for b in &basis {
                let along = product(&wave, b);
                add_product(Complex32::new(-along.re as f32, -along.im as f32), b, &mut wave);
            }
        }
        let norm = product(&wave, &wave).re.sqrt().max(f64::MIN_POSITIVE) as f32;
        wave.iter_mut().for_each(|x| *x /= norm);
        basis.push(wave);
    }
    basis
}
