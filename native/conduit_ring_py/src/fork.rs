//! Objects that were created before a fork.
//!
//! A forked child shares its parent's locks and ring position. If it used or closed them, it
//! would disturb the parent, so it may do neither.

use std::mem::ManuallyDrop;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// The number of forks between the first process and this one.
static FORKS: AtomicU32 = AtomicU32::new(0);

/// Counts a fork. Every forked child calls it.
#[pyfunction]
pub(crate) fn _after_fork() {
    FORKS.fetch_add(1, Relaxed);
}

/// The generation of processes in which an object was created.
#[derive(Clone, Copy)]
pub(crate) struct Birth(u32);

impl Birth {
    pub(crate) fn now() -> Birth {
        Birth(FORKS.load(Relaxed))
    }

    /// Returns whether this process created the object.
    pub(crate) fn is_here(self) -> bool {
        self.0 == FORKS.load(Relaxed)
    }

    /// Checks that this process created the object.
    pub(crate) fn check(self, kind: &str) -> PyResult<()> {
        if self.is_here() {
            return Ok(());
        }
        Err(PyRuntimeError::new_err(format!(
            "{kind} belongs to the process that this one was forked from; \
             open one in this process"
        )))
    }
}

/// A value that only the process which created it drops.
pub(crate) struct Own<T> {
    value: ManuallyDrop<T>,
    birth: Birth,
}

impl<T> Own<T> {
    pub(crate) fn new(value: T) -> Own<T> {
        Own {
            value: ManuallyDrop::new(value),
            birth: Birth::now(),
        }
    }

    pub(crate) fn get(&mut self) -> &mut T {
        &mut self.value
    }
}

impl<T> Drop for Own<T> {
    fn drop(&mut self) {
        if self.birth.is_here() {
            // SAFETY: the value is dropped only here and not used again.
            unsafe { ManuallyDrop::drop(&mut self.value) };
        }
    }
}
