//! The verdicts.

use super::filter::{Keeping, below_one_from};
use super::networks::{Shown, median};
use super::settings::Setting;
use super::way::count;
use super::{Claim, Measured};
use sdr_rx::network::info;
use sdr_rx::network::scene::SATELLITES;

/// A significant difference of iterations, relative to the larger.
const CLEAR: f64 = 0.05;

/// Each claim of the paper, and of network averages, with the results here.
pub fn claims(measured: &Measured) -> Vec<Claim> {
    let mut claims = filter(measured);
    claims.extend(convergence(measured));
    claims.extend(figures(measured));
    claims.extend(ours(measured));
    claims
}

fn claim(place: &'static str, claim: &str, paper: &str, ours: String, holds: bool) -> Claim {
    Claim { place, claim: claim.into(), paper: paper.into(), ours, holds }
}

fn filter(measured: &Measured) -> Vec<Claim> {
    let filtered = &measured.filtered;
    let epochs = filtered.errors.len();
    let worst = filtered.errors.iter().copied().fold(0.0, f64::max);
    let [first, last] = filtered.sigma;
    let at = |keeping| {
        let values = filtered.of(keeping);
        let from = below_one_from(values).map_or("never".into(), |k| format!("from epoch {k}"));
        let (first, last) = (values.first(), values.last());
        let [first, last] = [first, last].map(|v| v.copied().unwrap_or(f64::NAN));
        (format!("{from}; {first:.2} at first, {last:.3} at last"), below_one_from(values))
    };
    let (info, info_from) = at(Keeping::Info(5));
    let (more, more_from) = at(Keeping::Info(10));
    let (admm, admm_from) = at(Keeping::Admm(10));
    let (twenty, twenty_from) = at(Keeping::Admm(20));
    let (constant, constant_from) = at(Keeping::Constant(10));
    vec![
        claim(
            "Fig. 8",
            "errors of the filtered solution within 3 sigma (of normal ones 0.27 % are not)",
            "all",
            format!(
                "{:.2} % not, largest {worst:.2} x 3 sigma; {epochs} epochs; sigma {first:.3} to {last:.3} m",
                100.0 * filtered.outside
            ),
            filtered.outside <= 0.0027,
        ),
        claim(
            "Fig. 8",
            "nodes within 3 sigma of the centre, admm, 10 iterations an epoch",
            "yes",
            admm,
            admm_from.is_some(),
        ),
        claim("Fig. 8", "the same, 20 iterations", "yes", twenty, twenty_from.is_some()),
        claim(
            "ours",
            "rho must grow with the data: constant, 10 iterations, nodes fall behind",
            "",
            constant,
            admm_from.is_some() && constant_from.is_none_or(|k| Some(k) > admm_from),
        ),
        claim(
            "ours",
            "averages, 5 iterations an epoch: nodes within 3 sigma from the first epoch",
            "",
            info,
            info_from == Some(1),
        ),
        claim("ours", "the same, 10 iterations", "", more, more_from == Some(1)),
    ]
}

/// Both counts of a setting.
fn counts(measured: &Measured, setting: Setting) -> [Option<usize>; 2] {
    let way = measured.way(setting);
    [way.and_then(|way| way.three_sigma()), way.and_then(|way| way.millimetre())]
}

fn convergence(measured: &Measured) -> Vec<Claim> {
    let limit = measured.effort.limit;
    let of = |setting| counts(measured, setting);
    let text = |settings: &[Setting], k: usize| {
        settings.iter().map(|&s| count(of(s)[k], limit)).collect::<Vec<_>>().join("; ")
    };
    let steps = |k: Option<usize>| k.map_or(f64::INFINITY, |k| k as f64);
    let slower = |a: Setting, b: Setting, k: usize| {
        let (a, b) = (of(a)[k], of(b)[k]);
        b.is_some() && steps(a) > (1.0 + CLEAR) * steps(b)
    };
    let rho = |rho: f64| Setting::Admm(rho, 1.0);
    let relaxed = [rho(0.5), Setting::Admm(0.5, 1.6), Setting::Admm(0.5, 1.8)];
    let balanced = [Setting::Balanced(5.0), Setting::Balanced(0.005)];
    let better = [Setting::Rule, Setting::MeanWeight, Setting::Free(4.0, 1.6)];
    let reference = relaxed[1];
    vec![
        claim(
            "Fig. 9",
            "rho 5 is slower than 0.5: iterations to 3 sigma",
            "yes",
            text(&[rho(5.0), rho(0.5)], 0),
            slower(rho(5.0), rho(0.5), 0),
        ),
        claim(
            "Fig. 9",
            "rho 0.05 gains no more: iterations to 1 mm, 0.5; 0.05",
            "yes",
            text(&[rho(0.5), rho(0.05)], 1),
            slower(rho(0.05), rho(0.5), 1),
        ),
        claim(
            "Fig. 9",
            "rho 0.005 is slow again: iterations to 3 sigma, 0.5; 0.005",
            "yes",
            text(&[rho(0.5), rho(0.005)], 0),
            slower(rho(0.005), rho(0.5), 0),
        ),
        claim(
            "ours",
            "over-relaxation gains: rho 0.5, alpha 1; 1.6; 1.8, to 1 mm",
            "",
            text(&relaxed, 1),
            slower(relaxed[0], relaxed[1], 1),
        ),
        claim(
            "ours",
            "residual balancing rescues a bad rho: from 5; 0.005, to 1 mm",
            "",
            text(&balanced, 1),
            balanced.iter().all(|&s| of(s)[1].is_some()),
        ),
        claim(
            "ours",
            "rho by rule; W = 4 mean N; free datum, to 1 mm",
            "",
            text(&better, 1),
            slower(reference, Setting::MeanWeight, 1)
                && slower(reference, Setting::Free(4.0, 1.6), 1),
        ),
        claim(
            "ours",
            "averages, rho 3; planned from the graph, to 1 mm",
            "",
            text(&[Setting::Info(3.0, 1.6), Setting::Planned], 1),
            of(Setting::Planned)[1].is_some_and(|k| k <= 32),
        ),
    ]
}

fn figures(measured: &Measured) -> Vec<Claim> {
    let limit = measured.effort.limit;
    let [cold, near, warm] = measured.starts.each_ref().map(|way| way.three_sigma());
    let millimetre = measured.starts.each_ref().map(|way| count(way.millimetre(), limit));
    let correlations: Vec<f64> = measured.networks.iter().map(Shown::rank_correlation).collect();
    let mean = correlations.iter().sum::<f64>() / correlations.len() as f64;
    let (low, high) = correlations
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &r| (a.min(r), b.max(r)));
    let sets = &measured.constraint_nodes;
    let counted = |k: usize| median(sets.iter().map(|s| s[k].unwrap_or(limit) as f64).collect());
    let wins = sets.iter().filter(|s| s[0] < s[1] && s[0].is_some()).count();
    let all = [&measured.networks, &measured.bridges];
    let condition = all.iter().flat_map(|n| n.iter()).filter(|shown| shown.condition).count();
    let arrived = all.iter().flat_map(|n| n.iter()).filter(|shown| shown.info.is_some()).count();
    let total = all.iter().map(|n| n.len()).sum::<usize>();
    let [off, apart] = measured.printed;
    vec![
        claim(
            "Fig. 10",
            "the nearer the start the sooner: 0; truth + 1 m; epoch before, to 3 sigma",
            "yes",
            [cold, near, warm].map(|k| count(k, limit)).join("; "),
            cold > near && near > warm && warm.is_some(),
        ),
        claim("Fig. 10", "the same to 1 mm", "", millimetre.join("; "), {
            let [cold, near, warm] = measured.starts.each_ref().map(|way| way.millimetre());
            cold > near && near > warm && warm.is_some()
        }),
        claim(
            "Fig. 11",
            "more receivers, fewer iterations: rank correlation of both",
            "negative",
            format!("{low:.2} to {high:.2}, mean {mean:.2}, {} networks", correlations.len()),
            high < 0.0,
        ),
        claim(
            "text",
            "fewer constraint nodes never converge faster: C of 4; 5; all 9, medians",
            "never",
            format!(
                "{}; {}; {}: 4 beat 5 in {wins} of {}",
                counted(0),
                counted(1),
                counted(2),
                sets.len()
            ),
            wins == 0,
        ),
        claim(
            "Fig. 6",
            "the update as printed, N_i + W, gives the solution: off by",
            "0",
            format!("{off:.4} m, nodes within {apart:.0e} m"),
            off < 1e-3,
        ),
        claim(
            "(18.2)",
            "as printed, needed: graphs on which it holds; that converge",
            "all",
            format!("{condition}; {arrived} of {total}"),
            condition == total,
        ),
    ]
}

fn ours(measured: &Measured) -> Vec<Claim> {
    let limit = measured.effort.limit;
    let admm = counts(measured, Setting::Admm(0.5, 1.8))[1]
        .into_iter()
        .chain(counts(measured, Setting::Admm(0.5, 1.6))[1])
        .min();
    let averaged = counts(measured, Setting::Planned)[1];
    let (exchanges, exact) = measured.tree;
    let bytes = |k: Option<usize>, numbers: usize| {
        k.map_or("-".into(), |k| format!("{:.1}", (8 * k * numbers) as f64 / 1e3))
    };
    let packet = info::length(SATELLITES);
    let typical = |of: fn(&Shown) -> Option<usize>, shown: &[Shown]| {
        median(shown.iter().map(|s| of(s).map_or(f64::INFINITY, |k| k as f64)).collect())
    };
    let [hubs, bridges] =
        [&measured.networks, &measured.bridges].map(|shown| typical(|s| s.admm, shown));
    let averages = [&measured.networks, &measured.bridges].map(|shown| typical(|s| s.info, shown));
    let arrivals = measured.networks.iter().map(|s| s.info.map_or(f64::INFINITY, |k| k as f64));
    let (fewest, most) =
        arrivals.fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), k| (a.min(k), b.max(k)));
    let [paper, free] = measured.sigma;
    vec![
        claim(
            "ours",
            "kB a link and direction to 1 mm: admm; averages; tree",
            "",
            format!(
                "{}; {}; {}",
                bytes(admm, SATELLITES),
                bytes(averaged, packet),
                bytes(Some(1), packet)
            ),
            admm.zip(averaged).is_some_and(|(a, b)| b * packet < a * SATELLITES),
        ),
        claim(
            "ours",
            "averages, planned, to 1 mm on each network (at most 32 in the reference)",
            "",
            format!("{fewest:.0} to {most:.0}"),
            most <= 32.0,
        ),
        claim(
            "ours",
            "a tree is exact: after exchanges, to",
            "",
            format!("{exchanges}, {exact:.0e} m"),
            exact < 1e-9,
        ),
        claim(
            "ours",
            "bridges instead of links between hubs are slower: medians, admm",
            "",
            format!("{hubs}; {bridges} (averages {}; {})", averages[0], averages[1]),
            bridges > (1.0 + CLEAR) * hubs && hubs < limit as f64,
        ),
        claim(
            "ours",
            "free datum narrows the estimate: largest sigma before; after",
            "",
            format!("{paper:.3}; {free:.3} m"),
            free < paper,
        ),
    ]
}
