//! The records of accepted messages. Each subscriber has a log, which outlives it.
//!
//! A record has 64 bytes, so it lies within one page of the file. A `write` of it is complete or
//! absent, also if its process is killed during the call.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use crate::message::{self, Identity};

/// Size of a record in bytes.
pub const LEN: usize = 64;
const WHOLE: u32 = 0;
const TORN: u32 = 1;

/// The record of an accepted message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Whether the message was intact.
    pub whole: bool,
    /// The number of the topic.
    pub topic: u32,
    /// The sequence number under which the subscriber got the message.
    pub sequence: u64,
    /// The segment in the message; 0 if the message was torn.
    pub instance: u64,
    /// The writer in the message; 0 if the message was torn.
    pub writer: u64,
    /// The checksum of the message; 0 if the message was torn.
    pub checksum: u32,
    /// The number of lost messages before it that the subscriber reported.
    pub lost: u32,
    /// The time of publication on the ring's clock.
    pub timestamp_ns: u64,
}

impl Record {
    /// Returns the record of a message.
    pub fn of(topic: u32, meta: &conduit_ring::Meta, bytes: &[u8]) -> Record {
        let verified = message::verify(bytes, topic, meta.sequence);
        let torn = Identity {
            topic,
            writer: 0,
            instance: 0,
            sequence: meta.sequence,
        };
        let (identity, checksum) = verified.unwrap_or((torn, 0));
        Record {
            whole: verified.is_some(),
            topic,
            sequence: meta.sequence,
            instance: identity.instance,
            writer: identity.writer,
            checksum,
            lost: u32::try_from(meta.lost).unwrap_or(u32::MAX),
            timestamp_ns: meta.timestamp_ns,
        }
    }

    fn encode(&self) -> [u8; LEN] {
        let mut bytes = [0; LEN];
        let verdict = if self.whole { WHOLE } else { TORN };
        bytes[..4].copy_from_slice(&verdict.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.topic.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.instance.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.writer.to_le_bytes());
        bytes[32..36].copy_from_slice(&self.checksum.to_le_bytes());
        bytes[36..40].copy_from_slice(&self.lost.to_le_bytes());
        bytes[40..48].copy_from_slice(&self.timestamp_ns.to_le_bytes());
        bytes
    }

    fn decode(bytes: &[u8; LEN]) -> Record {
        let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let long = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        Record {
            whole: word(0) == WHOLE,
            topic: word(4),
            sequence: long(8),
            instance: long(16),
            writer: long(24),
            checksum: word(32),
            lost: word(36),
            timestamp_ns: long(40),
        }
    }
}

/// The log of a subscriber, for writing.
pub struct Log {
    file: File,
}

impl Log {
    /// Opens the log for appending.
    pub fn open(path: &Path) -> io::Result<Log> {
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        Ok(Log { file })
    }

    /// Appends a record. The record is in the file when this returns.
    pub fn append(&mut self, record: &Record) -> io::Result<()> {
        self.file.write_all(&record.encode())
    }
}

/// A log for reading, which removes its file at the end.
pub struct Tail {
    path: PathBuf,
    file: File,
    read: u64,
}

impl Tail {
    /// Creates an empty log.
    pub fn create(path: &Path) -> io::Result<Tail> {
        let file = OpenOptions::new()
            .create_new(true)
            .append(true)
            .read(true)
            .open(path)?;
        Ok(Tail {
            path: path.to_owned(),
            file,
            read: 0,
        })
    }

    /// Returns the records that were appended since the last call.
    pub fn read_new(&mut self) -> io::Result<Vec<Record>> {
        let mut records = Vec::new();
        let mut bytes = vec![0; 1024 * LEN];
        loop {
            let got = self.file.read_at(&mut bytes, self.read)?;
            let (whole, _) = bytes[..got].as_chunks::<LEN>();
            if whole.is_empty() {
                return Ok(records);
            }
            records.extend(whole.iter().map(Record::decode));
            self.read += (whole.len() * LEN) as u64;
        }
    }
}

impl Drop for Tail {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(sequence: u64, whole: bool) -> Record {
        Record {
            whole,
            topic: 5,
            sequence,
            instance: u64::MAX,
            writer: 1,
            checksum: 2,
            lost: 3,
            timestamp_ns: 4,
        }
    }

    #[test]
    fn records_are_read_once_and_in_order() {
        let path = std::env::temp_dir().join(format!("chaos-record-{}", std::process::id()));
        let mut tail = Tail::create(&path).unwrap();
        let mut log = Log::open(&path).unwrap();
        assert_eq!(tail.read_new().unwrap(), []);
        let records: Vec<_> = (0..3000).map(|n| record(n, n % 2 == 0)).collect();
        for record in &records {
            log.append(record).unwrap();
        }
        assert_eq!(tail.read_new().unwrap(), records);
        log.append(&record(9, true)).unwrap();
        assert_eq!(tail.read_new().unwrap(), [record(9, true)]);
        drop(tail);
        assert!(!path.exists());
    }
}
