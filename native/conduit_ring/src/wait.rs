//! Sleeping until there is news, without losing a wake-up.
//!
//! ```text
//!   sleeper                                writer (writer::notify)
//!   ───────                                ───────────────────────
//!   seen = futex_word        Acquire       write_idx = W + 1      Release
//!   waiting_mask |= own bit  relaxed       futex_word += 1        Release
//!   ── SeqCst fence ──                     ── SeqCst fence ──
//!   news? then no sleep                    waiting_mask != 0?
//!   FUTEX_WAIT while futex_word == seen      then FUTEX_WAKE
//! ```
//!
//! Behind the two fences at least one side sees the other. Either the sleeper sees the message,
//! or the writer sees the waiting bit and wakes it. A wake-up between the check and the sleep
//! changes `futex_word`, so that the kernel does not let the sleeper sleep.

use std::time::Duration;

use crate::layout::{FUTEX_WORD, ReaderSlot, WAITING_MASK};
use crate::memory::Memory;
use crate::sync::{Ordering, fence};

/// The longest single sleep. After it the sleeper checks that the publisher lives.
pub(crate) const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// The longest single sleep on a legacy publisher's segment, whose end wakes no reader.
pub(crate) const LONGEST_LEGACY_SLEEP: Duration = Duration::from_millis(50);

/// Sleeps until the writer notifies, unless there is news already. May return early for no
/// reason.
///
/// `news` is called once the waiting bit is set. A message that it does not see is followed by a
/// wake-up.
pub(crate) fn sleep(
    memory: &Memory,
    reader_slot: ReaderSlot,
    timeout: Duration,
    news: impl FnOnce() -> bool,
) {
    // Acquire: pairs with the Release in writer::notify, so that `news` sees whatever came before
    // a bump that is seen here.
    let seen = memory.u32(FUTEX_WORD).load(Ordering::Acquire);
    // Relaxed: the fence behind it orders it.
    memory
        .u32(WAITING_MASK)
        .fetch_or(reader_slot.bit(), Ordering::Relaxed);
    // SeqCst: pairs with the fence in sync::add_one_and_fence. It orders the bit before the look
    // of `news`.
    fence(Ordering::SeqCst);
    if !news() {
        memory.futex_wait(seen, timeout.min(LONGEST_SLEEP));
    }
    // Relaxed: a bit that is seen too long costs the writer a wake-up, and nothing else.
    memory
        .u32(WAITING_MASK)
        .fetch_and(!reader_slot.bit(), Ordering::Relaxed);
}

/// Sleeps on a mapping that cannot be written, unless there is news already.
///
/// No waiting bit announces the sleep. A writer that sees no other sleeper wakes no one, so that
/// only `timeout` bounds this sleep.
pub(crate) fn sleep_unseen(memory: &Memory, timeout: Duration, news: impl FnOnce() -> bool) {
    // Acquire: pairs with the Release in writer::notify, so that `news` sees whatever came before
    // a bump that is seen here.
    let seen = memory.u32(FUTEX_WORD).load(Ordering::Acquire);
    if !news() {
        memory.futex_wait(seen, timeout.min(LONGEST_SLEEP));
    }
}
