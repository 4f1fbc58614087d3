//! A subscriber's tie to one segment: its reader line, its cursor, and what it can tell about the publisher.

use std::io;
use std::sync::Arc;

use crate::attach::{self, Attached};
use crate::error::{Error, Fault};
use crate::header::{FIXED_LEN, Header, Origin};
use crate::layout::{ReaderLine, STATE, STATE_LIVE, WRITER_EPOCH, WRITER_PID};
use crate::lease::Lease;
use crate::line::{Line, Ticket};
use crate::memory::Memory;
use crate::pins::{self, Announced};
use crate::reader::{Dialect, Meta, Policy, Reader, Sink, Start};
use crate::segment::{Access, Name};
use crate::sync::Ordering::{Acquire, Relaxed};
use crate::topic::Topic;

/// Whether there is something to expect from a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Life {
    /// Its publisher lives, as far as can be known.
    Up,
    /// Its publisher died; another one may go on with it.
    Down,
    /// Nothing will ever be published there again, or the name leads elsewhere.
    Over,
}

/// How one takes part in a segment that one reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// In a reader slot of one's own.
    Reader,
    /// Without a trace: the mapping is read-only.
    Observer,
}

/// Which publisher a segment has, or had last. Differs between any two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Incarnation {
    /// Random number of the segment; 0 if it has no extension.
    pub instance_id: u64,
    /// Takeovers of the segment before this publisher's start.
    pub epoch: u32,
    /// Its process; 0 if the segment has no extension.
    pub pid: u32,
}

/// Where a reader begins in a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Beginning {
    /// As the user wishes.
    At(Start),
    /// Where it has got to: the subscriber was there before.
    After(Past),
}

/// What a subscriber remembers of the segment that it let go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Past {
    /// Which segment it was, if it had a number.
    instance_id: Option<u64>,
    cursor: u64,
    /// Messages lost there since the last delivery.
    pub(crate) lost: u64,
}

pub(crate) struct Attachment {
    attached: Arc<Attached>,
    /// `None` of an observer's.
    line: Option<Arc<Line>>,
    reader: Reader,
    /// What is known since the first lease.
    announced: Option<Announced>,
}

impl Attachment {
    /// Attaches to a topic; `None` when there is no segment that is alive, or not yet.
    pub(crate) fn open(
        topic: &Topic,
        part: Part,
        beginning: Beginning,
    ) -> Result<Option<Attachment>, Error> {
        let access = match part {
            Part::Reader => Access::Write,
            Part::Observer => Access::Read,
        };
        let attached = match attach::attach(topic, access) {
            Ok(Some(attached)) => Arc::new(attached),
            Ok(None)
            | Err(Error::BadSegment {
                fault: Fault::NotReady,
                ..
            }) => return Ok(None),
            Err(error) => return Err(error),
        };
        if is_native(&attached) && !is_live(&attached) {
            return Ok(None);
        }
        let line = match part {
            Part::Reader => Some(Line::claim(topic, &attached)?),
            Part::Observer => None,
        };
        let dialect = if is_native(&attached) {
            Dialect::Native
        } else {
            Dialect::Legacy
        };
        let reader = match beginning {
            Beginning::At(start) => Reader::begin(&attached.memory, dialect, start),
            Beginning::After(past) => {
                let known =
                    past.instance_id.is_some() && past.instance_id == instance_id(&attached.header);
                Reader::resume(dialect, if known { past.cursor } else { 0 }, past.lost)
            }
        };
        Ok(Some(Attachment {
            attached,
            line,
            reader,
            announced: None,
        }))
    }

    pub(crate) fn memory(&self) -> &Arc<Memory> {
        &self.attached.memory
    }

    pub(crate) fn header(&self) -> &Header {
        &self.attached.header
    }

    /// The reader line that is held; `None` of an observer's.
    pub(crate) fn line(&self) -> Option<ReaderLine> {
        self.line.as_ref().map(|line| line.number())
    }

    pub(crate) fn incarnation(&self) -> Incarnation {
        let memory = &self.attached.memory;
        Incarnation {
            instance_id: instance_id(&self.attached.header).unwrap_or(0),
            epoch: memory.u32(WRITER_EPOCH).load(Relaxed),
            pid: memory.u32(WRITER_PID).load(Relaxed),
        }
    }

    pub(crate) fn reader(&self) -> &Reader {
        &self.reader
    }

    pub(crate) fn past(&self) -> Past {
        Past {
            instance_id: instance_id(&self.attached.header),
            cursor: self.reader.cursor(),
            lost: self.reader.lost_since_delivery(),
        }
    }

    #[inline]
    pub(crate) fn next(&mut self, policy: Policy, sink: &mut impl Sink) -> Option<Meta> {
        let lost_before = self.reader.lost_total();
        let memory = &self.attached.memory;
        let meta = self.reader.next(memory, policy, sink);
        self.show(lost_before);
        meta
    }

    /// Shows in the line how far the reader is.
    #[inline]
    fn show(&self, lost_before: u64) {
        let memory = &self.attached.memory;
        let Some(line) = self.line() else {
            return;
        };
        memory
            .u64(line.read_idx())
            .store(self.reader.cursor(), Relaxed);
        if self.reader.lost_total() != lost_before {
            memory
                .u64(line.lost_count())
                .store(self.reader.lost_total(), Relaxed);
        }
    }

    /// As [`Attachment::next`], without a copy where the publisher respects a hold.
    pub(crate) fn lease(&mut self, topic: &Topic, policy: Policy) -> Result<Option<Lease>, Error> {
        let (Some(line), true) = (&self.line, self.has_news()) else {
            return Ok(None);
        };
        let ticket = Ticket::take(line).ok_or_else(|| Error::TooManyLeases {
            path: topic.path().to_owned(),
        })?;
        let view = ticket
            .borrow_view()
            .map_err(Error::os("map", topic.path()))?;
        let announced = self.announced(line.number());
        let lost_before = self.reader.lost_total();
        let memory = &self.attached.memory;
        let mut copy = Copied::default();
        let taken = self.reader.search(memory, policy, |reader| {
            let held = announced.is_some_and(|it| it.protects(memory, reader.cursor()));
            let meta = if held {
                reader.take_pinned(memory, ticket.pin())
            } else {
                reader.take(memory, &mut copy)
            };
            meta.map(|meta| (meta, held))
        });
        self.show(lost_before);
        let path = topic.path().to_owned();
        Ok(taken.map(|(meta, held)| {
            if held {
                let at = self.header().geometry.slot_offset(meta.sequence);
                Lease::of_slot(meta, ticket, view, at, path)
            } else {
                ticket.return_view(view);
                Lease::of_copy(meta, ticket, copy.into_bytes(meta.len), path)
            }
        }))
    }

    /// Legacy publishers do not look at pins.
    fn announced(&mut self, line: ReaderLine) -> Option<Announced> {
        if self.announced.is_none() && is_native(&self.attached) {
            self.announced = Some(pins::announce(&self.attached.memory, line));
        }
        self.announced
    }

    pub(crate) fn has_news(&self) -> bool {
        self.reader.has_news(&self.attached.memory)
    }

    /// Whether the state that stands in the segment says that its publisher goes on. Cheap: no system call.
    pub(crate) fn says_live(&self) -> bool {
        !is_native(&self.attached) || is_live(&self.attached)
    }

    /// Looks whether the publisher lives and the topic is still this segment.
    pub(crate) fn life(&self, topic: &Topic) -> io::Result<Life> {
        let header = self.attached.segment.head::<FIXED_LEN>()?;
        let len = self.attached.segment.len()?;
        let unchanged =
            header.is_some_and(|bytes| Header::decode(&bytes, len) == Ok(self.attached.header));
        if !unchanged || !self.says_live() {
            return Ok(Life::Over);
        }
        let name = self.attached.segment.name(topic.path())?;
        let alive = self.attached.has_live_publisher()?;
        Ok(judge(is_native(&self.attached), alive, name))
    }

    /// Claims a line again if the claim was wiped: a legacy publisher that starts anew clears the header.
    pub(crate) fn renew_claim(&mut self, topic: &Topic) -> Result<(), Error> {
        let Some(line) = self.line.as_ref().filter(|line| !line.stands()) else {
            return Ok(());
        };
        line.give_up().map_err(Error::os("unlock", topic.path()))?;
        self.announced = None;
        self.line = Some(Line::claim(topic, &self.attached)?);
        Ok(())
    }
}

/// A copy of a message for a lease.
#[derive(Default)]
struct Copied(Vec<u8>);

impl Copied {
    fn into_bytes(mut self, len: usize) -> Box<[u8]> {
        // The sink made it as long as the message; a later try may have asked for less.
        self.0.truncate(len);
        self.0.into_boxed_slice()
    }
}

// SAFETY: the vector is as long as was asked for, at least, and stays in place until the next call.
unsafe impl Sink for Copied {
    fn room(&mut self, len: usize) -> *mut u8 {
        if self.0.len() < len {
            self.0.resize(len, 0);
        }
        self.0.as_mut_ptr()
    }
}

fn judge(native: bool, alive: bool, name: Name) -> Life {
    match (native, alive, name) {
        (_, _, Name::Other) => Life::Over,
        (true, true, _) | (false, _, Name::Same) => Life::Up,
        (true, false, Name::Same) => Life::Down,
        (_, _, Name::Missing) => Life::Over,
    }
}

fn instance_id(header: &Header) -> Option<u64> {
    match header.origin {
        Origin::Native { instance_id } => Some(instance_id),
        Origin::Legacy => None,
    }
}

fn is_native(attached: &Attached) -> bool {
    attached.header.origin != Origin::Legacy
}

fn is_live(attached: &Attached) -> bool {
    // Acquire: meets the Release with which a publisher closes or retires.
    attached.memory.u32(STATE).load(Acquire) == STATE_LIVE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_native_segment_lives_by_its_lock_and_is_over_when_replaced() {
        assert_eq!(judge(true, true, Name::Same), Life::Up);
        assert_eq!(judge(true, true, Name::Missing), Life::Up);
        assert_eq!(judge(true, false, Name::Same), Life::Down);
        assert_eq!(judge(true, false, Name::Missing), Life::Over);
        assert_eq!(judge(true, true, Name::Other), Life::Over);
    }

    #[test]
    fn a_legacy_segment_lives_by_its_name() {
        assert_eq!(judge(false, false, Name::Same), Life::Up);
        assert_eq!(judge(false, false, Name::Missing), Life::Over);
        assert_eq!(judge(false, false, Name::Other), Life::Over);
    }
}
