//! Observations of a snapshot: code phases without the navigation message.

use super::Refined;
use crate::gnss::GpsTime;
use crate::gnss::constants::{CA_CHIP_RATE, CA_CODE_LENGTH, CA_CODE_PERIOD, L1_HZ, SPEED_OF_LIGHT};
use crate::gnss::observation::{CodeRange, Observation, ObservationEpoch};

/// The observations in the middle of a snapshot of `samples` samples, where code phase and Doppler are
/// least correlated. `start` is the receive time of its first sample, as well as it is known.
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
            let chips = a.code_phase_chips + CA_CHIP_RATE * (1.0 + a.doppler_hz / L1_HZ) * wait_s;
            let sent_s = chips.rem_euclid(CA_CODE_LENGTH as f64) / CA_CHIP_RATE;
            let modulo_s = (-sent_s).rem_euclid(CA_CODE_PERIOD);
            Observation {
                sv: a.sv,
                range: Some(CodeRange::ModuloCodePeriod(modulo_s * SPEED_OF_LIGHT)),
                range_sigma_m: r.code_sigma_chips / CA_CHIP_RATE * SPEED_OF_LIGHT,
                doppler_hz: Some(a.doppler_hz),
                doppler_sigma_hz: r.doppler_sigma_hz,
                carrier_phase_cycles: None,
                lost_lock: false,
                cn0_dbhz: Some(a.cn0_dbhz),
            }
        })
        .collect();
    observations.sort_by_key(|o| o.sv);
    ObservationEpoch { receive_time: start + wait_s, sample: middle, observations }
}
