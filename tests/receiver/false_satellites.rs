//! Satellites that are not there, and weak ones beside strong ones (`SDR_RX_DATA`, `cases/16-...`).

use crate::common::{Tested, data};
use sdr_rx::capture::SampleSource;
use sdr_rx::gnss::Sv;
use sdr_rx::receiver::{self, ReceiverOptions};
use sdr_rx::scenario::{Scenario, ScenarioSource};
use std::collections::BTreeSet;

#[test]
fn beside_a_satellite_of_60_db_hz_all_others_are_found_and_no_other() -> Tested {
    let Some(folder) = data() else { return Ok(()) };
    // Above the horizon by the orbits of the day.
    let truth: BTreeSet<Sv> =
        [1, 3, 8, 10, 14, 17, 21, 22, 27, 28, 32].into_iter().filter_map(Sv::from_prn).collect();
    for (name, cn0_dbhz) in [("nf_58", 40.0), ("nf_62s4", 38.0), ("nf_64", 40.0)] {
        let file = folder.join(format!("cases/16-shadow-of-a-strong-satellite/{name}.toml"));
        let mut source = ScenarioSource::new(&Scenario::read(&file)?)?;
        assert!(source.info().rate_hz > 2.5e6);
        let record = receiver::acquire(&mut source, &ReceiverOptions::default(), 0.2)?;
        let found = record.acquisitions.iter().map(|r| r.acquisition.sv());
        assert_eq!(found.collect::<BTreeSet<_>>(), truth, "{name}");
        // The strong one, of itself wide noise of N0 at 60 dB-Hz, is gone from the samples of the others.
        for weak in record.acquisitions.iter().skip(1) {
            let error_db = weak.acquisition.cn0_dbhz - cn0_dbhz;
            assert!(error_db.abs() < 2.0, "{name}: {:?}", weak.acquisition);
        }
    }
    Ok(())
}
