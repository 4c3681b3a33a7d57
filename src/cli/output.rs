//! How `process` and `acquire` print and write what they found.

use super::receive::Receive;
use super::words;
use sdr_rx::acquisition::{Acquisition, Refined};
use sdr_rx::advice::{self, Reading};
use sdr_rx::capture::{self, StreamInfo};
use sdr_rx::receiver::{Outcome, ReceiverOptions};
use sdr_rx::report::{self, OutputDir, Run};
use std::io::Write;
use std::path::Path;

/// An outcome with the names that a person gave things.
pub struct Printed<'a> {
    pub receive: &'a Receive,
    pub info: &'a StreamInfo,
    pub decimation: usize,
    pub outcome: &'a Outcome,
    /// Options as they are echoed.
    pub options: serde_json::Value,
}

impl Printed<'_> {
    /// The JSON object to `json`, or the tables to standard output; warnings to standard error.
    pub fn print(&self, json: Option<&Path>, fixes: bool) -> anyhow::Result<()> {
        self.with_run(|run| emit(run, json, tables(run, self.outcome, fixes)))
    }

    /// All reports into a folder.
    pub fn write_files(&self, folder: &Path, page: bool) -> anyhow::Result<()> {
        self.with_run(|run| {
            report::write_all(run, &OutputDir::create(folder)?, page)?;
            Ok(())
        })
    }

    fn with_run<T>(&self, then: impl FnOnce(&Run) -> anyhow::Result<T>) -> anyhow::Result<T> {
        let names: Vec<String> = self
            .receive
            .input
            .captures
            .iter()
            .map(|p| p.file_name().unwrap_or(p.as_os_str()).display().to_string())
            .collect();
        let acquisitions: Vec<Acquisition> =
            self.outcome.acquisitions.iter().map(|r| r.acquisition).collect();
        // Samples are counted at the receiver's rate, after decimation.
        let stream = StreamInfo {
            rate_hz: self.info.rate_hz / self.decimation as f64,
            samples: self.info.samples.map(|n| n / self.decimation as u64),
            ..self.info.clone()
        };
        then(&Run {
            capture: &names.join(" "),
            input: report::Input::Samples(&stream),
            acquisitions: &acquisitions,
            sky: self.outcome.sky.as_ref(),
            sky_epochs: &self.outcome.sky_epochs,
            epochs: &self.outcome.epochs,
            fixes: &self.outcome.fixes,
            navigation: &self.outcome.navigation,
            noise: self.outcome.noise.as_ref(),
            warnings: &self.outcome.warnings,
            reason: self.outcome.reason.as_deref(),
            first_fix_s: self.outcome.first_fix_s,
            reference: None,
            seed: self.receive.input.scenario()?.map(|scenario| scenario.seed),
            options: self.options.clone(),
        })
    }
}

/// The JSON object of a run to `json`, or `tables` to standard output; warnings to standard error.
pub fn emit(run: &Run, json: Option<&Path>, tables: String) -> anyhow::Result<()> {
    let to_stdout = json == Some(Path::new("-"));
    if let Some(path) = json.filter(|_| !to_stdout) {
        report::write_atomically(path, report::json(run).as_bytes())?;
    }
    let text = if to_stdout { report::json(run) } else { tables };
    for warning in run.warnings {
        eprintln!("warning: {warning}");
    }
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}

fn tables(run: &Run, outcome: &Outcome, fixes: bool) -> String {
    let mut text = report::acquisition_table(run.acquisitions);
    text += &report::noise_line(run);
    if let Some(sky) = run.sky {
        text += "\n";
        text += &report::array_sky_table(sky);
    }
    if fixes {
        text += "\n";
        text += &report::fix_table(run);
        let sky = report::sky(run);
        if !outcome.fixes.is_empty() {
            text += "\n";
            text += &report::sky_text(&sky);
        }
    }
    text
}

/// When next to nothing was found: tries how else the capture might be meant to be read, and says so.
pub fn advise(receive: &Receive, options: &ReceiverOptions, outcome: &mut Outcome) {
    let sound = |r: &&Refined| r.acquisition.cn0_dbhz >= advice::SOUND_DBHZ;
    let found = outcome.acquisitions.iter().filter(sound).count();
    if found >= advice::FEW || receive.input.is_standard_input() {
        return;
    }
    let open = |reading: &Reading| {
        let mut open = receive.input.options();
        open.duration_s = Some(advice::LOOK_S);
        reading.apply(&mut open);
        capture::open(&receive.input.captures, &open).ok()
    };
    let advised = advice::advise(&open, &options.search, found);
    outcome.warnings.extend(advised.iter().map(words::advised));
}
