//! Directions of the satellites by an array, at the start and during tracking, compared with those of the orbits.

use super::ReceiverOptions;
use super::event::Notice;
use super::find::Found;
use super::record::Record;
use crate::array::sky::interference::Interference;
use crate::array::{ArraySky, Manifold, SkyEpoch};
use crate::gnss::Sv;
use crate::gnss::antenna::direction;
use crate::position::{Fix, Residual};
use nalgebra::{Unit, Vector3};

/// Suspect directions are reported when they stay so for this many looks, a second apart.
const CONFIRMING_LOOKS: usize = 3;

/// The sources with the signatures of the satellites found.
pub(super) fn see(
    mut sky: ArraySky,
    found: &[Found],
    interference: Option<&Interference>,
    options: &ReceiverOptions,
) -> ArraySky {
    let manifold = manifold(interference, options);
    let signature =
        |f: &Found| Some((f.refined.acquisition.transmission, f.spatial.as_ref()?.0.clone()));
    sky.add(found.iter().filter_map(signature).collect(), manifold.as_ref());
    sky
}

/// The array's manifold, where its geometry is known, after the removal of jammers.
pub(super) fn manifold(
    interference: Option<&Interference>,
    options: &ReceiverOptions,
) -> Option<Manifold> {
    let whole = Manifold::new(options.array.as_ref()?.in_enu());
    Some(interference.map_or(whole.clone(), |i| whole.beside(&i.subspace)))
}

/// Compares the array's directions at the start with the first fix, and those of each later look with the fix
/// nearest in time; warns of suspect directions, with the time of their beginning.
pub(super) fn judge_sky(record: &mut Record, rate_hz: f64, options: &ReceiverOptions) {
    let Some(sky) = &mut record.sky else { return };
    if let Some(array) = &options.array {
        let manifold = Manifold::new(array.in_enu());
        if let Some(fix) = record.fixes.first() {
            let towards = towards(fix);
            sky.predict(&manifold, &towards);
            if !has_jammers(sky) {
                sky.orient(array, &towards);
            }
        }
        let with_jammers = has_jammers(sky);
        for SkyEpoch { sample, sky } in &mut record.sky_epochs {
            let apart = |fix: &&Fix| (fix.sample - *sample as f64).abs();
            let nearest = record.fixes.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
            if let Some(fix) = nearest.filter(|fix| apart(fix) < rate_hz) {
                let towards = towards(fix);
                sky.predict(&manifold, &towards);
                if !with_jammers {
                    sky.orient(array, &towards);
                }
            }
        }
    }
    let at_start = sky.warnings();
    if at_start.is_empty() {
        let onset = record
            .sky_epochs
            .windows(CONFIRMING_LOOKS)
            .find(|looks| looks.iter().all(|look| !look.sky.warnings().is_empty()));
        for epoch in onset.iter().flat_map(|looks| looks.first()) {
            let since_s = epoch.sample as f64 / rate_hz;
            let suspicions = epoch.sky.warnings().into_iter();
            let notice = |suspicion| Notice::Sky { from_s: Some(since_s), suspicion };
            record.notices.extend(suspicions.map(notice));
        }
    }
    let notice = |suspicion| Notice::Sky { from_s: None, suspicion };
    record.notices.extend(at_start.into_iter().map(notice));
}

/// Whether jammers were removed: signatures have nothing along them then, and no attitude follows.
fn has_jammers(sky: &ArraySky) -> bool {
    sky.picture.as_ref().is_some_and(|p| !p.jammers.is_empty())
}

/// Directions of a fix's satellites: east, north, up.
fn towards(fix: &Fix) -> Vec<(Sv, Unit<Vector3<f64>>)> {
    let one = |r: &Residual| (r.sv, direction(r.azimuth, r.elevation));
    fix.residuals.iter().map(one).collect()
}
