//! Epochs of one receiver in order: what those before say of the next.

use super::Candidates;
use crate::error::PositioningError;
use crate::fix::Fix;
use std::collections::VecDeque;

/// Epochs whose residuals are remembered, and how many a scale needs.
const REMEMBERED: usize = 120;
const ENOUGH: usize = 20;
/// Largest scale of variances: reflections that make errors six times the model's.
const MOST: f64 = 36.0;
/// Smallest, where no model of the ionosphere is known and the standard deviation allows for a day of a solar maximum.
const LEAST_WITHOUT_IONOSPHERE: f64 = 0.04;

/// The scale of a receiver's errors against the error model, from the residuals of its last epochs.
#[derive(Clone, Debug, Default)]
pub struct Sequence {
    /// Variance ratios of the last epochs that gave a position, oldest first.
    ratios: VecDeque<f64>,
}

impl Sequence {
    /// The position of the next epoch.
    ///
    /// # Errors
    /// As [`crate::solve_epoch`].
    pub fn judge(&mut self, candidates: Candidates) -> Result<Fix, PositioningError> {
        let ratio = candidates.variance_ratio();
        let least = match candidates.adjustment.nav.ionosphere {
            Some(_) => 1.0,
            None => LEAST_WITHOUT_IONOSPHERE,
        };
        let fix = candidates.judge(self.factor(least))?;
        if let Some(ratio) = ratio {
            if self.ratios.len() == REMEMBERED {
                self.ratios.pop_front();
            }
            self.ratios.push_back(ratio);
        }
        Ok(fix)
    }

    /// 80 % quantile of the variance ratios: a fault now and then does not raise it.
    fn factor(&self, least: f64) -> f64 {
        if self.ratios.len() < ENOUGH {
            return 1.0;
        }
        let mut ratios: Vec<f64> = self.ratios.iter().copied().collect();
        let rank = ratios.len() * 4 / 5;
        let (_, quantile, _) = ratios.select_nth_unstable_by(rank, f64::total_cmp);
        quantile.clamp(least, MOST)
    }
}
