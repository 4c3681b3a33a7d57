//! The noise of a receiver that does not state it, from its C/N0.

/// C/N0 that is assumed where a file does not state it, dB-Hz: a satellite at middle elevation.
const TYPICAL_CN0_DBHZ: f64 = 42.0;

/// Standard deviations of code (m) and Doppler (Hz) of a consumer's receiver at `cn0_dbhz`, or at a typical
/// value where none is known: 0.5 m and 0.2 Hz at 45 dB-Hz, both growing as the noise does, by 10 every
/// 20 dB.
///
/// The code is that of a loop of 1 Hz with correlators 0.1 chips apart (Kaplan and Hegarty 2017, 8.9). How
/// much Dopplers are smoothed differs by a factor of 50 between receivers (0.25 Hz of a u-blox at 42 dB-Hz,
/// 0.06 Hz of a Septentrio, 0.005 Hz of a monitor station): the largest is taken, so that no good one is
/// called faulty.
pub fn typical_noise(cn0_dbhz: Option<f64>) -> (f64, f64) {
    let noise = 10f64.powf((45.0 - cn0_dbhz.unwrap_or(TYPICAL_CN0_DBHZ)) / 20.0);
    (0.5 * noise, 0.2 * noise)
}
