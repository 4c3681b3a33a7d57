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
use treatment::{MemorylessMap, Tools, Treatment, db};

/// Signal by which a treatment is chosen, s.
const CHOICE_S: f64 = 0.02;
/// Chunks without interference after which the treatment ends, and between choices; of those that found nothing to
/// gain each next one waits twice as long, up to the most.
const PATIENCE: usize = 10;
const MOST_PATIENCE: usize = 640;
/// Noise over the gain of a weak signal, dB, by which a treatment may get worse before another one is looked for.
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
    /// Whether the last chunk looked like more than noise, and had room for it.
    is_loud: bool,
    patience: usize,
    /// Median power of the samples of the last choice.
    level: f32,
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
    /// Noise over the gain of a weak signal when it was chosen.
    chosen: f64,
    /// Power of the noise of a sample, as far as what it left shows it.
    noise: f64,
    /// Chunks without interference.
    quiet: usize,
    /// Chunks since it was chosen.
    age: usize,
}

impl Excisor {
    /// An excisor of the samples of a stream's first channel.
    pub fn new(info: &StreamInfo) -> Self {
        Self {
            info: info.clone(),
            tools: Tools::new(info),
            state: None,
            is_loud: false,
            wait: 0,
            patience: PATIENCE,
            level: 0.0,
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
        self.measure(&window[before..before + ready]);
        self.held.drain(..ready);
        self.next += ready as u64;
        window.truncate(before + ready);
        self.history = window;
        self.keep_history();
        true
    }

    /// Whether the last chunk looked like noise alone, or has a few values only.
    pub fn is_quiet(&self) -> bool {
        !self.is_loud && self.state.is_none()
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
        let is_coarse = is_coarse(samples);
        self.tools.set_coarse(is_coarse);
        let all = self.state.is_some() || self.seen <= 2.0 * samples.len() as f64;
        let hit = self.look.is_hit(&mut self.tools, samples, all);
        self.is_loud = hit && !is_coarse;
        if let Some(state) = &mut self.state {
            state.quiet = if hit { 0 } else { state.quiet + 1 };
            state.age += 1;
            let is_stale = hit && state.age.is_multiple_of(PATIENCE) && {
                let now = self.tools.scored_now(middle(samples, self.info.rate_hz), &state.how);
                now.is_some_and(|now| db(now.noise / state.chosen) > WORSE_DB)
            };
            if state.quiet < PATIENCE && !is_stale {
                return;
            }
            self.state = None;
        }
        // What is stronger now may be worth treating now.
        let is_stronger = || db((median_power(samples) / self.level).into()) > WORSE_DB;
        if hit && (self.wait == 0 || is_stronger()) {
            self.choose(samples);
        }
    }

    fn choose(&mut self, samples: &[Complex32]) {
        self.level = median_power(samples);
        self.wait = self.patience;
        self.patience = (2 * self.patience).min(MOST_PATIENCE);
        let chosen = self.tools.choose(middle(samples, self.info.rate_hz));
        if let Some(chosen) = chosen {
            // What is cut takes of the noise what it takes of a weak signal's amplitude. Of a ring the noise along its
            // radius alone is left.
            let is_ring = chosen.treatment.map == Some(MemorylessMap::Envelope);
            let left = chosen.score.gain * if is_ring { 2.0 } else { 1.0 };
            let noise = (chosen.score.noise * left).max(f64::MIN_POSITIVE);
            self.patience = PATIENCE;
            self.state = Some(Treating {
                how: chosen.treatment,
                chosen: chosen.score.noise,
                noise,
                quiet: 0,
                age: 0,
            });
        }
    }

    /// Names what was treated.
    fn measure(&mut self, raw: &[Complex32]) {
        let longest = self.tools.lengths()[0];
        let is_quiet = self.state.as_ref().is_some_and(|state| state.quiet > 0);
        if raw.len() < MIN_NAMED_BLOCKS * longest || is_quiet {
            return;
        }
        let transform = self.tools.transform(Basis { length: longest, chirp: 0.0 });
        let powers = Powers::of(transform, raw, longest / 4);
        let StreamInfo { rate_hz, if_hz, real, .. } = self.info;
        let mut now = Vec::new();
        if let Some(state) = &self.state {
            if names::is_of_lines(&state.how, rate_hz) {
                now = names::lines(&powers, rate_hz, if_hz, real);
            }
            if now.is_empty() {
                let all = raw.iter().map(|z| f64::from(z.norm_sqr())).sum::<f64>();
                let excess = all / raw.len() as f64 / state.noise - 1.0;
                now.extend(names::others(&state.how, rate_hz, excess.max(1e-3)));
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

/// The samples by which a treatment is chosen.
fn middle(samples: &[Complex32], rate_hz: f64) -> &[Complex32] {
    let count = ((CHOICE_S * rate_hz) as usize).min(samples.len());
    let start = (samples.len() - count) / 2;
    &samples[start..start + count]
}

/// Median power of some of the samples.
fn median_power(samples: &[Complex32]) -> f32 {
    let step = (samples.len() / 1024).max(1);
    let mut powers: Vec<f32> = samples.iter().step_by(step).map(Complex32::norm_sqr).collect();
    let middle = powers.len() / 2;
    if powers.is_empty() { 0.0 } else { *powers.select_nth_unstable_by(middle, f32::total_cmp).1 }
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
