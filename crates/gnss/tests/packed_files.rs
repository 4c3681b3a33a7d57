//! Files as archives keep them: packed by gzip, compact, under any name.

use flate2::Compression;
use flate2::write::GzEncoder;
use sdr_rx_gnss::format::{ReadError, rinex_nav, rinex_obs, sp3};
use sdr_rx_gnss::observation::ObservationEpoch;
use std::error::Error;
use std::io::Write;
use std::path::PathBuf;

const RINEX: &str = include_str!("../src/format/rinex_obs/compact/v3.rnx");
const COMPACT: &str = include_str!("../src/format/rinex_obs/compact/v3.crx");

fn gzip(text: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(text.as_bytes()).expect("memory");
    encoder.finish().expect("memory")
}

/// A folder for files.
struct Folder(tempfile::TempDir);

impl Folder {
    fn write(&self, name: &str, bytes: &[u8]) -> std::io::Result<PathBuf> {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).map(|()| path)
    }
}

/// All epochs of a file, and what was left out.
fn observations(path: &PathBuf) -> Result<(Vec<ObservationEpoch>, Vec<String>), ReadError> {
    let mut reader = rinex_obs::open(path)?;
    let epochs = reader.by_ref().collect::<Result<_, _>>()?;
    Ok((epochs, reader.left_out().kinds().iter().map(ToString::to_string).collect()))
}

/// An SP3 file with one satellite, and a navigation file with one record.
fn orbits() -> (String, String) {
    let mut table = "#dP2022  1  1  0  0  0.00000000       2 ORBIT IGS20 HLM  IGS\n".to_owned();
    table += "%c M  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc\n";
    for minute in [0, 15] {
        table += &format!("*  2022  1  1  0 {minute:2}  0.00000000\n");
        table += "PG05  20000.000000  -5000.000000  15000.000000    123.500000\n";
    }
    let zeros = format!("    {}\n", " 0.000000000000D+00".repeat(4));
    let mut record =
        format!("{:60}RINEX VERSION / TYPE\n", "     3.04           N: GNSS NAV DATA    G: GPS");
    record += &format!("{:60}END OF HEADER\n", "");
    record += &format!("G01 2022 01 01 00 00 00{}\n", " 0.000000000000D+00".repeat(3));
    record += &zeros;
    record += "     0.000000000000D+00 0.100000000000D-01 0.000000000000D+00 0.515367499542D+04\n";
    record += "     0.518400000000D+06 0.000000000000D+00 0.000000000000D+00 0.000000000000D+00\n";
    record += &zeros;
    record += "     0.000000000000D+00 0.000000000000D+00 0.219000000000D+04 0.000000000000D+00\n";
    (table + "EOF\n", record + &zeros + &zeros)
}

#[test]
fn packed_files_are_what_they_hold_whatever_their_name() -> Result<(), Box<dyn Error>> {
    let folder = Folder(tempfile::tempdir()?);
    let whole = observations(&folder.write("a.rnx", RINEX.as_bytes())?)?;
    assert!(whole.0.len() == 14 && whole.1.is_empty());
    for (name, bytes) in [
        ("b.crx.gz", gzip(COMPACT)),
        ("c.rnx", gzip(RINEX)),
        ("d.gz", COMPACT.into()),
        ("e.rnx", format!("\u{feff}{}", COMPACT.replace('\n', "\r\n")).into()),
        ("f.gz", gzip(&format!("\n{RINEX}"))),
    ] {
        assert_eq!(observations(&folder.write(name, &bytes)?)?, whole, "{name}");
    }
    let (table, record) = orbits();
    let plain = sp3::parse(&table, "x")?;
    assert_eq!(sp3::read(folder.write("g.sp3", &gzip(&table))?)?, plain);
    let plain = rinex_nav::parse(&record, "x")?;
    assert_eq!(plain.data.iter().count(), 1);
    assert_eq!(rinex_nav::read(folder.write("h.rnx.gz", &gzip(&record))?)?, plain);
    Ok(())
}

#[test]
fn what_came_before_the_end_of_a_cut_packed_file_is_used() -> Result<(), Box<dyn Error>> {
    let folder = Folder(tempfile::tempdir()?);
    let whole = observations(&folder.write("a.rnx", RINEX.as_bytes())?)?;
    let packed = gzip(RINEX);
    let path = folder.write("cut.rnx.gz", &packed[..packed.len() - 40])?;
    let (epochs, left_out) = observations(&path)?;
    assert!(epochs.len() >= whole.0.len() - 2, "{} epochs", epochs.len());
    assert_eq!(epochs[..epochs.len() - 1], whole.0[..epochs.len() - 1]);
    let named = left_out.join("; ");
    assert!(
        named.contains("ends of packed files left out") && named.contains("cut.rnx.gz"),
        "{named}"
    );
    // Nothing is left where the header is cut.
    let error = observations(&folder.write("less.rnx.gz", &packed[..60])?).unwrap_err().to_string();
    assert!(
        error.starts_with("reading the RINEX file") && error.contains("less.rnx.gz"),
        "{error}"
    );
    let (table, _) = orbits();
    let packed = gzip(&table);
    let file = sp3::read(folder.write("cut.sp3.gz", &packed[..packed.len() - 4])?)?;
    assert_eq!(file.orbits.len(), 1);
    assert_eq!(file.left_out.kinds()[0].what, "ends of packed files left out");
    Ok(())
}
