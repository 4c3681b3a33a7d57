//! Rates that are multiples of the chip rate, mixers and sampling clocks that are off, symbol edges without a transition:
//! scenes that ended with no fix or a wrong one, against the truth of their scenario (`SDR_RX_DATA`, `cases/`).

use crate::common::{Failed, Tested, data};
use crate::program::median;
use sdr_rx::capture::SampleSource;
use sdr_rx::receiver::{self, ReceiverOptions, Record};
use sdr_rx::report::Oscillators;
use sdr_rx::scenario::receiver::Trajectory;
use sdr_rx::scenario::{Scenario, ScenarioSource};

/// The record of a scene, and the median error of its fixes, m.
fn processed(name: &str, change: impl Fn(&mut Scenario)) -> Result<(Record, f64), Failed> {
    let folder = data().ok_or("no data")?;
    let mut scenario = Scenario::read(&folder.join(format!("cases/{name}.toml")))?;
    change(&mut scenario);
    let trajectory = Trajectory::new(&scenario.receiver, scenario.start);
    let mut source = ScenarioSource::new(&scenario)?;
    let options = ReceiverOptions { time: Some(scenario.start), ..ReceiverOptions::default() };
    let rate_hz = source.info().rate_hz;
    let record = receiver::process(&mut source, &options, &mut |_| ())?;
    let errors = record.fixes.iter().map(|fix| {
        // The receiver is at rest: what the rate is lowered by does not matter.
        (fix.position_m - trajectory.state(fix.sample / rate_hz).position_m).norm()
    });
    let errors: Vec<f64> = errors.collect();
    if errors.is_empty() {
        return Err(format!("{name}: {:?}, {:?}", record.reason, record.notices).into());
    }
    let middle = median(errors);
    println!("{name}: {} fixes, median error {middle:.2} m", record.fixes.len());
    Ok((record, middle))
}

/// Thermal noise of a 45 dB-Hz scene at 2 bits is 1.1 m at other rates: three times that.
const SOUND_M: f64 = 3.3;

#[test]
fn four_samples_a_chip_are_as_good_as_any_other_rate() -> Tested {
    if data().is_none() {
        return Ok(());
    }
    let (_, error_m) = processed("02-rate-multiple-of-1.023MHz/4092", |_| ())?;
    assert!(error_m < SOUND_M, "{error_m} m");
    Ok(())
}

#[test]
fn a_mixer_of_another_clock_moves_no_position_and_is_told() -> Tested {
    if data().is_none() {
        return Ok(());
    }
    let (record, error_m) =
        processed("03-carrier-offset-without-code-offset/lo1875", |s| s.duration_s = 40.0)?;
    assert!(error_m < SOUND_M && record.notices.is_empty(), "{error_m} m, {:?}", record.notices);
    let clocks = Oscillators::new(&record.fixes).ok_or("no clocks")?;
    assert!((clocks.carrier_offset_hz - 1875.0).abs() < 100.0, "{clocks:?}");
    assert!((clocks.sample_clock_ppm - 0.1).abs() < 0.1, "{clocks:?}");
    Ok(())
}

#[test]
fn an_oscillator_off_by_five_ppm_is_found_without_being_told() -> Tested {
    if data().is_none() {
        return Ok(());
    }
    let (record, error_m) = processed("19-oscillator-5ppm-off/drift5", |_| ())?;
    assert!(error_m < SOUND_M, "{error_m} m");
    let clocks = Oscillators::new(&record.fixes).ok_or("no clocks")?;
    assert!((clocks.sample_clock_ppm - 5.0).abs() < 0.1, "{clocks:?}");
    Ok(())
}

/// Eight satellites, some of which have no data transition in the first 0.2 s.
#[test]
fn symbol_edges_wait_for_transitions() -> Tested {
    if data().is_none() {
        return Ok(());
    }
    let (record, error_m) = processed("01-bit-edge-without-transition/synthetic_2013", |_| ())?;
    assert!(error_m < SOUND_M, "{error_m} m");
    assert!(record.fixes.iter().all(|fix| fix.excluded.is_empty() && fix.residuals.len() == 8));
    Ok(())
}
