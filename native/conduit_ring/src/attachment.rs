//! A subscriber's attachment to one segment: the way in which it reads, its cursor, and the life
//! of the segment's publisher.
//!
//! ```text
//!                    open: file found, header sound, state live
//!                                     │
//!                                     ▼
//!            lock free          ┌───────────┐     state closed or retired,
//!          ┌─────────────────── │    Up     │ ─── name leads elsewhere, ──┐
//!          ▼                    └───────────┘     header changed          ▼
//!    ┌───────────┐                 ▲                                ┌───────────┐
//!    │   Down    │ ────────────────┘                                │   Over    │
//!    └───────────┘  lock taken: a successor continues in place      └───────────┘
//!          │                                                              ▲
//!          └──────────── as from Up, or the name was removed ─────────────┘
//! ```
//!
//! `Over` is final: the subscriber drops the attachment and awaits the topic's next segment. In
//! `Down` and `Over` the messages that are left are still delivered before the subscriber reports
//! the end.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use crate::attach;
use crate::backing::{Backing, Role};
use crate::delivery::{Meta, Policy, Start};
use crate::error::{Error, Fault};
use crate::header::{FIXED_LEN, Header};
use crate::layout::{PUBLISHER_LOCK, STATE, STATE_LIVE, WRITER_EPOCH, WRITER_PID};
use crate::lease::Lease;
use crate::life::{LegacyPublisher, Life, life_of};
use crate::memory::Memory;
use crate::options::Guard;
use crate::outcome::Incarnation;
use crate::pins::{self, Announced};
use crate::reader::{Dialect, Reader};
use crate::registration::{Permit, Registration};
use crate::sink::{IntoBox, Sink};
use crate::source::Source;
use crate::sync::Ordering::Relaxed;
use crate::topic::Topic;
use crate::wait::{LONGEST_LEGACY_SLEEP, LONGEST_SLEEP};
use crate::waker::Alarm;

/// Where a reader begins in a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Beginning {
    /// At the messages that the user asked for.
    At(Start),
    /// Where the subscriber stopped in the segment that it read before.
    After(Progress),
}

/// What a subscriber remembers of the segment that it read before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Progress {
    /// The segment's number, if it had one.
    instance_id: Option<u64>,
    cursor: u64,
    /// Messages lost there since the last delivery.
    pub(crate) lost: u64,
}

/// See the module.
pub(crate) struct Attachment {
    backing: Backing,
    header: Header,
    reader: Reader,
    /// What is known since the first lease.
    announced: Option<Announced>,
    legacy: LegacyPublisher,
}

impl Attachment {
    /// Attaches to a topic. Returns `None` when it has no segment that is alive, or not yet.
    pub(crate) fn open(
        topic: &Topic,
        role: Role,
        guard: Guard,
        beginning: Beginning,
    ) -> Result<Option<Attachment>, Error> {
        let trust_all = guard == Guard::Never;
        let Some(found) = attach::open_to_read(topic, role.access(), trust_all)? else {
            return Ok(None);
        };
        let header = match attach::read_header(topic, &found.segment)? {
            Ok(header) => header,
            Err(Fault::NotReady) => return Ok(None),
            Err(fault) => return Err(attach::bad(topic, fault)),
        };
        let mut backing = Backing::open(topic, role, guard, found, header)?;
        if header.is_native() && backing.load32(STATE) != STATE_LIVE {
            return Ok(None);
        }
        backing.register(topic, role)?;
        let reader = match &backing {
            Backing::Mapped { attached, .. } => begin(&*attached.memory, &header, beginning),
            Backing::Guarded(guarded) => begin(&**guarded, &header, beginning),
        };
        Ok(Some(Attachment {
            backing,
            header,
            reader,
            announced: None,
            legacy: LegacyPublisher::new(),
        }))
    }

    /// As [`Backing::alarm`].
    pub(crate) fn alarm(&self) -> Option<Arc<dyn Alarm>> {
        self.backing.alarm()
    }

    /// As [`Backing::is_unmapped`].
    pub(crate) fn is_unmapped(&self) -> bool {
        self.backing.is_unmapped()
    }

    /// As [`Backing::is_broken`].
    pub(crate) fn is_broken(&self) -> bool {
        self.backing.is_broken()
    }

    /// As [`Backing::sleep`].
    pub(crate) fn sleep(&self, timeout: Duration, news: impl FnOnce() -> bool) {
        self.backing.sleep(timeout, news);
    }

    pub(crate) fn header(&self) -> &Header {
        &self.header
    }

    pub(crate) fn reader(&self) -> &Reader {
        &self.reader
    }

    pub(crate) fn incarnation(&self) -> Incarnation {
        Incarnation {
            instance_id: self.header.instance_id(),
            epoch: self.backing.load32(WRITER_EPOCH),
            pid: self.backing.load32(WRITER_PID),
        }
    }

    pub(crate) fn progress(&self) -> Progress {
        Progress {
            instance_id: instance_id(&self.header),
            cursor: self.reader.cursor(),
            lost: self.reader.lost_since_delivery(),
        }
    }

    /// Copies the next message into the sink.
    #[inline]
    pub(crate) fn next(
        &mut self,
        topic: &Topic,
        policy: Policy,
        sink: &mut impl Sink,
    ) -> Result<Option<Meta>, Error> {
        let lost_before = self.reader.lost_total();
        match &self.backing {
            Backing::Mapped { attached, .. } => {
                let meta = self.reader.next(&*attached.memory, policy, sink);
                self.report_progress(lost_before);
                Ok(meta)
            }
            Backing::Guarded(guarded) => {
                let meta = self.reader.next(&**guarded, policy, sink);
                guarded.check(topic).map(|()| meta)
            }
        }
    }

    /// Writes into the reader slot how far the reader is. Relaxed: people read it, and nothing is
    /// decided by it.
    #[inline]
    fn report_progress(&self, lost_before: u64) {
        let Backing::Mapped {
            attached,
            registration: Some(registration),
        } = &self.backing
        else {
            return;
        };
        let (memory, reader_slot) = (&attached.memory, registration.slot());
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
    pub(crate) fn lease(
        &mut self,
        topic: &Topic,
        policy: Policy,
    ) -> Result<Option<Lease>, Error> {
        if !self.has_news() {
            return Ok(None);
        }
        match &self.backing {
            Backing::Mapped {
                attached,
                registration: Some(registration),
            } if self.header.is_native() => {
                let (attached, registration) = (attached.clone(), registration.clone());
                self.lease_slot(topic, policy, &attached.memory, &registration)
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
        registration: &Arc<Registration>,
    ) -> Result<Option<Lease>, Error> {
        let permit = Permit::take(registration).ok_or_else(|| Error::TooManyLeases {
            path: topic.path().to_owned(),
        })?;
        let view = permit
            .borrow_view()
            .map_err(Error::os("map", topic.path()))?;
        let announced = *self
            .announced
            .get_or_insert_with(|| pins::announce(memory, registration.slot()));
        let lost_before = self.reader.lost_total();
        let mut copy = IntoBox::default();
        let taken = self.reader.search(memory, policy, |reader| {
            let held = announced.protects(memory, reader.cursor());
            let meta = if held {
                reader.take_pinned(memory, permit.pin())
            } else {
                reader.take(memory, &mut copy)
            };
            meta.map(|meta| (meta, held))
        });
        self.report_progress(lost_before);
        Ok(match taken {
            Some((meta, true)) => {
                let at = self.header.geometry.slot_offset(meta.sequence);
                let path = topic.path().to_owned();
                Some(Lease::of_slot(meta, permit, view, at, path))
            }
            Some((meta, false)) => {
                permit.return_view(view);
                Some(copied_lease(copy, meta, topic))
            }
            None => {
                permit.return_view(view);
                None
            }
        })
    }

    /// Returns whether there is a message to look at, or an error to report.
    pub(crate) fn has_news(&self) -> bool {
        match &self.backing {
            Backing::Mapped { attached, .. } => self.reader.has_news(&*attached.memory),
            Backing::Guarded(guarded) => self.reader.has_news(&**guarded) || guarded.is_broken(),
        }
    }

    /// Returns whether the segment's own state is live. Costs one load.
    pub(crate) fn says_live(&self) -> bool {
        !self.header.is_native() || self.backing.load32(STATE) == STATE_LIVE
    }

    /// Checks whether the publisher lives and the topic is still this segment. A few system
    /// calls.
    pub(crate) fn life(&mut self, topic: &Topic) -> io::Result<Life> {
        let segment = self.backing.segment();
        let header = segment.head::<FIXED_LEN>()?;
        let len = segment.len()?;
        let is_own = |bytes| Header::decode(&bytes, len) == Ok(self.header);
        let unchanged = header.is_some_and(is_own);
        if !unchanged || !self.says_live() {
            return Ok(Life::Over);
        }
        let name = segment.name(topic.path())?;
        let alive = if self.header.is_native() {
            segment.is_locked(PUBLISHER_LOCK)?
        } else {
            self.legacy.is_alive(&self.backing)
        };
        Ok(life_of(self.header.is_native(), alive, name))
    }

    /// Returns the longest sleep without a check of the publisher.
    pub(crate) fn longest_sleep(&self) -> Duration {
        if self.header.is_native() {
            LONGEST_SLEEP
        } else {
            LONGEST_LEGACY_SLEEP
        }
    }

    /// Claims a reader slot again if the claim was wiped.
    pub(crate) fn renew_registration(&mut self, topic: &Topic) -> Result<(), Error> {
        if self.backing.renew_registration(topic)? {
            self.announced = None;
        }
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
        Beginning::After(progress) => {
            let same = instance_id(header);
            let known = progress.instance_id.is_some() && progress.instance_id == same;
            let cursor = if known { progress.cursor } else { 0 };
            Reader::resume(dialect, cursor, progress.lost)
        }
    }
}

fn copied_lease(copy: IntoBox, meta: Meta, topic: &Topic) -> Lease {
    Lease::of_copy(meta, copy.into_bytes(meta.len), topic.path().to_owned())
}

/// `None` without the extension.
fn instance_id(header: &Header) -> Option<u64> {
    header.is_native().then_some(header.instance_id())
}
