//! Removal of strong satellites from samples, so that weak ones behind their cross-correlations are found.

use super::{Acquisition, Refiner};
use crate::correlator::{CodeTable, SampleBuffer, sign};
use crate::gnss::signal::CodeClock;
use nalgebra::{Matrix3, Vector3};
use num_complex::{Complex32, Complex64};
use std::f64::consts::TAU;

/// Distance of the early and the late replica from the prompt one, chips: together they follow the shape that a front
/// end gives the chips.
const TAP_CHIPS: f64 = 0.5;

/// Subtracts satellites, the strongest first, from the channels of a block. Their code phases refer to the first sample
/// and are refined on the first channel; `search_hz` is the maximum error of the Dopplers; codes run
/// faster than their carriers say by the fraction `code_offset`.
///
/// In 20 ms a satellite of 62 dB-Hz falls by some 18 dB: the replica of a [`CodeTable`] is placed to 1/80 chip. A weak
/// satellite loses the three dimensions of some 2000 that a code period's replicas span.
pub(crate) fn subtract(
    channels: &mut [impl AsRef<[Complex32]> + AsMut<[Complex32]>],
    rate_hz: f64,
    satellites: &[Acquisition],
    search_hz: f64,
    code_offset: f64,
) {
    for satellite in satellites {
        let table = CodeTable::new(satellite.transmission, rate_hz);
        let mut buffer = SampleBuffer::default();
        buffer.push(channels[0].as_ref());
        let refiner = Refiner::new(&buffer, rate_hz, 0, buffer.end()).with_code_offset(code_offset);
        let refined = refiner.refine(satellite, &table, search_hz);
        let satellite = refined.map_or(*satellite, |r| r.acquisition);
        let clock = satellite.transmission.clock_beside(satellite.doppler_hz, code_offset);
        for channel in channels.iter_mut() {
            subtract_one(channel.as_mut(), rate_hz, &satellite, clock, &table);
        }
    }
}

/// By correlation interval, subtracts the combination of early, prompt and late replica that is nearest to the samples.
fn subtract_one(
    samples: &mut [Complex32],
    rate_hz: f64,
    satellite: &Acquisition,
    clock: CodeClock,
    table: &CodeTable,
) {
    let intervals = table.transmission().signal.intervals();
    let period = clock.period_samples(rate_hz);
    let length = period / intervals as f64;
    // Replicas are indexed from a period before the first sample, within which the first one starts.
    let lead = period.ceil();
    let first = lead - period + clock.seconds_to_start(satellite.code_phase_chips) * rate_hz;
    let count = ((lead + samples.len() as f64 - first) / length).ceil() as usize;
    for (k, begin) in (0..count).map(|k| (k as u64, first + k as f64 * length)) {
        let taps = table.taps(k, begin, begin + length, TAP_CHIPS);
        let before = taps.first_sample as usize;
        let range =
            before.max(lead as usize)..(before + taps.len).min(lead as usize + samples.len());
        let replicas = |n: usize| Vector3::from_fn(|tap, _| sign(taps.codes[tap][n - before]));
        let carrier =
            |n: usize| Complex64::cis(TAU * (satellite.doppler_hz / rate_hz * n as f64).fract());
        let mut normal = Matrix3::zeros();
        let mut sums = Vector3::repeat(Complex64::ZERO);
        for n in range.clone() {
            let code = replicas(n);
            normal += code * code.transpose();
            let x = samples[n - lead as usize];
            let baseband = Complex64::new(x.re.into(), x.im.into()) * carrier(n).conj();
            sums += code.map(|c| baseband * c);
        }
        // A part of a period may be too short to tell the replicas apart.
        let Some(inverse) = normal.try_inverse() else { continue };
        let amplitudes = inverse.map(Complex64::from) * sums;
        for n in range {
            let signal = replicas(n).map(Complex64::from).dot(&amplitudes) * carrier(n);
            samples[n - lead as usize] -= Complex32::new(signal.re as f32, signal.im as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correlator::test_signal::TestSignal;
    use crate::gnss::signal;

    #[test]
    fn a_strong_satellite_falls_to_the_precision_of_its_replica_and_a_weak_one_stays() {
        let rate_hz = 2.6e6;
        let len = (0.02 * rate_hz) as usize;
        let of = |sv: &str, cn0_dbhz, doppler, delay_s, seed| {
            let signal = TestSignal {
                rate: rate_hz,
                doppler,
                delay_s,
                cn0_dbhz,
                fade_db: 0.0,
                fade_s: 0.0,
                symbol_edge: 7,
                seed,
            };
            signal.samples(sv.parse().unwrap(), len)
        };
        let strong = of("G14", 65.0, -403.0, 0.3e-3, 1);
        let weak = of("G06", 45.0, 600.0, 0.71e-3, 2);
        let mixed: Vec<_> = strong.iter().zip(&weak).map(|(a, b)| a + b).collect();
        let start = Acquisition {
            transmission: signal::of("G14".parse().unwrap()),
            doppler_hz: -400.0,
            code_phase_chips: 1023.0 - 0.3 * 1023.0 + 0.15,
            cn0_dbhz: 65.0,
            statistic: 0.0,
            false_alarm: 0.0,
        };
        let mut channels = [mixed];
        subtract(&mut channels, rate_hz, &[start], 50.0, 0.0);
        // The signal of 65 dB-Hz has 1.2 times the power of the noise in 2.6 MHz, each of the two samples' noise is 1;
        // what is left of it must be below a twentieth (-13 dB) of that, beside noise and the weak signal of 0.012.
        let power =
            |x: &[Complex32]| x.iter().map(|x| f64::from(x.norm_sqr())).sum::<f64>() / len as f64;
        let noise = power(&strong) / (1.0 + 10f64.powf(6.5) / rate_hz);
        let rest = power(&channels[0]) / noise;
        assert!((rest - 2.0).abs() < 0.08, "{rest}");
    }
}
