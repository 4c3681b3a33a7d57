//! Thermal and impulsive noise: complex Gaussian, and a Gaussian mixture of two components.
//!
//! Normal random numbers come from the Box-Muller transform in single precision (the logarithm, sine and
//! cosine are polynomials, so that the loop runs in vector registers) on the bits of a ChaCha8
//! generator. Sample n always takes the same words of the generator's stream, wherever the blocks
//! begin and whichever thread computes it. Tails reach 6.6 sigma.

use multiversion::multiversion;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The distribution of the noise of one complex sample: circular Gaussian of unit variance (the background),
/// or with `probability`, independently of other samples, of a variance `ratio` times as large (an impulse).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussianMixture {
    /// Probability that a sample is impulsive, 0 to 1 (0: white Gaussian noise).
    pub probability: f64,
    /// Variance of impulsive samples over that of the background, > 0.
    pub ratio: f64,
}

impl GaussianMixture {
    /// Variance of the mixture for a background of unit variance.
    pub fn variance(self) -> f64 {
        1.0 + self.probability * (self.ratio - 1.0)
    }
}

/// A noise generator of one channel.
pub struct NoiseSource {
    normal: ChaCha8Rng,
    gate: ChaCha8Rng,
    mixture: GaussianMixture,
    common: Option<CommonImpulses>,
    bits: Vec<u32>,
}

/// Impulses that are in all channels at once.
struct CommonImpulses {
    gate: ChaCha8Rng,
    threshold: u64,
    bits: Vec<u32>,
}

/// The number that a random 32-bit word is below with this probability.
fn threshold(probability: f64) -> u64 {
    (probability * 2f64.powi(32)) as u64
}

impl NoiseSource {
    /// Noise of the distribution `mixture` from `seed`, independent between values of `channel` below 2^30.
    pub fn new(mixture: GaussianMixture, seed: u64, channel: usize) -> Self {
        let stream = |kind: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(kind << 32 | channel as u64);
            rng
        };
        Self { normal: stream(1), gate: stream(2), mixture, common: None, bits: Vec::new() }
    }

    /// The same where a fraction `common` of the impulses is in all channels of this `seed` at once, each
    /// with noise of its own. The probability e of impulses at a channel stays that of the mixture: with
    /// a = e `common` of a common impulse, that of a channel's own is b with 1 - (1 - a)(1 - b) = e.
    pub fn with_common_impulses(mut self, common: f64, seed: u64) -> Self {
        let probability = self.mixture.probability * common;
        if probability > 0.0 {
            let mut gate = ChaCha8Rng::seed_from_u64(seed);
            gate.set_stream(4 << 32);
            self.common =
                Some(CommonImpulses { gate, threshold: threshold(probability), bits: Vec::new() });
            self.mixture.probability = if probability < 1.0 {
                (self.mixture.probability - probability) / (1.0 - probability)
            } else {
                0.0
            };
        }
        self
    }

    /// Adds to (`re`, `im`), of one length, the noise of samples `first`, `first` + 1, ...
    pub fn add(&mut self, first: u64, re: &mut [f32], im: &mut [f32]) {
        let len = re.len();
        self.bits.resize(2 * len, 0);
        self.normal.set_word_pos(2 * u128::from(first));
        self.normal.fill_bytes(bytemuck::cast_slice_mut(&mut self.bits));
        let sigma = std::f32::consts::FRAC_1_SQRT_2;
        let background = [sigma; 2];
        if self.mixture.probability == 0.0 && self.common.is_none() {
            return add_normal(&self.bits, &[], 0, background, re, im);
        }
        let (bits, gates) = (self.bits.len(), len);
        self.bits.resize(bits + gates, 0);
        let (normal, gate) = self.bits.split_at_mut(bits);
        self.gate.set_word_pos(u128::from(first));
        self.gate.fill_bytes(bytemuck::cast_slice_mut(gate));
        let mut threshold = threshold(self.mixture.probability);
        if let Some(common) = &mut self.common {
            // A gate word of 0 is an impulse.
            threshold = threshold.max(1);
            common.bits.resize(gates, 0);
            common.gate.set_word_pos(u128::from(first));
            common.gate.fill_bytes(bytemuck::cast_slice_mut(&mut common.bits));
            for (word, &common_word) in gate.iter_mut().zip(&common.bits) {
                *word *= u32::from(u64::from(common_word) >= common.threshold);
            }
        }
        let sigmas = [sigma, sigma * self.mixture.ratio.sqrt() as f32];
        add_normal(normal, gate, threshold, sigmas, re, im);
    }
}

/// Adds sigma x (normal, normal) to each sample; sigma is `sigmas[1]` where the sample's gate word
/// is below `threshold`, else `sigmas[0]`; an empty `gate` means never. About 45 operations a sample.
fn add_normal(
    bits: &[u32],
    gate: &[u32],
    threshold: u64,
    sigmas: [f32; 2],
    re: &mut [f32],
    im: &mut [f32],
) {
    const CHUNK: usize = 64;
    let mut scale = [sigmas[0]; CHUNK];
    for (start, pairs) in (0..re.len()).step_by(CHUNK).zip(bits.chunks(2 * CHUNK)) {
        let len = pairs.len() / 2;
        for (s, &g) in scale.iter_mut().zip(gate.get(start..start + len).unwrap_or(&[])) {
            *s = if u64::from(g) < threshold { sigmas[1] } else { sigmas[0] };
        }
        let pairs = bytemuck::cast_slice(pairs);
        add_box_muller(
            pairs,
            &scale[..len],
            &mut re[start..start + len],
            &mut im[start..start + len],
        );
    }
}

#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
fn add_box_muller(pairs: &[[u32; 2]], scale: &[f32], re: &mut [f32], im: &mut [f32]) {
    for (((pair, scale), re), im) in pairs.iter().zip(scale).zip(re).zip(im) {
        let (x, y) = box_muller(pair[0], pair[1]);
        *re += scale * x;
        *im += scale * y;
    }
}

/// Two independent standard normal numbers from two words of uniform bits: the radius
/// sqrt(-2 ln u) with u = (31 bits + 1/2) / 2^31, and a direction of 32 bits.
#[inline(always)]
fn box_muller(a: u32, b: u32) -> (f32, f32) {
    let u = ((a >> 1) as i32 as f32 + 0.5) * 2f32.powi(-31);
    let radius = (-2.0 * ln(u)).max(0.0).sqrt();
    // The low 30 bits place the angle in [-pi/4, pi/4); the two top bits turn it by quarters.
    let angle = (b << 2) as i32 as f32 * (std::f32::consts::FRAC_PI_2 / 4_294_967_296.0);
    let z = angle * angle;
    // Minimax polynomials on [-pi/4, pi/4] (Cephes, Moshier 1989: sinf, cosf), error below 2^-23.
    let sin = ((-1.951_529_6e-4 * z + 8.332_161e-3) * z - 1.666_665_5e-1) * z * angle + angle;
    let cos = ((2.443_315_7e-5 * z - 1.388_731_6e-3) * z + 4.166_664_6e-2) * z * z - 0.5 * z + 1.0;
    let sign = f32::from_bits(radius.to_bits() | (b & 0x8000_0000));
    if b & 0x4000_0000 == 0 { (sign * cos, sign * sin) } else { (-sign * sin, sign * cos) }
}

/// Natural logarithm of a positive normal number (Cephes logf, Moshier 1989), error below 2^-22
/// relative to max(|ln x|, 1).
#[inline(always)]
fn ln(x: f32) -> f32 {
    const SQRT_HALF_BITS: i32 = 0x3f35_04f3;
    const COEFFICIENTS: [f32; 9] = [
        7.037_683_6e-2,
        -1.151_461e-1,
        1.167_699_9e-1,
        -1.242_014_1e-1,
        1.424_932_3e-1,
        -1.666_805_8e-1,
        2.000_071_5e-1,
        -2.499_999_4e-1,
        3.333_333e-1,
    ];
    let bits = x.to_bits() as i32;
    let exponent = (bits - SQRT_HALF_BITS) >> 23;
    let f = f32::from_bits((bits - (exponent << 23)) as u32) - 1.0;
    let z = f * f;
    let polynomial = COEFFICIENTS.iter().fold(0.0, |sum, c| sum * f + c);
    let e = exponent as f32;
    f + (f * z * polynomial - 0.5 * z) + e * std::f32::consts::LN_2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draw(mixture: GaussianMixture, seed: u64, len: usize) -> (Vec<f32>, Vec<f32>) {
        let (mut re, mut im) = (vec![0.0; len], vec![0.0; len]);
        NoiseSource::new(mixture, seed, 0).add(0, &mut re, &mut im);
        (re, im)
    }

    #[test]
    fn polynomials_agree_with_the_scalar_functions_of_the_library() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..100_000 {
            let (a, b) = (rng.next_u32(), rng.next_u32());
            let (x, y) = box_muller(a, b);
            let u = (f64::from(a >> 1) + 0.5) / 2f64.powi(31);
            let quarter = f64::from(b >> 30 & 1) + 2.0 * f64::from(b >> 31);
            let turn = (quarter + f64::from((b << 2) as i32) / 2f64.powi(32)) / 4.0;
            let radius = (-2.0 * u.ln()).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
            // Rounding of u (2^-24) moves r^2 / 2 by as much near u = 1: r by 2^-24 / r.
            let bound = 4.0 * 2f64.powi(-22) * radius.max(1.0) + 2f64.powi(-24) / radius;
            assert!((f64::from(x) - radius * cos).abs() < bound);
            assert!((f64::from(y) - radius * sin).abs() < bound);
        }
    }

    #[test]
    fn noise_is_normal_by_chi_square_to_five_sigma_and_white() {
        let n = 1 << 22;
        let (re, im) = draw(GaussianMixture { probability: 0.0, ratio: 1.0 }, 3, n);
        let all: Vec<f64> = re.iter().chain(&im).map(|&x| f64::from(x) * 2f64.sqrt()).collect();
        let count = all.len() as f64;
        // Bins of a quarter sigma from -5 to 5 and the two tails, against the normal integral.
        let cdf = |x: f64| 0.5 * erfc(-x / 2f64.sqrt());
        let mut bins = [0u32; 42];
        for &x in &all {
            bins[((x + 5.0) * 4.0 + 1.0).floor().clamp(0.0, 41.0) as usize] += 1;
        }
        let edge = |i: usize| cdf(-5.0 + 0.25 * i as f64);
        let chi_square: f64 = (0..42)
            .map(|i| {
                let low = if i == 0 { 0.0 } else { edge(i - 1) };
                let high = if i == 41 { 1.0 } else { edge(i) };
                let expected = (high - low) * count;
                (f64::from(bins[i]) - expected).powi(2) / expected
            })
            .sum();
        // 41 degrees of freedom: mean 41, standard deviation 9; the 1e-5 point is 90.
        assert!(chi_square < 90.0, "chi-square {chi_square}");
        // Moments: standard deviations of the mean, variance and kurtosis are 1, sqrt 2, sqrt 24 over sqrt n.
        let moment = |p: i32| all.iter().map(|x| x.powi(p)).sum::<f64>() / count;
        let five_sigma = 5.0 / count.sqrt();
        assert!(moment(1).abs() < five_sigma);
        assert!((moment(2) - 1.0).abs() < five_sigma * 2f64.sqrt());
        assert!((moment(4) - 3.0).abs() < five_sigma * 96f64.sqrt());
        // Whiteness: correlation at any lag, and of I with Q, has the standard deviation 1 / sqrt n.
        let bound = 5.0 / (n as f64).sqrt();
        let correlation = |a: &[f32], b: &[f32]| {
            2.0 * a.iter().zip(b).map(|(x, y)| f64::from(x * y)).sum::<f64>() / n as f64
        };
        assert!(correlation(&re, &im).abs() < bound);
        for lag in [1, 2, 3, 7, 16, 64, 1000, 4096] {
            assert!(correlation(&re[lag..], &re).abs() < bound, "lag {lag}");
            assert!(correlation(&re[lag..], &im).abs() < bound, "lag {lag}");
        }
    }

    #[test]
    fn a_mixture_has_its_theoretical_moments() {
        let mixture = GaussianMixture { probability: 0.1, ratio: 50.0 };
        let n = 1 << 20;
        let (re, im) = draw(mixture, 5, n);
        let power: Vec<f64> = re.iter().zip(&im).map(|(x, y)| f64::from(x * x + y * y)).collect();
        let mean = power.iter().sum::<f64>() / n as f64;
        let square = power.iter().map(|p| p * p).sum::<f64>() / n as f64;
        // |z|^2 is exponential in each component: E p = v, E p^2 = 2 (1 - e + e K^2), and so on.
        let raw = |m: i32, factorial: f64| factorial * (0.9 + 0.1 * 50f64.powi(m));
        let sigma =
            |m: i32, f: f64, f2: f64| ((raw(2 * m, f2) - raw(m, f).powi(2)) / n as f64).sqrt();
        assert_eq!(mixture.variance(), raw(1, 1.0));
        assert!((mean - mixture.variance()).abs() < 5.0 * sigma(1, 1.0, 2.0), "{mean}");
        assert!((square - raw(2, 2.0)).abs() < 5.0 * sigma(2, 2.0, 24.0), "{square}");
    }

    #[test]
    fn any_blocks_give_the_same_noise_and_other_channels_another() {
        let mixture = GaussianMixture { probability: 0.3, ratio: 9.0 };
        let (re, _) = draw(mixture, 9, 1000);
        let mut source = NoiseSource::new(mixture, 9, 0);
        for (first, len) in [(500, 500), (0, 1), (1, 77), (78, 422)] {
            let (mut a, mut b) = (vec![0.0; len], vec![0.0; len]);
            source.add(first as u64, &mut a, &mut b);
            assert_eq!(a, re[first..first + len]);
        }
        let (mut a, mut b) = (vec![0.0; 1000], vec![0.0; 1000]);
        NoiseSource::new(mixture, 9, 1).add(0, &mut a, &mut b);
        let same = a.iter().zip(&re).filter(|(x, y)| x == y).count();
        assert!(same < 10);
    }

    /// Complementary error function by its continued fraction or series (Abramowitz & Stegun 7.1.6,
    /// 7.1.14), to 1e-12 relative.
    fn erfc(x: f64) -> f64 {
        if x < 0.0 {
            return 2.0 - erfc(-x);
        }
        let scale = (-x * x).exp() / std::f64::consts::PI.sqrt();
        if x < 2.0 {
            let mut term = x;
            let mut sum = x;
            for k in 1..100 {
                term *= 2.0 * x * x / (2 * k + 1) as f64;
                sum += term;
            }
            return 1.0 - 2.0 * scale * sum;
        }
        scale / (1..=200).rev().fold(x, |tail, k| x + f64::from(k) / 2.0 / tail)
    }
}
