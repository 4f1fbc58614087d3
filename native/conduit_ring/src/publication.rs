//! The private half of a publisher: one segment that is published into, and the care for its name
//! and its slots.
//!
//! [`Publisher`](crate::Publisher) is the public face. A [`Loan`](crate::Loan) borrows a
//! `Publication`, which is why the two are apart: neither of them names the other.

use std::sync::Arc;

use crate::attach::Attached;
use crate::claim::{reclaim_leaked, reclaim_pins};
use crate::clock;
use crate::error::Error;
use crate::geometry::Geometry;
use crate::layout::{PUBLISHER_LOCK, STATE, STATE_CLOSED};
use crate::memory::Memory;
use crate::options::PublisherOptions;
use crate::owner::Owner;
use crate::publish_error::PublishError;
use crate::renew;
use crate::sync::Ordering::Release;
use crate::takeover;
use crate::topic::Topic;
use crate::writer::{self, Pinned, Wake, Writer};

/// Wake-ups in a row that met no sleeper before the bits of dead readers are looked for.
const FRUITLESS_WAKES: u32 = 64;
/// How often the kernel is asked whether the holders of a slot still live.
const HOLDER_CHECK_NS: u64 = 10_000_000;
/// How often the topic's name is checked.
const NAME_CHECK_NS: u64 = 250_000_000;

/// A topic that this process publishes.
pub(crate) struct Publication {
    topic: Topic,
    attached: Attached,
    writer: Writer,
    fruitless_wakes: u32,
    /// When to ask next whether the holders of a slot live, on the clock of messages.
    next_holder_check_ns: u64,
    owner: Owner,
    /// When to check next whether the topic's name leads here, on the clock of messages. It is 0
    /// while the name is lost, so that each message checks.
    next_name_check_ns: u64,
    /// When to try next to get the name back.
    next_renewal_ns: u64,
    /// Why the name could not be got back.
    trouble: Option<Error>,
    renewals: u64,
}

impl Publication {
    /// Makes the topic or takes it over.
    pub(crate) fn open(topic: &Topic, options: &PublisherOptions) -> Result<Publication, Error> {
        let topic = &Topic::new(topic.name())?;
        let attached = takeover::acquire(topic, options)?;
        let writer = Writer::resume(&attached.memory);
        Ok(Publication {
            topic: topic.clone(),
            attached,
            writer,
            fruitless_wakes: 0,
            next_holder_check_ns: 0,
            owner: Owner::here(),
            next_name_check_ns: clock::now_ns() + NAME_CHECK_NS,
            next_renewal_ns: 0,
            trouble: None,
            renewals: 0,
        })
    }

    /// Publishes the concatenation of `parts` and returns its sequence number.
    #[inline]
    pub(crate) fn publish(&mut self, parts: &[&[u8]]) -> Result<u64, PublishError> {
        let len = parts
            .iter()
            .fold(0_usize, |len, part| len.saturating_add(part.len()));
        let now_ns = self.prepare(len)?;
        match self.writer.publish(&self.attached.memory, parts, now_ns) {
            Ok(published) => Ok(self.after_publish(published)),
            Err(pinned) => self.publish_elsewhere(pinned, parts, now_ns),
        }
    }

    /// Begins a message of `len` bytes that is written piece by piece.
    pub(crate) fn begin(&mut self, len: usize) -> Result<(), PublishError> {
        self.prepare(len)?;
        if let Err(pinned) = self.writer.begin(&self.attached.memory) {
            self.beyond_held_slots(pinned, Writer::begin)?;
        }
        Ok(())
    }

    /// Returns where the begun message is written to.
    pub(crate) fn payload(&self) -> *mut u8 {
        self.memory().slot(self.writer.next()).payload()
    }

    /// Publishes the first `len` bytes of the begun message. In a forked child it does nothing.
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

    /// Checks process, length and, now and then, the name. Returns the time.
    #[inline]
    fn prepare(&mut self, len: usize) -> Result<u64, PublishError> {
        self.check_len(len)?;
        let now_ns = clock::now_ns();
        if now_ns >= self.next_name_check_ns {
            self.check_name(now_ns)?;
        }
        Ok(now_ns)
    }

    #[inline]
    fn check_len(&self, len: usize) -> Result<(), PublishError> {
        self.check_owner()?;
        let max = self.geometry().max_message_size();
        if len > max {
            self.writer.reject_oversize(self.memory());
            return Err(PublishError::TooLarge { len, max });
        }
        Ok(())
    }

    #[inline]
    fn check_owner(&self) -> Result<(), PublishError> {
        if self.owner.is_here() {
            Ok(())
        } else {
            Err(PublishError::Forked)
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

    /// Tries again behind the slots that are held. Each slot is tried once, so that readers who
    /// take and release holds all the time delay the publisher no longer than that.
    #[cold]
    fn beyond_held_slots<T>(
        &mut self,
        mut pinned: Pinned,
        attempt: impl Fn(&mut Writer, &Memory) -> Result<T, Pinned>,
    ) -> Result<T, PublishError> {
        for _ in 0..=self.geometry().slot_count() {
            self.free_or_pass_over(pinned)?;
            match attempt(&mut self.writer, &self.attached.memory) {
                Ok(done) => return Ok(done),
                Err(still) => pinned = still,
            }
        }
        Err(self.drop_pinned())
    }

    /// Takes the slot back from holders that are dead, or passes it over. The kernel is asked
    /// about the holders at intervals only.
    fn free_or_pass_over(&mut self, pinned: Pinned) -> Result<(), PublishError> {
        let memory = &self.attached.memory;
        let now_ns = clock::now_ns();
        if now_ns >= self.next_holder_check_ns {
            self.next_holder_check_ns = now_ns.saturating_add(HOLDER_CHECK_NS);
            // Where the kernel does not answer, the holders count as alive.
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

    #[inline]
    fn after_publish(&mut self, (sequence, wake): (u64, Wake)) -> u64 {
        if let Wake::Woke(woken) = wake {
            self.count_fruitless_wake(woken);
        }
        sequence
    }

    /// A reader that was killed in its sleep leaves its waiting bit behind, and every message
    /// would cost a system call. So the bits of dead readers are cleared after a while.
    #[cold]
    fn count_fruitless_wake(&mut self, woken: u32) {
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

    /// Checks the topic's name now, whenever it was checked last.
    pub(crate) fn look_after(&mut self) -> Result<(), PublishError> {
        self.check_owner()?;
        self.next_renewal_ns = 0;
        self.check_name(clock::now_ns())
    }

    /// Makes the file anew if the topic's name does not lead to it any more.
    #[cold]
    fn check_name(&mut self, now_ns: u64) -> Result<(), PublishError> {
        if self.trouble.is_some() && now_ns < self.next_renewal_ns {
            return Err(PublishError::NameLost);
        }
        self.next_renewal_ns = now_ns.saturating_add(NAME_CHECK_NS);
        match renew::renew(&self.topic, &self.attached) {
            Ok(renewed) => {
                self.trouble = None;
                self.next_name_check_ns = self.next_renewal_ns;
                if let Some(renewed) = renewed {
                    self.move_to(renewed);
                }
                Ok(())
            }
            Err(trouble) => {
                self.trouble = Some(trouble);
                self.next_name_check_ns = 0;
                Err(PublishError::NameLost)
            }
        }
    }

    fn move_to(&mut self, renewed: Attached) {
        let old = std::mem::replace(&mut self.attached, renewed);
        // The mapping that a suspended loan keeps would keep the open file, and so the lock.
        let _ = old.segment.unlock(PUBLISHER_LOCK);
        self.renewals += 1;
    }

    /// Lets the topic go: closes it, or with `abandon` leaves it as a death would. In a forked
    /// child it does nothing.
    pub(crate) fn end(&self, abandon: bool) {
        if !self.owner.is_here() {
            return;
        }
        if !abandon {
            self.close();
        }
        // A mapping elsewhere may keep the open file, and so the lock.
        let _ = self.attached.segment.unlock(PUBLISHER_LOCK);
    }

    fn close(&self) {
        // Release: meets the Acquire in Backing::load32, so that a reader that sees the state
        // sees all messages.
        self.memory().u32(STATE).store(STATE_CLOSED, Release);
        writer::notify_all(self.memory());
        // A name that cannot be removed is replaced by the next publisher: the state says closed.
        let _ = self.attached.segment.unlink(self.topic.path());
    }

    #[inline]
    fn memory(&self) -> &Memory {
        &self.attached.memory
    }

    pub(crate) fn shared_memory(&self) -> &Arc<Memory> {
        &self.attached.memory
    }

    pub(crate) fn attached(&self) -> &Attached {
        &self.attached
    }

    pub(crate) fn topic(&self) -> &Topic {
        &self.topic
    }

    #[inline]
    pub(crate) fn geometry(&self) -> Geometry {
        self.attached.header.geometry
    }

    /// Returns the sequence number of the next message.
    pub(crate) fn next_sequence(&self) -> u64 {
        self.writer.next()
    }

    pub(crate) fn trouble(&self) -> Option<&Error> {
        self.trouble.as_ref()
    }

    pub(crate) fn renewals(&self) -> u64 {
        self.renewals
    }
}
