//! RINEX and SP3 files of others, damaged in forty ways: nothing panics, what is whole is read, what is lost is named.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sdr_rx_gnss::format::rinex_obs::ObservationReader;
use sdr_rx_gnss::format::{LeftOut, rinex_nav, sp3};
use sdr_rx_gnss::observation::{Observation, ObservationEpoch};
use sdr_rx_gnss::orbit::precise::PreciseOrbit;
use sdr_rx_gnss::{Ephemeris, GpsTime, Sv};
use std::error::Error;
use std::path::{Path, PathBuf};

/// Kinds of damage of one line of records, of which as many are made of a line of the header.
const KINDS: usize = 20;
/// Lines of a file that are read: an epoch or two thousand serve as well as more.
const MOST_LINES: usize = 1000;

/// All files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

/// Kinds that lose, double or insert whole lines: they change no value.
const OF_LINES: [usize; 6] = [0, 1, 4, 5, 8, 9];

/// What is read of a text.
struct Read {
    /// Of observations and positions the satellites at all epochs, else the records, with their values.
    items: Vec<String>,
    /// Items that one damaged line can take along: those of two epochs or records.
    most_lost: usize,
    left_out: LeftOut,
    /// Records of other systems.
    skipped: usize,
}

fn observations(text: &str) -> Option<Read> {
    let mut reader = ObservationReader::new(text.as_bytes(), "x").ok()?;
    let epochs: Vec<_> = reader.by_ref().map_while(Result::ok).collect();
    let most = epochs.iter().map(|epoch| epoch.observations.len()).max().unwrap_or(0);
    let item = |time: GpsTime, o: &Observation| {
        format!("{} {:.3} {} {:?}", time.week(), time.tow(), o.sv(), o.pseudorange_m())
    };
    let of = |e: &ObservationEpoch| {
        let time = e.receive_time;
        e.observations.iter().map(|o| item(time, o)).collect::<Vec<_>>()
    };
    let items = epochs.iter().flat_map(of).collect();
    Some(Read {
        items,
        most_lost: 2 * most,
        left_out: reader.left_out().clone(),
        skipped: reader.skipped(),
    })
}

fn ephemerides(text: &str) -> Option<Read> {
    let file = rinex_nav::parse(text, "x").ok()?;
    let items = file
        .data
        .iter()
        .map(|e| {
            // The last line of a record may be missing.
            let e = Ephemeris { transmission_time: None, fit_interval_flag: false, ..e.clone() };
            format!("{e:?}")
        })
        .collect();
    Some(Read { items, most_lost: 2, left_out: file.left_out, skipped: file.skipped })
}

fn positions(text: &str) -> Option<Read> {
    let file = sp3::parse(text, "x").ok()?;
    let item = |(sv, orbit): (&Sv, &PreciseOrbit)| {
        let sv = *sv;
        orbit.points().to_vec().into_iter().map(move |point| format!("{sv} {point:?}"))
    };
    let items = file.orbits.iter().flat_map(item).collect();
    Some(Read {
        items,
        most_lost: file.orbits.len(),
        left_out: file.left_out,
        skipped: file.skipped,
    })
}

type Reader = fn(&str) -> Option<Read>;

/// The reader of a file by what it starts with, none if it is another kind of file.
fn reader(text: &str) -> Option<Reader> {
    let first = text.lines().find(|line| !line.trim().is_empty())?;
    match (first.starts_with('#'), first.get(20..21)) {
        (true, _) => Some(positions),
        _ if !first.to_ascii_uppercase().contains("RINEX VERSION / TYPE") => None,
        (_, Some("O")) => Some(observations),
        (_, Some("N")) => Some(ephemerides),
        _ => None,
    }
}

/// The first line after the header.
fn first_record(lines: &[String]) -> usize {
    let rinex = lines.iter().position(|line| line.contains("END OF HEADER")).map(|k| k + 1);
    rinex.or_else(|| lines.iter().position(|line| line.starts_with('*'))).unwrap_or(0)
}

/// One of forty kinds of damage of a random line: those from [`KINDS`] on of the header.
fn damage(text: &str, kind: usize, rng: &mut ChaCha8Rng) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let body = first_record(&lines).min(lines.len() - 1);
    let of = if kind < KINDS { body..lines.len() } else { 0..body.max(1) };
    let (at, other) = (rng.random_range(of.clone()), rng.random_range(of));
    let column = rng.random_range(0..lines[at].len().max(1)).min(lines[at].len());
    let put = |line: &str, with: &[u8]| {
        let mut bytes = line.as_bytes().to_vec();
        for (place, b) in bytes.iter_mut().skip(column).zip(with) {
            *place = *b;
        }
        String::from_utf8_lossy(&bytes).into_owned()
    };
    match kind % KINDS {
        0 => drop(lines.remove(at)),
        1 => lines.insert(at, lines[at].clone()),
        2 => lines.swap(at, other),
        3 => lines[at].truncate(column),
        4 => lines.insert(at, "> junk".into()),
        5 => lines.insert(at, format!("{:60}COMMENT", "here")),
        6 => lines[at] = lines[at].chars().rev().collect(),
        7 => lines[at].clear(),
        8 => lines[at] += &" ".repeat(200),
        9 => lines[at] = "#".repeat(100_000),
        10 => lines[at].insert(column, '0'),
        11 => drop((!lines[at].is_empty()).then(|| lines[at].remove(column))),
        12 => {
            // One bit.
            let flipped = lines[at].as_bytes().get(column).copied().unwrap_or(b' ')
                ^ 1 << rng.random_range(0..7);
            lines[at] = put(&lines[at], &[flipped]);
        }
        13 => lines[at] = lines[at].replace(' ', "\t"),
        k => {
            let words: [&[u8]; 6] = [b"NaN", b"99", b"*****", b"1e99", b"\0\0\0", b"\x1A"];
            lines[at] = put(&lines[at], words[k - 14]);
        }
    }
    lines.join(["\n", "\r\n", "\r"][rng.random_range(0..3)]) + "\n"
}

/// How many of the items are not among the others.
fn missing(items: &[String], others: &[String]) -> usize {
    let mut others: Vec<&String> = others.iter().collect();
    others.sort();
    let there = |item: &String| others.binary_search(&item).is_ok();
    items.iter().filter(|item| !there(item)).count()
}

/// What was made of the damaged files, and what should not have been.
#[derive(Default)]
struct Verdict {
    damaged: usize,
    refused: usize,
    /// Items.
    lost: usize,
    offences: Vec<String>,
}

impl Verdict {
    /// Judges what is read of a text with one kind of damage against what is read of the text.
    fn judge(&mut self, name: &str, kind: usize, text: &str, good: &Read, read: Option<Read>) {
        self.damaged += 1;
        let in_header = kind >= KINDS;
        let mut offend =
            |what: String| self.offences.push(format!("{name}, damage {kind}: {what}"));
        let Some(read) = read else {
            // What everything needs stands in the header; a file of one epoch or record may lose it.
            self.refused += 1;
            if !in_header && good.items.len() > good.most_lost {
                offend("refused".to_owned());
            }
            return;
        };
        let count =
            |read: &Read| read.left_out.kinds().iter().map(|kind| kind.count).sum::<usize>();
        // Two lines that change places are two that are damaged.
        let most_lost = good.most_lost * if kind % KINDS == 2 { 2 } else { 1 };
        let lost = missing(&good.items, &read.items);
        self.lost += lost;
        let told = format!("{lost} of {} are lost", good.items.len());
        if !in_header && lost > most_lost {
            offend(told.clone());
        }
        let is_named = count(&read) > count(good) || read.skipped > good.skipped;
        // Where a line of the header is gone, or its label, nobody knows that there was one.
        let is_unknowable = in_header && text.contains("SCALE FACTOR");
        if lost > most_lost && !is_named && !is_unknowable {
            offend(format!("{told}, nothing is said"));
        }
        // A value may be missing, but none may be another.
        let is_value = |item: &&String| !item.ends_with("None");
        let values: Vec<String> = read.items.iter().filter(is_value).cloned().collect();
        let others = missing(&values, &good.items);
        if OF_LINES.contains(&kind) && others > 0 {
            offend(format!("{others} values are not those of the file"));
        }
        for kind in read.left_out.kinds().iter().filter(|kind| !kind.first.contains(", line ")) {
            offend(kind.to_string());
        }
    }
}

#[test]
fn forty_kinds_of_damage_lose_what_they_touch_and_say_so() -> Result<(), Box<dyn Error>> {
    let Some(data) = std::env::var_os("SDR_RX_DATA").map(PathBuf::from) else {
        println!("SDR_RX_DATA is not set: files of others are not read");
        return Ok(());
    };
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut whole, mut verdict) = (0, Verdict::default());
    for path in ["obs", "nav", "cases"].iter().flat_map(|folder| files(&data.join(folder))) {
        let text = String::from_utf8_lossy(&std::fs::read(&path)?).into_owned();
        let text = text.replace("\r\n", "\n").replace('\r', "\n");
        let text: String = text.lines().take(MOST_LINES).map(|l| format!("{l}\n")).collect();
        let Some(reader) = reader(&text) else { continue };
        let Some(good) = reader(&text) else { continue };
        whole += 1;
        for kind in 0..2 * KINDS {
            let read = reader(&damage(&text, kind, &mut rng));
            verdict.judge(&path.display().to_string(), kind, &text, &good, read);
        }
    }
    let Verdict { damaged, refused, lost, offences } = verdict;
    println!("{whole} files, {damaged} damaged: {refused} refused, {lost} items lost");
    assert!(whole > 0 && offences.is_empty(), "{}", offences.join("\n"));
    Ok(())
}
