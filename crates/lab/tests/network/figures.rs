//! The experiment on the paper's figures, on one network.

use crate::common::Tested;
use sdr_rx_lab::distributed_ls::{DistributedLsEffort, run};

#[test]
fn figures_9_and_10_hold_and_the_printed_form_does_not() -> Tested {
    let outcome = run(1, DistributedLsEffort { networks: 1, limit: 600, epochs: 12 }, &|_| ())?;
    for claim in &outcome.claims {
        let expected = match claim.place {
            "Fig. 9" | "Fig. 10" => true,
            "Fig. 6" | "(18.2)" => false,
            _ => continue,
        };
        assert_eq!(claim.holds, expected, "{}: {}", claim.claim, claim.ours);
    }
    let figures = outcome.plots.iter().map(|plot| plot.name.split('_').next().unwrap_or_default());
    let mut figures: Vec<_> = figures.collect();
    figures.dedup();
    assert_eq!(figures, ["fig8", "fig9", "fig10", "fig11"]);
    assert!(outcome.plots.iter().all(|plot| plot.curves.iter().all(|c| !c.points.is_empty())));
    Ok(())
}
