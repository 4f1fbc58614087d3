//! Pins: a reader that wants to look at a message where it lies, instead of copying it, says so, and the writer passes that
//! slot over until the pin is gone. Nobody waits for anybody.
//!
//! A pin is a word in the reader's reader slot: sequence number + 1 of the message that is held. Both sides announce first and look
//! then, with a SeqCst fence between: the reader writes its pin and looks at `write_intent`; the writer writes `write_intent`
//! and looks at the pins. At least one of the two sees the other: the reader fails, or the writer leaves the payload alone.
//!
//! The header of a held slot is not left alone: the writer puts the number there that it passes over. So a reader takes
//! length and time once, validates them as it validates a copy, and never looks at the header again. A slot that was passed
//! over holds a message of more than one lap ago. Hence a pin counts for its slot, whatever the lap of its message.
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

use crate::layout::{At64, PIN_MASK, ReaderSlot};
use crate::memory::Memory;
use crate::source;
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

/// Says that the reader of this reader slot uses pins, until it gives the reader slot up.
pub(crate) fn announce(memory: &Memory, reader_slot: ReaderSlot) -> Announced {
    // Release: meets the Acquire in `holders`, which then sees the pins that were cleared when the reader slot was claimed.
    memory
        .u32(PIN_MASK)
        .fetch_or(reader_slot.bit(), Ordering::Release);
    fence(Ordering::SeqCst);
    Announced {
        unseen: source::published(memory),
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

/// The reader slots, as bits, that hold a message in the slot which message `next` is about to take. `write_intent` says `next`
/// already.
#[cold]
pub(crate) fn holders(memory: &Memory, next: u64) -> u32 {
    // SeqCst: meets the fence in `pin`.
    fence(Ordering::SeqCst);
    // Acquire: meets the Release in `announce`, for a bit that has just been set.
    let mask = memory.u32(PIN_MASK).load(Ordering::Acquire);
    ReaderSlot::all()
        .filter(|reader_slot| {
            mask & reader_slot.bit() != 0 && holds_slot(memory, *reader_slot, next)
        })
        .fold(0, |bits, reader_slot| bits | reader_slot.bit())
}

/// Whether some slot behind that of message `next` is held by nobody, as far as a look tells: there are fewer pins than most
/// rings have slots, so that it is a short one.
#[cold]
pub(crate) fn is_another_free(memory: &Memory, next: u64) -> bool {
    (1..u64::from(memory.geometry().slot_count()))
        .any(|ahead| holders(memory, next.wrapping_add(ahead)) == 0)
}

fn holds_slot(memory: &Memory, reader_slot: ReaderSlot, sequence: u64) -> bool {
    let lap = u64::from(memory.geometry().slot_count()) - 1;
    reader_slot.pins().into_iter().any(|pin| {
        // Acquire: meets the Release in `unpin`.
        let pin = memory.u64(pin).load(Ordering::Acquire);
        pin != 0 && (pin - 1) & lap == sequence & lap
    })
}

/// The messages that the reader of this reader slot holds, the oldest first, for people to read.
#[cfg(not(loom))]
pub(crate) fn held(source: &impl source::Source, reader_slot: ReaderSlot) -> Vec<u64> {
    if source.load32(PIN_MASK, Ordering::Relaxed) & reader_slot.bit() == 0 {
        return Vec::new();
    }
    let pins = reader_slot
        .pins()
        .map(|pin| source.load(pin, Ordering::Relaxed));
    let mut held: Vec<u64> = pins
        .into_iter()
        .filter_map(|pin| pin.checked_sub(1))
        .collect();
    held.sort_unstable();
    held
}
