//! Which messages a reader gets, and what each of them carries besides its bytes.

/// Which messages a subscriber begins with.
///
/// It counts for a topic that exists when the subscriber opens. A topic that appears later is
/// read from its first message, and a topic that comes back is read from where the subscriber
/// stopped, or from the start of its new life.
///
/// ```
/// use conduit_ring::{Publisher, PublisherOptions, Read, Start, Subscriber, Topic};
/// use conduit_ring::SubscriberOptions;
///
/// # let name = format!("doc-start-{}", std::process::id());
/// # let topic = Topic::new(&name)?;
/// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// for message in [b"0", b"1", b"2"] {
///     publisher.publish(message).unwrap();
/// }
/// let first = |start| -> Result<Read, conduit_ring::Error> {
///     let options = SubscriberOptions { start, ..Default::default() };
///     Subscriber::open(&topic, &options)?.try_read(&mut Vec::new())
/// };
/// assert_eq!(first(Start::New)?, Read::Nothing);
/// assert!(matches!(first(Start::Latest)?, Read::Message(meta) if meta.sequence == 2));
/// assert!(matches!(first(Start::History(2))?, Read::Message(meta) if meta.sequence == 1));
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// The messages that are published from now on.
    #[default]
    New,
    /// The newest message of the ring, then new ones.
    Latest,
    /// The last `k` messages that are still in the ring, then new ones.
    ///
    /// A ring holds at most `slot_count` messages, however large `k` is.
    History(u32),
}

/// Which messages a subscriber gets when it has fallen behind.
///
/// [`Subscriber::set_policy`](crate::Subscriber::set_policy) changes the policy while the
/// subscriber runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// Every message that is still in the ring, in order. For recorders and filters.
    #[default]
    All,
    /// Only the newest message. The messages that it skips count as lost. For control loops and
    /// displays, to which an old sample is worth nothing.
    Latest,
}

/// What a message carries besides its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Meta {
    /// The sequence number. The messages of a segment count from 0.
    pub sequence: u64,
    /// When the message was published, on the clock of
    /// [`clock::now_ns`](crate::clock::now_ns).
    pub timestamp_ns: u64,
    /// The length in bytes.
    pub len: usize,
    /// How many messages this reader lost between the message delivered before and this one.
    ///
    /// Within one segment it is the gap in `sequence`. A reader that follows a topic into a new
    /// segment carries over the losses that it has not reported.
    pub lost: u64,
}
