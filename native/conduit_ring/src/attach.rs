//! Opening a segment that exists: checked first, mapped then.

use std::io;
use std::sync::Arc;

use crate::claim::LineLocks;
use crate::error::{Error, Fault};
use crate::header::{FIXED_LEN, Header};
use crate::layout::{PUBLISHER_LOCK, ReaderLine};
use crate::memory::Memory;
use crate::segment::{Access, Segment};
use crate::topic::Topic;

/// A segment, checked and mapped.
pub(crate) struct Attached {
    pub(crate) segment: Segment,
    pub(crate) memory: Arc<Memory>,
    pub(crate) header: Header,
}

/// Opens a topic's file; `None` when there is none.
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

/// Reads what the file says about itself.
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

/// Maps a checked segment.
pub(crate) fn map(
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

/// Opens and checks a topic; `None` when there is no file.
pub(crate) fn open(topic: &Topic, access: Access) -> Result<Option<(Segment, Header)>, Error> {
    let Some(segment) = open_file(topic, access)? else {
        return Ok(None);
    };
    let header = read_header(topic, &segment)?.map_err(|fault| bad(topic, fault))?;
    Ok(Some((segment, header)))
}

/// Opens, checks and maps a topic; `None` when there is no file.
pub(crate) fn attach(topic: &Topic, access: Access) -> Result<Option<Attached>, Error> {
    let Some((segment, header)) = open(topic, access)? else {
        return Ok(None);
    };
    map(topic, segment, header, access, false).map(Some)
}

pub(crate) fn bad(topic: &Topic, fault: Fault) -> Error {
    Error::BadSegment {
        path: topic.path().to_owned(),
        fault,
    }
}

impl Attached {
    /// Whether a publisher (other than one on this very descriptor) holds its lock.
    pub(crate) fn has_live_publisher(&self) -> io::Result<bool> {
        self.segment.is_locked(PUBLISHER_LOCK)
    }
}

impl LineLocks for Segment {
    fn try_lock(&self, line: ReaderLine) -> io::Result<bool> {
        Segment::try_lock(self, line.lock())
    }

    fn unlock(&self, line: ReaderLine) -> io::Result<()> {
        Segment::unlock(self, line.lock())
    }
}
