//! A reader that takes no part in a topic.

use std::fmt;
use std::time::{Duration, Instant};

use crate::backing::Role;
use crate::content::ContentTag;
use crate::error::Error;
use crate::geometry::Geometry;
use crate::options::{ObserverOptions, SubscriberOptions};
use crate::outcome::{Incarnation, Read, Stats, Wait};
use crate::subscriber::Subscriber;
use crate::topic::Topic;

/// The sleep after a message. Each further one is twice as long, up to the longest.
const SHORTEST_NAP: Duration = Duration::from_micros(100);

/// A reader without a trace, for tools and recorders.
///
/// An observer reads a topic as a [`Subscriber`] does: with the same validation, and through the
/// lives of its publishers. But its mapping is read-only, and it takes no reader slot. So there
/// may be any number of observers, they need no permission but to read, and a publisher spends
/// nothing on them.
///
/// # When a message is noticed
///
/// A publisher wakes sleepers only if it knows of one, and an observer cannot say that it sleeps.
/// A message wakes it at once when some subscriber waits too, or when the publisher is a legacy
/// one. Otherwise the observer looks by itself: 0.1 ms after a message, and then in naps that
/// double up to [`ObserverOptions::longest_nap`].
///
/// ```
/// use std::time::Duration;
/// use conduit_ring::{Observer, ObserverOptions, Publisher, PublisherOptions, Read, Topic};
///
/// # let name = format!("doc-observer-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// let mut observer = Observer::open(&topic, &ObserverOptions::default())?;
/// publisher.publish(b"12.5 degrees").unwrap();
///
/// let mut buffer = Vec::new();
/// let read = observer.read_timeout(&mut buffer, Duration::from_secs(1))?;
/// assert!(matches!(read, Read::Message(_)));
/// assert_eq!(buffer, b"12.5 degrees");
/// assert_eq!(publisher.info().readers, []);
/// # Ok::<(), conduit_ring::Error>(())
/// ```
pub struct Observer {
    subscriber: Subscriber,
    nap: Duration,
    longest_nap: Duration,
}

impl Observer {
    /// Starts to watch a topic, which need not exist yet.
    ///
    /// # Errors
    /// - [`Error::BadSegment`] when the file is not a ring that this version can read.
    /// - [`Error::InvalidTrust`] when the list of trusted users is invalid.
    /// - [`Error::Os`] when the operating system refuses.
    pub fn open(topic: &Topic, options: &ObserverOptions) -> Result<Observer, Error> {
        let reading = SubscriberOptions {
            start: options.start,
            policy: options.policy,
            guard: options.guard,
        };
        Ok(Observer {
            subscriber: Subscriber::open_as(Role::Observer, topic, &reading)?,
            nap: SHORTEST_NAP.min(options.longest_nap),
            longest_nap: options.longest_nap,
        })
    }

    /// Takes the next message, if there is one, into `buffer`, whose content it replaces. Never
    /// waits.
    ///
    /// # Errors
    /// As [`Subscriber::try_read`].
    pub fn try_read(&mut self, buffer: &mut Vec<u8>) -> Result<Read, Error> {
        let read = self.subscriber.try_read(buffer)?;
        if read != Read::Nothing {
            self.nap = SHORTEST_NAP.min(self.longest_nap);
        }
        Ok(read)
    }

    /// Waits for the next message or change of the publisher and takes it.
    ///
    /// Returns [`Read::Nothing`] when `timeout` has passed.
    ///
    /// # Errors
    /// As [`Observer::try_read`].
    pub fn read_timeout(
        &mut self,
        buffer: &mut Vec<u8>,
        timeout: Duration,
    ) -> Result<Read, Error> {
        let deadline = Instant::now().checked_add(timeout);
        loop {
            let read = self.try_read(buffer)?;
            if read != Read::Nothing {
                return Ok(read);
            }
            let left = deadline.map_or(Duration::MAX, |deadline| {
                deadline.saturating_duration_since(Instant::now())
            });
            if left.is_zero() {
                return Ok(Read::Nothing);
            }
            self.wait(left)?;
        }
    }

    /// Sleeps for a nap at most. Without a publisher it sleeps longer: a new one wakes all
    /// sleepers.
    fn wait(&mut self, left: Duration) -> Result<(), Error> {
        if !self.subscriber.publisher_up() {
            return self.subscriber.wait(left).map(drop);
        }
        if self.subscriber.wait(self.nap.min(left))? == Wait::TimedOut {
            self.nap = self.nap.saturating_mul(2).min(self.longest_nap);
        }
        Ok(())
    }

    /// Returns the topic.
    pub fn topic(&self) -> &Topic {
        self.subscriber.topic()
    }

    /// Returns whether the topic had a live publisher when it was last checked.
    pub fn publisher_up(&self) -> bool {
        self.subscriber.publisher_up()
    }

    /// Returns which publisher the segment has, or had last. Returns `None` while the topic has
    /// no segment.
    pub fn incarnation(&self) -> Option<Incarnation> {
        self.subscriber.incarnation()
    }

    /// Returns number and length of the slots, or `None` while the topic has no segment.
    pub fn geometry(&self) -> Option<Geometry> {
        self.subscriber.geometry()
    }

    /// Returns the encoding of the messages, or `None` while the topic has no segment.
    pub fn content(&self) -> Option<ContentTag> {
        self.subscriber.content()
    }

    /// Returns the counts of this observer's whole life.
    pub fn stats(&self) -> Stats {
        self.subscriber.stats()
    }
}

impl fmt::Debug for Observer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Observer")
            .field("topic", &self.topic().name())
            .field("publisher_up", &self.publisher_up())
            .field("stats", &self.stats())
            .finish_non_exhaustive()
    }
}
