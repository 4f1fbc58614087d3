//! One reader of a topic.

use std::fmt;
use std::time::{Duration, Instant};

use crate::attachment::Attachment;
use crate::backing::Role;
use crate::content::ContentTag;
use crate::delivery::Policy;
use crate::error::Error;
use crate::geometry::Geometry;
use crate::lease::Lease;
use crate::options::SubscriberOptions;
use crate::outcome::{Incarnation, Read, Received, Stats, Wait};
use crate::sink::{IntoNew, IntoVec};
use crate::subscription::{Change, Step, Subscription};
use crate::topic::Topic;
use crate::waker::Waker;

/// One reader of a topic, in a reader slot of its own.
///
/// A subscriber copies messages out at its own pace. It outlives publishers: it reports when one
/// dies ([`Read::PublisherDown`]) and when the next one comes ([`Read::PublisherUp`]), and
/// attaches to the topic's next segment by itself. The [crate's front page](crate) draws its
/// states.
///
/// | call | the message | waits |
/// |---|---|---|
/// | [`try_read`](Subscriber::try_read) | is copied into a vector that is used again | no |
/// | [`read_timeout`](Subscriber::read_timeout) | is copied into a vector that is used again | yes |
/// | [`try_read_with`](Subscriber::try_read_with) | is copied into a buffer made for it | no |
/// | [`try_lease`](Subscriber::try_lease) | stays in its slot | no |
/// | [`wait`](Subscriber::wait) | | yes |
///
/// ```
/// use std::time::Duration;
/// use conduit_ring::{Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic};
///
/// # let name = format!("doc-subscriber-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default())?;
/// for n in 0..20_u8 {
///     publisher.publish(&[n]).unwrap();
/// }
///
/// // The ring has 16 slots: the four oldest messages are lost, and the first one says so.
/// let mut buffer = Vec::new();
/// let mut messages = Vec::new();
/// while let Read::Message(meta) = subscriber.try_read(&mut buffer)? {
///     messages.push((meta.sequence, meta.lost, buffer[0]));
/// }
/// assert_eq!(messages.len(), 16);
/// assert_eq!(messages[..2], [(4, 4, 4), (5, 0, 5)]);
/// assert_eq!(subscriber.stats().lost, 4);
/// # Ok::<(), conduit_ring::Error>(())
/// ```
pub struct Subscriber {
    subscription: Subscription,
}

impl Subscriber {
    /// Subscribes to a topic, which need not exist yet.
    ///
    /// # Errors
    /// - [`Error::NoReaderSlot`] for the 17th subscriber.
    /// - [`Error::BadSegment`] when the file is not a ring that this version can read.
    /// - [`Error::InvalidTrust`] when the list of trusted users is invalid.
    /// - [`Error::Os`] when the operating system refuses.
    pub fn open(topic: &Topic, options: &SubscriberOptions) -> Result<Subscriber, Error> {
        Subscriber::open_as(Role::Reader, topic, options)
    }

    pub(crate) fn open_as(
        role: Role,
        topic: &Topic,
        options: &SubscriberOptions,
    ) -> Result<Subscriber, Error> {
        Ok(Subscriber {
            subscription: Subscription::open(role, topic, options)?,
        })
    }

    /// Takes the next message, if there is one, into `buffer`, whose content it replaces.
    ///
    /// Never waits. Calls the operating system only when there is no message: at most twice a
    /// second while the publisher lives, to check that it does, and in each call while none
    /// lives, to look for one.
    ///
    /// # Errors
    /// - [`Error::Forked`] in a child of the process that opened the subscriber.
    /// - [`Error::BadSegment`] when the file of a [guarded](crate::Guard) topic was shortened.
    /// - As [`Subscriber::open`], when the topic has a new segment and attaching to it fails.
    ///
    /// The subscriber stays usable, and the next call tries again.
    #[inline]
    pub fn try_read(&mut self, buffer: &mut Vec<u8>) -> Result<Read, Error> {
        let mut sink = IntoVec::new(buffer);
        let next = |it: &mut Attachment, topic: &Topic, policy| it.next(topic, policy, &mut sink);
        Ok(match self.subscription.step(next)? {
            Step::Message(meta) => {
                // SAFETY: the sink gave room for `len` bytes, and all of them were copied there.
                unsafe { sink.finish(meta.len) };
                Read::Message(meta)
            }
            Step::Change(Change::Up) => Read::PublisherUp,
            Step::Change(Change::Down) => Read::PublisherDown,
            Step::Nothing => Read::Nothing,
        })
    }

    /// Takes the next message, if there is one, into a buffer that `alloc` makes for its length.
    ///
    /// For buffers that must be made by a runtime, such as a binary of the BEAM. `alloc` may be
    /// called more than once for one message, when the publisher overtakes the copy. Never waits.
    ///
    /// ```
    /// use conduit_ring::{Publisher, PublisherOptions, Received, Subscriber, Topic};
    ///
    /// # let name = format!("doc-with-{}", std::process::id());
    /// let topic = Topic::new(&name)?;
    /// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
    /// let mut subscriber = Subscriber::open(&topic, &Default::default())?;
    /// publisher.publish(b"12.5 degrees").unwrap();
    /// let received = subscriber.try_read_with(|len| vec![0; len].into_boxed_slice())?;
    /// assert!(matches!(received, Received::Message(_, bytes) if *bytes == *b"12.5 degrees"));
    /// # Ok::<(), conduit_ring::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Subscriber::try_read`].
    ///
    /// # Panics
    /// Panics if `alloc` makes a buffer of another length than it was asked for.
    #[inline]
    pub fn try_read_with<B: AsMut<[u8]>>(
        &mut self,
        alloc: impl FnMut(usize) -> B,
    ) -> Result<Received<B>, Error> {
        let mut sink = IntoNew::new(alloc);
        let next = |it: &mut Attachment, topic: &Topic, policy| it.next(topic, policy, &mut sink);
        let step = self.subscription.step(next)?;
        Ok(match (step, sink.into_buffer()) {
            (Step::Message(meta), Some(buffer)) => Received::Message(meta, buffer),
            (Step::Change(Change::Up), _) => Received::PublisherUp,
            (Step::Change(Change::Down), _) => Received::PublisherDown,
            _ => Received::Nothing,
        })
    }

    /// Takes the next message, if there is one, without copying it: see [`Lease`]. Never waits.
    ///
    /// # Errors
    /// - [`Error::TooManyLeases`] when this subscriber has three leases. The message is kept for
    ///   the next call.
    /// - [`Error::Os`] when the message cannot be mapped.
    /// - As [`Subscriber::try_read`].
    pub fn try_lease(&mut self) -> Result<Received<Lease>, Error> {
        Ok(match self.subscription.step(Attachment::lease)? {
            Step::Message(lease) => Received::Message(lease.meta(), lease),
            Step::Change(Change::Up) => Received::PublisherUp,
            Step::Change(Change::Down) => Received::PublisherDown,
            Step::Nothing => Received::Nothing,
        })
    }

    /// Sleeps until [`Subscriber::try_read`] has a message or a change to return, a [`Waker`] is
    /// used or `timeout` has passed.
    ///
    /// The thread sleeps in the kernel and is woken by the next message. It wakes at least twice
    /// a second, to check that the publisher lives.
    ///
    /// # Errors
    /// As [`Subscriber::try_read`].
    pub fn wait(&mut self, timeout: Duration) -> Result<Wait, Error> {
        self.subscription.wait(timeout)
    }

    /// Waits for the next message or change of the publisher and takes it.
    ///
    /// Returns [`Read::Nothing`] when `timeout` has passed or a [`Waker`] was used.
    ///
    /// # Errors
    /// As [`Subscriber::try_read`].
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
            if self.wait(left)? != Wait::Ready {
                return Ok(Read::Nothing);
            }
        }
    }

    /// Sets which messages to get from now on after falling behind.
    pub fn set_policy(&mut self, policy: Policy) {
        self.subscription.options.policy = policy;
    }

    /// Returns a handle with which another thread can wake this subscriber.
    pub fn waker(&self) -> Waker {
        self.subscription.waker().clone()
    }

    /// Returns the topic.
    pub fn topic(&self) -> &Topic {
        self.subscription.topic()
    }

    /// Returns whether the topic had a live publisher when it was last checked.
    pub fn publisher_up(&self) -> bool {
        self.subscription.publisher_up()
    }

    /// Returns number and length of the slots, or `None` while the topic has no segment.
    pub fn geometry(&self) -> Option<Geometry> {
        self.subscription
            .attachment()
            .map(|attachment| attachment.header().geometry)
    }

    /// Returns the encoding of the messages, or `None` while the topic has no segment.
    pub fn content(&self) -> Option<ContentTag> {
        self.subscription
            .attachment()
            .map(|attachment| attachment.header().content)
    }

    /// Returns the counts of this subscriber's whole life.
    pub fn stats(&self) -> Stats {
        self.subscription.stats()
    }

    /// Returns which publisher the segment has, or had last. Returns `None` while the topic has
    /// no segment.
    pub fn incarnation(&self) -> Option<Incarnation> {
        self.subscription.attachment().map(Attachment::incarnation)
    }
}

impl fmt::Debug for Subscriber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Subscriber")
            .field("topic", &self.topic().name())
            .field("publisher_up", &self.publisher_up())
            .field("stats", &self.stats())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::PublisherOptions;
    use crate::publisher::Publisher;
    use crate::scratch::Scratch;

    /// What happens between a look for messages that finds none and a look at the publisher.
    #[test]
    fn messages_published_between_two_checks_come_before_the_end_of_the_publisher() {
        let ends: [fn(Publisher); 2] = [Publisher::close, Publisher::abandon];
        for end in ends {
            let topic = Scratch::new();
            let mut publisher = Publisher::open(&topic, &PublisherOptions::default()).unwrap();
            let mut subscriber = Subscriber::open(&topic, &Default::default()).unwrap();
            let mut buffer = Vec::new();
            assert_eq!(subscriber.try_read(&mut buffer).unwrap(), Read::Nothing);
            publisher.publish(b"last").unwrap();
            publisher.publish(b"words").unwrap();
            end(publisher);
            subscriber.subscription.check_publisher().unwrap();
            for word in [b"last".as_slice(), b"words"] {
                let read = subscriber.try_read(&mut buffer).unwrap();
                assert!(matches!(read, Read::Message(_)), "{read:?}");
                assert_eq!(buffer, word);
            }
            subscriber.subscription.check_publisher().unwrap();
            let read = subscriber.try_read(&mut buffer).unwrap();
            assert_eq!(read, Read::PublisherDown);
        }
    }
}
