//! A subscriber's tie to one segment: its reader slot, its cursor, and what it can tell about the publisher.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::attach::{self, Attached, Found};
use crate::delivery::{Meta, Policy, Start};
use crate::error::{Error, Fault};
use crate::guarded::{Guard, Guarded};
use crate::header::{FIXED_LEN, Header};
use crate::layout::{At32, PUBLISHER_LOCK, STATE, STATE_LIVE, WRITER_EPOCH, WRITER_PID};
use crate::lease::Lease;
use crate::memory::Memory;
use crate::os::{Access, Name, Segment};
use crate::pins::{self, Announced};
use crate::processes;
use crate::reader::{Dialect, Reader};
use crate::registration::{Registration, Ticket};
use crate::sink::{IntoBox, Sink};
use crate::source::{self, Source};
use crate::sync::Ordering::{Acquire, Relaxed};
use crate::topic::Topic;
use crate::wait::{self, LONGEST_LEGACY_SLEEP, LONGEST_SLEEP};
use crate::waker::Alarm;

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

impl Part {
    fn access(self) -> Access {
        match self {
            Part::Reader => Access::Write,
            Part::Observer => Access::Read,
        }
    }
}

/// Which publisher a segment has, or had last. Differs between any two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Incarnation {
    /// Random number of the sequence of messages; 0 if it has no extension.
    pub instance_id: u64,
    /// Takeovers before this publisher's start, and times that the segment was made anew.
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
    way: Way,
    header: Header,
    reader: Reader,
    /// What is known since the first lease.
    announced: Option<Announced>,
    legacy: LegacyLife,
}

/// What is known of a legacy publisher, which holds no lock.
#[derive(Debug)]
struct LegacyLife {
    alive: bool,
    published: u64,
    next_look: Instant,
    /// The process that had the segment mapped when last looked.
    peer: Option<u32>,
}

/// From a legacy publisher's last message, and from one look to the next, until the processes are looked at.
const LEGACY_LOOKS: Duration = Duration::from_secs(1);

/// How a segment is read.
enum Way {
    Mapped {
        attached: Arc<Attached>,
        /// `None` of an observer's.
        reader_slot: Option<Arc<Registration>>,
    },
    Guarded(Arc<Guarded>),
}

impl Way {
    fn open(
        topic: &Topic,
        part: Part,
        guard: Guard,
        Found { segment, foreign }: Found,
        header: Header,
    ) -> Result<Way, Error> {
        let access = part.access();
        let way = match guard {
            _ if foreign || (guard == Guard::Always && !header.is_native()) => {
                Way::Guarded(Arc::new(Guarded::unmapped(segment, header)))
            }
            Guard::Always => Way::Guarded(Arc::new(Guarded::open(topic, segment, header, access)?)),
            Guard::Auto => Way::mapped(attach::map(topic, segment, header, access, false)?),
            Guard::Never => {
                Way::mapped(attach::map_trusting(topic, segment, header, access, false)?)
            }
        };
        Ok(way)
    }

    fn mapped(attached: Attached) -> Way {
        Way::Mapped {
            attached: Arc::new(attached),
            reader_slot: None,
        }
    }

    fn segment(&self) -> &Segment {
        match self {
            Way::Mapped { attached, .. } => &attached.segment,
            Way::Guarded(guarded) => &guarded.segment,
        }
    }

    fn load32(&self, at: At32) -> u32 {
        match self {
            // Acquire: meets the Release with which a publisher closes or retires.
            Way::Mapped { attached, .. } => attached.memory.u32(at).load(Acquire),
            Way::Guarded(guarded) => guarded.load32(at),
        }
    }

    /// Observers have no reader slot, and guarded readers claim none.
    fn claim(&mut self, topic: &Topic, part: Part) -> Result<(), Error> {
        if let (
            Way::Mapped {
                attached,
                reader_slot,
            },
            Part::Reader,
        ) = (self, part)
        {
            *reader_slot = Some(Registration::claim(topic, attached)?);
        }
        Ok(())
    }
}

impl Attachment {
    /// Attaches to a topic; `None` when there is no segment that is alive, or not yet.
    pub(crate) fn open(
        topic: &Topic,
        part: Part,
        guard: Guard,
        beginning: Beginning,
    ) -> Result<Option<Attachment>, Error> {
        let trust_all = guard == Guard::Never;
        let Some(found) = attach::open_to_read(topic, part.access(), trust_all)? else {
            return Ok(None);
        };
        let header = match attach::read_header(topic, &found.segment)? {
            Ok(header) => header,
            Err(Fault::NotReady) => return Ok(None),
            Err(fault) => return Err(attach::bad(topic, fault)),
        };
        let mut way = Way::open(topic, part, guard, found, header)?;
        if header.is_native() && way.load32(STATE) != STATE_LIVE {
            return Ok(None);
        }
        way.claim(topic, part)?;
        let reader = match &way {
            Way::Mapped { attached, .. } => begin(&*attached.memory, &header, beginning),
            Way::Guarded(guarded) => begin(&**guarded, &header, beginning),
        };
        Ok(Some(Attachment {
            way,
            header,
            reader,
            announced: None,
            legacy: LegacyLife {
                alive: true,
                published: 0,
                next_look: Instant::now() + LEGACY_LOOKS,
                peer: None,
            },
        }))
    }

    /// What wakes those who sleep on the segment.
    pub(crate) fn alarm(&self) -> Option<Arc<dyn Alarm>> {
        match &self.way {
            Way::Mapped { attached, .. } => Some(attached.memory.clone()),
            Way::Guarded(guarded) if guarded.is_mapped() => Some(guarded.clone()),
            Way::Guarded(_) => None,
        }
    }

    /// Whether there is no word to sleep on.
    pub(crate) fn is_unmapped(&self) -> bool {
        matches!(&self.way, Way::Guarded(guarded) if !guarded.is_mapped())
    }

    pub(crate) fn header(&self) -> &Header {
        &self.header
    }

    pub(crate) fn incarnation(&self) -> Incarnation {
        Incarnation {
            instance_id: self.header.instance_id(),
            epoch: self.way.load32(WRITER_EPOCH),
            pid: self.way.load32(WRITER_PID),
        }
    }

    pub(crate) fn reader(&self) -> &Reader {
        &self.reader
    }

    pub(crate) fn past(&self) -> Past {
        Past {
            instance_id: instance_id(&self.header),
            cursor: self.reader.cursor(),
            lost: self.reader.lost_since_delivery(),
        }
    }

    /// Sleeps until there is news, or for no reason.
    pub(crate) fn sleep(&self, timeout: Duration, news: impl FnOnce() -> bool) {
        match &self.way {
            Way::Mapped {
                attached,
                reader_slot: Some(reader_slot),
            } => wait::sleep(&attached.memory, reader_slot.number(), timeout, news),
            Way::Mapped {
                attached,
                reader_slot: None,
            } => wait::sleep_unseen(&attached.memory, timeout, news),
            Way::Guarded(guarded) => guarded.sleep(timeout, news),
        }
    }

    #[inline]
    pub(crate) fn next(
        &mut self,
        topic: &Topic,
        policy: Policy,
        sink: &mut impl Sink,
    ) -> Result<Option<Meta>, Error> {
        let lost_before = self.reader.lost_total();
        match &self.way {
            Way::Mapped { attached, .. } => {
                let meta = self.reader.next(&*attached.memory, policy, sink);
                self.show(lost_before);
                Ok(meta)
            }
            Way::Guarded(guarded) => {
                let meta = self.reader.next(&**guarded, policy, sink);
                guarded.check(topic).map(|()| meta)
            }
        }
    }

    /// Shows in the reader slot how far the reader is.
    #[inline]
    fn show(&self, lost_before: u64) {
        let Way::Mapped {
            attached,
            reader_slot: Some(reader_slot),
        } = &self.way
        else {
            return;
        };
        let (memory, reader_slot) = (&attached.memory, reader_slot.number());
        memory
            .u64(reader_slot.read_idx())
            .store(self.reader.cursor(), Relaxed);
        if self.reader.lost_total() != lost_before {
            memory
                .u64(reader_slot.lost_count())
                .store(self.reader.lost_total(), Relaxed);
        }
    }

    /// As [`Attachment::next`], without a copy where the publisher respects a hold.
    pub(crate) fn lease(&mut self, topic: &Topic, policy: Policy) -> Result<Option<Lease>, Error> {
        if !self.has_news() {
            return Ok(None);
        }
        match &self.way {
            Way::Mapped {
                attached,
                reader_slot: Some(reader_slot),
            } if self.header.is_native() => {
                let (attached, reader_slot) = (attached.clone(), reader_slot.clone());
                self.lease_slot(topic, policy, &attached.memory, &reader_slot)
            }
            _ => {
                let mut copy = IntoBox::default();
                let meta = self.next(topic, policy, &mut copy)?;
                Ok(meta.map(|meta| copied_lease(copy, meta, topic)))
            }
        }
    }

    fn lease_slot(
        &mut self,
        topic: &Topic,
        policy: Policy,
        memory: &Memory,
        reader_slot: &Arc<Registration>,
    ) -> Result<Option<Lease>, Error> {
        let ticket = Ticket::take(reader_slot).ok_or_else(|| Error::TooManyLeases {
            path: topic.path().to_owned(),
        })?;
        let view = ticket
            .borrow_view()
            .map_err(Error::os("map", topic.path()))?;
        let announced = *self
            .announced
            .get_or_insert_with(|| pins::announce(memory, reader_slot.number()));
        let lost_before = self.reader.lost_total();
        let mut copy = IntoBox::default();
        let taken = self.reader.search(memory, policy, |reader| {
            let held = announced.protects(memory, reader.cursor());
            let meta = if held {
                reader.take_pinned(memory, ticket.pin())
            } else {
                reader.take(memory, &mut copy)
            };
            meta.map(|meta| (meta, held))
        });
        self.show(lost_before);
        Ok(match taken {
            Some((meta, true)) => {
                let at = self.header.geometry.slot_offset(meta.sequence);
                let path = topic.path().to_owned();
                Some(Lease::of_slot(meta, ticket, view, at, path))
            }
            Some((meta, false)) => {
                ticket.return_view(view);
                Some(copied_lease(copy, meta, topic))
            }
            None => {
                ticket.return_view(view);
                None
            }
        })
    }

    pub(crate) fn has_news(&self) -> bool {
        match &self.way {
            Way::Mapped { attached, .. } => self.reader.has_news(&*attached.memory),
            // Trouble is news.
            Way::Guarded(guarded) => self.reader.has_news(&**guarded) || guarded.is_broken(),
        }
    }

    /// Whether the file has turned out to be unreadable.
    pub(crate) fn is_broken(&self) -> bool {
        matches!(&self.way, Way::Guarded(guarded) if guarded.is_broken())
    }

    /// Whether the state that stands in the segment says that its publisher goes on. Cheap.
    pub(crate) fn says_live(&self) -> bool {
        !self.header.is_native() || self.way.load32(STATE) == STATE_LIVE
    }

    /// Looks whether the publisher lives and the topic is still this segment.
    pub(crate) fn life(&mut self, topic: &Topic) -> io::Result<Life> {
        let segment = self.way.segment();
        let header = segment.head::<FIXED_LEN>()?;
        let len = segment.len()?;
        let unchanged = header.is_some_and(|bytes| Header::decode(&bytes, len) == Ok(self.header));
        if !unchanged || !self.says_live() {
            return Ok(Life::Over);
        }
        let name = segment.name(topic.path())?;
        let alive = if self.header.is_native() {
            segment.is_locked(PUBLISHER_LOCK)?
        } else {
            self.legacy_publisher_lives()
        };
        Ok(judge(self.header.is_native(), alive, name))
    }

    /// Whether a legacy publisher lives, as far as is known: it publishes, or some process has the segment mapped as it would.
    fn legacy_publisher_lives(&mut self) -> bool {
        let now = Instant::now();
        let published = match &self.way {
            Way::Mapped { attached, .. } => source::published(&*attached.memory),
            Way::Guarded(guarded) => source::published(&**guarded),
        };
        if published != self.legacy.published {
            self.legacy.published = published;
            self.legacy.alive = true;
            self.legacy.next_look = now + LEGACY_LOOKS;
        } else if now >= self.legacy.next_look {
            let last = self.legacy.peer;
            self.legacy.peer = match &self.way {
                Way::Mapped {
                    attached,
                    reader_slot,
                } => {
                    let own = reader_slot.as_ref().map(|reader_slot| reader_slot.number());
                    processes::legacy_peer(&attached.segment, &*attached.memory, own, last)
                }
                Way::Guarded(guarded) => {
                    processes::legacy_peer(&guarded.segment, &**guarded, None, last)
                }
            };
            self.legacy.alive = self.legacy.peer.is_some();
            self.legacy.next_look = Instant::now() + LEGACY_LOOKS;
        }
        self.legacy.alive
    }

    /// The longest sleep without a look at the publisher.
    pub(crate) fn longest_sleep(&self) -> Duration {
        if self.header.is_native() {
            LONGEST_SLEEP
        } else {
            LONGEST_LEGACY_SLEEP
        }
    }

    /// Claims a reader slot again if the claim was wiped: a legacy publisher that starts anew clears the header.
    pub(crate) fn renew_claim(&mut self, topic: &Topic) -> Result<(), Error> {
        let Way::Mapped {
            attached,
            reader_slot: Some(reader_slot),
        } = &mut self.way
        else {
            return Ok(());
        };
        if reader_slot.stands() {
            return Ok(());
        }
        reader_slot
            .give_up()
            .map_err(Error::os("unlock", topic.path()))?;
        self.announced = None;
        *reader_slot = Registration::claim(topic, attached)?;
        Ok(())
    }
}

fn begin(source: &impl Source, header: &Header, beginning: Beginning) -> Reader {
    let dialect = if header.is_native() {
        Dialect::Native
    } else {
        Dialect::Legacy
    };
    match beginning {
        Beginning::At(start) => Reader::begin(source, dialect, start),
        Beginning::After(past) => {
            let known = past.instance_id.is_some() && past.instance_id == instance_id(header);
            Reader::resume(dialect, if known { past.cursor } else { 0 }, past.lost)
        }
    }
}

fn copied_lease(copy: IntoBox, meta: Meta, topic: &Topic) -> Lease {
    Lease::of_copy(meta, copy.into_bytes(meta.len), topic.path().to_owned())
}

fn judge(native: bool, alive: bool, name: Name) -> Life {
    match (native, alive, name) {
        (_, _, Name::Other) => Life::Over,
        (true, true, _) | (false, true, Name::Same) => Life::Up,
        (_, false, Name::Same) => Life::Down,
        (_, _, Name::Missing) => Life::Over,
    }
}

/// `None` without the extension.
fn instance_id(header: &Header) -> Option<u64> {
    header.is_native().then_some(header.instance_id())
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
    fn a_legacy_segment_lives_by_its_name_and_by_who_has_it_mapped() {
        assert_eq!(judge(false, true, Name::Same), Life::Up);
        assert_eq!(judge(false, false, Name::Same), Life::Down);
        for alive in [false, true] {
            assert_eq!(judge(false, alive, Name::Missing), Life::Over);
            assert_eq!(judge(false, alive, Name::Other), Life::Over);
        }
    }
}
