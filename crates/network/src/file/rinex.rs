//! Observations of a station, from its RINEX observation file: the combination of three codes of each satellite,
//! with the elevation for its weight.

use crate::code_bias::{BiasObservation, Carriers, ReceiverBias, ZENITH_SIGMA_M, station_model};
use crate::{NetworkError, Normals};
use nalgebra::Vector3;
use sdr_rx_gnss::coordinates::azimuth_elevation;
use sdr_rx_gnss::format::{LeftOut, rinex_obs};
use sdr_rx_gnss::orbit::Propagation;
use sdr_rx_gnss::{GpsTime, NavigationData, ReadError, Sv};
use std::path::{Path, PathBuf};

/// Which codes are combined, and of which satellites.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeOptions {
    /// The three codes by their RINEX names. A satellite without one of them is left out: a bias belongs to a
    /// code, which must be the same at all stations.
    pub signals: [String; 3],
    /// Their carriers.
    pub carriers: Carriers,
    /// Satellites lower than this are left out, rad.
    pub elevation_mask_rad: f64,
    /// Standard deviation of one code at the zenith, m.
    pub zenith_sigma_m: f64,
}

impl Default for CodeOptions {
    /// C1C, C2L and C5Q of GPS and QZSS, above 10 degrees.
    fn default() -> Self {
        Self {
            signals: ["C1C", "C2L", "C5Q"].map(str::to_owned),
            carriers: Carriers::GPS,
            elevation_mask_rad: 10f64.to_radians(),
            zenith_sigma_m: ZENITH_SIGMA_M,
        }
    }
}

/// The combination of a satellite's codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Combination {
    /// The satellite.
    pub sv: Sv,
    /// Receiver bias plus satellite bias, m.
    pub value_m: f64,
    /// Elevation, rad.
    pub elevation_rad: f64,
}

/// A station's file.
#[derive(Clone, Debug, PartialEq)]
pub struct StationFile {
    /// In the order of the file.
    pub epochs: Vec<StationEpoch>,
    /// Records that do not follow the format.
    pub left_out: LeftOut,
}

/// Observations of a station at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct StationEpoch {
    /// Receive instant by the station's clock.
    pub receive_time: GpsTime,
    /// By satellite, ascending.
    pub combinations: Vec<Combination>,
}

/// Why a file gives no station.
#[derive(Debug, thiserror::Error)]
pub enum StationError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The position of the station is not known.
    #[error(
        "reading the station '{}': its header has no APPROX POSITION XYZ, which elevations need; give the station's position", .0.display()
    )]
    NoPosition(PathBuf),
    /// No satellite has the three codes and an orbit.
    #[error(
        "reading the station '{}': no satellite has all of the codes {signals} and an orbit above the mask; name codes that its header lists, and a navigation file of that day", path.display()
    )]
    NoSatellite {
        /// The file.
        path: PathBuf,
        /// The requested codes.
        signals: String,
    },
}

/// Reads a station's file. `position_m` (ECEF, m, a kilometre is good enough) replaces the header's approximate
/// position. Satellites without orbit, or which declare themselves unhealthy, are left out.
///
/// # Errors
/// [`StationError`].
pub fn station_epochs(
    path: &Path,
    navigation: &NavigationData,
    position_m: Option<Vector3<f64>>,
    options: &CodeOptions,
) -> Result<StationFile, StationError> {
    let mut reader = rinex_obs::open(path)?;
    let position_m = position_m.or(reader.header().approximate_position_m);
    let position_m = position_m.ok_or_else(|| StationError::NoPosition(path.to_owned()))?;
    let signals = options.signals.each_ref().map(String::as_str);
    let mut epochs = Vec::new();
    while let Some(epoch) = reader.next_pseudoranges(&signals)? {
        let receive_time = epoch.receive_time;
        let combination = |(sv, ranges): (Sv, Vec<Option<f64>>)| {
            let ranges_m: Vec<f64> = ranges.into_iter().flatten().collect();
            let ranges_m: [f64; 3] = ranges_m.try_into().ok()?;
            let orbit = navigation.orbit(sv, receive_time).ok()?;
            let satellite = Propagation::solve(orbit, &position_m, receive_time).satellite;
            let (_, elevation_rad) = azimuth_elevation(&position_m, &satellite.position_m);
            let value_m = options.carriers.combine(ranges_m);
            (elevation_rad >= options.elevation_mask_rad).then_some(Combination {
                sv,
                value_m,
                elevation_rad,
            })
        };
        let combinations = epoch.satellites.into_iter().filter_map(combination).collect();
        epochs.push(StationEpoch { receive_time, combinations });
    }
    if epochs.iter().all(|epoch| epoch.combinations.is_empty()) {
        let (path, signals) = (path.to_owned(), options.signals.join(", "));
        return Err(StationError::NoSatellite { path, signals });
    }
    Ok(StationFile { epochs, left_out: reader.left_out().clone() })
}

/// The satellites that stations observed, ascending: the parameters of their network.
pub fn satellites<'a>(epochs: impl IntoIterator<Item = &'a StationEpoch>) -> Vec<Sv> {
    let combinations = epochs.into_iter().flat_map(|epoch| &epoch.combinations);
    let mut satellites: Vec<Sv> = combinations.map(|c| c.sv).collect();
    satellites.sort_unstable();
    satellites.dedup();
    satellites
}

/// A station's normal equations of the satellites' biases, m, summed over its epochs; the receiver's bias may
/// differ from one to the next. Other satellites than those listed are left out.
///
/// # Errors
/// None for satellites that are all different.
pub fn station_normals(
    epochs: &[StationEpoch],
    satellites: &[Sv],
    options: &CodeOptions,
    receiver: ReceiverBias,
) -> Result<Normals, NetworkError> {
    let mut sum = Normals::none(satellites.len());
    for epoch in epochs {
        let observation = |c: &Combination| {
            let satellite = satellites.iter().position(|sv| *sv == c.sv)?;
            let (combination_m, elevation_rad) = (c.value_m, c.elevation_rad);
            Some(BiasObservation { satellite, combination_m, elevation_rad })
        };
        let observed: Vec<_> = epoch.combinations.iter().filter_map(observation).collect();
        if observed.is_empty() {
            continue;
        }
        let count = satellites.len();
        let (carriers, sigma_m) = (&options.carriers, options.zenith_sigma_m);
        sum.add(&station_model(&observed, count, carriers, sigma_m, receiver)?.normals());
    }
    Ok(sum)
}
