//! `sdr-rx simulate`: a capture with known truth.

use super::interrupt::Interrupt;
use super::protect::protect;
use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use sdr_rx::capture::{Block, Datatype, SampleSource, SigmfWriter};
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::report::write_atomically;
use sdr_rx::scenario::config::Orbits;
use sdr_rx::scenario::{RawFormat, RawWriter, Scenario, ScenarioSource};
use sdr_rx::temporary::temporary_beside;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Suffixes of what is written beside the samples.
const NAVIGATION: &str = "nav.rnx";
const TRUTH: &str = "truth.json";
/// Samples of all channels together, generated at a time.
const BLOCK: usize = 1 << 18;

/// Make a capture with known truth from a scenario
///
/// The samples are those of GPS L1 C/A by IS-GPS-200, of each element where the scenario has an
/// array. Beside them are written the truth (NAME.truth.json) and the satellites' ephemerides
/// (NAME.nav.rnx, for `process --nav`). Files appear under their names when complete.
///
/// Example: sdr-rx simulate signals/static_8sv.toml --out static.sigmf-meta
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Simulate {
    /// The scenario, a TOML file (see docs/scenario.md)
    #[arg(value_name = "SCENARIO.toml")]
    scenario: PathBuf,
    /// NAME.sigmf-meta (samples in NAME.sigmf-data), or raw samples in NAME.cs8, .cs16, .cf32 or .b1, or -
    /// for raw samples on standard output in the scenario's own type, and nothing beside them
    #[arg(long, value_name = "CAPTURE")]
    out: PathBuf,
    /// Seconds to make, in place of the scenario's duration_s
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Replace files that sdr-rx did not write
    #[arg(long)]
    force: bool,
    /// Seed of all random draws, in place of the scenario's
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

/// Simulates the capture.
pub fn run(args: &Simulate) -> anyhow::Result<ExitCode> {
    let mut scenario = Scenario::read(&args.scenario)?;
    let beside = ["sigmf-data", NAVIGATION, TRUTH].map(|suffix| args.out.with_extension(suffix));
    let mut inputs = vec![args.scenario.clone()];
    if let Orbits::NavigationFile(path) = &scenario.orbits {
        inputs.push(path.clone());
        let left_out = rinex_nav::read(path)?.left_out;
        left_out.kinds().iter().for_each(|kind| eprintln!("warning: {kind}"));
    }
    let outputs = [&args.out].into_iter().chain(&beside).map(PathBuf::as_path);
    protect(outputs.take(if args.out == Path::new("-") { 0 } else { 4 }), &inputs, args.force)?;
    if let Some(duration) = args.duration {
        if !(duration > 0.0 && duration.is_finite()) {
            bail!("--duration {duration}: seconds to make must be above 0");
        }
        scenario.duration_s = duration;
    }
    scenario.seed = args.seed.unwrap_or(scenario.seed);
    let mut source = ScenarioSource::new(&scenario)?;
    if args.out == Path::new("-") {
        let format = RawFormat::from_suffix(&source.info().format)
            .context("--out -: real samples are written as SigMF only: give NAME.sigmf-meta")?;
        let mut writer = RawWriter::new(io::stdout().lock(), format);
        let written = copy(&mut source, |block| Ok(writer.write(block)?));
        // A reader may close the pipe: that is no failure.
        return match written.and_then(|()| Ok(writer.finish().map(drop)?)) {
            Err(e) if is_broken_pipe(&e) => Ok(ExitCode::SUCCESS),
            other => other.map(|()| ExitCode::SUCCESS),
        };
    }
    let suffix = args.out.extension().and_then(|s| s.to_str()).unwrap_or_default();
    if suffix == "sigmf-meta" {
        let datatype = match source.info().format.trim_start_matches(['c', 'r']) {
            "s8" => Datatype::I8,
            "s16" => Datatype::I16,
            _ => Datatype::F32,
        };
        let mut writer =
            SigmfWriter::create(&args.out, source.info(), datatype, &scenario.description)?;
        copy(&mut source, |block| Ok(writer.write(block)?))?;
        write_beside(&args.out, &source)?;
        writer.finish()?;
    } else {
        let format = RawFormat::from_suffix(suffix).filter(|_| !scenario.front_end.real);
        let format = format.with_context(|| {
            format!(
                "--out '{}': the name must end in .sigmf-meta, or for complex samples in .cs8, .cs16, \
                 .cf32 or .b1",
                args.out.display()
            )
        })?;
        let failed = || format!("writing '{}'", args.out.display());
        let file = temporary_beside(&args.out).with_context(failed)?;
        let mut writer = RawWriter::new(file, format);
        copy(&mut source, |block| writer.write(block).with_context(failed))?;
        let file = writer.finish().with_context(failed)?;
        write_beside(&args.out, &source)?;
        file.persist(&args.out).with_context(failed)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Takes all samples of the source, with a progress bar where standard error is a terminal.
fn copy(
    source: &mut ScenarioSource,
    mut write: impl FnMut(&Block) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let samples = source.info().samples.unwrap_or(0);
    let at_a_time = BLOCK / source.info().channels;
    let bar = if io::stderr().is_terminal() {
        ProgressBar::new(samples)
            .with_style(ProgressStyle::with_template("{bar:40} {percent} %, {eta} left")?)
    } else {
        ProgressBar::hidden()
    };
    let interrupt = Interrupt::new().context("waiting for Ctrl-C")?;
    let mut block = Block::default();
    loop {
        if interrupt.pressed() {
            // Files that are not complete go with the error.
            bail!("interrupted: nothing was written");
        }
        let read = source.read(&mut block, at_a_time).map_err(|e| anyhow::anyhow!(e))?;
        if read == 0 {
            bar.finish_and_clear();
            return Ok(());
        }
        write(&block)?;
        bar.inc(read as u64);
    }
}

/// Writes the truth as NAME.truth.json and the ephemerides as NAME.nav.rnx beside the capture.
fn write_beside(out: &Path, source: &ScenarioSource) -> anyhow::Result<()> {
    let mut text = serde_json::to_vec_pretty(&source.truth())?;
    text.push(b'\n');
    let navigation = rinex_nav::write(&source.scenario().navigation()?);
    write_atomically(&out.with_extension(NAVIGATION), navigation.as_bytes())?;
    Ok(write_atomically(&out.with_extension(TRUTH), &text)?)
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let kind = error.downcast_ref::<io::Error>().map(io::Error::kind);
    kind == Some(io::ErrorKind::BrokenPipe)
}
