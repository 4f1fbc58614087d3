//! A topic, inspected from outside.

use crate::attach;
use crate::claim;
use crate::content::ContentTag;
use crate::error::Error;
use crate::geometry::Geometry;
use crate::guarded::Guarded;
use crate::header::{Header, Origin};
use crate::layout::{
    DROPPED_PINNED, LAST_PUBLISH, PUBLISHER_LOCK, REALTIME_OFFSET, REJECTED_OVERSIZE, ReaderSlot,
    STATE, STATE_CLOSED, STATE_LIVE, STATE_RETIRED, SUBSCRIBER_MASK, WAITING_MASK, WAKE_COUNT,
    WRITER_EPOCH, WRITER_PID,
};
use crate::os::{Access, Segment};
use crate::pins;
use crate::source::{self, Source};
use crate::sync::Ordering::{Acquire, Relaxed};
use crate::topic::Topic;

/// The state of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum State {
    /// The publisher lives.
    Live,
    /// The publisher died. The next one takes the topic over.
    Dead,
    /// The publisher closed the topic.
    Closed,
    /// A publisher with another geometry or content replaced the segment.
    Retired,
    /// A publisher without the extension made the topic. Whether it lives is unknown.
    Legacy,
    /// The segment has a state that this version does not know.
    Unknown,
}

/// A claimed reader slot, as the segment shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Reader {
    /// Number of the reader slot, 0..16.
    pub index: u32,
    /// Whether the reader speaks the extension. If not, only `index` and `next_sequence` have a
    /// meaning.
    pub native: bool,
    /// Whether the reader lives. A native reader that does not has left its slot behind. Always
    /// `true` for others.
    pub alive: bool,
    /// Whether the reader sleeps.
    pub waiting: bool,
    /// The reader's process.
    pub pid: u32,
    /// Sequence number of the message that the reader reads next.
    pub next_sequence: u64,
    /// How many messages the reader has lost.
    pub lost: u64,
    /// How many messages the reader holds in their slots.
    pub leases: u32,
    /// The sequence numbers of these messages, the oldest first. A message that is older than the
    /// ring has slots costs the topic a number in each lap.
    pub held: Vec<u64>,
}

/// The state, the counters and the readers of a topic, at one moment.
///
/// The fields are read one after another while the topic is in use, so that they need not agree
/// with each other to the message.
///
/// ```
/// use conduit_ring::{Info, Publisher, PublisherOptions, State, Subscriber, Topic};
///
/// # let name = format!("doc-info-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// let _subscriber = Subscriber::open(&topic, &Default::default())?;
/// publisher.publish(b"12.5 degrees").unwrap();
///
/// let info = Info::read(&topic)?;
/// assert_eq!((info.state, info.published), (State::Live, 1));
/// assert_eq!(info.readers[0].pid, std::process::id());
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Info {
    /// The topic.
    pub topic: Topic,
    /// Number and length of its slots.
    pub geometry: Geometry,
    /// The state of the topic.
    pub state: State,
    /// How many messages have been published, which is the next sequence number.
    pub published: u64,
    /// The encoding of the messages.
    pub content: ContentTag,
    /// How many times a publisher took over or made the file anew.
    pub epoch: u32,
    /// Random number of this sequence of messages. It stays the same where a living publisher
    /// makes its file anew. It is 0 if the topic has no extension.
    pub instance_id: u64,
    /// The publisher's process.
    pub writer_pid: u32,
    /// When the last message was published, on the clock of
    /// [`clock::now_ns`](crate::clock::now_ns); 0 before the first message.
    pub last_publish_ns: u64,
    /// What to add to a timestamp to get wall time, as it was when the publisher started.
    pub realtime_offset_ns: i64,
    /// How many numbers were passed over because a reader held the slot, and how many messages
    /// were dropped because readers held all slots.
    pub dropped_pinned: u64,
    /// How many messages were rejected because they were too large.
    pub rejected_oversize: u64,
    /// How many times sleepers were woken.
    pub wake_count: u64,
    /// The claimed reader slots.
    pub readers: Vec<Reader>,
}

impl Info {
    /// Inspects a topic without taking part in it.
    ///
    /// The file is opened for reading only and is not mapped, so that a user who shortens it does
    /// no harm. No reader slot is taken.
    ///
    /// # Errors
    /// - [`Error::NoTopic`] when the topic does not exist.
    /// - [`Error::BadSegment`] when the file is not a ring that this version can read.
    /// - [`Error::Os`] when the operating system refuses.
    pub fn read(topic: &Topic) -> Result<Info, Error> {
        let segment = attach::open_file(topic, Access::Read)?.ok_or_else(|| Error::NoTopic {
            path: topic.path().to_owned(),
        })?;
        let header = attach::sound_header(topic, &segment)?;
        let alive = segment
            .is_locked(PUBLISHER_LOCK)
            .map_err(Error::os("lock", topic.path()))?;
        let looked = Guarded::unmapped(segment, header);
        let info = Info::collect(topic, &looked.segment, &header, &looked, alive);
        looked.check(topic).map(|()| info)
    }

    /// Reads all fields from a source. `alive` is whether the publisher's lock is taken.
    ///
    /// Relaxed, but for the state: the fields are for people, and nothing is decided by them.
    pub(crate) fn collect(
        topic: &Topic,
        segment: &Segment,
        header: &Header,
        source: &impl Source,
        alive: bool,
    ) -> Info {
        Info {
            topic: topic.clone(),
            geometry: header.geometry,
            state: state(header, source.load32(STATE, Acquire), alive),
            published: source::published(source),
            content: header.content,
            epoch: source.load32(WRITER_EPOCH, Relaxed),
            instance_id: header.instance_id(),
            writer_pid: source.load32(WRITER_PID, Relaxed),
            last_publish_ns: source.load(LAST_PUBLISH, Relaxed),
            realtime_offset_ns: source.load(REALTIME_OFFSET, Relaxed) as i64,
            dropped_pinned: source.load(DROPPED_PINNED, Relaxed),
            rejected_oversize: source.load(REJECTED_OVERSIZE, Relaxed),
            wake_count: source.load(WAKE_COUNT, Relaxed),
            readers: ReaderSlot::all()
                .filter_map(|reader_slot| reader_of(segment, source, reader_slot))
                .collect(),
        }
    }
}

fn state(header: &Header, state: u32, alive: bool) -> State {
    match (header.origin, state) {
        (Origin::Legacy, _) => State::Legacy,
        (_, STATE_LIVE) if alive => State::Live,
        (_, STATE_LIVE) => State::Dead,
        (_, STATE_CLOSED) => State::Closed,
        (_, STATE_RETIRED) => State::Retired,
        _ => State::Unknown,
    }
}

/// Relaxed: for people, as all of an Info.
fn reader_of(segment: &Segment, source: &impl Source, reader_slot: ReaderSlot) -> Option<Reader> {
    let has = |mask| source.load32(mask, Relaxed) & reader_slot.bit() != 0;
    if !has(SUBSCRIBER_MASK) {
        return None;
    }
    let native = claim::is_native_claim(source, reader_slot);
    let held = pins::held(source, reader_slot);
    Some(Reader {
        index: reader_slot.index(),
        native,
        alive: !native || segment.is_locked(reader_slot.lock()).unwrap_or(true),
        waiting: has(WAITING_MASK),
        pid: source.load32(reader_slot.pid(), Relaxed),
        next_sequence: source.load(reader_slot.read_idx(), Relaxed),
        lost: source.load(reader_slot.lost_count(), Relaxed),
        leases: held.len() as u32,
        held,
    })
}
