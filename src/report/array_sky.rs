//! Sources and directions by an antenna array, as a table and as a JSON record.

use super::Run;
use crate::array::{ArraySky, Arrival, Bearing, Jammer, SatelliteArrival, Source};
use crate::gnss::Sv;
use serde::Serialize;
use std::fmt::Write;

/// Elements whose phases are printed; the JSON record has all.
const PRINTED_ELEMENTS: usize = 4;

/// A direction: the angle from the broadside of a linear array, or azimuth and elevation.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BearingRecord {
    #[serde(skip_serializing_if = "Option::is_none")]
    angle_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    azimuth_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    elevation_deg: Option<f64>,
}

impl From<Bearing> for BearingRecord {
    fn from(bearing: Bearing) -> Self {
        let degrees = |x: f64| Some(x.to_degrees());
        match bearing {
            Bearing::Cone(angle) => {
                Self { angle_deg: degrees(angle), azimuth_deg: None, elevation_deg: None }
            }
            Bearing::Direction { azimuth, elevation } => Self {
                angle_deg: None,
                azimuth_deg: degrees(azimuth),
                elevation_deg: degrees(elevation),
            },
        }
    }
}

/// Sources and directions as a record.
#[derive(Clone, Debug, Serialize)]
pub struct ArraySkyRecord {
    #[serde(skip_serializing_if = "Option::is_none")]
    elements: Option<usize>,
    /// All sources: satellites by their signatures, and others.
    sources: Vec<SourceRecord>,
    /// Number by LDA-l1,1 and JANE on the covariance, without codes; absent where there are too many signals.
    #[serde(skip_serializing_if = "Option::is_none")]
    blind_sources: Option<Vec<SourceRecord>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    jammers: Vec<JammerRecord>,
    /// Number by the singular values of the code periods, without codes.
    #[serde(skip_serializing_if = "Option::is_none")]
    signals: Option<usize>,
    /// Satellites found in the singular vectors.
    #[serde(skip_serializing_if = "Option::is_none")]
    blind_satellites: Option<Vec<Sv>>,
    satellites: Vec<SatelliteRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    all_from_one_direction: Option<bool>,
}

#[derive(Clone, Debug, Serialize)]
struct SourceRecord {
    /// How it was found: `despread` or `covariance`.
    #[serde(rename = "route")]
    method: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    sv: Option<Sv>,
    #[serde(flatten)]
    bearing: BearingRecord,
    /// Of the angle, or the larger of azimuth's (times the cosine of the elevation) and elevation's.
    sigma_deg: f64,
    /// Power at an element over its noise.
    power_db: f64,
}

#[derive(Clone, Debug, Serialize)]
struct JammerRecord {
    #[serde(flatten)]
    bearing: Option<BearingRecord>,
    power_db: f64,
}

#[derive(Clone, Debug, Serialize)]
struct SatelliteRecord {
    sv: Sv,
    #[serde(flatten)]
    bearing: Option<BearingRecord>,
    /// Maximum standard deviation of the direction, as a turn in the plane of the array's coordinates.
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma_deg: Option<f64>,
    /// Direction cosines along the array's axes.
    #[serde(skip_serializing_if = "Option::is_none")]
    cosines: Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    misfit: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<BearingRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    suspected: Option<bool>,
    /// Gain and phase of each element against the first.
    elements: Vec<ElementRecord>,
}

/// Direction of one satellite at one time.
#[derive(Clone, Debug, Serialize)]
pub struct DirectionRecord {
    sv: Sv,
    #[serde(flatten)]
    bearing: BearingRecord,
    sigma_deg: f64,
    /// Whether it differs from the direction by the orbit, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    suspected: Option<bool>,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct ElementRecord {
    gain_db: f64,
    phase_deg: f64,
}

/// The directions of the look nearest to a sample, if one was made within a second.
pub fn directions(run: &Run, sample: f64) -> Vec<DirectionRecord> {
    let at_start = run.sky.map(|sky| (0.0, sky));
    let later = run.sky_epochs.iter().map(|epoch| (epoch.sample as f64, &epoch.sky));
    let apart = |look: &(f64, &ArraySky)| (look.0 - sample).abs();
    let looks = at_start.into_iter().chain(later).filter(|l| apart(l) < run.input.rate_hz());
    let nearest = looks.min_by(|a, b| apart(a).total_cmp(&apart(b)));
    let record = |s: &SatelliteArrival| {
        let arrival = s.arrival.as_ref()?;
        Some(DirectionRecord {
            sv: s.sv,
            bearing: arrival.bearing.into(),
            sigma_deg: sigma_deg(arrival),
            suspected: s.predicted.map(|p| !p.agrees),
        })
    };
    nearest.iter().flat_map(|look| &look.1.satellites).filter_map(record).collect()
}

impl ArraySkyRecord {
    /// The record of an array's sources and directions.
    pub fn new(sky: &ArraySky) -> Self {
        let picture = sky.picture.as_ref();
        let despread = sky.satellites.iter().filter_map(SourceRecord::of_satellite);
        let others = sky.unexplained().map(SourceRecord::new);
        let jammers = picture.map_or(&[][..], |p| &p.jammers);
        Self {
            elements: picture.map(|p| p.elements),
            sources: despread.chain(others).collect(),
            blind_sources: picture
                .filter(|p| !p.crowded)
                .map(|p| p.sources.iter().map(SourceRecord::new).collect()),
            jammers: jammers.iter().map(JammerRecord::new).collect(),
            signals: sky.blind.as_ref().map(|b| b.signals),
            blind_satellites: sky.blind.as_ref().map(|b| b.satellites.clone()),
            satellites: sky.satellites.iter().map(SatelliteRecord::new).collect(),
            all_from_one_direction: sky.one_direction.map(|o| o.is_one),
        }
    }
}

impl SourceRecord {
    fn new(source: &Source) -> Self {
        Self {
            method: "covariance",
            sv: None,
            bearing: source.bearing.into(),
            sigma_deg: source_sigma_deg(source),
            power_db: 10.0 * source.power.log10(),
        }
    }
}

impl SourceRecord {
    fn of_satellite(satellite: &SatelliteArrival) -> Option<Self> {
        let arrival = satellite.arrival.as_ref()?;
        Some(Self {
            method: "despread",
            sv: Some(satellite.sv),
            bearing: arrival.bearing.into(),
            sigma_deg: sigma_deg(arrival),
            power_db: 10.0 * satellite.sample_snr.log10(),
        })
    }
}

impl JammerRecord {
    fn new(jammer: &Jammer) -> Self {
        Self { bearing: jammer.bearing.map(Into::into), power_db: jammer.power_db }
    }
}

/// Standard deviation of a source's angle, or the larger of the two.
fn source_sigma_deg(source: &Source) -> f64 {
    let [first, second] = source.bearing_sigma;
    let across = match source.bearing {
        Bearing::Cone(_) => first,
        Bearing::Direction { elevation, .. } => first * elevation.cos(),
    };
    across.max(second).to_degrees()
}

impl SatelliteRecord {
    fn new(s: &SatelliteArrival) -> Self {
        let first = s.signature.response[0];
        let element = |z: &num_complex::Complex64| ElementRecord {
            gain_db: 20.0 * (z.norm() / first.norm()).log10(),
            phase_deg: (z / first).arg().to_degrees(),
        };
        let cosines = |a: &Arrival| match a.bearing {
            Bearing::Cone(_) => vec![a.point[0]],
            Bearing::Direction { .. } => a.point.to_vec(),
        };
        Self {
            sv: s.sv,
            bearing: s.arrival.map(|a| a.bearing.into()),
            sigma_deg: s.arrival.as_ref().map(sigma_deg),
            cosines: s.arrival.as_ref().map(cosines),
            misfit: s.arrival.map(|a| a.misfit),
            expected: s.predicted.map(|p| p.bearing.into()),
            suspected: s.predicted.map(|p| !p.agrees),
            elements: s.signature.response.iter().map(element).collect(),
        }
    }
}

/// Maximum standard deviation of the direction, degrees: near the array's plane a small change of a cosine
/// is a large change of angle.
fn sigma_deg(arrival: &Arrival) -> f64 {
    let [s, t] = arrival.point;
    let height = (1.0 - s * s - t * t).max(1e-4).sqrt();
    (arrival.sigma[0].hypot(arrival.sigma[1]) / height).min(1.0).to_degrees()
}

fn angles(bearing: Bearing) -> String {
    match bearing {
        Bearing::Cone(angle) => format!("{:13.1}", angle.to_degrees()),
        Bearing::Direction { azimuth, elevation } => {
            format!("{:7.1} {:5.1}", azimuth.to_degrees(), elevation.to_degrees())
        }
    }
}

/// Results without codes: jammers, signals, sources with their directions.
fn sources_text(sky: &ArraySky) -> String {
    let mut text = String::new();
    if let Some(picture) = &sky.picture {
        for jammer in &picture.jammers {
            let from = jammer.bearing.map_or(String::new(), |b| format!(" from{} deg", angles(b)));
            let _ = writeln!(
                text,
                "  jammer      {:.1} dB over the noise{from}, removed",
                jammer.power_db
            );
        }
    }
    if let Some(blind) = &sky.blind {
        let names: Vec<String> = blind.satellites.iter().map(ToString::to_string).collect();
        let _ = writeln!(
            text,
            "  signals     {} in {} code periods, by their singular values; {} found in them: {} ({:.0} % of a full search's transforms)",
            blind.signals,
            blind.periods,
            names.len(),
            names.join(" "),
            100.0 * blind.transforms as f64 / blind.full_search_transforms.max(1) as f64
        );
    }
    if let Some(picture) = &sky.picture {
        let _ = writeln!(
            text,
            "  sources     {} by LDA-l1,1 and JANE on the covariance of {} elements, {} samples",
            if picture.crowded {
                "too many to be counted".to_owned()
            } else {
                picture.sources.len().to_string()
            },
            picture.elements,
            picture.samples
        );
        for source in &picture.sources {
            let _ = writeln!(
                text,
                "     {} deg +- {:.2}, {:+.1} dB",
                angles(source.bearing),
                source_sigma_deg(source),
                10.0 * source.power.log10()
            );
        }
    }
    text
}

/// Results without codes; then one line per satellite: direction with its standard deviation, direction by the
/// orbit, and the phases of the elements against the first.
pub fn array_sky_table(sky: &ArraySky) -> String {
    let mut text = sources_text(sky);
    if sky.satellites.is_empty() {
        return text;
    }
    let measured = sky.satellites.iter().find_map(|s| s.arrival);
    let what = match measured.map(|a| a.bearing) {
        None => String::new(),
        Some(Bearing::Cone(_)) => format!("{:>13} {:>6} {:>13}", "angle/deg", "sigma", "expected"),
        Some(Bearing::Direction { .. }) => {
            format!("{:>13} {:>6} {:>13}", "az, el/deg", "sigma", "expected")
        }
    };
    let _ = writeln!(text, "\n  sv  {what}  phases of the elements against the first/deg");
    for s in &sky.satellites {
        let _ = write!(text, "  {} ", s.sv);
        if measured.is_some() {
            let direction = s
                .arrival
                .map_or(" ".repeat(20), |a| format!("{} {:6.2}", angles(a.bearing), sigma_deg(&a)));
            let expected = s.predicted.map_or(" ".repeat(13), |p| angles(p.bearing));
            let _ = write!(text, "{direction} {expected} ");
        }
        for z in s.signature.response.iter().skip(1).take(PRINTED_ELEMENTS) {
            let phase = (z / s.signature.response[0]).arg().to_degrees();
            let _ = write!(text, " {phase:+7.1}");
        }
        if s.signature.response.len() > PRINTED_ELEMENTS + 1 {
            text += " ...";
        }
        if s.predicted.is_some_and(|p| !p.agrees) {
            text += "  suspected";
        }
        text += "\n";
    }
    text
}
