//! Excision of interference in the samples of one antenna: in the basis in which it is sparse, each cell is multiplied
//! by floor over power.
//!
//! Continuous waves, offsets of the converter and narrow noise are sparse in long spectra, pulses in short ones, sweeps
//! in spectra of dechirped blocks; impulses in the samples themselves, which is [`ImpulseSuppressor`]'s part. Nothing is
//! to be set: a test of some blocks of each chunk of samples ([`Look`]) shows whether there is anything, and what is
//! done about it is what leaves a weak signal with the most signal-to-noise ratio ([`treatment`]). Where that is nothing,
//! samples pass as they are.
//!
//! Weights are real and alike at delays of either sign, so that the correlation peak stays symmetric, whatever is cut.

mod basis;
mod envelope;
mod floor;
mod look;
mod names;
mod treatment;

pub use names::{Interferer, InterfererKind};

use super::ImpulseReport;
use crate::capture::{Block, StreamInfo};
use basis::Basis;
use floor::Powers;
use look::Look;
use num_complex::Complex32;
use treatment::{Tools, Treatment, db};

/// Signal by which a treatment is chosen, s.
const CHOICE_S: f64 = 0.02;
/// Chunks without interference after which the treatment ends, and between choices; of those that found nothing to
/// gain each next one waits twice as long, up to the most.
const PATIENCE: usize = 10;
const MOST_PATIENCE: usize = 640;
/// Power in the code's band, dB, by which the output may rise before another treatment is looked for.
const WORSE_DB: f64 = 1.0;
/// Blocks without which nothing is named.
const MIN_NAMED_BLOCKS: usize = 16;
/// Distinct values of a rail up to which the converter has two bits at most.
const COARSE_VALUES: usize = 4;

/// Excises interference of one channel, chunk by chunk.
///
/// While it treats, output is held back by the reach of the treatment, some thousand samples. Cost: of clean samples
/// the look alone, one transform of 8192 samples a chunk; while it treats, eight transforms of a block for each block of
/// the samples.
#[derive(Clone)]
pub struct Excisor {
    info: StreamInfo,
    tools: Tools,
    state: Option<Treating>,
    /// Chunks until the next choice is allowed.
    wait: usize,
    patience: usize,
    look: Look,
    /// Raw samples before those that wait.
    history: Vec<Complex32>,
    /// Raw samples that wait for those after them.
    held: Vec<Complex32>,
    /// Index of the first sample that waits.
    next: u64,
    seen: f64,
    found: Vec<Interferer>,
}

/// A treatment in effect.
#[derive(Clone)]
struct Treating {
    how: Treatment,
    /// Power in the code's band after it when it was chosen.
    power: f64,
    /// Power of what it removed over that of what it left.
    removed: f64,
    /// Chunks without interference.
    quiet: usize,
}

impl Excisor {
    /// An excisor of the samples of a stream's first channel.
    pub fn new(info: &StreamInfo) -> Self {
        Self {
            info: info.clone(),
            tools: Tools::new(info),
            state: None,
            wait: 0,
            patience: PATIENCE,
            look: Look::default(),
            history: Vec::new(),
            held: Vec::new(),
            next: 0,
            seen: 0.0,
            found: Vec::new(),
        }
    }

    /// Treats a chunk: the block is exchanged for the samples that are ready; all of them at the end of the stream
    /// (`last`). Whether they were treated: impulses, too, are suppressed then.
    pub fn process(&mut self, block: &mut Block, last: bool) -> bool {
        self.examine(block.channel(0));
        if self.held.is_empty() {
            self.next = block.first_sample();
        }
        let Some(how) = self.state.as_ref().map(|s| s.how.clone()) else {
            self.release(block);
            return false;
        };
        self.held.extend_from_slice(block.channel(0));
        let reach = how.reach();
        let mut window = std::mem::take(&mut self.history);
        let before = window.len();
        window.extend_from_slice(&self.held);
        let treated = self.tools.treat(&window, &how);
        let kept = if last { 0 } else { reach.min(self.held.len()) };
        let ready = self.held.len() - kept;
        block.reset(1, ready, self.next);
        block.channel_mut(0).copy_from_slice(&treated[before..before + ready]);
        self.measure(&window[before..before + ready], block.channel(0));
        self.held.drain(..ready);
        self.next += ready as u64;
        window.truncate(before + ready);
        self.history = window;
        self.keep_history();
        true
    }

    /// Whether samples wait.
    pub fn holds(&self) -> bool {
        !self.held.is_empty()
    }

    /// Interference so far, strongest first.
    pub fn interferers(&self) -> Vec<Interferer> {
        let mut all = self.found.clone();
        all.iter_mut().for_each(|i| i.time_fraction /= self.seen.max(1.0));
        all.sort_by(|a, b| b.to_noise_db.total_cmp(&a.to_noise_db));
        all
    }

    /// Impulses that were suppressed together with other interference.
    pub fn impulses(&self) -> Option<ImpulseReport> {
        self.tools.impulses.report()
    }

    /// Gives what waits and the chunk as they are.
    fn release(&mut self, block: &mut Block) {
        if !self.held.is_empty() {
            let all = [&self.held[..], block.channel(0)].concat();
            block.reset(1, all.len(), self.next);
            block.channel_mut(0).copy_from_slice(&all);
            self.held.clear();
        }
        let samples = block.channel(0);
        self.history.extend_from_slice(&samples[samples.len().saturating_sub(self.kept())..]);
        self.keep_history();
    }

    /// Samples of the past that are kept.
    fn kept(&self) -> usize {
        4 * self.tools.lengths().first().copied().unwrap_or(0)
    }

    fn keep_history(&mut self) {
        let spare = self.history.len().saturating_sub(self.kept());
        self.history.drain(..spare);
    }

    /// Decides about the treatment by the samples of a chunk.
    fn examine(&mut self, samples: &[Complex32]) {
        self.seen += samples.len() as f64;
        self.wait = self.wait.saturating_sub(1);
        self.tools.set_coarse(is_coarse(samples));
        let all = self.state.is_some() || self.seen <= 2.0 * samples.len() as f64;
        let hit = self.look.is_hit(&mut self.tools, samples, all);
        if let Some(state) = &mut self.state {
            state.quiet = if hit { 0 } else { state.quiet + 1 };
            if state.quiet >= PATIENCE {
                self.state = None;
            }
            return;
        }
        if hit && self.wait == 0 {
            self.choose(samples);
        }
    }

    fn choose(&mut self, samples: &[Complex32]) {
        self.wait = self.patience;
        self.patience = (2 * self.patience).min(MOST_PATIENCE);
        let count = ((CHOICE_S * self.info.rate_hz) as usize).min(samples.len());
        let start = (samples.len() - count) / 2;
        let part = &samples[start..start + count];
        if let Some(chosen) = self.tools.choose(part) {
            let power = chosen.score.noise * chosen.score.gain.powi(2);
            let raw = self.tools.power_in_band(part);
            let removed = raw / power.max(f64::MIN_POSITIVE);
            self.patience = PATIENCE;
            self.state = Some(Treating { how: chosen.treatment, power, removed, quiet: 0 });
        }
    }

    /// Names what was treated, and sees whether the treatment still serves.
    fn measure(&mut self, raw: &[Complex32], treated: &[Complex32]) {
        let longest = self.tools.lengths()[0];
        let is_quiet = self.state.as_ref().is_some_and(|state| state.quiet > 0);
        if raw.len() < MIN_NAMED_BLOCKS * longest || is_quiet {
            return;
        }
        let transform = self.tools.transform(Basis { length: longest, chirp: 0.0 });
        let powers = Powers::of(transform, raw, longest / 4);
        let StreamInfo { rate_hz, if_hz, real, .. } = self.info;
        let mut now = Vec::new();
        let power = self.tools.power_in_band(treated);
        if let Some(state) = &mut self.state {
            if names::is_of_lines(&state.how, rate_hz) {
                now = names::lines(&powers, rate_hz, if_hz, real);
            }
            if now.is_empty() {
                now.extend(names::others(&state.how, rate_hz, (state.removed - 1.0).max(1e-3)));
            }
            if db(power / state.power) > WORSE_DB && self.wait == 0 {
                // What was chosen no longer serves.
                state.quiet = PATIENCE;
            }
        }
        for mut interferer in now {
            let amount = raw.len() as f64;
            let same = |i: &&mut Interferer| is_same(&i.kind, &interferer.kind, rate_hz);
            match self.found.iter_mut().find(same) {
                Some(known) => {
                    let share = amount / (known.time_fraction + amount);
                    known.to_noise_db += share * (interferer.to_noise_db - known.to_noise_db);
                    known.time_fraction += amount;
                }
                None => {
                    interferer.time_fraction = amount;
                    self.found.push(interferer);
                }
            }
        }
    }
}

/// Whether two findings are of one interferer.
fn is_same(a: &InterfererKind, b: &InterfererKind, rate_hz: f64) -> bool {
    use InterfererKind::{NarrowNoise, Tone};
    match (a, b) {
        (Tone { frequency_hz: a }, Tone { frequency_hz: b }) => (a - b).abs() < rate_hz / 1024.0,
        (NarrowNoise { frequency_hz: a, width_hz: wide }, NarrowNoise { frequency_hz: b, .. }) => {
            (a - b).abs() < *wide
        }
        _ => std::mem::discriminant(a) == std::mem::discriminant(b),
    }
}

/// Whether the samples have at most four values a rail.
fn is_coarse(samples: &[Complex32]) -> bool {
    let mut values: Vec<f32> = Vec::new();
    samples.iter().take(4096).all(|z| {
        if !values.contains(&z.re) {
            values.push(z.re);
        }
        values.len() <= COARSE_VALUES
    })
}

#[cfg(test)]
mod tests;
