//! One antenna element: its noise, and the signals that reach it.

use super::Scenario;
use super::emission::Emission;
use super::jammer::Interference;
use super::noise::NoiseSource;
use super::variance::VarianceSource;
use num_complex::Complex32;

/// One antenna element.
pub(super) struct Element {
    channel: usize,
    noise: Option<NoiseSource>,
    variance: Option<VarianceSource>,
    level: f32,
    re: Vec<f32>,
    im: Vec<f32>,
}

impl Element {
    /// The element of a `channel`, which makes segments of `len` samples.
    pub fn new(scenario: &Scenario, channel: usize, len: usize) -> Self {
        let settings = &scenario.noise;
        let noise = || {
            NoiseSource::new(settings.mixture(), scenario.seed, channel)
                .with_common_impulses(settings.impulse_common_fraction, scenario.seed)
        };
        Self {
            channel,
            noise: settings.enabled.then(noise),
            variance: settings.variance(scenario.front_end.rate_hz, scenario.seed, channel),
            level: settings.background_variance.sqrt() as f32,
            re: vec![0.0; len],
            im: vec![0.0; len],
        }
    }

    /// Makes a batch of segments; `drawn` is the index of their first sample in the noise.
    pub fn make(
        &mut self,
        drawn: u64,
        emissions: &[Emission],
        jamming: &[Interference],
        out: &mut [Complex32],
    ) {
        let len = self.re.len();
        let (re, im) = (&mut self.re[..], &mut self.im[..]);
        for (k, out) in out.chunks_exact_mut(len).enumerate() {
            re.fill(0.0);
            im.fill(0.0);
            if let Some(noise) = &mut self.noise {
                let first = drawn + (k * len) as u64;
                noise.add(first, re, im);
                if let Some(variance) = &mut self.variance {
                    variance.scale(first, re, im);
                }
                if self.level != 1.0 {
                    re.iter_mut().chain(im.iter_mut()).for_each(|x| *x *= self.level);
                }
            }
            emissions.iter().for_each(|e| e.add(self.channel, k, re, im));
            let range = k * len..(k + 1) * len;
            jamming.iter().for_each(|j| j.add(self.channel, range.clone(), re, im));
            for ((out, &re), &im) in out.iter_mut().zip(&*re).zip(&*im) {
                *out = Complex32::new(re, im);
            }
        }
    }
}
