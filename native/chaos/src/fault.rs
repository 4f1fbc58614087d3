//! Faults that a run injects, to show that it finds them.

use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::FileExt;

use conduit_ring::Topic;

/// A fault to inject.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A publisher corrupts some messages.
    Torn,
    /// A sequence number is decremented after its publisher was killed, so that the next message
    /// gets it again.
    Reused,
    /// Another publisher opens a topic, so that its own publisher cannot.
    Stuck,
    /// A reader slot is marked as taken without a reader.
    Leaked,
}

impl Fault {
    /// Parses a fault's name.
    pub fn parse(text: &str) -> Option<Fault> {
        match text {
            "torn" => Some(Fault::Torn),
            "reused" => Some(Fault::Reused),
            "stuck" => Some(Fault::Stuck),
            "leaked" => Some(Fault::Leaked),
            _ => None,
        }
    }
}

/// Decrements the number of published messages in a topic's file.
pub fn decrement_published(topic: &Topic) -> io::Result<()> {
    const WRITE_IDX: u64 = 64;
    change_word(topic, WRITE_IDX, |published| published.saturating_sub(1))
}

/// Marks a reader slot as taken in a topic's file.
pub fn mark_slot(topic: &Topic) -> io::Result<()> {
    const SUBSCRIBER_MASK: u64 = 128;
    change_word(topic, SUBSCRIBER_MASK, |mask| mask | 1 << 15)
}

fn change_word(topic: &Topic, at: u64, change: impl Fn(u32) -> u32) -> io::Result<()> {
    let options = OpenOptions::new().read(true).write(true).open(topic.path());
    let Ok(file) = options else {
        return Ok(());
    };
    let mut word = [0; 4];
    file.read_exact_at(&mut word, at)?;
    file.write_all_at(&change(u32::from_le_bytes(word)).to_le_bytes(), at)
}
