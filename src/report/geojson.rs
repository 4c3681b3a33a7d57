//! The fixes as GeoJSON (RFC 7946): longitude, latitude, ellipsoidal height.

use super::Run;
use crate::gnss::coordinates::Geodetic;
use crate::position::Fix;
use geojson::{Feature, FeatureCollection, GeoJson, Geometry};
use serde_json::json;

/// The track as a line (of two fixes or more), then each fix as a point with its time, standard deviation,
/// integrity and solver. Heights are above the WGS 84 ellipsoid, as RFC 7946 requires.
pub fn geojson(run: &Run) -> String {
    let coordinates = |fix: &Fix| {
        let position = Geodetic::from_ecef(&fix.position_m);
        // 1e-9 deg is 0.1 mm.
        let degrees = |rad: f64| (rad.to_degrees() * 1e9).round() / 1e9;
        let height = (position.height * 1e4).round() / 1e4;
        vec![degrees(position.longitude), degrees(position.latitude), height]
    };
    let mut features = Vec::new();
    if run.fixes.len() > 1 {
        let line = Geometry::new_line_string(run.fixes.iter().map(coordinates));
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
            "solver": fix.solver,
        });
        features.push(feature(Geometry::new_point(coordinates(fix)), properties));
    }
    let collection = FeatureCollection { bbox: None, features, foreign_members: None };
    GeoJson::FeatureCollection(collection).to_string() + "\n"
}

fn feature(geometry: Geometry, properties: serde_json::Value) -> Feature {
    let properties = properties.as_object().cloned();
    Feature { bbox: None, geometry: Some(geometry), id: None, properties, foreign_members: None }
}
