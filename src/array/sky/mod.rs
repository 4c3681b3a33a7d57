//! Measurements of an antenna array on each satellite: its direction, and whether it agrees with the orbit.

pub mod authenticity;
pub mod beams;
mod identify;
pub mod interference;
pub mod look;
mod picture;

pub use beams::{Beam, BeamKind};
pub use look::{LookCodes, LookDecision, LookError, LookOptions, SparseLook};
pub use picture::{Jammer, Looked, SkyPicture, SkySource, jammers, look};

use crate::array::geometry::{
    ArrayAttitude, Arrival, Bearing, Manifold, Signature, arrival, element_gains,
};
use crate::gnss::antenna::ArrayDescription;
use crate::gnss::{Sv, Transmission};
use authenticity::{OneDirection, agrees, one_direction};
use nalgebra::{Unit, Vector3};
use num_complex::Complex64;

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
    /// Carrier-to-noise density at one element, dB-Hz.
    pub cn0_dbhz: f64,
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

/// The satellites received by an array.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ArraySky {
    /// Sources without codes; their directions where the geometry is known.
    pub picture: Option<SkyPicture>,
    /// Signatures of satellites by despreading, strongest first.
    pub satellites: Vec<SatelliteArrival>,
    /// Whether they all come from one direction; `None` with too few for a result.
    pub one_direction: Option<OneDirection>,
    /// Attitude by the satellites whose directions are known, whatever the one that was given.
    pub attitude: Option<ArrayAttitude>,
    /// Gains of the elements against the array as it was given, where all directions agree with it.
    pub gains: Option<Vec<Complex64>>,
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
    pub fn add(&mut self, signatures: Vec<(Transmission, Signature)>, manifold: Option<&Manifold>) {
        let references: Vec<&Signature> = signatures.iter().map(|s| &s.1).collect();
        self.one_direction = one_direction(&references);
        let seen = |(transmission, signature): (Transmission, Signature)| SatelliteArrival {
            sv: transmission.sv,
            cn0_dbhz: 10.0 * (signature.snr / transmission.timing().interval_s).log10(),
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

    /// Attitude and gains from the directions of satellites (unit vectors: east, north, up), after [`Self::predict`] with
    /// the array as it was given.
    pub fn orient(&mut self, array: &ArrayDescription, expected: &[(Sv, Unit<Vector3<f64>>)]) {
        let known = |s: &SatelliteArrival| {
            let towards = expected.iter().find(|e| e.0 == s.sv)?.1;
            Some((s.signature.clone(), towards))
        };
        let seen: Vec<(Signature, Unit<Vector3<f64>>)> =
            self.satellites.iter().filter_map(known).collect();
        let seen: Vec<_> = seen.iter().map(|(signature, u)| (signature, *u)).collect();
        self.attitude = ArrayAttitude::estimate(&array.array, &seen);
        let agrees = self.satellites.iter().filter_map(|s| s.predicted).all(|p| p.agrees);
        let manifold = Manifold::new(array.in_enu());
        self.gains = agrees.then(|| element_gains(&manifold, &seen)).flatten();
    }

    /// Sources in which no code was found.
    pub fn unexplained(&self) -> impl Iterator<Item = &SkySource> {
        self.picture.iter().flat_map(|p| &p.sources).filter(|s| s.sv.is_none())
    }

    /// Number of sources found before despreading.
    pub fn sources(&self) -> usize {
        self.picture.as_ref().map_or(0, |p| p.sources.len())
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
