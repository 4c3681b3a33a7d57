//! The way of the fixes on a map.

use crate::gnss::coordinates::Geodetic;
use crate::position::Fix;

/// A point of a map: longitude and latitude, degrees to 0.1 mm, and height above the WGS 84 ellipsoid, m.
pub(super) fn map_point(place: &Geodetic) -> [f64; 3] {
    let degrees = |rad: f64| (rad.to_degrees() * 1e9).round() / 1e9;
    let height = (place.height * 1e4).round() / 1e4;
    [degrees(place.longitude), degrees(place.latitude), height]
}

/// The fixes in order, as lines that are cut where they cross 180 degrees of longitude (RFC 7946 3.1.9).
pub(super) fn lines(fixes: &[Fix]) -> Vec<Vec<[f64; 3]>> {
    let mut lines: Vec<Vec<[f64; 3]>> = Vec::new();
    for fix in fixes {
        let next = map_point(&Geodetic::from_ecef(&fix.position_m));
        let Some(line) = lines.last_mut() else {
            lines.push(vec![next]);
            continue;
        };
        let last = line[line.len() - 1];
        if (next[0] - last[0]).abs() > 180.0 {
            // The edge on the side of the last point, and what is left of the way there.
            let edge = 180f64.copysign(last[0]);
            let (before, after) = ((edge - last[0]).abs(), (next[0] + edge).abs());
            let share = if before + after > 0.0 { before / (before + after) } else { 0.5 };
            let between = |k: usize| last[k] + share * (next[k] - last[k]);
            line.push([edge, between(1), between(2)]);
            lines.push(vec![[-edge, between(1), between(2)], next]);
        } else {
            line.push(next);
        }
    }
    lines
}
