//! Printing of records, as text or as one JSON object per line.

use program::Failure;
use program::stop::Stop;
use serde_json::Value;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};

/// A record to print. Its text is what `Display` writes.
pub trait Record: Display {
    /// Returns the record as a JSON object.
    fn json(&self) -> Value;
}

/// Prints records to stdout.
pub struct Output {
    json: bool,
    stop: Stop,
}

impl Output {
    /// Creates an output to stdout. Requests `stop` when the reader closes the pipe.
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

    /// Prints records as a table that starts with `head`; as JSON, prints the records alone. Tabs
    /// separate the columns of a record's text.
    pub fn put_table(&mut self, head: &str, records: &[impl Record]) -> Result<(), Failure> {
        if self.json {
            return records.iter().try_for_each(|record| self.put(record));
        }
        let texts = records.iter().map(ToString::to_string);
        let rows = std::iter::once(head.to_owned()).chain(texts);
        align(rows.collect())
            .iter()
            .try_for_each(|row| self.line(row))
    }

    fn line(&self, text: impl Display) -> Result<(), Failure> {
        match writeln!(io::stdout().lock(), "{text}") {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.stop.request(),
            Err(error) => {
                return Err(Failure::Runtime(format!(
                    "could not write to stdout: {error}"
                )));
            }
            Ok(()) => {}
        }
        Ok(())
    }

    /// Returns whether the stop was requested.
    pub fn stopped(&self) -> bool {
        self.stop.requested()
    }

    /// Returns the stop that ends the program.
    pub fn stop(&self) -> &Stop {
        &self.stop
    }
}

/// Formats a value, or a dash for none.
pub fn or_dash(value: Option<impl ToString>) -> String {
    value.map_or_else(|| "-".into(), |value| value.to_string())
}

/// Aligns the columns of rows.
fn align(rows: Vec<String>) -> Vec<String> {
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
        assert_eq!(align(rows), ["NAME      N", "imu       12", "µ-camera  3"]);
    }
}
