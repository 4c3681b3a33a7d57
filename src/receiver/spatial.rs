//! First stage of an array: equal noise in all elements, and removal of jammers.

use crate::array::CMat;
use crate::array::covariance::covariance;
use crate::array::sky::interference::Interference;
use crate::capture::Block;
use num_complex::{Complex32, Complex64};

/// Samples of a block in which jammers are searched.
const LOOK: usize = 1 << 15;

/// Equalises the elements' noise, and removes jammers, block by block.
#[derive(Clone, Debug, Default)]
pub(super) struct SpatialFilter {
    /// Gain that makes each element's noise that of the first; from the first block.
    gains: Vec<Complex64>,
    interference: Option<Interference>,
}

impl SpatialFilter {
    /// Treats a block in place; one of a single channel stays as it is.
    pub(super) fn process(&mut self, block: &mut Block) {
        if block.channels() < 2 || block.is_empty() {
            return;
        }
        if self.gains.is_empty() {
            let floors: Vec<f64> = (0..block.channels()).map(|c| floor(block.channel(c))).collect();
            let gain = |f: &f64| if *f > 0.0 { (floors[0] / f).sqrt() } else { 1.0 };
            self.gains = floors.iter().map(|f| Complex64::from(gain(f))).collect();
        }
        block.weight_channels(&self.gains);
        let interference = Interference::find(&head_covariance(block));
        if !interference.is_empty() {
            let mut channels: Vec<&mut [Complex32]> = block.channels_mut().collect();
            interference.remove(&mut channels);
            self.interference = Some(interference);
        }
    }

    /// Jammers of the last block that had any.
    pub(super) fn interference(&self) -> Option<&Interference> {
        self.interference.as_ref()
    }
}

/// Covariance of the elements' first samples.
pub(super) fn head_covariance(block: &Block) -> CMat {
    let len = block.len().min(LOOK);
    let looked: Vec<&[Complex32]> =
        (0..block.channels()).map(|c| &block.channel(c)[..len]).collect();
    covariance(&looked)
}

/// Median power of the samples: robust against impulses.
fn floor(samples: &[Complex32]) -> f64 {
    let mut powers: Vec<f32> = samples.iter().take(LOOK).map(Complex32::norm_sqr).collect();
    let middle = powers.len() / 2;
    f64::from(*powers.select_nth_unstable_by(middle, f32::total_cmp).1)
}
