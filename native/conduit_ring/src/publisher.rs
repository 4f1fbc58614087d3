//! The one who publishes a topic.

use std::fmt;
use std::sync::Arc;

use crate::attach::Attached;
use crate::claim::{reclaim_leaked, reclaim_pins};
use crate::clock;
use crate::content::ContentTag;
use crate::create;
use crate::error::{Error, PublishError};
use crate::geometry::Geometry;
use crate::info::Info;
use crate::layout::{PUBLISHER_LOCK, STATE, STATE_CLOSED};
use crate::loan::Loan;
use crate::memory::Memory;
use crate::owner::Owner;
use crate::sync::Ordering::Release;
use crate::topic::Topic;
use crate::writer::{self, Pinned, Wake, Writer};

/// Wake-ups in a row that met nobody asleep before dead readers' bits are looked for.
const FRUITLESS_WAKES: u32 = 64;
/// How often the holders of a slot that is in the way are asked whether they live.
const HOLDER_LOOKS_NS: u64 = 10_000_000;

/// How often a publisher looks whether the topic's name leads to its file.
const NAME_LOOKS_NS: u64 = 250_000_000;

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
    /// When to look next whether the holders of a slot live, on the clock of messages.
    next_holder_look_ns: u64,
    abandoned: bool,
    owner: Owner,
    /// When to look next whether the topic's name leads here, on the clock of messages; 0 while it does not.
    next_name_look_ns: u64,
    /// When to try next to get it back.
    next_renewal_ns: u64,
    /// Why the name could not be got back.
    trouble: Option<Error>,
    renewals: u64,
}

impl Publisher {
    /// Makes the topic, or goes on with it where a publisher that died left it: at the same sequence number, and without
    /// its subscribers noticing, if geometry and content are the same; in a new segment otherwise.
    ///
    /// # Errors
    /// [`Error::InvalidTopic`] for a name that [`Topic::new`] refuses; [`Error::PublisherAlive`] while another one lives; [`Error::LegacyInUse`] or [`Error::BadSegment`] when the file
    /// there is not ours and a process may use it (see [`PublisherOptions::force`]); [`Error::Os`].
    pub fn open(topic: &Topic, options: &PublisherOptions) -> Result<Publisher, Error> {
        let topic = &Topic::new(topic.name())?;
        let attached = create::acquire(topic, options)?;
        let writer = Writer::resume(&attached.memory);
        Ok(Publisher {
            topic: topic.clone(),
            attached,
            writer,
            fruitless_wakes: 0,
            next_holder_look_ns: 0,
            abandoned: false,
            owner: Owner::here(),
            next_name_look_ns: clock::now_ns() + NAME_LOOKS_NS,
            next_renewal_ns: 0,
            trouble: None,
            renewals: 0,
        })
    }

    /// Publishes one message and returns its sequence number. Never waits; a system call is made only if a subscriber
    /// sleeps.
    ///
    /// # Errors
    /// [`PublishError::TooLarge`]; [`PublishError::SlotHeld`] while subscribers' leases hold all slots. Both are counted, and
    /// nothing is published. A slot that is held among others is passed over, and its number with it.
    /// [`PublishError::NameLost`]: see [`Publisher::look_after`].
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
        self.check_len(len)?;
        let now_ns = clock::now_ns();
        if now_ns >= self.next_name_look_ns {
            self.keep_name(now_ns)?;
        }
        match self.writer.publish(&self.attached.memory, parts, now_ns) {
            Ok(published) => Ok(self.after_publish(published)),
            Err(pinned) => self.publish_elsewhere(pinned, parts, now_ns),
        }
    }

    #[cold]
    fn publish_elsewhere(
        &mut self,
        pinned: Pinned,
        parts: &[&[u8]],
        now_ns: u64,
    ) -> Result<u64, PublishError> {
        let published = self.beyond_held_slots(pinned, |writer, memory| {
            writer.publish(memory, parts, now_ns)
        })?;
        Ok(self.after_publish(published))
    }

    /// Lends the next slot, for a message of `len` bytes that is written there piece by piece, without a copy of it
    /// elsewhere. Nothing is published before [`Loan::commit`].
    ///
    /// From here on the message that was in the slot, the oldest one, is lost to those who have not read it.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub fn loan(&mut self, len: usize) -> Result<Loan<'_>, PublishError> {
        self.check_len(len)?;
        let now_ns = clock::now_ns();
        if now_ns >= self.next_name_look_ns {
            self.keep_name(now_ns)?;
        }
        if let Err(pinned) = self.writer.begin(&self.attached.memory) {
            self.beyond_held_slots(pinned, Writer::begin)?;
        }
        Ok(Loan::new(self, len))
    }

    /// Looks whether the topic's name still leads to this publisher's file. Where the file was removed or another one has the
    /// name, it is made anew: with the same messages, at the same sequence number, and the subscribers follow.
    ///
    /// Publishing looks by itself, at most once in a quarter of a second. This is for a publisher that may be silent for
    /// longer, and must be found all the same.
    ///
    /// # Errors
    /// [`PublishError::NameLost`] when the name is another living publisher's or a stranger's, or for want of memory;
    /// [`Publisher::trouble`] tells. From then on nothing is published until the name is free: each look tries again.
    pub fn look_after(&mut self) -> Result<(), PublishError> {
        if !self.owner.is_here() {
            return Err(PublishError::Forked);
        }
        self.next_renewal_ns = 0;
        self.keep_name(clock::now_ns())
    }

    /// Why the topic's name is lost, while it is.
    pub fn trouble(&self) -> Option<&Error> {
        self.trouble.as_ref()
    }

    /// How many times this publisher had to make its file anew.
    pub fn renewals(&self) -> u64 {
        self.renewals
    }

    #[cold]
    fn keep_name(&mut self, now_ns: u64) -> Result<(), PublishError> {
        if self.trouble.is_some() && now_ns < self.next_renewal_ns {
            return Err(PublishError::NameLost);
        }
        self.next_renewal_ns = now_ns.saturating_add(NAME_LOOKS_NS);
        match create::renew(&self.topic, &self.attached) {
            Ok(renewed) => {
                self.trouble = None;
                self.next_name_look_ns = self.next_renewal_ns;
                if let Some(renewed) = renewed {
                    self.move_to(renewed);
                }
                Ok(())
            }
            Err(trouble) => {
                self.trouble = Some(trouble);
                self.next_name_look_ns = 0;
                Err(PublishError::NameLost)
            }
        }
    }

    fn move_to(&mut self, renewed: Attached) {
        let old = std::mem::replace(&mut self.attached, renewed);
        // A loan elsewhere may keep the open file alive, and so the lock.
        let _ = old.segment.unlock(PUBLISHER_LOCK);
        self.renewals += 1;
    }

    pub(crate) fn shared_memory(&self) -> &Arc<Memory> {
        &self.attached.memory
    }

    /// Where the message that is lent is written to.
    pub(crate) fn lent_payload(&self) -> *mut u8 {
        self.memory().slot(self.writer.next()).payload()
    }

    /// Publishes the first `len` bytes of what was lent.
    pub(crate) fn commit(&mut self, len: usize) -> u64 {
        if !self.owner.is_here() {
            return self.writer.next();
        }
        let now_ns = clock::now_ns();
        let memory = &self.attached.memory;
        self.writer.commit(memory, len, now_ns);
        let sequence = self.writer.advance(memory, now_ns);
        let wake = writer::notify(memory);
        self.after_publish((sequence, wake))
    }

    #[inline]
    fn memory(&self) -> &Memory {
        &self.attached.memory
    }

    #[inline]
    fn check_len(&self, len: usize) -> Result<(), PublishError> {
        if !self.owner.is_here() {
            return Err(PublishError::Forked);
        }
        let max = self.attached.header.geometry.max_message_size();
        if len > max {
            self.writer.reject_oversize(self.memory());
            return Err(PublishError::TooLarge { len, max });
        }
        Ok(())
    }

    #[inline]
    fn after_publish(&mut self, (sequence, wake): (u64, Wake)) -> u64 {
        if let Wake::Woke(woken) = wake {
            self.after_wake(woken);
        }
        sequence
    }

    /// Tries again behind slots that are held. Each slot is tried once: whoever takes and gives back holds all the time keeps
    /// the publisher here no longer than that.
    #[cold]
    fn beyond_held_slots<T>(
        &mut self,
        mut pinned: Pinned,
        attempt: impl Fn(&mut Writer, &Memory) -> Result<T, Pinned>,
    ) -> Result<T, PublishError> {
        for _ in 0..=self.geometry().slot_count() {
            self.make_way(pinned)?;
            match attempt(&mut self.writer, &self.attached.memory) {
                Ok(done) => return Ok(done),
                Err(still) => pinned = still,
            }
        }
        Err(self.drop_pinned())
    }

    /// Takes the slot back from holders that are dead, or passes it over; who lives is looked at now and then only.
    fn make_way(&mut self, pinned: Pinned) -> Result<(), PublishError> {
        let memory = &self.attached.memory;
        let now_ns = clock::now_ns();
        if now_ns >= self.next_holder_look_ns {
            self.next_holder_look_ns = now_ns.saturating_add(HOLDER_LOOKS_NS);
            // A lock that cannot be asked for is held, as far as is known.
            if reclaim_pins(memory, &self.attached.segment, pinned.holders).unwrap_or(false) {
                return Ok(());
            }
        }
        if self.writer.pass_over(memory) {
            Ok(())
        } else {
            Err(self.drop_pinned())
        }
    }

    fn drop_pinned(&self) -> PublishError {
        self.writer.drop_pinned(&self.attached.memory);
        PublishError::SlotHeld
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
        let Attached {
            segment,
            memory,
            header,
        } = &self.attached;
        Info::collect(&self.topic, segment, header, &**memory, true)
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
        if !self.owner.is_here() {
            return;
        }
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
