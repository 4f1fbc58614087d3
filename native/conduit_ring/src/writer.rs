//! Publishing, as ring.md's protocol has it: one message after another into the slots of a [`Memory`].
//!
//! Orders, each Release with its Acquire:
//! - `write_intent`, then a release fence, then size, time and payload. A reader that copied any byte of the new message
//!   meets that fence with its acquire fence after the copy, so its load of `write_intent` sees the intent.
//! - size, time, payload and sequence, then `write_idx` (Release). A reader's load of `write_idx` (Acquire) that sees it
//!   finds them.
//! - `write_idx`, `futex_word`, then a SeqCst fence, then the masks. A sleeper sets its waiting bit, then has a SeqCst
//!   fence, then checks `write_idx`: at least one of the two sees the other.
//! - `write_intent`, then a SeqCst fence if a bit of `pin_mask` stands, then the pins: see `pins.rs`.

use crate::layout::{
    DROPPED_PINNED, FUTEX_WORD, LAST_PUBLISH, NATIVE_MASK, NO_MESSAGE, POISON, REJECTED_OVERSIZE,
    SLOT_LEN, SLOT_SEQ_HI, SLOT_SEQ_LO, SLOT_TIME_HI, SLOT_TIME_LO, SUBSCRIBER_MASK, WAITING_MASK,
    WAKE_COUNT, WRITE_IDX, WRITE_INTENT,
};
use crate::memory::Memory;
use crate::pins;
use crate::sync::{Ordering, add_one_and_fence, bump, fence};

/// The one writer of a segment. Its `next` is private and authoritative; `write_idx` only tells it to others.
pub(crate) struct Writer {
    next: u64,
    /// Whether something of message `next` may stand in its slot already: a message that failed half-way, or a predecessor's.
    /// Then `write_intent` must go on saying so.
    begun: bool,
    /// Whether this writer has found that nobody holds the slot, and has announced since what it does to it: no pin that was
    /// set later holds.
    taken: bool,
}

/// A slot was left alone since a reader holds the message in it; the bits of those who do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pinned {
    pub(crate) holders: u32,
}

/// What the wake decision came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wake {
    /// Nobody slept: no system call.
    NotNeeded,
    /// Sleepers were called, and this many woke.
    Woke(u32),
}

impl Writer {
    /// Goes on where the segment stands: at 0 in a new one, at the predecessor's next message in one that was taken over.
    pub(crate) fn resume(memory: &Memory) -> Writer {
        let next = memory.u64(WRITE_IDX).load(Ordering::Acquire);
        // SeqCst: what `pins.rs` says of the fence behind the message before.
        fence(Ordering::SeqCst);
        Writer {
            next,
            begun: memory.u64(WRITE_INTENT).load(Ordering::Relaxed) != next,
            taken: false,
        }
    }

    pub(crate) fn next(&self) -> u64 {
        self.next
    }

    /// Publishes the concatenation of `parts`, which fits the slot, and returns its sequence number; or nothing, when a reader
    /// holds the slot.
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

    /// Announces that the slot of the next message is about to change. From here on no reader accepts what was in it.
    #[inline]
    pub(crate) fn begin(&mut self, memory: &Memory) -> Result<(), Pinned> {
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

    #[inline]
    fn poison(&self, memory: &Memory) {
        memory.slot(self.next).store(SLOT_SEQ_HI, POISON);
        // Release: meets the acquire fence in Reader::is_whole.
        fence(Ordering::Release);
    }

    /// Takes the announcement back if a reader holds the slot: the number may still not be used up.
    #[cold]
    fn leave_held_slot(&self, memory: &Memory) -> Result<(), Pinned> {
        let holders = pins::holders(memory, self.next);
        if holders == 0 {
            return Ok(());
        }
        if !self.begun {
            memory.u64(WRITE_INTENT).store(self.next, Ordering::Relaxed);
        }
        Err(Pinned { holders })
    }

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

    #[inline]
    pub(crate) fn commit(&self, memory: &Memory, len: usize, time_ns: u64) {
        let slot = memory.slot(self.next);
        slot.store(SLOT_LEN, len as u32);
        slot.store(SLOT_TIME_LO, time_ns as u32);
        slot.store(SLOT_TIME_HI, (time_ns >> 32) as u32);
        // Release: a legacy reader that sees the sequence and has an acquire fence behind it sees the message.
        fence(Ordering::Release);
        slot.store(SLOT_SEQ_LO, self.next as u32);
        slot.store(SLOT_SEQ_HI, (self.next >> 32) as u32);
    }

    #[inline]
    pub(crate) fn advance(&mut self, memory: &Memory, time_ns: u64) -> u64 {
        memory.u64(LAST_PUBLISH).store(time_ns, Ordering::Relaxed);
        self.use_number(memory)
    }

    #[inline]
    fn use_number(&mut self, memory: &Memory) -> u64 {
        let sequence = self.next;
        self.next = sequence.wrapping_add(1);
        (self.begun, self.taken) = (false, false);
        // Release: meets the Acquire in reader::published.
        memory.u64(WRITE_IDX).store(self.next, Ordering::Release);
        sequence
    }

    /// Uses up the number of the next message, whose slot a reader holds: the slot gets its number, no length and no time, and
    /// keeps its payload. `false`, and nothing was done, when there is no other slot to go on with.
    ///
    /// A legacy reader must find the number there: from one that is not the expected it would go back by a whole ring.
    #[cold]
    pub(crate) fn pass_over(&mut self, memory: &Memory) -> bool {
        if !pins::is_another_free(memory, self.next) {
            return false;
        }
        memory
            .u64(WRITE_INTENT)
            .store(self.next.wrapping_add(1), Ordering::Relaxed);
        self.poison(memory);
        self.commit(memory, 0, NO_MESSAGE);
        self.use_number(memory);
        bump(memory.u64(DROPPED_PINNED), 1);
        true
    }

    /// Counts a message that was dropped since readers hold all slots.
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

/// Tells readers that something changed; wakes them only if someone may be asleep.
#[inline]
pub(crate) fn notify(memory: &Memory) -> Wake {
    add_one_and_fence(memory.u32(FUTEX_WORD));
    let claimed = memory.u32(SUBSCRIBER_MASK).load(Ordering::Relaxed);
    let native = memory.u32(NATIVE_MASK).load(Ordering::Relaxed);
    let waiting = memory.u32(WAITING_MASK).load(Ordering::Relaxed);
    if (claimed & !native) | waiting == 0 {
        Wake::NotNeeded
    } else {
        wake(memory)
    }
}

/// Tells readers that something changed and wakes all of them, whatever the masks say.
pub(crate) fn notify_all(memory: &Memory) {
    // Release: meets the Acquire in wait::sleep.
    memory.u32(FUTEX_WORD).fetch_add(1, Ordering::Release);
    memory.futex_wake();
}

#[cold]
fn wake(memory: &Memory) -> Wake {
    bump(memory.u64(WAKE_COUNT), 1);
    Wake::Woke(memory.futex_wake())
}
