use super::*;
use crate::format::rinex_obs::ObservationReader;
use crate::observation::{Observation, ObservationEpoch};
use proptest::prelude::*;

/// Observation files and what RNX2CRX 4.1.0 of the Geospatial Information Authority of Japan makes of them: satellites come and
/// go, values miss, clocks, flags, more satellites than a line has room for, an event that changes the types.
const FILES: [(&str, &str); 2] = [
    (include_str!("v2.24o"), include_str!("v2.24d")),
    (include_str!("v3.rnx"), include_str!("v3.crx")),
];

/// The decoded lines, and what is left out.
fn decoded(text: &str) -> (Vec<String>, Vec<String>) {
    let line = |(k, text)| Line { format: "RINEX", file: "x.crx", number: k + 1, text };
    let mut lines = text.lines().enumerate().map(line);
    let mut compact = Compact::new(&lines.next().unwrap()).unwrap();
    let losses = lines.filter_map(|line| compact.push(&line, false).err());
    let losses = losses.map(|(what, error)| format!("{what}: {error}")).collect();
    compact.finish();
    (std::iter::from_fn(|| compact.pop()).map(|line| line.1).collect(), losses)
}

/// Epochs read, and what is named, if anything.
fn read(text: &str) -> Option<(Vec<ObservationEpoch>, Vec<String>)> {
    let mut reader = ObservationReader::new(text.as_bytes(), "x.crx").ok()?;
    let epochs = reader.by_ref().map_while(Result::ok).collect();
    Some((epochs, reader.left_out().kinds().iter().map(ToString::to_string).collect()))
}

#[test]
fn what_rnx2crx_wrote_is_the_file_that_it_read() {
    for (original, compact) in FILES {
        let (lines, losses) = decoded(compact);
        assert_eq!(losses, [""; 0]);
        let theirs: Vec<&str> = original.lines().map(str::trim_end).collect();
        for (k, (ours, theirs)) in lines.iter().zip(&theirs).enumerate() {
            assert_eq!(ours, theirs, "line {}", k + 1);
        }
        assert_eq!(lines.len(), theirs.len());
        assert_eq!(read(compact), read(original));
        let twice = read(&format!("{compact}{compact}")).unwrap();
        assert_eq!((twice.0.len(), twice.1.len()), (2 * read(original).unwrap().0.len(), 0));
        let mixed = read(&format!("{compact}{original}{compact}")).unwrap();
        assert_eq!((mixed.0.len(), mixed.1.len()), (3 * read(original).unwrap().0.len(), 0));
    }
}

#[test]
fn a_line_lost_or_doubled_never_gives_a_value_to_another_satellite() {
    for (original, compact) in FILES {
        let (good, _) = read(original).unwrap();
        let lines: Vec<&str> = compact.lines().collect();
        let body = lines.iter().position(|line| line.contains("END OF HEADER")).unwrap() + 1;
        // The types of observations are what an event's lines say.
        let is_event = |line: &str| line.len() > 60 && line[60..].contains("OBS");
        for at in body..lines.len() {
            if is_event(lines[at]) {
                continue;
            }
            let (mut lost, mut doubled) = (lines.clone(), lines.clone());
            lost.remove(at);
            doubled.insert(at, lines[at]);
            for changed in [lost, doubled] {
                let Some((epochs, named)) = read(&format!("{}\n", changed.join("\n"))) else {
                    continue;
                };
                for epoch in &epochs {
                    let same = good.iter().find(|e| e.receive_time == epoch.receive_time);
                    let same =
                        same.unwrap_or_else(|| panic!("line {}: an epoch of its own", at + 1));
                    for o in &epoch.observations {
                        let of = |p: &&Observation| p.transmission == o.transmission;
                        let theirs = same.observations.iter().find(of).unwrap();
                        assert_eq!(o.range, theirs.range, "line {} ('{}')", at + 1, lines[at]);
                    }
                }
                assert!(epochs.len() == good.len() || !named.is_empty(), "line {}", at + 1);
            }
        }
    }
}

#[test]
fn a_damaged_number_loses_its_series_and_a_cut_file_its_last_value() {
    let (original, compact) = FILES[1];
    let (good, _) = read(original).unwrap();
    // The code of J02.
    let entry = "\n-5990 -5990 -5990 -5990 ";
    assert!(compact.contains(entry));
    let (epochs, named) = read(&compact.replacen(entry, "\n-59x0 -5990 -5990 -5990 ", 1)).unwrap();
    assert_eq!(named.len(), 1);
    assert!(named[0].contains("'-59x0' of J02 is no value"), "{}", named[0]);
    let mut missing = 0;
    for (ours, theirs) in epochs.iter().zip(&good) {
        for (o, t) in ours.observations.iter().zip(&theirs.observations) {
            assert_eq!((o.transmission, o.doppler_hz), (t.transmission, t.doppler_hz));
            missing += usize::from(o.range.is_none() && t.range.is_some());
            assert!(o.range == t.range || o.range.is_none() && o.sv().to_string() == "J02");
        }
    }
    assert!((1..=6).contains(&missing), "{missing}");
    let cut = compact.trim_end();
    let (epochs, _) = read(&cut[..cut.len() - 1]).unwrap();
    assert_eq!(epochs.len(), good.len());
}

#[test]
fn numbers_follow_from_their_differences_up_to_the_order_stated() {
    // Third differences of k^4, in thousandths.
    let values = [0i64, 1, 16, 81, 256, 625, 1296];
    let mut series = Series::default();
    assert_eq!(series.take("5"), Number::NotBegun);
    assert_eq!(series.take("3&0"), Number::Value(0));
    for (entry, value) in ["1", "14", "36", "60", "84", "108"].iter().zip(&values[1..]) {
        assert_eq!(series.take(entry), Number::Value(*value));
    }
    assert_eq!(series.take("-"), Number::Wrong);
    assert_eq!(series.take("7"), Number::Missing);
    assert_eq!(series.take("0&-7"), Number::Value(-7));
    assert_eq!(series.take("9"), Number::Value(9));
    assert_eq!(series.take(""), Number::Missing);
    assert_eq!(series.take("1"), Number::NotBegun);
    for wrong in ["3&", "&3", "10&3", "x&3", "3&3&3", "3&99999999999999"] {
        assert_eq!(Series::default().take(wrong), Number::Wrong, "{wrong}");
    }
    assert_eq!(changed("G01 G02", "  7  &&5"), "G07 G  5");
    assert_eq!(decimal(-5, 3, 14), "        -0.005");
    assert_eq!(decimal(-123_456_789_012, 12, 15), "-0.123456789012");
    assert_eq!(decimal(-123_456_789, 9, 12), "-0.123456789");
}

proptest! {
    #[test]
    fn mutilated_files_never_panic(
        which in 0usize..2,
        at in 0usize..4000,
        with in "[ -~]{0,9}\n?",
        cut in 0usize..12_000,
    ) {
        let mut text = FILES[which].1.to_owned();
        let at = at.min(text.len());
        let to = (at + with.len()).min(text.len());
        text.replace_range(at..to, &with);
        let _ = read(&text);
        let _ = read(text.get(..cut).unwrap_or(&text));
    }
}
