//! Whether a legacy publisher lives. It holds no lock, so that only its messages and its mapping
//! show it.

use std::time::{Duration, Instant};

use crate::backing::Backing;
use crate::processes;

/// How long a legacy publisher may be silent before the processes are searched, and the interval
/// between two searches.
const SEARCH_INTERVAL: Duration = Duration::from_secs(1);

/// What is known about a legacy publisher.
#[derive(Debug)]
pub(crate) struct LegacyPublisher {
    alive: bool,
    published: u64,
    next_search: Instant,
    /// The process that had the segment mapped at the last search.
    peer: Option<u32>,
}

impl LegacyPublisher {
    /// Assumes that it lives.
    pub(crate) fn new() -> LegacyPublisher {
        LegacyPublisher {
            alive: true,
            published: 0,
            next_search: Instant::now() + SEARCH_INTERVAL,
            peer: None,
        }
    }

    /// Returns whether the publisher lives, as far as is known: it publishes, or some process has
    /// the segment mapped as a publisher would.
    pub(crate) fn is_alive(&mut self, backing: &Backing) -> bool {
        let published = backing.published();
        if published != self.published {
            self.published = published;
            self.alive = true;
            self.next_search = Instant::now() + SEARCH_INTERVAL;
        } else if Instant::now() >= self.next_search {
            let (own, last) = (backing.reader_slot(), self.peer);
            self.peer = match backing {
                Backing::Mapped { attached, .. } => {
                    processes::legacy_peer(&attached.segment, &*attached.memory, own, last)
                }
                Backing::Guarded(guarded) => {
                    processes::legacy_peer(&guarded.segment, &**guarded, own, last)
                }
            };
            self.alive = self.peer.is_some();
            self.next_search = Instant::now() + SEARCH_INTERVAL;
        }
        self.alive
    }
}
