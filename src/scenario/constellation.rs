//! A synthetic constellation: Walker's pattern as broadcast ephemerides, for scenarios that need no
//! outside data.

use super::values;
use crate::gnss::constants::{GPS_PI, OMEGA_EARTH};
use crate::gnss::coordinates::azimuth_elevation;
use crate::gnss::{Constellation, Ephemeris, GpsTime, Sv};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Walker's delta pattern i: T/P/F (Walker 1984): T satellites in P evenly spaced planes, F steps of
/// 360/T degrees of phase from plane to plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Walker {
    /// `T/P/F`, such as `24/6/1`. Up to 32 satellites become G01, G02, ... plane by plane; of more, as in low
    /// orbits, the 32 of the highest elevation at the receiver at the start, the highest first. (Of another system as
    /// many as it has numbers.)
    pub pattern: Pattern,
    /// The system whose satellites they are, by its letter in RINEX: G, E or J.
    #[serde(
        default = "gps",
        deserialize_with = "values::one_system",
        serialize_with = "values::print_system"
    )]
    pub system: Constellation,
    /// Inclination, degrees.
    #[serde(default = "gps_inclination", deserialize_with = "values::elevation")]
    pub inclination_deg: f64,
    /// Semi-major axis, km.
    #[serde(default = "gps_axis", deserialize_with = "values::positive")]
    pub semi_major_axis_km: f64,
    /// Eccentricity.
    #[serde(default, deserialize_with = "values::zero_to_one")]
    pub eccentricity: f64,
    /// Longitude of the first plane's ascending node at the epoch, degrees.
    #[serde(default, deserialize_with = "values::finite")]
    pub node_longitude_deg: f64,
    /// Argument of latitude of the first satellite at the epoch, degrees.
    #[serde(default, deserialize_with = "values::finite")]
    pub argument_deg: f64,
}

fn gps_inclination() -> f64 {
    55.0
}

fn gps() -> Constellation {
    Constellation::Gps
}

fn gps_axis() -> f64 {
    26_560.0
}

/// The numbers of a Walker pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Pattern {
    /// T: satellites.
    pub satellites: u16,
    /// P: planes, a divisor of T.
    pub planes: u16,
    /// F: phasing, 0 to P - 1.
    pub phasing: u16,
}

impl TryFrom<String> for Pattern {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        let numbers: Vec<u16> = text.split('/').map_while(|n| n.parse().ok()).collect();
        match numbers[..] {
            [satellites, planes, phasing]
                if satellites > 0
                    && planes > 0
                    && satellites % planes == 0
                    && phasing < planes
                    && text.matches('/').count() == 2 =>
            {
                Ok(Self { satellites, planes, phasing })
            }
            _ => Err(format!(
                "'{text}' is no Walker pattern T/P/F: T satellites, P a divisor of T, F < P, such as 24/6/1"
            )),
        }
    }
}

impl From<Pattern> for String {
    fn from(p: Pattern) -> Self {
        format!("{}/{}/{}", p.satellites, p.planes, p.phasing)
    }
}

impl Walker {
    /// The ephemerides of the satellites that get a PRN, with their epoch at the two-hour mark nearest
    /// `start` and zero clock terms except relativity; `receiver_m` (ECEF) is where heights are compared.
    pub fn ephemerides(&self, start: GpsTime, receiver_m: &Vector3<f64>) -> Vec<Ephemeris> {
        let mut all = self.all(start);
        let numbers = Sv::all(self.system).count();
        if all.len() > numbers {
            let elevation =
                |e: &Ephemeris| azimuth_elevation(receiver_m, &e.state(start).position_m).1;
            all.sort_by(|a, b| elevation(b).total_cmp(&elevation(a)));
        }
        let numbered = all.into_iter().zip(Sv::all(self.system));
        numbered
            .map(|(e, sv)| Ephemeris { sv, iodc: u16::from(sv.prn()), iode: sv.prn(), ..e })
            .collect()
    }

    /// All satellites, as if they were one.
    fn all(&self, start: GpsTime) -> Vec<Ephemeris> {
        let epoch = GpsTime::from_week_tow(start.week(), (start.tow() / 7200.0).round() * 7200.0);
        let Pattern { satellites, planes, phasing } = self.pattern;
        let per_plane = satellites / planes;
        let turn = 2.0 * GPS_PI;
        let node_of_week = self.node_longitude_deg.to_radians() + OMEGA_EARTH * epoch.tow();
        let sv = Sv::from_prn(1).expect("number 1 is a GPS satellite");
        (0..satellites)
            .map(|k| {
                let (plane, slot) = (f64::from(k / per_plane), f64::from(k % per_plane));
                let phase = slot / f64::from(per_plane)
                    + (plane * f64::from(phasing) / f64::from(satellites)).fract();
                let wrap = |angle: f64| (angle + GPS_PI).rem_euclid(turn) - GPS_PI;
                Ephemeris {
                    sv,
                    iodc: 1,
                    iode: 1,
                    ura_index: 0,
                    health: 0,
                    l2_codes: 1,
                    l2_p_data: false,
                    fit_interval_flag: false,
                    toc: epoch,
                    toe: epoch,
                    transmission_time: None,
                    af0: 0.0,
                    af1: 0.0,
                    af2: 0.0,
                    tgd: 0.0,
                    sqrt_a: (self.semi_major_axis_km * 1e3).sqrt(),
                    e: self.eccentricity,
                    m0: wrap(turn * phase + self.argument_deg.to_radians()),
                    delta_n: 0.0,
                    omega0: wrap(turn * plane / f64::from(planes) + node_of_week),
                    omega_dot: 0.0,
                    i0: self.inclination_deg.to_radians(),
                    idot: 0.0,
                    omega: 0.0,
                    cuc: 0.0,
                    cus: 0.0,
                    crc: 0.0,
                    crs: 0.0,
                    cic: 0.0,
                    cis: 0.0,
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walker_pattern_is_evenly_spaced_and_inclined_as_asked() {
        let walker = Walker {
            pattern: Pattern::try_from("24/6/1".to_owned()).unwrap(),
            system: Constellation::Gps,
            inclination_deg: 55.0,
            semi_major_axis_km: 26_560.0,
            eccentricity: 0.0,
            node_longitude_deg: 20.0,
            argument_deg: 0.0,
        };
        let start = GpsTime::from_week_tow(2190, 525_000.0);
        let here = nalgebra::Vector3::new(6.37e6, 0.0, 0.0);
        let all = walker.ephemerides(start, &here);
        assert_eq!(all.len(), 24);
        let at = |k: usize| all[k].state(all[k].toe).position_m / 26.56e6;
        // The first satellite is at its node, at 20 degrees of longitude.
        let node = nalgebra::Vector3::new(20f64.to_radians().cos(), 20f64.to_radians().sin(), 0.0);
        assert!((at(0) - node).norm() < 1e-9);
        // Neighbours in a plane are 90 degrees apart; the highest reach sin 55 degrees.
        for k in 0..24 {
            assert!((at(k).norm() - 1.0).abs() < 1e-9);
            assert!(at(k).dot(&at(k / 4 * 4 + (k + 1) % 4)).abs() < 1e-9);
        }
        assert!((at(1).z - 55f64.to_radians().sin()).abs() < 1e-9);
        // Plane 1 is turned by 60 degrees and its first satellite 15 degrees past the node.
        assert!((at(4).z - 15f64.to_radians().sin() * 55f64.to_radians().sin()).abs() < 1e-9);
        // Of a shell of 1584 the 32 highest are numbered, downwards.
        let shell = Walker {
            pattern: Pattern::try_from("1584/72/39".to_owned()).unwrap(),
            semi_major_axis_km: 6921.0,
            ..walker
        };
        let highest = shell.ephemerides(start, &here);
        let elevation = |e: &Ephemeris| azimuth_elevation(&here, &e.state(start).position_m).1;
        assert_eq!(highest.len(), 32);
        assert!(highest.is_sorted_by(|a, b| elevation(a) >= elevation(b) && a.sv < b.sv));
        let above = |e: &&Ephemeris| elevation(e) > elevation(&highest[31]);
        assert_eq!(shell.all(start).iter().filter(above).count(), 31);
        for text in ["24/5/1", "33/2/0", "24/6/6", "24/6", "a/b/c", "24/6/1/0", "0/1/0", "24/0/0"] {
            assert!(Pattern::try_from(text.to_owned()).is_err(), "{text}");
        }
    }
}
