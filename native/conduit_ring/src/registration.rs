//! A reader's hold on its reader slot: given up when neither the reader nor a lease needs it any more.

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

pub(crate) struct Registration {
    attached: Arc<Attached>,
    claim: Claim,
    given_up: AtomicBool,
    owner: Owner,
    /// Bit i: ticket i is out.
    tickets: AtomicU32,
    /// Mappings that leases looked through and the next ones will.
    views: Mutex<Vec<Mapping>>,
}

impl Registration {
    /// Claims a reader slot.
    pub(crate) fn claim(
        topic: &Topic,
        attached: &Arc<Attached>,
    ) -> Result<Arc<Registration>, Error> {
        let who = Claimant {
            id: os::random_id().map_err(Error::os("getrandom", topic.path()))?,
            pid: std::process::id(),
            start_time: os::process_start_time(),
        };
        let claim = Claim::take(&attached.memory, &attached.segment, who)
            .map_err(Error::os("lock", topic.path()))?
            .ok_or_else(|| Error::NoReaderSlot {
                path: topic.path().to_owned(),
            })?;
        Ok(Arc::new(Registration {
            attached: attached.clone(),
            claim,
            given_up: AtomicBool::new(false),
            owner: Owner::here(),
            tickets: AtomicU32::new(0),
            views: Mutex::default(),
        }))
    }

    pub(crate) fn number(&self) -> ReaderSlot {
        self.claim.reader_slot
    }

    /// Whether the segment still says that the reader slot is this reader's.
    pub(crate) fn stands(&self) -> bool {
        self.claim.stands(self.memory())
    }

    /// Gives the reader slot up, once.
    pub(crate) fn give_up(&self) -> io::Result<()> {
        if !self.owner.is_here() || self.given_up.swap(true, AcqRel) {
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
        let _ = self.give_up();
    }
}

/// The right to hold one message: a reader slot has as many as it has pins.
pub(crate) struct Ticket {
    reader_slot: Arc<Registration>,
    number: usize,
}

impl Ticket {
    /// `None` when all are out.
    pub(crate) fn take(reader_slot: &Arc<Registration>) -> Option<Ticket> {
        let all = reader_slot.number().pins().len();
        let out = reader_slot.tickets.load(Relaxed);
        let number = (0..all).find(|number| out & 1 << number == 0)?;
        // Acquire: meets the Release in drop, so that a pin is taken away before it is set anew. Only the one subscriber takes.
        reader_slot.tickets.fetch_or(1 << number, Acquire);
        Some(Ticket {
            reader_slot: reader_slot.clone(),
            number,
        })
    }

    /// The pin that goes with it.
    pub(crate) fn pin(&self) -> At64 {
        self.reader_slot.number().pins()[self.number]
    }

    /// A mapping to look through; read-only, and apart from the reader's own, so that it can become private.
    pub(crate) fn borrow_view(&self) -> io::Result<Mapping> {
        if let Some(view) = self.reader_slot.views().pop() {
            return Ok(view);
        }
        let len = self.reader_slot.attached.header.geometry.segment_len();
        self.reader_slot
            .attached
            .segment
            .map(len, Access::Read, false)
    }

    pub(crate) fn return_view(&self, view: Mapping) {
        self.reader_slot.views().push(view);
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        if !self.reader_slot.given_up.load(Acquire) && self.reader_slot.owner.is_here() {
            pins::unpin(self.reader_slot.memory(), self.pin());
        }
        self.reader_slot
            .tickets
            .fetch_and(!(1 << self.number), Release);
    }
}
