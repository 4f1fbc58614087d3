//! Reading with validation: a message is delivered whole and as it was published, or counted as
//! lost.
//!
//! ```text
//!              ┌──────────────── cursor == write_idx: nothing
//!   search ────┤
//!     ▲        ├──────────────── cursor >  write_idx: resynchronise, counted
//!     │        │
//!     │        └─► too far behind? lose the oldest ─► read length and time
//!     │                                                    │
//!     │                       impossible, passed over, or  │
//!     ├── lose one ◄────────── overwritten already ────────┤
//!     │                                                    ▼
//!     │                                             copy the payload
//!     │                                                    │
//!     └── lose one ◄── not whole ── acquire fence, validate┴── whole ──► deliver
//! ```
//!
//! Cursor and geometry are private, so that no number of the shared memory is read twice and
//! trusted. A message is copied first and validated afterwards. If the writer may have begun to
//! overwrite the slot by the end of the copy, the copy is dropped. `writer.rs` explains the
//! memory orders.

use crate::delivery::{Meta, Policy, Start};
use crate::layout::{
    At64, NO_MESSAGE, SLOT_LEN, SLOT_SEQ_HI, SLOT_SEQ_LO, SLOT_TIME_HI, SLOT_TIME_LO, WRITE_IDX,
    WRITE_INTENT,
};
use crate::memory::Memory;
use crate::pins;
use crate::sink::Sink;
use crate::source::{Source, SourceSlot, published};
use crate::sync::{Ordering, fence};

/// How the publisher of a segment shows that it is overwriting a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dialect {
    /// It stores `write_intent` first. All slots are usable.
    Native,
    /// It shows nothing but `write_idx`, so that the slot behind the newest message is never
    /// usable. Its wake-up call, a full barrier, separates its messages.
    Legacy,
}

/// A private cursor over a segment, and the count of its losses.
pub(crate) struct Reader {
    cursor: u64,
    dialect: Dialect,
    /// Messages lost since the last delivery.
    lost: u64,
    lost_total: u64,
    resyncs: u64,
}

impl Reader {
    /// Makes a reader that begins with the messages that `start` asks for.
    pub(crate) fn begin(source: &impl Source, dialect: Dialect, start: Start) -> Reader {
        let published = published(source);
        let oldest = published - safe(source, dialect).min(published);
        let cursor = match start {
            Start::New => published,
            Start::Latest => newest(source, oldest, published),
            Start::History(k) => published.saturating_sub(k.into()).max(oldest),
        };
        Reader {
            cursor,
            dialect,
            lost: 0,
            lost_total: 0,
            resyncs: 0,
        }
    }

    /// Makes a reader that has seen every message before `cursor`, and has lost some of them
    /// since its last delivery.
    pub(crate) fn resume(dialect: Dialect, cursor: u64, lost: u64) -> Reader {
        Reader {
            cursor,
            dialect,
            lost,
            lost_total: lost,
            resyncs: 0,
        }
    }

    /// Returns the sequence number of the next message to look at.
    pub(crate) fn cursor(&self) -> u64 {
        self.cursor
    }

    pub(crate) fn lost_since_delivery(&self) -> u64 {
        self.lost
    }

    pub(crate) fn lost_total(&self) -> u64 {
        self.lost_total
    }

    pub(crate) fn resyncs(&self) -> u64 {
        self.resyncs
    }

    /// Returns whether [`Reader::next`] has something to look at.
    pub(crate) fn has_news(&self, source: &impl Source) -> bool {
        published(source) != self.cursor
    }

    /// Delivers the next message into the sink.
    ///
    /// After as many invalid messages as there are slots it returns `None`, so that a broken
    /// writer cannot keep it here.
    #[inline]
    pub(crate) fn next(
        &mut self,
        source: &impl Source,
        policy: Policy,
        sink: &mut impl Sink,
    ) -> Option<Meta> {
        self.search(source, policy, |reader| reader.take(source, sink))
    }

    /// As [`Reader::next`], with the caller's way of taking the message at the cursor: by
    /// [`Reader::take`] or [`Reader::take_pinned`].
    #[inline]
    pub(crate) fn search<T>(
        &mut self,
        source: &impl Source,
        policy: Policy,
        mut take: impl FnMut(&mut Reader) -> Option<T>,
    ) -> Option<T> {
        for _ in 0..=source.geometry().slot_count() {
            let published = published(source);
            if published == self.cursor {
                return None;
            }
            if !self.catch_up(source, published, policy) {
                return None;
            }
            if let Some(taken) = take(self) {
                return Some(taken);
            }
            self.lose(1);
        }
        None
    }

    /// Moves the cursor to the oldest message that may be read. Returns `false` when there is
    /// none.
    #[inline]
    fn catch_up(&mut self, source: &impl Source, published: u64, policy: Policy) -> bool {
        if self.cursor > published {
            self.cursor = published;
            self.resyncs += 1;
            return false;
        }
        let safe = safe(source, self.dialect);
        self.lose((published - self.cursor).saturating_sub(safe));
        if policy == Policy::Latest {
            self.lose(newest(source, self.cursor, published) - self.cursor);
        }
        safe > 0
    }

    /// Counts the next `count` messages as lost.
    #[inline]
    fn lose(&mut self, count: u64) {
        self.cursor = self.cursor.wrapping_add(count);
        self.lost = self.lost.saturating_add(count);
        self.lost_total = self.lost_total.saturating_add(count);
    }

    /// Copies the message at the cursor. Returns `None` when it cannot be trusted.
    #[inline]
    pub(crate) fn take(&mut self, source: &impl Source, sink: &mut impl Sink) -> Option<Meta> {
        let slot = source.slot(self.cursor);
        let len = slot.load(SLOT_LEN) as usize;
        let timestamp_ns = long(&slot, SLOT_TIME_LO, SLOT_TIME_HI);
        if !self.is_message(source, len, timestamp_ns) || self.is_overwritten(source) {
            return None;
        }
        // SAFETY: the sink gave room for `len` bytes.
        unsafe { slot.read_payload(sink.room(len), len) };
        if !self.is_whole(source, &slot) {
            return None;
        }
        Some(self.deliver(timestamp_ns, len))
    }

    /// Pins the message at the cursor in its slot. Returns `None`, and sets no pin, when the
    /// message cannot be trusted. A writer that looks at pins leaves the slot alone until the pin
    /// is cleared.
    pub(crate) fn take_pinned(&mut self, memory: &Memory, pin: At64) -> Option<Meta> {
        pins::pin(memory, pin, self.cursor);
        // From here on the payload does not change, if this message is still there. The header
        // may: see `pins.rs`.
        let slot = memory.slot(self.cursor);
        let len = slot.load(SLOT_LEN) as usize;
        let timestamp_ns = long(&slot, SLOT_TIME_LO, SLOT_TIME_HI);
        if !self.is_whole(memory, &slot) || !self.is_message(memory, len, timestamp_ns) {
            pins::unpin(memory, pin);
            return None;
        }
        Some(self.deliver(timestamp_ns, len))
    }

    /// Returns whether a slot's header can be that of a message: the length fits, and the number
    /// was not passed over.
    #[inline]
    fn is_message(&self, source: &impl Source, len: usize, timestamp_ns: u64) -> bool {
        let passed_over = self.dialect == Dialect::Native && is_passed_over(len, timestamp_ns);
        len <= source.geometry().capacity() && !passed_over
    }

    /// Moves the cursor behind the message and reports the losses before it.
    #[inline]
    fn deliver(&mut self, timestamp_ns: u64, len: usize) -> Meta {
        let meta = Meta {
            sequence: self.cursor,
            timestamp_ns,
            len,
            lost: self.lost,
        };
        self.cursor = self.cursor.wrapping_add(1);
        self.lost = 0;
        meta
    }

    /// Returns whether all bytes that were read of the slot so far belong to the message at the
    /// cursor.
    #[inline]
    fn is_whole(&self, source: &impl Source, slot: &impl SourceSlot) -> bool {
        let sequence = long(slot, SLOT_SEQ_LO, SLOT_SEQ_HI);
        // Acquire: pairs with the release fence in Writer::poison. If any byte read before was of
        // a later message, the loads behind this fence see that message's intent.
        fence(Ordering::Acquire);
        sequence == self.cursor && !self.is_overwritten(source)
    }

    /// Returns whether the writer may have begun to write a later message into the cursor's slot,
    /// or has never published the cursor's message.
    ///
    /// Relaxed: the acquire fence in `is_whole` orders the load behind the copy.
    #[inline]
    fn is_overwritten(&self, source: &impl Source) -> bool {
        let slots = u64::from(source.geometry().slot_count());
        match self.dialect {
            Dialect::Native => {
                let intent = source.load(WRITE_INTENT, Ordering::Relaxed);
                intent.wrapping_sub(self.cursor).wrapping_sub(1) >= slots
            }
            Dialect::Legacy => {
                let published = source.load(WRITE_IDX, Ordering::Relaxed);
                published.wrapping_sub(self.cursor).wrapping_sub(1) >= slots - 1
            }
        }
    }
}

/// Returns how far behind a reader may be and still find its message whole.
#[inline]
fn safe(source: &impl Source, dialect: Dialect) -> u64 {
    let slots = u64::from(source.geometry().slot_count());
    match dialect {
        Dialect::Native => slots,
        Dialect::Legacy => slots - 1,
    }
}

/// Returns the newest number from `oldest` on that seems to have a message, or `oldest` if none
/// does. A writer that passes over a held slot has published a number without a message.
fn newest(source: &impl Source, oldest: u64, published: u64) -> u64 {
    let mut newest = published.saturating_sub(1).max(oldest);
    while newest > oldest && seems_passed_over(source, newest) {
        newest -= 1;
    }
    newest
}

fn seems_passed_over(source: &impl Source, sequence: u64) -> bool {
    let slot = source.slot(sequence);
    is_passed_over(
        slot.load(SLOT_LEN) as usize,
        long(&slot, SLOT_TIME_LO, SLOT_TIME_HI),
    )
}

/// Returns whether a slot has a number and no message.
#[inline]
fn is_passed_over(len: usize, timestamp_ns: u64) -> bool {
    len == 0 && timestamp_ns == NO_MESSAGE
}

#[inline]
fn long(slot: &impl SourceSlot, lo: usize, hi: usize) -> u64 {
    u64::from(slot.load(lo)) | u64::from(slot.load(hi)) << 32
}
