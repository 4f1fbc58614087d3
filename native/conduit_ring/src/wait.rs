//! Sleeping until there is news, without losing a wake-up.

use std::time::Duration;

use crate::layout::{FUTEX_WORD, ReaderSlot, WAITING_MASK};
use crate::memory::Memory;
use crate::sync::{Ordering, fence};

/// The longest single sleep: whoever wakes from it looks whether the publisher lives.
pub(crate) const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// The same where the publisher is a legacy one, whose end wakes nobody.
pub(crate) const LONGEST_LEGACY_SLEEP: Duration = Duration::from_millis(50);

/// Sleeps until the writer notifies, unless there is news already. Returns for no reason, too.
///
/// `news` is asked once the waiting bit is set: what it does not see then, the writer follows with a wake-up.
pub(crate) fn sleep(
    memory: &Memory,
    reader_slot: ReaderSlot,
    timeout: Duration,
    news: impl FnOnce() -> bool,
) {
    // Acquire: meets the Release in writer::notify, so that what came before a bump seen here is seen by `news`.
    let seen = memory.u32(FUTEX_WORD).load(Ordering::Acquire);
    memory
        .u32(WAITING_MASK)
        .fetch_or(reader_slot.bit(), Ordering::Relaxed);
    fence(Ordering::SeqCst);
    if !news() {
        memory.futex_wait(seen, timeout.min(LONGEST_SLEEP));
    }
    memory
        .u32(WAITING_MASK)
        .fetch_and(!reader_slot.bit(), Ordering::Relaxed);
}

/// Sleeps through a mapping that cannot be written, unless there is news already. No waiting bit says so: a writer that
/// sees no other sleeper calls nobody, so the time-out is what bounds this sleep.
pub(crate) fn sleep_unseen(memory: &Memory, timeout: Duration, news: impl FnOnce() -> bool) {
    // Acquire: meets the Release in writer::notify, so that what came before a bump seen here is seen by `news`.
    let seen = memory.u32(FUTEX_WORD).load(Ordering::Acquire);
    if !news() {
        memory.futex_wait(seen, timeout.min(LONGEST_SLEEP));
    }
}
