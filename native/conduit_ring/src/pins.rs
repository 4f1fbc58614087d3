//! Pins: a reader that wants to look at a message where it lies, instead of copying it, says so, and the writer drops new
//! messages for that slot until the pin is gone. Nobody waits for anybody.
//!
//! A pin is a word in the reader's line: sequence number + 1 of the message that is held. Both sides announce first and look
//! then, with a SeqCst fence between: the reader writes its pin and looks at `write_intent`; the writer writes `write_intent`
//! and looks at the pins. At least one of the two sees the other: the reader fails, or the writer leaves the slot alone.
//!
//! # Why the writer needs no fence while nobody uses pins
//!
//! The writer looks at `pin_mask` first, and only if a bit stands there does it pay for the fence and the scan. Between its
//! store of `write_intent` and that look there is no fence, so the look may be older than the store. But it is never older
//! than the SeqCst fence that ends the publishing of the message before (`writer::notify`), or than the one in
//! `Writer::resume`. Hence a reader sets its bit once and leaves it ([`announce`]): bit, SeqCst fence, then `write_idx`, say
//! w. Whatever fence of the writer's comes later than the reader's is followed by a look that sees the bit. Whatever fence
//! came earlier followed a store of `write_idx` that the reader sees, so it ended a message before w. So the one message that
//! may be written without a look at the pins is w itself, and the one message that this can overwrite is w − slot_count.
//! That one the reader does not pin: it copies it ([`Announced::protects`]). All others are safe from then on.

use crate::layout::{At64, PIN_MASK, ReaderLine};
use crate::memory::Memory;
use crate::reader;
use crate::sync::{Ordering, fence};

/// What a reader knows once its bit of `pin_mask` is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Announced {
    /// The one message that may be written without a look at this reader's pins.
    unseen: u64,
}

impl Announced {
    /// Whether a pin on this message is respected.
    pub(crate) fn protects(self, memory: &Memory, sequence: u64) -> bool {
        let slots = u64::from(memory.geometry().slot_count());
        sequence.wrapping_add(slots) != self.unseen
    }
}

/// Says that the reader of this line uses pins, until it gives the line up.
pub(crate) fn announce(memory: &Memory, line: ReaderLine) -> Announced {
    // Release: meets the Acquire in `holders`, which then sees the pins that were cleared when the line was claimed.
    memory.u32(PIN_MASK).fetch_or(line.bit(), Ordering::Release);
    fence(Ordering::SeqCst);
    Announced {
        unseen: reader::published(memory),
    }
}

/// Sets a pin. It holds if the message is found whole afterwards.
pub(crate) fn pin(memory: &Memory, pin: At64, sequence: u64) {
    memory
        .u64(pin)
        .store(sequence.wrapping_add(1), Ordering::Relaxed);
    fence(Ordering::SeqCst);
}

/// Takes a pin away, whoever has it now.
pub(crate) fn unpin(memory: &Memory, pin: At64) {
    // Release: meets the Acquire in `holders`: all that was read of the slot was read before it is overwritten.
    memory.u64(pin).store(0, Ordering::Release);
}

/// Whether some reader uses pins at all.
#[inline]
pub(crate) fn in_use(memory: &Memory) -> bool {
    memory.u32(PIN_MASK).load(Ordering::Relaxed) != 0
}

/// The lines, as bits, that hold the message which message `next` is about to overwrite. `write_intent` says `next` already.
#[cold]
pub(crate) fn holders(memory: &Memory, next: u64) -> u32 {
    // SeqCst: meets the fence in `pin`.
    fence(Ordering::SeqCst);
    let Some(held) = next.checked_sub(u64::from(memory.geometry().slot_count())) else {
        return 0;
    };
    // Acquire: meets the Release in `announce`, for a bit that has just been set.
    let mask = memory.u32(PIN_MASK).load(Ordering::Acquire);
    ReaderLine::all()
        .filter(|line| mask & line.bit() != 0 && holds(memory, *line, held))
        .fold(0, |bits, line| bits | line.bit())
}

fn holds(memory: &Memory, line: ReaderLine, sequence: u64) -> bool {
    // Acquire: meets the Release in `unpin`.
    line.pins()
        .into_iter()
        .any(|pin| memory.u64(pin).load(Ordering::Acquire) == sequence.wrapping_add(1))
}

/// How many messages the reader of this line holds, for people to read.
#[cfg(not(loom))]
pub(crate) fn count(memory: &Memory, line: ReaderLine) -> u32 {
    if memory.u32(PIN_MASK).load(Ordering::Relaxed) & line.bit() == 0 {
        return 0;
    }
    let set = |pin: &At64| memory.u64(*pin).load(Ordering::Relaxed) != 0;
    line.pins().iter().filter(|pin| set(pin)).count() as u32
}
