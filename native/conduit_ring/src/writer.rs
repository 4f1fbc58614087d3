//! Publishing: one message after another into the slots of a [`Memory`].
//!
//! ```text
//!   publisher                                     reader of the same slot
//!   ─────────                                     ───────────────────────
//!   write_intent = W + 1      relaxed
//!   (pins in use? SeqCst fence, look at the pins)
//!   seq_hi = poison           relaxed
//!   ── release fence ──  ◄──────────────┐
//!   size, time, payload       relaxed   │         copy size, time, payload   relaxed
//!   ── release fence ──                 │         load the sequence          relaxed
//!   sequence                  relaxed   └──────►  ── acquire fence ──
//!   write_idx = W + 1         Release ◄─────┐     load write_intent          relaxed: whole?
//!   futex_word += 1           Release       │
//!   ── SeqCst fence ──                      └───► load write_idx             Acquire: next?
//!   load the masks; wake      relaxed
//! ```
//!
//! Why these orders suffice:
//! - **No torn message.** `write_intent` stands before the release fence, and the payload behind
//!   it. A reader that copied any byte of the new message meets that fence with its acquire fence
//!   behind the copy, so that its load of `write_intent` sees the intent, and it drops the copy.
//! - **No missing byte.** Size, time, payload and sequence stand before `write_idx` (Release). A
//!   reader whose load of `write_idx` (Acquire) sees the new value sees all of them.
//! - **No lost wake-up.** `write_idx` and `futex_word` stand before a SeqCst fence, and the masks
//!   behind it. A sleeper sets its waiting bit, has a SeqCst fence, and checks `write_idx` behind
//!   it. At least one of the two sees the other.
//! - **No overwritten hold.** `write_intent` stands before a SeqCst fence, and the pins behind
//!   it: see `pins.rs`.

use crate::layout::{
    DROPPED_PINNED, FUTEX_WORD, LAST_PUBLISH, NATIVE_MASK, NO_MESSAGE, POISON, REJECTED_OVERSIZE,
    SLOT_LEN, SLOT_SEQ_HI, SLOT_SEQ_LO, SLOT_TIME_HI, SLOT_TIME_LO, SUBSCRIBER_MASK,
    WAITING_MASK, WAKE_COUNT, WRITE_IDX, WRITE_INTENT,
};
use crate::memory::Memory;
use crate::pins;
use crate::sync::{Ordering, add_one_and_fence, bump, fence};

/// The one writer of a segment.
///
/// Its `next` is private and authoritative. `write_idx` only shows it to others, so that a peer
/// that damages `write_idx` cannot lead the writer astray.
pub(crate) struct Writer {
    next: u64,
    /// Whether the slot may already hold bytes of message `next`: of a message that failed
    /// half-way, or of a predecessor's. Then `write_intent` must keep announcing it.
    begun: bool,
    /// Whether this writer has found the slot free of holds, and has announced since what it does
    /// to it. No pin that was set later holds.
    taken: bool,
}

/// The slot was left alone, because readers hold the message in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pinned {
    /// The bits of their reader slots.
    pub(crate) holders: u32,
}

/// Whether sleepers were woken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wake {
    /// No reader slept, and no system call was made.
    NotNeeded,
    /// Readers may have slept, and this many woke.
    Woke(u32),
}

impl Writer {
    /// Continues a segment: at 0 in a new one, at the predecessor's next message in one that was
    /// taken over.
    pub(crate) fn resume(memory: &Memory) -> Writer {
        // Acquire: pairs with the Release of a predecessor in use_number, so that its stores to
        // the slots come before this writer's.
        let next = memory.u64(WRITE_IDX).load(Ordering::Acquire);
        // SeqCst: replaces the fence behind the message before, which `pins.rs` relies on.
        fence(Ordering::SeqCst);
        Writer {
            next,
            // Relaxed: the predecessor is dead, and its lock was taken by a system call since.
            begun: memory.u64(WRITE_INTENT).load(Ordering::Relaxed) != next,
            taken: false,
        }
    }

    pub(crate) fn next(&self) -> u64 {
        self.next
    }

    /// Publishes the concatenation of `parts`, which fits the slot, and returns its sequence
    /// number. Publishes nothing when readers hold the slot.
    #[inline]
    pub(crate) fn publish(
        &mut self,
        memory: &Memory,
        parts: &[&[u8]],
        time_ns: u64,
    ) -> Result<(u64, Wake), Pinned> {
        self.begin(memory)?;
        let len = self.fill(memory, parts);
        self.commit(memory, len, time_ns);
        Ok((self.advance(memory, time_ns), notify(memory)))
    }

    /// Announces that the slot of the next message is about to change. From here on no reader
    /// accepts the message that was in it.
    #[inline]
    pub(crate) fn begin(&mut self, memory: &Memory) -> Result<(), Pinned> {
        // Relaxed: the release fence in poison orders it before the slot's new bytes.
        memory
            .u64(WRITE_INTENT)
            .store(self.next.wrapping_add(1), Ordering::Relaxed);
        if !self.taken && pins::in_use(memory) {
            self.leave_held_slot(memory)?;
        }
        (self.begun, self.taken) = (true, true);
        self.poison(memory);
        Ok(())
    }

    /// Marks the slot as being written, for legacy readers: they find a foreign sequence number.
    #[inline]
    fn poison(&self, memory: &Memory) {
        memory.slot(self.next).store(SLOT_SEQ_HI, POISON);
        // Release: pairs with the acquire fence in Reader::is_whole. A reader that sees a byte
        // written from here on sees the intent.
        fence(Ordering::Release);
    }

    /// Takes the announcement back if readers hold the slot: the number is not used up yet.
    #[cold]
    fn leave_held_slot(&self, memory: &Memory) -> Result<(), Pinned> {
        let holders = pins::holders(memory, self.next);
        if holders == 0 {
            return Ok(());
        }
        if !self.begun {
            // Relaxed: an older intent only makes readers reject more.
            memory.u64(WRITE_INTENT).store(self.next, Ordering::Relaxed);
        }
        Err(Pinned { holders })
    }

    /// Copies the parts into the slot, one behind the other, and returns their length.
    #[inline]
    pub(crate) fn fill(&self, memory: &Memory, parts: &[&[u8]]) -> usize {
        let slot = memory.slot(self.next);
        let mut len = 0;
        for part in parts {
            slot.write_payload(len, part);
            len += part.len();
        }
        len
    }

    /// Completes the slot: length, time, and the sequence number last.
    #[inline]
    pub(crate) fn commit(&self, memory: &Memory, len: usize, time_ns: u64) {
        let slot = memory.slot(self.next);
        slot.store(SLOT_LEN, len as u32);
        slot.store(SLOT_TIME_LO, time_ns as u32);
        slot.store(SLOT_TIME_HI, (time_ns >> 32) as u32);
        // Release: pairs with the acquire fence of a legacy reader behind its load of the
        // sequence. A reader that sees the sequence sees the message.
        fence(Ordering::Release);
        slot.store(SLOT_SEQ_LO, self.next as u32);
        slot.store(SLOT_SEQ_HI, (self.next >> 32) as u32);
    }

    /// Publishes the completed slot and returns its sequence number.
    #[inline]
    pub(crate) fn advance(&mut self, memory: &Memory, time_ns: u64) -> u64 {
        // Relaxed: for people.
        memory.u64(LAST_PUBLISH).store(time_ns, Ordering::Relaxed);
        self.use_number(memory)
    }

    #[inline]
    fn use_number(&mut self, memory: &Memory) -> u64 {
        let sequence = self.next;
        self.next = sequence.wrapping_add(1);
        (self.begun, self.taken) = (false, false);
        // Release: pairs with the Acquire in source::published. A reader that sees the number
        // sees the slot.
        memory.u64(WRITE_IDX).store(self.next, Ordering::Release);
        sequence
    }

    /// Uses up the number of the next message, whose slot readers hold. The slot gets its number,
    /// no length and no time, and keeps its payload. Returns `false`, and does nothing, when
    /// there is no other slot to continue with.
    ///
    /// The number must be there for legacy readers: a legacy reader that finds another number
    /// than it expects goes back by a whole ring.
    #[cold]
    pub(crate) fn pass_over(&mut self, memory: &Memory) -> bool {
        if !pins::is_another_free(memory, self.next) {
            return false;
        }
        // Relaxed: as in begin.
        memory
            .u64(WRITE_INTENT)
            .store(self.next.wrapping_add(1), Ordering::Relaxed);
        self.poison(memory);
        self.commit(memory, 0, NO_MESSAGE);
        self.use_number(memory);
        bump(memory.u64(DROPPED_PINNED), 1);
        true
    }

    /// Counts a message that was dropped because readers hold all slots.
    #[cold]
    pub(crate) fn drop_pinned(&self, memory: &Memory) {
        bump(memory.u64(DROPPED_PINNED), 1);
    }

    /// Counts a message that does not fit.
    #[cold]
    pub(crate) fn reject_oversize(&self, memory: &Memory) {
        bump(memory.u64(REJECTED_OVERSIZE), 1);
    }
}

/// Announces a change to the readers, and wakes them only if one of them may sleep.
#[inline]
pub(crate) fn notify(memory: &Memory) -> Wake {
    add_one_and_fence(memory.u32(FUTEX_WORD));
    // Relaxed: the SeqCst fence before them orders these loads, and the one in wait::sleep its
    // store. A legacy reader has no waiting bit, so that it always counts as asleep.
    let claimed = memory.u32(SUBSCRIBER_MASK).load(Ordering::Relaxed);
    let native = memory.u32(NATIVE_MASK).load(Ordering::Relaxed);
    let waiting = memory.u32(WAITING_MASK).load(Ordering::Relaxed);
    if (claimed & !native) | waiting == 0 {
        Wake::NotNeeded
    } else {
        wake(memory)
    }
}

/// Announces a change to the readers and wakes all of them, whatever the masks say.
pub(crate) fn notify_all(memory: &Memory) {
    // Release: pairs with the Acquire in wait::sleep, so that a reader that sees the bump sees
    // what came before it.
    memory.u32(FUTEX_WORD).fetch_add(1, Ordering::Release);
    memory.futex_wake();
}

#[cold]
fn wake(memory: &Memory) -> Wake {
    bump(memory.u64(WAKE_COUNT), 1);
    Wake::Woke(memory.futex_wake())
}
