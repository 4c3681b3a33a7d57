//! The record of a whole run, from the receiver's events.

use super::event::{Event, Notice};
use super::record::Record;
use super::resolve::Resolved;
use super::sky::judge_sky;
use super::snapshot::solve_snapshot_head;
use super::{End, ReceiverOptions};
use crate::capture::Note;

/// Gathers a [`Record`]. Fixes and observations of events are not kept: at the end all instants are solved again,
/// with the navigation data of the whole run.
#[derive(Clone, Debug, Default)]
pub struct Recorder {
    record: Record,
}

impl Recorder {
    /// Takes an event.
    pub fn take(&mut self, event: &Event) {
        let record = &mut self.record;
        match event {
            Event::Found(found) => record.acquisitions.clone_from(found),
            Event::Sky(epoch) if record.sky.is_none() => record.sky = Some(epoch.sky.clone()),
            Event::Sky(epoch) => record.sky_epochs.push(epoch.clone()),
            Event::Notice(notice) => record.notices.push(notice.clone()),
            _ => (),
        }
    }

    /// The record, when the stream has ended. `sources`: the notes of the source.
    pub fn finish(self, end: End, options: &ReceiverOptions, sources: Vec<Note>) -> Record {
        let mut record = self.record;
        let found = record.acquisitions.len();
        record.navigation = options.navigation.clone();
        record.samples = end.samples;
        record.noise = end.noise;
        record.interferers = end.interferers;
        if let Some(tracks) = end.tracks {
            record.samples = tracks.samples;
            record.decoded = tracks.decoded.clone();
            record.sbas.clone_from(&tracks.sbas);
            record.navigation.merge(tracks.decoded.clone());
            let Resolved { epochs, fixes, reason } =
                tracks.resolve(&record.navigation, found, options);
            record.first_fix_s = tracks.ready_s.filter(|_| !fixes.is_empty());
            (record.epochs, record.fixes, record.reason) = (epochs, fixes, reason);
        }
        let unread = record.fixes.is_empty() && !options.navigation.is_empty();
        if let Some(snapshot) = end.snapshot.filter(|s| s.is_all || unread) {
            // Where no message could be read, the start of the recording is used as a snapshot.
            let solved = solve_snapshot_head(&record.acquisitions, &snapshot, options);
            record.epochs.extend(solved.epoch);
            record.notices.extend(solved.notice);
            match solved.fix {
                Ok(fix) => {
                    record.first_fix_s = Some(snapshot.samples as f64 / snapshot.rate_hz);
                    record.fixes.push(fix);
                    record.reason = None;
                }
                Err(reason) => record.reason = Some(reason),
            }
        }
        judge_sky(&mut record, end.rate_hz, options);
        record.notices.splice(0..0, sources.into_iter().map(Notice::Source));
        record
    }
}
