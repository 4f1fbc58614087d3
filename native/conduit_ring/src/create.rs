//! Making a segment: complete and locked before it has a name, so that no process opens a
//! half-made file.
//!
//! ```text
//! O_TMPFILE ─► chmod, chown ─► allocate ─► header ─► lock byte 64 ─► map ─► magic ─► linkat
//!  no name                      ENOSPC                                              the name
//! ```
//!
//! A crash before `linkat` leaves nothing: the kernel removes a file that has no name.

use std::io;

use crate::attach::{self, Attached};
use crate::claim;
use crate::clock;
use crate::error::Error;
use crate::header::{Header, Origin};
use crate::layout::{
    EXT_MAGIC, HEADER_LEN, MAGIC, PUBLISHER_LOCK, REALTIME_OFFSET, WRITER_PID, WRITER_START,
};
use crate::memory::Memory;
use crate::options::PublisherOptions;
use crate::os::{self, Access, Segment};
use crate::sync::Ordering::{Relaxed, Release};
use crate::topic::{Topic, directory};

/// Makes a segment for a topic that has none. Returns `None` when another publisher took the name
/// meanwhile.
pub(crate) fn create(
    topic: &Topic,
    options: &PublisherOptions,
) -> Result<Option<Attached>, Error> {
    let instance_id = os::random_id().map_err(Error::os("getrandom", topic.path()))?;
    let header = Header {
        geometry: options.geometry,
        content: options.content,
        origin: Origin::Native { instance_id },
    };
    build(topic, header, (options.mode, options.group), |_, _| Ok(()))
}

/// Makes a segment and gives it the topic's name. `fill` adds what the segment holds from the
/// start. Returns `None` when another publisher took the name meanwhile.
pub(crate) fn build(
    topic: &Topic,
    header: Header,
    (mode, group): (u32, Option<u32>),
    fill: impl FnOnce(&Segment, &Memory) -> io::Result<()>,
) -> Result<Option<Attached>, Error> {
    let path = topic.path();
    let len = header.geometry.segment_len();
    let segment =
        Segment::create(directory(), len, mode, group).map_err(Error::os("create", path))?;
    segment
        .write_head(&header.encode())
        .map_err(Error::os("write", path))?;
    lock_publisher(topic, &segment)?;
    let attached = attach::map(topic, segment, header, Access::Write, false)?;
    claim::prepare(&attached.memory);
    write_identity(&attached.memory);
    fill(&attached.segment, &attached.memory).map_err(Error::os("fill", path))?;
    // Release: pairs with the Acquire of a peer that finds the magic by a mapping. Readers of
    // this crate find it by the file's name, which comes later.
    attached.memory.u32(MAGIC).store(EXT_MAGIC, Release);
    match attached.segment.link(path) {
        Ok(()) => Ok(Some(map_by_name(topic, attached))),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Ok(None),
        Err(e) => Err(Error::os("link", path)(e)),
    }
}

/// Maps a new segment again by its name, so that `/proc/PID/maps` shows the name, for people and
/// for `processes`. The kernel shows the first mapping without one for ever.
fn map_by_name(topic: &Topic, attached: Attached) -> Attached {
    let is_same = |named: &Segment| attached.segment.is_same(named).unwrap_or(false);
    let named = match Segment::open(topic.path(), Access::Write) {
        Ok(named) if is_same(&named) => named,
        _ => return attached,
    };
    match attach::map(topic, named, attached.header, Access::Write, true) {
        Ok(Attached { memory, .. }) => Attached { memory, ..attached },
        Err(_) => attached,
    }
}

/// Takes the publisher's lock. The error names the process that has it.
pub(crate) fn lock_publisher(topic: &Topic, segment: &Segment) -> Result<(), Error> {
    if segment
        .try_lock(PUBLISHER_LOCK)
        .map_err(Error::os("lock", topic.path()))?
    {
        return Ok(());
    }
    let pid = match segment.head::<HEADER_LEN>() {
        Ok(Some(head)) => {
            u32::from_le_bytes(std::array::from_fn(|i| head[WRITER_PID.offset() + i]))
        }
        _ => 0,
    };
    Err(Error::PublisherAlive {
        path: topic.path().to_owned(),
        pid,
    })
}

/// Writes which process publishes from now on, and the offset of its wall clock.
/// Relaxed: these fields are for people.
pub(crate) fn write_identity(memory: &Memory) {
    memory.u32(WRITER_PID).store(std::process::id(), Relaxed);
    memory
        .u64(WRITER_START)
        .store(os::process_start_time(), Relaxed);
    memory
        .u64(REALTIME_OFFSET)
        .store(clock::realtime_offset_ns() as u64, Relaxed);
}
