//! Which process opened a publisher, a subscriber or a thread. A child after `fork` shares its
//! parent's mappings, locks and reader slots, and owns none of them.

use std::sync::Once;
use std::sync::atomic::AtomicU64;

use crate::os;
use crate::sync::Ordering::Relaxed;

/// How many forks lie between this process and the first one that called [`Owner::here`].
static FORKS: AtomicU64 = AtomicU64::new(0);

/// The process that opened something.
///
/// For bindings of other languages. A child after `fork` must not wait for a lock of its
/// parent's: the thread that holds it does not exist in the child. So a binding asks
/// [`is_here`](Owner::is_here) before it takes such a lock. Publishers and subscribers ask by
/// themselves ([`Error::Forked`](crate::Error::Forked)).
///
/// ```
/// use conduit_ring::Owner;
///
/// let owner = Owner::here();
/// assert!(owner.is_here()); // false in a child that is forked from here on
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Owner(u64);

impl Owner {
    /// Returns this process.
    pub fn here() -> Owner {
        static WATCH: Once = Once::new();
        WATCH.call_once(|| os::call_in_children(count_fork));
        Owner(FORKS.load(Relaxed))
    }

    /// Returns whether the calling process is this one, and not a child of it. Costs one load.
    ///
    /// Relaxed: the count changes in the child before its first instruction.
    #[inline]
    pub fn is_here(self) -> bool {
        self.0 == FORKS.load(Relaxed)
    }
}

/// Runs in the child, which has one thread then.
extern "C" fn count_fork() {
    FORKS.fetch_add(1, Relaxed);
}
