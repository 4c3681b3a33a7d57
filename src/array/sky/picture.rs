//! The picture that a look gives: number and directions of the sources, jammers, and the satellites found in them.

use super::identify::Identified;
use super::interference::Interference;
use super::look::{Candidate, Look, LookCodes, LookDecision, LookError, LookOptions, SparseLook};
use crate::array::code_periods::CodeFound;
use crate::array::code_periods::periods::CodePeriods;
use crate::array::decision::Source;
use crate::array::geometry::{Bearing, Manifold};
use crate::gnss::Sv;
use num_complex::Complex64;

/// A source is periodic when more than this part of the power of its direction lies within so many Hz of its Doppler.
const PERIODIC_FRACTION: f64 = 0.6;
const PERIODIC_HZ: f64 = 50.0;
/// What is left this near to a satellite that was removed, in its direction, is its residue.
const RESIDUE_HZ: f64 = 130.0;

/// Interference from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jammer {
    /// Its direction, where it could be determined.
    pub bearing: Option<Bearing>,
    /// Power over the noise of one element's samples, all elements together, dB.
    pub power_db: f64,
}

/// A source.
#[derive(Clone, Debug, PartialEq)]
pub struct SkySource {
    /// The satellite whose code was found in it.
    pub sv: Option<Sv>,
    /// Whether it was asked for.
    pub is_asked: bool,
    /// Its Doppler, Hz, modulo the inverse of a code period.
    pub doppler_hz: f64,
    /// Whether most of its power is at this Doppler, as that of a signal of this code period or of a carrier; else it is
    /// another signal or noise.
    pub is_periodic: bool,
    /// Carrier-to-noise density at one element, dB-Hz: by its code, or without one by its power, which edges of data
    /// bits lower.
    pub cn0_dbhz: f64,
    /// Its direction, where the array's geometry is known and it is resolved from the others.
    pub direction: Option<Source>,
}

/// Sources found by an array without codes, and the codes found in them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkyPicture {
    /// Number of elements.
    pub elements: usize,
    /// Number of code periods of each element used.
    pub periods: usize,
    /// Jammers that were removed first.
    pub jammers: Vec<Jammer>,
    /// The sparse reconstruction, where the array's geometry is known and a snapshot was above the noise.
    pub sparse: Option<SparseLook>,
    /// What decided on sources, where the geometry is known.
    pub decision: LookDecision,
    /// Sources, strongest first: those with a code, and those that remain when these are removed.
    pub sources: Vec<SkySource>,
    /// Fourier transforms by which the codes were found, and those of a full search of the same samples.
    pub transforms: (usize, usize),
}

/// The result of [`look`].
#[derive(Clone, Debug)]
pub struct Looked {
    /// The sources.
    pub picture: SkyPicture,
    /// The satellites, strongest first.
    pub found: Vec<CodeFound>,
    /// The code periods, without the satellites found.
    pub rest: CodePeriods,
}

/// Searches all blocks of `block` code periods in the samples of all elements (baseband, of one length, with equal noise
/// floors and no remaining jammer; after the map for weak signals where impulses were suppressed); `manifold` where the
/// array's geometry is known.
///
/// # Errors
/// See [`LookError`].
pub fn look(
    data: CodePeriods,
    block: usize,
    manifold: Option<&Manifold>,
    interference: Option<&Interference>,
    codes: &LookCodes<'_>,
    options: &LookOptions,
) -> Result<Looked, LookError> {
    let mut look = Look::new(data, block, manifold, interference, options)?;
    let mut identified = look.identify(codes)?;
    let is_sure = look.surely(options.jane.false_alarm);
    let asked = identified.found.len();
    if !codes.others.is_empty() && identified.rest.iter().any(&is_sure) {
        let others = look.identify(&LookCodes { satellites: codes.others, ..*codes })?;
        identified.found.extend(others.found);
        identified.transforms += others.transforms;
        identified.rest = others.rest;
    }
    let mut sources: Vec<SkySource> = identified
        .found
        .iter()
        .enumerate()
        .map(|(k, (code, candidate))| {
            // Where several sources are at one Doppler, the direction may be that of none of them.
            let signature = code.signature.as_ref();
            let agrees = signature.is_some_and(|s| candidate.is_along(&s.response));
            SkySource {
                sv: Some(code.acquisition.sv()),
                is_asked: k < asked,
                is_periodic: true,
                cn0_dbhz: code.acquisition.cn0_dbhz,
                direction: candidate.source.filter(|_| agrees),
                ..look.source(candidate)
            }
        })
        .collect();
    sources.extend(look.unknown(&identified, options.jane.false_alarm));
    sources.sort_by(|a, b| b.cn0_dbhz.total_cmp(&a.cn0_dbhz));
    let picture = SkyPicture {
        elements: look.data.elements,
        periods: look.doppler.blocks * block,
        jammers: interference.map_or(Vec::new(), |i| jammers(i, manifold)),
        sparse: look.sparse.clone(),
        decision: options.decision,
        sources,
        transforms: (identified.transforms, identified.full_search),
    };
    let found = identified.found.into_iter().take(asked).map(|f| f.0).collect();
    Ok(Looked { picture, found, rest: look.data })
}

impl Look {
    /// A candidate as a source.
    fn source(&self, candidate: &Candidate) -> SkySource {
        let gain = (self.data.elements * self.doppler.block) as f64;
        let bin_rate_hz = self.data.bins as f64 / self.data.period_s;
        SkySource {
            sv: None,
            is_asked: false,
            doppler_hz: self.doppler.doppler_hz(candidate.index),
            is_periodic: self.is_periodic(candidate),
            cn0_dbhz: 10.0 * (candidate.excess.max(1e-9) / gain * bin_rate_hz).log10(),
            direction: candidate.source,
        }
    }

    /// Whether most of the power of a candidate's direction is at its Doppler.
    fn is_periodic(&self, candidate: &Candidate) -> bool {
        let count = self.doppler.covariances.len();
        let excess = |index: usize| (self.doppler.power(index, &candidate.beam) - 1.0).max(0.0);
        let near = |index: usize| {
            let apart = index.abs_diff(candidate.index);
            apart.min(count - apart) as f64 * self.doppler.step_hz <= PERIODIC_HZ
        };
        let (mut inside, mut all) = (0.0, 0.0);
        for index in 0..count {
            // What noise alone shows is not counted.
            let power = excess(index);
            if power > 2.0 / self.doppler.samples.sqrt() {
                all += power;
                inside += if near(index) { power } else { 0.0 };
            }
        }
        inside > PERIODIC_FRACTION * all
    }

    /// Sources without a code in what is left, with this probability that noise alone shows one: not the residue of a
    /// satellite that was removed, and of one direction only one, unless they are periodic.
    fn unknown(&self, identified: &Identified, false_alarm: f64) -> Vec<SkySource> {
        let is_sure = self.surely(false_alarm);
        let residue_blocks = RESIDUE_HZ / (2.0 * self.doppler.step_hz);
        let is_residue = |c: &&Candidate| {
            identified.found.iter().any(|(_, strong)| {
                let apart = self.doppler.blocks_apart(strong.index, c.index);
                strong.is_beside(c) && apart < residue_blocks
            })
        };
        let mut kept: Vec<(Candidate, bool)> = Vec::new();
        for candidate in identified.rest.iter().filter(|c| is_sure(c)).filter(|c| !is_residue(c)) {
            let is_periodic = self.is_periodic(candidate);
            let is_known = |(k, periodic): &(Candidate, bool)| {
                k.is_beside(candidate) && !(*periodic && is_periodic)
            };
            if !kept.iter().any(is_known) {
                kept.push((candidate.clone(), is_periodic));
            }
        }
        kept.iter().map(|(candidate, _)| self.source(candidate)).collect()
    }
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
