//! How a publisher gets the segment of its topic, whatever has the topic's name.
//!
//! ```text
//!   open the file of the topic's name
//!   │
//!   ├─ no file ─────────────────────────────────────────────► create, at number 0
//!   ├─ owner not trusted, without force ────────────────────► ForeignOwner
//!   ├─ lock refused ────────────────────────────────────────► PublisherAlive
//!   └─ lock taken
//!      ├─ the name leads to another file by now ────────────► begin again
//!      ├─ native
//!      │  ├─ same geometry and content, state live ─────────► take over, at write_idx
//!      │  └─ else ──► retire, unlink ───────────────────────► create, at number 0
//!      └─ legacy, not a ring, or owner not trusted
//!         ├─ a process uses it, without force ──────────────► LegacyInUse, BadSegment
//!         └─ else ──► unlink ───────────────────────────────► create, at number 0
//! ```
//!
//! The lock decides, never a time or a process number. A lock that was taken on a file that lost
//! the name meanwhile does not count.

use crate::attach::{self, Attached};
use crate::create::{create, lock_publisher, write_identity};
use crate::error::Error;
use crate::guarded::Guarded;
use crate::header::{self, Header, Origin};
use crate::layout::{MESSAGE_LIMIT, STATE, STATE_LIVE, STATE_RETIRED, WRITER_EPOCH};
use crate::options::PublisherOptions;
use crate::os::{Access, Name, Segment};
use crate::processes;
use crate::sync::Ordering::{Acquire, Relaxed, Release};
use crate::topic::Topic;
use crate::trust;
use crate::writer;

/// How often to begin again when others make and remove the same name at the same time.
pub(crate) const ATTEMPTS: u32 = 64;

/// Gets the topic's segment with its publisher lock held.
pub(crate) fn acquire(topic: &Topic, options: &PublisherOptions) -> Result<Attached, Error> {
    for _ in 0..ATTEMPTS {
        let opened = attach::open_file(topic, Access::Write);
        let attempt = match opened.map_err(|error| trust::explain(topic, error))? {
            None => create(topic, options)?,
            Some(found) => take_over_or_replace(topic, options, found)?,
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

/// Takes over the segment that has the topic's name, or replaces it. Returns `None` when the name
/// led to another file by the time the lock was taken.
fn take_over_or_replace(
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
            take_over_or_retire(topic, options, found, header)
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

fn take_over_or_retire(
    topic: &Topic,
    options: &PublisherOptions,
    found: Segment,
    header: Header,
) -> Result<Option<Attached>, Error> {
    let same_slots = header.geometry.has_slots_of(&options.geometry);
    let same = same_slots && header.content == options.content;
    if same {
        found
            .allocate(header.geometry.segment_len())
            .map_err(Error::os("allocate", topic.path()))?;
    }
    let mut attached = attach::map(topic, found, header, Access::Write, same)?;
    // Acquire: pairs with the Release with which a predecessor closed or retired the segment.
    if same && attached.memory.u32(STATE).load(Acquire) == STATE_LIVE {
        attached.header.geometry = options.geometry;
        take_over(&attached);
        return Ok(Some(attached));
    }
    retire(topic, &attached)?;
    create(topic, options)
}

/// Continues in place, at the same sequence number. Sleepers are woken in case the predecessor
/// died before it woke them.
fn take_over(attached: &Attached) {
    let memory = &attached.memory;
    // Relaxed: the predecessor is dead, and its lock was taken by a system call since. Readers
    // compare the epoch with an earlier one and order nothing by it.
    memory
        .u32(MESSAGE_LIMIT)
        .store(header::message_limit(&attached.header.geometry), Relaxed);
    memory.u32(WRITER_EPOCH).fetch_add(1, Relaxed);
    write_identity(memory);
    writer::notify_all(memory);
}

/// Ends a segment whose publisher is dead, and removes its name. Readers attach to the next one.
pub(crate) fn retire(topic: &Topic, attached: &Attached) -> Result<(), Error> {
    // Release: pairs with the Acquire in Backing::load32, so that a reader that sees the state
    // sees all messages.
    attached.memory.u32(STATE).store(STATE_RETIRED, Release);
    writer::notify_all(&attached.memory);
    attached
        .segment
        .unlink(topic.path())
        .map_err(Error::os("unlink", topic.path()))
}

/// Removes a legacy publisher's file if that publisher is dead: no process has the file mapped,
/// or only readers of this crate, which follow.
pub(crate) fn remove_legacy(
    topic: &Topic,
    found: &Segment,
    header: Header,
    force: bool,
) -> Result<(), Error> {
    let refusal = Error::LegacyInUse {
        path: topic.path().to_owned(),
    };
    let removable = force || is_left_by_legacy(topic, header)?;
    remove_unused(topic, found, removable, refusal)
}

/// Returns whether no process has a legacy segment mapped as its publisher would, or is about to.
pub(crate) fn is_left_by_legacy(topic: &Topic, header: Header) -> Result<bool, Error> {
    let Some(segment) = attach::open_file(topic, Access::Read)? else {
        return Ok(true);
    };
    let looked = Guarded::unmapped(segment, header);
    let peer = processes::legacy_peer(&looked.segment, &looked, None, None);
    let left = peer.is_none() && !processes::is_about_to_be_mapped(&looked.segment);
    looked.check(topic).map(|()| left)
}

/// Removes a file that is not a native segment, if no process uses it or `force` is set.
pub(crate) fn remove_unused(
    topic: &Topic,
    found: &Segment,
    force: bool,
    refusal: Error,
) -> Result<(), Error> {
    if !force && !found.is_unused() {
        return Err(refusal);
    }
    found
        .unlink(topic.path())
        .map_err(Error::os("unlink", topic.path()))
}

/// Locks the file that has the topic's name. Returns `false` when the name led to another file by
/// the time the lock was taken.
pub(crate) fn lock_named(topic: &Topic, found: &Segment) -> Result<bool, Error> {
    lock_publisher(topic, found)?;
    let name = found
        .name(topic.path())
        .map_err(Error::os("stat", topic.path()))?;
    Ok(name == Name::Same)
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};
    use std::io;
    use std::os::unix::fs::FileExt;

    use super::*;
    use crate::content::ContentTag;
    use crate::geometry::Geometry;
    use crate::layout::{EXT_MAGIC, HEADER_LEN, MAGIC};
    use crate::publisher::Publisher;
    use crate::scratch::Scratch;

    /// Leaves a segment as a publisher that died leaves it.
    fn leave_dead(topic: &Topic) -> Segment {
        let mut publisher = Publisher::open(topic, &PublisherOptions::default()).unwrap();
        publisher.publish(b"last words").unwrap();
        publisher.abandon();
        Segment::open(topic.path(), Access::Write).unwrap()
    }

    fn epoch(segment: &Segment) -> u32 {
        let head = segment.head::<HEADER_LEN>().unwrap().unwrap();
        u32::from_le_bytes(std::array::from_fn(|i| head[WRITER_EPOCH.offset() + i]))
    }

    #[test]
    fn a_file_that_lost_its_name_before_it_was_locked_is_not_taken_over() {
        let topic = Scratch::new();
        for replace in [false, true] {
            let found = leave_dead(&topic);
            let copy = Segment::open(topic.path(), Access::Read).unwrap();
            fs::remove_file(topic.path()).unwrap();
            if replace {
                leave_dead(&topic);
            }
            let taken =
                take_over_or_replace(&topic, &PublisherOptions::default(), found).unwrap();
            assert!(taken.is_none());
            assert_eq!(epoch(&copy), 0);
            assert_eq!(topic.path().exists(), replace);
        }
    }

    #[test]
    #[cfg_attr(
        target_pointer_width = "32",
        ignore = "on a 32-bit machine the largest geometry, 2 GiB, may fit into memory"
    )]
    fn a_takeover_allocates_what_the_file_lacks() {
        // More memory than exists. Pages that are not allocated show only when they are written,
        // by a signal.
        let geometry = Geometry::slots(1 << 20, 1 << 30).unwrap();
        let topic = Scratch::new();
        let file = File::create(topic.path()).unwrap();
        file.set_len(geometry.segment_len()).unwrap();
        let header = Header {
            geometry,
            content: ContentTag::RAW,
            origin: Origin::Native { instance_id: 7 },
        };
        file.write_all_at(&header.encode(), 0).unwrap();
        file.write_all_at(&EXT_MAGIC.to_le_bytes(), MAGIC.offset() as u64)
            .unwrap();
        let options = PublisherOptions {
            geometry,
            ..Default::default()
        };
        let refused = Publisher::open(&topic, &options).unwrap_err();
        let kind = refused
            .errno()
            .map(|errno| io::Error::from_raw_os_error(errno).kind());
        assert_eq!(kind, Some(io::ErrorKind::StorageFull), "{refused}");
    }
}
