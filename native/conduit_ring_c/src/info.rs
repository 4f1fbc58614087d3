//! What there is to know about a topic.

use std::ffi::{c_char, c_int};

use conduit_ring::{ContentTag, Info, Reader, State, Topic};

use crate::failure::{Failure, answer};
use crate::geometry::conduit_ring_geometry;
use crate::pointer::{self, Out};

/// Reader slots of a topic.
pub const CONDUIT_RING_READERS: u32 = 16;

/// Values of `state`.
pub const CONDUIT_RING_STATE_UNKNOWN: u32 = 0;
/// See the header.
pub const CONDUIT_RING_STATE_LIVE: u32 = 1;
/// See the header.
pub const CONDUIT_RING_STATE_CLOSED: u32 = 2;
/// See the header.
pub const CONDUIT_RING_STATE_RETIRED: u32 = 3;
/// See the header.
pub const CONDUIT_RING_STATE_DEAD: u32 = 4;
/// See the header.
pub const CONDUIT_RING_STATE_LEGACY: u32 = 5;

/// A claimed reader slot.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct conduit_ring_reader {
    /// Number of the slot.
    pub index: u32,
    /// Its process.
    pub pid: u32,
    /// Whether it speaks the extension.
    pub is_native: bool,
    /// Whether it lives.
    pub is_alive: bool,
    /// Whether it sleeps.
    pub is_waiting: bool,
    /// What it reads next.
    pub next_sequence: u64,
    /// What it has lost.
    pub lost: u64,
}

/// What there is to know about a topic, at one moment.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_info {
    /// Number and length of its slots.
    pub geometry: conduit_ring_geometry,
    /// The longest message that fits.
    pub max_message_size_bytes: u32,
    /// How it stands.
    pub state: u32,
    /// Takeovers so far.
    pub epoch: u32,
    /// Process of the publisher.
    pub writer_pid: u32,
    /// Messages published so far.
    pub published: u64,
    /// Hash of the encoding's name.
    pub content_tag: u64,
    /// Random number of this very segment.
    pub instance_id: u64,
    /// When the last message was published.
    pub last_publish_ns: u64,
    /// What makes wall time of a time stamp.
    pub realtime_offset_ns: i64,
    /// Messages dropped because a reader held the slot.
    pub dropped_pinned: u64,
    /// Messages rejected because they were too large.
    pub rejected_oversize: u64,
    /// Times that sleepers were called.
    pub wake_count: u64,
    /// How many of `readers` are filled.
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
    answer(|| {
        // SAFETY: null or a text, by the header.
        let name = unsafe { pointer::text(topic, "topic") }?;
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(info, "info") }?;
        let info = Topic::found(name).and_then(|topic| Info::read(&topic));
        out.put((&info.map_err(Failure::from)?).into());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_content_tag(content: *const c_char) -> u64 {
    // SAFETY: null or a text, by the header.
    unsafe { tag(content) }.map_or(0, ContentTag::value)
}

/// The tag of an encoding's name; null is raw.
///
/// # Safety
/// `content` is null or a text.
pub(crate) unsafe fn tag(content: *const c_char) -> Result<ContentTag, Failure> {
    if content.is_null() {
        return Ok(ContentTag::RAW);
    }
    // SAFETY: the caller's promise is the same.
    unsafe { pointer::text(content, "content") }.map(ContentTag::of)
}
