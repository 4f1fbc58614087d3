//! How the segment of an attachment is reached: through a mapping, or by `pread`.

use std::sync::Arc;
use std::time::Duration;

use crate::attach::{self, Attached, Found};
use crate::error::Error;
use crate::guarded::Guarded;
use crate::header::Header;
use crate::layout::{At32, ReaderSlot};
use crate::options::Guard;
use crate::os::{Access, Segment};
use crate::registration::Registration;
use crate::source;
use crate::sync::Ordering::Acquire;
use crate::topic::Topic;
use crate::wait;
use crate::waker::Alarm;

/// How a process takes part in a segment that it reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// In a reader slot of its own.
    Reader,
    /// Without a trace: the mapping is read-only.
    Observer,
}

impl Role {
    pub(crate) fn access(self) -> Access {
        match self {
            Role::Reader => Access::Write,
            Role::Observer => Access::Read,
        }
    }
}

/// An open segment, and the way in which it is read.
pub(crate) enum Backing {
    /// By loads from a mapping.
    Mapped {
        attached: Arc<Attached>,
        /// `None` for an observer.
        registration: Option<Arc<Registration>>,
    },
    /// By `pread`, for files that others could shorten.
    Guarded(Arc<Guarded>),
}

impl Backing {
    /// Chooses the way: a stranger's file is never mapped, and [`Guard`] decides about others.
    pub(crate) fn open(
        topic: &Topic,
        role: Role,
        guard: Guard,
        Found { segment, foreign }: Found,
        header: Header,
    ) -> Result<Backing, Error> {
        let access = role.access();
        let backing = match guard {
            _ if foreign || (guard == Guard::Always && !header.is_native()) => {
                Backing::Guarded(Arc::new(Guarded::unmapped(segment, header)))
            }
            Guard::Always => {
                Backing::Guarded(Arc::new(Guarded::open(topic, segment, header, access)?))
            }
            Guard::Auto => Backing::mapped(attach::map(topic, segment, header, access, false)?),
            Guard::Never => {
                Backing::mapped(attach::map_trusting(topic, segment, header, access, false)?)
            }
        };
        Ok(backing)
    }

    fn mapped(attached: Attached) -> Backing {
        Backing::Mapped {
            attached: Arc::new(attached),
            registration: None,
        }
    }

    /// Claims a reader slot, if the role and the way have one.
    pub(crate) fn register(&mut self, topic: &Topic, role: Role) -> Result<(), Error> {
        if let (
            Backing::Mapped {
                attached,
                registration,
            },
            Role::Reader,
        ) = (self, role)
        {
            *registration = Some(Registration::claim(topic, attached)?);
        }
        Ok(())
    }

    /// Claims a reader slot again if the claim was wiped: a legacy publisher that starts again
    /// clears the header. Returns whether it did.
    pub(crate) fn renew_registration(&mut self, topic: &Topic) -> Result<bool, Error> {
        let Backing::Mapped {
            attached,
            registration: Some(registration),
        } = self
        else {
            return Ok(false);
        };
        if registration.is_current() {
            return Ok(false);
        }
        registration
            .release()
            .map_err(Error::os("unlock", topic.path()))?;
        *registration = Registration::claim(topic, attached)?;
        Ok(true)
    }

    pub(crate) fn segment(&self) -> &Segment {
        match self {
            Backing::Mapped { attached, .. } => &attached.segment,
            Backing::Guarded(guarded) => &guarded.segment,
        }
    }

    /// Returns the reader slot that is held through this very segment.
    pub(crate) fn reader_slot(&self) -> Option<ReaderSlot> {
        match self {
            Backing::Mapped { registration, .. } => registration
                .as_ref()
                .map(|registration| registration.slot()),
            Backing::Guarded(_) => None,
        }
    }

    pub(crate) fn load32(&self, at: At32) -> u32 {
        match self {
            // Acquire: pairs with the Release with which a publisher closes or retires, so that
            // a reader that sees the end sees the last messages.
            Backing::Mapped { attached, .. } => attached.memory.u32(at).load(Acquire),
            Backing::Guarded(guarded) => guarded.load32(at),
        }
    }

    /// Returns how many messages have been published.
    pub(crate) fn published(&self) -> u64 {
        match self {
            Backing::Mapped { attached, .. } => source::published(&*attached.memory),
            Backing::Guarded(guarded) => source::published(&**guarded),
        }
    }

    /// Returns what wakes the threads that sleep on the segment.
    pub(crate) fn alarm(&self) -> Option<Arc<dyn Alarm>> {
        match self {
            Backing::Mapped { attached, .. } => Some(attached.memory.clone()),
            Backing::Guarded(guarded) if guarded.is_mapped() => Some(guarded.clone()),
            Backing::Guarded(_) => None,
        }
    }

    /// Returns whether there is no word to sleep on.
    pub(crate) fn is_unmapped(&self) -> bool {
        matches!(self, Backing::Guarded(guarded) if !guarded.is_mapped())
    }

    /// Returns whether the file has turned out to be unreadable.
    pub(crate) fn is_broken(&self) -> bool {
        matches!(self, Backing::Guarded(guarded) if guarded.is_broken())
    }

    /// Sleeps until there is news. May return early for no reason.
    pub(crate) fn sleep(&self, timeout: Duration, news: impl FnOnce() -> bool) {
        match self {
            Backing::Mapped {
                attached,
                registration: Some(registration),
            } => wait::sleep(&attached.memory, registration.slot(), timeout, news),
            Backing::Mapped {
                attached,
                registration: None,
            } => wait::sleep_unseen(&attached.memory, timeout, news),
            Backing::Guarded(guarded) => guarded.sleep(timeout, news),
        }
    }
}
