//! The look: sources and their directions from the samples alone, before any code is known, and the codes that are
//! then found in them.
//!
//! At real signal strengths a satellite lies some 20 dB under the noise of a sample. What repeats every code period is
//! first separated by Doppler modulo the inverse of a code period ([`DopplerCovariances`]): of each of these small
//! covariances the snapshots above the noise are taken, LDA-l1,1 (or the faster solver of the same problem) finds
//! directions in all of them side by side, and JANE decides on each covariance which are present. A column holds one or
//! two satellites, so that more of them than elements are resolved. Without the array's geometry the eigenvalues decide
//! (Tracy and Widom), with one element the power (gamma distribution).
//!
//! Three false candidates are expected in noise alone, since each is verified: by its code, the strongest first, in a
//! beam to it (`identify`), and in the end, if no code was found, once more in what the others leave.

use super::interference::Interference;
use crate::array::CMat;
use crate::array::code_periods::doppler::DopplerCovariances;
use crate::array::code_periods::periods::CodePeriods;
use crate::array::covariance::covariance;
use crate::array::decision::jane::bearing_sigma;
use crate::array::decision::random_matrix::eigenvalue_threshold;
use crate::array::decision::scan::Scan;
use crate::array::decision::{Group, Jane, JaneError, JaneOptions, Source, row_noise, row_rule};
use crate::array::geometry::{Manifold, Point, dictionary};
use crate::array::sparse::{Engine, SparseError, SparseEstimate, SparseOptions, reconstruct};
use crate::gnss::Transmission;
use crate::gnss::antenna::AntennaArray;
use nalgebra::Vector3;
use num_complex::Complex64;
use rayon::prelude::*;
use sdr_rx_linalg::hermitian_eigen;
use std::f64::consts::PI;

/// Points of the dictionary in a beamwidth.
const POINTS_PER_BEAM: usize = 3;
/// Maximum number of points of a dictionary: for a plane the square of this along each axis.
const MAX_POINTS: usize = 40;
/// Candidates of one direction are one source where more than this fraction of a beam's power lies along the other.
const COHERENT: f64 = 0.5;
/// And within so many inverse block lengths of each other.
const NEIGHBOURS: f64 = 2.0;

/// Fraction of the median eigenvalue of some periods below which the smallest shows that elements share their noise.
const DEPENDENT: f64 = 0.3;
const TESTED_PERIODS: usize = 10;

/// Options of the look.
#[derive(Clone, Debug, PartialEq)]
pub struct LookOptions {
    /// The solver of the sparse problem.
    pub sparse: SparseOptions,
    /// The decision; its false-alarm probability is that of a source left without a code.
    pub jane: JaneOptions,
    /// Candidates expected in noise alone: each is verified.
    pub false_candidates: f64,
    /// What decides on sources where the array's geometry is known.
    pub decision: LookDecision,
}

/// What decides on sources.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LookDecision {
    /// JANE, from the directions of the rows.
    #[default]
    Jane,
    /// The rows of the sparse estimate alone, on its grid, as in the paper on LDA-l1,1.
    Rows,
}

impl Default for LookOptions {
    /// The fast solver, three false candidates, and one false source in a thousand looks.
    fn default() -> Self {
        Self {
            sparse: SparseOptions::default(),
            jane: JaneOptions::default(),
            false_candidates: 3.0,
            decision: LookDecision::default(),
        }
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
    /// One element without samples.
    #[error(
        "directions without codes: the samples of channel {0} are all zero: is its antenna connected?"
    )]
    Silent(usize),
    /// Noise that the elements share.
    #[error(
        "directions without codes: the noise of the elements is not independent: do channels share an antenna, or a front end?"
    )]
    Dependent,
}

/// The codes searched in the sources of a look.
#[derive(Clone, Copy, Debug)]
pub struct LookCodes<'a> {
    /// Satellites, of one signal.
    pub satellites: &'a [Transmission],
    /// Others of the same code length: only what is left without a code is searched for them, to name it.
    pub others: &'a [Transmission],
    /// Doppler interval, Hz.
    pub doppler_hz: (f64, f64),
    /// Probability of one or more false satellites.
    pub false_alarm: f64,
}

/// The sparse reconstruction of a look.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseLook {
    /// The engine that ran.
    pub engine: Engine,
    /// Bound on the relative distance of its objective from the optimum.
    pub gap: f64,
    /// Snapshots above the noise, of all Dopplers.
    pub snapshots: usize,
    /// Dopplers modulo the inverse of a code period, Hz, and directions of the groups of rows in the estimate, strongest
    /// first.
    pub directions: Vec<(f64, Point)>,
}

/// A possible source, at one Doppler modulo the inverse of a code period.
#[derive(Clone, Debug)]
pub(in crate::array) struct Candidate {
    /// Index of the Doppler.
    pub(in crate::array) index: usize,
    /// Response of the elements, of norm 1.
    pub(in crate::array) beam: Vec<Complex64>,
    /// Power in the beam over the noise, less that of the noise.
    pub(in crate::array) excess: f64,
    /// Its direction, where the array's geometry is known.
    pub(in crate::array) source: Option<Source>,
}

/// How candidates are told from noise.
enum Rule {
    /// JANE on each covariance, from the directions of the sparse estimate there.
    Jane(Box<Jane>, Vec<Vec<Point>>),
    /// The rows of the sparse estimate of the eigenvalues above this.
    Rows(Box<Manifold>, SparseOptions, f64),
    /// Eigenvalues above this, of so many dimensions.
    Eigenvalues(f64, usize),
}

/// A look at a stretch of samples.
pub(in crate::array) struct Look {
    pub(in crate::array) data: CodePeriods,
    pub(in crate::array) doppler: DopplerCovariances,
    rule: Rule,
    pub(in crate::array) sparse: Option<SparseLook>,
}

impl Look {
    pub(in crate::array) fn new(
        mut data: CodePeriods,
        block: usize,
        manifold: Option<&Manifold>,
        interference: Option<&Interference>,
        options: &LookOptions,
    ) -> Result<Self, LookError> {
        let powers = data.powers();
        let silent = powers.iter().position(|p| *p == 0.0);
        if let Some(channel) = silent.filter(|_| powers.iter().any(|p| *p > 0.0)) {
            return Err(LookError::Silent(channel));
        }
        equalise(&mut data, interference);
        let nulled = interference.map_or(0, Interference::count);
        if !is_independent(&data, nulled).ok_or(LookError::NoNoise)? {
            return Err(LookError::Dependent);
        }
        let doppler = DopplerCovariances::new(&data, block, nulled).ok_or(LookError::NoNoise)?;
        let each = (options.false_candidates / doppler.covariances.len() as f64).min(0.5);
        let edge = edge(data.elements - nulled, doppler.samples, each);
        let mut sparse = None;
        let rule = match manifold {
            Some(manifold) if data.elements > 1 => {
                let manifold =
                    interference.map_or(manifold.clone(), |i| manifold.clone().beside(&i.subspace));
                let snapshots = snapshots(&doppler, edge);
                let mut groups = vec![Vec::new(); doppler.covariances.len()];
                if snapshots.0.ncols() > 0 {
                    let estimate;
                    (estimate, groups) = directions(&snapshots, &manifold, &options.sparse)?;
                    sparse = Some(SparseLook {
                        engine: options.sparse.engine,
                        gap: estimate.gap,
                        snapshots: snapshots.0.ncols(),
                        directions: merged(&groups, &manifold, &doppler),
                    });
                }
                let start = groups.iter().map(|g| g.iter().map(|g| g.point).collect()).collect();
                let jane = JaneOptions { false_alarm: each, ..options.jane };
                match options.decision {
                    LookDecision::Jane => Rule::Jane(Box::new(Jane::new(&manifold, jane)?), start),
                    LookDecision::Rows => Rule::Rows(Box::new(manifold), options.sparse, edge),
                }
            }
            _ => Rule::Eigenvalues(edge, data.elements - nulled),
        };
        Ok(Self { data, doppler, rule, sparse })
    }

    /// Candidates in the covariances as they are now, strongest first; of one source only one.
    pub(in crate::array) fn candidates(&self) -> Result<Vec<Candidate>, LookError> {
        let count = self.doppler.covariances.len();
        let of_all: Vec<Vec<Candidate>> = match &self.rule {
            Rule::Rows(manifold, options, edge) => self.by_rows(manifold, options, *edge)?,
            _ => {
                (0..count).into_par_iter().map(|index| self.at(index)).collect::<Result<_, _>>()?
            }
        };
        let all = of_all.into_iter().flatten().map(|c| (c, ())).collect();
        Ok(distinct(all, &self.doppler).into_iter().map(|c| c.0).collect())
    }

    /// Whether a candidate is one with this probability that noise shows any.
    pub(in crate::array) fn surely(&self, false_alarm: f64) -> impl Fn(&Candidate) -> bool + use<> {
        let each = false_alarm / self.doppler.covariances.len() as f64;
        let samples = self.doppler.samples;
        let threshold = match &self.rule {
            Rule::Jane(jane, _) => jane.threshold(each, samples),
            // A beam's power is at most the largest eigenvalue.
            Rule::Rows(manifold, ..) => samples * edge(manifold.elements(), samples, each),
            Rule::Eigenvalues(_, dimensions) => edge(*dimensions, samples, each),
        };
        move |c| match &c.source {
            Some(source) => source.statistic > threshold,
            None => c.excess + 1.0 > threshold,
        }
    }

    /// Candidates by the rows of the sparse estimate: directions are points of its grid.
    fn by_rows(
        &self,
        manifold: &Manifold,
        options: &SparseOptions,
        edge: f64,
    ) -> Result<Vec<Vec<Candidate>>, LookError> {
        let snapshots = snapshots(&self.doppler, edge);
        if snapshots.0.ncols() == 0 {
            return Ok(Vec::new());
        }
        let (_, groups) = directions(&snapshots, manifold, options)?;
        // Uniform within a step.
        let sigma = grid_step(manifold) / 12f64.sqrt();
        let sigma = if manifold.dimensions() < 2 { [sigma, 0.0] } else { [sigma; 2] };
        let covariance = [[sigma[0].powi(2), 0.0], [0.0, sigma[1].powi(2)]];
        let candidate = |index: usize, point: Point| {
            let beam = unit(manifold.response(point));
            let excess = self.doppler.power(index, &beam) - 1.0;
            let source = Source {
                point,
                sigma,
                bearing: manifold.bearing(point),
                bearing_sigma: bearing_sigma(manifold, point, covariance),
                power: excess / manifold.elements() as f64,
                statistic: self.doppler.samples * (1.0 + excess),
            };
            Candidate { index, beam, excess, source: Some(source) }
        };
        let at = |(index, groups): (usize, Vec<Group>)| {
            groups.iter().map(|group| candidate(index, group.point)).collect()
        };
        Ok(groups.into_iter().enumerate().map(at).collect())
    }

    /// Candidates at one Doppler.
    fn at(&self, index: usize) -> Result<Vec<Candidate>, LookError> {
        let s = &self.doppler.covariances[index];
        match &self.rule {
            Rule::Jane(jane, start) => {
                let unit = |point: &Point| unit(jane.manifold().response(*point));
                let decision =
                    jane.decide_covariance(s, self.doppler.samples, Some(1.0), &start[index])?;
                let candidate = |source: Source| {
                    let beam = unit(&source.point);
                    let excess = self.doppler.power(index, &beam) - 1.0;
                    Candidate { index, beam, excess, source: Some(source) }
                };
                Ok(decision.sources.into_iter().map(candidate).collect())
            }
            Rule::Rows(..) => Ok(Vec::new()),
            Rule::Eigenvalues(edge, _) => {
                let Some((values, vectors)) = hermitian_eigen(s) else { return Ok(Vec::new()) };
                let above = values.iter().enumerate().take_while(|(_, l)| **l > *edge);
                let candidate = |(k, l): (usize, &f64)| {
                    let beam = vectors.col(k).iter().copied().collect();
                    Candidate { index, beam, excess: l - 1.0, source: None }
                };
                Ok(above.map(candidate).collect())
            }
        }
    }
}

impl Candidate {
    /// Whether a response of the elements is of its direction.
    pub(in crate::array) fn is_along(&self, response: &[Complex64]) -> bool {
        coherence(&self.beam, &unit(response.to_vec())) > COHERENT
    }

    /// Whether two candidates are of one direction.
    pub(in crate::array) fn is_beside(&self, other: &Self) -> bool {
        coherence(&self.beam, &other.beam) > COHERENT
    }

    /// Whether a weaker candidate is only the skirt of this one: of the same direction, and as near or as weak as the
    /// spectrum of a block with a data bit edge in its middle allows.
    fn explains(&self, weak: &Self, doppler: &DopplerCovariances) -> bool {
        let apart = doppler.blocks_apart(self.index, weak.index);
        let skirt = 2.0 * (2.0 / (PI * apart)).powi(2);
        self.is_beside(weak) && (apart < NEIGHBOURS || weak.excess < skirt * self.excess)
    }
}

/// Candidates, each with something of its own, strongest first, without those that a stronger one explains.
fn distinct<T>(mut all: Vec<(Candidate, T)>, doppler: &DopplerCovariances) -> Vec<(Candidate, T)> {
    all.sort_by(|a, b| b.0.excess.total_cmp(&a.0.excess));
    let mut kept: Vec<(Candidate, T)> = Vec::new();
    for weak in all {
        if !kept.iter().any(|strong| strong.0.explains(&weak.0, doppler)) {
            kept.push(weak);
        }
    }
    kept
}

/// The groups of all Dopplers as directions, strongest first, of one source only one.
fn merged(
    groups: &[Vec<Group>],
    manifold: &Manifold,
    doppler: &DopplerCovariances,
) -> Vec<(f64, Point)> {
    let candidate = |(index, group): (usize, &Group)| {
        let beam = unit(manifold.response(group.point));
        let excess = doppler.power(index, &beam) - 1.0;
        (Candidate { index, beam, excess, source: None }, group.point)
    };
    let all = groups.iter().enumerate().flat_map(|(index, g)| g.iter().map(move |g| (index, g)));
    let kept = distinct(all.map(candidate).collect(), doppler);
    kept.into_iter().map(|(c, point)| (doppler.doppler_hz(c.index), point)).collect()
}

/// Whether the noise of the elements, but for `nulled` directions, is independent: no eigenvalue of the covariance of
/// some periods is far below the median one, as signals leave it. `None` without power.
fn is_independent(data: &CodePeriods, nulled: usize) -> Option<bool> {
    let of_period =
        |k: usize| covariance(&(0..data.elements).map(|m| data.row(m, k)).collect::<Vec<_>>());
    let zeros = CMat::zeros(data.elements, data.elements);
    let sum = (0..data.periods.min(TESTED_PERIODS)).fold(zeros, |sum, k| sum + of_period(k));
    let (values, _) = hermitian_eigen(&sum)?;
    let kept = &values[..data.elements - nulled];
    let (smallest, median) = (kept[kept.len() - 1], kept[kept.len() / 2]);
    (kept[0] > 0.0).then_some(smallest > DEPENDENT * median.max(1e-9 * kept[0]))
}

/// The eigenvalue, in units of the noise, that noise alone exceeds in one covariance with this probability.
fn edge(elements: usize, samples: f64, false_alarm: f64) -> f64 {
    if elements > 1 {
        return eigenvalue_threshold(elements, samples as usize, false_alarm);
    }
    let one = Manifold::new(AntennaArray::new(vec![Vector3::zeros()]));
    Scan::new(&one).threshold(false_alarm, samples) / samples
}

/// u sqrt(lambda - 1) of all eigenvalues above the edge, of all Dopplers side by side, and how many of each.
fn snapshots(doppler: &DopplerCovariances, edge: f64) -> (CMat, Vec<usize>) {
    let of = |s: &CMat| -> Vec<Vec<Complex64>> {
        let Some((values, vectors)) = hermitian_eigen(s) else { return Vec::new() };
        let above = values.iter().enumerate().take_while(|(_, l)| **l > edge);
        let column = |(k, l): (usize, &f64)| -> Vec<Complex64> {
            vectors.col(k).iter().map(|u| u * (l - 1.0).sqrt()).collect()
        };
        above.map(column).collect()
    };
    let columns: Vec<Vec<Vec<Complex64>>> = doppler.covariances.par_iter().map(of).collect();
    let counts = columns.iter().map(Vec::len).collect();
    let columns = columns.concat();
    let snapshots =
        CMat::from_fn(doppler.covariances[0].nrows(), columns.len(), |m, n| columns[n][m]);
    (snapshots, counts)
}

/// Directions at each Doppler: the sparse reconstruction of the snapshots of all Dopplers, and the row rule on the
/// columns of each.
fn directions(
    (columns, counts): &(CMat, Vec<usize>),
    manifold: &Manifold,
    options: &SparseOptions,
) -> Result<(SparseEstimate, Vec<Vec<Group>>), LookError> {
    let grid = manifold.grid((2.0 / grid_step(manifold)).round() as usize);
    let responses = dictionary(manifold, &grid);
    let estimate = reconstruct(&responses, columns, options)?;
    let noise = row_noise(&(columns - &responses * &estimate.x));
    let mut first = 0;
    let groups = counts.iter().map(|&count| {
        let own = estimate.x.subcols(first, count).to_owned();
        first += count;
        if count > 0 { row_rule(&own, &grid, noise) } else { Vec::new() }
    });
    let groups = groups.collect();
    Ok((estimate, groups))
}

/// Distance of neighbouring points of the dictionary.
fn grid_step(manifold: &Manifold) -> f64 {
    let across = POINTS_PER_BEAM * manifold.elements();
    let across = if manifold.dimensions() < 2 { across } else { across.min(MAX_POINTS) };
    2.0 / across as f64
}

/// A response of norm 1.
fn unit(mut response: Vec<Complex64>) -> Vec<Complex64> {
    let norm = response.iter().map(|z| z.norm_sqr()).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    response.iter_mut().for_each(|z| *z /= norm);
    response
}

/// Fraction of a beam's power along another, both of norm 1.
fn coherence(a: &[Complex64], b: &[Complex64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.conj() * b).sum::<Complex64>().norm_sqr()
}

/// Scales the samples to the same power at all elements, except for what was removed with the jammers: the tests go to
/// 1 / sqrt(N) of the noise, and the gains of the front end are known far less accurately.
fn equalise(data: &mut CodePeriods, interference: Option<&Interference>) {
    let kept = |m: usize| {
        1.0 - interference.map_or(0.0, |i| i.subspace.row(m).iter().map(|u| u.norm_sqr()).sum())
    };
    let powers: Vec<f64> =
        data.powers().into_iter().enumerate().map(|(m, p)| p / kept(m)).collect();
    let mean = powers.iter().sum::<f64>() / powers.len() as f64;
    for (m, power) in powers.into_iter().enumerate() {
        let gain = (mean / power).sqrt() as f32;
        let rows = &mut data.rows[m * data.periods..(m + 1) * data.periods];
        rows.iter_mut().flatten().for_each(|x| *x *= gain);
    }
}
