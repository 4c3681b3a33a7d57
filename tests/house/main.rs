//! The structure of the sources: layers of modules, cycles, words and names.

#[path = "../common/mod.rs"]
mod common;
mod imports;
mod source;

use common::Tested;
use imports::House;
use source::Source;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Modules ("rooms"), each with its layer ("floor").
type Floors = BTreeMap<String, usize>;

/// The layers in CONTRIBUTING.md: lines such as `2 | capture, correlator   samples and codes`.
fn floors(page: &str) -> Floors {
    let line = |line: &str| -> Option<Vec<(String, usize)>> {
        let (floor, rooms) = line.split_once(" | ")?;
        let floor = floor.trim().parse().ok()?;
        let rooms = rooms.split("  ").next()?.split(", ");
        Some(rooms.map(|room| (room.trim().to_owned(), floor)).collect())
    };
    page.lines().filter_map(line).flatten().collect()
}

fn drawn_floors() -> Result<Floors, std::io::Error> {
    Ok(floors(&std::fs::read_to_string(repository().join("CONTRIBUTING.md"))?))
}

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All sources of the program and of the crates.
fn sources() -> Result<Vec<Source>, std::io::Error> {
    let mut folders = vec![("sdr_rx".to_owned(), repository().join("src"))];
    for entry in std::fs::read_dir(repository().join("crates"))? {
        let folder = entry?.path();
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        folders.push((name, folder.join("src")));
    }
    let mut sources = Vec::new();
    for (name, folder) in folders {
        sources.extend(source::read(&name, &folder, repository())?);
    }
    Ok(sources)
}

/// Fails with all violations, one a line.
fn none(offences: Vec<String>) -> Tested {
    if offences.is_empty() { Ok(()) } else { Err(format!("\n{}", offences.join("\n")).into()) }
}

/// Imports of rooms that are not on a floor below.
fn upward(house: &House, floors: &Floors) -> Vec<String> {
    let floor = |room: &str| floors.get(room).copied();
    house
        .rooms()
        .into_iter()
        .filter(|(_, from, to)| floor(to).is_none() || floor(to) >= floor(from))
        .map(|(path, from, to)| {
            format!("{path}: {from} (floor {:?}) imports {to} ({:?})", floor(from), floor(&to))
        })
        .collect()
}

#[test]
fn each_room_imports_only_from_floors_below() -> Tested {
    let floors = drawn_floors()?;
    assert!(floors.values().max() <= Some(&8), "more than eight floors");
    none(upward(&House::new(&sources()?), &floors))
}

#[test]
fn the_drawing_shows_the_rooms_that_there_are() -> Tested {
    let (floors, sources) = (drawn_floors()?, sources()?);
    let rooms: BTreeSet<&str> = sources.iter().filter_map(Source::room).collect();
    assert_eq!(floors.keys().map(String::as_str).collect::<BTreeSet<_>>(), rooms);
    Ok(())
}

#[test]
fn no_files_import_each_other_in_a_circle() -> Tested {
    none(House::new(&sources()?).circles())
}

#[test]
fn only_the_command_line_names_its_options() -> Tested {
    let of_library = |path: &str| {
        let below = ["gnss", "position", "network", "linalg"];
        (path.starts_with("src/") && !path.starts_with("src/cli/"))
            || below.iter().any(|name| path.starts_with(&format!("crates/{name}/src/")))
    };
    let names_option = |text: &str| {
        text.match_indices("--")
            .any(|(at, _)| text[at + 2..].starts_with(|c: char| c.is_ascii_lowercase()))
    };
    let mut offences = Vec::new();
    for source in sources()?.iter().filter(|s| of_library(&s.path)) {
        for (line, text) in source.strings().filter(|(_, text)| names_option(text)) {
            offences.push(format!("{}:{line}: \"{text}\"", source.path));
        }
    }
    none(offences)
}

/// Names of constants of one signal.
const NAMES_OF_A_SIGNAL: [&str; 6] = [
    "CA_CHIP_RATE",
    "CA_CODE_LENGTH",
    "CA_CODE_PERIOD",
    "L1_HZ",
    "CYCLES_PER_CHIP",
    "PERIODS_PER_BIT",
];
/// Its numbers: chips, chip rate, carrier, cycles of the carrier in a chip.
const NUMBERS_OF_A_SIGNAL: [&str; 5] = ["1023", "1.023e6", "1575.42e6", "1575420000", "154"];

/// Lines of code that name or repeat a constant of one signal.
fn knows_a_signal(source: &Source) -> Vec<String> {
    let number = |word: &str| -> String {
        let word = word.replace('_', "");
        let plain = ["f64", "f32", "usize", "u64", "u32", "u16", "i64", "i32"]
            .iter()
            .find_map(|kind| word.strip_suffix(kind))
            .unwrap_or(&word);
        plain.trim_end_matches(".0").trim_end_matches('.').to_owned()
    };
    let knows = |line: &str| {
        let code = line.replace("..", " ");
        let mut words = code.split(|c: char| !c.is_alphanumeric() && !matches!(c, '_' | '.'));
        words.any(|word| {
            NAMES_OF_A_SIGNAL.contains(&word)
                || NUMBERS_OF_A_SIGNAL.contains(&number(word).as_str())
        })
    };
    let lines = source.code.lines().enumerate().filter(|(_, line)| knows(line));
    lines.map(|(k, line)| format!("{}:{}: {}", source.path, k + 1, line.trim())).collect()
}

#[test]
fn the_numbers_of_a_signal_are_found_in_every_form() {
    let known = |code: &str| knows_a_signal(&Source::new("sdr_rx", "src/a.rs", code)).len();
    for code in ["a = 1023;", "1_023_usize", "0..1023", "1.023e6_f64", "1_575.42e6", "154.0 * x"] {
        assert_eq!(known(code), 1, "{code}");
    }
    assert_eq!(known("use crate::constants::{L1_HZ, PI};"), 1);
    assert_eq!(
        known("a.1540; x1023; // 1023\nlet s = \"1023\"; #[cfg(test)]\nconst A: u8 = 1023;"),
        0
    );
}

#[test]
fn no_room_but_signal_knows_the_numbers_of_a_signal() -> Tested {
    let sources = sources()?;
    let others = sources.iter().filter(|s| !s.path.starts_with("crates/gnss/src/signal/"));
    none(others.flat_map(knows_a_signal).collect())
}

/// Names of public types, each with the files that define it.
fn public_types(sources: &[Source]) -> BTreeMap<&str, Vec<&str>> {
    let mut types = BTreeMap::<_, Vec<_>>::new();
    for source in sources {
        for (at, _) in source.code.match_indices("pub ") {
            let mut words = source.code[at + 4..].split(|c: char| !c.is_alphanumeric() && c != '_');
            if let (Some("struct" | "enum" | "trait" | "type"), Some(name)) =
                (words.next(), words.next())
            {
                types.entry(name).or_default().push(source.path.as_str());
            }
        }
    }
    types
}

#[test]
fn no_two_public_types_share_a_name() -> Tested {
    let sources = sources()?;
    let shared = public_types(&sources).into_iter().filter(|(_, files)| files.len() > 1);
    none(shared.map(|(name, files)| format!("{name}: {}", files.join(", "))).collect())
}

/// Sources from texts: paths with the contents of the files.
fn made(files: &[(&str, &str)]) -> Vec<Source> {
    files.iter().map(|(path, text)| Source::new("sdr_rx", path, text)).collect()
}

#[test]
fn an_upward_import_is_found_in_every_form_and_not_in_tests() {
    let floors = floors("2 | tracking, array   beams\n1 | capture\n");
    let offences = |text: &str| {
        let house = made(&[
            ("src/lib.rs", "pub mod capture; pub mod tracking;"),
            ("src/capture/mod.rs", "mod file;"),
            ("src/capture/file.rs", text),
            ("src/tracking.rs", "use crate::capture::Block;"),
            ("src/array.rs", ""),
        ]);
        upward(&House::new(&house), &floors).len()
    };
    assert_eq!(offences("use std::io;\nuse super::Block;"), 0);
    assert_eq!(offences("use crate::{capture::Block, tracking::{self, Channel}};"), 1);
    assert_eq!(offences("pub(super) use super::super::tracking::Channel;"), 1);
    assert_eq!(offences("fn f() { crate::tracking::run(\"}\", '\"') }"), 1);
    assert_eq!(
        offences("// use crate::tracking::Channel;\nconst T: &str = \"crate::tracking::x\";"),
        0
    );
    assert_eq!(offences("#[cfg(test)]\nmod tests {\n use crate::tracking::Channel;\n}"), 0);
    assert_eq!(
        offences(
            "#[cfg(test)]\n#[allow(unused)]\nuse crate::{array, tracking};\nuse crate::array::Beam;"
        ),
        1
    );
    // Modules of one layer do not import each other.
    let neighbours =
        made(&[("src/array.rs", "use crate::tracking::Channel;"), ("src/tracking.rs", "")]);
    assert_eq!(upward(&House::new(&neighbours), &floors).len(), 1);
}

#[test]
fn a_cycle_of_files_is_found_and_a_re_export_is_none() {
    let circles = |door: &str, first: &str, second: &str| {
        let house =
            made(&[("src/a/mod.rs", door), ("src/a/first.rs", first), ("src/a/second.rs", second)]);
        House::new(&house).circles()
    };
    let door = "mod first; mod second; pub use first::One; pub use second::Two;";
    assert!(
        circles(door, "pub struct One;", "use super::first::One;\npub struct Two(One);").is_empty()
    );
    assert!(circles(door, "pub struct One;", "use super::One;\npub struct Two(One);").is_empty());
    let tied =
        circles(door, "use super::Two; pub struct One;", "use super::One;\npub struct Two(One);");
    assert_eq!(tied, ["src/a/first.rs -> src/a/second.rs -> src/a/first.rs"]);
    let called = format!("{door}\npub struct Zero;\nfn f() {{ first::run() }}");
    assert!(circles(&called, "use super::Zero;\npub struct One;", "").is_empty());
}

#[test]
fn two_public_types_of_one_name_are_found_and_private_ones_are_not() {
    let house = made(&[
        ("src/a.rs", "pub struct Row<T>(T);\npub(crate) enum State {}\nstruct Header;"),
        (
            "src/b.rs",
            "pub enum Row {}\npub struct State;\npub struct Header;\n// pub struct Header",
        ),
    ]);
    let shared: Vec<_> = public_types(&house).into_iter().filter(|(_, f)| f.len() > 1).collect();
    assert_eq!(shared, [("Row", vec!["src/a.rs", "src/b.rs"])]);
}
