//! Looking at a message where it lies.

use std::fmt;
use std::path::PathBuf;

use crate::copy;
use crate::delivery::Meta;
use crate::error::Error;
use crate::layout::SLOT_HEADER_LEN;
use crate::os::Mapping;
use crate::registration::Permit;

/// A message that stays what it is until the lease is dropped: not copied, but held in its slot.
///
/// While it is held the publisher leaves the message alone. It neither waits nor stops: when it has gone round the ring and
/// comes to this slot again, it passes it over, and the slot's number with it, which other subscribers count as lost
/// ([`Info::dropped_pinned`](crate::Info::dropped_pinned)). Only when all slots are held does it drop messages
/// ([`PublishError::SlotHeld`](crate::PublishError::SlotHeld)). So hold a lease for less than `slot_count - 1` periods of the
/// topic, or [`detach`](Lease::detach) it. A holder that is killed holds nothing any more.
///
/// A subscriber has at most three such leases at a time; they may outlive it, and go to other threads.
///
/// A lease is a copy, made at once and not counted among the three, where no publisher would respect a hold: on a topic of a legacy publisher, in guarded mode, and of a message that the publisher may already be about to
/// overwrite when the subscriber takes its first lease. [`Lease::holds_slot`] tells.
///
/// # The bytes
///
/// They are shared memory. All processes that may write the topic's file and keep to the protocol leave them alone while
/// the lease lasts; one that does not can change them under one's eyes or cut them off (SIGBUS), as it can do with all of
/// the ring. Hence [`Lease::as_slice`] is unsafe; [`Lease::read_at`] and [`Lease::to_vec`] copy, and are not.
pub struct Lease {
    meta: Meta,
    place: Place,
    /// `None` of a copy, and once detached.
    permit: Option<Permit>,
    path: PathBuf,
}

/// Where the bytes lie.
enum Place {
    /// In a mapping of the lease's own: the slot, or private pages once detached.
    Mapped {
        /// `None` only while it is dropped.
        pages: Option<Mapping>,
        at: usize,
    },
    Copied(Box<[u8]>),
}

impl Lease {
    pub(crate) fn of_slot(
        meta: Meta,
        permit: Permit,
        view: Mapping,
        slot_offset: usize,
        path: PathBuf,
    ) -> Lease {
        let place = Place::Mapped {
            pages: Some(view),
            at: slot_offset + SLOT_HEADER_LEN,
        };
        Lease {
            meta,
            place,
            permit: Some(permit),
            path,
        }
    }

    pub(crate) fn of_copy(meta: Meta, bytes: Box<[u8]>, path: PathBuf) -> Lease {
        Lease {
            meta,
            place: Place::Copied(bytes),
            permit: None,
            path,
        }
    }

    /// What the message says about itself.
    pub fn meta(&self) -> Meta {
        self.meta
    }

    /// Length of the message in bytes.
    pub fn len(&self) -> usize {
        self.meta.len
    }

    /// Whether the message has no bytes.
    pub fn is_empty(&self) -> bool {
        self.meta.len == 0
    }

    /// Whether the publisher leaves a slot alone for this lease; not so for a copy, and not once detached.
    pub fn holds_slot(&self) -> bool {
        self.permit.is_some()
    }

    /// Where the message lies: [`Lease::len`] bytes, readable until the lease is dropped. Of any alignment.
    pub fn as_ptr(&self) -> *const u8 {
        match &self.place {
            Place::Mapped { pages, at } => pages
                .as_ref()
                .map_or(std::ptr::null(), |pages| pages.base().wrapping_add(*at)),
            Place::Copied(bytes) => bytes.as_ptr(),
        }
    }

    /// The message.
    ///
    /// # Safety
    /// As long as the slice is used, no process writes into this slot and none shortens the file: all that may write it
    /// keep to the protocol.
    pub unsafe fn as_slice(&self) -> &[u8] {
        // SAFETY: `len` bytes are readable as long as self is borrowed, and do not change by the caller's promise.
        unsafe { std::slice::from_raw_parts(self.as_ptr(), self.len()) }
    }

    /// Copies the bytes from `at` on into `to`.
    ///
    /// # Panics
    /// When the message has not that many.
    pub fn read_at(&self, at: usize, to: &mut [u8]) {
        assert!(
            at <= self.len() && to.len() <= self.len() - at,
            "{} bytes from {at} on of a message of {}",
            to.len(),
            self.len()
        );
        // SAFETY: the source has these bytes by the assertion, the destination is a slice of this process's own.
        unsafe { copy::out_of_shared(self.as_ptr().wrapping_add(at), to.as_mut_ptr(), to.len()) };
    }

    /// A copy of the message.
    pub fn to_vec(&self) -> Vec<u8> {
        let mut bytes = vec![0; self.len()];
        self.read_at(0, &mut bytes);
        bytes
    }

    /// Gives the slot back to the publisher and keeps the bytes, at the same address: the pages under them are replaced by
    /// private ones with the same content. For those who have handed the address out and cannot take it back, as runtimes
    /// with garbage collection do. Does not count among the three leases any more.
    ///
    /// Costs a copy. Other threads may read the bytes meanwhile.
    ///
    /// # Errors
    /// [`Error::Os`] when there is no memory; then the lease is as it was.
    pub fn detach(&mut self) -> Result<(), Error> {
        if let Place::Mapped {
            pages: Some(pages),
            at,
        } = &mut self.place
            && self.permit.is_some()
        {
            *at = pages
                .make_private(*at, self.meta.len)
                .map_err(Error::os("detach", &self.path))?;
        }
        self.permit = None;
        Ok(())
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        if let (Some(permit), Place::Mapped { pages, .. }) = (&self.permit, &mut self.place)
            && let Some(view) = pages.take()
        {
            permit.return_view(view);
        }
    }
}

impl fmt::Debug for Lease {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Lease")
            .field("meta", &self.meta)
            .field("holds_slot", &self.holds_slot())
            .finish_non_exhaustive()
    }
}
