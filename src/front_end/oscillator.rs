//! A numerically controlled oscillator whose phase depends on the sample's index alone.

use multiversion::multiversion;
use num_complex::{Complex32, Complex64};
use std::f64::consts::TAU;

/// Samples between two phases computed in double precision.
const ANCHOR: usize = 256;

/// Multiplies samples by exp(-j 2 pi f n / rate), n counted from the start of the stream.
///
/// The phase is kept in units of 2^-64 cycles and multiplied by n exactly (modulo one cycle), so that it
/// neither drifts nor depends on the lengths of blocks. Within 256 samples it comes from a table: each phasor
/// is accurate to the rounding of two `f32` factors.
#[derive(Clone, Debug)]
pub struct Oscillator {
    step: u64,
    table: Vec<Complex32>,
}

impl Oscillator {
    /// An oscillator of `frequency_hz` at `rate_hz` samples per second.
    pub fn new(frequency_hz: f64, rate_hz: f64) -> Self {
        let cycles_per_sample = (frequency_hz / rate_hz).rem_euclid(1.0);
        let step = (cycles_per_sample * 2f64.powi(64)) as u64;
        let table = (0..ANCHOR as u64).map(|n| narrow(phasor(step, n))).collect();
        Self { step, table }
    }

    /// The phasor of sample `n` in double precision.
    pub fn at(&self, n: u64) -> Complex64 {
        phasor(self.step, n)
    }

    /// Mixes `samples`, of which the first has index `first`, in place.
    pub fn mix(&self, first: u64, samples: &mut [Complex32]) {
        let mut n = first;
        for run in samples.chunks_mut(ANCHOR) {
            turn(run, &self.table, narrow(self.at(n)));
            n += run.len() as u64;
        }
    }
}

fn phasor(step: u64, n: u64) -> Complex64 {
    let cycles = step.wrapping_mul(n) as f64 / 2f64.powi(64);
    Complex64::cis(-TAU * cycles)
}

fn narrow(z: Complex64) -> Complex32 {
    Complex32::new(z.re as f32, z.im as f32)
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn turn(samples: &mut [Complex32], table: &[Complex32], anchor: Complex32) {
    for (x, t) in samples.iter_mut().zip(table) {
        let re = t.re * anchor.re - t.im * anchor.im;
        let im = t.re * anchor.im + t.im * anchor.re;
        *x = Complex32::new(x.re * re - x.im * im, x.re * im + x.im * re);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn blocks_and_the_scalar_version_agree(
            if_hz in -1e7f64..1e7,
            first in 0u64..1_000_000_000_000,
            len in 1usize..1500,
            cut in 0usize..1500,
        ) {
            let oscillator = Oscillator::new(if_hz, 20e6);
            let mut whole = vec![Complex32::new(3.0, -1.0); len];
            let mut parts = whole.clone();
            oscillator.mix(first, &mut whole);
            let (a, b) = parts.split_at_mut(cut.min(len));
            oscillator.mix(first, a);
            oscillator.mix(first + a.len() as u64, b);
            // Two factors and two products, each rounded to 2^-24 in both components: 6 roundings of
            // a value of magnitude sqrt(10) at most.
            let bound = 6.0 * 2f64.powi(-24) * 2.0 * 10f64.sqrt();
            for (k, (&w, &p)) in whole.iter().zip(&parts).enumerate() {
                let n = first + k as u64;
                // The direct way: the fraction of n f / rate, in 128-bit integers.
                let step = ((if_hz / 20e6).rem_euclid(1.0) * 2f64.powi(64)) as u128;
                let cycles = (step * u128::from(n) % (1 << 64)) as f64 / 2f64.powi(64);
                let exact = Complex64::new(3.0, -1.0) * Complex64::cis(-TAU * cycles);
                for x in [w, p] {
                    let error = Complex64::new(x.re.into(), x.im.into()) - exact;
                    prop_assert!(error.norm() < bound, "{error} at {n}");
                }
            }
        }
    }

    #[test]
    fn the_frequency_is_accurate_over_days() {
        // At n = rate x 1 day an integer number of Hz has advanced by a whole number of cycles; the step is
        // accurate to 2^-53 of itself, so the phase to 2^-53 of the 2.16e11 cycles.
        let oscillator = Oscillator::new(2.5e6, 20e6);
        let day = 20_000_000 * 86_400;
        assert!(oscillator.at(day).arg().abs() < TAU * 2.16e11 * 2f64.powi(-53));
    }
}
