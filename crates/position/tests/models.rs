//! Observations made by others with known models (`SDR_RX_DATA`, `cases/`): models, orbits and health as they were sent.

use sdr_rx_gnss::NavigationData;
use sdr_rx_gnss::format::{rinex_nav, rinex_obs};
use sdr_rx_gnss::observation::ObservationEpoch;
use sdr_rx_position::{DropReason, Fix, PositioningOptions, solve_epoch};
use std::path::{Path, PathBuf};

type Failed = Box<dyn std::error::Error + Send + Sync>;

fn cases() -> Option<PathBuf> {
    let folder = std::env::var_os("SDR_RX_DATA").map(|d| Path::new(&d).join("cases"));
    if folder.is_none() {
        println!("SDR_RX_DATA is not set: tests with files of others are passed over");
    }
    folder
}

/// The last epoch's fix, and how far, m, it is from the approximate position, which is the true one.
fn solved(observations: &Path, nav: &NavigationData) -> Result<(Fix, f64), Failed> {
    let reader = rinex_obs::open(observations)?;
    let truth_m = reader.header().approximate_position_m.ok_or("no position")?;
    let epochs: Vec<ObservationEpoch> = reader.collect::<Result<_, _>>()?;
    let epoch = epochs.last().ok_or("no epoch")?;
    let fix = solve_epoch(epoch, nav, &PositioningOptions::default())?;
    let error_m = (fix.position_m - truth_m).norm();
    Ok((fix, error_m))
}

/// Ranges are written to a millimetre, dilutions are below 4.
const EXACT_M: f64 = 0.02;

#[test]
fn files_of_known_models_are_solved_to_their_last_digit() -> Result<(), Failed> {
    let Some(cases) = cases() else { return Ok(()) };
    for (folder, file, nav) in [
        ("04-rinex4-ionosphere-of-other-systems", "obs.rnx", "nav4_all.rnx"),
        ("04-rinex4-ionosphere-of-other-systems", "obs.rnx", "nav4_gps_only.rnx"),
        ("05-troposphere-below-minus-100m", "dead_sea.rnx", "nav.22n"),
        ("05-troposphere-below-minus-100m", "m_-101.rnx", "nav.22n"),
        ("05-troposphere-below-minus-100m", "m_-430.rnx", "nav.22n"),
        ("05-troposphere-below-minus-100m", "m_-99.rnx", "nav.22n"),
        ("05-troposphere-below-minus-100m", "m_10001.rnx", "nav.22n"),
        ("06-above-50km", "m_50000.rnx", "nav.22n"),
        ("06-above-50km", "m_53000.rnx", "nav.22n"),
        ("06-above-50km", "m_400000.rnx", "nav.22n"),
        ("21-ionosphere-of-zeros", "obs.rnx", "ok2.n"),
        ("21-ionosphere-of-zeros", "obs.rnx", "ionzero.n"),
    ] {
        let folder = cases.join(folder);
        let nav = rinex_nav::read(folder.join(nav))?.data;
        let (fix, error_m) = solved(&folder.join(file), &nav)?;
        assert!(error_m < EXACT_M, "{file}: {error_m} m");
        assert!(fix.integrity.is_proved(), "{file}");
    }
    Ok(())
}

/// G14's pseudorange is 30 m wrong; the file says in three ways that it is unhealthy.
#[test]
fn a_change_of_health_within_an_issue_is_obeyed() -> Result<(), Failed> {
    let Some(cases) = cases() else { return Ok(()) };
    let folder = cases.join("20-health-change-within-an-issue");
    for name in
        ["b_newer_unhealthy_toe_minus16", "c_same_issue_unhealthy", "d_same_issue_unhealthy_first"]
    {
        let nav = rinex_nav::read(folder.join(format!("{name}.n")))?.data;
        let (fix, error_m) = solved(&folder.join("o.rnx"), &nav)?;
        assert!(error_m < EXACT_M, "{name}: {error_m} m");
        let unhealthy = fix.unused.iter().find(|d| d.reason == DropReason::Unhealthy(63));
        assert_eq!(unhealthy.map(|d| d.sv.to_string()).as_deref(), Some("G14"), "{name}");
    }
    let healthy = rinex_nav::read(folder.join("a_healthy.n"))?.data;
    assert!(solved(&folder.join("o.rnx"), &healthy)?.1 > 5.0, "the fault shows where it is used");
    Ok(())
}
