//! Beams: weights that combine the channels of an array into one.
//!
//! A beam's output is w^H x. All weights here pass the wanted signature s undistorted, w^H s = s_0 (the
//! response of the reference element, the first), so that changing a beam does not change the carrier phase.

use crate::acquisition::search::add_product;
use crate::array::CMat;
use crate::capture::Block;
use num_complex::{Complex32, Complex64};
use sdr_rx_linalg::{Cholesky, orthonormal_basis};

/// Choice of the weights of a receiver's beams.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BeamKind {
    /// [`Beam::conventional`]. On samples whose jammers were removed it is [`Beam::lcmv`] with nulls on them,
    /// since the signature measured there has nothing along them.
    #[default]
    Conventional,
    /// [`Beam::mvdr`]: against interference too weak to be detected as a jammer.
    Mvdr,
}

/// Fraction of the mean power that is added to the covariance's diagonal for [`Beam::mvdr`]: with fewer
/// samples than some hundred per element the weights would otherwise adapt to the noise.
const LOADING: f64 = 1e-2;

/// Weights of one beam.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    weights: Vec<Complex32>,
}

impl Beam {
    /// A beam of these weights.
    pub fn new(weights: &[Complex64]) -> Self {
        let single = |w: &Complex64| Complex32::new(w.re as f32, w.im as f32);
        Self { weights: weights.iter().map(single).collect() }
    }

    /// One element alone.
    pub fn element(index: usize, elements: usize) -> Self {
        let weight = |m| if m == index { Complex32::ONE } else { Complex32::ZERO };
        Self { weights: (0..elements).map(weight).collect() }
    }

    /// Matched to the signature alone: the maximum gain in white noise, 10 log10(M) dB (van Trees 2.3).
    pub fn conventional(signature: &[Complex64]) -> Self {
        Self::normalised(signature.to_vec(), signature)
    }

    /// Capon's beam: minimum output power with the signature passed undistorted (van Trees 6.2.1), from the
    /// covariance of the samples of all elements with a little diagonal loading.
    pub fn mvdr(signature: &[Complex64], covariance: &CMat) -> Self {
        let m = signature.len();
        let power = (0..m).map(|k| covariance[(k, k)].re).sum::<f64>() / m as f64;
        let loaded = CMat::from_fn(m, m, |i, k| {
            covariance[(i, k)] + if i == k { LOADING * power } else { 0.0 }
        });
        let column = CMat::from_fn(m, 1, |k, _| signature[k]);
        match Cholesky::new(&loaded) {
            Some(factor) => {
                let solved = factor.solve(&column);
                Self::normalised((0..m).map(|k| solved[(k, 0)]).collect(), signature)
            }
            None => Self::conventional(signature),
        }
    }

    /// Matched to the signature with exact nulls on the columns of `interference`, fewer than the elements (van
    /// Trees 6.7).
    pub fn lcmv(signature: &[Complex64], interference: &CMat) -> Self {
        let m = signature.len();
        let basis = orthonormal_basis(interference);
        let column = CMat::from_fn(m, 1, |k, _| signature[k]);
        let free = &column - &basis * (basis.adjoint() * &column);
        Self::normalised((0..m).map(|k| free[(k, 0)]).collect(), signature)
    }

    /// Scaled so that w^H s = s_0; where the weights do not pass the signature at all, the first element.
    fn normalised(weights: Vec<Complex64>, signature: &[Complex64]) -> Self {
        let passed: Complex64 = weights.iter().zip(signature).map(|(w, s)| w.conj() * s).sum();
        let scale = (signature[0] / passed).conj();
        if !scale.is_finite() || passed.norm() < 1e-12 {
            return Self::element(0, signature.len());
        }
        let single = |w: Complex64| Complex32::new(w.re as f32, w.im as f32);
        Self { weights: weights.into_iter().map(|w| single(w * scale)).collect() }
    }

    /// The weights.
    pub fn weights(&self) -> &[Complex32] {
        &self.weights
    }

    /// Gain for a signature over the response of the first element to it, dB, in noise that is white in
    /// space.
    pub fn gain_db(&self, signature: &[Complex64]) -> f64 {
        let wide = |w: &Complex32| Complex64::new(w.re.into(), w.im.into());
        let passed: Complex64 =
            self.weights.iter().zip(signature).map(|(w, s)| wide(w).conj() * s).sum();
        let noise: f64 = self.weights.iter().map(|w| wide(w).norm_sqr()).sum();
        10.0 * (passed.norm_sqr() / (signature[0].norm_sqr() * noise)).log10()
    }

    /// Forms the beam of a block with one channel per weight. One multiply-add a sample and element; the
    /// output stays in the cache, the channels are read once.
    pub fn form(&self, block: &Block, output: &mut Vec<Complex32>) {
        const TILE: usize = 2048;
        output.clear();
        output.resize(block.len(), Complex32::ZERO);
        for (tile, out) in output.chunks_mut(TILE).enumerate() {
            for (m, w) in self.weights.iter().enumerate() {
                add_product(w.conj(), &block.channel(m)[tile * TILE..][..out.len()], out);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::Manifold;
    use crate::gnss::antenna::AntennaArray;

    fn passed(beam: &Beam, signature: &[Complex64]) -> Complex64 {
        let wide = |w: &Complex32| Complex64::new(w.re.into(), w.im.into());
        beam.weights().iter().zip(signature).map(|(w, s)| wide(w).conj() * s).sum()
    }

    #[test]
    fn beams_pass_the_signature_and_suppress_the_jammer() {
        let manifold = Manifold::new(AntennaArray::half_wavelength(8));
        let wanted = manifold.response([0.2, 0.0]);
        let jammer = manifold.response([-0.35, 0.0]);
        // Unit noise and a jammer 40 dB over it at every element.
        let covariance = CMat::from_fn(8, 8, |i, k| {
            1e4 * jammer[i] * jammer[k].conj() + if i == k { 1.0 } else { 0.0 }
        });
        let interference = CMat::from_fn(8, 1, |k, _| jammer[k]);
        let conventional = Beam::conventional(&wanted);
        let mvdr = Beam::mvdr(&wanted, &covariance);
        let lcmv = Beam::lcmv(&wanted, &interference);
        for beam in [&conventional, &mvdr, &lcmv] {
            // Weights are rounded to 2^-24 of at most 1.
            assert!((passed(beam, &wanted) - 1.0).norm() < 1e-5);
        }
        assert!((conventional.gain_db(&wanted) - 10.0 * 8f64.log10()).abs() < 1e-4);
        assert!(passed(&lcmv, &jammer).norm() < 1e-5);
        // One null costs at most the fraction of the wanted signature's power that lies along it.
        let along: Complex64 = jammer.iter().zip(&wanted).map(|(j, w)| j.conj() * w).sum();
        let cost = 10.0 * (1.0 - along.norm_sqr() / 64.0).log10();
        assert!((lcmv.gain_db(&wanted) - (10.0 * 8f64.log10() + cost)).abs() < 1e-3);
        // The residual of the jammer over the noise, with loading of 1 % of 10^4: some 100 of noise.
        assert!(passed(&mvdr, &jammer).norm_sqr() * 1e4 < 1.0);
    }

    #[test]
    fn a_formed_beam_is_the_direct_sum() {
        let mut block = Block::zeros(3, 5000);
        for (c, channel) in block.channels_mut().enumerate() {
            for (n, x) in channel.iter_mut().enumerate() {
                *x = Complex32::new(((n * (c + 3)) % 17) as f32, ((n + 5 * c) % 13) as f32 - 6.0);
            }
        }
        let signature =
            [Complex64::new(1.0, 0.0), Complex64::new(0.0, 2.0), Complex64::new(-0.5, 0.5)];
        let beam = Beam::conventional(&signature);
        let mut output = Vec::new();
        beam.form(&block, &mut output);
        for n in [0, 1, 2047, 2048, 4999] {
            let sum: Complex32 =
                (0..3).map(|c| beam.weights()[c].conj() * block.channel(c)[n]).sum();
            // Three products and sums of at most 17 in magnitude.
            assert!((output[n] - sum).norm() < 1e-4);
        }
    }
}
