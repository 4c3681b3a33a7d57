//! Imports between files: the names that they take from each other.

use crate::source::Source;
use std::collections::{BTreeMap, BTreeSet};

/// A name that a file imports.
struct Import {
    /// As written: `super`, `outcome`, `Failure`.
    path: Vec<String>,
    /// Its name in the file.
    name: String,
    /// Whether it is exported again.
    passed_on: bool,
}

/// A file and its imports.
struct File<'a> {
    source: &'a Source,
    imports: Vec<Import>,
    /// Its code without the imports.
    rest: String,
}

/// All files, by crate and module such as `sdr_rx::capture::file`.
pub struct House<'a> {
    files: BTreeMap<String, File<'a>>,
}

impl<'a> House<'a> {
    /// Reads the imports of all files.
    pub fn new(sources: &'a [Source]) -> Self {
        let file = |source: &'a Source| {
            let (imports, rest) = imports(&source.code);
            (source.module.join("::"), File { source, imports, rest })
        };
        Self { files: sources.iter().map(file).collect() }
    }

    /// Each import of another room: path of the file, its room, the other.
    pub fn rooms(&self) -> BTreeSet<(&str, &str, String)> {
        let rooms: BTreeSet<&str> = self.files.values().filter_map(|f| f.source.room()).collect();
        let mut found = BTreeSet::new();
        for file in self.files.values() {
            let Some(room) = file.source.room() else { continue };
            for path in file.imports.iter().map(|i| i.path.clone()).chain(paths(&file.rest)) {
                // The root of sdr_rx re-exports crates under the names of their folders.
                let path = self.absolute(file.source, &path).unwrap_or_default();
                let index = usize::from(path.first().is_some_and(|krate| krate == "sdr_rx"));
                let other =
                    path.get(index).filter(|name| *name != room && rooms.contains(name.as_str()));
                found.extend(other.map(|other| (file.source.path.as_str(), room, other.clone())));
            }
        }
        found
    }

    /// A path from the root, its crate first; `None` for external ones.
    fn absolute(&self, from: &Source, path: &[String]) -> Option<Vec<String>> {
        let (first, rest) = path.split_first()?;
        let module = &from.module;
        match first.as_str() {
            "crate" => Some([&module[..1], rest].concat()),
            "self" => Some([module, rest].concat()),
            "super" => {
                let above = rest.iter().take_while(|name| *name == "super").count();
                Some([&module[..module.len().checked_sub(1 + above)?], &rest[above..]].concat())
            }
            "sdr_rx" => Some(path.to_vec()),
            other => match other.strip_prefix("sdr_rx_") {
                Some(krate) => Some([&[krate.to_owned()], rest].concat()),
                None => self
                    .files
                    .contains_key(&format!("{}::{first}", module.join("::")))
                    .then(|| [module, path].concat()),
            },
        }
    }

    /// The file that defines the item of a path from the root, through re-exports.
    fn definer(&self, path: &[String], depth: usize) -> Option<&str> {
        let length =
            (1..=path.len()).rev().find(|n| self.files.contains_key(&path[..*n].join("::")))?;
        let (module, file) = self.files.get_key_value(&path[..length].join("::"))?;
        let passed =
            path.get(length).and_then(|name| file.imports.iter().find(|i| i.name == *name));
        match passed {
            Some(import) if depth < 8 => {
                self.definer(&self.absolute(file.source, &import.path)?, depth + 1)
            }
            _ => Some(module),
        }
    }

    /// The files of its crate that a file depends on, without its own submodules: a `mod.rs` may both define common
    /// items of its files and call them.
    fn needs(&self, module: &str) -> BTreeSet<&str> {
        let file = &self.files[module];
        let behind = format!("{module}::");
        let own = file.imports.iter().filter(|i| !i.passed_on || has_word(&file.rest, &i.name));
        own.map(|import| import.path.clone())
            .chain(paths(&file.rest))
            .filter_map(|path| self.absolute(file.source, &path))
            .filter(|path| path[0] == file.source.module[0])
            .filter_map(|path| self.definer(&path, 0))
            .filter(|other| *other != module && !other.starts_with(&behind))
            .collect()
    }

    /// A cycle of each group of files that depend on each other: their paths.
    pub fn circles(&self) -> Vec<String> {
        let mut needs: BTreeMap<&str, BTreeSet<&str>> =
            self.files.keys().map(|module| (module.as_str(), self.needs(module))).collect();
        let mut circles = Vec::new();
        while let Some((first, _)) = needs.first_key_value() {
            // Along dependencies, until a file has none left, or one comes again.
            let (mut way, mut last) = (vec![*first], *first);
            while let Some(next) = needs[last].iter().find(|next| needs.contains_key(*next)) {
                if let Some(at) = way.iter().position(|module| module == next) {
                    let round =
                        way[at..].iter().chain([next]).map(|p| self.files[*p].source.path.as_str());
                    circles.push(round.collect::<Vec<_>>().join(" -> "));
                    break;
                }
                way.push(next);
                last = next;
            }
            needs.remove(last);
        }
        circles
    }
}

/// The imports of a file, and its code without them.
fn imports(code: &str) -> (Vec<Import>, String) {
    let (mut imports, mut rest, mut at) = (Vec::new(), String::new(), 0);
    while let Some(start) = find_word(&code[at..], "use").map(|found| at + found) {
        let end = code[start..].find(';').map_or(code.len(), |length| start + length);
        rest.push_str(&code[at..start]);
        let before = code[..start].trim_end();
        let passed_on = before.ends_with("pub")
            || (before.ends_with(')') && before.rfind("pub(") > before.rfind([';', '}']));
        expand(&[], &code[start + 3..end], passed_on, &mut imports);
        at = end;
    }
    rest.push_str(&code[at..]);
    (imports, rest)
}

/// Adds the names of a tree such as `crate::{capture::Block, tracking::{self, Channel as C}}`.
fn expand(prefix: &[String], tree: &str, passed_on: bool, imports: &mut Vec<Import>) {
    let (path, group) =
        tree.split_once('{').map_or((tree, None), |(path, group)| (path, Some(group)));
    let (path, alias) =
        path.split_once(" as ").map_or((path, None), |(path, name)| (path, Some(name)));
    let names = path.split("::").map(str::trim).filter(|name| !name.is_empty() && *name != "*");
    let path: Vec<String> = prefix.iter().cloned().chain(names.map(str::to_owned)).collect();
    if let Some(group) = group {
        for branch in branches(group) {
            expand(&path, branch, passed_on, imports);
        }
    } else if !path.is_empty() && !tree.trim().is_empty() {
        let selfless = path.len() > 1 && path[path.len() - 1] == "self";
        let path = if selfless { path[..path.len() - 1].to_vec() } else { path };
        let name = alias.unwrap_or(&path[path.len() - 1]).trim().to_owned();
        imports.push(Import { path, name, passed_on });
    }
}

/// The parts between the commas of a group, up to the brace that closes it.
fn branches(group: &str) -> Vec<&str> {
    let (mut branches, mut depth, mut start) = (Vec::new(), 0, 0);
    for (at, byte) in group.bytes().enumerate() {
        match byte {
            b'{' => depth += 1,
            b'}' if depth > 0 => depth -= 1,
            b',' | b'}' if depth == 0 => {
                branches.push(&group[start..at]);
                start = at + 1;
            }
            _ => {}
        }
        if byte == b'}' && depth == 0 && start == at + 1 {
            break;
        }
    }
    branches
}

/// The paths of two names or more that stand in code: `crate::capture::open` and `child::function`.
fn paths(code: &str) -> impl Iterator<Item = Vec<String>> {
    code.split(|c: char| !c.is_alphanumeric() && !matches!(c, '_' | ':'))
        .filter(|word| word.contains("::"))
        .map(|word| word.split("::").filter(|name| !name.is_empty()).map(str::to_owned).collect())
}

fn find_word(code: &str, word: &str) -> Option<usize> {
    let part = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(word)
        .map(|(at, _)| at)
        .find(|at| !code[..*at].ends_with(part) && !code[at + word.len()..].starts_with(part))
}

fn has_word(code: &str, word: &str) -> bool {
    find_word(code, word).is_some()
}
