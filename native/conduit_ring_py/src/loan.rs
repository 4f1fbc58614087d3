//! A slot that is lent for writing during a `with` block.
//!
//! Each view and array keeps the slot's memory mapped, so that none of them becomes invalid after
//! the block. Writing after the block is prevented as far as Python allows: views are released,
//! arrays become read-only.

use std::ffi::c_int;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use conduit_ring::SuspendedLoan;
use pyo3::exceptions::{PyBufferError, PyValueError};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyMemoryView, PyTuple};

use crate::publication::Publication;
use crate::{bytes, message};

/// The memory of one loan.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Slot {
    loan: SuspendedLoan,
    ended: AtomicBool,
}

#[pymethods]
impl Slot {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let slot = slf.get();
        if slot.ended.load(SeqCst) {
            return Err(PyBufferError::new_err(ENDED));
        }
        let (start, len) = (slot.loan.as_mut_ptr(), slot.loan.len());
        // SAFETY: Python calls this function; the bytes stay mapped as long as the slot lives,
        // and Rust accesses them as shared memory.
        unsafe { bytes::export_writable(slf.as_any(), start, len, view, flags) }
    }
}

const ENDED: &str = "loan has ended with its block";

/// The next slot of a topic, lent for a ``with`` block by :meth:`Publisher.loan`.
///
/// The message is written in the slot, without another copy: ``data`` and ``array`` are writable
/// views of the ring. Leaving the block publishes the message. If an exception leaves it, nothing
/// is published, and the next message gets the same slot and number.
///
/// The slot contains bytes of older messages at first. During the loan nothing else can be
/// published, and the ring's oldest message is lost for subscribers that have not read it.
///
/// After the block, :attr:`data` and :meth:`array` raise ``ValueError``, and so does a
/// ``memoryview`` from :attr:`data`. An array from :meth:`array` becomes read-only and shows the
/// slot's later contents. A part of an array (``array[10:]``) stays writable: do not write to it
/// after the block, which would damage a published message.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Loan {
    /// Keeps the publisher open.
    _publisher: Py<PyAny>,
    publication: Arc<Publication>,
    size: usize,
    stage: Mutex<Stage>,
}

enum Stage {
    NotEntered,
    Lent(Lent),
    Ended,
}

struct Lent {
    slot: Py<Slot>,
    len: usize,
    views: Vec<Py<PyMemoryView>>,
    arrays: Vec<Py<PyAny>>,
}

#[pymethods]
impl Loan {
    /// The sequence number that the message will have.
    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        self.with_lent(|lent| lent.slot.get().loan.sequence())
    }

    /// The slot's bytes as a writable ``memoryview``, which is released with the block.
    #[getter]
    fn data(&self, py: Python<'_>) -> PyResult<Py<PyMemoryView>> {
        let slot = self.slot(py)?;
        let view = PyMemoryView::from(slot.bind(py).as_any())?.unbind();
        self.with_lent(|lent| lent.views.push(view.clone_ref(py)))?;
        Ok(view)
    }

    /// Return the slot's bytes as a writable numpy array, as :meth:`Message.array` does.
    ///
    /// Needs numpy.
    #[pyo3(
        signature = (dtype=None, shape=None, *, offset=0),
        text_signature = "($self, dtype='uint8', shape=None, *, offset=0)"
    )]
    fn array<'py>(
        &self,
        py: Python<'py>,
        dtype: Option<Bound<'py, PyAny>>,
        shape: Option<Bound<'py, PyAny>>,
        offset: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let slot = self.slot(py)?;
        let array = message::array(slot.bind(py).as_any(), dtype, shape, offset)?;
        self.with_lent(|lent| lent.arrays.push(array.clone().unbind()))?;
        Ok(array)
    }

    /// Shorten the message to its first ``size`` bytes.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If ``size`` is larger than the loan.
    fn truncate(&self, size: usize) -> PyResult<()> {
        let is_shorter = self.with_lent(|lent| {
            let is_shorter = size <= lent.len;
            lent.len = lent.len.min(size);
            is_shorter
        })?;
        if is_shorter {
            return Ok(());
        }
        Err(PyValueError::new_err(format!(
            "cannot make a loan longer, to {size} bytes"
        )))
    }

    fn __len__(&self) -> PyResult<usize> {
        self.with_lent(|lent| lent.len)
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __enter__<'py>(slf: PyRef<'py, Self>, py: Python<'py>) -> PyResult<PyRef<'py, Self>> {
        if !matches!(*slf.lock(), Stage::NotEntered) {
            return Err(PyValueError::new_err(
                "loan was entered already; get another one from the publisher",
            ));
        }
        let slot = Slot {
            loan: slf.publication.lend(py, slf.size)?,
            ended: AtomicBool::new(false),
        };
        let lent = Stage::Lent(Lent {
            slot: Py::new(py, slot)?,
            len: slf.size,
            views: Vec::new(),
            arrays: Vec::new(),
        });
        *slf.lock() = lent;
        Ok(slf)
    }

    #[pyo3(signature = (*exception))]
    fn __exit__(&self, py: Python<'_>, exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        let stage = mem::replace(&mut *self.lock(), Stage::Ended);
        let Stage::Lent(lent) = stage else {
            return Ok(());
        };
        let closed = lent.close(py);
        let raised = exception.get_item(0).is_ok_and(|kind| !kind.is_none());
        if raised || closed.is_err() {
            self.publication.cancel();
            return closed;
        }
        self.publication.commit(py, &lent.slot.get().loan, lent.len)
    }

    fn __repr__(&self) -> String {
        match &*self.lock() {
            Stage::NotEntered => format!("<Loan of {} bytes, not entered>", self.size),
            Stage::Lent(lent) => format!(
                "<Loan of {} bytes for message {}>",
                lent.len,
                lent.slot.get().loan.sequence()
            ),
            Stage::Ended => "<Loan, ended>".to_owned(),
        }
    }
}

impl Loan {
    pub(crate) fn new(publisher: Py<PyAny>, publication: Arc<Publication>, size: usize) -> Loan {
        Loan {
            _publisher: publisher,
            publication,
            size,
            stage: Mutex::new(Stage::NotEntered),
        }
    }

    fn slot(&self, py: Python<'_>) -> PyResult<Py<Slot>> {
        self.with_lent(|lent| lent.slot.clone_ref(py))
    }

    fn with_lent<R>(&self, action: impl FnOnce(&mut Lent) -> R) -> PyResult<R> {
        match &mut *self.lock() {
            Stage::Lent(lent) => Ok(action(lent)),
            Stage::NotEntered => Err(PyValueError::new_err(
                "loan is not entered; use it in a with block",
            )),
            Stage::Ended => Err(PyValueError::new_err(ENDED)),
        }
    }

    /// Locks the stage. No Python code runs while the lock is held.
    fn lock(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Lent {
    /// Releases the views and makes the arrays read-only.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.slot.get().ended.store(true, SeqCst);
        for view in &self.views {
            // Fails while another object uses the view.
            let _ = view.call_method0(py, "release");
        }
        for array in &self.arrays {
            array.call_method1(py, "setflags", (false,))?;
        }
        Ok(())
    }
}

/// Cancels a loan that was entered and never left.
impl Drop for Loan {
    fn drop(&mut self) {
        if matches!(*self.lock(), Stage::Lent(_)) {
            self.publication.cancel();
        }
    }
}
