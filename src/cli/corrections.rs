//! The options of the position, common to `process` and `solve`.

use super::input::si_number;
use anyhow::ensure;
use clap::{Args, ValueEnum};
use sdr_rx::gnss::atmosphere::Troposphere;
use sdr_rx::position::{Observable, PositioningOptions, Solver, Systems};

/// What positions are solved from and how, corrections of the ranges, and elevation mask.
#[derive(Args, Clone, Debug)]
pub struct Corrections {
    /// Observables to solve from; Dopplers need a receiver at rest
    #[arg(long, value_name = "WHAT", default_value = "pseudorange", help_heading = "Position")]
    observable: ObservableArg,
    /// Solver from the Earth's centre: aw-dgn-bt, best, vp, gn, ...; any other word lists all. Where it fails, best
    /// takes over
    #[arg(long, value_name = "NAME", default_value = "aw-dgn-bt", help_heading = "Position")]
    solver: Solver,
    /// Satellite systems to use, by their letters in RINEX: G GPS, J QZSS, E Galileo, C BeiDou, R GLONASS, S SBAS
    #[arg(long, value_name = "G,E,...", default_value_t = Systems::ALL, help_heading = "Position")]
    systems: Systems,
    /// Troposphere model
    #[arg(long, value_name = "MODEL", default_value = "saastamoinen", help_heading = "Position")]
    troposphere: TroposphereArg,
    /// Satellites below this elevation are not used, deg
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 5.0,
        allow_negative_numbers = true,
        help_heading = "Position"
    )]
    mask: f64,
    /// Heights above this are believed only where redundant satellites agree, m: 20k is above aircraft; rockets and
    /// low orbits need more, such as 1500k
    #[arg(
        long,
        value_name = "M",
        default_value = "20k",
        value_parser = si_number,
        help_heading = "Position"
    )]
    max_height: f64,
    /// Largest speed of the receiver of a snapshot, m/s
    #[arg(
        long,
        value_name = "M/S",
        default_value = "100",
        value_parser = si_number,
        help_heading = "Position"
    )]
    user_speed: f64,
}

/// `--observable`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ObservableArg {
    /// Pseudoranges; Dopplers then give the velocity.
    Pseudorange,
    /// Dopplers alone.
    Doppler,
    /// Both, weighted.
    Both,
}

/// `--troposphere`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum TroposphereArg {
    /// No delay, as in most simulators.
    None,
    /// Saastamoinen in the standard atmosphere.
    Saastamoinen,
}

impl Corrections {
    /// The library's options.
    pub fn options(&self) -> anyhow::Result<PositioningOptions> {
        ensure!(
            (-90.0..90.0).contains(&self.mask),
            "--mask must be an elevation between -90 and 90 deg"
        );
        ensure!(self.max_height > 0.0, "--max-height must be positive, such as 500k");
        ensure!(
            (0.0..=20e3).contains(&self.user_speed),
            "--user-speed must be 0 to 20k m/s: satellites of low orbits have 8k"
        );
        Ok(PositioningOptions {
            observable: match self.observable {
                ObservableArg::Pseudorange => Observable::Pseudorange,
                ObservableArg::Doppler => Observable::Doppler,
                ObservableArg::Both => Observable::Both,
            },
            solver: self.solver,
            systems: self.systems,
            max_height_m: self.max_height,
            user_speed_mps: self.user_speed,
            troposphere: match self.troposphere {
                TroposphereArg::None => Troposphere::None,
                TroposphereArg::Saastamoinen => Troposphere::Saastamoinen,
            },
            elevation_mask: self.mask.to_radians(),
            ..PositioningOptions::default()
        })
    }
}
