//! Observations of a snapshot: code phases without the navigation message.

use super::Refined;
use crate::gnss::GpsTime;
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::observation::{CodeRange, Observation, ObservationEpoch};

/// The observations in the middle of a snapshot of `samples` samples, where code phase and Doppler are least
/// correlated. `start` is the approximate receive time of its first sample.
pub fn snapshot_epoch(
    refined: &[Refined],
    start: GpsTime,
    samples: u64,
    rate_hz: f64,
) -> ObservationEpoch {
    let middle = samples as f64 / 2.0;
    let wait_s = middle / rate_hz;
    let mut observations: Vec<Observation> = refined
        .iter()
        .map(|r| {
            let a = &r.acquisition;
            let signal = a.transmission.signal;
            let code_rate = a.transmission.clock(a.doppler_hz).chip_rate_hz;
            let chips = a.code_phase_chips + code_rate * wait_s;
            let sent_s = chips.rem_euclid(signal.chips as f64) / signal.chip_rate_hz;
            let modulo_s = (-sent_s).rem_euclid(signal.period_s());
            Observation {
                transmission: a.transmission,
                range: Some(CodeRange::ModuloCodePeriod(modulo_s * SPEED_OF_LIGHT)),
                range_sigma_m: r.code_sigma_chips / signal.chip_rate_hz * SPEED_OF_LIGHT,
                doppler_hz: Some(a.doppler_hz),
                doppler_sigma_hz: r.doppler_sigma_hz,
                carrier_phase_cycles: None,
                lost_lock: false,
                cn0_dbhz: Some(a.cn0_dbhz),
            }
        })
        .collect();
    observations.sort_by_key(|o| o.transmission);
    ObservationEpoch { receive_time: start + wait_s, sample: middle, observations }
}
