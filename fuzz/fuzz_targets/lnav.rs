#![no_main]
//! Bits of any content through the frame decoder, and words of any content through every message.

use libfuzzer_sys::fuzz_target;
use sdr_rx::gnss::Sv;
use sdr_rx::gnss::message::lnav::{FrameDecoder, Subframe};
use sdr_rx::gnss::message::lnav::{Header, decode_subframe, encode_subframe};
use sdr_rx::gnss::message::{Content, MessageDecoder, NavigationCollector};

fuzz_target!(|bytes: &[u8]| {
    let mut decoder = FrameDecoder::new();
    let bits = bytes.iter().flat_map(|byte| (0..8).map(move |k| byte >> k & 1));
    for (bit, index) in bits.zip(0..) {
        decoder.push(if bit == 1 { -1.0 } else { 1.0 }, index);
    }
    let mut collector = NavigationCollector::default();
    let sv = Sv::from_prn(1).expect("PRN 1 exists");
    for chunk in bytes.chunks_exact(30) {
        let words = std::array::from_fn(|k| {
            chunk[3 * k..3 * k + 3].iter().fold(0, |word, &byte| word << 8 | u32::from(byte))
        });
        let (header, message) = decode_subframe(&words);
        let subframe = Subframe { start_index: 0, inverted: false, header, words };
        collector.add(sv, &Content::Lnav(subframe.clone()));
        // What was decoded fits its fields again; only a TOW count or number may be out of range.
        let header = Header { tow_count: 0, id: 1, ..subframe.header };
        encode_subframe(&header, &message).expect("decoded values fit");
    }
});
