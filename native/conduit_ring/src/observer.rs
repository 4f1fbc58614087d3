//! One who watches a topic without taking part in it.

use std::fmt;
use std::time::{Duration, Instant};

use crate::attachment::Incarnation;
use crate::backing::Role;
use crate::content::ContentTag;
use crate::error::Error;
use crate::geometry::Geometry;
use crate::options::{ObserverOptions, SubscriberOptions};
use crate::outcome::{Read, Stats, Wait};
use crate::subscriber::Subscriber;
use crate::topic::Topic;

/// The sleep after a message; it doubles until the next one, or until the longest.
const SHORTEST_NAP: Duration = Duration::from_micros(100);

/// Reads a topic as a [`Subscriber`](crate::Subscriber) does, with the same validation and across deaths of publishers,
/// but without a trace: through a read-only mapping, without a reader slot. There may be any number of observers, they
/// need no permission but to read, and a publisher spends nothing on them. For tools and recorders.
///
/// The price: a publisher wakes those who sleep only if it knows of one. An observer cannot say that it sleeps, so a
/// message wakes it at once when some subscriber waits too, or when the publisher is a legacy one; otherwise it looks
/// by itself, 0.1 ms after a message and then in naps that double up to [`ObserverOptions::longest_nap`].
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
    /// Begins to watch a topic, which need not exist yet.
    ///
    /// # Errors
    /// [`Error::BadSegment`]; [`Error::Os`].
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

    /// As [`Subscriber::try_read`](crate::Subscriber::try_read).
    ///
    /// # Errors
    /// As there.
    pub fn try_read(&mut self, buffer: &mut Vec<u8>) -> Result<Read, Error> {
        let read = self.subscriber.try_read(buffer)?;
        if read != Read::Nothing {
            self.nap = SHORTEST_NAP.min(self.longest_nap);
        }
        Ok(read)
    }

    /// Waits for the next message or change of the publisher and takes it. [`Read::Nothing`] when the time is up.
    ///
    /// # Errors
    /// As [`Observer::try_read`].
    pub fn read_timeout(&mut self, buffer: &mut Vec<u8>, timeout: Duration) -> Result<Read, Error> {
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

    /// Sleeps for a nap at most; without a publisher longer, since a new one wakes everybody.
    fn wait(&mut self, left: Duration) -> Result<(), Error> {
        if !self.subscriber.publisher_up() {
            return self.subscriber.wait(left).map(drop);
        }
        if self.subscriber.wait(self.nap.min(left))? == Wait::TimedOut {
            self.nap = self.nap.saturating_mul(2).min(self.longest_nap);
        }
        Ok(())
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        self.subscriber.topic()
    }

    /// Whether the topic had a live publisher when last looked at.
    pub fn publisher_up(&self) -> bool {
        self.subscriber.publisher_up()
    }

    /// Which publisher the segment has, or had last, once there is one.
    pub fn incarnation(&self) -> Option<Incarnation> {
        self.subscriber.incarnation()
    }

    /// Number and length of the slots, once there is a segment.
    pub fn geometry(&self) -> Option<Geometry> {
        self.subscriber.geometry()
    }

    /// The encoding of the messages, once there is a segment.
    pub fn content(&self) -> Option<ContentTag> {
        self.subscriber.content()
    }

    /// Counts of this observer's whole life.
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
