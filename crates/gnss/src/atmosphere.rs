//! Delay of the L1 code by ionosphere and troposphere.

use super::GpsTime;
use super::constants::SPEED_OF_LIGHT;
use super::coordinates::Geodetic;

/// The eight coefficients of the Klobuchar model (IS-GPS-200N 20.3.3.5.1.7).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Klobuchar {
    /// Amplitude coefficients, s per semicircle^0..3.
    pub alpha: [f64; 4],
    /// Period coefficients, s per semicircle^0..3.
    pub beta: [f64; 4],
}

impl Klobuchar {
    /// The model of coefficients as they were sent; zeros throughout are sent where none is known.
    pub fn sent(alpha: [f64; 4], beta: [f64; 4]) -> Option<Self> {
        (alpha != [0.0; 4] || beta != [0.0; 4]).then_some(Self { alpha, beta })
    }

    /// Slant delay of the L1 code, m, for a receiver at `position` with the satellite at
    /// `azimuth`, `elevation` (rad), at GPS time `t` (IS-GPS-200N figure 20-4). The carrier is
    /// advanced by the same amount. Below the horizon the horizon's value is returned.
    pub fn delay_m(&self, position: Geodetic, azimuth: f64, elevation: f64, t: GpsTime) -> f64 {
        use std::f64::consts::PI;
        let semicircles = |rad: f64| rad / PI;
        let el = semicircles(elevation.max(0.0));
        let psi = 0.0137 / (el + 0.11) - 0.022;
        let phi_i = (semicircles(position.latitude) + psi * azimuth.cos()).clamp(-0.416, 0.416);
        let lambda_i = semicircles(position.longitude) + psi * azimuth.sin() / (phi_i * PI).cos();
        let phi_m = phi_i + 0.064 * ((lambda_i - 1.617) * PI).cos();
        let local = (43_200.0 * lambda_i + t.tow()).rem_euclid(86_400.0);
        let slant = 1.0 + 16.0 * (0.53 - el).powi(3);
        let polynomial = |c: &[f64; 4]| c[0] + phi_m * (c[1] + phi_m * (c[2] + phi_m * c[3]));
        let amplitude = polynomial(&self.alpha).max(0.0);
        let period = polynomial(&self.beta).max(72_000.0);
        let x = 2.0 * PI * (local - 50_400.0) / period;
        let vertical =
            if x.abs() < 1.57 { amplitude * (1.0 - x * x / 2.0 + x.powi(4) / 24.0) } else { 0.0 };
        slant * (5e-9 + vertical) * SPEED_OF_LIGHT
    }
}

/// Model of the troposphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Troposphere {
    /// No delay (as most signal simulators).
    None,
    /// Saastamoinen's zenith delay in the standard atmosphere, mapped by 1/cos z.
    #[default]
    Saastamoinen,
}

impl Troposphere {
    /// Slant delay, m, at `position` for an `elevation` in rad (Saastamoinen 1972, with the ICAO standard
    /// atmosphere at the receiver's height and 70 % relative humidity). Zero below the horizon. It has no step in
    /// height: above the tropopause the temperature stays as it is there, and below -1 km the delay.
    pub fn delay_m(self, position: Geodetic, elevation: f64) -> f64 {
        /// Height of the tropopause, m, and scale height of the pressure above it (ICAO Doc 7488).
        const TROPOPAUSE_M: f64 = 11e3;
        const SCALE_M: f64 = 6341.6;
        if self == Self::None || elevation <= 0.0 {
            return 0.0;
        }
        let height = position.height.max(-1e3);
        let below = height.min(TROPOPAUSE_M);
        let thinner = (-(height - below) / SCALE_M).exp();
        let pressure_hpa = 1013.25 * (1.0 - 2.2557e-5 * below).powf(5.2568) * thinner;
        let temperature_k = 15.0 - 6.5e-3 * below + 273.16;
        let saturation_hpa =
            6.108 * ((17.15 * temperature_k - 4684.0) / (temperature_k - 38.45)).exp();
        let vapour_hpa = 0.7 * saturation_hpa * thinner;
        let z = std::f64::consts::FRAC_PI_2 - elevation;
        let gravity = 1.0 - 0.00266 * (2.0 * position.latitude).cos() - 0.00028 * below / 1e3;
        let dry = 0.0022768 * pressure_hpa / gravity / z.cos();
        let wet = 0.002277 * (1255.0 / temperature_k + 0.05) * vapour_hpa / z.cos();
        dry + wet
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn night_ionosphere_is_five_nanoseconds_times_the_slant_factor() {
        let model = Klobuchar { alpha: [1e-8, 0.0, 0.0, 0.0], beta: [9e4, 0.0, 0.0, 0.0] };
        let position = Geodetic::from_degrees(40.0, 0.0, 0.0);
        let night = GpsTime::from_week_tow(2190, 2.0 * 3600.0);
        let day = GpsTime::from_week_tow(2190, 14.0 * 3600.0);
        let zenith = std::f64::consts::FRAC_PI_2;
        let slant = 1.0 + 16.0 * 0.03f64.powi(3);
        assert!(
            (model.delay_m(position, 0.0, zenith, night) - 5e-9 * slant * SPEED_OF_LIGHT).abs()
                < 1e-9
        );
        // At 14 h local time the cosine is at its maximum: amplitude added in full (longitude 0).
        assert!(
            (model.delay_m(position, 0.0, zenith, day) - 15e-9 * slant * SPEED_OF_LIGHT).abs()
                < 1e-6
        );
    }

    #[test]
    fn zenith_troposphere_at_sea_level_is_that_of_the_standard_atmosphere() {
        let position = Geodetic::from_degrees(45.0, 0.0, 0.0);
        let delay = Troposphere::Saastamoinen.delay_m(position, std::f64::consts::FRAC_PI_2);
        // 2.31 m dry by the 1013.25 hPa standard, plus 0.05 to 0.15 m wet.
        assert!((2.35..2.47).contains(&delay), "{delay}");
        let low = Troposphere::Saastamoinen.delay_m(position, 30f64.to_radians());
        assert!((low / delay - 2.0).abs() < 1e-9);
        assert_eq!(Troposphere::None.delay_m(position, 1.0), 0.0);
    }

    /// Pressures of ICAO Doc 7488 in hPa, 2.2768 mm of dry delay each (latitude 45 degrees), and nowhere a step.
    #[test]
    fn the_troposphere_thins_out_without_a_step() {
        let zenith = |height| {
            let position = Geodetic::from_degrees(45.0, 0.0, height);
            Troposphere::Saastamoinen.delay_m(position, std::f64::consts::FRAC_PI_2)
        };
        for (height, pressure_hpa) in [(5e3, 540.2), (11e3, 226.3), (15e3, 120.4), (20e3, 54.75)] {
            let dry = 2.2768e-3 * pressure_hpa;
            // Gravity changes by 0.3 %; water is below 2 % from 5 km on.
            assert!(
                (zenith(height) / dry - 1.0).abs() < 0.03,
                "{height}: {} {dry}",
                zenith(height)
            );
        }
        let heights = || (-50..2000).map(|k| f64::from(k) * 20.0);
        for height in heights() {
            let step = zenith(height) - zenith(height + 1e-3);
            // Half a kilometre of the scale height's slope at most: 2.6 m / 7 km, and the water's.
            assert!((0.0..2e-6).contains(&step), "{height}: {step}");
        }
        assert!(zenith(4e5) < 1e-12 && zenith(-6.3e6).is_finite());
    }
}
