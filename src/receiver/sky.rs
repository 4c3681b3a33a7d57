//! What an antenna array says of each satellite: from where it comes, and whether it should.

use super::find::Found;
use super::{Outcome, ReceiverOptions};
use crate::array::authenticity::{OneDirection, agrees, one_direction};
use crate::array::{Arrival, Bearing, Manifold, Signature, arrival};
use crate::gnss::Sv;
use crate::positioning::Residual;
use nalgebra::{Unit, Vector3};

/// What errors of attitude and elements may turn a direction by, in direction cosines (0.1 is 6 degrees at
/// the zenith or at broadside).
const TOLERANCE: f64 = 0.1;

/// A satellite as the array sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct SatelliteArrival {
    /// The satellite.
    pub sv: Sv,
    /// Response of each element.
    pub signature: Signature,
    /// Where it comes from, where the array's geometry is known.
    pub arrival: Option<Arrival>,
    /// Where it should come from, where its orbit and the receiver's position are known.
    pub predicted: Option<Prediction>,
}

/// A direction that follows from orbit and position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// As the array would measure it.
    pub bearing: Bearing,
    /// How far the measured direction lies from it, in direction cosines.
    pub apart: f64,
    /// Whether the two agree within the measurement's deviation and errors of attitude and elements.
    pub agrees: bool,
}

/// The satellites in the array's sky.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ArraySky {
    /// Satellites found, strongest first.
    pub satellites: Vec<SatelliteArrival>,
    /// Whether they all come from one direction; `None` with too few to tell.
    pub one_direction: Option<OneDirection>,
}

impl ArraySky {
    /// From satellites found at the start; `None` with a single antenna.
    pub(super) fn new(found: &[Found], manifold: Option<&Manifold>) -> Option<Self> {
        let satellites: Vec<SatelliteArrival> = found
            .iter()
            .filter_map(|f| {
                let (signature, _) = f.spatial.as_ref()?;
                Some(SatelliteArrival {
                    sv: f.refined.acquisition.sv,
                    arrival: manifold.and_then(|m| arrival(m, signature)),
                    signature: signature.clone(),
                    predicted: None,
                })
            })
            .collect();
        let signatures: Vec<&Signature> = satellites.iter().map(|s| &s.signature).collect();
        let one_direction = one_direction(&signatures);
        (!satellites.is_empty()).then_some(Self { satellites, one_direction })
    }

    /// Compares directions with those of a fix.
    fn predict(&mut self, manifold: &Manifold, residuals: &[Residual]) {
        for satellite in &mut self.satellites {
            let known = residuals.iter().find(|r| r.sv == satellite.sv);
            let (Some(residual), Some(arrival)) = (known, &satellite.arrival) else { continue };
            let (sin, cos) = residual.elevation.sin_cos();
            let (east, north) = residual.azimuth.sin_cos();
            let towards = Unit::new_normalize(Vector3::new(cos * east, cos * north, sin));
            let (apart, agrees) = agrees(manifold, arrival, &towards, TOLERANCE);
            let bearing = manifold.bearing(manifold.point(&towards));
            satellite.predicted = Some(Prediction { bearing, apart, agrees });
        }
    }

    /// What of it a person should be warned of.
    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(OneDirection { apart, is_one: true, .. }) = self.one_direction {
            warnings.push(format!(
                "all {} satellites come from one direction ({:.1} % of their power lies apart from it): suspected spoofing, or channels that share one antenna",
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
                "{} not where the orbit says: {cause}",
                match &wrong[..] {
                    [one] => format!("{one} comes from a direction"),
                    many => format!("{} come from directions", many.join(" ")),
                }
            ));
        }
        warnings
    }
}

/// Compares the array's sky with the first fix, and warns.
pub(super) fn judge(outcome: &mut Outcome, options: &ReceiverOptions) {
    let Some(mut sky) = outcome.sky.take() else { return };
    if let (Some(array), Some(fix)) = (&options.array, outcome.fixes.first()) {
        sky.predict(&Manifold::new(array.in_enu()), &fix.residuals);
    }
    outcome.warnings.extend(sky.warnings());
    outcome.sky = Some(sky);
}
