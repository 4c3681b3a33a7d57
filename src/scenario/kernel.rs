//! The signal kernel: chips by a numerically controlled oscillator, carrier by a rotating phasor.
//!
//! Both run over one segment (at most 1 ms) with constant rates; every segment is anchored anew in
//! double precision, so single precision never accumulates beyond it. No fused multiply-add is
//! used: every instruction set gives the same bytes.

use multiversion::multiversion;
use num_complex::Complex64;

/// Samples whose phasors advance side by side.
const LANES: usize = 16;

/// One period of a code, and as much of the next as a segment may need that starts anywhere in the first: a power of two
/// of entries, whose index is the integer part of a code phase of 64 bits.
#[derive(Clone, Debug)]
pub struct ChipTable {
    values: Box<[f32]>,
    /// Bits of the fraction of a code phase.
    fraction_bits: u32,
}

impl ChipTable {
    /// Of the values of one period, for segments of up to so many of them.
    pub fn new(period: &[f32], segment: usize) -> Self {
        let len = (period.len() + segment).next_power_of_two();
        let values = (0..len).map(|i| period[i % period.len()]).collect();
        Self { values, fraction_bits: 64 - len.ilog2() }
    }

    /// Becomes `other` with the values from `from` on of the other sign.
    pub fn set_signed(&mut self, other: &Self, from: usize) {
        self.values.copy_from_slice(&other.values);
        self.values[from..].iter_mut().for_each(|v| *v = -*v);
    }

    /// Writes into `chips` the value at code phase `start` + k `step` (entries, `start` in the first period, `step` >=
    /// 0, the last in the table) for each sample k: one multiply, shift and look-up per sample.
    pub fn spread(&self, start: f64, step: f64, chips: &mut [f32]) {
        let scale = (1u64 << self.fraction_bits) as f64;
        let (start, step) = ((start * scale) as u64, (step * scale) as u64);
        spread_fixed(&self.values, self.fraction_bits, start, step, chips);
    }

    /// The same, but each sample is the mean of the code over the time from half a sample before to half a sample after it,
    /// as behind a filter before the sampling: at rates commensurate with the chips, where chips sampled as they are would
    /// look alike for all delays within a sample. Costs the signal `2/3 x 1/2` of its power in samples with a chip edge
    /// (0.4 dB at four samples a chip).
    pub fn spread_averaged(&self, start: f64, step: f64, chips: &mut [f32]) {
        let scale = (1u64 << self.fraction_bits) as f64;
        let (start, step) = ((start * scale) as u64, (step * scale) as u64);
        spread_averaged_fixed(&self.values, self.fraction_bits, start, step, chips);
    }
}

#[multiversion(targets("x86_64+avx2+bmi2", "aarch64+neon"))]
fn spread_fixed(table: &[f32], fraction_bits: u32, start: u64, step: u64, chips: &mut [f32]) {
    let mask = table.len() - 1;
    let mut phase = start;
    for chip in chips {
        *chip = table[(phase >> fraction_bits) as usize & mask];
        phase = phase.wrapping_add(step);
    }
}

#[multiversion(targets("x86_64+avx2+bmi2", "aarch64+neon"))]
fn spread_averaged_fixed(
    table: &[f32],
    fraction_bits: u32,
    start: u64,
    step: u64,
    chips: &mut [f32],
) {
    let fraction: u64 = (1 << fraction_bits) - 1;
    let (half, per_sample) = (step / 2, 1.0 / step as f32);
    // Before the first sample of a code the first chip stands for the last one.
    let mut begin = start.saturating_sub(half);
    for k in 0..chips.len() as u64 {
        let end = start.saturating_add(k * step + half);
        let (first, last) = ((begin >> fraction_bits) as usize, (end >> fraction_bits) as usize);
        // At most one edge lies between, as samples are shorter than chips.
        let after = if first == last { 1.0 } else { (end & fraction) as f32 * per_sample };
        chips[k as usize] = table[first] + (table[last] - table[first]) * after;
        begin = end;
    }
}

/// Adds `chips` times the phasor `start` exp(j 2 pi k `cycles`) to (`re`, `im`); the three slices are of
/// one length. `start` carries amplitude, initial phase and, with an array, the element's steering:
/// call it once per channel with the same chips. Eight operations a sample and 16-fold parallel;
/// single precision leaves a phase error below 2^-24 rad x samples / 16, 8e-6 rad over 2048 samples.
pub fn mix_add(chips: &[f32], start: Complex64, cycles: f64, re: &mut [f32], im: &mut [f32]) {
    let step = Complex64::cis(std::f64::consts::TAU * cycles);
    let mut phasor = start;
    let mut lanes = ([0.0; LANES], [0.0; LANES]);
    let mut rotation = Complex64::ONE;
    for lane in 0..LANES {
        lanes.0[lane] = phasor.re as f32;
        lanes.1[lane] = phasor.im as f32;
        phasor *= step;
        rotation *= step;
    }
    mix_add_lanes(chips, lanes, (rotation.re as f32, rotation.im as f32), re, im);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
fn mix_add_lanes(
    chips: &[f32],
    lanes: ([f32; LANES], [f32; LANES]),
    rotation: (f32, f32),
    re: &mut [f32],
    im: &mut [f32],
) {
    let (mut c, mut s) = lanes;
    let (chips, chip_rest) = chips.as_chunks::<LANES>();
    let (re, re_rest) = re.as_chunks_mut::<LANES>();
    let (im, im_rest) = im.as_chunks_mut::<LANES>();
    for ((chip, re), im) in chips.iter().zip(re).zip(im) {
        for l in 0..LANES {
            re[l] += chip[l] * c[l];
            im[l] += chip[l] * s[l];
            let turned = c[l] * rotation.0 - s[l] * rotation.1;
            s[l] = c[l] * rotation.1 + s[l] * rotation.0;
            c[l] = turned;
        }
    }
    for (l, ((chip, re), im)) in chip_rest.iter().zip(re_rest).zip(im_rest).enumerate() {
        *re += chip * c[l];
        *im += chip * s[l];
    }
}

/// Adds `weight` times (`from_re`, `from_im`) to (`re`, `im`), all of one length: a wave that is made once and
/// reaches each element with a weight of its own. Eight operations a sample.
pub fn add_weighted(
    from_re: &[f32],
    from_im: &[f32],
    weight: Complex64,
    re: &mut [f32],
    im: &mut [f32],
) {
    add_weighted_lanes(from_re, from_im, [weight.re as f32, weight.im as f32], re, im);
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
fn add_weighted_lanes(x: &[f32], y: &[f32], [a, b]: [f32; 2], re: &mut [f32], im: &mut [f32]) {
    for (((x, y), re), im) in x.iter().zip(y).zip(re).zip(im) {
        *re += a * x - b * y;
        *im += a * y + b * x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::{Sv, signal};

    #[test]
    fn kernels_agree_with_their_scalar_versions() {
        let code = signal::of(Sv::from_prn(7).unwrap()).code();
        let values: Vec<f32> = code.iter().map(|&chip| f32::from(chip)).collect();
        let table = ChipTable::new(&values, 1024);
        for (start, step, cycles, len) in [
            (0.0, 0.39346, 1.7e-3, 2048),
            (1022.999, 0.4999, -0.31, 2047),
            (511.3, 0.05, 0.002, 100),
            (17.0, 1.0, 0.5, 15),
        ] {
            let mut chips = vec![0.0; len];
            table.spread(start, step, &mut chips);
            let (mut re, mut im) = (vec![0.25f32; len], vec![-0.5f32; len]);
            let first = Complex64::from_polar(0.7, 1.1);
            mix_add(&chips, first, cycles, &mut re, &mut im);
            for k in 0..len {
                let phase: f64 = start + step * k as f64;
                // 2^-53 chips x 2048 steps: no phase is that near a chip's edge here, except exact ones.
                let chip = f64::from(code[phase.floor() as usize % code.len()]);
                assert_eq!(f64::from(chips[k]), chip, "sample {k}");
                let turn = Complex64::cis(std::f64::consts::TAU * cycles * k as f64);
                let exact = first * turn * chip + Complex64::new(0.25, -0.5);
                let got = Complex64::new(f64::from(re[k]), f64::from(im[k]));
                // Three roundings of 2^-24 per turn of 16 lanes, coherent in the worst case.
                let bound = 2f64.powi(-24) * (4.0 + 3.0 * (k / LANES) as f64);
                assert!((got - exact).norm() < bound, "sample {k}: {got} {exact}");
            }
        }
    }
}
