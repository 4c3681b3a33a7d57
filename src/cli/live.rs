//! Output while a stream is received: a status line on a terminal, a line for each fix, events as JSON Lines.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use sdr_rx::capture::StreamInfo;
use sdr_rx::gnss::Sv;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::position::Fix;
use sdr_rx::receiver::Event;
use sdr_rx::report::{event_line, events_start};
use sdr_rx::tracking::LockState;
use std::collections::BTreeSet;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::Path;

/// Outputs of events.
pub struct Live {
    /// Samples a second, of the stream, and as the receiver counts them.
    rates_hz: [f64; 2],
    bar: ProgressBar,
    tracked: BTreeSet<Sv>,
    last: Option<String>,
    /// Fixes are printed to standard output.
    follow: bool,
    events: Option<Box<dyn Write + Send>>,
    failed: Option<std::io::Error>,
}

impl Live {
    /// For a stream whose samples the receiver counts at `rate_hz`.
    pub fn new(info: &StreamInfo, rate_hz: f64, follow: bool) -> Self {
        let bar =
            ProgressBar::with_draw_target(info.samples, ProgressDrawTarget::stderr_with_hz(1));
        let style = match info.samples {
            Some(_) => "{elapsed_precise} [{bar:30}] {percent} % {eta}  {msg}",
            None => "{elapsed_precise}  {msg}",
        };
        let bar = match ProgressStyle::with_template(style) {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        };
        Self {
            rates_hz: [info.rate_hz, rate_hz],
            bar,
            tracked: BTreeSet::new(),
            last: None,
            follow,
            events: None,
            failed: None,
        }
    }

    /// Events go to a file, or to standard output for `-`.
    pub fn write_events(&mut self, path: &Path, capture: &str) -> std::io::Result<()> {
        let mut events: Box<dyn Write + Send> = match path == Path::new("-") {
            true => Box::new(std::io::stdout()),
            false => Box::new(BufWriter::new(std::fs::File::create(path)?)),
        };
        events.write_all(events_start(capture).as_bytes())?;
        self.events = Some(events);
        Ok(())
    }

    /// Takes an event.
    pub fn take(&mut self, event: &Event) {
        match event {
            Event::Lock { sv, state: LockState::Lost, .. } => {
                self.tracked.remove(sv);
            }
            Event::Lock { sv, .. } => {
                self.tracked.insert(*sv);
            }
            Event::Fix(fix) => {
                let line = fix_line(fix, self.rates_hz[1]);
                if self.follow {
                    let written = self.bar.suspend(|| writeln!(std::io::stdout(), "{line}"));
                    self.note(written);
                }
                self.last = Some(line);
            }
            _ => (),
        }
        if let Some(events) = &mut self.events {
            let line = event_line(event, self.rates_hz[1]);
            let written = events.write_all(line.as_bytes());
            // Readers of events need fixes at once.
            let written = match event {
                Event::Fix(_) | Event::NoFix { .. } => written.and_then(|()| events.flush()),
                _ => written,
            };
            self.note(written);
        }
    }

    /// Shows the progress, in samples of the stream.
    pub fn progress(&self, samples: u64) {
        self.bar.set_position(samples);
        let at_s = samples as f64 / self.rates_hz[0];
        let last = self.last.as_deref().unwrap_or("no fix yet");
        let satellites = self.tracked.len();
        self.bar.set_message(format!("{at_s:.1} s of signal, {satellites} satellites; {last}"));
    }

    /// Ends the status line; an error if something could not be written.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.bar.finish_and_clear();
        if let Some(events) = &mut self.events {
            let flushed = events.flush();
            self.note(flushed);
        }
        self.failed.map_or(Ok(()), Err)
    }

    /// A closed pipe is no error; other errors are kept for the end.
    fn note(&mut self, written: std::io::Result<()>) {
        if let Err(error) = written {
            (self.follow, self.events) = (false, None);
            if error.kind() != ErrorKind::BrokenPipe {
                self.failed.get_or_insert(error);
            }
        }
    }
}

/// A fix in a line: UTC, latitude and longitude in degrees, height above WGS 84, satellites, standard deviation
/// (3-D), signal from the first sample on, whether it is proved.
fn fix_line(fix: &Fix, rate_hz: f64) -> String {
    let position = Geodetic::from_ecef(&fix.position_m);
    let sigma_m = fix.covariance.trace().max(0.0).sqrt();
    format!(
        "{} {:.7} {:.7} {:.1} m, {} satellites, {sigma_m:.1} m (1 sigma), {:.2} s{}",
        fix.time.utc_iso(),
        position.latitude.to_degrees(),
        position.longitude.to_degrees(),
        position.height,
        fix.residuals.len(),
        fix.sample / rate_hz,
        if fix.integrity.is_proved() { "" } else { ", UNVERIFIED" }
    )
}
