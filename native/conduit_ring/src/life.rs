//! Whether the publisher of a segment lives.
//!
//! A native publisher holds a lock. A legacy publisher holds none, so that only its messages and
//! its mapping show it.

use std::time::{Duration, Instant};

use crate::backing::Backing;
use crate::os::Name;
use crate::processes;

/// What is to be expected of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Life {
    /// Its publisher lives, as far as is known.
    Up,
    /// Its publisher died; another one may continue it.
    Down,
    /// Nothing will ever be published there again, or the name leads elsewhere.
    Over,
}

/// Judges by the publisher's life and by the file that the topic's name leads to. A native
/// publisher gets a removed name back; a legacy publisher does not.
pub(crate) fn life_of(native: bool, alive: bool, name: Name) -> Life {
    match (native, alive, name) {
        (_, _, Name::Other) => Life::Over,
        (true, true, _) | (false, true, Name::Same) => Life::Up,
        (_, false, Name::Same) => Life::Down,
        (_, _, Name::Missing) => Life::Over,
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_native_segment_lives_by_its_lock_and_is_over_when_replaced() {
        assert_eq!(life_of(true, true, Name::Same), Life::Up);
        assert_eq!(life_of(true, true, Name::Missing), Life::Up);
        assert_eq!(life_of(true, false, Name::Same), Life::Down);
        assert_eq!(life_of(true, false, Name::Missing), Life::Over);
        assert_eq!(life_of(true, true, Name::Other), Life::Over);
    }

    #[test]
    fn a_legacy_segment_lives_by_its_name_and_by_who_has_it_mapped() {
        assert_eq!(life_of(false, true, Name::Same), Life::Up);
        assert_eq!(life_of(false, false, Name::Same), Life::Down);
        for alive in [false, true] {
            assert_eq!(life_of(false, alive, Name::Missing), Life::Over);
            assert_eq!(life_of(false, alive, Name::Other), Life::Over);
        }
    }
}
