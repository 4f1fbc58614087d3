//! What a subscriber notes of each message that it was given, in a log of its own that outlives it.
//!
//! A record has 64 bytes, so that it lies within one page of the file: one `write` of it is done or not, also when
//! its process is killed in the midst.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use crate::message::{self, Identity};

/// Bytes of a record.
pub const LEN: usize = 64;
const WHOLE: u32 = 0;
const TORN: u32 = 1;

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Whether the message proved to be what was published.
    pub whole: bool,
    /// The topic that the subscriber reads.
    pub topic: u32,
    /// The number under which the message was given.
    pub sequence: u64,
    /// The segment that the message names; 0 if torn.
    pub instance: u64,
    /// The life of a publisher that the message names; 0 if torn.
    pub writer: u64,
    /// The message's checksum; 0 if torn.
    pub checksum: u32,
    /// How many messages the subscriber was told to have lost before it.
    pub lost: u32,
    /// When it was published, on the ring's clock.
    pub timestamp_ns: u64,
}

impl Record {
    /// What there is to note of a message.
    pub fn of(topic: u32, meta: &conduit_ring::Meta, bytes: &[u8]) -> Record {
        let proof = message::verify(bytes, topic, meta.sequence);
        let torn = Identity {
            topic,
            writer: 0,
            instance: 0,
            sequence: meta.sequence,
        };
        let (identity, checksum) = proof.unwrap_or((torn, 0));
        Record {
            whole: proof.is_some(),
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

/// A subscriber's end of its log.
pub struct Log {
    file: File,
}

impl Log {
    /// Opens the log for appending.
    pub fn open(path: &Path) -> io::Result<Log> {
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        Ok(Log { file })
    }

    /// Appends a record; it is in the file when this returns.
    pub fn append(&mut self, record: &Record) -> io::Result<()> {
        self.file.write_all(&record.encode())
    }
}

/// The judge's end of a log, which follows what is appended. The file goes with it.
pub struct Tail {
    path: PathBuf,
    file: File,
    read: u64,
}

impl Tail {
    /// Makes an empty log.
    pub fn create(path: &Path) -> io::Result<Tail> {
        let options = OpenOptions::new()
            .create_new(true)
            .append(true)
            .read(true)
            .open(path)?;
        Ok(Tail {
            path: path.to_owned(),
            file: options,
            read: 0,
        })
    }

    /// The records that were appended since the last time.
    pub fn news(&mut self) -> io::Result<Vec<Record>> {
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
    fn what_is_appended_is_read_once_and_in_order() {
        let path = std::env::temp_dir().join(format!("chaos-record-{}", std::process::id()));
        let mut tail = Tail::create(&path).unwrap();
        let mut log = Log::open(&path).unwrap();
        assert_eq!(tail.news().unwrap(), []);
        let records: Vec<_> = (0..3000).map(|n| record(n, n % 2 == 0)).collect();
        for record in &records {
            log.append(record).unwrap();
        }
        assert_eq!(tail.news().unwrap(), records);
        log.append(&record(9, true)).unwrap();
        assert_eq!(tail.news().unwrap(), [record(9, true)]);
        drop(tail);
        assert!(!path.exists());
    }
}
