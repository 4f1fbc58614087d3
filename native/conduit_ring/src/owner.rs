//! The process that opened something. A child after `fork` shares its parent's mappings, locks and reader slots, and owns
//! none of them.

use std::sync::Once;
use std::sync::atomic::AtomicU64;

use crate::os;
use crate::sync::Ordering::Relaxed;

/// How many forks lie between this process and the first one that opened something.
static FORKS: AtomicU64 = AtomicU64::new(0);

/// The process that opened something, for bindings of other languages: a child after `fork` must not even wait for a lock
/// of its parent's, whose holder is not there to let go of it. Asking costs one load.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Owner(u64);

impl Owner {
    /// This process.
    pub fn here() -> Owner {
        static WATCH: Once = Once::new();
        WATCH.call_once(|| os::call_in_children(count_fork));
        Owner(FORKS.load(Relaxed))
    }

    /// Whether it is this process still, and not a child of it.
    #[inline]
    pub fn is_here(self) -> bool {
        self.0 == FORKS.load(Relaxed)
    }
}

/// Runs in the child alone, which has one thread then.
extern "C" fn count_fork() {
    FORKS.fetch_add(1, Relaxed);
}
