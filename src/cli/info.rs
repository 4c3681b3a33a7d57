//! `sdr-rx info`: properties of a capture.

use super::input::Input;
use super::words;
use sdr_rx::capture::{Block, SampleSource};
use sdr_rx::front_end::{Level, LevelMeter, power_spectrum};
use serde::Serialize;
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::process::ExitCode;

/// Samples of each channel that are analysed.
const LOOK: usize = 1 << 22;
/// Samples of each channel that are read at once.
const BLOCK: usize = 1 << 16;
/// Columns of the spectrum on the terminal.
const COLUMNS: usize = 64;

/// What a capture holds: format, rate, length, level and spectrum
///
/// Example: sdr-rx info signals/circle_8sv.toml
#[derive(clap::Args)]
pub struct Info {
    #[command(flatten)]
    input: Input,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The properties.
#[derive(Serialize)]
struct Report {
    schema: &'static str,
    files: Vec<String>,
    format: String,
    rate_hz: f64,
    if_hz: f64,
    channels: usize,
    real: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    samples: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    length_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    start_utc: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    start_gps: Option<(i32, f64)>,
    looked_at_s: f64,
    levels: Vec<Level>,
    spectra_db: Vec<Vec<f64>>,
    warnings: Vec<String>,
}

/// Prints the properties of the capture; the level and the spectrum are those of its first 4 million samples.
pub fn run(args: &Info) -> anyhow::Result<ExitCode> {
    let mut source = args.input.open()?;
    let files = args.input.captures.iter().map(|p| p.display().to_string()).collect();
    let report = look(source.as_mut(), files)?;
    let text = if args.json { serde_json::to_string(&report)? + "\n" } else { page(&report)? };
    match io::stdout().write_all(text.as_bytes()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(ExitCode::SUCCESS),
    }
}

fn look(source: &mut dyn SampleSource, files: Vec<String>) -> anyhow::Result<Report> {
    let info = source.info().clone();
    let mut meters = vec![LevelMeter::default(); info.channels];
    let bins = if info.real { 2 * COLUMNS } else { COLUMNS };
    let mut power = vec![vec![0.0; bins]; info.channels];
    let (mut block, mut seen) = (Block::default(), 0);
    while seen < LOOK {
        let got = source.read(&mut block, BLOCK).map_err(|e| anyhow::anyhow!(e))?;
        if got == 0 {
            break;
        }
        for (c, meter) in meters.iter_mut().enumerate() {
            meter.add(block.channel(c));
            let spectrum = power_spectrum(block.channel(c), bins);
            power[c].iter_mut().zip(spectrum).for_each(|(sum, p)| *sum += p * got as f64);
        }
        seen += got;
    }
    let levels: Vec<Level> = meters.iter().filter_map(|m| m.level(info.real)).collect();
    let decibels = |p: &f64| 10.0 * (p / seen.max(1) as f64).max(1e-30).log10();
    let spectra_db = power.iter().map(|p| p[bins - COLUMNS..].iter().map(decibels).collect());
    let mut warnings: Vec<String> = source.notes().iter().map(words::note).collect();
    for (c, level) in levels.iter().enumerate() {
        warnings.extend(level.warnings().iter().map(|d| format!("channel {c}: {d}")));
    }
    Ok(Report {
        schema: "sdr-rx-info/1",
        files,
        format: info.format,
        rate_hz: info.rate_hz,
        if_hz: info.if_hz,
        channels: info.channels,
        real: info.real,
        samples: info.samples,
        length_s: info.samples.map(|n| n as f64 / info.rate_hz),
        start_utc: info.start_time.map(|t| t.utc_iso()),
        start_gps: info.start_time.map(|t| (t.week(), t.tow())),
        looked_at_s: seen as f64 / info.rate_hz,
        levels,
        spectra_db: spectra_db.collect(),
        warnings,
    })
}

fn page(report: &Report) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    let out = &mut text;
    for file in &report.files {
        writeln!(out, "file        {file}")?;
    }
    let kind = if report.real { "real" } else { "complex" };
    writeln!(out, "type        {} ({kind})", report.format)?;
    writeln!(out, "rate        {} MHz", report.rate_hz / 1e6)?;
    writeln!(out, "L1 carrier  at {} kHz", report.if_hz / 1e3)?;
    writeln!(out, "channels    {}", report.channels)?;
    match (report.samples, report.length_s) {
        (Some(samples), Some(length)) => {
            writeln!(out, "length      {length} s, {samples} samples")?
        }
        _ => writeln!(out, "length      not known before its end")?,
    }
    if let (Some(utc), Some((week, tow))) = (&report.start_utc, report.start_gps) {
        writeln!(out, "start       {utc}, GPS week {week} tow {tow} s")?;
    }
    for (c, (level, spectrum)) in report.levels.iter().zip(&report.spectra_db).enumerate() {
        write_channel(out, c, level, spectrum, report)?;
    }
    for warning in &report.warnings {
        writeln!(out, "warning     {warning}")?;
    }
    Ok(text)
}

fn write_channel(
    out: &mut String,
    channel: usize,
    level: &Level,
    spectrum: &[f64],
    report: &Report,
) -> std::fmt::Result {
    writeln!(
        out,
        "\nchannel {channel}   level of the first {} s: rms {:.4}, peak {} ({:.2} % of the numbers), \
         mean {:+.4} {:+.4}j, kurtosis {:.2}",
        report.looked_at_s,
        level.rms,
        level.peak,
        100.0 * level.at_peak,
        level.mean_i,
        level.mean_q,
        level.kurtosis,
    )?;
    if let (Some(gain), Some(phase)) = (level.iq_gain_db, level.iq_phase_deg) {
        writeln!(out, "            I against Q {gain:+.2} dB, quadrature error {phase:+.2} deg")?;
    }
    if let Some(values) = &level.values {
        let values: Vec<String> = values
            .iter()
            .map(|(value, fraction)| format!("{value}: {:.1} %", 100.0 * fraction))
            .collect();
        writeln!(out, "            values {}", values.join(", "))?;
    }
    let highest = spectrum.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let lowest = spectrum.iter().copied().fold(f64::INFINITY, f64::min);
    let low = lowest.min(highest - 6.0);
    let from = if report.real { 0.0 } else { -report.rate_hz / 2e6 };
    writeln!(
        out,
        "spectrum    {from} MHz {} {} MHz, {low:.1} to {highest:.1} dB",
        bars(spectrum, low, highest),
        report.rate_hz / 2e6
    )
}

/// One bar of eight heights for each value.
fn bars(values: &[f64], low: f64, high: f64) -> String {
    const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let height = |v: &f64| ((v - low) / (high - low) * 7.0).round().clamp(0.0, 7.0) as usize;
    values.iter().map(|v| BARS[height(v)]).collect()
}
