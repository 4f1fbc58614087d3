//! Where the verbs' answers go: records, one after the other, as text or as one JSON object a line.

use program::Failure;
use program::stop::Stop;
use serde_json::Value;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};

/// Something to print: its text is what `Display` gives.
pub trait Record: Display {
    /// The same as a JSON object.
    fn json(&self) -> Value;
}

/// The way to stdout.
pub struct Output {
    json: bool,
    stop: Stop,
}

impl Output {
    /// Prints to stdout. A reader that goes away requests `stop`.
    pub fn to_stdout(json: bool, stop: Stop) -> Output {
        Output { json, stop }
    }

    /// Prints one record.
    pub fn put(&mut self, record: &impl Record) -> Result<(), Failure> {
        if self.json {
            self.line(record.json())
        } else {
            self.line(record)
        }
    }

    /// Prints records as a table that begins with `head`; as JSON, the records alone. A record's text has a tab between
    /// two columns.
    pub fn put_table(&mut self, head: &str, records: &[impl Record]) -> Result<(), Failure> {
        if self.json {
            return records.iter().try_for_each(|record| self.put(record));
        }
        let rows = std::iter::once(head.to_owned()).chain(records.iter().map(ToString::to_string));
        aligned(rows.collect())
            .iter()
            .try_for_each(|row| self.line(row))
    }

    fn line(&self, text: impl Display) -> Result<(), Failure> {
        match writeln!(io::stdout().lock(), "{text}") {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.stop.request(),
            Err(error) => return Err(Failure::Runtime(format!("stdout: {error}"))),
            Ok(()) => {}
        }
        Ok(())
    }

    /// Whether whoever started this wants no more.
    pub fn stopped(&self) -> bool {
        self.stop.requested()
    }

    /// The wish that this ends.
    pub fn stop(&self) -> &Stop {
        &self.stop
    }
}

/// A cell that may be empty.
pub fn or_dash(value: Option<impl ToString>) -> String {
    value.map_or_else(|| "-".into(), |value| value.to_string())
}

/// Puts columns under each other.
fn aligned(rows: Vec<String>) -> Vec<String> {
    let cells: Vec<Vec<&str>> = rows.iter().map(|row| row.split('\t').collect()).collect();
    let columns = cells.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let widths = cells.iter().filter_map(|row| row.get(column));
        widths.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    cells
        .iter()
        .map(|row| {
            let padded = row
                .iter()
                .zip(&widths)
                .map(|(cell, &width)| format!("{cell:<width$}"));
            padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let rows = ["NAME\tN", "imu\t12", "µ-camera\t3"]
            .map(String::from)
            .to_vec();
        assert_eq!(
            aligned(rows),
            ["NAME      N", "imu       12", "µ-camera  3"]
        );
    }
}
