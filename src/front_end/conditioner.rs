//! Conversion of the front end's samples to complex baseband at the receiver's processing rate.
//!
//! Sampled at a multiple of the chip rate, all chips change between the same samples: delays within a sample look
//! alike, and a replica of signs lies on a grid of samples (73 m at 4.092 MHz), whatever the phases it is tabulated at.
//! A stream of such a rate is resampled to one a thousandth lower, at which a code period sweeps the grid.

use super::Oscillator;
use crate::capture::{Block, StreamInfo};
use crate::gnss::signal::GPS_L1_CA;
use multiversion::multiversion;
use num_complex::Complex32;
use std::f64::consts::PI;

/// Half the number of filter taps per unit of the decimation factor, and where a stream is resampled.
const TAPS_PER_STEP: usize = 4;
const TAPS_PER_STEP_RESAMPLED: usize = 8;
/// Kaiser's beta for 50 dB of stop-band attenuation, 0.1102 (50 - 8.7) (Oppenheim and Schafer 7.75).
const KAISER_BETA: f64 = 4.55;
/// Distances of outputs are whole multiples of an input sample over this.
const UNITS: u64 = 1024;
/// Filters for positions between input samples.
const POSITIONS: usize = 128;
/// Real and imaginary parts in separate arrays, for vectorisation of the filter.
#[derive(Clone, Debug, Default)]
struct Parts {
    re: Vec<f32>,
    im: Vec<f32>,
}

/// Removes the intermediate frequency and, if asked, lowers the rate by an integer factor; a rate that would then be
/// commensurate with the chips by 1/1024 more.
///
/// Output sample k corresponds to the instant of input k times the ratio of the rates: the filter is symmetric about
/// it, so there is no delay to correct, and the time of the first sample is unchanged. Input before the start
/// of the stream is taken as zero, so the first four output samples of a decimated stream are attenuated (eight of a
/// resampled one); there is no output for as many last instants of the input. Blocks must come in order and without
/// gaps. Cost: one complex product a sample, 9 multiply-adds a sample to decimate and 17 to resample.
#[derive(Clone, Debug)]
pub struct Conditioner {
    info: StreamInfo,
    oscillator: Option<Oscillator>,
    /// Distance of outputs, input samples over [`UNITS`].
    step: u64,
    /// Filters for positions between input samples; none where nothing is filtered.
    bank: Vec<Vec<f32>>,
    pending: Vec<Parts>,
    mixed: Vec<Complex32>,
    next_output: u64,
    /// Input samples that are no longer held.
    drained: u64,
}

impl Conditioner {
    /// A conditioner of the stream that `info` describes; a `decimation` of 0 counts as 1.
    ///
    /// The passband (within 0.1 dB) is +-0.31 of the new rate; aliases from beyond +-0.69 of it are
    /// attenuated by 49 dB. (+-0.40 and +-0.60 where it is resampled.)
    pub fn new(info: &StreamInfo, decimation: usize) -> Self {
        let decimation = decimation.max(1);
        let resampled = GPS_L1_CA.is_commensurate(info.rate_hz / decimation as f64);
        let bank = match (resampled, decimation) {
            (true, _) => (0..POSITIONS)
                .map(|k| low_pass(decimation, TAPS_PER_STEP_RESAMPLED, k as f64 / POSITIONS as f64))
                .collect(),
            (false, 1) => Vec::new(),
            (false, _) => vec![low_pass(decimation, TAPS_PER_STEP, 0.0)],
        };
        let half = bank.first().map_or(0, Vec::len) / 2;
        let step = decimation as u64 * (UNITS + u64::from(resampled));
        let given = |n: u64| match n.checked_sub(half as u64 + 1) {
            Some(last) => (last * UNITS + UNITS - 1) / step + 1,
            None => 0,
        };
        Self {
            oscillator: (info.if_hz != 0.0).then(|| Oscillator::new(info.if_hz, info.rate_hz)),
            step,
            pending: vec![Parts { re: vec![0.0; half], im: vec![0.0; half] }; info.channels],
            mixed: Vec::new(),
            next_output: 0,
            drained: 0,
            info: StreamInfo {
                rate_hz: info.rate_hz * UNITS as f64 / step as f64,
                if_hz: 0.0,
                real: info.real && info.if_hz == 0.0,
                samples: info.samples.map(given),
                ..info.clone()
            },
            bank,
        }
    }

    /// Stream information of the output.
    pub fn info(&self) -> &StreamInfo {
        &self.info
    }

    /// Whether the output is the input unchanged, so that the stage can be left out.
    pub fn is_identity(&self) -> bool {
        self.bank.is_empty() && self.oscillator.is_none()
    }

    /// Conditions the next block of the input; `output` is resized.
    pub fn process(&mut self, input: &Block, output: &mut Block) {
        let Some(taps) = self.bank.first().map(Vec::len) else {
            output.clone_from(input);
            if let Some(oscillator) = &self.oscillator {
                output.channels_mut().for_each(|x| oscillator.mix(input.first_sample(), x));
            }
            return;
        };
        let held = self.pending.first().map_or(0, |p| p.re.len()) + input.len();
        // Outputs whose filters end within the input.
        let end = match (self.drained + held as u64).checked_sub(taps as u64) {
            Some(last) => (last * UNITS + UNITS - 1) / self.step + 1,
            None => 0,
        };
        let count = end.saturating_sub(self.next_output);
        output.reset(input.channels(), count as usize, self.next_output);
        let done = ((self.next_output + count) * self.step / UNITS - self.drained) as usize;
        let mut mixed = std::mem::take(&mut self.mixed);
        for (channel, held) in self.pending.iter_mut().enumerate() {
            mixed.clear();
            mixed.extend_from_slice(input.channel(channel));
            if let Some(oscillator) = &self.oscillator {
                oscillator.mix(input.first_sample(), &mut mixed);
            }
            held.re.extend(mixed.iter().map(|x| x.re));
            held.im.extend(mixed.iter().map(|x| x.im));
            let first = self.next_output * self.step - self.drained * UNITS;
            resample(held, &self.bank, first, self.step, output.channel_mut(channel));
            held.re.drain(..done);
            held.im.drain(..done);
        }
        self.mixed = mixed;
        self.next_output += count;
        self.drained += done as u64;
    }
}

/// Rate of the stream behind a conditioner, Hz.
pub fn conditioned_rate_hz(rate_hz: f64, decimation: usize) -> f64 {
    let rate_hz = rate_hz / decimation.max(1) as f64;
    if GPS_L1_CA.is_commensurate(rate_hz) {
        rate_hz * UNITS as f64 / (UNITS + 1) as f64
    } else {
        rate_hz
    }
}

/// Kaiser-windowed low-pass of unit gain at 0 Hz whose half-amplitude point is the new Nyquist
/// frequency: 2 x `taps_per_step` x `decimation` + 1 taps, symmetric about `shift` samples after their middle.
fn low_pass(decimation: usize, taps_per_step: usize, shift: f64) -> Vec<f32> {
    let half = (taps_per_step * decimation) as i64;
    let tap = |k: i64| {
        let k = k as f64 - shift;
        let x = k / decimation as f64;
        let sinc = if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) };
        let at = k / half as f64;
        sinc * bessel_i0(KAISER_BETA * (1.0 - at * at).max(0.0).sqrt())
    };
    let taps: Vec<f64> = (-half..=half).map(tap).collect();
    let sum: f64 = taps.iter().sum();
    taps.iter().map(|t| (t / sum) as f32).collect()
}

/// Modified Bessel function of the first kind and order 0, by its series (terms (x/2)^2k / k!^2).
fn bessel_i0(x: f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 1.0;
    for k in 1..30 {
        term *= (x / 2.0 / f64::from(k)).powi(2);
        sum += term;
    }
    sum
}

/// Outputs `step` apart from `first` on, in [`UNITS`] of an input: the inner product of the inputs from there on and the
/// taps for the position between them.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn resample(input: &Parts, bank: &[Vec<f32>], first: u64, step: u64, output: &mut [Complex32]) {
    for (k, y) in output.iter_mut().enumerate() {
        let at = first + k as u64 * step;
        let (start, between) = ((at / UNITS) as usize, (at % UNITS) as usize);
        let taps = &bank[between * bank.len() / UNITS as usize][..];
        let re = &input.re[start..][..taps.len()];
        let im = &input.im[start..][..taps.len()];
        let mut sums = [[0f32; 8]; 2];
        let (t_runs, t_rest) = taps.as_chunks::<8>();
        let (re_runs, re_rest) = re.as_chunks::<8>();
        let (im_runs, im_rest) = im.as_chunks::<8>();
        for ((t, re), im) in t_runs.iter().zip(re_runs).zip(im_runs) {
            for lane in 0..8 {
                sums[0][lane] += re[lane] * t[lane];
                sums[1][lane] += im[lane] * t[lane];
            }
        }
        let mut sum = Complex32::new(sums[0].iter().sum(), sums[1].iter().sum());
        for ((t, re), im) in t_rest.iter().zip(re_rest).zip(im_rest) {
            sum += Complex32::new(re * t, im * t);
        }
        *y = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn info(rate_hz: f64, if_hz: f64) -> StreamInfo {
        StreamInfo {
            rate_hz,
            if_hz,
            channels: 1,
            real: if_hz != 0.0,
            samples: None,
            start_time: None,
            format: "cf32".into(),
            array: None,
        }
    }

    fn block(first: u64, samples: &[Complex32]) -> Block {
        let mut block = Block::default();
        block.reset(1, samples.len(), first);
        block.channel_mut(0).copy_from_slice(samples);
        block
    }

    fn run(conditioner: &mut Conditioner, samples: &[Complex32], cuts: &[usize]) -> Vec<Complex32> {
        let (mut at, mut all, mut out) = (0, Vec::new(), Block::default());
        let sizes = cuts.iter().copied().chain(std::iter::once(usize::MAX));
        for size in sizes {
            let end = samples.len().min(at + size.min(samples.len()));
            conditioner.process(&block(at as u64, &samples[at..end]), &mut out);
            assert_eq!(out.first_sample(), all.len() as u64);
            all.extend_from_slice(out.channel(0));
            at = end;
        }
        all
    }

    proptest! {
        #[test]
        fn decimation_equals_its_scalar_version_for_any_block_lengths(
            values in prop::collection::vec((-100f32..100.0, -100f32..100.0), 1..400),
            step in 2usize..6,
            cuts in prop::collection::vec(0usize..90, 0..6),
        ) {
            let samples: Vec<Complex32> = values.iter().map(|&(a, b)| Complex32::new(a, b)).collect();
            let input = StreamInfo { samples: Some(samples.len() as u64), ..info(1e6, 0.0) };
            let mut conditioner = Conditioner::new(&input, step);
            let promised = conditioner.info().samples;
            let out = run(&mut conditioner, &samples, &cuts);
            prop_assert_eq!(promised, Some(out.len() as u64));
            let taps = low_pass(step, TAPS_PER_STEP, 0.0);
            let half = taps.len() as i64 / 2;
            // Each of n products and sums rounds to 2^-24 of at most 142 x the sum of |taps| (< 2).
            let bound = taps.len() as f32 * 2f32.powi(-24) * 142.0 * 2.0;
            for (k, y) in out.iter().enumerate() {
                let center = (k * step) as i64;
                let direct: Complex32 = (-half..=half)
                    .filter_map(|d| Some(samples.get(usize::try_from(center + d).ok()?)? * taps[(d + half) as usize]))
                    .sum();
                prop_assert!((direct - y).norm() <= bound);
            }
        }
    }

    /// Rates of usual front ends: 1, 2, 4 samples a chip, 16 in 3 chips, and those that no small numbers express.
    #[test]
    fn multiples_of_the_chip_rate_are_resampled_and_tones_keep_their_phase() {
        for (rate_hz, resampled) in [
            (2.046e6, true),
            (4.092e6, true),
            (5.115e6, true),
            (5.456e6, true),
            (8.184e6, true),
            (16.368e6, true),
            (2.048e6, false),
            (2.4e6, false),
            (2.6e6, false),
            (4e6, false),
            (4.1e6, false),
            (5e6, false),
            (12e6, false),
            (20e6, false),
        ] {
            assert_eq!(Conditioner::new(&info(rate_hz, 0.0), 1).is_identity(), !resampled);
            assert_eq!(conditioned_rate_hz(rate_hz, 1) < rate_hz, resampled, "{rate_hz}");
        }
        // A tone at a tenth of the rate, whatever the blocks: to half of a 128th of a sample, 0.1 x 2 pi / 256.
        let input = info(4.092e6, 0.0);
        let tone = |at: f64| Complex32::cis((2.0 * PI * 0.1 * at) as f32);
        let samples: Vec<Complex32> = (0..20_000).map(|n| tone(f64::from(n))).collect();
        let mut conditioner = Conditioner::new(&input, 1);
        let ratio = input.rate_hz / conditioner.info().rate_hz;
        let out = run(&mut conditioner, &samples, &[1, 7, 500, 3, 2000]);
        assert!(out.len() > 19_900);
        for (k, y) in out.iter().enumerate().skip(20) {
            assert!((y - tone(k as f64 * ratio)).norm() < 0.1 * PI as f32 / 128.0 + 3e-3, "{k}");
        }
    }

    #[test]
    fn only_baseband_at_the_same_rate_is_passed_unchanged() {
        assert!(Conditioner::new(&info(4e6, 0.0), 1).is_identity());
        assert!(!Conditioner::new(&info(4e6, 0.0), 2).is_identity());
        assert!(!Conditioner::new(&info(4e6, 1e6), 1).is_identity());
    }

    #[test]
    fn a_real_carrier_is_mixed_to_baseband_with_its_phase_at_the_documented_instants() {
        // cos(2 pi f t + 1) at the intermediate frequency, 20 MHz to 5 MHz: half its amplitude with phase 1
        // at every output instant; the image at 2 f = 10 MHz, aliased to 0, is attenuated by 49 dB, and the
        // offset of 500 Hz advances the phase.
        let (rate, if_hz, offset) = (20e6, 5.0e6 + 445.88, 500.0);
        let phase = |n: usize| 2.0 * PI * (if_hz + offset) * n as f64 / rate + 1.0;
        let samples: Vec<Complex32> =
            (0..4000).map(|n| Complex32::new(phase(n).cos() as f32, 0.0)).collect();
        let mut conditioner = Conditioner::new(&info(rate, if_hz), 4);
        assert_eq!(conditioner.info().rate_hz, 5e6);
        assert_eq!(conditioner.info().if_hz, 0.0);
        let out = run(&mut conditioner, &samples, &[1000]);
        for (k, y) in out.iter().enumerate().skip(TAPS_PER_STEP) {
            let expected = 2.0 * PI * offset * (4 * k) as f64 / rate + 1.0;
            let expected = Complex32::from_polar(0.5, expected as f32);
            assert!((y - expected).norm() < 0.5 * 10f32.powf(-49.0 / 20.0), "{k}: {y} {expected}");
        }
    }

    #[test]
    fn the_filter_has_the_documented_passband_and_alias_attenuation() {
        for step in [2, 4, 5, 10] {
            let taps = low_pass(step, TAPS_PER_STEP, 0.0);
            let gain = |new_rates: f64| {
                let half = taps.len() as f64 / 2.0 - 0.5;
                let angle = |k: usize| 2.0 * PI * new_rates / step as f64 * (k as f64 - half);
                let sum: f64 =
                    taps.iter().enumerate().map(|(k, &t)| f64::from(t) * angle(k).cos()).sum();
                20.0 * sum.abs().log10()
            };
            for k in 0..=31 {
                assert!(gain(f64::from(k) / 100.0).abs() < 0.1, "step {step}, {k}");
            }
            // Kaiser's formulas for beta and length are good to about 1 dB of the 50 dB designed.
            for k in 69..(50 * step) {
                assert!(
                    gain(k as f64 / 100.0) < -49.0,
                    "step {step}, {k}: {}",
                    gain(k as f64 / 100.0)
                );
            }
        }
    }
}
