//! A look at a topic from outside.

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

/// How a topic stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum State {
    /// Its publisher lives.
    Live,
    /// Its publisher died; the next one takes over.
    Dead,
    /// Its publisher closed it.
    Closed,
    /// It was replaced by one of another geometry.
    Retired,
    /// It was made by a publisher without the extension, of whose life nothing is known.
    Legacy,
    /// It says something that it should not.
    Unknown,
}

/// A claimed reader slot.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Reader {
    /// Number of the slot, 0..16.
    pub index: u32,
    /// Whether it speaks the extension; if not, only index and `next_sequence` mean something.
    pub native: bool,
    /// Whether it lives: a native reader that does not leaked its slot. Always `true` for others.
    pub alive: bool,
    /// Whether it sleeps.
    pub waiting: bool,
    /// Its process.
    pub pid: u32,
    /// Sequence number of the message that it reads next.
    pub next_sequence: u64,
    /// Messages it has lost.
    pub lost: u64,
    /// Messages it holds in their slots.
    pub leases: u32,
    /// Their sequence numbers, the oldest first. One that is older than the ring has slots costs the topic a number a lap.
    pub held: Vec<u64>,
}

/// What there is to know about a topic, at one moment.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Info {
    /// The topic.
    pub topic: Topic,
    /// Number and length of its slots.
    pub geometry: Geometry,
    /// How it stands.
    pub state: State,
    /// Messages published so far, which is the next sequence number.
    pub published: u64,
    /// The encoding of its messages.
    pub content: ContentTag,
    /// Takeovers so far.
    pub epoch: u32,
    /// Random number of this sequence of messages, which goes on where a living publisher makes its file anew; 0 if it has no
    /// extension.
    pub instance_id: u64,
    /// Process of the publisher.
    pub writer_pid: u32,
    /// When the last message was published, on [`clock::now_ns`](crate::clock::now_ns)'s clock; 0 before the first.
    pub last_publish_ns: u64,
    /// What to add to a time stamp to get wall time, as of the publisher's start.
    pub realtime_offset_ns: i64,
    /// Numbers passed over because a reader held the slot, and messages dropped because readers held all slots.
    pub dropped_pinned: u64,
    /// Messages rejected because they were too large.
    pub rejected_oversize: u64,
    /// Times that sleepers were called.
    pub wake_count: u64,
    /// The claimed reader slots.
    pub readers: Vec<Reader>,
}

impl Info {
    /// Looks at a topic without taking part: it is opened for reading only, takes no reader slot, and is not mapped, so that
    /// nobody who shortens it does harm.
    ///
    /// # Errors
    /// [`Error::NoTopic`], [`Error::BadSegment`], [`Error::Os`].
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
