//! Conversion of the front end's samples to complex baseband at the receiver's processing rate.

use super::Oscillator;
use crate::capture::{Block, StreamInfo};
use multiversion::multiversion;
use num_complex::Complex32;
use std::f64::consts::PI;

/// Half the number of filter taps per unit of the decimation factor.
const TAPS_PER_STEP: usize = 4;
/// Kaiser's beta for 50 dB of stop-band attenuation, 0.1102 (50 - 8.7) (Oppenheim and Schafer 7.75).
const KAISER_BETA: f64 = 4.55;

/// Real and imaginary parts in separate arrays, for vectorisation of the filter.
#[derive(Clone, Debug, Default)]
struct Parts {
    re: Vec<f32>,
    im: Vec<f32>,
}

/// Removes the intermediate frequency and, if asked, lowers the rate by an integer factor.
///
/// Output sample k corresponds to the instant of input sample k x `decimation`: the filter is symmetric about
/// it, so there is no delay to correct, and the time of the first sample is unchanged. Input before the start
/// of the stream is taken as zero, so the first four output samples of a decimated stream are attenuated;
/// there is no output for the last four instants of the input. Blocks must come in order and without gaps.
/// Cost: one complex product a sample, and 9 multiply-adds a sample to decimate.
#[derive(Clone, Debug)]
pub struct Conditioner {
    info: StreamInfo,
    oscillator: Option<Oscillator>,
    decimation: usize,
    taps: Vec<f32>,
    pending: Vec<Parts>,
    mixed: Vec<Complex32>,
    next_output: u64,
}

impl Conditioner {
    /// A conditioner of the stream that `info` describes; a `decimation` of 0 counts as 1.
    ///
    /// The passband (within 0.1 dB) is +-0.31 of the new rate; aliases from beyond +-0.69 of it are
    /// attenuated by 49 dB.
    pub fn new(info: &StreamInfo, decimation: usize) -> Self {
        let decimation = decimation.max(1);
        let taps = if decimation > 1 { low_pass(decimation) } else { Vec::new() };
        let half = taps.len() / 2;
        let given =
            |n: u64| (n + decimation as u64 - 1).saturating_sub(half as u64) / decimation as u64;
        Self {
            oscillator: (info.if_hz != 0.0).then(|| Oscillator::new(info.if_hz, info.rate_hz)),
            decimation,
            pending: vec![Parts { re: vec![0.0; half], im: vec![0.0; half] }; info.channels],
            mixed: Vec::new(),
            next_output: 0,
            info: StreamInfo {
                rate_hz: info.rate_hz / decimation as f64,
                if_hz: 0.0,
                real: info.real && info.if_hz == 0.0,
                samples: info.samples.map(given),
                ..info.clone()
            },
            taps,
        }
    }

    /// Stream information of the output.
    pub fn info(&self) -> &StreamInfo {
        &self.info
    }

    /// Whether the output is the input unchanged, so that the stage can be left out.
    pub fn is_identity(&self) -> bool {
        self.decimation == 1 && self.oscillator.is_none()
    }

    /// Conditions the next block of the input; `output` is resized.
    pub fn process(&mut self, input: &Block, output: &mut Block) {
        if self.decimation == 1 {
            output.clone_from(input);
            if let Some(oscillator) = &self.oscillator {
                output.channels_mut().for_each(|x| oscillator.mix(input.first_sample(), x));
            }
            return;
        }
        let held = self.pending.first().map_or(0, |p| p.re.len()) + input.len();
        let count = match held.checked_sub(self.taps.len()) {
            Some(rest) => rest / self.decimation + 1,
            None => 0,
        };
        output.reset(input.channels(), count, self.next_output);
        let mut mixed = std::mem::take(&mut self.mixed);
        for (channel, held) in self.pending.iter_mut().enumerate() {
            mixed.clear();
            mixed.extend_from_slice(input.channel(channel));
            if let Some(oscillator) = &self.oscillator {
                oscillator.mix(input.first_sample(), &mut mixed);
            }
            held.re.extend(mixed.iter().map(|x| x.re));
            held.im.extend(mixed.iter().map(|x| x.im));
            decimate(held, &self.taps, self.decimation, output.channel_mut(channel));
            held.re.drain(..count * self.decimation);
            held.im.drain(..count * self.decimation);
        }
        self.mixed = mixed;
        self.next_output += count as u64;
    }
}

/// Kaiser-windowed low-pass of unit gain at 0 Hz whose half-amplitude point is the new Nyquist
/// frequency: 2 x `TAPS_PER_STEP` x `decimation` + 1 symmetric taps.
fn low_pass(decimation: usize) -> Vec<f32> {
    let half = (TAPS_PER_STEP * decimation) as i64;
    let tap = |k: i64| {
        let x = k as f64 / decimation as f64;
        let sinc = if k == 0 { 1.0 } else { (PI * x).sin() / (PI * x) };
        let at = k as f64 / half as f64;
        sinc * bessel_i0(KAISER_BETA * (1.0 - at * at).sqrt())
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

/// One output per `step` inputs: the inner product of the taps and the inputs from there on.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn decimate(input: &Parts, taps: &[f32], step: usize, output: &mut [Complex32]) {
    for (k, y) in output.iter_mut().enumerate() {
        let re = &input.re[k * step..][..taps.len()];
        let im = &input.im[k * step..][..taps.len()];
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
            let taps = low_pass(step);
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
            let taps = low_pass(step);
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
