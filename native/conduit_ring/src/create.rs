//! How a publisher comes by its segment: made anew, or taken over from a predecessor that died.

use std::io;

use crate::attach::{self, Attached};
use crate::claim;
use crate::clock;
use crate::error::Error;
use crate::guarded::Guarded;
use crate::header::{self, Header, Origin};
use crate::layout::{
    At64, DROPPED_PINNED, EXT_MAGIC, HEADER_LEN, LAST_PUBLISH, MAGIC, MESSAGE_LIMIT,
    PUBLISHER_LOCK, REALTIME_OFFSET, REJECTED_OVERSIZE, STATE, STATE_LIVE, STATE_RETIRED,
    WAKE_COUNT, WRITE_IDX, WRITE_INTENT, WRITER_EPOCH, WRITER_PID, WRITER_START,
};
use crate::memory::Memory;
use crate::os::{self, Access, Name, Segment};
use crate::processes;
use crate::publisher::PublisherOptions;
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

/// Makes a segment; `None` when the name was given meanwhile.
fn create(topic: &Topic, options: &PublisherOptions) -> Result<Option<Attached>, Error> {
    let instance_id = os::random_id().map_err(Error::os("getrandom", topic.path()))?;
    let header = Header {
        geometry: options.geometry,
        content: options.content,
        origin: Origin::Native { instance_id },
    };
    make(topic, header, (options.mode, options.group), |_, _| Ok(()))
}

/// Makes a segment, complete and locked before it has a name. `fill` puts into it what else it has from the start.
fn make(
    topic: &Topic,
    header: Header,
    (mode, group): (u32, Option<u32>),
    fill: impl FnOnce(&Segment, &Memory) -> io::Result<()>,
) -> Result<Option<Attached>, Error> {
    let path = topic.path();
    let len = header.geometry.segment_len();
    let instance_id = match header.origin {
        Origin::Native { instance_id } => instance_id,
        Origin::Legacy => 0,
    };
    let segment =
        Segment::create(directory(), len, mode, group).map_err(Error::os("create", path))?;
    segment
        .write_head(&Header::encode(
            header.geometry,
            header.content,
            instance_id,
        ))
        .map_err(Error::os("write", path))?;
    lock(topic, &segment)?;
    let attached = attach::map(topic, segment, header, Access::Write, false)?;
    claim::prepare(&attached.memory);
    introduce(&attached.memory);
    fill(&attached.segment, &attached.memory).map_err(Error::os("fill", path))?;
    // Release: meets the Acquire of whoever finds the magic; readers find it by the file's name anyway.
    attached.memory.u32(MAGIC).store(EXT_MAGIC, Release);
    match attached.segment.link(path) {
        Ok(()) => Ok(Some(map_by_name(topic, attached))),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Ok(None),
        Err(e) => Err(Error::os("link", path)(e)),
    }
}

/// Maps a new segment anew by its name, so that /proc/PID/maps has the name, for people and for `processes`. Until now the file
/// had none, and that is what the kernel goes on showing of the mapping there is.
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

/// Makes a publisher's segment anew, under its sequence numbers and with its messages, if the name does not lead to it any
/// more; `None` if it does.
pub(crate) fn renew(topic: &Topic, old: &Attached) -> Result<Option<Attached>, Error> {
    for _ in 0..ATTEMPTS {
        match old.segment.name(topic.path()) {
            Ok(Name::Same) => return Ok(None),
            Ok(Name::Other) => {
                if !clear_name(topic)? {
                    continue;
                }
            }
            Ok(Name::Missing) => {}
            Err(e) => return Err(Error::os("stat", topic.path())(e)),
        }
        if let Some(renewed) = make_anew(topic, old)? {
            // Release: meets the Acquire in Subscriber's look at the state.
            old.memory.u32(STATE).store(STATE_RETIRED, Release);
            writer::notify_all(&old.memory);
            return Ok(Some(renewed));
        }
    }
    Err(Error::PublisherAlive {
        path: topic.path().to_owned(),
        pid: 0,
    })
}

/// Removes what has the name of a topic that has a publisher, if nobody lives there; `false` when it has changed meanwhile.
fn clear_name(topic: &Topic) -> Result<bool, Error> {
    let opened = attach::open_file(topic, Access::Write);
    let Some(found) = opened.map_err(|error| trust::explain(topic, error))? else {
        return Ok(true);
    };
    trust::require(topic, &found)?;
    if !lock_named(topic, &found)? {
        return Ok(false);
    }
    match attach::read_header(topic, &found)? {
        Ok(header) if header.origin != Origin::Legacy => {
            let attached = attach::map(topic, found, header, Access::Write, false)?;
            retire(topic, &attached)?;
        }
        Ok(header) => remove_legacy(topic, &found, header, false)?,
        Err(fault) => remove_unused(topic, &found, false, attach::bad(topic, fault))?,
    }
    Ok(true)
}

fn make_anew(topic: &Topic, old: &Attached) -> Result<Option<Attached>, Error> {
    let (mode, group) = old
        .segment
        .access_rights()
        .map_err(Error::os("stat", topic.path()))?;
    let end = old.header.geometry.segment_len();
    make(topic, old.header, (mode, Some(group)), |segment, memory| {
        segment.copy_from(&old.segment, HEADER_LEN as u64, end)?;
        for at in CARRIED_OVER {
            memory
                .u64(at)
                .store(old.memory.u64(at).load(Relaxed), Relaxed);
        }
        let epoch = old.memory.u32(WRITER_EPOCH).load(Relaxed);
        memory
            .u32(WRITER_EPOCH)
            .store(epoch.wrapping_add(1), Relaxed);
        Ok(())
    })
}

/// What of a header goes on in a segment that is made anew.
const CARRIED_OVER: [At64; 6] = [
    WRITE_IDX,
    WRITE_INTENT,
    LAST_PUBLISH,
    DROPPED_PINNED,
    REJECTED_OVERSIZE,
    WAKE_COUNT,
];

/// Succeeds the publisher of a segment that exists; `None` when the name has changed meanwhile.
fn succeed(
    topic: &Topic,
    options: &PublisherOptions,
    found: Segment,
) -> Result<Option<Attached>, Error> {
    if !options.force {
        trust::require(topic, &found)?;
    }
    if !lock_named(topic, &found)? {
        return Ok(None);
    }
    if let Err(refusal) = trust::require(topic, &found) {
        remove_unused(topic, &found, options.force, refusal)?;
        return create(topic, options);
    }
    match attach::read_header(topic, &found)? {
        Ok(header) if header.origin != Origin::Legacy => {
            succeed_native(topic, options, found, header)
        }
        Ok(header) => {
            remove_legacy(topic, &found, header, options.force)?;
            create(topic, options)
        }
        Err(fault) => {
            let refusal = attach::bad(topic, fault);
            remove_unused(topic, &found, options.force, refusal)?;
            create(topic, options)
        }
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

/// Removes a legacy publisher's file if that is dead: nobody has it mapped, or only readers of ours, who then follow.
fn remove_legacy(topic: &Topic, found: &Segment, header: Header, force: bool) -> Result<(), Error> {
    let refusal = Error::LegacyInUse {
        path: topic.path().to_owned(),
    };
    remove_unused(
        topic,
        found,
        force || is_left_by_legacy(topic, header)?,
        refusal,
    )
}

/// Whether no process has a legacy segment mapped as its publisher would, or is about to.
pub(crate) fn is_left_by_legacy(topic: &Topic, header: Header) -> Result<bool, Error> {
    let Some(segment) = attach::open_file(topic, Access::Read)? else {
        return Ok(true);
    };
    let looked = Guarded::unmapped(segment, header);
    let peer = processes::legacy_peer(&looked.segment, &looked, None, None);
    let left = peer.is_none() && !processes::is_about_to_be_mapped(&looked.segment);
    looked.check(topic).map(|()| left)
}

/// Removes a file that is no native segment, if that harms nobody or the caller insists.
fn remove_unused(topic: &Topic, found: &Segment, force: bool, refusal: Error) -> Result<(), Error> {
    if !force && !found.is_unused() {
        return Err(refusal);
    }
    found
        .unlink(topic.path())
        .map_err(Error::os("unlink", topic.path()))
}

/// Locks the file that has the topic's name; `false` when the name went to another one before the lock was obtained.
fn lock_named(topic: &Topic, found: &Segment) -> Result<bool, Error> {
    lock(topic, found)?;
    let name = found
        .name(topic.path())
        .map_err(Error::os("stat", topic.path()))?;
    Ok(name == Name::Same)
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
        .store(os::process_start_time(), Relaxed);
    memory
        .u64(REALTIME_OFFSET)
        .store(clock::realtime_offset_ns() as u64, Relaxed);
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};
    use std::os::unix::fs::FileExt;

    use super::*;
    use crate::content::ContentTag;
    use crate::geometry::Geometry;
    use crate::publisher::Publisher;

    /// A topic whose file is removed afterwards.
    struct Scratch(Topic);

    impl Scratch {
        fn new(name: &str) -> Scratch {
            Scratch(Topic::new(&format!("create-{}-{name}", std::process::id())).unwrap())
        }

        /// Leaves what a publisher that died leaves.
        fn leave_dead(&self) -> Segment {
            let mut publisher = Publisher::open(&self.0, &PublisherOptions::default()).unwrap();
            publisher.publish(b"last words").unwrap();
            publisher.abandon();
            Segment::open(self.0.path(), Access::Write).unwrap()
        }
    }

    impl Drop for Scratch {
        fn drop(&mut self) {
            let _ = fs::remove_file(self.0.path());
        }
    }

    fn epoch(segment: &Segment) -> u32 {
        let head = segment.head::<HEADER_LEN>().unwrap().unwrap();
        u32::from_le_bytes(std::array::from_fn(|i| head[WRITER_EPOCH.offset() + i]))
    }

    #[test]
    fn a_file_that_lost_its_name_before_it_was_locked_is_not_taken_over() {
        let scratch = Scratch::new("renamed");
        for replace in [false, true] {
            let found = scratch.leave_dead();
            let copy = Segment::open(scratch.0.path(), Access::Read).unwrap();
            fs::remove_file(scratch.0.path()).unwrap();
            if replace {
                scratch.leave_dead();
            }
            let taken = succeed(&scratch.0, &PublisherOptions::default(), found).unwrap();
            assert!(taken.is_none());
            assert_eq!(epoch(&copy), 0);
            assert_eq!(scratch.0.path().exists(), replace);
        }
    }

    #[test]
    fn a_takeover_allocates_what_the_file_lacks() {
        // More than there is: what is not asked for shows only when it is written, by a signal.
        let geometry = Geometry::slots(1 << 20, 1 << 30).unwrap();
        let scratch = Scratch::new("sparse");
        let file = File::create(scratch.0.path()).unwrap();
        file.set_len(geometry.segment_len()).unwrap();
        let head = Header::encode(geometry, ContentTag::RAW, 7);
        file.write_all_at(&head, 0).unwrap();
        file.write_all_at(&EXT_MAGIC.to_le_bytes(), MAGIC.offset() as u64)
            .unwrap();
        let options = PublisherOptions {
            geometry,
            ..Default::default()
        };
        let refused = Publisher::open(&scratch.0, &options).unwrap_err();
        let kind = refused
            .errno()
            .map(|errno| io::Error::from_raw_os_error(errno).kind());
        assert_eq!(kind, Some(io::ErrorKind::StorageFull), "{refused}");
    }
}
