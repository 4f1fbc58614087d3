//! The state of a topic.

use std::ffi::{c_char, c_int};

use conduit_ring::{ContentTag, Info, Reader, State, Topic};

use crate::failure::{Failure, status};
use crate::geometry::conduit_ring_geometry;
use crate::pointer::{self, Out};

/// The number of reader slots.
pub const CONDUIT_RING_READERS: u32 = 16;

/// `state`: the file contains an unknown state.
pub const CONDUIT_RING_STATE_UNKNOWN: u32 = 0;
/// `state`: the publisher is alive.
pub const CONDUIT_RING_STATE_LIVE: u32 = 1;
/// `state`: the publisher has closed the topic.
pub const CONDUIT_RING_STATE_CLOSED: u32 = 2;
/// `state`: a topic of another geometry has replaced this one.
pub const CONDUIT_RING_STATE_RETIRED: u32 = 3;
/// `state`: the publisher died; the next one takes over.
pub const CONDUIT_RING_STATE_DEAD: u32 = 4;
/// `state`: from a publisher without the extension, which may be alive or dead.
pub const CONDUIT_RING_STATE_LEGACY: u32 = 5;

/// A claimed reader slot.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct conduit_ring_reader {
    /// The slot's index.
    pub index: u32,
    /// The reader's process.
    pub pid: u32,
    /// Whether it uses the extension.
    pub is_native: bool,
    /// Whether it is a native reader that is alive.
    pub is_alive: bool,
    /// Whether it sleeps until a message arrives.
    pub is_waiting: bool,
    /// The next sequence number that it reads.
    pub next_sequence: u64,
    /// The number of messages that it lost.
    pub lost: u64,
}

/// The state of a topic at one time.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_info {
    /// Number and size of the slots.
    pub geometry: conduit_ring_geometry,
    /// The longest message that fits into a slot.
    pub max_message_size_bytes: u32,
    /// One of the `CONDUIT_RING_STATE_` constants.
    pub state: u32,
    /// Number of takeovers.
    pub epoch: u32,
    /// The publisher's process.
    pub writer_pid: u32,
    /// Number of published messages.
    pub published: u64,
    /// Hash of the encoding's name.
    pub content_tag: u64,
    /// Random number of this file.
    pub instance_id: u64,
    /// Time of the last message.
    pub last_publish_ns: u64,
    /// Difference to wall time at the publisher's start.
    pub realtime_offset_ns: i64,
    /// Skipped numbers and dropped messages due to held slots.
    pub dropped_pinned: u64,
    /// Messages that were too large.
    pub rejected_oversize: u64,
    /// How often the publisher woke sleeping readers.
    pub wake_count: u64,
    /// Number of valid entries in `readers`.
    pub reader_count: u32,
    /// The claimed reader slots.
    pub readers: [conduit_ring_reader; 16],
}

impl From<&Reader> for conduit_ring_reader {
    fn from(reader: &Reader) -> Self {
        conduit_ring_reader {
            index: reader.index,
            pid: reader.pid,
            is_native: reader.native,
            is_alive: reader.alive,
            is_waiting: reader.waiting,
            next_sequence: reader.next_sequence,
            lost: reader.lost,
        }
    }
}

impl From<&Info> for conduit_ring_info {
    fn from(info: &Info) -> Self {
        let mut readers = [conduit_ring_reader::default(); CONDUIT_RING_READERS as usize];
        let filled = readers.iter_mut().zip(&info.readers);
        let reader_count = filled.map(|(to, from)| *to = from.into()).count();
        conduit_ring_info {
            geometry: info.geometry.into(),
            max_message_size_bytes: info.geometry.max_message_size() as u32,
            state: state(info.state),
            epoch: info.epoch,
            writer_pid: info.writer_pid,
            published: info.published,
            content_tag: info.content.value(),
            instance_id: info.instance_id,
            last_publish_ns: info.last_publish_ns,
            realtime_offset_ns: info.realtime_offset_ns,
            dropped_pinned: info.dropped_pinned,
            rejected_oversize: info.rejected_oversize,
            wake_count: info.wake_count,
            reader_count: reader_count as u32,
            readers,
        }
    }
}

fn state(state: State) -> u32 {
    match state {
        State::Live => CONDUIT_RING_STATE_LIVE,
        State::Closed => CONDUIT_RING_STATE_CLOSED,
        State::Retired => CONDUIT_RING_STATE_RETIRED,
        State::Dead => CONDUIT_RING_STATE_DEAD,
        State::Legacy => CONDUIT_RING_STATE_LEGACY,
        _ => CONDUIT_RING_STATE_UNKNOWN,
    }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_topic_info(
    topic: *const c_char,
    info: *mut conduit_ring_info,
) -> c_int {
    status(|| {
        // SAFETY: null or a NUL-terminated text, as the header demands.
        let name = unsafe { pointer::text(topic, "topic") }?;
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(info, "info") }?;
        let info = Topic::found(name).and_then(|topic| Info::read(&topic));
        out.put((&info.map_err(Failure::from)?).into());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_content_tag(content: *const c_char) -> u64 {
    // SAFETY: null or a NUL-terminated text, as the header demands.
    unsafe { tag(content) }.map_or(0, ContentTag::value)
}

/// Returns the tag of an encoding's name; null is raw.
///
/// # Safety
/// `content` is null or points to a NUL-terminated text.
pub(crate) unsafe fn tag(content: *const c_char) -> Result<ContentTag, Failure> {
    if content.is_null() {
        return Ok(ContentTag::RAW);
    }
    // SAFETY: the caller guarantees the same.
    unsafe { pointer::text(content, "content") }.map(ContentTag::of)
}
