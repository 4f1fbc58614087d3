//! The state of a publisher, which its loans and its thread share.

use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use conduit_ring::{Info, PublishError, SuspendedLoan};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::errors;
use crate::fork::{Birth, Own};

/// The size of a message in bytes from which other Python threads run during the copy.
const DETACH_FROM: usize = 64 * 1024;

/// A publisher behind a lock.
pub(crate) struct Publication {
    birth: Birth,
    inner: Mutex<Option<Own<State>>>,
}

struct State {
    publisher: conduit_ring::Publisher,
    /// Whether a loan is outstanding. Its holder writes to the next message's slot, so nothing
    /// else is published.
    has_lent: bool,
    /// The next sequence number at the last check of the name.
    checked_at: Option<u64>,
}

impl Publication {
    pub(crate) fn new(publisher: conduit_ring::Publisher) -> Publication {
        Publication {
            birth: Birth::now(),
            inner: Mutex::new(Some(Own::new(State {
                publisher,
                has_lent: false,
                checked_at: None,
            }))),
        }
    }

    /// Publishes `parts` as one message.
    pub(crate) fn publish(&self, py: Python<'_>, parts: &[&[u8]]) -> PyResult<u64> {
        let publish = |state: &mut State| {
            let published = state.without_loan()?.publish_slices(parts);
            state.explain(published)
        };
        let size = parts.iter().map(|part| part.len()).sum::<usize>();
        if size < DETACH_FROM {
            self.with(py, publish)?
        } else {
            self.with_detached(py, publish)?
        }
    }

    /// Lends the next slot.
    pub(crate) fn lend(&self, py: Python<'_>, size: usize) -> PyResult<SuspendedLoan> {
        self.with(py, |state| {
            let loan = state.without_loan()?.loan(size).map(|loan| loan.suspend());
            state.has_lent = loan.is_ok();
            state.explain(loan)
        })?
    }

    /// Publishes the first `len` bytes of a loan.
    pub(crate) fn commit(
        &self,
        py: Python<'_>,
        loan: &SuspendedLoan,
        len: usize,
    ) -> PyResult<()> {
        let committed = self.with(py, |state| {
            state.has_lent = false;
            let mut loan = loan.resume(&mut state.publisher)?;
            loan.truncate(len);
            Some(loan.commit())
        })?;
        match committed {
            Some(_) => Ok(()),
            None => Err(PyRuntimeError::new_err(
                "loan's slot is no longer available",
            )),
        }
    }

    /// Cancels the outstanding loan.
    pub(crate) fn cancel(&self) {
        if self.birth.is_here()
            && let Some(state) = self.lock().as_mut()
        {
            state.get().has_lent = false;
        }
    }

    /// Returns the state of the topic.
    pub(crate) fn info(&self, py: Python<'_>) -> PyResult<Info> {
        self.with(py, |state| state.publisher.info())
    }

    /// Closes the publisher. Does nothing in a child of the process that opened it.
    pub(crate) fn close(&self) {
        if self.birth.is_here() {
            drop(self.lock().take());
        }
    }

    /// Returns whether the publisher is closed.
    pub(crate) fn is_closed(&self, py: Python<'_>) -> bool {
        !self.birth.is_here() || py.detach(|| self.lock().is_none())
    }

    /// Checks the topic's name. Returns `false` when the publisher is closed.
    pub(crate) fn check_name(&self) -> bool {
        match self.inner.try_lock() {
            Ok(mut inner) => match inner.as_mut() {
                Some(state) => {
                    state.get().check_name();
                    true
                }
                None => false,
            },
            // Another thread is publishing, which checks the name too.
            Err(TryLockError::WouldBlock) => true,
            Err(TryLockError::Poisoned(_)) => false,
        }
    }

    /// Calls `action` without running other Python threads, unless one of them is publishing.
    fn with<R: Send>(
        &self,
        py: Python<'_>,
        action: impl FnOnce(&mut State) -> R + Send,
    ) -> PyResult<R> {
        self.birth.check("publisher")?;
        let guard = match self.inner.try_lock() {
            Ok(guard) => guard,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return self.with_detached(py, action),
        };
        apply(guard, action)
    }

    /// Calls `action` detached from Python: a thread that waits for the lock must not keep Python
    /// from running, or the lock's holder could wait for Python.
    fn with_detached<R: Send>(
        &self,
        py: Python<'_>,
        action: impl FnOnce(&mut State) -> R + Send,
    ) -> PyResult<R> {
        self.birth.check("publisher")?;
        py.detach(|| apply(self.lock(), action))
    }

    fn lock(&self) -> MutexGuard<'_, Option<Own<State>>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn check_name(&mut self) {
        let next = Some(self.publisher.next_sequence());
        // A publisher that publishes checks its name itself. A loan is written to the current
        // file.
        if !self.has_lent && self.checked_at == next {
            // The next call that publishes raises the error, and the next check tries again.
            let _ = self.publisher.look_after();
        }
        self.checked_at = next;
    }

    /// Converts a result, and adds the reason to the error for a lost name.
    fn explain<T>(&self, result: Result<T, PublishError>) -> PyResult<T> {
        result.map_err(|error| errors::of_publish(error, self.publisher.trouble()))
    }

    /// Returns the publisher if no loan is outstanding.
    fn without_loan(&mut self) -> PyResult<&mut conduit_ring::Publisher> {
        if self.has_lent {
            return Err(PyRuntimeError::new_err(
                "publisher has an outstanding loan; leave its block first",
            ));
        }
        Ok(&mut self.publisher)
    }
}

fn apply<R>(
    mut guard: MutexGuard<'_, Option<Own<State>>>,
    action: impl FnOnce(&mut State) -> R,
) -> PyResult<R> {
    match guard.as_mut() {
        Some(state) => Ok(action(state.get())),
        None => Err(errors::closed("publisher")),
    }
}
