//! The rows of a search, one Doppler each, of eight satellites side by side: the best cells of each satellite.

use super::fan::Fan;
use super::lanes::{LANES, Lanes, Work, peaks_and_sums};
use super::{Folded, PEAK_CHIPS, Peak, SearchPlan, looks_of};
use crate::acquisition::statistics;
use num_complex::Complex32;
use rayon::prelude::*;

/// Rows that are searched one after the other by one thread.
const ROWS: usize = 64;

/// The best cells of one satellite.
pub(super) struct Best {
    /// Of the rows in which noise does not reach it.
    pub(super) sound: Option<Peak>,
    /// Of the rows that vary too much for that, and in which white noise would not reach it.
    pub(super) doubtful: Option<Peak>,
    /// Noise: the sum over the cells of the median row.
    pub(super) floor: f64,
}

/// Satellites whose codes run alike with the Doppler, and the spectra of their codes side by side by component.
struct Group<'a> {
    satellites: &'a [usize],
    cycles_per_chip: f64,
    codes: Vec<Vec<Lanes>>,
}

/// The best cells of one satellite in some rows, and the sum of the cells of each.
#[derive(Default)]
struct Rows {
    sound: Option<Peak>,
    doubtful: Option<Peak>,
    sums: Vec<f32>,
}

/// What decides about a cell.
#[derive(Clone, Copy)]
struct Rule<'a> {
    threshold: f64,
    ln_limit: f64,
    looks: usize,
    fan: Option<&'a Fan<'a>>,
}

impl Rule<'_> {
    fn is_weaker(&self, a: &Peak, b: &Peak) -> bool {
        // Statistics of beams and of sums have different distributions.
        match self.fan {
            Some(_) => a.ln_false_alarm > b.ln_false_alarm,
            None => a.statistic < b.statistic,
        }
    }

    fn keep(&self, best: &mut Option<Peak>, peak: Option<Peak>) {
        if let Some(peak) = peak
            && best.is_none_or(|best| self.is_weaker(&best, &peak))
        {
            *best = Some(peak);
        }
    }
}

impl SearchPlan {
    /// The best cells of each of these satellites.
    pub(super) fn search_all(
        &self,
        wanted: &[usize],
        folded: &Folded,
        threshold: f64,
        fan: Option<&Fan<'_>>,
    ) -> Vec<Best> {
        let looks = self.looks(folded);
        let ln_limit = statistics::ln_cell_false_alarm(threshold, looks as f64);
        let rule = Rule { threshold, ln_limit, looks, fan };
        let cycles = |k: usize| self.options.satellites[k].cycles_per_chip();
        let groups: Vec<Group<'_>> = wanted
            .chunk_by(|a, b| cycles(*a) == cycles(*b))
            .flat_map(|alike| alike.chunks(LANES))
            .map(|satellites| self.group(satellites, cycles(satellites[0])))
            .collect();
        let dopplers: Vec<i64> = self.dopplers().collect();
        let tasks: Vec<(&Group<'_>, &[i64])> =
            groups.iter().flat_map(|g| dopplers.chunks(ROWS).map(move |rows| (g, rows))).collect();
        let searched: Vec<Vec<Rows>> = tasks
            .par_iter()
            .map(|(group, rows)| self.search_rows(group, rows, folded, rule))
            .collect();
        let parts = dopplers.len().div_ceil(ROWS);
        let of_group = |parts: &[Vec<Rows>]| -> Vec<Best> {
            (0..parts[0].len())
                .map(|lane| self.best(parts.iter().map(|p| &p[lane]), rule))
                .collect()
        };
        searched.chunks(parts).flat_map(of_group).collect()
    }

    fn group<'a>(&self, satellites: &'a [usize], cycles_per_chip: f64) -> Group<'a> {
        let mut codes = vec![vec![Lanes::ZERO; self.bins]; self.components];
        for (lane, &satellite) in satellites.iter().enumerate() {
            for (lanes, code) in codes.iter_mut().zip(&self.codes[satellite]) {
                lanes.iter_mut().zip(code).for_each(|(lanes, c)| lanes.set(lane, *c));
            }
        }
        Group { satellites, cycles_per_chip, codes }
    }

    /// Of all rows of one satellite.
    fn best<'a>(&self, parts: impl Iterator<Item = &'a Rows>, rule: Rule<'_>) -> Best {
        let mut all = Rows::default();
        for part in parts {
            rule.keep(&mut all.sound, part.sound);
            rule.keep(&mut all.doubtful, part.doubtful);
            all.sums.extend_from_slice(&part.sums);
        }
        // A strong signal raises the mean of its own row, so the noise is that of the median row.
        let middle = all.sums.len() / 2;
        let (_, &mut floor, _) = all.sums.select_nth_unstable_by(middle, f32::total_cmp);
        let floor = f64::from(floor).max(f64::MIN_POSITIVE);
        let bins = self.bins as f64;
        let over_noise = |peak: Peak| Peak { power: peak.power * bins / floor, ..peak };
        Best { sound: all.sound.map(over_noise), doubtful: all.doubtful.map(over_noise), floor }
    }

    fn search_rows(
        &self,
        group: &Group<'_>,
        dopplers: &[i64],
        folded: &Folded,
        rule: Rule<'_>,
    ) -> Vec<Rows> {
        let (bins, windows) = (self.bins, folded.windows.len());
        let mut work = Work::new(&self.lanes);
        let mut spectrum = vec![Complex32::ZERO; bins];
        let mut power = vec![[0f32; LANES]; bins];
        let mut rows: Vec<Rows> = group.satellites.iter().map(|_| Rows::default()).collect();
        for &index in dopplers {
            power.fill([0.0; LANES]);
            for look in 0..windows {
                self.rotate(index, look, folded, &mut spectrum);
                let advance = self.advance(group.cycles_per_chip, index, look, folded);
                for codes in &group.codes {
                    self.lanes.add_power(codes, &spectrum, advance, &mut work, &mut power);
                }
            }
            let (highest, sums) = peaks_and_sums(&power);
            for (lane, (rows, &satellite)) in rows.iter_mut().zip(group.satellites).enumerate() {
                let (highest, sum) = (f64::from(highest[lane]), f64::from(sums[lane]));
                rows.sums.push(sums[lane]);
                let noise = sum / (rule.looks * bins) as f64;
                let is_high = highest > rule.threshold * noise;
                if is_high || rule.fan.is_some_and(|fan| highest > fan.enough() * noise) {
                    let of_bin = |bin: usize| power[self.lanes.place(bin)][lane];
                    let of_lane: Vec<f32> = (0..bins).map(of_bin).collect();
                    let at = (satellite, group.cycles_per_chip, index);
                    self.judge(&of_lane, noise, at, folded, rule, rows);
                }
            }
        }
        rows
    }

    /// Judges a row of one satellite in which a cell is high: `power` by bin, whose mean is `noise` a look.
    fn judge(
        &self,
        power: &[f32],
        noise: f64,
        (satellite, cycles_per_chip, index): (usize, f64, i64),
        folded: &Folded,
        rule: Rule<'_>,
        rows: &mut Rows,
    ) {
        let of_cell = |bin: usize| self.judge_cell(power, bin, noise, rule.looks, index);
        let highest = power.iter().copied().fold(0f32, f32::max);
        let is_high = f64::from(highest) > rule.threshold * noise;
        let bin = power.iter().position(|&p| p == highest).unwrap_or(0);
        let mut peak = is_high.then(|| of_cell(bin));
        if let Some(fan) = rule.fan {
            let (correlations, advances) =
                self.correlate(&self.codes[satellite], cycles_per_chip, index, folded);
            let beam = fan.strongest(power, &correlations, &advances, noise);
            let of_beam = beam.and_then(|beam| {
                beam.peak(&of_cell(beam.bin), rule.looks as f64, self.spread_error())
            });
            if let Some(of_beam) = of_beam
                && peak.is_none_or(|peak| of_beam.ln_false_alarm < peak.ln_false_alarm)
            {
                peak = Some(of_beam);
            }
        }
        let Some(found) = peak else { return };
        let is_sound = found.ln_false_alarm < rule.ln_limit;
        rule.keep(if is_sound { &mut rows.sound } else { &mut rows.doubtful }, peak);
    }

    /// Correlations of one satellite in one row, look by look, and the bins by which each of them is early.
    fn correlate(
        &self,
        codes: &[Vec<Complex32>],
        cycles_per_chip: f64,
        index: i64,
        folded: &Folded,
    ) -> (Vec<Complex32>, Vec<usize>) {
        let mut scratch = vec![Complex32::ZERO; self.inverse.get_inplace_scratch_len()];
        let mut all = vec![Complex32::ZERO; self.looks(folded) * self.bins];
        let of_look = |((code, look), product): ((&[Complex32], usize), &mut [Complex32])| {
            self.multiply_row(code, index, look, folded, product);
            self.inverse.process_with_scratch(product, &mut scratch);
            self.advance(cycles_per_chip, index, look, folded)
        };
        let products = all.chunks_exact_mut(self.bins);
        let advances = looks_of(codes, folded).zip(products).map(of_look).collect();
        (all, advances)
    }

    /// The spectrum of a look, shifted to the Doppler of a row.
    fn rotate(&self, index: i64, look: usize, folded: &Folded, out: &mut [Complex32]) {
        let (spectrum, lines) = self.row_spectrum(index, look, folded);
        let (head, tail) = spectrum.split_at(lines);
        out[..tail.len()].copy_from_slice(tail);
        out[tail.len()..].copy_from_slice(head);
    }

    /// A cell of a row, judged by the other cells: by fewer looks where they vary more than noise does. `noise` is the
    /// mean power of one look.
    fn judge_cell(&self, power: &[f32], bin: usize, noise: f64, looks: usize, index: i64) -> Peak {
        let bins = self.bins;
        let highest = power[bin];
        let statistic = f64::from(highest) / noise;
        let beside = (PEAK_CHIPS * bins as f64 / self.chips).ceil() as usize;
        let rest = bins - 2 * beside - 1;
        let others = || (0..rest).map(|k| f64::from(power[(bin + beside + 1 + k) % bins]));
        let mean = others().sum::<f64>() / rest as f64;
        let spread = others().map(|p| (p / mean - 1.0).powi(2)).sum::<f64>() / rest as f64;
        let white = looks as f64;
        let ln_false_alarm = if spread * white < 1.0 + self.spread_error() {
            statistics::ln_cell_false_alarm(statistic, white)
        } else {
            let fewer = spread.recip();
            statistics::ln_cell_false_alarm(fewer * f64::from(highest) / mean, fewer)
        };
        let power = f64::from(highest);
        Peak { index, bin, statistic, ln_false_alarm, power, spread }
    }
}
