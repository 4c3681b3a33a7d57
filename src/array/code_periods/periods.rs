//! Samples by code period: one row for every element and code period, one column for every bin of code phase.

use crate::gnss::Signal;
use multiversion::multiversion;
use num_complex::{Complex32, Complex64};

/// Maximum number of bins in a code period, two for each chip of a C/A code; at higher rates neighbouring samples are
/// summed. Without a code the threshold of a power grows with the square root of the number of bins.
const MAX_BINS: usize = 2048;

/// Samples of all elements, by code period and bin of code phase.
#[derive(Clone, Debug)]
pub struct CodePeriods {
    /// Rows, element by element: row m K + k is period k of element m. Samples of one bin are summed and
    /// divided by the root of their number, so that white noise keeps its variance.
    pub rows: Vec<Vec<Complex32>>,
    /// Number of elements, M.
    pub elements: usize,
    /// Number of code periods, K.
    pub periods: usize,
    /// Bins in a code period, N.
    pub bins: usize,
    /// Code period, s.
    pub period_s: f64,
    /// Mean position of a sample in its bin, 0 to 1.
    pub offset: f64,
}

impl CodePeriods {
    /// Sorts the first `periods` code periods of a signal of all channels, or as many as there are. `rate_hz` is at
    /// least the chip rate.
    ///
    /// # Panics
    /// When a channel is shorter than the first.
    pub fn new(channels: &[&[Complex32]], rate_hz: f64, signal: &Signal, periods: usize) -> Self {
        let samples = channels.first().map_or(0, |c| c.len());
        let elements = channels.len();
        let per_period = rate_hz * signal.period_s();
        let bins = bins_per_period(per_period, signal.chips);
        let bins_per_sample = bins as f64 / per_period;
        let whole = ((samples as f64 + 1e-6) / per_period) as usize;
        let periods = periods.min(whole);
        // A sample on the edge between two bins belongs to the later one in spite of rounding.
        let position = |n: usize| n as f64 * bins_per_sample + 1e-6;
        let used = (0..samples).take_while(|&n| position(n) < (periods * bins) as f64).count();
        let mut scale = vec![0f32; periods * bins];
        (0..used).for_each(|n| scale[position(n) as usize] += 1.0);
        scale.iter_mut().for_each(|count| *count = count.max(1.0).sqrt().recip());
        let mut rows = Vec::with_capacity(elements * periods);
        for channel in channels {
            let mut sorted = vec![Complex32::ZERO; periods * bins];
            for (n, x) in channel[..used].iter().enumerate() {
                sorted[position(n) as usize] += x;
            }
            sorted.iter_mut().zip(&scale).for_each(|(x, scale)| *x *= scale);
            rows.extend(sorted.chunks_exact(bins.max(1)).map(<[Complex32]>::to_vec));
        }
        let offset = (0..used).map(|n| position(n).fract()).sum::<f64>() / used.max(1) as f64;
        Self { rows, elements, periods, bins, period_s: signal.period_s(), offset }
    }

    /// The period `k` of element `m`.
    pub fn row(&self, m: usize, k: usize) -> &[Complex32] {
        &self.rows[m * self.periods + k]
    }

    /// The first of them.
    pub fn first(mut self, periods: usize) -> Self {
        let (before, mut at) = (self.periods.max(1), 0);
        self.periods = periods.min(self.periods);
        self.rows.retain(|_| {
            at += 1;
            (at - 1) % before < periods
        });
        self
    }

    /// Mean power of a bin of each element.
    pub fn powers(&self) -> Vec<f64> {
        let power = |row: &Vec<Complex32>| product(row, row).re;
        let mean = (self.periods * self.bins).max(1) as f64;
        self.rows
            .chunks(self.periods.max(1))
            .map(|rows| rows.iter().map(power).sum::<f64>() / mean)
            .collect()
    }
}

/// Bins per code period: as many as samples or slightly fewer, at most 2048; with prime factors 2, 3 and 5 only, for
/// fast transforms.
fn bins_per_period(samples: f64, chips: usize) -> usize {
    let most = ((samples + 1e-6) as usize).min(MAX_BINS);
    let is_smooth = |n: &usize| {
        [2, 3, 5].into_iter().fold(*n, |mut rest, prime| {
            while rest > 0 && rest.is_multiple_of(prime) {
                rest /= prime;
            }
            rest
        }) == 1
    };
    (1..=most.max(chips)).rev().find(is_smooth).unwrap_or(1)
}

/// Sum of a conj(b).
#[multiversion(targets(
    "x86_64+avx2+fma",
    "x86_64+avx512f+avx512bw+avx512vl+avx512dq",
    "aarch64+neon"
))]
pub(crate) fn product(a: &[Complex32], b: &[Complex32]) -> Complex64 {
    const LANES: usize = 16;
    let (mut re, mut im) = ([0f32; LANES], [0f32; LANES]);
    let mut add = |lane: usize, a: &Complex32, b: &Complex32| {
        re[lane] += a.re * b.re + a.im * b.im;
        im[lane] += a.im * b.re - a.re * b.im;
    };
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            add(lane, &a[lane], &b[lane]);
        }
    }
    a_rest.iter().zip(b_rest).enumerate().for_each(|(lane, (a, b))| add(lane, a, b));
    let sum = |lanes: [f32; LANES]| lanes.into_iter().map(f64::from).sum();
    Complex64::new(sum(re), sum(im))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gnss::signal::GPS_L1_CA;

    #[test]
    fn the_number_of_bins_is_that_of_samples_or_2048() {
        for (rate, bins) in
            [(2.048e6, 2048), (2e6, 2000), (2.6e6, 2048), (20e6, 2048), (1.1e6, 1080)]
        {
            assert_eq!(bins_per_period(rate * 1e-3, GPS_L1_CA.chips), bins, "{rate}");
        }
    }
}
