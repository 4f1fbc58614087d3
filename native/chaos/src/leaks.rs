//! Counts reader slots that no reader has and none can get.

use std::collections::BTreeSet;
use std::io;
use std::thread;
use std::time::{Duration, Instant};

use conduit_ring::{Error, Info, State, Subscriber, SubscriberOptions, Topic};

/// The number of reader slots of a topic.
const SLOTS: usize = 16;
const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// Returns the number of leaked slots of a topic. `readers` returns the processes that read the
/// topic, each by one subscriber.
///
/// Opens as many subscribers as possible: together with the readers there must be sixteen. The
/// first one's claim reclaims the slots of dead readers; no doctor runs.
///
/// Each reader must have its slot before that. A reader that moves from one segment to the next
/// while these subscribers have all slots is refused one.
pub fn count(
    topic: &Topic,
    patience: Duration,
    mut readers: impl FnMut() -> io::Result<BTreeSet<u32>>,
) -> io::Result<u64> {
    let deadline = Instant::now() + patience;
    loop {
        let info = match Info::read(topic) {
            // The topic's publisher was ended while it was between two segments.
            Err(Error::NoTopic { .. }) => return Ok(0),
            info => info.map_err(io::Error::other)?,
        };
        if !matches!(info.state, State::Live | State::Dead) {
            return Ok(0);
        }
        let readers = readers()?;
        let late = Instant::now() > deadline;
        if late || have_slots(&readers, &info) {
            let missing = SLOTS.abs_diff(open_all(topic).len() + readers.len());
            if missing == 0 || late {
                return Ok(missing as u64);
            }
        }
        thread::sleep(RETRY_PAUSE);
    }
}

/// Returns whether each of these processes has a reader slot.
fn have_slots(readers: &BTreeSet<u32>, info: &Info) -> bool {
    let alive = info.readers.iter().filter(|it| it.native && it.alive);
    let attached: BTreeSet<u32> = alive.map(|reader| reader.pid).collect();
    readers.is_subset(&attached)
}

/// Opens subscribers until the topic has no reader slot left.
fn open_all(topic: &Topic) -> Vec<Subscriber> {
    let mut opened = Vec::new();
    while opened.len() <= SLOTS
        && let Ok(subscriber) = Subscriber::open(topic, &SubscriberOptions::default())
    {
        opened.push(subscriber);
    }
    opened
}

#[cfg(test)]
#[path = "../../conduit_ring/tests/support/run.rs"]
mod run;

#[cfg(test)]
mod tests {
    use conduit_ring::{Publisher, PublisherOptions};

    use super::*;
    use crate::fault;

    /// Longer than anything here takes.
    const LONG: Duration = Duration::from_secs(60);

    fn publisher() -> Publisher {
        let topic = Topic::new(&run::unique("leaks")).unwrap();
        Publisher::open(&topic, &PublisherOptions::default()).unwrap()
    }

    fn subscriber(topic: &Topic) -> Subscriber {
        Subscriber::open(topic, &SubscriberOptions::default()).unwrap()
    }

    /// The readers are this process.
    fn this_process() -> io::Result<BTreeSet<u32>> {
        Ok(BTreeSet::from([std::process::id()]))
    }

    /// Returns the process in each reader slot, which a release leaves there.
    fn claimants(topic: &Topic) -> [u32; SLOTS] {
        let bytes = std::fs::read(topic.path()).unwrap();
        let pid = |slot| std::array::from_fn(|i| bytes[192 + 64 * slot + 8 + i]);
        std::array::from_fn(|slot| u32::from_le_bytes(pid(slot)))
    }

    #[test]
    fn slots_are_not_filled_before_a_late_reader_has_its_own() {
        let publisher = publisher();
        let mut late = None;
        let mut looks = 0;
        let counted = count(publisher.topic(), LONG, || {
            looks += 1;
            if looks == 3 {
                assert_eq!(claimants(publisher.topic()), [0; SLOTS]);
                late = Some(subscriber(publisher.topic()));
            }
            this_process()
        });
        assert_eq!(counted.unwrap(), 0);
        assert!(late.is_some());
        assert_ne!(claimants(publisher.topic())[SLOTS - 1], 0, "filled at last");
    }

    #[test]
    fn a_leaked_slot_is_counted_beside_a_reader() {
        let publisher = publisher();
        let _reader = subscriber(publisher.topic());
        fault::mark_slot(publisher.topic()).unwrap();
        let counted = count(publisher.topic(), Duration::ZERO, this_process);
        assert_eq!(counted.unwrap(), 1);
    }

    #[test]
    fn a_reader_that_never_gets_a_slot_is_counted() {
        let publisher = publisher();
        let counted = count(publisher.topic(), Duration::ZERO, this_process);
        assert_eq!(counted.unwrap(), 1);
    }
}
