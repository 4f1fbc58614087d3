//! A reader's hold on its line: given up when neither the reader nor a lease needs it any more.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU32};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::attach::Attached;
use crate::claim::{Claim, Claimant};
use crate::error::Error;
use crate::layout::{At64, ReaderLine};
use crate::memory::Memory;
use crate::os::{self, Access, Mapping};
use crate::owner::Owner;
use crate::pins;
use crate::sync::Ordering::{AcqRel, Acquire, Relaxed, Release};
use crate::topic::Topic;

pub(crate) struct Line {
    attached: Arc<Attached>,
    claim: Claim,
    given_up: AtomicBool,
    owner: Owner,
    /// Bit i: ticket i is out.
    tickets: AtomicU32,
    /// Mappings that leases looked through and the next ones will.
    views: Mutex<Vec<Mapping>>,
}

impl Line {
    /// Claims a line.
    pub(crate) fn claim(topic: &Topic, attached: &Arc<Attached>) -> Result<Arc<Line>, Error> {
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
        Ok(Arc::new(Line {
            attached: attached.clone(),
            claim,
            given_up: AtomicBool::new(false),
            owner: Owner::here(),
            tickets: AtomicU32::new(0),
            views: Mutex::default(),
        }))
    }

    pub(crate) fn number(&self) -> ReaderLine {
        self.claim.line
    }

    /// Whether the segment still says that the line is this reader's.
    pub(crate) fn stands(&self) -> bool {
        self.claim.stands(self.memory())
    }

    /// Gives the line up, once.
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

impl Drop for Line {
    fn drop(&mut self) {
        // Closing the file frees the lock in any case.
        let _ = self.give_up();
    }
}

/// The right to hold one message: a line has as many as it has pins.
pub(crate) struct Ticket {
    line: Arc<Line>,
    number: usize,
}

impl Ticket {
    /// `None` when all are out.
    pub(crate) fn take(line: &Arc<Line>) -> Option<Ticket> {
        let all = line.number().pins().len();
        let out = line.tickets.load(Relaxed);
        let number = (0..all).find(|number| out & 1 << number == 0)?;
        // Acquire: meets the Release in drop, so that a pin is taken away before it is set anew. Only the one subscriber takes.
        line.tickets.fetch_or(1 << number, Acquire);
        Some(Ticket {
            line: line.clone(),
            number,
        })
    }

    /// The pin that goes with it.
    pub(crate) fn pin(&self) -> At64 {
        self.line.number().pins()[self.number]
    }

    /// A mapping to look through; read-only, and apart from the reader's own, so that it can become private.
    pub(crate) fn borrow_view(&self) -> io::Result<Mapping> {
        if let Some(view) = self.line.views().pop() {
            return Ok(view);
        }
        let len = self.line.attached.header.geometry.segment_len();
        self.line.attached.segment.map(len, Access::Read, false)
    }

    pub(crate) fn return_view(&self, view: Mapping) {
        self.line.views().push(view);
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        if !self.line.given_up.load(Acquire) && self.line.owner.is_here() {
            pins::unpin(self.line.memory(), self.pin());
        }
        self.line.tickets.fetch_and(!(1 << self.number), Release);
    }
}
