#![no_main]
//! Raw samples of every format, layout and interval.

mod common;

use libfuzzer_sys::fuzz_target;
use sdr_rx::capture::{BitOrder, Layout, OpenOptions};

const FORMATS: [&str; 15] = [
    "cu8", "cs8", "cs16", "cs32", "cf32", "cf64", "ru8", "rs8", "rs16", "rs32", "rf32", "rf64", "b1",
    "b2", "rb2",
];

fuzz_target!(|data: (u8, u8, u8, f64, f64, Vec<u8>)| {
    let (format, flags, channels, start_s, duration_s, bytes) = data;
    let options = OpenOptions {
        format: Some(FORMATS[usize::from(format) % FORMATS.len()].to_owned()),
        rate_hz: Some(1e3),
        if_hz: Some(10.0),
        conjugate: flags & 1 != 0,
        channels: Some(usize::from(channels)),
        layout: (flags & 2 != 0).then_some(Layout::Planar),
        bit_order: (flags & 4 != 0).then_some(BitOrder::LeastFirst),
        start_s: if flags & 8 != 0 { start_s } else { 0.0 },
        duration_s: (flags & 16 != 0).then_some(duration_s),
        ..OpenOptions::default()
    };
    common::open_and_read(&[("a.bin", &bytes)], &options);
});
