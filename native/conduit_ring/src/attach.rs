//! Opening a segment that exists: it is checked first and mapped then.

use std::io;
use std::sync::Arc;

use crate::claim::ReaderSlotLocks;
use crate::error::{Error, Fault};
use crate::header::{FIXED_LEN, Header};
use crate::layout::ReaderSlot;
use crate::memory::Memory;
use crate::os::{Access, Segment};
use crate::topic::Topic;
use crate::trust;

/// A segment, checked and mapped.
pub(crate) struct Attached {
    pub(crate) segment: Segment,
    pub(crate) memory: Arc<Memory>,
    pub(crate) header: Header,
}

/// Opens a topic's file. Returns `None` when it does not exist.
pub(crate) fn open_file(topic: &Topic, access: Access) -> Result<Option<Segment>, Error> {
    let segment = match Segment::open(topic.path(), access) {
        Ok(segment) => segment,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::os("open", topic.path())(e)),
    };
    if segment
        .is_regular()
        .map_err(Error::os("stat", topic.path()))?
    {
        Ok(Some(segment))
    } else {
        Err(bad(topic, Fault::NotAFile))
    }
}

/// Reads and checks the header. The inner result is what is wrong with the file.
pub(crate) fn read_header(
    topic: &Topic,
    segment: &Segment,
) -> Result<Result<Header, Fault>, Error> {
    let head = segment
        .head::<FIXED_LEN>()
        .map_err(Error::os("read", topic.path()))?;
    let len = segment.len().map_err(Error::os("stat", topic.path()))?;
    Ok(head
        .ok_or(Fault::NotReady)
        .and_then(|head| Header::decode(&head, len)))
}

/// Maps a checked segment. Refuses a stranger's, who could shorten it at any moment.
pub(crate) fn map(
    topic: &Topic,
    segment: Segment,
    header: Header,
    access: Access,
    populate: bool,
) -> Result<Attached, Error> {
    trust::require(topic, &segment)?;
    map_trusting(topic, segment, header, access, populate)
}

/// Maps a checked segment of any owner.
pub(crate) fn map_trusting(
    topic: &Topic,
    segment: Segment,
    header: Header,
    access: Access,
    populate: bool,
) -> Result<Attached, Error> {
    let len = header.geometry.segment_len();
    let mapping = segment
        .map(len, access, populate)
        .map_err(Error::os("map", topic.path()))?;
    let memory =
        Memory::new(mapping, header.geometry).ok_or_else(|| bad(topic, Fault::Truncated))?;
    Ok(Attached {
        segment,
        memory: Arc::new(memory),
        header,
    })
}

/// Opens a topic's file for reading. With write access it opens the file for writing as well,
/// unless a stranger owns it. Returns `None` when the file does not exist.
pub(crate) fn open_to_read(
    topic: &Topic,
    access: Access,
    trust_all: bool,
) -> Result<Option<Found>, Error> {
    let open = |access| -> Result<Option<Found>, Error> {
        let Some(segment) = open_file(topic, access)? else {
            return Ok(None);
        };
        let foreign = !trust_all && trust::is_foreign(topic, &segment)?;
        Ok(Some(Found { segment, foreign }))
    };
    match open(Access::Read)? {
        // Another file may have the name by now, so that its owner is checked again.
        Some(found) if access == Access::Write && !found.foreign => open(access),
        found => Ok(found),
    }
}

/// A topic's file that was opened.
pub(crate) struct Found {
    pub(crate) segment: Segment,
    /// Whether it belongs to a user who is not trusted.
    pub(crate) foreign: bool,
}

/// Opens and checks a topic. Returns `None` when its file does not exist.
fn open(topic: &Topic, access: Access) -> Result<Option<(Segment, Header)>, Error> {
    let Some(segment) = open_file(topic, access)? else {
        return Ok(None);
    };
    let header = sound_header(topic, &segment)?;
    Ok(Some((segment, header)))
}

/// As [`read_header`], for a file that must be sound.
pub(crate) fn sound_header(topic: &Topic, segment: &Segment) -> Result<Header, Error> {
    read_header(topic, segment)?.map_err(|fault| bad(topic, fault))
}

/// Opens, checks and maps a topic. Returns `None` when its file does not exist.
pub(crate) fn attach(topic: &Topic, access: Access) -> Result<Option<Attached>, Error> {
    let Some((segment, header)) = open(topic, access)? else {
        return Ok(None);
    };
    map(topic, segment, header, access, false).map(Some)
}

/// Makes the error for a file that cannot be used.
pub(crate) fn bad(topic: &Topic, fault: Fault) -> Error {
    Error::BadSegment {
        path: topic.path().to_owned(),
        fault,
    }
}

impl ReaderSlotLocks for Segment {
    fn try_lock(&self, reader_slot: ReaderSlot) -> io::Result<bool> {
        Segment::try_lock(self, reader_slot.lock())
    }

    fn unlock(&self, reader_slot: ReaderSlot) -> io::Result<()> {
        Segment::unlock(self, reader_slot.lock())
    }
}
