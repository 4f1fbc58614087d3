//! How a publisher comes by its segment: made anew, or taken over from a predecessor that died.

use std::io;

use crate::attach::{self, Attached};
use crate::claim;
use crate::clock;
use crate::error::Error;
use crate::header::{self, Header, Origin};
use crate::layout::{
    EXT_MAGIC, HEADER_LEN, MAGIC, MESSAGE_LIMIT, PUBLISHER_LOCK, REALTIME_OFFSET, STATE,
    STATE_LIVE, STATE_RETIRED, WRITER_EPOCH, WRITER_PID, WRITER_START,
};
use crate::memory::Memory;
use crate::publisher::PublisherOptions;
use crate::segment::{self, Access, Name, Segment};
use crate::sync::Ordering::{Acquire, Relaxed, Release};
use crate::topic::{Topic, directory};
use crate::trust;
use crate::writer;

/// Rounds against others that make and remove the same name at the same time.
const ATTEMPTS: u32 = 64;

/// Gets the topic's segment with its publisher lock held, whatever stands there now.
pub(crate) fn acquire(topic: &Topic, options: &PublisherOptions) -> Result<Attached, Error> {
    for _ in 0..ATTEMPTS {
        let opened = attach::open_file(topic, Access::Write);
        let attempt = match opened.map_err(|error| trust::explain(topic, error))? {
            None => create(topic, options)?,
            Some(found) => succeed(topic, options, found)?,
        };
        if let Some(attached) = attempt {
            return Ok(attached);
        }
    }
    Err(Error::PublisherAlive {
        path: topic.path().to_owned(),
        pid: 0,
    })
}

/// Makes a segment, complete and locked before it has a name; `None` when the name was given meanwhile.
fn create(topic: &Topic, options: &PublisherOptions) -> Result<Option<Attached>, Error> {
    let path = topic.path();
    let len = options.geometry.segment_len();
    let instance_id = segment::random_id().map_err(Error::os("getrandom", path))?;
    let header = Header {
        geometry: options.geometry,
        content: options.content,
        origin: Origin::Native { instance_id },
    };
    let segment = Segment::create(directory(), len, options.mode, options.group)
        .map_err(Error::os("create", path))?;
    segment
        .write_head(&Header::encode(
            header.geometry,
            header.content,
            instance_id,
        ))
        .map_err(Error::os("write", path))?;
    lock(topic, &segment)?;
    let attached = attach::map(topic, segment, header, Access::Write, true)?;
    claim::prepare(&attached.memory);
    introduce(&attached.memory);
    // Release: meets the Acquire of whoever finds the magic; readers find it by the file's name anyway.
    attached.memory.u32(MAGIC).store(EXT_MAGIC, Release);
    match attached.segment.link(path) {
        Ok(()) => Ok(Some(attached)),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Ok(None),
        Err(e) => Err(Error::os("link", path)(e)),
    }
}

/// Succeeds the publisher of a segment that exists; `None` when the name has changed meanwhile.
fn succeed(
    topic: &Topic,
    options: &PublisherOptions,
    found: Segment,
) -> Result<Option<Attached>, Error> {
    if !options.force {
        trust::require(topic, &found)?;
    }
    lock(topic, &found)?;
    if found
        .name(topic.path())
        .map_err(Error::os("stat", topic.path()))?
        != Name::Same
    {
        return Ok(None);
    }
    if let Err(refusal) = trust::require(topic, &found) {
        return replace(topic, options, &found, refusal);
    }
    match attach::read_header(topic, &found)? {
        Ok(header) if header.origin != Origin::Legacy => {
            succeed_native(topic, options, found, header)
        }
        Ok(_) => replace(
            topic,
            options,
            &found,
            Error::LegacyInUse {
                path: topic.path().to_owned(),
            },
        ),
        Err(fault) => replace(topic, options, &found, attach::bad(topic, fault)),
    }
}

fn succeed_native(
    topic: &Topic,
    options: &PublisherOptions,
    found: Segment,
    header: Header,
) -> Result<Option<Attached>, Error> {
    let same = header.geometry.has_slots_of(&options.geometry) && header.content == options.content;
    if same {
        found
            .allocate(header.geometry.segment_len())
            .map_err(Error::os("allocate", topic.path()))?;
    }
    let mut attached = attach::map(topic, found, header, Access::Write, same)?;
    if same && attached.memory.u32(STATE).load(Acquire) == STATE_LIVE {
        attached.header.geometry = options.geometry;
        take_over(&attached);
        return Ok(Some(attached));
    }
    retire(topic, &attached)?;
    create(topic, options)
}

/// Goes on in place, at the same sequence number. Sleepers are called in case the predecessor died before it did.
fn take_over(attached: &Attached) {
    let memory = &attached.memory;
    memory
        .u32(MESSAGE_LIMIT)
        .store(header::message_limit(&attached.header.geometry), Relaxed);
    memory.u32(WRITER_EPOCH).fetch_add(1, Relaxed);
    introduce(memory);
    writer::notify_all(memory);
}

fn retire(topic: &Topic, attached: &Attached) -> Result<(), Error> {
    // Release: meets the Acquire in Subscriber's look at the state.
    attached.memory.u32(STATE).store(STATE_RETIRED, Release);
    writer::notify_all(&attached.memory);
    attached
        .segment
        .unlink(topic.path())
        .map_err(Error::os("unlink", topic.path()))
}

/// Replaces a file that is no native segment, if that harms nobody or the caller insists.
fn replace(
    topic: &Topic,
    options: &PublisherOptions,
    found: &Segment,
    refusal: Error,
) -> Result<Option<Attached>, Error> {
    if !options.force && !found.is_unused() {
        return Err(refusal);
    }
    found
        .unlink(topic.path())
        .map_err(Error::os("unlink", topic.path()))?;
    create(topic, options)
}

fn lock(topic: &Topic, segment: &Segment) -> Result<(), Error> {
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

fn introduce(memory: &Memory) {
    memory.u32(WRITER_PID).store(std::process::id(), Relaxed);
    memory
        .u64(WRITER_START)
        .store(segment::process_start_time(), Relaxed);
    memory
        .u64(REALTIME_OFFSET)
        .store(clock::realtime_offset_ns() as u64, Relaxed);
}
