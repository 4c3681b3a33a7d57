//! Runs the program and reads its output.

use crate::common::Failed;
use assert_cmd::Command;
use nalgebra::Vector3;
use serde_json::Value;
use std::path::Path;

/// Output of a run of the program.
pub struct Answer {
    /// Exit code.
    pub code: i32,
    /// The JSON record, null where there is none.
    pub json: Value,
    /// The record's bytes.
    pub bytes: Vec<u8>,
    /// Standard error.
    pub stderr: String,
}

/// Runs `sdr-rx` with these arguments and `--json -`.
pub fn run(arguments: &[&str]) -> Result<Answer, Failed> {
    let output = Command::new(env!("CARGO_BIN_EXE_sdr-rx"))
        .args(arguments)
        .args(["--json", "-"])
        .output()?;
    Ok(Answer {
        code: output.status.code().ok_or("killed")?,
        json: serde_json::from_slice(&output.stdout).unwrap_or_default(),
        bytes: output.stdout,
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    })
}

impl Answer {
    /// All messages: warnings, the reason of a missing fix, errors.
    pub fn messages(&self) -> String {
        format!("{}{}", self.stderr, self.json["reason"].as_str().unwrap_or_default())
    }

    /// The rows of a list of the record.
    pub fn rows(&self, name: &str) -> &[Value] {
        self.json[name].as_array().map_or(&[], Vec::as_slice)
    }

    /// Names of the satellites acquired, sorted.
    pub fn satellites(&self) -> Vec<String> {
        let name = |row: &Value| row["sv"].as_str().unwrap_or_default().to_owned();
        let mut names: Vec<String> = self.rows("acquisitions").iter().map(name).collect();
        names.sort();
        names
    }

    /// A number of one acquisition; NaN where it is missing.
    pub fn acquired(&self, sv: &str, field: &str) -> f64 {
        let row = self.rows("acquisitions").iter().find(|row| row["sv"] == sv);
        row.and_then(|row| row[field].as_f64()).unwrap_or(f64::NAN)
    }
}

/// A vector of the record; NaN where it is missing.
pub fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_fn(|k, _| value[k].as_f64().unwrap_or(f64::NAN))
}

/// Median of some numbers, NaN of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// A file of the data folder as an argument.
pub fn file(data: &Path, name: &str) -> String {
    data.join(name).display().to_string()
}
