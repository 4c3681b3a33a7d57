//! Despreading of an array's samples: one satellite's prompts of every element and correlation interval.

use crate::array::CMat;
use crate::correlator::{CodeTable, SampleBuffer, Window, correlate};
use num_complex::Complex64;

/// Prompts of a satellite, one row per channel and one column per whole correlation interval among the samples
/// `start..end` (stream indices). The code phase given, chips, is that at sample `start`; the Doppler, Hz, is
/// that of the middle. Cost: one pass over the samples of every channel.
pub fn despread(
    channels: &[SampleBuffer],
    rate_hz: f64,
    (start, end): (u64, u64),
    (doppler_hz, code_phase_chips): (f64, f64),
    table: &CodeTable,
) -> CMat {
    let clock = table.transmission().clock(doppler_hz);
    let length = clock.period_samples(rate_hz) / table.transmission().signal.intervals() as f64;
    let first = start as f64 + clock.seconds_to_start(code_phase_chips) * rate_hz;
    let count = ((end as f64 - first) / length).floor().max(0.0) as usize;
    let step = doppler_hz / rate_hz;
    CMat::from_fn(channels.len(), count, |channel, k| {
        let begin = first + k as f64 * length;
        let taps = table.taps(k as u64, begin, begin + length, 0.5);
        let window = channels[channel]
            .window(taps.first_sample, taps.first_sample + taps.len as u64)
            .unwrap_or(Window::Words([&[], &[]]));
        let phase = (step * (taps.first_sample - start) as f64).fract();
        let [_, prompt, _] = correlate(window, taps.codes, phase, step);
        Complex64::new(prompt.re.into(), prompt.im.into())
    })
}
