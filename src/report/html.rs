//! One static page with tables and plots: `--report`.

use super::kml::escape;
use super::{
    Input, ReportError, Run, Summary, acquisition_table, array_sky_table, arrival_plot, counted,
    east_north_plot, fix_table, height_plot, satellites_in_view, sky_plot,
};
use std::fmt::Write;

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem;color:#222}\
pre{background:#f6f6f4;padding:.8rem 1rem;overflow-x:auto}\
.plots{display:flex;flex-wrap:wrap;gap:1rem}svg{max-width:100%;height:auto}.warning{color:#a33}";

/// The page: capture, warnings, satellites, position and plots. It needs no other file and no network.
pub fn html(run: &Run) -> Result<String, ReportError> {
    let title = escape(run.capture);
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{title}: sdr-rx</title>\n<style>{STYLE}</style>\n<h1>{title}</h1>\n"
    );
    let made_from = match run.input {
        Input::Samples(stream) => {
            let length = |n| format!(", {:.3} s", n as f64 / stream.rate_hz);
            format!(
                "{} at {} Hz, intermediate frequency {} Hz, {} channel(s){}",
                escape(&stream.format),
                stream.rate_hz,
                stream.if_hz,
                stream.channels,
                stream.samples.map_or(String::new(), length),
            )
        }
        Input::Observations { version } => {
            format!("RINEX {version:.2} observations, {} epochs", run.epochs.len())
        }
    };
    let _ = writeln!(page, "<p>{made_from}. sdr-rx {}.</p>", env!("CARGO_PKG_VERSION"));
    for warning in run.warnings {
        let _ = writeln!(page, "<p class=\"warning\">{}</p>", escape(warning));
    }
    let _ = writeln!(page, "<h2>Position</h2>\n<pre>{}</pre>", escape(&fix_table(run)));
    if let Some(summary) = Summary::new(run.fixes, run.input.rate_hz()) {
        let fixes = counted(run.fixes);
        let times: Vec<f64> = fixes.iter().map(|f| f.time - fixes[0].time).collect();
        let _ = writeln!(
            page,
            "<div class=\"plots\">\n{}{}{}</div>",
            sky_plot(&satellites_in_view(run))?,
            east_north_plot(&summary)?,
            height_plot(&summary, &times)?
        );
    }
    if let Some(sky) = run.sky {
        let table = escape(&array_sky_table(sky));
        let _ = writeln!(page, "<h2>Directions</h2>\n<pre>{table}</pre>");
        if sky.satellites.iter().any(|s| s.arrival.is_some()) {
            let plot = arrival_plot(sky, run.sky_epochs)?;
            let _ = writeln!(page, "<div class=\"plots\">\n{plot}</div>");
        }
    }
    if matches!(run.input, Input::Samples(_)) {
        let table = escape(&acquisition_table(run.acquisitions));
        let _ = writeln!(page, "<h2>Satellites found</h2>\n<pre>{table}</pre>");
    }
    page += "</html>\n";
    Ok(page)
}
