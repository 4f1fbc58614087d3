//! Pins: a reader looks at a message in its slot, instead of copying it, and the writer passes
//! the slot over until the pin is cleared. Neither side waits for the other.
//!
//! A pin is a word in the reader slot: the sequence number + 1 of the message that is held. Both
//! sides announce first and look then, with a SeqCst fence between:
//!
//! ```text
//!   reader                               writer
//!   ──────                               ──────
//!   pin = r + 1                          write_intent = W + 1
//!   ── SeqCst fence ──                   ── SeqCst fence ──
//!   load write_intent                    load the pins
//!     past r + slot_count? unpin, fail     one in this slot? pass the slot over
//! ```
//!
//! At least one of the two sees the other: the reader fails, or the writer leaves the payload
//! alone.
//!
//! The header of a held slot is not left alone: the writer stores the number there that it passes
//! over. So a reader takes length and time once, validates them as it validates a copy, and never
//! looks at the header again. A slot that was passed over holds a message of more than one lap
//! ago. Hence a pin counts for its slot, whatever the lap of its message.
//!
//! # Why the writer needs no fence while no reader uses pins
//!
//! The writer loads `pin_mask` first. Only if a bit is set does it pay for the fence and the
//! scan. Between its store of `write_intent` and that load there is no fence, so the load may be
//! older than the store. But it is never older than the SeqCst fence that ends the publishing of
//! the message before (`writer::notify`), or than the fence in `Writer::resume`.
//!
//! Hence a reader sets its bit once and leaves it ([`announce`]): it sets the bit, has a SeqCst
//! fence, and then loads `write_idx`, say w. There are two cases for each fence of the writer:
//! - It comes later than the reader's. Then the load behind it sees the bit.
//! - It comes earlier. Then it follows a store of `write_idx` that the reader sees, so that it
//!   ended a message before w.
//!
//! So w is the one message that may be written without a look at the pins, and w − `slot_count`
//! is the one message that it can overwrite. The reader does not pin that one: it copies it
//! ([`Announced::protects`]). All others are safe from then on.

use crate::layout::{At64, PIN_MASK, ReaderSlot};
use crate::memory::Memory;
use crate::source;
use crate::sync::{Ordering, fence};

/// What a reader knows once its bit of `pin_mask` is set.
///
/// It is a proof that [`announce`] was called, and needed to decide whether a pin counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Announced {
    /// The one message that may be written without a look at this reader's pins.
    unseen: u64,
}

impl Announced {
    /// Returns whether the writer respects a pin on this message.
    pub(crate) fn protects(self, memory: &Memory, sequence: u64) -> bool {
        let slots = u64::from(memory.geometry().slot_count());
        sequence.wrapping_add(slots) != self.unseen
    }
}

/// Announces that the reader in this reader slot uses pins, until it releases the slot.
pub(crate) fn announce(memory: &Memory, reader_slot: ReaderSlot) -> Announced {
    // Release: pairs with the Acquire in `holders`, which then sees that the pins were cleared
    // when the reader slot was claimed.
    memory
        .u32(PIN_MASK)
        .fetch_or(reader_slot.bit(), Ordering::Release);
    // SeqCst: pairs with the writer's fences in notify and resume; see the module.
    fence(Ordering::SeqCst);
    Announced {
        unseen: source::published(memory),
    }
}

/// Sets a pin. It counts if the message is found whole afterwards.
pub(crate) fn pin(memory: &Memory, pin: At64, sequence: u64) {
    memory
        .u64(pin)
        .store(sequence.wrapping_add(1), Ordering::Relaxed);
    // SeqCst: pairs with the fence in `holders`. Either the writer sees this pin, or the reader
    // sees the writer's intent.
    fence(Ordering::SeqCst);
}

/// Clears a pin.
pub(crate) fn unpin(memory: &Memory, pin: At64) {
    // Release: pairs with the Acquire in `holds_slot`, so that the reads of the slot come before
    // the writes that overwrite it.
    memory.u64(pin).store(0, Ordering::Release);
}

/// Returns whether some reader uses pins. Relaxed: the module explains why that suffices.
#[inline]
pub(crate) fn in_use(memory: &Memory) -> bool {
    memory.u32(PIN_MASK).load(Ordering::Relaxed) != 0
}

/// Returns the reader slots, as bits, that hold a message in the slot which message `next` is
/// about to take. `write_intent` must already announce `next`.
#[cold]
pub(crate) fn holders(memory: &Memory, next: u64) -> u32 {
    // SeqCst: pairs with the fence in `pin`. Either the loads below see the pin, or its reader
    // sees the intent.
    fence(Ordering::SeqCst);
    // Acquire: pairs with the Release in `announce`, for a bit that has just been set.
    let mask = memory.u32(PIN_MASK).load(Ordering::Acquire);
    ReaderSlot::all()
        .filter(|reader_slot| {
            mask & reader_slot.bit() != 0 && holds_slot(memory, *reader_slot, next)
        })
        .fold(0, |bits, reader_slot| bits | reader_slot.bit())
}

/// Returns whether no reader holds some slot behind that of message `next`. It is a short search:
/// most rings have more slots than there are pins.
#[cold]
pub(crate) fn is_another_free(memory: &Memory, next: u64) -> bool {
    (1..u64::from(memory.geometry().slot_count()))
        .any(|ahead| holders(memory, next.wrapping_add(ahead)) == 0)
}

fn holds_slot(memory: &Memory, reader_slot: ReaderSlot, sequence: u64) -> bool {
    let lap = u64::from(memory.geometry().slot_count()) - 1;
    reader_slot.pins().into_iter().any(|pin| {
        // Acquire: pairs with the Release in `unpin`.
        let pin = memory.u64(pin).load(Ordering::Acquire);
        pin != 0 && (pin - 1) & lap == sequence & lap
    })
}

/// Returns the messages that the reader in this reader slot holds, the oldest first. For people.
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
