//! The fixes as GeoJSON (RFC 7946): longitude, latitude, ellipsoidal height.

use super::Run;
use super::track::{lines, map_point};
use crate::gnss::coordinates::Geodetic;
use geojson::{Feature, FeatureCollection, GeoJson, Geometry};
use serde_json::json;

/// The track as a line (of two fixes or more; cut at 180 degrees of longitude), then each fix as a point with its time, standard deviation,
/// integrity and solver. Heights are above the WGS 84 ellipsoid, as RFC 7946 requires.
pub fn geojson(run: &Run) -> String {
    let mut features = Vec::new();
    if run.fixes.len() > 1 {
        let mut parts = lines(run.fixes);
        let line = match parts.len() {
            1 => Geometry::new_line_string(parts.remove(0)),
            _ => Geometry::new_multi_line_string(parts),
        };
        features.push(feature(
            line,
            json!({ "name": run.capture, "height": "above WGS 84 ellipsoid" }),
        ));
    }
    for fix in run.fixes {
        let sigma: [f64; 3] = std::array::from_fn(|k| fix.covariance[(k, k)].max(0.0).sqrt());
        let properties = json!({
            "time": fix.time.utc_iso(),
            "sigma_enu_m": sigma,
            "integrity": fix.integrity,
            "protection": fix.protection,
            "satellites": fix.residuals.len(),
            "pdop": fix.pdop,
            "solver": fix.start.solver,
        });
        let point = map_point(&Geodetic::from_ecef(&fix.position_m));
        features.push(feature(Geometry::new_point(point), properties));
    }
    let generator = concat!("sdr-rx ", env!("CARGO_PKG_VERSION"));
    let foreign = serde_json::Map::from_iter([("generator".to_owned(), generator.into())]);
    let collection = FeatureCollection { bbox: None, features, foreign_members: Some(foreign) };
    GeoJson::FeatureCollection(collection).to_string() + "\n"
}

fn feature(geometry: Geometry, properties: serde_json::Value) -> Feature {
    let properties = properties.as_object().cloned();
    Feature { bbox: None, geometry: Some(geometry), id: None, properties, foreign_members: None }
}
