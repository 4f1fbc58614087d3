//! What the calls of a subscriber return.

use crate::delivery::Meta;

/// What a look at a topic gave.
///
/// Changes of the publisher come in order with the messages: [`Read::PublisherDown`] follows the
/// last message, and [`Read::PublisherUp`] comes before the first message of the next publisher.
/// A publisher that is replaced between two looks, at the same sequence number, is no change;
/// compare [`Subscriber::incarnation`](crate::Subscriber::incarnation) to notice that too.
///
/// ```
/// use conduit_ring::{Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic};
///
/// # let name = format!("doc-read-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default())?;
/// let mut buffer = Vec::new();
/// assert_eq!(subscriber.try_read(&mut buffer)?, Read::Nothing);
///
/// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// publisher.publish(b"last words").unwrap();
/// assert_eq!(subscriber.try_read(&mut buffer)?, Read::PublisherUp);
/// publisher.close();
/// assert!(matches!(subscriber.try_read(&mut buffer)?, Read::Message(_)));
/// assert_eq!(subscriber.try_read(&mut buffer)?, Read::PublisherDown);
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// A message. Its bytes are in the buffer.
    Message(Meta),
    /// Nothing new.
    Nothing,
    /// The topic has a publisher again, or for the first time.
    PublisherUp,
    /// The publisher died, closed the topic or was replaced. Every message that it had published
    /// and that was still in the ring was delivered before.
    PublisherDown,
}

/// What a look at a topic gave, with the buffer that the message was copied into.
///
/// It is [`Read`] for calls that make a buffer or a lease for each message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received<B> {
    /// A message and its bytes.
    Message(Meta, B),
    /// As [`Read::Nothing`].
    Nothing,
    /// As [`Read::PublisherUp`].
    PublisherUp,
    /// As [`Read::PublisherDown`].
    PublisherDown,
}

/// Why a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// [`Subscriber::try_read`](crate::Subscriber::try_read) has a message or a change to return.
    Ready,
    /// A [`Waker`](crate::Waker) was used.
    Woken,
    /// The time has passed.
    TimedOut,
}

/// What a subscriber has seen in its whole life, over all segments of the topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Stats {
    /// Messages delivered.
    pub delivered: u64,
    /// Messages lost.
    pub lost: u64,
    /// How many times the publisher's count was behind the reader's. It is 0 unless a peer
    /// damages the segment.
    pub resyncs: u64,
}

/// Which publisher a segment has, or had last.
///
/// Two publishers of a topic never have the same value, so that a change of it shows that a
/// publisher was replaced, however fast that went.
///
/// ```
/// use conduit_ring::{Publisher, PublisherOptions, Subscriber, SubscriberOptions, Topic};
///
/// # let name = format!("doc-incarnation-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let first = Publisher::open(&topic, &PublisherOptions::default())?;
/// let subscriber = Subscriber::open(&topic, &SubscriberOptions::default())?;
/// let before = subscriber.incarnation().expect("the topic has a segment");
/// first.abandon();
/// let _second = Publisher::open(&topic, &PublisherOptions::default())?;
/// let after = subscriber.incarnation().expect("the topic has a segment");
/// assert_eq!(after.instance_id, before.instance_id);
/// assert_eq!(after.epoch, before.epoch + 1);
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Incarnation {
    /// Random number of the sequence of messages; 0 if the segment has no extension.
    pub instance_id: u64,
    /// How many takeovers there were before this publisher, and how many times the segment was
    /// made anew.
    pub epoch: u32,
    /// The publisher's process; 0 if the segment has no extension.
    pub pid: u32,
}
