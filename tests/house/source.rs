//! Rust as text: a file without its comments, its strings and what is compiled for tests alone.

use std::ops::Range;
use std::path::{Path, PathBuf};

/// A file of sources.
pub struct Source {
    /// Its path from the repository.
    pub path: String,
    /// Its crate (that of its folder in crates/, or `sdr_rx`) and module.
    pub module: Vec<String>,
    /// The text, with blanks for comments, for the insides of literals and for what is compiled for tests alone.
    pub code: String,
    /// Modules in files of their own that are compiled for tests alone.
    tests: Vec<String>,
    text: String,
    literals: Vec<Range<usize>>,
}

impl Source {
    /// The text of the file at a path such as `src/capture/mod.rs` or `crates/gnss/src/time.rs`.
    pub fn new(krate: &str, path: &str, text: &str) -> Self {
        let inside = path.split_once("src/").map_or(path, |(_, inside)| inside);
        let names =
            inside.trim_end_matches(".rs").split('/').filter(|n| !["mod", "lib"].contains(n));
        let module = [krate].into_iter().chain(names).map(str::to_owned).collect();
        let (mut code, literals) = without_comments(text);
        let tests = remove_tests(&mut code);
        let code = String::from_utf8_lossy(&code).into_owned();
        Self { path: path.into(), module, code, tests, text: text.into(), literals }
    }

    /// The room that the file belongs to: the crate, or of `sdr_rx` the folder or file in src/; none of its roots.
    pub fn room(&self) -> Option<&str> {
        let room = if self.module[0] == "sdr_rx" { self.module.get(1)? } else { &self.module[0] };
        (room != "main").then_some(room)
    }

    /// The strings outside tests, with their lines.
    pub fn strings(&self) -> impl Iterator<Item = (usize, &str)> {
        let kept = self.literals.iter().filter(|r| self.code[r.start - 1..].starts_with('"'));
        kept.map(|r| (self.text[..r.start].matches('\n').count() + 1, &self.text[r.clone()]))
    }
}

/// The sources in a folder, without those that are compiled for tests alone.
pub fn read(krate: &str, folder: &Path, repository: &Path) -> Result<Vec<Source>, std::io::Error> {
    let mut sources = Vec::new();
    for path in files(folder)? {
        let name = path.strip_prefix(repository).unwrap_or(&path).display().to_string();
        sources.push(Source::new(krate, &name, &std::fs::read_to_string(&path)?));
    }
    let tests: Vec<Vec<String>> = sources
        .iter()
        .flat_map(|s| {
            s.tests.iter().map(|name| [&s.module[..], std::slice::from_ref(name)].concat())
        })
        .collect();
    sources.retain(|s| !tests.iter().any(|test| s.module.starts_with(test)));
    Ok(sources)
}

fn files(folder: &Path) -> Result<Vec<PathBuf>, std::io::Error> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(files(&path)?);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// The text with blanks for comments and for the insides of literals, and the positions of the insides of strings.
fn without_comments(text: &str) -> (Vec<u8>, Vec<Range<usize>>) {
    let bytes = text.as_bytes();
    let (mut code, mut strings) = (bytes.to_vec(), Vec::new());
    let find =
        |from: usize, what: &str| text[from..].find(what).map_or(bytes.len(), |at| from + at);
    let mut at = 0;
    while at < bytes.len() {
        let next = at + 1;
        // Range to be blanked, and where reading goes on.
        let (inside, after) = match bytes[at..] {
            [b'/', b'/', ..] => (at..find(at, "\n"), find(at, "\n")),
            [b'/', b'*', ..] => (at..find(at, "*/"), find(at, "*/")),
            [b'"', ..] => {
                let end = end_of_string(text, at);
                strings.push(next..end);
                (next..end, end + 1)
            }
            [b'\'', b'\\', ..] => (next..find(at + 3, "'"), find(at + 3, "'") + 1),
            [b'\'', ..] => {
                // A character, or the name of a lifetime.
                let end = next + text[next..].chars().next().map_or(0, char::len_utf8);
                if bytes.get(end) == Some(&b'\'') { (next..end, end + 1) } else { (at..at, next) }
            }
            _ => (at..at, next),
        };
        blank(&mut code, inside);
        at = after;
    }
    (code, strings)
}

/// Where the string that begins at `at` ends: the position of its second quotation mark.
fn end_of_string(text: &str, at: usize) -> usize {
    let hashes = text[..at].bytes().rev().take_while(|b| *b == b'#').count();
    if text[..at - hashes].ends_with('r') {
        let end = format!("\"{}", "#".repeat(hashes));
        return text[at + 1..].find(&end).map_or(text.len(), |length| at + 1 + length);
    }
    let mut escaped = false;
    let end = text[at + 1..].find(|c| {
        let ends = c == '"' && !escaped;
        escaped = c == '\\' && !escaped;
        ends
    });
    end.map_or(text.len(), |length| at + 1 + length)
}

/// Blanks what is compiled for tests alone; the names of its modules that are files of their own.
fn remove_tests(code: &mut [u8]) -> Vec<String> {
    const MARK: &[u8] = b"#[cfg(test)]";
    let mut modules = Vec::new();
    while let Some(start) = code.windows(MARK.len()).position(|window| window == MARK) {
        let end = end_of_item(code, start + MARK.len());
        let item = String::from_utf8_lossy(&code[start..end]).into_owned();
        let name = item.rsplit_once("mod ").and_then(|(_, name)| name.strip_suffix(';'));
        modules.extend(name.map(str::to_owned));
        blank(code, start..end);
    }
    modules
}

/// Behind the first semicolon outside of brackets, or the first brace that closes all.
fn end_of_item(code: &[u8], from: usize) -> usize {
    let mut depth = 0;
    for (at, byte) in code.iter().enumerate().skip(from) {
        match byte {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth -= 1,
            _ => {}
        }
        if depth == 0 && matches!(byte, b';' | b'}') {
            return at + 1;
        }
    }
    code.len()
}

fn blank(code: &mut [u8], range: Range<usize>) {
    code[range].iter_mut().filter(|b| **b != b'\n').for_each(|b| *b = b' ');
}
