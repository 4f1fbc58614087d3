//! Objects from before a fork.
//!
//! A forked child shares its parent's locks and ring position. Were it to use or to close them, it would do so behind the
//! parent's back; so it may do neither.

use std::mem::ManuallyDrop;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Forks between the first process and this one.
static FORKS: AtomicU32 = AtomicU32::new(0);

/// Called in every forked child.
#[pyfunction]
pub(crate) fn _after_fork() {
    FORKS.fetch_add(1, Relaxed);
}

/// The generation of processes in which something was made.
#[derive(Clone, Copy)]
pub(crate) struct Birth(u32);

impl Birth {
    pub(crate) fn now() -> Birth {
        Birth(FORKS.load(Relaxed))
    }

    pub(crate) fn is_here(self) -> bool {
        self.0 == FORKS.load(Relaxed)
    }

    pub(crate) fn check(self, what: &str) -> PyResult<()> {
        if self.is_here() {
            return Ok(());
        }
        Err(PyRuntimeError::new_err(format!(
            "the {what} belongs to the process that this one was forked from; open one here"
        )))
    }
}

/// A value that is dropped only by the process that made it.
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
            // SAFETY: the value is dropped here alone and not used again.
            unsafe { ManuallyDrop::drop(&mut self.value) };
        }
    }
}
