//! The 16 reader slots: taking one, releasing it, and taking back those whose readers died.
//!
//! A lock holds a reader slot, and the kernel frees it when the reader dies. The bits in the
//! header only tell the publisher about it. The bits of a native reader slot change under its
//! lock alone.
//!
//! ```text
//!              claim                                        release
//!    lock                                         native_mask     &= !bit
//!    waiting_mask, pin_mask &= !bit               waiting_mask    &= !bit
//!    claim_id = random                            pin_mask        &= !bit
//!    subscriber_mask |= bit   AcqRel              read_idx = u64::MAX
//!    native_mask     |= bit                       subscriber_mask &= !bit    Release
//!    read_idx = write_idx, pins = 0               claim_id = 0
//!                                                 unlock
//! ```
//!
//! A legacy reader has no lock: it sets its bit of `subscriber_mask` and then writes its
//! `read_idx`. Two things follow for the order of a release:
//! - Native, waiting and pin bits go before the mask bit. Else a legacy successor of that bit
//!   would be taken for native, and not be woken.
//! - `read_idx` is made invalid before the mask bit goes, and a new segment begins with such a
//!   `read_idx`. So at whatever step a native reader is killed, its leftovers differ from a
//!   legacy claim: by the native bit, or by a `claim_id` beside an invalid `read_idx`.
//!
//! All other accesses are Relaxed: they are made under the lock, and a lock that changes hands is
//! a system call on both sides, which orders them.
//!
//! One case errs on the safe side and is left to a person: a reader that is killed while it
//! claims a reader slot that a legacy reader had before.

use std::io;

use crate::layout::{NATIVE_MASK, PIN_MASK, ReaderSlot, SUBSCRIBER_MASK, WAITING_MASK};
use crate::memory::Memory;
use crate::source::{self, Source};
use crate::sync::Ordering::{AcqRel, Acquire, Relaxed, Release};

/// `read_idx` of a reader slot that was never claimed, or that a native reader is releasing.
const RELEASED: u64 = u64::MAX;

/// The locks on reader slots: the kernel's, or a model of them.
pub(crate) trait ReaderSlotLocks {
    /// Takes the lock. Returns `false` when another reader has it.
    fn try_lock(&self, reader_slot: ReaderSlot) -> io::Result<bool>;

    /// Frees the lock.
    fn unlock(&self, reader_slot: ReaderSlot) -> io::Result<()>;
}

/// The reader that claims, as it is written into the reader slot for people.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Claimant {
    /// A random number by which the claim is recognised.
    pub(crate) id: u64,
    pub(crate) pid: u32,
    pub(crate) start_time: u64,
}

/// A reader slot that this process holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Claim {
    pub(crate) reader_slot: ReaderSlot,
    pub(crate) id: u64,
}

impl Claim {
    /// Takes a reader slot, if need be a dead reader's. Returns `None` when all are held.
    pub(crate) fn take(
        memory: &Memory,
        locks: &impl ReaderSlotLocks,
        claimant: Claimant,
    ) -> io::Result<Option<Claim>> {
        reclaim_leaked(memory, locks)?;
        for reader_slot in ReaderSlot::all() {
            if is_set(memory, reader_slot) || !locks.try_lock(reader_slot)? {
                continue;
            }
            if take_free(memory, reader_slot, claimant) {
                return Ok(Some(Claim {
                    reader_slot,
                    id: claimant.id,
                }));
            }
            locks.unlock(reader_slot)?;
        }
        Ok(None)
    }

    /// Returns whether the segment still says so. A legacy publisher that starts again clears it.
    ///
    /// Relaxed: an outdated answer is corrected by the next check.
    pub(crate) fn is_current(&self, memory: &Memory) -> bool {
        memory.u64(self.reader_slot.claim_id()).load(Relaxed) == self.id
            && memory.u32(NATIVE_MASK).load(Relaxed) & self.reader_slot.bit() != 0
            && is_set(memory, self.reader_slot)
    }

    /// Releases the reader slot if it is still this claim's, and its lock in any case.
    pub(crate) fn release(self, memory: &Memory, locks: &impl ReaderSlotLocks) -> io::Result<()> {
        if self.is_current(memory) {
            clear(memory, self.reader_slot);
        }
        locks.unlock(self.reader_slot)
    }
}

/// Prepares the reader slots of a new segment.
pub(crate) fn prepare(memory: &Memory) {
    ReaderSlot::all()
        .for_each(|reader_slot| memory.u64(reader_slot.read_idx()).store(RELEASED, Relaxed));
}

/// Releases every reader slot whose native reader died. The caller holds no reader slot.
///
/// Each slot is looked at again under its lock: until then a living reader may have taken it.
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

/// Clears the pins in those of these reader slots (bits) whose readers died. Returns whether
/// there was one.
pub(crate) fn reclaim_pins(
    memory: &Memory,
    locks: &impl ReaderSlotLocks,
    reader_slots: u32,
) -> io::Result<bool> {
    let mut reclaimed = false;
    let is_asked_for = |reader_slot: &ReaderSlot| reader_slots & reader_slot.bit() != 0;
    for reader_slot in ReaderSlot::all().filter(is_asked_for) {
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

/// Claims a reader slot whose lock is held and whose bit was clear. Returns `false` when a legacy
/// reader was faster.
fn take_free(memory: &Memory, reader_slot: ReaderSlot, claimant: Claimant) -> bool {
    memory
        .u32(WAITING_MASK)
        .fetch_and(!reader_slot.bit(), Relaxed);
    memory.u32(PIN_MASK).fetch_and(!reader_slot.bit(), Relaxed);
    memory
        .u64(reader_slot.claim_id())
        .store(claimant.id, Relaxed);
    // AcqRel: the Acquire pairs with the Release in clear, so that the predecessor's stores come
    // first; the Release pairs with the Acquire in is_set, so that a peer that sees the bit sees
    // the claim_id. The other stores are Relaxed: they change under the lock, or are for people.
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
    memory.u32(reader_slot.pid()).store(claimant.pid, Relaxed);
    memory
        .u64(reader_slot.start_time())
        .store(claimant.start_time, Relaxed);
    memory.u64(reader_slot.lost_count()).store(0, Relaxed);
    reader_slot
        .pins()
        .into_iter()
        .for_each(|pin| memory.u64(pin).store(0, Relaxed));
    true
}

/// Releases a reader slot in the order that the module explains.
fn clear(memory: &Memory, reader_slot: ReaderSlot) {
    memory
        .u32(NATIVE_MASK)
        .fetch_and(!reader_slot.bit(), Relaxed);
    memory
        .u32(WAITING_MASK)
        .fetch_and(!reader_slot.bit(), Relaxed);
    memory.u32(PIN_MASK).fetch_and(!reader_slot.bit(), Relaxed);
    memory.u64(reader_slot.read_idx()).store(RELEASED, Relaxed);
    // Release: pairs with the acquiring claim of a legacy successor, and with fetch_or in
    // take_free. The next reader with this bit finds the others cleared.
    memory
        .u32(SUBSCRIBER_MASK)
        .fetch_and(!reader_slot.bit(), Release);
    memory.u64(reader_slot.claim_id()).store(0, Relaxed);
}

/// Acquire: pairs with the AcqRel in take_free.
fn is_set(source: &impl Source, reader_slot: ReaderSlot) -> bool {
    source.load32(SUBSCRIBER_MASK, Acquire) & reader_slot.bit() != 0
}

/// Returns whether a guarded reader sleeps here, or died asleep: it claims nothing but the lock.
fn waits_unclaimed(memory: &Memory, reader_slot: ReaderSlot) -> bool {
    let waits = memory.u32(WAITING_MASK).load(Relaxed) & reader_slot.bit() != 0;
    waits && !is_set(memory, reader_slot)
}

/// Returns whether a native reader set the bit, also while it claims or releases the slot.
pub(crate) fn is_native_claim(source: &impl Source, reader_slot: ReaderSlot) -> bool {
    let native = source.load32(NATIVE_MASK, Relaxed) & reader_slot.bit() != 0;
    let releasing = source.load(reader_slot.claim_id(), Relaxed) != 0
        && source.load(reader_slot.read_idx(), Relaxed) == RELEASED;
    is_set(source, reader_slot) && (native || releasing)
}
