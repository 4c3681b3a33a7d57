//! The options that describe a capture, common to all commands that read one.

use anyhow::ensure;
use clap::{Args, ValueEnum};
use sdr_rx::capture::{self, BitOrder, Encoding, Layout, OpenOptions, SampleSource};
use sdr_rx::gnss::GpsTime;
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::path::PathBuf;

/// The capture and its properties.
#[derive(Args, Clone, Debug)]
pub(crate) struct Input {
    /// Raw file, .sigmf-meta, ION metadata (.sdrx .smfx .xml, then perhaps its data files), .wav, a
    /// scenario (.toml, simulated while it is read), or - for standard input; several files are one
    /// channel each
    #[arg(value_name = "CAPTURE", required = true)]
    pub captures: Vec<PathBuf>,
    /// Sample type: cu8 cs8 cs16 cs32 cf32 cf64, real ru8 rs8 rs16 rs32 rf32 rf64, packed b1 b2 rb2, wav
    #[arg(short = 'f', long, value_name = "TYPE", help_heading = "Capture")]
    pub format: Option<String>,
    /// Samples per second of each channel, such as 4M
    #[arg(short = 'r', long, value_name = "HZ", value_parser = si_number, help_heading = "Capture")]
    pub rate: Option<f64>,
    /// Where the L1 carrier lies in the samples, Hz, such as 4.092M (complex samples: 0)
    #[arg(long = "if", value_name = "HZ", value_parser = si_number, allow_hyphen_values = true, help_heading = "Capture")]
    pub if_hz: Option<f64>,
    /// The spectrum is mirrored: invert Q
    #[arg(long, help_heading = "Capture")]
    pub conjugate: bool,
    /// Channels (antenna elements) in the file
    #[arg(long, value_name = "N", help_heading = "Capture")]
    pub channels: Option<usize>,
    /// How the channels lie in the file [default: interleaved]
    #[arg(long, value_name = "LAYOUT", help_heading = "Capture")]
    pub layout: Option<LayoutArg>,
    /// Which bits of a packed byte hold its first sample [default: msb]
    #[arg(long, value_name = "ORDER", help_heading = "Capture")]
    pub bit_order: Option<BitOrderArg>,
    /// Values of 2-bit codes: tc tca ob oba sm sma (two's complement, offset binary, sign and magnitude;
    /// a = adjusted to odd values) [default: tc]
    #[arg(long, value_name = "CODE", help_heading = "Capture")]
    pub encoding: Option<Encoding>,
    /// Stream or lane of ION metadata [default: those of GPS L1]
    #[arg(long, value_name = "ID", help_heading = "Capture")]
    pub stream: Option<String>,
    /// Seconds to skip at the start
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        help_heading = "Capture"
    )]
    pub start: f64,
    /// Seconds to read at most
    #[arg(long, value_name = "S", allow_negative_numbers = true, help_heading = "Capture")]
    pub duration: Option<f64>,
    /// Time of the first sample of the file: UTC as 2021-12-02T08:47:00Z, or GPS week:tow
    #[arg(long, value_name = "TIME", help_heading = "Capture")]
    pub time: Option<GpsTime>,
}

/// `--layout`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum LayoutArg {
    /// Samples of all channels at one instant side by side.
    Interleaved,
    /// All samples of a channel, then the next channel.
    Planar,
}

/// `--bit-order`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum BitOrderArg {
    /// The most significant bits.
    Msb,
    /// The least significant bits.
    Lsb,
}

impl Input {
    /// Opens the capture, or simulates it where it is a scenario.
    pub fn open(&self) -> anyhow::Result<Box<dyn SampleSource>> {
        Ok(match self.scenario()? {
            Some(scenario) => Box::new(ScenarioSource::new(&scenario)?),
            None => capture::open(&self.captures, &self.options())?,
        })
    }

    /// The scenario, cut to `--duration`, if the capture is one.
    pub fn scenario(&self) -> anyhow::Result<Option<Scenario>> {
        let [path] = &self.captures[..] else { return Ok(None) };
        if path.extension().is_none_or(|suffix| suffix != "toml") {
            return Ok(None);
        }
        let own = OpenOptions { duration_s: self.duration, ..OpenOptions::default() };
        ensure!(
            self.options() == own,
            "'{}' is a scenario, which itself describes its samples: of the capture options only \
             --duration applies",
            path.display()
        );
        let mut scenario = Scenario::read(path)?;
        if let Some(duration) = self.duration {
            ensure!(duration > 0.0, "--duration {duration}: seconds to make must be above 0");
            scenario.duration_s = scenario.duration_s.min(duration);
        }
        Ok(Some(scenario))
    }

    /// Names of the captures, without their folders.
    pub fn name(&self) -> String {
        let name = |p: &PathBuf| p.file_name().unwrap_or(p.as_os_str()).display().to_string();
        self.captures.iter().map(name).collect::<Vec<_>>().join(" ")
    }

    /// Whether a capture is standard input, a pipe, a socket or a device, which cannot be read twice.
    pub fn is_stream(&self) -> bool {
        let streams = |path: &PathBuf| {
            let kind = std::fs::metadata(path).map(|m| m.file_type());
            path.as_os_str() == "-" || kind.is_ok_and(|kind| !kind.is_file() && !kind.is_dir())
        };
        self.captures.iter().any(streams)
    }

    /// The library's options.
    pub fn options(&self) -> OpenOptions {
        OpenOptions {
            format: self.format.clone(),
            rate_hz: self.rate,
            if_hz: self.if_hz,
            conjugate: self.conjugate,
            channels: self.channels,
            layout: self.layout.map(|l| match l {
                LayoutArg::Interleaved => Layout::Interleaved,
                LayoutArg::Planar => Layout::Planar,
            }),
            bit_order: self.bit_order.map(|o| match o {
                BitOrderArg::Msb => BitOrder::MostFirst,
                BitOrderArg::Lsb => BitOrder::LeastFirst,
            }),
            encoding: self.encoding,
            start_s: self.start,
            duration_s: self.duration,
            start_time: self.time,
            stream: self.stream.clone(),
        }
    }
}

/// A number with an SI suffix: `4M`, `2.6M`, `-48.75k`, `1575.42M`, `4e6`.
pub fn si_number(text: &str) -> Result<f64, String> {
    let (digits, scale) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (&text[..at], 1e3),
        Some((at, 'M')) => (&text[..at], 1e6),
        Some((at, 'G')) => (&text[..at], 1e9),
        _ => (text, 1.0),
    };
    let number: f64 = digits
        .parse()
        .map_err(|_| format!("'{text}' is no number: write it as 4000000, 4e6, 4M or 4000k"))?;
    Ok(number * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn si_suffixes_scale() {
        assert_eq!(si_number("4M"), Ok(4e6));
        assert_eq!(si_number("-48.75k"), Ok(-48_750.0));
        assert_eq!(si_number("2.6e6"), Ok(2.6e6));
        assert_eq!(si_number("1.57542G"), Ok(1_575.42e6));
        assert!(si_number("").is_err() && si_number("M").is_err() && si_number("4 MHz").is_err());
    }
}
