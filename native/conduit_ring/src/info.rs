//! A look at a topic from outside.

use crate::attach::{self, Attached};
use crate::claim;
use crate::content::ContentTag;
use crate::error::Error;
use crate::geometry::Geometry;
use crate::header::Origin;
use crate::layout::{
    DROPPED_PINNED, LAST_PUBLISH, REALTIME_OFFSET, REJECTED_OVERSIZE, ReaderLine, STATE,
    STATE_CLOSED, STATE_LIVE, STATE_RETIRED, SUBSCRIBER_MASK, WAITING_MASK, WAKE_COUNT,
    WRITER_EPOCH, WRITER_PID,
};
use crate::memory::Memory;
use crate::pins;
use crate::reader;
use crate::segment::Access;
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
    /// Random number of this very segment; 0 if it has no extension.
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
    /// Looks at a topic without taking part: it is opened for reading only and takes no reader slot.
    ///
    /// # Errors
    /// [`Error::NoTopic`], [`Error::BadSegment`], [`Error::Os`].
    pub fn read(topic: &Topic) -> Result<Info, Error> {
        let attached = attach::attach(topic, Access::Read)?.ok_or_else(|| Error::NoTopic {
            path: topic.path().to_owned(),
        })?;
        let alive = attached
            .has_live_publisher()
            .map_err(Error::os("lock", topic.path()))?;
        Ok(Info::collect(topic, &attached, alive))
    }

    pub(crate) fn collect(topic: &Topic, attached: &Attached, alive: bool) -> Info {
        let memory = &*attached.memory;
        Info {
            topic: topic.clone(),
            geometry: attached.header.geometry,
            state: state(attached, alive),
            published: reader::published(memory),
            content: attached.header.content,
            epoch: memory.u32(WRITER_EPOCH).load(Relaxed),
            instance_id: match attached.header.origin {
                Origin::Native { instance_id } => instance_id,
                Origin::Legacy => 0,
            },
            writer_pid: memory.u32(WRITER_PID).load(Relaxed),
            last_publish_ns: memory.u64(LAST_PUBLISH).load(Relaxed),
            realtime_offset_ns: memory.u64(REALTIME_OFFSET).load(Relaxed) as i64,
            dropped_pinned: memory.u64(DROPPED_PINNED).load(Relaxed),
            rejected_oversize: memory.u64(REJECTED_OVERSIZE).load(Relaxed),
            wake_count: memory.u64(WAKE_COUNT).load(Relaxed),
            readers: ReaderLine::all()
                .filter_map(|line| reader_of(attached, line))
                .collect(),
        }
    }
}

fn state(attached: &Attached, alive: bool) -> State {
    match (
        attached.header.origin,
        attached.memory.u32(STATE).load(Acquire),
    ) {
        (Origin::Legacy, _) => State::Legacy,
        (_, STATE_LIVE) if alive => State::Live,
        (_, STATE_LIVE) => State::Dead,
        (_, STATE_CLOSED) => State::Closed,
        (_, STATE_RETIRED) => State::Retired,
        _ => State::Unknown,
    }
}

fn reader_of(attached: &Attached, line: ReaderLine) -> Option<Reader> {
    let memory: &Memory = &attached.memory;
    let has = |mask| memory.u32(mask).load(Relaxed) & line.bit() != 0;
    let native = claim::is_native_claim(memory, line);
    let held = pins::held(memory, line);
    has(SUBSCRIBER_MASK).then(|| Reader {
        index: line.index(),
        native,
        alive: !native || attached.segment.is_locked(line.lock()).unwrap_or(true),
        waiting: has(WAITING_MASK),
        pid: memory.u32(line.pid()).load(Relaxed),
        next_sequence: memory.u64(line.read_idx()).load(Relaxed),
        lost: memory.u64(line.lost_count()).load(Relaxed),
        leases: held.len() as u32,
        held,
    })
}
