//! The times at which a snapshot may have been taken, as far as ephemerides cover them.

use super::{NEEDED, sighting};
use crate::epoch::sighting::Sighting;
use crate::error::{DropReason, Dropped, PositioningError};
use sdr_rx_gnss::observation::ObservationEpoch;
use sdr_rx_gnss::{Ephemeris, GpsTime, NavigationData, Sv};

/// Half a cell of time, s, at most: from there Dopplers lead to the right time (99 % with one start).
const HALF_CELL_S: f64 = 1800.0;
/// A GPS time holds no infinity: thirty years are no knowledge, s.
const NO_KNOWLEDGE_S: f64 = 1e9;

/// A stretch of time that starts from its middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub centre: GpsTime,
    /// Half its length, s.
    pub half_s: f64,
}

/// The times that are searched.
pub(super) struct TimeWindow<'a> {
    epoch: &'a ObservationEpoch,
    nav: &'a NavigationData,
    /// What the user allows.
    pub asked: (GpsTime, GpsTime),
    /// What of it enough ephemerides cover, in the order of time; never empty.
    pub cells: Vec<Cell>,
    /// The rest, s; infinite if the window is.
    pub left_out_s: f64,
    /// Satellites with an ephemeris in the best of the cells.
    pub most_satellites: usize,
}

impl<'a> TimeWindow<'a> {
    /// The times around the epoch's receive time, `uncertainty_s` either way, at which ephemerides are in
    /// force.
    pub fn new(
        epoch: &'a ObservationEpoch,
        nav: &'a NavigationData,
        uncertainty_s: f64,
    ) -> Result<Self, PositioningError> {
        let half_s = uncertainty_s.min(NO_KNOWLEDGE_S);
        let asked = (epoch.receive_time - half_s, epoch.receive_time + half_s);
        let mut window =
            Self { epoch, nav, asked, cells: Vec::new(), left_out_s: 0.0, most_satellites: 0 };
        for (from, to) in window.covered() {
            let count = ((to - from) / (2.0 * HALF_CELL_S)).ceil();
            let half_s = (to - from) / count / 2.0;
            for k in 0..count as usize {
                let centre = from + (2 * k + 1) as f64 * half_s;
                let usable = window.sightings(centre, None).0.len();
                window.most_satellites = window.most_satellites.max(usable);
                if usable >= NEEDED {
                    window.cells.push(Cell { centre, half_s });
                }
            }
        }
        window.left_out_s = (2.0 * uncertainty_s - window.searched_s()).max(0.0);
        if window.cells.is_empty() { Err(window.uncovered()) } else { Ok(window) }
    }

    /// Where ephemerides of observed satellites are in force, within what was asked.
    fn covered(&self) -> Vec<(GpsTime, GpsTime)> {
        let observed = |e: &&Ephemeris| self.epoch.observations.iter().any(|o| o.sv() == e.sv);
        let mut spans: Vec<(GpsTime, GpsTime)> = self
            .nav
            .iter()
            .filter(observed)
            .map(|e| (e.toe - e.half_fit_interval(), e.toe + e.half_fit_interval()))
            .map(|(from, to)| (later(from, self.asked.0), earlier(to, self.asked.1)))
            .filter(|(from, to)| from < to)
            .collect();
        spans.sort_by(|a, b| (a.0 - b.0).total_cmp(&0.0));
        let mut merged: Vec<(GpsTime, GpsTime)> = Vec::new();
        for span in spans {
            match merged.last_mut() {
                Some(last) if span.0 <= last.1 => last.1 = later(last.1, span.1),
                _ => merged.push(span),
            }
        }
        merged
    }

    /// Why no time can be searched.
    fn uncovered(&self) -> PositioningError {
        let time = self.epoch.receive_time;
        let (_, dropped) = self.sightings(time, None);
        let ages = dropped.iter().filter_map(|d| match d.reason {
            DropReason::Stale(hours) => Some(hours),
            _ => None,
        });
        match ages.min_by(f64::total_cmp) {
            Some(hours) if self.most_satellites == 0 => {
                PositioningError::StaleEphemerides { hours, time }
            }
            _ => PositioningError::TooFewSatellites {
                usable: self.most_satellites,
                needed: NEEDED,
                dropped,
            },
        }
    }

    /// First and last instant that is searched.
    pub fn ends(&self) -> (GpsTime, GpsTime) {
        let ends = |c: &Cell| (c.centre - c.half_s, c.centre + c.half_s);
        let (first, last) = (self.cells.first().map(ends), self.cells.last().map(ends));
        (first.map_or(self.asked.0, |e| e.0), last.map_or(self.asked.1, |e| e.1))
    }

    /// Time that is searched, s.
    pub fn searched_s(&self) -> f64 {
        self.cells.iter().map(|c| 2.0 * c.half_s).sum()
    }

    /// Whether `time` is in a cell, or no more than `margin_s` beyond one.
    pub fn is_searched(&self, time: GpsTime, margin_s: f64) -> bool {
        self.cells.iter().any(|c| (time - c.centre).abs() <= c.half_s + margin_s)
    }

    /// Whether the user allows `time`.
    pub fn is_asked(&self, time: GpsTime) -> bool {
        (self.asked.0..=self.asked.1).contains(&time)
    }

    /// The satellites with an ephemeris in force at `time`, and the others.
    pub fn sightings(
        &self,
        time: GpsTime,
        excluded: Option<Sv>,
    ) -> (Vec<Sighting<'a>>, Vec<Dropped>) {
        let mut usable: Vec<Sighting> = Vec::new();
        let mut dropped = Vec::new();
        for observation in self.epoch.observations.iter().filter(|o| Some(o.sv()) != excluded) {
            let sv = observation.sv();
            let sighting = match usable.iter().any(|s| s.observation.sv() == sv) {
                true => Err(DropReason::Duplicate),
                false => sighting(observation, time, self.nav),
            };
            match sighting {
                Ok(sighting) => usable.push(sighting),
                Err(reason) => dropped.push(Dropped { sv, reason }),
            }
        }
        (usable, dropped)
    }
}

fn earlier(a: GpsTime, b: GpsTime) -> GpsTime {
    if a < b { a } else { b }
}

fn later(a: GpsTime, b: GpsTime) -> GpsTime {
    if a > b { a } else { b }
}
