//! Weights that keep outliers from spoiling a least-squares solution.

/// How residuals larger than their deviation explains are weighted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Robust {
    /// As all others: plain least squares.
    #[default]
    None,
    /// By Huber (1964): `1` up to 1.345 deviations, then `1.345 / |v|`: 95 % as efficient as least squares
    /// under normal noise.
    Huber,
    /// By IGG-III (Yang, Song, Xu, J. Geodesy 76, 2002): `1` up to k0 = 2 deviations, then
    /// `k0/|v| ((k1 - |v|)/(k1 - k0))^2`, and nothing from k1 = 5 on. Found from Huber's solution, as a loss
    /// that rejects has several minima.
    Igg3,
}

const HUBER: f64 = 1.345;
const IGG3_FULL: f64 = 2.0;
const IGG3_NOTHING: f64 = 5.0;

impl Robust {
    /// Weight, 0 to 1, of a residual of `v` standard deviations.
    pub fn weight(self, v: f64) -> f64 {
        let v = v.abs();
        match self {
            Self::None => 1.0,
            Self::Huber => (HUBER / v).min(1.0),
            Self::Igg3 if v <= IGG3_FULL => 1.0,
            Self::Igg3 if v >= IGG3_NOTHING => 0.0,
            Self::Igg3 => {
                let share = (IGG3_NOTHING - v) / (IGG3_NOTHING - IGG3_FULL);
                IGG3_FULL / v * share * share
            }
        }
    }

    /// The losses that are solved one after the other after plain least squares, each from the solution of the
    /// one before.
    pub(super) fn stages(self) -> &'static [Self] {
        match self {
            Self::None => &[],
            Self::Huber => &[Self::Huber],
            Self::Igg3 => &[Self::Huber, Self::Igg3],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_fall_from_one_without_jumps_and_bound_the_influence() {
        for loss in [Robust::None, Robust::Huber, Robust::Igg3] {
            assert_eq!(loss.weight(0.0), 1.0);
            for k in 0..1000 {
                let v = 0.01 * f64::from(k);
                let (here, next) = (loss.weight(v), loss.weight(-v - 1e-6));
                assert!((0.0..=1.0).contains(&here) && (next - here).abs() < 1e-5 && next <= here);
                // What a residual pulls: at most 1.345 of Huber, 2 of IGG-III, nothing beyond 5.
                let pull = v * here;
                match loss {
                    Robust::None => {}
                    Robust::Huber => assert!(pull < HUBER + 1e-12),
                    Robust::Igg3 => assert!(pull <= IGG3_FULL && (v < 5.0 || pull == 0.0)),
                }
            }
        }
    }
}
