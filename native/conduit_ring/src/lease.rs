//! A message that is read in its slot.

use std::fmt;
use std::path::PathBuf;

use crate::copy;
use crate::delivery::Meta;
use crate::error::Error;
use crate::layout::SLOT_HEADER_LEN;
use crate::os::Mapping;
use crate::registration::Permit;

/// A message that is held in its slot, not copied, until the lease is dropped.
///
/// While the lease lives the publisher leaves the message alone. It neither waits nor stops. When
/// it has gone round the ring and comes to this slot again, it passes the slot over, and the
/// slot's number with it, which other subscribers count as lost
/// ([`Info::dropped_pinned`](crate::Info::dropped_pinned)). Only when all slots are held does it
/// drop messages ([`PublishError::SlotHeld`](crate::PublishError::SlotHeld)).
///
/// So hold a lease for less than `slot_count - 1` periods of the topic, or
/// [`detach`](Lease::detach) it. A process that is killed holds nothing any more.
///
/// A subscriber has at most three such leases at a time. They may outlive it, and go to other
/// threads.
///
/// ```
/// use conduit_ring::{Publisher, PublisherOptions, Received, Subscriber, Topic};
///
/// # let name = format!("doc-lease-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// let mut subscriber = Subscriber::open(&topic, &Default::default())?;
/// publisher.publish(b"12.5 degrees").unwrap();
/// let Received::Message(meta, lease) = subscriber.try_lease()? else {
///     panic!("expected a message");
/// };
/// let mut unit = [0; 7];
/// lease.read_at(5, &mut unit);
/// assert_eq!((meta.len, &unit), (12, b"degrees"));
/// assert_eq!(publisher.info().readers[0].held, [0]);
/// drop(lease); // the publisher may use the slot again
/// # Ok::<(), conduit_ring::Error>(())
/// ```
///
/// # When it is a copy
///
/// A lease is a copy, made at once and not counted among the three, where the publisher would not
/// respect a hold: on a topic of a legacy publisher, in [guarded](crate::Guard) mode, and for a
/// message that the publisher may already be about to overwrite when the subscriber takes its
/// first lease. [`Lease::holds_slot`] distinguishes the two.
///
/// # The bytes
///
/// The bytes are shared memory. All processes that may write the topic's file and keep to the
/// protocol leave them alone while the lease lives. A process that breaks the protocol can change
/// them or cut them off (SIGBUS), as it can do with all of the ring. Hence [`Lease::as_slice`] is
/// unsafe; [`Lease::read_at`] and [`Lease::to_vec`] copy, and are safe.
pub struct Lease {
    meta: Meta,
    place: Place,
    /// `None` for a copy, and once detached.
    permit: Option<Permit>,
    path: PathBuf,
}

/// Where the bytes are.
enum Place {
    /// In a mapping of the lease's own: in the slot, or in private pages once detached.
    Mapped {
        /// `None` only while the lease is dropped.
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

    /// Returns sequence number, time, length and losses.
    pub fn meta(&self) -> Meta {
        self.meta
    }

    /// Returns the length of the message in bytes.
    pub fn len(&self) -> usize {
        self.meta.len
    }

    /// Returns whether the message has no bytes.
    pub fn is_empty(&self) -> bool {
        self.meta.len == 0
    }

    /// Returns whether the publisher leaves a slot alone for this lease. `false` for a copy, and
    /// once detached.
    pub fn holds_slot(&self) -> bool {
        self.permit.is_some()
    }

    /// Returns the address of the message: [`Lease::len`] bytes of any alignment, readable until
    /// the lease is dropped.
    pub fn as_ptr(&self) -> *const u8 {
        match &self.place {
            Place::Mapped { pages, at } => pages
                .as_ref()
                .map_or(std::ptr::null(), |pages| pages.base().wrapping_add(*at)),
            Place::Copied(bytes) => bytes.as_ptr(),
        }
    }

    /// Returns the message as a slice.
    ///
    /// # Safety
    /// While the slice is used, no process writes into this slot and none shortens the file. That
    /// is so when all processes that may write the file keep to the protocol.
    pub unsafe fn as_slice(&self) -> &[u8] {
        // SAFETY: `len` bytes are readable while self is borrowed, and do not change by the
        // caller's promise.
        unsafe { std::slice::from_raw_parts(self.as_ptr(), self.len()) }
    }

    /// Copies the bytes from `at` on into `to`.
    ///
    /// # Panics
    /// Panics if the message ends before `at + to.len()`.
    pub fn read_at(&self, at: usize, to: &mut [u8]) {
        assert!(
            at <= self.len() && to.len() <= self.len() - at,
            "expected a part inside the message of {} bytes, got: {} bytes from {at} on",
            self.len(),
            to.len()
        );
        // SAFETY: the source has these bytes by the assertion, the destination is a slice of this
        // process's own.
        unsafe { copy::out_of_shared(self.as_ptr().wrapping_add(at), to.as_mut_ptr(), to.len()) };
    }

    /// Returns a copy of the message.
    pub fn to_vec(&self) -> Vec<u8> {
        let mut bytes = vec![0; self.len()];
        self.read_at(0, &mut bytes);
        bytes
    }

    /// Gives the slot back to the publisher and keeps the bytes, at the same address.
    ///
    /// The pages under the bytes are replaced by private ones with the same content. For code
    /// that has handed the address out and cannot take it back, as runtimes with garbage
    /// collection do. Afterwards the lease does not count among the three any more. Detaching
    /// costs a copy. Other threads may read the bytes meanwhile.
    ///
    /// # Errors
    /// [`Error::Os`] when memory is short. The lease is then as it was.
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
