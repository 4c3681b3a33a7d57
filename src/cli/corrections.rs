//! The options of the position, common to `process` and `solve`.

use anyhow::ensure;
use clap::{Args, ValueEnum};
use sdr_rx::gnss::atmosphere::Troposphere;
use sdr_rx::position::PositioningOptions;

/// Corrections of the ranges, and elevation mask.
#[derive(Args, Clone, Debug)]
pub struct Corrections {
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
        Ok(PositioningOptions {
            troposphere: match self.troposphere {
                TroposphereArg::None => Troposphere::None,
                TroposphereArg::Saastamoinen => Troposphere::Saastamoinen,
            },
            elevation_mask: self.mask.to_radians(),
            ..PositioningOptions::default()
        })
    }
}
