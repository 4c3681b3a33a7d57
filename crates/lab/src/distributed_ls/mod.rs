//! The experiment of Khodabandeh & Teunissen, "Distributed least-squares estimation applied to GNSS networks"
//! (Meas. Sci. Technol. 30 (2019) 044005), figures 8 to 11, on a simulated network of the same size: 110 stations,
//! 118 links, nine constraint nodes.
//!
//! Stations, links and satellites are not the paper's (see [`scene`](sdr_rx::network::scene)), so that shapes and
//! orders of magnitude are compared, not values. Interpretation of figure 8: the errors of a centre's filter over
//! 2.5 h stay within 3 sigma, and the nodes' filter
//! keeps up with it by a few iterations an epoch.

mod claims;
mod filter;
mod networks;
mod settings;
mod start;
mod way;

use crate::Findings;
use crate::claim::Claim;
use filter::Filtered;
use networks::Shown;
use rayon::prelude::*;
use sdr_rx::network::scene::{NetworkLayout, StationScene};
use sdr_rx::network::{Datum, NetworkError};
use sdr_rx::report::{Curve, LinePlot};
use settings::Setting;
use std::fmt::Write;
use way::{Epoch, Way, count};

/// Amount of work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistributedLsEffort {
    /// Number of networks.
    pub networks: u64,
    /// Maximum number of iterations.
    pub limit: usize,
    /// Epochs of the filters.
    pub epochs: usize,
}

impl DistributedLsEffort {
    /// 2.5 h, ten networks.
    pub const FULL: Self = Self { networks: 10, limit: 4000, epochs: 300 };
    /// Some seconds.
    pub const QUICK: Self = Self { networks: 2, limit: 1200, epochs: 30 };
}

/// All results.
struct Measured {
    effort: DistributedLsEffort,
    filtered: Filtered,
    settings: Vec<(Setting, Way)>,
    starts: [Way; 3],
    networks: Vec<Shown>,
    bridges: Vec<Shown>,
    constraint_nodes: Vec<[Option<usize>; 3]>,
    printed: [f64; 2],
    tree: (usize, f64),
    /// Largest standard deviation of the paper's datum and of the free one, m.
    sigma: [f64; 2],
}

/// Makes figures, tables and verdicts; `progress` is given the fraction that is done, 0 to 1.
///
/// # Errors
/// [`NetworkError`] of a scene that cannot be solved.
pub fn run(
    seed: u64,
    effort: DistributedLsEffort,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Findings, NetworkError> {
    let limit = effort.limit;
    let scene = StationScene::new(NetworkLayout::Hubs, seed)?;
    let epoch = Epoch::new(&scene, 0, Datum::Observed, seed)?;
    let free = Epoch::new(&scene, 0, Datum::ZeroMean, seed)?;
    let way = |&setting: &Setting| Ok((setting, setting.way(&epoch, &free, limit)?));
    let settings = Setting::ALL.par_iter().map(way).collect::<Result<_, NetworkError>>()?;
    progress(0.2);
    let filtered = filter::filter(&scene, effort.epochs, seed)?;
    progress(0.5);
    let networks = networks::networks(NetworkLayout::Hubs, effort.networks, limit)?;
    let bridges = networks::networks(NetworkLayout::Bridges, effort.networks, limit)?;
    progress(0.8);
    let measured = Measured {
        effort,
        filtered,
        settings,
        starts: start::ways(&scene, seed, limit)?,
        networks,
        bridges,
        constraint_nodes: networks::constraint_nodes(effort.networks, limit)?,
        printed: settings::printed(&epoch, limit)?,
        tree: networks::tree(&scene, &epoch)?,
        sigma: [&epoch, &free].map(|epoch| epoch.solution.sigma().amax()),
    };
    progress(1.0);
    Ok(Findings {
        maps: Vec::new(),
        plots: measured.plots(),
        tables: measured.tables(),
        claims: claims::claims(&measured),
    })
}

impl Measured {
    fn way(&self, setting: Setting) -> Option<&Way> {
        self.settings.iter().find(|(other, _)| *other == setting).map(|(_, way)| way)
    }

    fn plots(&self) -> Vec<LinePlot> {
        let plot = |name: &str, title: &str, curves: Vec<Curve>| LinePlot {
            name: name.into(),
            title: title.into(),
            axes: ["iterations".into(), "farthest node from the centre (m)".into()],
            log: [true, true],
            curves,
        };
        let of = |wanted: fn(&Setting) -> bool| {
            let chosen = self.settings.iter().filter(move |(setting, _)| wanted(setting));
            chosen.map(|(setting, way)| way.curve(setting.to_string())).collect()
        };
        let starts =
            self.starts.iter().zip(["from 0", "from truth + 1 m", "from the epoch before"]);
        let coverage = self.networks.iter().zip(1..).map(|(shown, seed)| {
            let mut points: Vec<_> =
                shown.coverage.iter().map(|c| (c.0 as f64, c.1 as f64)).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Curve { name: format!("network {seed}"), points }
        });
        let mut plots = self.filtered.plots.clone();
        plots.extend([
            plot(
                "fig9_rho",
                "The weight of agreement, rho",
                of(|s| matches!(s, Setting::Admm(_, 1.0))),
            ),
            plot("fig9_better", "What is faster", of(|s| !matches!(s, Setting::Admm(_, 1.0)))),
            plot("fig10_start", "The start", starts.map(|(way, name)| way.curve(name)).collect()),
            LinePlot {
                axes: ["receivers of a satellite".into(), "iterations to 1 mm".into()],
                log: [false, false],
                ..plot("fig11_receivers", "Receivers of a satellite", coverage.collect())
            },
        ]);
        plots
    }

    fn tables(&self) -> Vec<(String, String)> {
        let mut convergence = String::from("setting,iterations to 1 mm,iterations to 3 sigma\n");
        let limit = self.effort.limit;
        for (setting, way) in &self.settings {
            let [mm, sigma] = [way.millimetre(), way.three_sigma()].map(|k| count(k, limit));
            let _ = writeln!(convergence, "{setting},{mm},{sigma}");
        }
        let mut networks = String::from(
            "layout,seed,admm iterations to 1 mm,info iterations to 1 mm,radius of info,(18.2) holds,rank correlation\n",
        );
        for (layout, shown) in [("hubs", &self.networks), ("bridges", &self.bridges)] {
            for (shown, seed) in shown.iter().zip(1..) {
                let [admm, info] = [shown.admm, shown.info].map(|k| count(k, limit));
                let (condition, radius) = (shown.condition, shown.radius);
                let correlation = shown.rank_correlation();
                let _ = writeln!(
                    networks,
                    "{layout},{seed},{admm},{info},{radius:.3},{condition},{correlation:.2}"
                );
            }
        }
        let mut sets = String::from("seed,C = 1 3 4 9,C = 1 3 4 6 9,C = all\n");
        for (best, seed) in self.constraint_nodes.iter().zip(1..) {
            let [a, b, c] = best.map(|k| count(k, limit));
            let _ = writeln!(sets, "{seed},{a},{b},{c}");
        }
        let named =
            [("convergence", convergence), ("networks", networks), ("constraint_nodes", sets)];
        named.map(|(name, text)| (name.into(), text)).into()
    }
}
