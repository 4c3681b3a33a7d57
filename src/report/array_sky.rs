//! Sources and directions by an antenna array, as a table and as a JSON record.

use super::Run;
use crate::array::{
    ArrayAttitude, ArraySky, Arrival, Bearing, Engine, Jammer, LookDecision, Point,
    SatelliteArrival, SkyPicture, SkySource, SparseLook,
};
use crate::gnss::Sv;
use crate::gnss::antenna::Attitude;
use num_complex::Complex64;
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
    /// Sources by the look, before codes.
    #[serde(skip_serializing_if = "Option::is_none")]
    look: Option<LookRecord>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    jammers: Vec<JammerRecord>,
    satellites: Vec<SatelliteRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    attitude: Option<AttitudeRecord>,
    /// Of the elements against the array as it was given.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    gains: Vec<ElementRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    all_from_one_direction: Option<bool>,
}

/// Sources without codes, and what was found in them.
#[derive(Clone, Debug, Serialize)]
struct LookRecord {
    /// Code periods used.
    periods: usize,
    /// The solver of the sparse problem, where it ran.
    #[serde(skip_serializing_if = "Option::is_none")]
    engine: Option<&'static str>,
    /// What decided on directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    decision: Option<&'static str>,
    /// Bound on the relative distance of its objective from the optimum.
    #[serde(skip_serializing_if = "Option::is_none")]
    duality_gap: Option<f64>,
    sources: Vec<SourceRecord>,
    /// Fourier transforms by which the codes were found.
    transforms: usize,
    full_search_transforms: usize,
}

#[derive(Clone, Debug, Serialize)]
struct SourceRecord {
    /// How it was found: `despread` or `look`.
    #[serde(rename = "route")]
    method: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    sv: Option<Sv>,
    /// What a source without a code of the list may be.
    #[serde(skip_serializing_if = "Option::is_none")]
    kind: Option<&'static str>,
    #[serde(flatten)]
    bearing: Option<BearingRecord>,
    /// Maximum standard deviation of the direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma_deg: Option<f64>,
    /// Doppler modulo the inverse of a code period.
    #[serde(skip_serializing_if = "Option::is_none")]
    doppler_modulo_hz: Option<f64>,
    /// At one element.
    cn0_dbhz: f64,
}

/// Attitude by the directions of the satellites.
#[derive(Clone, Copy, Debug, Serialize)]
struct AttitudeRecord {
    /// Of the platform; of a line, a turn that brings its axis where it is.
    #[serde(flatten)]
    attitude: Attitude,
    heading_sigma_deg: f64,
    tilt_sigma_deg: f64,
    satellites: usize,
    /// Squared residuals over their variance.
    misfit: f64,
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
            sigma_deg: sigma_deg(arrival.point, arrival.sigma),
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
            look: picture.map(LookRecord::new),
            jammers: jammers.iter().map(JammerRecord::new).collect(),
            satellites: sky.satellites.iter().map(SatelliteRecord::new).collect(),
            attitude: sky.attitude.map(|a| AttitudeRecord {
                attitude: a.attitude,
                heading_sigma_deg: a.sigma[0].to_degrees(),
                tilt_sigma_deg: a.sigma[1].to_degrees(),
                satellites: a.satellites,
                misfit: a.misfit,
            }),
            gains: sky.gains.iter().flatten().map(|g| element(*g)).collect(),
            all_from_one_direction: sky.one_direction.map(|o| o.is_one),
        }
    }
}

impl LookRecord {
    fn new(picture: &SkyPicture) -> Self {
        Self {
            periods: picture.periods,
            engine: picture.sparse.as_ref().map(|s| engine_name(s.engine)),
            decision: picture.sparse.as_ref().map(|_| match picture.decision {
                LookDecision::Jane => "JANE",
                LookDecision::Rows => "row rule",
            }),
            duality_gap: picture.sparse.as_ref().map(|s| s.gap),
            sources: picture.sources.iter().map(SourceRecord::new).collect(),
            transforms: picture.transforms.0,
            full_search_transforms: picture.transforms.1,
        }
    }
}

impl SourceRecord {
    fn new(source: &SkySource) -> Self {
        Self {
            method: "look",
            sv: source.sv,
            kind: match source.sv {
                Some(_) if source.is_asked => None,
                Some(_) => Some("not asked for"),
                None => Some(kind(source)),
            },
            bearing: source.direction.map(|d| d.bearing.into()),
            sigma_deg: source.direction.map(|d| sigma_deg(d.point, d.sigma)),
            doppler_modulo_hz: Some(source.doppler_hz),
            cn0_dbhz: source.cn0_dbhz,
        }
    }

    fn of_satellite(satellite: &SatelliteArrival) -> Option<Self> {
        let arrival = satellite.arrival.as_ref()?;
        Some(Self {
            method: "despread",
            sv: Some(satellite.sv),
            kind: None,
            bearing: Some(arrival.bearing.into()),
            sigma_deg: Some(sigma_deg(arrival.point, arrival.sigma)),
            doppler_modulo_hz: None,
            cn0_dbhz: satellite.cn0_dbhz,
        })
    }
}

/// What a source without a code of the list may be.
fn kind(source: &SkySource) -> &'static str {
    if source.is_periodic {
        "periodic: an unknown code of this period, or a carrier"
    } else {
        "another system, or interference"
    }
}

fn engine_name(engine: Engine) -> &'static str {
    match engine {
        Engine::Admm => "ADMM",
        Engine::Lda => "LDA-l1,1",
    }
}

impl JammerRecord {
    fn new(jammer: &Jammer) -> Self {
        Self { bearing: jammer.bearing.map(Into::into), power_db: jammer.power_db }
    }
}

impl SatelliteRecord {
    fn new(s: &SatelliteArrival) -> Self {
        let first = s.signature.response[0];
        let cosines = |a: &Arrival| match a.bearing {
            Bearing::Cone(_) => vec![a.point[0]],
            Bearing::Direction { .. } => a.point.to_vec(),
        };
        Self {
            sv: s.sv,
            bearing: s.arrival.map(|a| a.bearing.into()),
            sigma_deg: s.arrival.map(|a| sigma_deg(a.point, a.sigma)),
            cosines: s.arrival.as_ref().map(cosines),
            misfit: s.arrival.map(|a| a.misfit),
            expected: s.predicted.map(|p| p.bearing.into()),
            suspected: s.predicted.map(|p| !p.agrees),
            elements: s.signature.response.iter().map(|z| element(z / first)).collect(),
        }
    }
}

fn element(gain: Complex64) -> ElementRecord {
    ElementRecord { gain_db: 20.0 * gain.norm().log10(), phase_deg: gain.arg().to_degrees() }
}

/// Maximum standard deviation of the direction, degrees: near the array's plane a small change of a cosine
/// is a large change of angle.
fn sigma_deg([s, t]: Point, sigma: Point) -> f64 {
    let height = (1.0 - s * s - t * t).max(1e-4).sqrt();
    (sigma[0].hypot(sigma[1]) / height).min(1.0).to_degrees()
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
    let Some(picture) = &sky.picture else { return text };
    let known = picture.sources.iter().filter(|s| s.sv.is_some()).count();
    let by = match &picture.sparse {
        None => String::new(),
        Some(SparseLook { engine, gap, snapshots, directions }) => format!(
            ", directions by {}{} of {} (gap {gap:.1e}, {snapshots} snapshots)",
            match picture.decision {
                LookDecision::Jane => "JANE from ",
                LookDecision::Rows => "the rows, ",
            },
            directions.len(),
            engine_name(*engine)
        ),
    };
    let _ = writeln!(
        text,
        "  look        {} sources in {} code periods of {} elements{by}",
        picture.sources.len(),
        picture.periods,
        picture.elements
    );
    let _ = writeln!(
        text,
        "              codes found in {known} of them, by {} transforms ({:.0} % of a full search's)",
        picture.transforms.0,
        100.0 * picture.transforms.0 as f64 / picture.transforms.1.max(1) as f64
    );
    for source in &picture.sources {
        let direction = source.direction.as_ref().map_or(String::new(), |d| {
            format!("{} deg +- {:.2}, ", angles(d.bearing), sigma_deg(d.point, d.sigma))
        });
        let asked = if source.is_asked { "" } else { ", not asked for" };
        let what = source.sv.map_or(kind(source).to_owned(), |sv| format!("{sv}{asked}"));
        let _ = writeln!(text, "     {direction}{:4.1} dB-Hz  {what}", source.cn0_dbhz);
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
            let direction = s.arrival.map_or(" ".repeat(20), |a| {
                format!("{} {:6.2}", angles(a.bearing), sigma_deg(a.point, a.sigma))
            });
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
    if let Some(ArrayAttitude { attitude, sigma: [heading, tilt], satellites, misfit }) =
        sky.attitude
    {
        let _ = writeln!(
            text,
            "\n  attitude    heading {:.2} +- {:.2} deg, pitch {:.2}, roll {:.2} +- {:.2} deg by {satellites} satellites (misfit {misfit:.1})",
            attitude.yaw_deg,
            heading.to_degrees(),
            attitude.pitch_deg,
            attitude.roll_deg,
            tilt.to_degrees()
        );
    }
    text
}
