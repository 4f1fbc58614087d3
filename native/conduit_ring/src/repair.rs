//! Repairs of the files that crashes left, for a person's tool.
//!
//! The ring needs none of them: publishers and subscribers repair by themselves whatever is in
//! their way. These functions remove leftovers of topics that are no longer used, and answer
//! the questions of `ganglion doctor`.
//!
//! Each one touches a file only under a lock that a living process would hold: the publisher's,
//! or that of the reader whose slot it takes back.

use crate::attach;
use crate::claim;
use crate::error::{Error, Fault};
use crate::header::{FIXED_LEN, Header, Origin};
use crate::info::Info;
use crate::layout::{EXT_MAGIC, HEADER_LEN, MAGIC, PUBLISHER_LOCK, ReaderSlot, SUBSCRIBER_MASK};
use crate::memory::Memory;
use crate::os::{Access, Name, Segment};
use crate::sync::Ordering::Release;
use crate::takeover;
use crate::topic::Topic;
use crate::trust;

/// The result of a repair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Repair {
    /// The repair was made.
    Made,
    /// There is nothing to repair any more.
    NotNeeded,
    /// A publisher lives. Nothing was touched.
    PublisherAlive,
    /// A process has the file open or mapped, or that cannot be known. Nothing was touched.
    InUse,
    /// The file is not a ring of this crate, as far as can be seen. Nothing was touched.
    NotARing,
}

/// Takes back the reader slots of readers that died, and returns how many there were.
///
/// Live topics are no exception: a slot is taken back under its lock, as each new subscriber
/// does.
///
/// # Errors
/// - [`Error::NoTopic`] when the topic does not exist.
/// - [`Error::BadSegment`] when the file is not a ring that this version can read.
/// - [`Error::ForeignOwner`] when the file belongs to a user who is not trusted.
/// - [`Error::Os`] when the operating system refuses.
pub fn reclaim_readers(topic: &Topic) -> Result<usize, Error> {
    let leaked = |info: Info| info.readers.iter().filter(|reader| !reader.alive).count();
    let before = leaked(Info::read(topic)?);
    let Some(attached) = attach::attach(topic, Access::Write)? else {
        return Ok(0);
    };
    claim::reclaim_leaked(&attached.memory, &attached.segment)
        .map_err(Error::os("lock", topic.path()))?;
    Ok(before.saturating_sub(leaked(Info::read(topic)?)))
}

/// Returns whether a legacy publisher that is dead made a topic: no process has it mapped, as far
/// as can be seen, but readers of this crate.
///
/// # Errors
/// - [`Error::NoTopic`] when the topic does not exist.
/// - [`Error::BadSegment`] when the file is not a ring that this version can read.
/// - [`Error::Os`] when the operating system refuses.
pub fn is_left_by_legacy_publisher(topic: &Topic) -> Result<bool, Error> {
    let segment = attach::open_file(topic, Access::Read)?.ok_or_else(|| Error::NoTopic {
        path: topic.path().to_owned(),
    })?;
    let header = attach::sound_header(topic, &segment)?;
    Ok(header.origin == Origin::Legacy && takeover::is_left_by_legacy(topic, header)?)
}

/// Removes the file of a topic whose publisher is dead and that no process has open.
///
/// A damaged file is removed too if it shows that it was a ring once, or if its header is all
/// zeros and so was never filled.
///
/// ```
/// use conduit_ring::repair::{Repair, remove_abandoned};
/// use conduit_ring::{Publisher, PublisherOptions, Topic};
///
/// # let name = format!("doc-repair-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// assert_eq!(remove_abandoned(&topic)?, Repair::PublisherAlive);
/// publisher.abandon(); // as if it had been killed
/// assert_eq!(remove_abandoned(&topic)?, Repair::Made);
/// assert_eq!(remove_abandoned(&topic)?, Repair::NotNeeded);
/// # Ok::<(), conduit_ring::Error>(())
/// ```
///
/// # Errors
/// - [`Error::BadSegment`] when the name leads to a directory, a device or the like.
/// - [`Error::Os`] when the operating system refuses.
pub fn remove_abandoned(topic: &Topic) -> Result<Repair, Error> {
    with_abandoned(topic, |segment| {
        if !was_ours(topic, segment)? {
            return Ok(Repair::NotARing);
        }
        segment
            .unlink(topic.path())
            .map_err(Error::os("unlink", topic.path()))?;
        Ok(Repair::Made)
    })
}

/// Clears the bits of legacy readers in a topic whose publisher is dead and that no process has
/// open.
///
/// Legacy readers hold no lock, so that only such a topic shows that they are dead.
///
/// # Errors
/// - [`Error::BadSegment`] when the file is not a ring that this version can read.
/// - [`Error::ForeignOwner`] when the file belongs to a user who is not trusted.
/// - [`Error::Os`] when the operating system refuses.
pub fn clear_legacy_readers(topic: &Topic) -> Result<Repair, Error> {
    with_abandoned(topic, |segment| {
        trust::require(topic, segment)?;
        let header = attach::sound_header(topic, segment)?;
        let mapping = segment
            .map(header.geometry.segment_len(), Access::Write, false)
            .map_err(Error::os("map", topic.path()))?;
        let memory = Memory::new(mapping, header.geometry)
            .ok_or_else(|| attach::bad(topic, Fault::Truncated))?;
        let legacy = ReaderSlot::all()
            .filter(|&reader_slot| !claim::is_native_claim(&memory, reader_slot))
            .fold(0, |bits, reader_slot| bits | reader_slot.bit());
        // Release: as in claim::clear, for a legacy reader that claims the bit next.
        let before = memory.u32(SUBSCRIBER_MASK).fetch_and(!legacy, Release);
        Ok(match before & legacy {
            0 => Repair::NotNeeded,
            _ => Repair::Made,
        })
    })
}

/// Runs a repair on a file that no process uses, and that no publisher can take meanwhile.
fn with_abandoned(
    topic: &Topic,
    repair: impl FnOnce(&Segment) -> Result<Repair, Error>,
) -> Result<Repair, Error> {
    let Some(segment) = attach::open_file(topic, Access::Write)? else {
        return Ok(Repair::NotNeeded);
    };
    let os = |action| Error::os(action, topic.path());
    if segment.is_locked(PUBLISHER_LOCK).map_err(os("lock"))? {
        return Ok(Repair::PublisherAlive);
    }
    // This is checked before the lock is taken, too: a process that has the file open would take
    // the lock for a publisher's.
    if !segment.is_unused() {
        return Ok(Repair::InUse);
    }
    if !segment.try_lock(PUBLISHER_LOCK).map_err(os("lock"))? {
        return Ok(Repair::PublisherAlive);
    }
    if segment.name(topic.path()).map_err(os("stat"))? != Name::Same {
        return Ok(Repair::NotNeeded);
    }
    if !segment.is_unused() {
        return Ok(Repair::InUse);
    }
    repair(&segment)
}

/// Returns whether a file is a ring, or a damaged one, or one that was never filled.
fn was_ours(topic: &Topic, segment: &Segment) -> Result<bool, Error> {
    let len = segment.len().map_err(Error::os("stat", topic.path()))?;
    let wanted = len.min(HEADER_LEN as u64) as usize;
    let mut head = [0; HEADER_LEN];
    segment
        .read_at(&mut head[..wanted], 0)
        .map_err(Error::os("read", topic.path()))?;
    Ok(is_ours(&head, len))
}

fn is_ours(head: &[u8; HEADER_LEN], len: u64) -> bool {
    let (fixed, _) = head.split_first_chunk::<FIXED_LEN>().expect("a header");
    let magic = &fixed[MAGIC.offset()..MAGIC.offset() + 4];
    match Header::decode(fixed, len) {
        Ok(_) | Err(Fault::Truncated) => true,
        // A later version of this crate decides about its own files.
        Err(Fault::Version) => false,
        Err(_) => magic == EXT_MAGIC.to_le_bytes() || head.iter().all(|&byte| byte == 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::ContentTag;
    use crate::geometry::Geometry;

    fn head() -> [u8; HEADER_LEN] {
        let fixed = Header {
            geometry: Geometry::default(),
            content: ContentTag::RAW,
            origin: Origin::Native { instance_id: 7 },
        }
        .encode();
        let mut head = [0; HEADER_LEN];
        head[..FIXED_LEN].copy_from_slice(&fixed);
        head[MAGIC.offset()..MAGIC.offset() + 4].copy_from_slice(&EXT_MAGIC.to_le_bytes());
        head
    }

    #[test]
    fn rings_damaged_ones_and_empty_files_are_ours() {
        let len = Geometry::default().segment_len();
        assert!(is_ours(&head(), len));
        assert!(is_ours(&head(), len - 1));
        assert!(is_ours(&[0; HEADER_LEN], 0));
        let mut broken = head();
        broken[0] = 3;
        assert!(is_ours(&broken, len));
    }

    #[test]
    fn files_of_others_and_of_later_versions_are_not() {
        let mut text = [0; HEADER_LEN];
        text[..16].copy_from_slice(b"buy milk, bread\n");
        assert!(!is_ours(&text, 16));
        assert!(!is_ours(&text, 100_000));
        let mut later = head();
        later[20] = 9;
        assert!(!is_ours(&later, Geometry::default().segment_len()));
    }
}
