//! A reader's registration in a segment: a claimed reader slot that a subscriber shares with its
//! leases.
//!
//! A lease may outlive its subscriber, and its pin lies in the reader slot. So the slot is
//! released by whichever of them is dropped last.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU32};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::attach::Attached;
use crate::claim::{Claim, Claimant};
use crate::error::Error;
use crate::layout::{At64, ReaderSlot};
use crate::memory::Memory;
use crate::os::{self, Access, Mapping};
use crate::owner::Owner;
use crate::pins;
use crate::sync::Ordering::{AcqRel, Acquire, Relaxed, Release};
use crate::topic::Topic;

/// See the module.
pub(crate) struct Registration {
    attached: Arc<Attached>,
    claim: Claim,
    released: AtomicBool,
    owner: Owner,
    /// Bit i: permit i is taken.
    permits: AtomicU32,
    /// Mappings that leases no longer use, for the next ones.
    views: Mutex<Vec<Mapping>>,
}

impl Registration {
    /// Claims a reader slot.
    pub(crate) fn claim(
        topic: &Topic,
        attached: &Arc<Attached>,
    ) -> Result<Arc<Registration>, Error> {
        let claimant = Claimant {
            id: os::random_id().map_err(Error::os("getrandom", topic.path()))?,
            pid: std::process::id(),
            start_time: os::process_start_time(),
        };
        let claim = Claim::take(&attached.memory, &attached.segment, claimant)
            .map_err(Error::os("lock", topic.path()))?
            .ok_or_else(|| Error::NoReaderSlot {
                path: topic.path().to_owned(),
            })?;
        Ok(Arc::new(Registration {
            attached: attached.clone(),
            claim,
            released: AtomicBool::new(false),
            owner: Owner::here(),
            permits: AtomicU32::new(0),
            views: Mutex::default(),
        }))
    }

    /// Returns the claimed reader slot.
    pub(crate) fn slot(&self) -> ReaderSlot {
        self.claim.reader_slot
    }

    /// Returns whether the segment still says that the reader slot is this reader's.
    pub(crate) fn is_current(&self) -> bool {
        self.claim.is_current(self.memory())
    }

    /// Releases the reader slot, once. In a forked child it does nothing.
    pub(crate) fn release(&self) -> io::Result<()> {
        // AcqRel: one of several threads releases, behind all that the others did before.
        if !self.owner.is_here() || self.released.swap(true, AcqRel) {
            return Ok(());
        }
        self.claim.release(self.memory(), &self.attached.segment)
    }

    fn memory(&self) -> &Memory {
        &self.attached.memory
    }

    fn views(&self) -> MutexGuard<'_, Vec<Mapping>> {
        self.views.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Registration {
    fn drop(&mut self) {
        // Closing the file frees the lock in any case.
        let _ = self.release();
    }
}

/// The right to hold one message. A registration has as many as its reader slot has pins.
pub(crate) struct Permit {
    registration: Arc<Registration>,
    number: usize,
}

impl Permit {
    /// Takes a permit. Returns `None` when all are taken.
    pub(crate) fn take(registration: &Arc<Registration>) -> Option<Permit> {
        let all = registration.slot().pins().len();
        // Relaxed: only the one subscriber takes permits, so that a free one stays free.
        let taken = registration.permits.load(Relaxed);
        let number = (0..all).find(|number| taken & 1 << number == 0)?;
        // Acquire: pairs with the Release in drop, so that a pin is cleared before it is set
        // again.
        registration.permits.fetch_or(1 << number, Acquire);
        Some(Permit {
            registration: registration.clone(),
            number,
        })
    }

    /// Returns the pin that belongs to the permit.
    pub(crate) fn pin(&self) -> At64 {
        self.registration.slot().pins()[self.number]
    }

    /// Returns a mapping to look through. It is read-only, and apart from the reader's own, so
    /// that it can become private.
    pub(crate) fn borrow_view(&self) -> io::Result<Mapping> {
        if let Some(view) = self.registration.views().pop() {
            return Ok(view);
        }
        let attached = &self.registration.attached;
        let len = attached.header.geometry.segment_len();
        attached.segment.map(len, Access::Read, false)
    }

    /// Keeps a mapping for the next permit.
    pub(crate) fn return_view(&self, view: Mapping) {
        self.registration.views().push(view);
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        // Acquire: pairs with the AcqRel in release; behind it the pin may be another reader's.
        if !self.registration.released.load(Acquire) && self.registration.owner.is_here() {
            pins::unpin(self.registration.memory(), self.pin());
        }
        // Release: pairs with the Acquire in take.
        let taken = &self.registration.permits;
        taken.fetch_and(!(1 << self.number), Release);
    }
}
