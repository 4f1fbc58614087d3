//! The 16 reader slots: taking one, giving it up, and taking back those whose readers died.
//!
//! A reader slot is held by a lock, which the kernel frees when its reader dies; the bits only tell the writer about it. Bits of
//! a native reader slot change under its lock alone. A legacy reader has no lock: it sets its bit of `subscriber_mask` and then
//! writes its `read_idx`. Hence the order in which a native reader slot is given up: native, waiting and pin bits first (a legacy
//! successor of the bit must not be taken for native, or it would not be woken), then `read_idx` is made invalid, then the
//! mask bit goes, then `claim_id`. reader slots of a new segment begin with such a `read_idx`. Hence whatever step a native reader
//! was killed at, what it left is told from a legacy claim: by its native bit, or by a `claim_id` beside an invalid
//! `read_idx`. (One case errs on the safe side and is left to a person: killed in the midst of claiming a reader slot that a
//! legacy reader had before.)

use std::io;

use crate::layout::{NATIVE_MASK, PIN_MASK, ReaderSlot, SUBSCRIBER_MASK, WAITING_MASK};
use crate::memory::Memory;
use crate::source::{self, Source};
use crate::sync::Ordering::{AcqRel, Acquire, Relaxed, Release};

/// `read_idx` of a reader slot that has not been claimed yet, or that a native reader is giving up.
const GIVEN_UP: u64 = u64::MAX;

/// The locks on reader slots.
pub(crate) trait ReaderSlotLocks {
    /// `false` when another one has it.
    fn try_lock(&self, reader_slot: ReaderSlot) -> io::Result<bool>;
    fn unlock(&self, reader_slot: ReaderSlot) -> io::Result<()>;
}

/// Who claims, for people to read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Claimant {
    /// Random, so that a claim can be recognised.
    pub(crate) id: u64,
    pub(crate) pid: u32,
    pub(crate) start_time: u64,
}

/// A reader slot that is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Claim {
    pub(crate) reader_slot: ReaderSlot,
    pub(crate) id: u64,
}

impl Claim {
    /// Takes a reader slot, those of dead readers included; `None` when all are held.
    pub(crate) fn take(
        memory: &Memory,
        locks: &impl ReaderSlotLocks,
        who: Claimant,
    ) -> io::Result<Option<Claim>> {
        reclaim_leaked(memory, locks)?;
        for reader_slot in ReaderSlot::all() {
            if is_set(memory, reader_slot) || !locks.try_lock(reader_slot)? {
                continue;
            }
            if take_free(memory, reader_slot, who) {
                return Ok(Some(Claim {
                    reader_slot,
                    id: who.id,
                }));
            }
            locks.unlock(reader_slot)?;
        }
        Ok(None)
    }

    /// Whether the segment still says so; a legacy publisher may have started it anew.
    pub(crate) fn stands(&self, memory: &Memory) -> bool {
        memory.u64(self.reader_slot.claim_id()).load(Relaxed) == self.id
            && memory.u32(NATIVE_MASK).load(Relaxed) & self.reader_slot.bit() != 0
            && is_set(memory, self.reader_slot)
    }

    /// Gives the reader slot up if it still is this claim's, and its lock in any case.
    pub(crate) fn release(self, memory: &Memory, locks: &impl ReaderSlotLocks) -> io::Result<()> {
        if self.stands(memory) {
            clear(memory, self.reader_slot);
        }
        locks.unlock(self.reader_slot)
    }
}

/// Prepares the reader slots of a new segment.
pub(crate) fn prepare(memory: &Memory) {
    ReaderSlot::all()
        .for_each(|reader_slot| memory.u64(reader_slot.read_idx()).store(GIVEN_UP, Relaxed));
}

/// Gives up every reader slot whose native reader died. The caller holds no reader slot.
pub(crate) fn reclaim_leaked(memory: &Memory, locks: &impl ReaderSlotLocks) -> io::Result<()> {
    for reader_slot in ReaderSlot::all() {
        let leaked = is_native_claim(memory, reader_slot) || waits_unclaimed(memory, reader_slot);
        if leaked && locks.try_lock(reader_slot)? {
            if is_native_claim(memory, reader_slot) {
                clear(memory, reader_slot);
            } else {
                memory
                    .u32(WAITING_MASK)
                    .fetch_and(!reader_slot.bit(), Relaxed);
            }
            locks.unlock(reader_slot)?;
        }
    }
    Ok(())
}

/// Takes the pins of those of these reader slots (bits) whose readers died; whether there was one.
pub(crate) fn reclaim_pins(
    memory: &Memory,
    locks: &impl ReaderSlotLocks,
    reader_slots: u32,
) -> io::Result<bool> {
    let mut reclaimed = false;
    for reader_slot in ReaderSlot::all().filter(|reader_slot| reader_slots & reader_slot.bit() != 0)
    {
        if !locks.try_lock(reader_slot)? {
            continue;
        }
        if is_native_claim(memory, reader_slot) {
            clear(memory, reader_slot);
        } else {
            memory.u32(PIN_MASK).fetch_and(!reader_slot.bit(), Relaxed);
        }
        locks.unlock(reader_slot)?;
        reclaimed = true;
    }
    Ok(reclaimed)
}

/// Takes a reader slot whose lock is held and whose bit was clear; `false` when a legacy reader was quicker.
fn take_free(memory: &Memory, reader_slot: ReaderSlot, who: Claimant) -> bool {
    memory
        .u32(WAITING_MASK)
        .fetch_and(!reader_slot.bit(), Relaxed);
    memory.u32(PIN_MASK).fetch_and(!reader_slot.bit(), Relaxed);
    memory.u64(reader_slot.claim_id()).store(who.id, Relaxed);
    // AcqRel: meets the Release in clear and the Acquire in is_set.
    if memory
        .u32(SUBSCRIBER_MASK)
        .fetch_or(reader_slot.bit(), AcqRel)
        & reader_slot.bit()
        != 0
    {
        memory.u64(reader_slot.claim_id()).store(0, Relaxed);
        return false;
    }
    memory.u32(NATIVE_MASK).fetch_or(reader_slot.bit(), Relaxed);
    memory
        .u64(reader_slot.read_idx())
        .store(source::published(memory), Relaxed);
    memory.u32(reader_slot.pid()).store(who.pid, Relaxed);
    memory
        .u64(reader_slot.start_time())
        .store(who.start_time, Relaxed);
    memory.u64(reader_slot.lost_count()).store(0, Relaxed);
    reader_slot
        .pins()
        .into_iter()
        .for_each(|pin| memory.u64(pin).store(0, Relaxed));
    true
}

fn clear(memory: &Memory, reader_slot: ReaderSlot) {
    memory
        .u32(NATIVE_MASK)
        .fetch_and(!reader_slot.bit(), Relaxed);
    memory
        .u32(WAITING_MASK)
        .fetch_and(!reader_slot.bit(), Relaxed);
    memory.u32(PIN_MASK).fetch_and(!reader_slot.bit(), Relaxed);
    memory.u64(reader_slot.read_idx()).store(GIVEN_UP, Relaxed);
    // Release: meets the acquiring claim of a legacy successor, and fetch_or in take_free.
    memory
        .u32(SUBSCRIBER_MASK)
        .fetch_and(!reader_slot.bit(), Release);
    memory.u64(reader_slot.claim_id()).store(0, Relaxed);
}

fn is_set(source: &impl Source, reader_slot: ReaderSlot) -> bool {
    source.load32(SUBSCRIBER_MASK, Acquire) & reader_slot.bit() != 0
}

/// What a guarded reader that sleeps looks like: it claims nothing but the lock.
fn waits_unclaimed(memory: &Memory, reader_slot: ReaderSlot) -> bool {
    memory.u32(WAITING_MASK).load(Relaxed) & reader_slot.bit() != 0 && !is_set(memory, reader_slot)
}

/// Whether a set bit was set by a native reader, be it in the midst of claiming or giving up.
pub(crate) fn is_native_claim(source: &impl Source, reader_slot: ReaderSlot) -> bool {
    let native = source.load32(NATIVE_MASK, Relaxed) & reader_slot.bit() != 0;
    let giving_up = source.load(reader_slot.claim_id(), Relaxed) != 0
        && source.load(reader_slot.read_idx(), Relaxed) == GIVEN_UP;
    is_set(source, reader_slot) && (native || giving_up)
}
