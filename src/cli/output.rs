//! Output of `process` and `acquire`.

use super::progress;
use super::receive::Receive;
use super::words;
use indicatif::ProgressBar;
use sdr_rx::acquisition::{Acquisition, Refined};
use sdr_rx::advice::{self, Advice, Reading};
use sdr_rx::capture::{self, StreamInfo};
use sdr_rx::position::Fix;
use sdr_rx::receiver::{ReceiverOptions, Record};
use sdr_rx::report::{self, OutputDir, Reference, Run};
use sdr_rx::scenario::Scenario;
use sdr_rx::scenario::receiver::Trajectory;
use std::io::Write;
use std::path::Path;

/// A record with the names of its inputs.
pub struct Printed<'a> {
    pub receive: &'a Receive,
    pub info: &'a StreamInfo,
    /// Rate of the samples that the record counts, Hz.
    pub rate_hz: f64,
    pub record: &'a Record,
    /// Whether the stream was ended before its end.
    pub interrupted: bool,
    pub advice: Vec<Advice>,
    /// Options, for the record.
    pub options: serde_json::Value,
}

impl Printed<'_> {
    /// The JSON object to `json`, or the tables to standard output where they are wanted; warnings to standard
    /// error.
    pub fn print(&self, json: Option<&Path>, shown: bool, fixes: bool) -> anyhow::Result<()> {
        let tables = |run: &Run| if shown { tables(run, fixes) } else { String::new() };
        self.with_run(|run| emit(run, json, tables(run)))
    }

    /// All reports into a folder.
    pub fn write_files(&self, folder: &OutputDir, page: bool) -> anyhow::Result<()> {
        self.with_run(|run| {
            report::write_all(run, folder, page)?;
            Ok(())
        })
    }

    /// Samples at the receiver's rate: those of the stream where their number is known, else those received.
    fn samples(&self) -> Option<u64> {
        let promised =
            self.info.samples.map(|n| (n as f64 * self.rate_hz / self.info.rate_hz) as u64);
        promised.filter(|_| !self.interrupted).or(Some(self.record.samples))
    }

    /// Where the receiver of a scenario is at each fix.
    fn truth(&self, scenario: &Scenario, rate_hz: f64) -> Reference<'static> {
        let trajectory = Trajectory::new(&scenario.receiver, scenario.start);
        let place = |fix: &Fix| trajectory.state(fix.sample / rate_hz).position_m;
        Reference {
            positions_m: self.record.fixes.iter().map(place).collect(),
            source: "the scenario",
        }
    }

    fn with_run<T>(&self, then: impl FnOnce(&Run) -> anyhow::Result<T>) -> anyhow::Result<T> {
        let acquisitions: Vec<Acquisition> =
            self.record.acquisitions.iter().map(|r| r.acquisition).collect();
        // Samples are counted at the receiver's rate.
        let stream =
            StreamInfo { rate_hz: self.rate_hz, samples: self.samples(), ..self.info.clone() };
        let notices = self.record.notices.iter().map(words::notice);
        let warnings: Vec<String> = notices.chain(self.advice.iter().map(words::advised)).collect();
        let reason = self.record.reason.as_ref().map(words::reason);
        let scenario = self.receive.input.scenario()?;
        then(&Run {
            capture: &self.receive.input.name(),
            input: report::Input::Samples(&stream),
            acquisitions: &acquisitions,
            sky: self.record.sky.as_ref(),
            sky_epochs: &self.record.sky_epochs,
            epochs: &self.record.epochs,
            fixes: &self.record.fixes,
            navigation: &self.record.navigation,
            sbas: &self.record.sbas,
            noise: self.record.noise.as_ref(),
            interferers: &self.record.interferers,
            warnings: &warnings,
            reason: reason.as_deref(),
            first_fix_s: self.record.first_fix_s,
            reference: scenario.as_ref().map(|s| self.truth(s, stream.rate_hz)),
            seed: scenario.as_ref().map(|scenario| scenario.seed),
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

fn tables(run: &Run, fixes: bool) -> String {
    let mut text = report::acquisition_table(run.acquisitions);
    text += &report::noise_line(run);
    if let Some(sky) = run.sky {
        text += "\n";
        text += &report::array_sky_table(sky);
    }
    if fixes {
        text += "\n";
        text += &report::fix_table(run);
        let in_view = report::satellites_in_view(run);
        if !run.fixes.is_empty() {
            text += "\n";
            text += &report::sky_plot_text(&in_view);
        }
    }
    text
}

/// Where almost nothing was found in a file: the probable cause.
pub fn advise(receive: &Receive, options: &ReceiverOptions, record: &Record) -> Vec<Advice> {
    let sound = |r: &&Refined| r.acquisition.cn0_dbhz >= advice::SOUND_DBHZ;
    let found = record.acquisitions.iter().filter(sound).count();
    let enough = advice::FEW.min(options.search.satellites.len());
    let has_tracks = !record.fixes.is_empty()
        || record.epochs.iter().any(|epoch| epoch.observations.len() >= advice::FEW);
    if found >= enough || has_tracks || receive.input.is_stream() {
        return Vec::new();
    }
    let open = |reading: &Reading| {
        let mut open = receive.input.options();
        open.duration_s = Some(advice::LOOK_S);
        reading.apply(&mut open);
        capture::open(&receive.input.captures, &open).ok()
    };
    let searched = options.search.by_code().into_iter().next();
    let Some(searched) = searched else { return Vec::new() };
    let bar = progress::thousandths().unwrap_or_else(|_| ProgressBar::hidden());
    let advice = advice::advise(&open, &searched, found, &mut |part| {
        bar.set_position((1000.0 * part) as u64);
    });
    bar.finish_and_clear();
    advice
}
