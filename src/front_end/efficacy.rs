//! Effect of a memoryless nonlinearity on a weak signal in a Gaussian mixture of noise.
//!
//! A map z -> z w(|z|^2) passes a weak signal with the gain s = E\[p w(p) i(p)\], i = E\[1 / variance | p\],
//! and noise with the power n = E\[p w(p)^2\], p = |z|^2: the output's signal-to-noise ratio is the input
//! signal's power times s^2 / n, the map's *efficacy* (Miller and Thomas 1972; Kay, Detection Theory, 10.5).
//! The maximum, at w = i, is the Fisher information E\[p i(p)^2\]. Against the background alone, whose
//! efficacy is 1 / v1, a map loses -10 log10(v1 s^2 / n).

use super::mixture::Mixture;

/// A memoryless map of samples that depends on their magnitude alone. Thresholds are in standard deviations
/// of the background, sqrt(E|z|^2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Map {
    /// No change.
    Linear,
    /// The locally optimum map: w = E[1 / variance | z].
    Optimal,
    /// Blanking: samples above the threshold become zero.
    Blank(f64),
    /// Clipping: samples above the threshold keep their phase, and its magnitude.
    Clip(f64),
    /// Hard limiting: samples keep their phase alone.
    Sign,
    /// The optimum of the Cauchy distribution, w = 1 / (K^2 + p), whose sum is the myriad.
    Myriad(f64),
}

impl Map {
    /// The weight w of samples of this power, about 1 for the background.
    pub fn weight(self, noise: &Mixture, power: f64) -> f64 {
        let p = power / noise.background;
        match self {
            Self::Linear => 1.0,
            Self::Optimal => noise.background * noise.inverse_variance(power),
            Self::Blank(threshold) => f64::from(p <= threshold * threshold),
            Self::Clip(threshold) => (threshold / p.sqrt()).min(1.0),
            Self::Sign => 1.0 / p.sqrt(),
            Self::Myriad(k) => k * k / (k * k + p),
        }
    }

    /// Effect of the map on signal and noise.
    pub fn effect(self, noise: &Mixture) -> Effect {
        let threshold = match self {
            Self::Blank(threshold) => threshold,
            _ => 1.0,
        };
        Effect::of(noise, threshold, |power| self.weight(noise, power))
    }

    /// Loss of signal-to-noise ratio against the background alone, dB.
    pub fn loss_db(self, noise: &Mixture) -> f64 {
        self.effect(noise).loss_db()
    }
}

/// Effect of a map on a weak signal and on noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effect {
    /// Gain of the signal's amplitude.
    pub signal: f64,
    /// Power of the noise after the map over that of the background before.
    pub noise: f64,
}

impl Effect {
    /// The effect of weights by power on noise of this distribution; they may jump at one threshold, given in
    /// standard deviations of the background.
    pub fn of(mixture: &Mixture, threshold: f64, weight: impl Fn(f64) -> f64) -> Self {
        // Trapezoidal rule over ln p from where p times its density is negligible to where the density is:
        // e^-18 of the background's, and 60 times the impulses' mean; the jump lies halfway between two
        // points. The integrand is smooth otherwise, so that steps of 0.03 cause no error.
        const STEPS: usize = 1024;
        let (low, high) = (mixture.background.ln() - 18.0, mixture.impulse.ln() + 4.1);
        let step = (high - low) / STEPS as f64;
        let jump = mixture.background.ln() + 2.0 * threshold.ln();
        let start = low + ((jump - low) / step).fract() * step - step / 2.0;
        let (mut signal, mut noise) = (0.0, 0.0);
        for k in 0..=STEPS {
            let power = (start + step * k as f64).exp();
            let mass = step * mixture.log_power_density(power) * power;
            let weight = weight(power);
            signal += mass * weight * mixture.inverse_variance(power);
            noise += mass * weight * weight;
        }
        Self { signal, noise: noise / mixture.background }
    }

    /// Loss of signal-to-noise ratio against the background alone, dB, of weights that are about 1 for it.
    pub fn loss_db(self) -> f64 {
        -10.0 * (self.signal * self.signal / self.noise).log10()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mixture(probability: f64, ratio: f64) -> Mixture {
        Mixture { probability, background: 7.0, impulse: 7.0 * ratio, real: false }
    }

    #[test]
    fn losses_agree_with_independent_integration() {
        // Independent numerical integration, to 0.01 dB; linear, blank at 2 and 2.5, clip at 1, sign,
        // myriad at 1.5, optimal.
        let table = [
            (0.0, 1.0, [0.0, 0.42, 0.06, 0.26, 1.05, 0.34, 0.0]),
            (0.1, 50.0, [7.71, 0.95, 0.68, 1.26, 1.83, 0.97, 0.63]),
            (0.1, 1e3, [20.04, 0.88, 0.53, 1.39, 1.93, 0.82, 0.48]),
            (0.1, 1e4, [30.00, 0.88, 0.52, 1.41, 1.95, 0.80, 0.46]),
            (0.2, 50.0, [10.33, 1.56, 1.39, 2.32, 2.69, 1.67, 1.27]),
            (0.3, 50.0, [11.96, 2.25, 2.21, 3.46, 3.64, 2.48, 1.98]),
            (0.3, 1e3, [24.8, 1.98, 1.65, 3.92, 4.03, 1.99, 1.61]),
        ];
        let maps = [
            Map::Linear,
            Map::Blank(2.0),
            Map::Blank(2.5),
            Map::Clip(1.0),
            Map::Sign,
            Map::Myriad(1.5),
            Map::Optimal,
        ];
        for (probability, ratio, losses) in table {
            for (map, loss) in maps.into_iter().zip(losses) {
                let ours = map.loss_db(&mixture(probability, ratio));
                // Half a unit of the last digit printed.
                let digit = if loss == 24.8 { 0.05 } else { 0.0055 };
                assert!(
                    (ours - loss).abs() < digit,
                    "{probability} {ratio} {map:?}: {ours} {loss}"
                );
            }
        }
        for (ratio, optimal, linear) in [(50.0, 0.07, 1.73), (1e3, 0.05, 10.4), (1e4, 0.04, 20.0)] {
            let noise = mixture(0.01, ratio);
            assert!((Map::Optimal.loss_db(&noise) - optimal).abs() < 0.0055);
            assert!((Map::Linear.loss_db(&noise) - linear).abs() < 0.055);
        }
    }

    #[test]
    fn the_maximum_efficacy_is_the_fisher_information() {
        let noise = mixture(0.1, 50.0);
        let Effect { signal, noise } = Map::Optimal.effect(&noise);
        assert!((signal - 0.8651).abs() < 5e-5 && (noise - signal).abs() < 1e-9);
    }

    #[test]
    fn closed_forms_hold_for_real_and_complex_samples() {
        // Linear: unit gain and the variance. Sign of Gaussian noise: 4 / pi of complex samples, pi / 2 of
        // real ones (1-bit quantisation), to the accuracy of the trapezoidal rule.
        for real in [false, true] {
            let noisy = Mixture { real, ..mixture(0.1, 1e3) };
            let Effect { signal, noise } = Map::Linear.effect(&noisy);
            assert!((signal - 1.0).abs() < 1e-6 && (noise / (0.9 + 0.1 * 1e3) - 1.0).abs() < 1e-6);
            let sign = Map::Sign.loss_db(&Mixture { real, ..mixture(0.0, 1.0) });
            let ratio = std::f64::consts::PI / if real { 2.0 } else { 4.0 };
            let closed = 10.0 * if real { ratio.log10() } else { -ratio.log10() };
            assert!((sign - closed).abs() < 1e-3, "{sign} {closed}");
        }
    }
}
