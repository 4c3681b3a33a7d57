//! Measurements of an antenna array on each satellite: its direction, and whether it agrees with the orbit.

pub mod authenticity;
pub mod beams;
pub mod interference;
pub mod look;

pub use beams::{Beam, BeamKind};
pub use look::{Jammer, LookError, LookOptions, SkyPicture, look};

use crate::array::decision::Source;
use crate::array::geometry::{Arrival, Bearing, Manifold, Signature, arrival};
use crate::gnss::{Sv, Transmission};
use authenticity::{OneDirection, agrees, one_direction};
use nalgebra::{Unit, Vector3};

/// Errors of a direction by those of attitude and elements, in direction cosines (0.1 is 6 degrees at the
/// zenith or at broadside).
const TOLERANCE: f64 = 0.1;

/// Array measurements of a satellite.
#[derive(Clone, Debug, PartialEq)]
pub struct SatelliteArrival {
    /// The satellite.
    pub sv: Sv,
    /// Response of each element.
    pub signature: Signature,
    /// Power at one element over the noise of a sample.
    pub sample_snr: f64,
    /// Its direction, where the array's geometry is known.
    pub arrival: Option<Arrival>,
    /// Its predicted direction, where its orbit and the receiver's position are known.
    pub predicted: Option<Prediction>,
}

/// A direction predicted from orbit and position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// As the array would measure it.
    pub bearing: Bearing,
    /// Distance of the measured direction from it, in direction cosines.
    pub apart: f64,
    /// Whether the two agree within five standard deviations and errors of attitude and elements.
    pub agrees: bool,
}

/// Number of signals by their code periods, without codes, and the satellites whose codes were found in them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlindCount {
    /// Number of code periods decomposed.
    pub periods: usize,
    /// Number of singular values that noise does not explain: signals, whatever their code.
    pub signals: usize,
    /// Satellites found in them, strongest first.
    pub satellites: Vec<Sv>,
    /// Number of Fourier transforms used.
    pub transforms: usize,
    /// Number of inverse transforms of the full search of the same samples.
    pub full_search_transforms: usize,
}

/// The satellites received by an array.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ArraySky {
    /// Sources and their directions without codes; `None` without geometry.
    pub picture: Option<SkyPicture>,
    /// Signals by their code periods, and satellites found in them.
    pub blind: Option<BlindCount>,
    /// Signatures of satellites by despreading, strongest first.
    pub satellites: Vec<SatelliteArrival>,
    /// Whether they all come from one direction; `None` with too few for a result.
    pub one_direction: Option<OneDirection>,
}

/// The satellites received by an array at one instant of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyEpoch {
    /// Index of the sample in the middle of what was despread.
    pub sample: u64,
    /// The satellites that were clearly measured then.
    pub sky: ArraySky,
}

impl ArraySky {
    /// Adds the signatures of satellites; `manifold` where the array's geometry is known.
    pub fn add(
        &mut self,
        signatures: Vec<(Transmission, Signature)>,
        rate_hz: f64,
        manifold: Option<&Manifold>,
    ) {
        let references: Vec<&Signature> = signatures.iter().map(|s| &s.1).collect();
        self.one_direction = one_direction(&references);
        let seen = |(transmission, signature): (Transmission, Signature)| SatelliteArrival {
            sv: transmission.sv,
            sample_snr: signature.snr / (rate_hz * transmission.signal.period_s()),
            arrival: manifold.and_then(|m| arrival(m, &signature)),
            signature,
            predicted: None,
        };
        self.satellites = signatures.into_iter().map(seen).collect();
    }

    /// Compares the directions of satellites with the predicted ones (unit vectors towards them, in the frame
    /// of the manifold's elements).
    pub fn predict(&mut self, manifold: &Manifold, expected: &[(Sv, Unit<Vector3<f64>>)]) {
        for satellite in &mut self.satellites {
            let known = expected.iter().find(|e| e.0 == satellite.sv);
            let (Some((_, towards)), Some(arrival)) = (known, &satellite.arrival) else { continue };
            let (apart, agrees) = agrees(manifold, arrival, towards, TOLERANCE);
            let bearing = manifold.bearing(manifold.point(towards));
            satellite.predicted = Some(Prediction { bearing, apart, agrees });
        }
    }

    /// Sources found without codes that no satellite explains: farther from each than half a beamwidth and
    /// five standard deviations.
    pub fn unexplained(&self) -> impl Iterator<Item = &Source> {
        let elements = self.picture.as_ref().map_or(1, |p| p.elements) as f64;
        let found = self.picture.iter().flat_map(|p| &p.sources);
        found.filter(move |source| {
            let arrivals = self.satellites.iter().filter_map(|s| s.arrival.as_ref());
            let apart =
                |a: &Arrival| (a.point[0] - source.point[0]).hypot(a.point[1] - source.point[1]);
            let reach = 1.0 / elements + 5.0 * source.sigma[0].hypot(source.sigma[1]);
            arrivals.map(apart).all(|d| d > reach)
        })
    }

    /// Number of sources found without despreading: by direction or by their code periods, whichever is
    /// larger.
    pub fn sources(&self) -> usize {
        let by_direction = self.picture.as_ref().map_or(0, |p| p.sources.len());
        by_direction.max(self.blind.as_ref().map_or(0, |b| b.signals))
    }

    /// Warnings for the user.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(OneDirection { apart, is_one: true, .. }) = self.one_direction {
            warnings.push(format!(
                "all {} satellites come from one direction ({:.1} % of their power is orthogonal to it): suspected spoofing, or channels that share one antenna",
                self.satellites.len(),
                100.0 * apart
            ));
        }
        let compared = || self.satellites.iter().filter_map(|s| Some((s.sv, s.predicted?)));
        let wrong: Vec<String> =
            compared().filter(|(_, p)| !p.agrees).map(|(sv, _)| sv.to_string()).collect();
        let right = compared().count() - wrong.len();
        let is_one = self.one_direction.is_some_and(|o| o.is_one);
        if !wrong.is_empty() {
            let cause = if right == 0 && !is_one {
                "is the array's geometry or attitude right?"
            } else {
                "suspected spoofing or reflection"
            };
            warnings.push(format!(
                "{}: {cause}",
                match &wrong[..] {
                    [one] => format!("{one} comes from a direction that disagrees with its orbit"),
                    many => format!(
                        "{} come from directions that disagree with their orbits",
                        many.join(" ")
                    ),
                }
            ));
        }
        warnings
    }
}
