//! The figures and tables of the paper on AW-DGN-BT (NAVIGATION 73, 2026, navi.734), reproduced, and maps of
//! its failures.
//!
//! Figs. 2 and 3 and Table 2: five satellites over Turin brought down to a hundred heights, iterations of ADGN
//! and AW-DGN for each first damping. Figs. 5 and 6 and Table 3: three sites under Galileo for ten hours. The
//! geometry of Turin is not the paper's, which gives neither geometry nor noise.

mod failures;
mod geometry;
mod scale_down;
mod tally;

use crate::Findings;
use crate::claim::Claim;
use failures::Failures;
use geometry::altitudes_m;
use scale_down::{SITES, Study, name};
use sdr_rx::position::{RowKind, Solver};
use sdr_rx::report::HeatMap;
use std::fmt::Write;
use tally::Tally;

/// First dampings of Figs. 2 and 3.
const DAMPINGS: [f64; 8] = [0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.0];

/// Amount of work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AwDgnEffort {
    /// Time between epochs at the three sites, s; the paper has 60 or 10.
    pub interval_s: f64,
    /// Draws for each cell of the failure maps.
    pub draws: u64,
}

impl AwDgnEffort {
    /// The paper's epochs, a minute apart.
    pub const FULL: Self = Self { interval_s: 60.0, draws: 2000 };
    /// Some seconds.
    pub const QUICK: Self = Self { interval_s: 1200.0, draws: 100 };
}

/// Outcomes of some solvers at every height, by one observable at one site.
struct Series {
    observable: RowKind,
    place: &'static str,
    rows: Vec<(Solver, Vec<Tally>)>,
}

impl Series {
    fn new(study: &Study, place: &'static str, observable: RowKind, solvers: &[Solver]) -> Self {
        let tallies = study.run(observable, solvers, 1.0);
        Self { observable, place, rows: solvers.iter().copied().zip(tallies).collect() }
    }

    fn of(&self, solver: Solver) -> Summary {
        let row = self.rows.iter().find(|(s, _)| *s == solver);
        Summary::of(row.map_or(&[], |(_, tallies)| tallies))
    }

    /// Mean iterations, blank where not every epoch converged: the paper's figures.
    fn map(&self, name: &str, title: String) -> HeatMap {
        let value = |t: &Tally| if t.all_right() { t.mean_iterations() } else { f64::NAN };
        HeatMap {
            name: name.into(),
            title,
            x_axis: "orbit height / km".into(),
            x: altitudes_m().iter().map(|h| (h / 1e3).round()).collect(),
            rows: self.rows.iter().map(|(solver, _)| solver.to_string()).collect(),
            value: "iterations".into(),
            range: [3.0, 12.0],
            values: self.rows.iter().map(|(_, row)| row.iter().map(value).collect()).collect(),
        }
    }
}

/// Outcomes of a solver over all heights.
#[derive(Clone, Copy, Debug, Default)]
struct Summary {
    all: Tally,
    /// Heights at which every epoch was right.
    heights: usize,
}

impl Summary {
    fn of(tallies: &[Tally]) -> Self {
        let mut all = Tally::default();
        tallies.iter().for_each(|t| all += *t);
        Self { all, heights: tallies.iter().filter(|t| t.all_right()).count() }
    }

    fn complete(&self) -> bool {
        self.all.runs > 0 && self.all.all_right()
    }
}

/// Makes the figures, tables and maps; `progress` is given the fraction that is done, 0 to 1.
pub fn run(effort: AwDgnEffort, progress: &(dyn Fn(f64) + Sync)) -> Findings {
    let turin = Study::turin();
    let dampings = DAMPINGS.iter().flat_map(|&mu0| [Solver::Adgn(mu0), Solver::AwDgn(mu0)]);
    let fixed = [Solver::Gn, Solver::AdgnBt, Solver::AwDgnBt, Solver::VpOnce, Solver::Vp];
    let mut solvers: Vec<Solver> = dampings.collect();
    solvers.sort_by_key(|s| matches!(s, Solver::AwDgn(_)));
    solvers.extend(fixed);
    let turin = RowKind::ALL.map(|o| Series::new(&turin, "Turin", o, &solvers));
    let noisy: Vec<Summary> = [1.0, 6.0, 20.0]
        .map(|scale| {
            let study = Study::turin();
            Summary::of(&study.run(RowKind::RangeRate, &[Solver::AwDgnBt], scale)[0])
        })
        .to_vec();
    progress(0.1);
    let sites: Vec<Series> = SITES
        .iter()
        .flat_map(|(name, place)| {
            let study = Study::site(*place, effort.interval_s);
            RowKind::ALL.map(|o| Series::new(&study, name, o, &fixed))
        })
        .collect();
    progress(0.5);
    let failures = failures::run(effort.draws, &|done| progress(0.5 + 0.5 * done));

    let mut maps: Vec<HeatMap> = turin
        .iter()
        .zip(["fig2_turin_pseudorange", "fig3_turin_doppler"])
        .map(|(s, file)| s.map(file, format!("Turin, five satellites, {}", name(s.observable))))
        .collect();
    for (series, k) in sites.iter().zip(0..) {
        let figure = 5 + k % 2;
        let place = series.place.to_lowercase().replace(' ', "_");
        maps.push(series.map(
            &format!("fig{figure}_{place}_{}", name(series.observable).to_lowercase()),
            format!("{}, Galileo, {}", series.place, name(series.observable)),
        ));
    }
    let claims = claims(&turin, &sites, &noisy, &failures);
    maps.extend(failures.maps);
    let tables = vec![("table2".into(), table(&turin)), ("table3".into(), table(&sites))];
    Findings { maps, tables, claims, ..Findings::default() }
}

/// A line for each site, observable and solver.
fn table(series: &[Series]) -> String {
    let mut text = String::from(
        "place,observable,solver,runs,right,converged elsewhere,heights all right,mean iterations,most iterations\n",
    );
    for s in series {
        for (solver, tallies) in &s.rows {
            let Summary { all, heights } = Summary::of(tallies);
            let _ = writeln!(
                text,
                "{},{},{solver},{},{},{},{heights},{:.3},{}",
                s.place,
                name(s.observable),
                all.runs,
                all.right,
                all.wrong + all.named,
                all.mean_iterations(),
                all.most_iterations
            );
        }
    }
    text
}

/// The best first damping of ADGN that converges everywhere, and its iterations.
fn best_damping(series: &Series) -> (f64, f64) {
    DAMPINGS
        .iter()
        .map(|&mu0| (mu0, series.of(Solver::Adgn(mu0))))
        .filter(|(_, s)| s.complete())
        .map(|(mu0, s)| (mu0, s.all.mean_iterations()))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((f64::NAN, f64::NAN))
}

fn claims(
    turin: &[Series],
    sites: &[Series],
    noisy: &[Summary],
    failures: &Failures,
) -> Vec<Claim> {
    let aw: Vec<Summary> = sites.iter().map(|s| s.of(Solver::AwDgnBt)).collect();
    let gn: Vec<usize> = sites.iter().map(|s| s.of(Solver::Gn).heights).collect();
    let bt: Vec<Summary> = sites.iter().map(|s| s.of(Solver::AdgnBt)).collect();
    let vp: Vec<Summary> = sites.iter().map(|s| s.of(Solver::Vp)).collect();
    let of = |summaries: &[Summary], observable| {
        let place = sites.iter().zip(summaries);
        let chosen = place.filter(|(s, _)| s.observable == observable).map(|(_, x)| *x);
        chosen.collect::<Vec<_>>()
    };
    let means = |s: &[Summary]| span(s.iter().map(|s| s.all.mean_iterations()), 2);
    let [pseudorange, doppler] = RowKind::ALL.map(|o| means(&of(&aw, o)));
    let [vp_pseudorange, vp_doppler] = RowKind::ALL.map(|o| means(&of(&vp, o)));
    let near = |s: &[Summary]| s.iter().all(|s| (6.0..8.0).contains(&s.all.mean_iterations()));
    let runs: usize = aw.iter().map(|s| s.all.runs).sum();
    let right: usize = aw.iter().map(|s| s.all.right).sum();
    let [best_range, best_doppler] = [0, 1].map(|k| best_damping(&turin[k]));
    let at_turin = [0, 1].map(|k| turin[k].of(Solver::AwDgnBt));
    let bt_heights = |o| span(of(&bt, o).iter().map(|s| s.heights as f64), 0);
    let bt_wrong = of(&bt, RowKind::Range)
        .iter()
        .map(|s| 100.0 * s.all.wrong as f64 / s.all.runs as f64)
        .fold(0.0, f64::max);
    let percent = |t: &Tally| format!("{:.1}", 100.0 * t.fraction());
    let shell = |rows: &[(usize, [Tally; 2])], solver: usize| {
        let percents: Vec<String> = rows.iter().map(|(_, t)| percent(&t[solver])).collect();
        format!("{} % of runs", percents.join(", "))
    };
    let found = |rows: &[(usize, [Tally; 2])]| {
        rows.iter().all(|(n, t)| {
            let answered = (t[1].right + t[1].named) as f64 / t[1].runs as f64;
            answered >= if *n == 4 { 0.97 } else { 0.998 }
        })
    };
    let claim = |place, claim: &str, paper: &str, ours: String, holds| Claim {
        place,
        claim: claim.into(),
        paper: paper.into(),
        ours,
        holds,
    };
    vec![
        claim(
            "Fig. 2",
            "ADGN, pseudorange: best first damping, and its iterations",
            "0.08, 9.17",
            format!("{}, {:.2}", best_range.0, best_range.1),
            best_range.0 == 0.08 && (best_range.1 - 9.17).abs() < 0.5,
        ),
        claim(
            "Fig. 3",
            "ADGN, Doppler: best first damping, and its iterations",
            "0.02, 11.5",
            format!("{}, {:.2}", best_doppler.0, best_doppler.1),
            best_doppler.0 == 0.02 && (best_doppler.1 - 11.5).abs() < 0.75,
        ),
        claim(
            "Tab. 2",
            "AW-DGN-BT at Turin: iterations by pseudorange and by Doppler",
            "7.23, 7.5",
            at_turin.map(|s| format!("{:.2}", s.all.mean_iterations())).join(", "),
            at_turin.iter().all(Summary::complete)
                && (at_turin[0].all.mean_iterations() - 7.23).abs() < 0.3
                && (at_turin[1].all.mean_iterations() - 7.5).abs() < 0.3,
        ),
        claim(
            "Fig. 5",
            "AW-DGN-BT converges at every height, three sites, both observables",
            "100 %",
            format!("{right} of {runs} runs"),
            aw.iter().all(Summary::complete),
        ),
        claim(
            "Tab. 3",
            "its iterations, pseudorange; Doppler",
            "about 7",
            format!("{pseudorange}; {doppler}"),
            near(&aw),
        ),
        claim(
            "Fig. 5",
            "Gauss-Newton converges at fewer than 40 % of the heights",
            "< 40",
            span(gn.iter().map(|&n| n as f64), 0),
            gn.iter().all(|&n| n < 40),
        ),
        claim(
            "Fig. 6",
            "ADGN-BT too, by Doppler",
            "< 40",
            bt_heights(RowKind::RangeRate),
            of(&bt, RowKind::RangeRate).iter().all(|s| s.heights < 40),
        ),
        claim(
            "Fig. 5",
            "ADGN-BT too, by pseudorange",
            "< 40",
            bt_heights(RowKind::Range),
            of(&bt, RowKind::Range).iter().all(|s| s.heights < 40),
        ),
        claim(
            "text",
            "solutions that converged are the receiver's position: ADGN-BT, pseudorange",
            "yes",
            format!("up to {bt_wrong:.0} % of runs at false minima"),
            bt_wrong == 0.0,
        ),
        claim(
            "text",
            "convergence does not depend on noise: Doppler of 0.5, 3, 10 Hz",
            "7.5",
            noisy
                .iter()
                .map(|s| format!("{:.2}", s.all.mean_iterations()))
                .collect::<Vec<_>>()
                .join(", "),
            noisy.iter().all(Summary::complete),
        ),
        claim(
            "text",
            "AW-DGN-BT converges in LEO: 1584/72/39 at 550 km, Doppler, 4, 5, 6, 8 satellites",
            "always",
            shell(&failures.starlink, 0),
            failures.starlink.iter().all(|(_, t)| t[0].all_right()),
        ),
        claim(
            "text",
            "the same for 648/18/1 at 1200 km",
            "always",
            shell(&failures.oneweb, 0),
            failures.oneweb.iter().all(|(_, t)| t[0].all_right()),
        ),
        claim(
            "ours",
            "variable projection: every run, iterations by pseudorange; Doppler",
            "",
            format!("{vp_pseudorange}; {vp_doppler}"),
            vp.iter().all(Summary::complete),
        ),
        claim(
            "ours",
            "variable projection finds the position, 550 km, or gives it as an alternative",
            "",
            shell(&failures.starlink, 1),
            found(&failures.starlink),
        ),
        claim(
            "ours",
            "the same at 1200 km",
            "",
            shell(&failures.oneweb, 1),
            found(&failures.oneweb),
        ),
        claim(
            "ours",
            "receivers in orbit at 300 and 500 km: AW-DGN-BT, variable projection",
            "",
            failures.in_orbit.iter().map(|t| percent(t) + " %").collect::<Vec<_>>().join(", "),
            failures.in_orbit[1].fraction() >= 0.999,
        ),
    ]
}

/// Smallest to largest of some numbers.
fn span(values: impl Iterator<Item = f64>, decimals: usize) -> String {
    let (low, high) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    format!("{low:.decimals$} to {high:.decimals$}")
}
