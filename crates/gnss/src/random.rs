//! Random numbers by a simple generator, so that figures can be checked in any language.

use num_complex::Complex64;
use std::f64::consts::TAU;

/// The generator SplitMix64 (Steele, Lea and Flood 2014), with the draws of the reference scenes.
#[derive(Clone, Debug)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// A stream that starts from a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform on [0, 1): the upper 53 bits.
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Circular complex normal with E|z|^2 = 1: sqrt(-ln(1 - u1)) exp(j 2 pi u2).
    pub fn complex_normal(&mut self) -> Complex64 {
        let radius = (-(1.0 - self.uniform()).ln()).sqrt();
        Complex64::from_polar(radius, TAU * self.uniform())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_number_is_that_of_the_reference() {
        // By an independent implementation.
        assert_eq!(SplitMix64::new(1).uniform(), 0.5665615751722809);
    }
}
