//! Messages whose publisher was killed while it wrote them.

use std::collections::HashSet;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use conduit_ring::Topic;

/// The half-written messages of a run.
#[derive(Debug, Default)]
pub struct HalfWritten {
    messages: HashSet<(String, Message)>,
}

/// A message by its segment and sequence number.
type Message = (u64, u64);

impl HalfWritten {
    /// Waits until a message of the topic is being written, at most for `timeout`. Ignores
    /// messages that a dead publisher left half-written.
    pub fn wait(&self, topic: &Topic, timeout: Duration) {
        let deadline = Instant::now() + timeout;
        let Ok(file) = File::open(topic.path()) else {
            return;
        };
        let is_known = |message| self.messages.contains(&(topic.name().to_owned(), message));
        while Instant::now() < deadline {
            if being_written(&file).is_some_and(|message| !is_known(message)) {
                return;
            }
        }
    }

    /// Records the message that a dead publisher left half-written, if any.
    pub fn record(&mut self, topic: &Topic) {
        let file = File::open(topic.path());
        if let Some(message) = file.ok().as_ref().and_then(being_written) {
            self.messages.insert((topic.name().to_owned(), message));
        }
    }

    /// Returns the number of half-written messages.
    pub fn count(&self) -> u64 {
        self.messages.len() as u64
    }
}

/// Returns the message that is being written, if any.
fn being_written(file: &File) -> Option<Message> {
    const INSTANCE: usize = 32;
    const WRITE_IDX: usize = 64;
    const WRITE_INTENT: usize = 72;
    let mut head = [0; 80];
    file.read_exact_at(&mut head, 0).ok()?;
    let long = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let (published, intended) = (long(WRITE_IDX), long(WRITE_INTENT));
    (intended == published.wrapping_add(1)).then(|| (long(INSTANCE), published))
}
