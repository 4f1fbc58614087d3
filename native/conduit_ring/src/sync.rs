//! The atomics that the protocol is written with: core's, or loom's when the protocol is
//! model-checked.

#[cfg(not(loom))]
pub(crate) use core::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
#[cfg(loom)]
pub(crate) use loom::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};

/// Adds to a word that only one process writes. It is cheaper than an atomic addition.
///
/// Relaxed: the words are counters for people.
#[inline]
pub(crate) fn bump(counter: &AtomicU64, by: u64) {
    counter.store(
        counter.load(Ordering::Relaxed).wrapping_add(by),
        Ordering::Relaxed,
    );
}

/// Adds one to a word, and then is a full fence: every access before it, the addition included,
/// comes before every access behind it.
#[inline]
pub(crate) fn add_one_and_fence(word: &AtomicU32) {
    // Release: pairs with the Acquire in wait::sleep.
    word.fetch_add(1, Ordering::Release);
    // On x86-64 a locked addition is a full fence already (Intel SDM 3A, 9.2.3.9; AMD APM 2,
    // 7.4.2), and a second one costs half as much as publishing a small message.
    #[cfg(all(target_arch = "x86_64", not(loom), not(miri)))]
    core::sync::atomic::compiler_fence(Ordering::SeqCst);
    #[cfg(not(all(target_arch = "x86_64", not(loom), not(miri))))]
    fence(Ordering::SeqCst);
}
