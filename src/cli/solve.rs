//! `sdr-rx solve`: positions from RINEX observations.

use super::corrections::Corrections;
use super::output;
use super::protect::{protect, protect_folder};
use anyhow::{Context, ensure};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use nalgebra::Vector3;
use rayon::prelude::*;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::gnss::format::rinex_obs::{self, ObservationHeader};
use sdr_rx::gnss::format::{rinex_nav, sp3};
use sdr_rx::gnss::navigation_data::UtcParameters;
use sdr_rx::gnss::observation::ObservationEpoch;
use sdr_rx::gnss::{GpsTime, NavigationData};
use sdr_rx::position::solver::point_solution::{Iteration, trace_csv};
use sdr_rx::position::{
    Exclusion, Fix, Height, PositioningError, PositioningOptions, Robust, Sequence, candidates,
    solve_static,
};
use sdr_rx::report::{self, Input, OutputDir, Reference, Run};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Epochs that are read and then solved together, on all processors.
const CHUNK: usize = 256;

/// Positions from RINEX observations (versions 2 to 4, compact or not; L1 of GPS, QZSS, Galileo, BeiDou, GLONASS)
///
/// From the Earth's centre, epoch by epoch, with broadcast or SP3 orbits. Files may be packed by gzip or compress. What `sdr-rx process
/// signals/static_8sv.toml --out fix` writes are such files:
///
/// Example: sdr-rx solve fix/SDRX00XXX_S_20220010200_39S_01S_MO.rnx fix/navigation.rnx
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Solve {
    /// The observations
    #[arg(value_name = "OBS.rnx")]
    observations: PathBuf,
    /// RINEX navigation files: ephemerides and ionosphere
    #[arg(value_name = "NAV.rnx")]
    navigation: Vec<PathBuf>,
    /// Precise orbits and clocks, used instead of broadcast ones while they are valid
    #[arg(long, value_name = "FILE")]
    sp3: Vec<PathBuf>,
    /// The receiver is at rest: one position from all epochs
    #[arg(long = "static", help_heading = "Position")]
    at_rest: bool,
    /// Weights of outliers
    #[arg(long, value_name = "WEIGHTS", default_value = "none", help_heading = "Position")]
    robust: RobustArg,
    /// What to do when the satellites' observations are inconsistent
    #[arg(long, value_name = "HOW", default_value = "chi-square", help_heading = "Position")]
    exclusion: ExclusionArg,
    #[command(flatten)]
    corrections: Corrections,
    /// The height is known: metres above WGS 84, and their standard deviation, such as 560:10
    #[arg(long, value_name = "M:SIGMA", value_parser = height, allow_hyphen_values = true, help_heading = "Position")]
    height: Option<Height>,
    /// Leave out satellites whose C/N0 is lower, dB-Hz: what receivers report below 28 may be noise
    #[arg(long, value_name = "DBHZ", default_value_t = 28.0, help_heading = "Position")]
    min_cn0: f64,
    /// True position, deg, deg, m above WGS 84, to compare with [default: APPROX POSITION of the file]
    #[arg(long, value_name = "LAT,LON,H", value_parser = position, allow_hyphen_values = true, help_heading = "Output")]
    reference: Option<Geodetic>,
    /// Write result.json, RINEX, NMEA, GeoJSON and KML files into this folder
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Write the result as one JSON object to a file, or - for standard output
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true, default_missing_value = "-", help_heading = "Output")]
    json: Option<PathBuf>,
    /// Replace files that sdr-rx did not write
    #[arg(long, help_heading = "Output")]
    force: bool,
    /// Add a page with plots, report.html, to --out
    #[arg(long, requires = "out", help_heading = "Output")]
    report: bool,
    /// Write each step of the solver, of every epoch and set of satellites tried, as CSV
    #[arg(long, value_name = "FILE.csv", help_heading = "Output")]
    trace: Option<PathBuf>,
    /// Threads; the result is the same for any number [default: all processors]
    #[arg(short = 'j', long, value_name = "N")]
    threads: Option<usize>,
}

/// `--robust`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum RobustArg {
    /// Plain least squares.
    None,
    /// Huber.
    Huber,
    /// IGG-III.
    Igg3,
}

/// `--exclusion`.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum ExclusionArg {
    /// Exclude satellites until the residuals pass the test, or refuse the epoch.
    ChiSquare,
    /// Refuse the epoch.
    Refuse,
    /// No test.
    Off,
}

fn height(text: &str) -> Result<Height, String> {
    let numbers = text.split_once(':').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    match numbers {
        Some((height_m, sigma_m)) if f64::is_finite(height_m) && sigma_m > 0.0 => {
            Ok(Height { height_m, sigma_m })
        }
        _ => Err(format!("'{text}' is no height: write metres and standard deviation as 560:10")),
    }
}

fn position(text: &str) -> Result<Geodetic, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[latitude, longitude, height])
            if latitude.abs() <= 90.0 && longitude.abs() <= 360.0 && height.is_finite() =>
        {
            Ok(Geodetic::from_degrees(latitude, longitude, height))
        }
        _ => Err(format!("'{text}' is no position: write degrees and metres as 48.137,11.575,560")),
    }
}

impl Solve {
    fn options(&self) -> anyhow::Result<PositioningOptions> {
        Ok(PositioningOptions {
            robust: match self.robust {
                RobustArg::None => Robust::None,
                RobustArg::Huber => Robust::Huber,
                RobustArg::Igg3 => Robust::Igg3,
            },
            exclusion: match self.exclusion {
                ExclusionArg::ChiSquare => Exclusion::ChiSquare,
                ExclusionArg::Refuse => Exclusion::Refuse,
                ExclusionArg::Off => Exclusion::Off,
            },
            height: self.height,
            min_cn0_dbhz: Some(self.min_cn0),
            ..self.corrections.options()?
        })
    }

    fn navigation(&self, warnings: &mut Vec<String>) -> anyhow::Result<NavigationData> {
        ensure!(
            !(self.navigation.is_empty() && self.sp3.is_empty()),
            "no orbits are given: name a RINEX navigation file after the observations, or --sp3 FILE"
        );
        let mut navigation = NavigationData::default();
        for path in &self.navigation {
            let file = rinex_nav::read(path)?;
            warnings.extend(file.left_out.kinds().iter().map(ToString::to_string));
            if file.data.is_empty() {
                warnings.push(format!(
                    "{}: no ephemeris is in it that is known here; {} other records were skipped",
                    path.display(),
                    file.skipped
                ));
            }
            navigation.merge(file.data);
        }
        for path in &self.sp3 {
            let file = sp3::read(path)?;
            warnings.extend(file.left_out.kinds().iter().map(ToString::to_string));
            let short: Vec<String> = file
                .orbits
                .iter()
                .filter_map(|(sv, orbit)| {
                    orbit.too_few().map(|(n, of)| format!("{sv} {n} of {of}"))
                })
                .collect();
            if !short.is_empty() {
                warnings.push(format!(
                    "{}: precise orbits with too few points are not used ({})",
                    path.display(),
                    short.join(", ")
                ));
            }
            navigation.merge(file.into_navigation_data());
        }
        Ok(navigation)
    }
}

/// The solutions of a file.
#[derive(Default)]
struct Solved {
    epochs: Vec<ObservationEpoch>,
    fixes: Vec<Fix>,
    sequence: Sequence,
    /// Epochs without a position.
    refused: Vec<(GpsTime, PositioningError)>,
    trace: String,
    warnings: Vec<String>,
}

impl Solved {
    /// Keeps the steps of an epoch's solver under its time.
    fn add_trace(&mut self, time: GpsTime, steps: &[Iteration]) {
        let csv = trace_csv(steps);
        let mut lines = csv.lines();
        let head = lines.next().unwrap_or_default();
        if self.trace.is_empty() {
            self.trace = format!("gps_week,tow_s,{head}\n");
        }
        for line in lines {
            self.trace += &format!("{},{:.3},{line}\n", time.week(), time.tow());
        }
    }
}

/// Solves, prints and writes. Exit code 1 when there is no fix that redundant observations prove.
pub fn run(args: &Solve) -> anyhow::Result<ExitCode> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads.unwrap_or(0))
        .build_global()
        .context("starting threads")?;
    let inputs =
        [&args.navigation[..], &args.sp3, std::slice::from_ref(&args.observations)].concat();
    let outputs = args.json.iter().chain(&args.trace).map(PathBuf::as_path);
    protect(outputs, &inputs, args.force)?;
    let folder = args.out.as_ref().map(OutputDir::create).transpose()?;
    if let Some(folder) = &folder {
        folder.check()?;
        protect_folder(folder, &inputs, args.force)?;
    }
    let options = args.options()?;
    let mut told = Vec::new();
    let mut navigation = args.navigation(&mut told)?;
    navigation.utc.iter().for_each(UtcParameters::announce);
    let (header, solved) = solve(args, &mut navigation, &options)?;
    let reason = match solved.refused.first() {
        _ if !solved.fixes.is_empty() => None,
        Some((_, error)) => Some(error.to_string()),
        None => Some("the file holds no epoch".to_owned()),
    };
    let mut warnings = told;
    warnings.extend(solved.warnings);
    if let (Some((time, error)), None) = (solved.refused.first(), &reason) {
        let count = solved.refused.len();
        warnings.push(format!(
            "{count} of {} epochs have no position; the first, {}: {error}",
            solved.epochs.len(),
            time.utc_iso()
        ));
    }
    let approximate = header.approximate_position_m.map(|marker| {
        let [up, east, north] = header.antenna_uen_m.into();
        let enu = Geodetic::from_ecef(&marker).ecef_to_enu();
        (marker + enu.transpose() * Vector3::new(east, north, up), "APPROX POSITION of the file")
    });
    let given = args.reference.map(|position| (position.to_ecef(), "--reference"));
    let reference = given
        .or(approximate)
        .map(|(position_m, source)| Reference { positions_m: vec![position_m], source });
    let name = args.observations.file_name().unwrap_or(args.observations.as_os_str());
    let run = Run {
        capture: &name.display().to_string(),
        input: Input::Observations { version: header.version },
        acquisitions: &[],
        sky: None,
        sky_epochs: &[],
        epochs: &solved.epochs,
        fixes: &solved.fixes,
        navigation: &navigation,
        sbas: &[],
        noise: None,
        interferers: &[],
        warnings: &warnings,
        reason: reason.as_deref(),
        first_fix_s: solved.fixes.first().map(|fix| fix.sample),
        reference,
        seed: None,
        options: serde_json::json!({
            "observable": options.observable,
            "solver": options.solver.to_string(),
            "systems": options.systems.to_string(),
            "static": args.at_rest,
            "robust": options.robust,
            "exclusion": options.exclusion,
            "height": options.height,
            "troposphere": options.troposphere,
            "min_cn0_dbhz": options.min_cn0_dbhz,
            "elevation_mask_deg": options.elevation_mask.to_degrees(),
        }),
    };
    if let Some(path) = &args.trace {
        report::write_atomically(path, solved.trace.as_bytes())?;
    }
    if let Some(folder) = &folder {
        report::write_all(&run, folder, args.report)?;
    }
    let mut text = report::fix_table(&run);
    if !solved.fixes.is_empty() {
        text += "\n";
        text += &report::sky_plot_text(&report::satellites_in_view(&run));
    }
    output::emit(&run, args.json.as_deref(), text)?;
    let proved = solved.fixes.iter().any(|fix| fix.integrity.is_proved());
    Ok(if proved { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Reads the file and solves its epochs.
fn solve(
    args: &Solve,
    navigation: &mut NavigationData,
    options: &PositioningOptions,
) -> anyhow::Result<(ObservationHeader, Solved)> {
    let mut reader = rinex_obs::open(&args.observations)?;
    navigation.glonass_channels.extend(reader.header().glonass_channels.clone());
    let navigation = &*navigation;
    let bar = bar(&args.observations);
    let mut solved = Solved::default();
    loop {
        let chunk: Vec<ObservationEpoch> = reader.by_ref().take(CHUNK).collect::<Result<_, _>>()?;
        if chunk.is_empty() {
            break;
        }
        if !args.at_rest {
            solve_chunk(&chunk, navigation, options, args.trace.is_some(), &mut solved);
        }
        solved.epochs.extend(chunk);
        bar.set_position(reader.bytes());
    }
    bar.finish_and_clear();
    if args.at_rest {
        let mut steps: Vec<(usize, Iteration)> = Vec::new();
        let keep = args.trace.is_some();
        let mut trace = |epoch: usize, step: &Iteration| {
            if keep {
                steps.push((epoch, step.clone()));
            }
        };
        let time = |k: usize| solved.epochs[k].receive_time;
        match solve_static(&solved.epochs, navigation, options, &mut trace) {
            Ok((fix, refused)) => {
                solved.refused = refused.into_iter().map(|(k, error)| (time(k), error)).collect();
                solved.fixes = vec![fix];
            }
            Err(error) if solved.epochs.is_empty() => drop(error),
            Err(error) => solved.refused = vec![(time(0), error)],
        }
        for steps in steps.chunk_by(|a, b| a.0 == b.0) {
            let time = solved.epochs[steps[0].0].receive_time;
            let steps: Vec<Iteration> = steps.iter().map(|s| s.1.clone()).collect();
            solved.add_trace(time, &steps);
        }
    }
    if reader.skipped() > 0 {
        solved.warnings.push(format!(
            "{} satellites of epochs were skipped: of other systems, or without code and Doppler on L1",
            reader.skipped()
        ));
    }
    solved.warnings.extend(reader.left_out().kinds().iter().map(ToString::to_string));
    Ok((reader.header().clone(), solved))
}

/// Solves epochs on all processors and judges them in order; the result does not depend on the number of processors.
fn solve_chunk(
    chunk: &[ObservationEpoch],
    navigation: &NavigationData,
    options: &PositioningOptions,
    trace: bool,
    solved: &mut Solved,
) {
    let results: Vec<_> = chunk
        .par_iter()
        .map(|epoch| {
            let mut steps = Vec::new();
            let mut keep = |step: &Iteration| {
                if trace {
                    steps.push(step.clone());
                }
            };
            let result = candidates(epoch, navigation, options, &mut keep);
            (result, steps)
        })
        .collect();
    for (epoch, (result, steps)) in chunk.iter().zip(results) {
        solved.add_trace(epoch.receive_time, &steps);
        match result.and_then(|candidates| solved.sequence.judge(candidates)) {
            Ok(fix) => solved.fixes.push(fix),
            Err(error) => solved.refused.push((epoch.receive_time, error)),
        }
    }
}

/// A progress bar on a terminal, nothing elsewhere.
fn bar(path: &Path) -> ProgressBar {
    let bytes = std::fs::metadata(path).map(|m| m.len()).ok();
    let bar = ProgressBar::with_draw_target(bytes, ProgressDrawTarget::stderr_with_hz(5));
    match ProgressStyle::with_template("{elapsed_precise} [{bar:40}] {percent} % {eta}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_and_heights_are_read() {
        let munich = position("48.5, 11.5,560").unwrap();
        assert_eq!((munich.latitude.to_degrees(), munich.height), (48.5, 560.0));
        assert_eq!(height("-20:0.5"), Ok(Height { height_m: -20.0, sigma_m: 0.5 }));
        for wrong in ["", "48,11", "91,0,0", "a,b,c", "1,2,nan"] {
            assert!(position(wrong).is_err(), "{wrong}");
        }
        for wrong in ["", "560", "560:0", "560:-1", "a:b", "nan:1"] {
            assert!(height(wrong).is_err(), "{wrong}");
        }
    }
}
