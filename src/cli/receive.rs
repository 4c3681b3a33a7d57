//! The options common to `process` and `acquire`, and their conversion to the receiver's.

use super::corrections::Corrections;
use super::input::{Input, si_number};
use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};
use sdr_rx::acquisition::SearchOptions;
use sdr_rx::array::{BeamKind, Engine, LookDecision, LookOptions, SparseOptions};
use sdr_rx::capture::StreamInfo;
use sdr_rx::front_end::Suppression;
use sdr_rx::gnss::antenna::ArrayDescription;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::gnss::navigation_data::UtcParameters;
use sdr_rx::gnss::satellite::parse_sv_list;
use sdr_rx::gnss::signal::GPS_L1_CA;
use sdr_rx::gnss::{Constellation, Sv, signal};
use sdr_rx::position::{Observable, PositioningOptions, Solver};
use sdr_rx::receiver::ReceiverOptions;
use std::path::PathBuf;

/// Options of the search.
#[derive(Args, Clone, Debug)]
pub struct Receive {
    /// The capture.
    #[command(flatten)]
    pub input: Input,
    /// Satellites to search, such as G01-G32,J193-J199, or all of a system, such as G,E
    /// [default: G, and of one antenna E where the rate leaves 4 MHz, the band of its signal]
    #[arg(long, value_name = "LIST", value_parser = satellites, help_heading = "Search")]
    pub prn: Option<Satellites>,
    /// Maximum Doppler, Hz, of either sign: satellites make 5k, the oscillator's error adds to it
    #[arg(long, value_name = "HZ", default_value = "5k", value_parser = si_number, help_heading = "Search")]
    pub doppler_max: f64,
    /// Maximum rate of the Doppler, Hz/s, of either sign: satellites in low orbits reach 600
    /// [default: 600 where --doppler-max is above 10k, else 0]
    #[arg(long, value_name = "HZ/S", value_parser = si_number, help_heading = "Search")]
    pub doppler_rate_max: Option<f64>,
    /// Coherent integration of the search, ms, 1 to 20
    #[arg(long, value_name = "MS", default_value_t = 10, help_heading = "Search")]
    pub search_ms: usize,
    /// Windows of that length that the search sums; 16 follow where fewer than 8 satellites are found
    #[arg(long, value_name = "N", default_value_t = 2, help_heading = "Search")]
    pub search_windows: usize,
    /// Probability of a false alarm in the whole search
    #[arg(long, value_name = "P", default_value_t = 1e-3, help_heading = "Search")]
    pub pfa: f64,
    /// Lower the sampling rate by this factor first [default: 1, or what leaves at least 4 MHz]
    #[arg(long, value_name = "N", help_heading = "Search")]
    pub decimate: Option<usize>,
    /// The antenna array of a capture of several channels: ula:8, ura:2x2, uca:8:0.5, or a TOML file
    /// [default: that of the metadata]
    #[arg(long, value_name = "ARRAY", value_parser = array, help_heading = "Array")]
    pub array: Option<ArrayDescription>,
    /// Solver of the sparse problem that looks for sources: the fast one, or LDA-l1,1 as published
    #[arg(long, value_name = "ENGINE", default_value = "admm", help_heading = "Array")]
    pub engine: EngineArg,
    /// Beams to the satellites: to the measured signature, with nulls on detected jammers; or Capon's (MVDR), against
    /// interference too weak to be detected
    #[arg(long, value_name = "KIND", default_value = "conventional", help_heading = "Array")]
    pub beam: BeamArg,
    /// Impulsive noise, and with auto other interference of one antenna too: auto, off, optimal, blank, clip or sign (blank:2.5 sets a threshold, sigma)
    #[arg(long, value_name = "HOW", default_value = "auto", help_heading = "Search")]
    pub suppress: Suppression,
    /// Threads; the result is the same for any number [default: all processors]
    #[arg(short = 'j', long, value_name = "N")]
    pub threads: Option<usize>,
}

/// Options of the position.
#[derive(Args, Clone, Debug)]
pub(super) struct Solve {
    /// RINEX navigation files, in addition to what the signals carry
    #[arg(long, value_name = "FILE", help_heading = "Position")]
    pub nav: Vec<PathBuf>,
    /// How far --time may be off for a snapshot, such as 60, 10min, 5h or 7d; without any time all times
    /// that --nav covers are searched
    #[arg(long, value_name = "S", default_value = "60", value_parser = duration, help_heading = "Position")]
    pub time_uncertainty: f64,
    /// Corrections of the ranges.
    #[command(flatten)]
    pub corrections: Corrections,
    /// The methods of the papers alone, of an array of known geometry: papers is --engine lda with the row rule as the
    /// decision, only the satellites in its sources, --solver aw-dgn-bt and --observable both, with nothing that takes over
    #[arg(
        long,
        value_name = "METHODS",
        conflicts_with_all = ["engine", "solver", "observable"],
        help_heading = "Position"
    )]
    pub method: Option<MethodArg>,
    /// Time between fixes, s
    #[arg(long, value_name = "S", default_value_t = 1.0, help_heading = "Position")]
    pub interval: f64,
    /// Coherent integration of the tracking loops, ms: 1, 2, 4, 5, 10 or 20
    #[arg(long, value_name = "MS", default_value_t = 10, help_heading = "Tracking")]
    pub coherent_ms: usize,
    /// Bandwidth of the phase-locked loop, Hz
    #[arg(long, value_name = "HZ", default_value_t = 15.0, help_heading = "Tracking")]
    pub pll_bw: f64,
    /// Bandwidth of the delay-locked loop, Hz
    #[arg(long, value_name = "HZ", default_value_t = 0.5, help_heading = "Tracking")]
    pub dll_bw: f64,
    /// Window of the carrier smoothing of pseudoranges, s, or off; observation files stay unsmoothed
    #[arg(long, value_name = "S|off", default_value = "100", value_parser = smoothing, help_heading = "Tracking")]
    pub smoothing: Window,
}

/// `--smoothing`: a window, s, or none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window(pub(super) Option<f64>);

/// Reads `--smoothing`.
pub(super) fn smoothing(text: &str) -> Result<Window, String> {
    let window_s = text.parse().ok().filter(|s| (1.0..=3600.0).contains(s));
    match (text, window_s) {
        ("off", _) => Ok(Window(None)),
        (_, Some(window_s)) => Ok(Window(Some(window_s))),
        _ => Err(format!(
            "'{text}' is no window of smoothing: write seconds from 1 to 3600, such as 100, or off"
        )),
    }
}

/// `--method`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MethodArg {
    /// Those of the papers on LDA-l1,1 and AW-DGN-BT.
    Papers,
}

/// A list of satellites.
#[derive(Clone, Debug)]
pub struct Satellites(pub Vec<Sv>);

fn satellites(text: &str) -> Result<Satellites, String> {
    parse_sv_list(text).map(Satellites).map_err(|e| e.to_string())
}

/// A duration, s, of a number with a suffix: `60`, `60s`, `10min`, `5h`, `7d`.
fn duration(text: &str) -> Result<f64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit_s = match &text[digits.len()..] {
        "" | "s" => 1.0,
        "min" => 60.0,
        "h" => 3600.0,
        "d" => 86_400.0,
        unit => return Err(format!("'{unit}' is no unit of time: write s, min, h or d")),
    };
    let number: f64 = digits
        .parse()
        .ok()
        .filter(|n: &f64| n.is_finite())
        .ok_or(format!("'{text}' is no duration: write it as 60, 60s, 10min, 5h or 7d"))?;
    Ok(number * unit_s)
}

fn array(text: &str) -> Result<ArrayDescription, String> {
    ArrayDescription::parse(text).map_err(|e| e.to_string())
}

/// `--engine`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum EngineArg {
    /// Douglas-Rachford splitting.
    Admm,
    /// LDA-l1,1.
    Lda,
}

impl From<EngineArg> for Engine {
    fn from(engine: EngineArg) -> Self {
        match engine {
            EngineArg::Admm => Self::Admm,
            EngineArg::Lda => Self::Lda,
        }
    }
}

/// `--beam`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum BeamArg {
    /// Matched to the signature.
    Conventional,
    /// Minimum output power.
    Mvdr,
}

impl From<BeamArg> for BeamKind {
    fn from(beam: BeamArg) -> Self {
        match beam {
            BeamArg::Conventional => Self::Conventional,
            BeamArg::Mvdr => Self::Mvdr,
        }
    }
}

/// Minimum rate after automatic decimation, Hz.
const ENOUGH_RATE_HZ: f64 = 4e6;

impl Receive {
    /// Sets the number of threads.
    pub fn start_threads(&self) -> anyhow::Result<()> {
        let threads = self.threads.unwrap_or(0);
        ensure!(threads <= 1024, "-j {threads}: 1 to 1024 threads, or none for all processors");
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("starting threads")
    }

    /// Refuses values that no search can have.
    fn check(&self, rate_hz: f64) -> anyhow::Result<()> {
        ensure!((1..=20).contains(&self.search_ms), "--search-ms must be 1 to 20");
        ensure!(
            (1..=100_000).contains(&self.search_windows),
            "--search-windows must be 1 to 100000: windows of --search-ms that are summed"
        );
        ensure!(
            (1.0..=500e3).contains(&self.doppler_max.abs()),
            "--doppler-max must be 1 Hz to 500 kHz: satellites make 5k, the oscillator's error adds to it"
        );
        ensure!(
            self.doppler_rate_max.is_none_or(|rate| rate.abs() <= 10e3),
            "--doppler-rate-max must be at most 10k Hz/s: satellites in low orbits reach 600"
        );
        ensure!(self.pfa > 0.0 && self.pfa < 1.0, "--pfa must be a probability between 0 and 1");
        let most = (rate_hz / GPS_L1_CA.chip_rate_hz) as usize;
        ensure!(
            self.decimate.is_none_or(|factor| (1..=most.max(1)).contains(&factor)),
            "--decimate must be 1 to {}: {rate_hz:.0} Hz over it must not fall below the chip rate, 1.023 MHz",
            most.max(1)
        );
        Ok(())
    }

    /// The receiver's options for a stream.
    ///
    /// # Errors
    /// Which option no search can have.
    pub fn options(&self, info: &StreamInfo) -> anyhow::Result<ReceiverOptions> {
        self.check(info.rate_hz)?;
        let automatic = ((info.rate_hz / ENOUGH_RATE_HZ) as usize).max(1);
        let decimation = self.decimate.unwrap_or(automatic);
        let holds_galileo = info.rate_hz / decimation as f64 >= ENOUGH_RATE_HZ;
        let galileo =
            Sv::all(Constellation::Galileo).filter(|_| holds_galileo && info.channels == 1);
        let satellites = match &self.prn {
            Some(asked) => asked.0.clone(),
            None => Sv::all_gps().chain(galileo).collect(),
        };
        let low_orbit_rate = if self.doppler_max.abs() > 10e3 { 600.0 } else { 0.0 };
        Ok(ReceiverOptions {
            search: SearchOptions {
                satellites: satellites.into_iter().map(signal::of).collect(),
                doppler_hz: (-self.doppler_max.abs(), self.doppler_max.abs()),
                doppler_rate_hz_s: self.doppler_rate_max.unwrap_or(low_orbit_rate).abs(),
                coherent_ms: self.search_ms,
                max_windows: self.search_windows,
                false_alarm: self.pfa,
            },
            time: info.start_time,
            array: self.array.clone().or(info.array.clone()),
            look: LookOptions {
                sparse: SparseOptions { engine: self.engine.into(), ..SparseOptions::default() },
                ..LookOptions::default()
            },
            beams: self.beam.into(),
            suppression: self.suppress,
            decimation,
            ..ReceiverOptions::default()
        })
    }
}

/// The options that decide the result, for the record.
pub fn echo(options: &ReceiverOptions) -> serde_json::Value {
    serde_json::json!({
        "satellites": options.search.satellites.iter().map(|t| t.sv).collect::<Vec<_>>(),
        "doppler_hz": options.search.doppler_hz,
        "search_ms": options.search.coherent_ms,
        "search_windows": options.search.max_windows,
        "pfa": options.search.false_alarm,
        "array": options.array,
        "decision": options.array.as_ref().map(|_| format!("{:?}", options.look.decision).to_lowercase()),
        "searches_rest": options.searches_rest,
        "takes_over": options.positioning.takes_over,
        "engine": options.array.as_ref().map(|_| format!("{:?}", options.look.sparse.engine).to_lowercase()),
        "beam": format!("{:?}", options.beams).to_lowercase(),
        "suppress": options.suppression.to_string(),
        "decimation": options.decimation,
        "coherent_ms": options.tracking.coherent_ms,
        "pll_hz": options.tracking.pll_hz,
        "dll_hz": options.tracking.dll_hz,
        "smoothing_s": options.smoothing_s,
        "interval_s": options.interval_s,
        "observable": options.positioning.observable,
        "systems": options.positioning.systems.to_string(),
        "solver": options.positioning.solver.to_string(),
        "troposphere": options.positioning.troposphere,
        "elevation_mask_deg": options.positioning.elevation_mask.to_degrees(),
        "time_uncertainty_s": options.time.map(|_| options.positioning.time_uncertainty_s),
    })
}

impl Solve {
    /// Checks the options and adds them to the receiver's.
    pub fn apply(&self, options: &mut ReceiverOptions) -> anyhow::Result<()> {
        let check = |ok: bool, what: &str| if ok { Ok(()) } else { Err(anyhow::anyhow!("{what}")) };
        check(
            [1, 2, 4, 5, 10, 20].contains(&self.coherent_ms),
            "--coherent-ms must divide a data bit: 1, 2, 4, 5, 10 or 20",
        )?;
        check(
            self.pll_bw > 0.0 && self.pll_bw <= 100.0,
            "--pll-bw must be above 0 and at most 100 Hz",
        )?;
        check(
            self.dll_bw > 0.0 && self.dll_bw <= 20.0,
            "--dll-bw must be above 0 and at most 20 Hz",
        )?;
        check(
            self.interval >= 0.01 && self.interval.is_finite(),
            "--interval must be 0.01 s or more",
        )?;
        check(self.time_uncertainty > 0.0, "--time-uncertainty must be above 0")?;
        for path in &self.nav {
            let file = rinex_nav::read(path)?;
            file.left_out.kinds().iter().for_each(|kind| eprintln!("warning: {kind}"));
            options.navigation.merge(file.data);
        }
        options.navigation.utc.iter().for_each(UtcParameters::announce);
        options.interval_s = self.interval;
        options.tracking.coherent_ms = self.coherent_ms;
        options.tracking.pll_hz = self.pll_bw;
        options.tracking.dll_hz = self.dll_bw;
        options.smoothing_s = self.smoothing.0;
        options.positioning = PositioningOptions {
            time_uncertainty_s: self.time_uncertainty,
            ..self.corrections.options()?
        };
        if let Some(MethodArg::Papers) = self.method {
            check(
                options.array.is_some(),
                "--method papers finds satellites by their directions: give the array's geometry by --array",
            )?;
            options.look.sparse.engine = Engine::Lda;
            options.look.decision = LookDecision::Rows;
            options.searches_rest = false;
            options.positioning.solver = Solver::AwDgnBt;
            options.positioning.takes_over = false;
            options.positioning.observable = Observable::Both;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_units() {
        assert_eq!(duration("90"), Ok(90.0));
        assert_eq!(duration("0.5s"), Ok(0.5));
        assert_eq!(duration("10min"), Ok(600.0));
        assert_eq!(duration("5h"), Ok(18_000.0));
        assert_eq!(duration("7d"), Ok(604_800.0));
        for wrong in ["", "h", "5 h", "5m", "inf", "nan", "5hours"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn windows_of_smoothing_are_seconds_or_off() {
        assert_eq!(smoothing("100"), Ok(Window(Some(100.0))));
        assert_eq!(smoothing("off"), Ok(Window(None)));
        for wrong in ["", "0", "-5", "0.5", "nan", "inf", "1e9", "on", "100s"] {
            assert!(smoothing(wrong).is_err_and(|e| e.contains("seconds from 1")), "{wrong}");
        }
    }
}
