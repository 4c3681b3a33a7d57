//! Tables for the terminal.

use super::{Accuracy, Input, Oscillators, Run, SatelliteInView, Summary, counted};
use crate::acquisition::Acquisition;
use crate::front_end::Interferer;
use crate::gnss::constants::SPEED_OF_LIGHT;
use crate::gnss::coordinates::Geodetic;
use crate::position::{Doubt, Fix, Integrity, InterSystemOffset};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

/// One line per satellite found: Doppler, code phase, C/N0 as number and bar, false-alarm probability.
pub fn acquisition_table(acquisitions: &[Acquisition]) -> String {
    if acquisitions.is_empty() {
        return "no satellite found\n".to_owned();
    }
    let mut text =
        String::from("  sv   Doppler/Hz  code/chips  C/N0/dB-Hz               false alarm\n");
    for a in acquisitions {
        let _ = writeln!(
            text,
            "  {}  {:+10.1}  {:10.3}  {:10.1} {:13} {:11.1e}",
            a.sv(),
            a.doppler_hz,
            a.code_phase_chips,
            a.cn0_dbhz,
            bar(a.cn0_dbhz),
            a.false_alarm
        );
    }
    text
}

/// One block per dB-Hz over 25, two to a character, up to 13 characters (51 dB-Hz).
fn bar(cn0_dbhz: f64) -> String {
    let halves = (cn0_dbhz - 25.0).round().clamp(0.0, 26.0) as usize;
    "#".repeat(halves / 2) + if halves % 2 == 1 { "+" } else { "" }
}

/// Interference, impulsive noise and their suppression; empty where there were none.
pub fn noise_line(run: &Run) -> String {
    let line = |interferer: &Interferer| format!("  interference {interferer}, removed\n");
    let lines: String = run.interferers.iter().map(line).collect();
    let lines = if lines.is_empty() { lines } else { format!("\n{lines}") };
    lines + &run.noise.map_or(String::new(), |noise| {
        let part = match noise.treated {
            t if t < 0.995 => format!(" in {:.0} % of the samples", 100.0 * t),
            _ => String::new(),
        };
        format!(
            "\n  noise       impulsive{part}: {:.2} % at {:.3e} times the background's power; suppressed ({}), which gains {:.1} dB\n",
            100.0 * noise.impulse_probability,
            noise.variance_ratio,
            noise.suppression,
            noise.untreated_loss_db - noise.loss_db
        )
    })
}

/// Summary of the fixes: first fix, median position, spread, velocity, DOP; or why there is none.
pub fn fix_table(run: &Run) -> String {
    let fixes = counted(run.fixes);
    let (Some(s), Some(last)) = (Summary::new(run.fixes, run.input.rate_hz()), fixes.last()) else {
        return format!("no fix: {}\n", run.reason.unwrap_or("no reason is known"));
    };
    let position = Geodetic::from_ecef(&s.place_m);
    let mut text = match s.proved {
        true => String::new(),
        false => format!("no verified fix: {}\n", why_unverified(last)),
    };
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<11} {value}");
    };
    line(
        "fixes",
        format!(
            "{} by {}, {} satellites",
            states(run.fixes),
            last.start.solver,
            last.residuals.len()
        ),
    );
    let failed = || fixes.iter().filter_map(|fix| fix.start.failed.as_ref().zip(Some(fix)));
    if let Some((first, fix)) = failed().next() {
        let (count, by) = (failed().count(), fix.start.solver);
        line(
            "solver",
            format!("{} failed in {count}, {by} took over: {}", first.solver, first.cause),
        );
    }
    let needed = run.first_fix_s.unwrap_or(s.first_fix_s);
    line(
        "first fix",
        match run.input {
            Input::Samples(_) => format!("from the first {needed:.2} s of signal"),
            _ => format!("{needed:.2} s after the first epoch"),
        },
    );
    line("last fix", last.time.utc_iso());
    if let Some(search) = last.time_search {
        line(
            "its time",
            format!(
                "found in {:.1} h, {} positions and times explain the Dopplers, {:.0e} false fixes to be expected",
                search.searched_s / 3600.0,
                search.hypotheses,
                search.false_expected
            ),
        );
    }
    line(
        "position",
        format!(
            "{:.7} deg, {:.7} deg, {:.2} m above WGS 84 (latitude, longitude, height; {})",
            position.latitude.to_degrees(),
            position.longitude.to_degrees(),
            position.height,
            if s.moving { "last, the receiver moves" } else { "median" }
        ),
    );
    let [x, y, z]: [f64; 3] = s.place_m.into();
    line("ECEF", format!("{x:.2} {y:.2} {z:.2} m"));
    let sigma = |axis: usize| last.covariance[(axis, axis)].max(0.0).sqrt();
    line(
        "sigma",
        format!("east {:.2} north {:.2} up {:.2} m (1 sigma, last)", sigma(0), sigma(1), sigma(2)),
    );
    if !last.offsets.is_empty() {
        let offset = |o: &InterSystemOffset| {
            let [offset_m, sigma_m] = [o.offset_s, o.sigma_s].map(|s| s * SPEED_OF_LIGHT);
            format!("{} {offset_m:+.2} m (sigma {sigma_m:.2})", o.system.letter())
        };
        let offsets: Vec<String> = last.offsets.iter().map(offset).collect();
        line(
            "clocks",
            format!("against {}: {} (last)", last.reference.letter(), offsets.join(", ")),
        );
    }
    if let Some(level) = last.protection {
        line(
            "protection",
            format!(
                "level {:.1} m, horizontal {:.1} m, vertical {:.1} m (last)",
                level.position_m, level.horizontal_m, level.vertical_m
            ),
        );
    }
    if s.moving {
        let axis = |k: usize| {
            let values = || s.offsets_m.iter().map(move |offset| offset[k]);
            values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min)
        };
        line(
            "track",
            format!("over {:.0} m east, {:.0} m north, {:.0} m up", axis(0), axis(1), axis(2)),
        );
    } else if s.fixes > 1 {
        line(
            "spread",
            format!(
                "horizontal {:.2} m (50 %) {:.2} m (95 %), vertical {:.2} m (50 %) {:.2} m (95 %)",
                s.horizontal_50_m, s.horizontal_95_m, s.vertical_50_m, s.vertical_95_m
            ),
        );
    }
    if let Some(a) = run.reference.as_ref().and_then(|r| Accuracy::new(run.fixes, r)) {
        let [east, north, up] = a.mean_enu_m;
        line(
            "error",
            format!(
                "{:.2} m (50 %) {:.2} m (95 %) against {}; mean east {east:+.2} north {north:+.2} up {up:+.2} m",
                a.error_50_m, a.error_95_m, a.reference
            ),
        );
    }
    if let Some(v) = last.velocity_mps {
        let enu = Geodetic::from_ecef(&last.position_m).ecef_to_enu() * v;
        line(
            "velocity",
            format!("east {:+.3} north {:+.3} up {:+.3} m/s (last)", enu.x, enu.y, enu.z),
        );
    }
    line(
        "DOP",
        format!(
            "position {:.2} (median), horizontal {:.2}, vertical {:.2} (last)",
            s.pdop, last.hdop, last.vdop
        ),
    );
    if let (Input::Samples(_), Some(clocks)) = (run.input, Oscillators::new(run.fixes)) {
        line(
            "oscillator",
            format!(
                "sampling clock {:+.3} ppm, carrier {:+.0} Hz beside it",
                clocks.sample_clock_ppm, clocks.carrier_offset_hz
            ),
        );
    }
    let ambiguous = fixes.iter().filter(|f| !f.alternatives_m.is_empty()).count();
    if ambiguous > 0 {
        line(
            "ambiguous",
            format!(
                "{ambiguous} of {}: with few satellites another position explains them equally well",
                s.fixes
            ),
        );
    }
    if !last.excluded.is_empty() {
        let names: Vec<String> = last.excluded.iter().map(ToString::to_string).collect();
        line("excluded", names.join(" "));
    }
    if !last.unused.is_empty() {
        let reasons: Vec<String> =
            last.unused.iter().map(|d| format!("{} {}", d.sv, d.reason)).collect();
        line("not used", reasons.join(", "));
    }
    text
}

/// How many fixes are in which state.
fn states(fixes: &[Fix]) -> String {
    let states = [Integrity::Verified, Integrity::Excluded, Integrity::Unverified];
    let names = ["verified", "verified after exclusions", "unverified"];
    let counts = states.map(|state| fixes.iter().filter(|f| f.integrity == state).count());
    let named = counts.iter().zip(names).filter(|(count, _)| **count > 0);
    named.map(|(count, name)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
}

/// Why a position is not proved.
fn why_unverified(fix: &Fix) -> String {
    let satellites = fix.residuals.len();
    match (fix.doubt, fix.protection) {
        (Some(Doubt::Motion(off_m)), _) => {
            format!("it is {off_m:.0} m from where the fix before and the velocity lead")
        }
        (Some(Doubt::Clock(off_m)), _) => format!(
            "the receiver's clock is {off_m:.0} m from where the fix before and its drift lead"
        ),
        (_, Some(level)) => format!(
            "a fault that the {satellites} satellites do not show could put the position {:.0} m off",
            level.position_m
        ),
        (Some(Doubt::ProtectionLevel), None) => "no test was asked for".to_owned(),
        _ => format!("{satellites} satellites are too few to check each other"),
    }
}

/// Sky plot as text: north up, east right, the zenith in the middle and the horizon as the edge.
pub fn sky_plot_text(satellites: &[SatelliteInView]) -> String {
    const RADIUS: usize = 10;
    let (rows, columns) = (2 * RADIUS + 1, 4 * RADIUS + 4);
    let mut grid = vec![vec![b' '; columns]; rows];
    let mut put = |radius: f64, azimuth: f64, text: &str| {
        // A character is about twice as high as wide.
        let row = (RADIUS as f64 * (1.0 - radius * azimuth.cos())).round() as usize;
        let column = (2.0 * RADIUS as f64 * (1.0 + radius * azimuth.sin())).round() as usize;
        for (cell, byte) in
            grid[row.min(rows - 1)][column.min(columns - 3)..].iter_mut().zip(text.bytes())
        {
            *cell = byte;
        }
    };
    for degree in (0..360).step_by(5) {
        let azimuth = f64::from(degree).to_radians();
        put(1.0, azimuth, ".");
    }
    put(0.0, 0.0, "+");
    for (k, name) in ["N", "E", "S", "W"].into_iter().enumerate() {
        put(1.0, FRAC_PI_2 * k as f64, name);
    }
    for s in satellites {
        put((1.0 - s.elevation / FRAC_PI_2).clamp(0.0, 1.0), s.azimuth, &s.sv.to_string());
    }
    let lines = grid.iter().map(|row| String::from_utf8_lossy(row).trim_end().to_owned() + "\n");
    lines.collect()
}
