//! The fixes as KML 2.2 for a globe viewer.

use super::track::lines;
use super::{Run, Summary};
use crate::gnss::coordinates::Geodetic;
use nalgebra::Vector3;
use std::fmt::Write;

/// The place (median at rest, last fix of a moving receiver) and the track, cut at 180 degrees of longitude. Coordinates are longitude, latitude and height above the WGS 84 ellipsoid;
/// as KML's own heights are above the geoid, the track is clamped to the ground.
pub fn kml(run: &Run) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n<Document>\n",
    );
    let name = escape(run.capture);
    let _ = writeln!(text, "<name>{name}</name>");
    text += "<description>By sdr-rx. Heights are above the WGS 84 ellipsoid.</description>\n";
    if let Some(summary) = Summary::new(run.fixes, run.input.rate_hz()) {
        let _ = writeln!(
            text,
            "<Placemark><name>{} of {} {}</name><Point><coordinates>{}</coordinates></Point></Placemark>",
            if summary.moving { "last" } else { "median" },
            summary.fixes,
            if summary.proved { "fixes" } else { "unverified positions" },
            coordinates(&summary.place_m)
        );
    }
    if run.fixes.len() > 1 {
        text += "<Placemark><name>track</name><MultiGeometry>\n";
        for line in lines(run.fixes) {
            text += "<LineString><altitudeMode>clampToGround</altitudeMode><coordinates>\n";
            for [longitude, latitude, height] in line {
                let _ = writeln!(text, "{longitude:.9},{latitude:.9},{height:.4}");
            }
            text += "</coordinates></LineString>\n";
        }
        text += "</MultiGeometry></Placemark>\n";
    }
    text + "</Document>\n</kml>\n"
}

fn coordinates(position_m: &Vector3<f64>) -> String {
    let p = Geodetic::from_ecef(position_m);
    format!("{:.9},{:.9},{:.4}", p.longitude.to_degrees(), p.latitude.to_degrees(), p.height)
}

/// Text for XML and HTML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
