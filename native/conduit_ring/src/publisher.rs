//! The one who publishes a topic.

use std::fmt;

use crate::attach::Attached;
use crate::claim::reclaim_leaked;
use crate::clock;
use crate::content::ContentTag;
use crate::create;
use crate::error::{Error, PublishError};
use crate::geometry::Geometry;
use crate::info::Info;
use crate::layout::{PUBLISHER_LOCK, STATE, STATE_CLOSED};
use crate::sync::Ordering::Release;
use crate::topic::Topic;
use crate::writer::{self, Wake, Writer};

/// Wake-ups in a row that met nobody asleep before dead readers' bits are looked for.
const FRUITLESS_WAKES: u32 = 64;

/// How a topic is published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublisherOptions {
    /// Number and length of the slots.
    pub geometry: Geometry,
    /// The encoding of the messages.
    pub content: ContentTag,
    /// Permissions of the file, whatever the umask. A file that is taken over keeps its own, and its group.
    pub mode: u32,
    /// Group of the file; the process's own if `None`.
    pub group: Option<u32>,
    /// Replace a file that is not ours although a process may still use it.
    pub force: bool,
}

impl Default for PublisherOptions {
    fn default() -> Self {
        PublisherOptions {
            geometry: Geometry::default(),
            content: ContentTag::RAW,
            mode: 0o660,
            group: None,
            force: false,
        }
    }
}

/// The one publisher of a topic. Closes it when dropped.
pub struct Publisher {
    topic: Topic,
    attached: Attached,
    writer: Writer,
    fruitless_wakes: u32,
    abandoned: bool,
}

impl Publisher {
    /// Makes the topic, or goes on with it where a publisher that died left it: at the same sequence number, and without
    /// its subscribers noticing, if geometry and content are the same; in a new segment otherwise.
    ///
    /// # Errors
    /// [`Error::PublisherAlive`] while another one lives; [`Error::LegacyInUse`] or [`Error::BadSegment`] when the file
    /// there is not ours and a process may use it (see [`PublisherOptions::force`]); [`Error::Os`].
    pub fn open(topic: &Topic, options: &PublisherOptions) -> Result<Publisher, Error> {
        let attached = create::acquire(topic, options)?;
        let writer = Writer::resume(&attached.memory);
        Ok(Publisher {
            topic: topic.clone(),
            attached,
            writer,
            fruitless_wakes: 0,
            abandoned: false,
        })
    }

    /// Publishes one message and returns its sequence number. Never waits; a system call is made only if a subscriber
    /// sleeps.
    ///
    /// # Errors
    /// [`PublishError::TooLarge`]: counted, and nothing is published.
    #[inline]
    pub fn publish(&mut self, message: &[u8]) -> Result<u64, PublishError> {
        self.publish_slices(&[message])
    }

    /// Publishes the concatenation of `parts` as one message, each part copied straight into the slot.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    #[inline]
    pub fn publish_slices(&mut self, parts: &[&[u8]]) -> Result<u64, PublishError> {
        let len = parts
            .iter()
            .fold(0_usize, |len, part| len.saturating_add(part.len()));
        let max = self.attached.header.geometry.max_message_size();
        if len > max {
            self.writer.reject_oversize(&self.attached.memory);
            return Err(PublishError::TooLarge { len, max });
        }
        let (sequence, wake) = self
            .writer
            .publish(&self.attached.memory, parts, clock::now_ns());
        if let Wake::Woke(woken) = wake {
            self.after_wake(woken);
        }
        Ok(sequence)
    }

    /// A reader that was killed in its sleep leaves its waiting bit behind, and every message would cost a system call.
    #[cold]
    fn after_wake(&mut self, woken: u32) {
        self.fruitless_wakes = if woken == 0 {
            self.fruitless_wakes + 1
        } else {
            0
        };
        if self.fruitless_wakes >= FRUITLESS_WAKES {
            self.fruitless_wakes = 0;
            // A failure leaves the bits as they were: slower, not wrong.
            let _ = reclaim_leaked(&self.attached.memory, &self.attached.segment);
        }
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }

    /// Number and length of the slots.
    pub fn geometry(&self) -> Geometry {
        self.attached.header.geometry
    }

    /// Sequence number of the next message.
    pub fn next_sequence(&self) -> u64 {
        self.writer.next()
    }

    /// What there is to know about the topic.
    pub fn info(&self) -> Info {
        Info::collect(&self.topic, &self.attached, true)
    }

    /// Ends the topic: subscribers read what is left and then learn that the publisher is gone.
    pub fn close(self) {}

    /// Lets go of the topic as a death would: it stays, and the next publisher goes on with it in place.
    pub fn abandon(mut self) {
        self.abandoned = true;
    }

    fn end_topic(&self) {
        // Release: meets the Acquire in Subscriber's look at the state.
        self.attached.memory.u32(STATE).store(STATE_CLOSED, Release);
        writer::notify_all(&self.attached.memory);
        // A name that cannot be removed is replaced by the next publisher: the state says closed.
        let _ = self.attached.segment.unlink(self.topic.path());
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        if !self.abandoned {
            self.end_topic();
        }
        // A mapping elsewhere may keep the open file alive, and so the lock.
        let _ = self.attached.segment.unlock(PUBLISHER_LOCK);
    }
}

impl fmt::Debug for Publisher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Publisher")
            .field("topic", &self.topic.name())
            .field("geometry", &self.geometry())
            .field("next_sequence", &self.next_sequence())
            .finish_non_exhaustive()
    }
}
