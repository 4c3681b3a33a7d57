//! Directions without codes: sources and their directions from the samples alone, before any code is known.
//!
//! At real signal strengths a satellite lies some 20 dB under the noise of a sample, where the raw snapshots
//! of the paper on JANE contain too little. So the covariance of all samples is compressed to the few
//! snapshots above its noise; LDA-l1,1 (or the faster solver of the same problem) finds candidates in them;
//! and JANE decides on the covariance which are present, how many, and from where.

use super::interference::Interference;
use crate::array::CMat;
use crate::array::covariance::{compress, covariance};
use crate::array::decision::{Jane, JaneError, JaneOptions, Source, row_noise, row_rule};
use crate::array::geometry::{Bearing, Manifold, dictionary};
use crate::array::sparse::{SparseError, SparseOptions, solve};
use num_complex::{Complex32, Complex64};

/// Candidates of the dictionary in a beamwidth.
const POINTS_PER_BEAM: usize = 3;
/// Maximum number of points of a dictionary: for a plane the square of this along each axis.
const MAX_POINTS: usize = 40;

/// Options of the search of directions.
#[derive(Clone, Debug, PartialEq)]
pub struct LookOptions {
    /// The solver of the sparse problem.
    pub sparse: SparseOptions,
    /// The decision.
    pub jane: JaneOptions,
}

impl Default for LookOptions {
    /// The fast solver, and one false source in a thousand searches.
    fn default() -> Self {
        Self { sparse: SparseOptions::default(), jane: JaneOptions::default() }
    }
}

/// Why no directions were found.
#[derive(Debug, thiserror::Error)]
pub enum LookError {
    /// The sparse problem could not be solved.
    #[error(transparent)]
    Sparse(#[from] SparseError),
    /// The decision could not be made.
    #[error(transparent)]
    Jane(#[from] JaneError),
    /// The samples hold no noise to measure by.
    #[error(
        "directions without codes: the samples are all zero, or hold a number that is not finite"
    )]
    NoNoise,
}

/// Interference from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jammer {
    /// Its direction, where it could be determined.
    pub bearing: Option<Bearing>,
    /// Power over the noise of one element's samples, all elements together, dB.
    pub power_db: f64,
}

/// Sources found by an array without codes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkyPicture {
    /// Number of elements.
    pub elements: usize,
    /// Number of samples of each element used.
    pub samples: usize,
    /// Jammers that were removed first.
    pub jammers: Vec<Jammer>,
    /// Number of eigenvalues of the covariance that noise does not explain.
    pub rank: usize,
    /// Number of groups of rows in the sparse estimate.
    pub candidates: usize,
    /// Sources decided on, strongest first; the powers are those at an element over its noise.
    pub sources: Vec<Source>,
    /// Whether there are too many signals for this array to resolve directions by its covariance: as many as
    /// elements, or more. No sources are given then.
    pub crowded: bool,
}

/// Searches the samples of all elements, which have equal noise floors and no remaining jammer. The noise is
/// that after the map for weak signals where impulses were suppressed.
///
/// # Errors
/// See [`LookError`].
pub fn look(
    channels: &[&[Complex32]],
    manifold: &Manifold,
    interference: Option<&Interference>,
    options: &LookOptions,
) -> Result<SkyPicture, LookError> {
    let samples = channels.first().map_or(0, |c| c.len());
    let nulled = interference.map_or(0, Interference::count);
    let jammers = interference.map_or(Vec::new(), |i| jammers(i, Some(manifold)));
    let r = equalised(covariance(channels), interference);
    let manifold = &interference.map_or(manifold.clone(), |i| manifold.clone().beside(&i.subspace));
    let compressed =
        compress(&r, samples, nulled, options.jane.false_alarm).ok_or(LookError::NoNoise)?;
    let noise = compressed.division.noise_variance;
    let mut picture = SkyPicture {
        elements: channels.len(),
        samples,
        jammers,
        rank: compressed.division.rank,
        ..SkyPicture::default()
    };
    let mut start = Vec::new();
    if picture.rank > 0 {
        let across = POINTS_PER_BEAM * channels.len();
        let across = if manifold.dimensions() < 2 { across } else { across.min(MAX_POINTS) };
        let grid = manifold.grid(across);
        let responses = dictionary(manifold, &grid);
        let estimate = solve(&responses, &compressed.snapshots, &options.sparse)?;
        let residual = &compressed.snapshots - &responses * &estimate;
        let groups = row_rule(&estimate, &grid, row_noise(&residual));
        picture.candidates = groups.len();
        start = groups.iter().map(|g| g.point).collect();
    }
    let jane = Jane::new(manifold, options.jane)?;
    let decision = jane.decide_covariance(&r, samples as f64, Some(noise), &start)?;
    picture.sources = decision.sources;
    picture.sources.iter_mut().for_each(|s| s.power /= noise);
    Ok(picture)
}

/// The covariance scaled to the same power at all elements, except for what was removed with the jammers:
/// JANE tests to 1 / sqrt(T) of the noise, and the gains of the front end are known far less accurately.
fn equalised(r: CMat, interference: Option<&Interference>) -> CMat {
    let kept = |m: usize| {
        1.0 - interference.map_or(0.0, |i| i.subspace.row(m).iter().map(|u| u.norm_sqr()).sum())
    };
    let elements = r.nrows();
    let power = |m: usize| r[(m, m)].re / kept(m);
    let mean = (0..elements).map(power).sum::<f64>() / elements as f64;
    let gains: Vec<f64> = (0..elements).map(|m| (mean / power(m)).sqrt()).collect();
    CMat::from_fn(elements, elements, |m, k| r[(m, k)] * (gains[m] * gains[k]))
}

/// The components of interference, strongest first, each with the direction whose response contains most of
/// its power (where the array is known).
pub fn jammers(interference: &Interference, manifold: Option<&Manifold>) -> Vec<Jammer> {
    let Some(manifold) = manifold else {
        let jammer = |&power_db| Jammer { bearing: None, power_db };
        return interference.powers_db.iter().map(jammer).collect();
    };
    let mut directions = interference.directions(manifold);
    let components = interference.powers_db.iter().zip(interference.subspace.col_iter());
    let jammer = |(&power_db, component): (&f64, faer::ColRef<'_, Complex64>)| {
        let held = |point| {
            let response = manifold.response(point);
            let along: Complex64 = component.iter().zip(&response).map(|(u, a)| u.conj() * a).sum();
            along.norm_sqr()
        };
        let powers = directions.iter().map(|d| held(d.0)).enumerate();
        let best = powers.max_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0);
        let bearing = best.map(|k| manifold.bearing(directions.swap_remove(k).0));
        Jammer { bearing, power_db }
    };
    components.map(jammer).collect()
}
